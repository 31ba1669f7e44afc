"""Two trajectories at the same stamps."""

from __future__ import annotations

import dataclasses
import enum
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, require_choice, require_numbers, require_type
from trundle.geometry import se2
from trundle.records import Trajectory
from trundle.records.columns import stamps as column_of_stamps

__all__ = ["Stamps", "associate", "at_times", "describe_spans", "interpolate", "shift", "span"]

Stamped = npt.NDArray[np.int64]
_LATEST = 9e9  # [s]: as far as int64 nanoseconds reach
Mask = npt.NDArray[np.bool_]


class Stamps(enum.Enum):
    """Whose stamps two trajectories are compared at; the other one is interpolated."""

    SPARSER = "sparser"
    """Of the one with fewer samples in the common time: the denser one loses less."""
    ESTIMATE = "estimate"
    REFERENCE = "reference"


def associate(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    max_gap: float = 1.0,
    time_offset: float = 0.0,
    stamps: Stamps | str = Stamps.SPARSER,
) -> tuple[Trajectory, Trajectory]:
    """Both trajectories at common stamps, which are stamps of one of them.

    The other one is interpolated there (see `interpolate`), never extrapolated. Samples without a
    position (NaN) are left out first. Where both have a sample at the same time, both come through as
    they are. Where one has no times (`Trajectory.timed`) they belong together row by row.

    Args:
        estimate: What is judged.
        reference: What it is judged by. Headings may be NaN.
        max_gap: Longest time between two samples that is interpolated over [s].
        time_offset: Added to the stamps of the estimate [s], where the clocks differ.
        stamps: Whose stamps are kept.

    Returns:
        Estimate and reference with equal `time_ns`, in the clock of the reference.

    Raises:
        InputError: If stamps go back, or nothing matches; the message says both time spans. If one has no
            times and they have not as many rows, or a time offset is given.
    """
    stamps = require_choice("stamps", stamps, Stamps)
    for name, trajectory in (("estimate", estimate), ("reference", reference)):
        require_type("associate", name, trajectory, Trajectory)
    require_numbers("associate", one={"max_gap": max_gap})
    if max_gap is None or not max_gap > 0.0:
        raise InputError(f"max_gap: {max_gap} s, must be > 0")
    estimate, reference = at_times(estimate, reference, time_offset)
    estimate = _measured("estimate", shift(estimate, time_offset))
    reference = _measured("reference", reference)
    if _kept(estimate, reference, stamps) is estimate:
        covered = _covered(reference, estimate.time_ns, max_gap)
        pair = estimate.take(covered), interpolate(reference, estimate.time_ns[covered])
    else:
        covered = _covered(estimate, reference.time_ns, max_gap)
        pair = interpolate(estimate, reference.time_ns[covered]), reference.take(covered)
    if not covered.any():
        raise InputError(
            "estimate and reference have no time in common that is sampled closely enough "
            f"(max_gap {max_gap:g} s): {describe_spans(estimate, reference)}"
        )
    return pair


def at_times(
    estimate: Trajectory, reference: Trajectory, time_offset: float = 0.0
) -> tuple[Trajectory, Trajectory]:
    """Both with stamps that can be compared: one that has no times takes those of the other, row by row.

    Raises:
        InputError: If one has no times, and they have not as many rows, or a time offset is given.
    """
    if estimate.timed and reference.timed:
        return estimate, reference
    untimed = "reference" if estimate.timed else "estimate"
    if len(estimate) != len(reference):
        rows = f"the estimate has {len(estimate)}, the reference {len(reference)}"
        raise InputError(
            f"the {untimed} has no times (KITTI files do not), so both must have as many rows: {rows}"
        )
    if time_offset:
        raise InputError(f"time_offset: {time_offset:g} s, but the {untimed} has no times to add it to")
    if estimate.timed:
        return estimate, dataclasses.replace(reference, time_ns=estimate.time_ns, timed=True)
    return dataclasses.replace(estimate, time_ns=reference.time_ns, timed=reference.timed), reference


def interpolate(trajectory: Trajectory, time_ns: npt.ArrayLike) -> Trajectory:
    """The trajectory at other stamps within its own time, without moving one of its samples.

    Between two poses the body holds one twist, an arc (the geodesic of SE(2)), turning the shorter way;
    where a heading is NaN it goes straight, and its heading is NaN. Twists and covariances are
    interpolated linearly.

    Args:
        trajectory: Samples in time order.
        time_ns: Stamps [ns], int64, shape (M,).

    Returns:
        A trajectory of M samples.

    Raises:
        InputError: If the trajectory's stamps go back, or a wanted stamp is outside of them.
    """
    require_type("interpolate", "trajectory", trajectory, Trajectory)
    wanted = column_of_stamps("time_ns", time_ns)
    _require_order("trajectory", trajectory)
    if not wanted.size:
        return trajectory.take(wanted)
    own = trajectory.time_ns
    if not own.size or wanted.min() < own[0] or wanted.max() > own[-1]:
        raise InputError(
            f"stamps from {_seconds(wanted.min())} to {_seconds(wanted.max())} s, must be within the "
            f"trajectory: {span(trajectory)}"
        )
    before, after = _neighbours(own, wanted)
    gap = np.maximum(own[after] - own[before], 1)
    fraction = ((wanted - own[before]) / gap)[:, None]

    def blend(column: npt.NDArray[np.float64], weight: Any) -> npt.NDArray[np.float64]:
        # The first term alone where the weight is zero: 0 * NaN would spread from a neighbour.
        here = column[before]
        return np.where(weight == 0.0, here, here + weight * (column[after] - here))

    first, second = trajectory.poses[before], trajectory.poses[after]
    straight = blend(trajectory.poses, fraction)
    motion = se2.log(se2.compose(se2.inverse(first), second))
    arc = se2.compose(first, se2.exp(fraction * motion))
    poses = np.where((fraction == 0.0) | np.isnan(arc), straight, arc)
    return dataclasses.replace(
        trajectory,
        time_ns=wanted,
        poses=poses,
        twists=None if trajectory.twists is None else blend(trajectory.twists, fraction),
        covariances=(
            None if trajectory.covariances is None else blend(trajectory.covariances, fraction[..., None])
        ),
    )


def shift(trajectory: Trajectory, seconds: float) -> Trajectory:
    """The same trajectory with a time [s] added to its stamps.

    Raises:
        InputError: If the time is not finite.
    """
    require_type("shift", "trajectory", trajectory, Trajectory)
    require_numbers("shift", one={"time_offset": seconds})
    if seconds is None or not abs(seconds) < _LATEST:
        raise InputError(f"time_offset: {seconds} s, must be finite and within 292 years")
    return dataclasses.replace(trajectory, time_ns=trajectory.time_ns + round(seconds * 1e9))


def span(trajectory: Trajectory) -> str:
    """First and last stamp, for people."""
    if not len(trajectory):
        return "empty"
    time_ns = trajectory.time_ns
    samples = "1 sample" if len(time_ns) == 1 else f"{len(time_ns)} samples"
    return f"{samples} from {_seconds(time_ns[0])} to {_seconds(time_ns[-1])} s"


def describe_spans(estimate: Trajectory, reference: Trajectory) -> str:
    """Both time spans, for people, and the offset that starts them together if they never meet."""
    text = f"estimate {span(estimate)}, reference {span(reference)}"
    if not len(estimate) or not len(reference):
        return text
    first, second = estimate.time_ns, reference.time_ns
    if first[-1] < second[0] or second[-1] < first[0]:
        offset = _seconds(second[0] - first[0])
        text += f"; two clocks? time_offset={offset} (--time-offset {offset}) starts them together"
    return text


def _seconds(time_ns: np.int64) -> str:
    return f"{int(time_ns) / 1e9:.3f}"


def _require_order(name: str, trajectory: Trajectory) -> None:
    back = np.flatnonzero(np.diff(trajectory.time_ns) < 0)
    if back.size:
        k = int(back[0]) + 1
        earlier, later = trajectory.time_ns[k - 1 : k + 1]
        raise InputError(
            f"{name}: sample {k} at {_seconds(later)} s comes after one at {_seconds(earlier)} s; "
            "stamps must not go back"
        )


def _measured(name: str, trajectory: Trajectory) -> Trajectory:
    """The samples that have a position, in time order."""
    _require_order(name, trajectory)
    finite: Mask = np.logical_and.reduce(np.isfinite(trajectory.poses[:, :2]), axis=1)
    return trajectory if finite.all() else trajectory.take(finite)


def _kept(estimate: Trajectory, reference: Trajectory, stamps: Stamps) -> Trajectory:
    """The one whose stamps are kept."""
    if stamps is Stamps.SPARSER and len(estimate) and len(reference):
        start = max(estimate.time_ns[0], reference.time_ns[0])
        end = min(estimate.time_ns[-1], reference.time_ns[-1])
        inside = [int(((t.time_ns >= start) & (t.time_ns <= end)).sum()) for t in (estimate, reference)]
        return estimate if inside[0] <= inside[1] else reference
    return reference if stamps is Stamps.REFERENCE else estimate


def _neighbours(own: Stamped, wanted: Stamped) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Indices of the last sample at or before each wanted stamp, and of the one after it."""
    before = np.maximum(np.searchsorted(own, wanted, side="right") - 1, 0)
    return before, np.minimum(before + 1, len(own) - 1)


def _covered(trajectory: Trajectory, wanted: Stamped, max_gap: float) -> Mask:
    """Which stamps the trajectory has, or has two close enough samples around."""
    own = trajectory.time_ns
    if not own.size:
        return np.zeros(wanted.shape, dtype=bool)
    before, after = _neighbours(own, wanted)
    close = (own[before] == wanted) | ((own[after] - own[before]) * 1e-9 <= max_gap)
    covered: Mask = (own[0] <= wanted) & (wanted <= own[-1]) & close
    return covered
