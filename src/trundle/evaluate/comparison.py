"""An estimate judged by a reference."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, require_choice, require_positive, require_type
from trundle.evaluate.alignment import align, align_origin, since_start, transform
from trundle.evaluate.association import Stamps, associate, at_times, describe_spans, shift
from trundle.evaluate.consistency import nees
from trundle.evaluate.pose_error import RelativeErrors, ape, rpe, travelled
from trundle.evaluate.statistics import Statistics
from trundle.geometry import Pose2D
from trundle.records import Trajectory

__all__ = ["Alignment", "Comparison", "compare"]


class Alignment(enum.Enum):
    """How the estimate is brought into the frame of the reference before absolute errors are taken."""

    BEST = "best"
    """Best rotation and translation over all positions."""
    ORIGIN = "origin"
    """First pose upon first pose."""
    NONE = "none"
    """Both are in one frame already."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Comparison:
    """How far an estimate is from a reference. None: the reference does not tell.

    Attributes:
        estimate: The matched estimate, aligned, in the frame of the reference.
        reference: The reference at the same stamps.
        alignment: Pose of the estimate's frame in the reference's.
        position: Absolute position error after the alignment [m]; its rmse is the ATE.
        heading: Absolute heading error after the alignment [rad].
        rpe_distance: Path length of the motions below [m].
        rpe_position: Relative position error over that distance [m].
        rpe_heading: Relative heading error over that distance [rad].
        drift: Mean of the relative position error per metre of path [m/m]; times 100, percent.
        heading_drift: Mean of the relative heading error per metre of path [rad/m].
        anees: Mean normalised error squared since the start, over its 3 degrees of freedom: 1 is
            honest, more is overconfident.
        overlap: Time that both trajectories cover [s]; None where neither has times.
    """

    estimate: Trajectory
    reference: Trajectory
    alignment: Pose2D
    position: Statistics
    heading: Statistics | None
    rpe_distance: float
    rpe_position: Statistics | None
    rpe_heading: Statistics | None
    drift: float | None
    heading_drift: float | None
    anees: float | None
    overlap: float | None

    @property
    def ate(self) -> float:
        """Absolute trajectory error: RMSE of position after the alignment [m]."""
        return self.position.rmse

    @property
    def matched(self) -> int:
        """How many samples were compared."""
        return len(self.reference)

    @property
    def reference_length(self) -> float:
        """Length of the matched reference's path [m]; noise makes it longer."""
        return self.reference.distance


def compare(
    estimate: Trajectory,
    reference: Trajectory,
    *,
    max_gap: float = 1.0,
    time_offset: float = 0.0,
    stamps: Stamps | str = Stamps.SPARSER,
    alignment: Alignment | str = Alignment.BEST,
    rpe_distance: float = 1.0,
) -> Comparison:
    """Associate, align, and take every error that the two trajectories allow.

    Args:
        estimate: What is judged, e.g. odometry.
        reference: What it is judged by. Headings may be NaN: errors that need them are None then.
        max_gap: Longest time between two samples that is interpolated over [s].
        time_offset: Added to the stamps of the estimate [s].
        stamps: Whose stamps the two are compared at: "sparser", "estimate", "reference".
        alignment: How the estimate is brought into the reference's frame: "best", "origin", "none".
        rpe_distance: Path length over which relative errors are taken [m]; they are None where the
            reference's path is shorter.

    Raises:
        InputError: If fewer than three samples match; the message says both time spans. If one has no times
            (`Trajectory.timed`) and they have not as many rows.
        ConfigError: If there is no such alignment, or a number is impossible.
        Unobservable: If the best alignment is wanted of something that stays at one point.
    """
    alignment = require_choice("alignment", alignment, Alignment)
    rpe_distance = require_positive("rpe_distance", rpe_distance)
    for name, trajectory in (("estimate", estimate), ("reference", reference)):
        require_type("compare", name, trajectory, Trajectory)
    estimate, reference = at_times(estimate, reference, time_offset)
    pair = associate(estimate, reference, max_gap=max_gap, time_offset=time_offset, stamps=stamps)
    shifted = shift(estimate, time_offset)
    matched, truth = pair
    if len(truth) < 3:
        raise InputError(
            f"{len(truth)} samples of estimate and reference match, must be at least 3: "
            f"{describe_spans(shifted, reference)}"
        )
    placement = _place(matched, truth, alignment)
    aligned = transform(matched, placement, frame=reference.frame)
    absolute = ape(aligned, truth)
    position = Statistics.of(absolute.position)
    assert position is not None  # associate leaves no sample without a position
    relative = _relative(matched, truth, rpe_distance)
    return Comparison(
        estimate=aligned,
        reference=truth,
        alignment=placement,
        position=position,
        heading=Statistics.of(absolute.heading),
        rpe_distance=rpe_distance,
        rpe_position=Statistics.of(relative.position),
        rpe_heading=Statistics.of(relative.heading),
        drift=_mean(relative.position / relative.distance),
        heading_drift=_mean(relative.heading / relative.distance),
        anees=_anees(matched, truth),
        overlap=_overlap(shifted, reference),
    )


def _place(estimate: Trajectory, reference: Trajectory, alignment: Alignment) -> Pose2D:
    if alignment is Alignment.BEST:
        return align(estimate, reference)
    return align_origin(estimate, reference) if alignment is Alignment.ORIGIN else Pose2D()


def _relative(estimate: Trajectory, reference: Trajectory, distance: float) -> RelativeErrors:
    """Relative errors; none where the reference's path is shorter than the distance."""
    if travelled(reference)[-1] < distance:
        nothing, nowhere = np.empty(0), np.empty(0, dtype=np.intp)
        return RelativeErrors(
            position=nothing, heading=nothing, distance=nothing, first=nowhere, last=nowhere
        )
    return rpe(estimate, reference, distance=distance)


def _mean(errors: npt.NDArray[np.float64]) -> float | None:
    statistics = Statistics.of(errors)
    return None if statistics is None else statistics.mean


def _anees(estimate: Trajectory, reference: Trajectory) -> float | None:
    if estimate.covariances is None or np.isnan(reference.poses[0, 2]):
        return None
    mean = _mean(nees(since_start(estimate), since_start(reference)))
    return None if mean is None else mean / 3.0


def _overlap(estimate: Trajectory, reference: Trajectory) -> float | None:
    if not estimate.timed:
        return None
    start = max(estimate.time_ns[0], reference.time_ns[0])
    end = min(estimate.time_ns[-1], reference.time_ns[-1])
    return float(end - start) * 1e-9
