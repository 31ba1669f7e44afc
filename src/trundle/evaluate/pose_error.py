"""Absolute and relative pose error."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, shown
from trundle.evaluate.alignment import require_matched
from trundle.geometry import se2
from trundle.records import Trajectory

__all__ = ["PoseErrors", "RelativeErrors", "ape", "rpe", "travelled"]

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseErrors:
    """How far poses are from where they should be.

    Attributes:
        position: Distances [m], shape (N,); NaN where they cannot be told.
        heading: Angles without sign [rad], in [0, pi], shape (N,); NaN where not measured.
    """

    position: Floats
    heading: Floats


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RelativeErrors(PoseErrors):
    """How far motions are from what they should be.

    Attributes:
        first: Indices at which the motions begin, shape (N,).
        last: Indices at which they end.
        distance: Length of the reference's path between the two [m].
    """

    first: Indices
    last: Indices
    distance: Floats


def ape(estimate: Trajectory, reference: Trajectory) -> PoseErrors:
    """Absolute pose error, sample by sample: `associate` and `align` first.

    Args:
        estimate: N poses, in the frame of the reference.
        reference: N poses.

    Raises:
        ShapeError: If the two differ in length.
    """
    require_matched(estimate, reference, at_least=0)
    offset = estimate.poses - reference.poses
    return PoseErrors(
        position=np.hypot(offset[:, 0], offset[:, 1]),
        heading=np.abs(se2.wrap(offset[:, 2])),
    )


def rpe(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    distance: float | None = None,
    time: float | None = None,
    all_pairs: bool = True,
) -> RelativeErrors:
    """Relative pose error: the motions over a distance or a time, compared.

    It needs no alignment. The motion from sample i ends at the first sample that is at least so far
    along the reference's path (or so much later).

    Args:
        estimate: N poses.
        reference: N poses at the same stamps. The errors of motions that begin without a heading are
            NaN; so are heading errors of motions that end without one.
        distance: Along the path of the reference [m]. Noise of the reference makes its path longer.
        time: [s]. Exactly one of distance and time is given.
        all_pairs: A motion begins at every sample; else where the one before it ended.

    Raises:
        ShapeError: If the two differ in length.
        InputError: Unless exactly one positive step is given, or if the reference is shorter than it, or it
            has no times and the step is one.

    Source:
        Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems": the error of a
        motion is Q^-1 P, with Q and P the motions of reference and estimate.
    """
    require_matched(estimate, reference, at_least=2)
    path = travelled(reference)
    if (distance is None) == (time is None):
        raise InputError("rpe needs either distance [m] or time [s]")
    if distance is not None:
        first, last = _pairs(path, _positive("distance", distance, "m"), all_pairs)
        whole = f"{path[-1]:.6g} m long, distance is {distance:g} m"
    else:
        assert time is not None
        if not reference.timed:
            raise InputError("the reference has no times: rpe needs distance [m]")
        elapsed = (reference.time_ns - reference.time_ns[0]).astype(np.float64)
        first, last = _pairs(elapsed, round(_positive("time", time, "s") * 1e9), all_pairs)
        whole = f"{elapsed[-1] * 1e-9:.6g} s long, time is {time:g} s"
    if not first.size:
        raise InputError(f"the reference is {whole}: it holds no such motion")
    error = se2.compose(se2.inverse(_motion(reference, first, last)), _motion(estimate, first, last))
    return RelativeErrors(
        position=np.hypot(error[:, 0], error[:, 1]),
        heading=np.abs(se2.wrap(error[:, 2])),
        first=first,
        last=last,
        distance=path[last] - path[first],
    )


def _positive(name: str, value: float, unit: str) -> float:
    if not isinstance(value, Real) or not 0.0 < value < np.inf:
        raise InputError(f"{name}: {shown(value)} {unit}, must be > 0 and finite")
    return value


def travelled(trajectory: Trajectory) -> Floats:
    """Path length up to each sample [m], shape (N,).

    Raises:
        InputError: If a position is not finite.
    """
    if not np.isfinite(trajectory.poses[:, :2]).all():
        raise InputError(
            "a position is not finite, so the path has no length: associate() leaves such samples out"
        )
    step = np.diff(trajectory.poses[:, :2], axis=0)
    return np.concatenate(([0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))))


def _motion(trajectory: Trajectory, first: Indices, last: Indices) -> Floats:
    return np.asarray(se2.compose(se2.inverse(trajectory.poses[first]), trajectory.poses[last]))


def _pairs(along: Floats, step: float, all_pairs: bool) -> tuple[Indices, Indices]:
    """From which sample to which a motion of one step goes; `along` never falls."""
    samples = np.arange(len(along))
    # A path of ten steps of 0.1 m is one metre long, whatever rounding makes of the sum; and a motion
    # takes at least one sample, even where its step is lost in rounding.
    ends = np.searchsorted(along, along + step * (1.0 - 1e-9), side="left")
    ends = np.maximum(ends, samples + 1)
    firsts = samples if all_pairs else _chain(ends)
    firsts = firsts[ends[firsts] < len(along)]
    return firsts, ends[firsts]


def _chain(ends: Indices) -> Indices:
    """Samples that are reached from the first by going to the end of one motion after another."""
    chain = [0]
    while (end := int(ends[chain[-1]])) < len(ends):
        chain.append(end)
    return np.asarray(chain, dtype=np.intp)
