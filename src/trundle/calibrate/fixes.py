"""References of every kind as one: measured components of the pose, at stamps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.calibrate.run import Closed, Rolled, Run, Spun
from trundle.errors import InputError, TooFewData
from trundle.records import Trajectory, WheelLog
from trundle.robot import Robot

__all__ = ["Fixes", "fixes_of", "offset_of"]

Floats = npt.NDArray[np.float64]

_BASE = "base_link"
FEWEST = 3
"""A trajectory with fewer samples than this beside the log is no reference."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Fixes:
    """Components of the robot's pose in a frame of their own.

    Attributes:
        moments: When, from the log's first row [s], shape (N,), increasing.
        poses: (x, y, theta) [m, m, rad], shape (N, 3); NaN where a component was not measured.
        sigma: Standard deviations of positions and headings [m, rad]; None where the residuals shall tell.
        whole_turns: The headings count turns, and are not only directions.
        mounted: A sensor saw them that may be mounted anywhere; else they are the robot's own.
        offset: Place (x, y) of the tracked point [m], where a reference without headings could not be moved
            to the robot's own.
    """

    moments: Floats
    poses: Floats
    sigma: tuple[float, float] | None = None
    whole_turns: bool = False
    mounted: bool = True
    offset: tuple[float, float] = (0.0, 0.0)

    def __len__(self) -> int:
        return len(self.moments)

    @property
    def positions(self) -> bool:
        """Whether any position was measured."""
        return bool(np.isfinite(self.poses[:, :2]).any())

    @property
    def headings(self) -> bool:
        """Whether any heading was measured."""
        return bool(np.isfinite(self.poses[:, 2]).any())


def fixes_of(robot: Robot, run: Run, most: int) -> Fixes:
    """What is known of where a run went.

    Args:
        robot: Whose run it is.
        run: The run; without a reference of its own that of its log counts, else its gyro.
        most: Of more samples, every second, third, ... is used.

    Raises:
        InputError: If nothing is known.
        TooFewData: If too little of it is beside the log.
    """
    log, reference = run.log, run.reference
    if reference is None:
        reference = log.reference
    match reference:
        case Trajectory():
            return _seen(run, reference, most, offset_of(robot, reference))
        case Rolled(distance=distance, sigma=sigma):
            return _ends(log, (distance, math.nan, math.nan), (sigma, 0.01))
        case Spun(angle=angle, sigma=sigma):
            return _ends(log, (math.nan, math.nan, angle), (0.002, sigma), whole_turns=True)
        case Closed(sigma=sigma, heading_sigma=heading_sigma):
            return _ends(log, (0.0, 0.0, 0.0), (sigma, heading_sigma))
    if log.yaw_rate is None:
        raise InputError(f"{run.name or log.source}: nothing says where it went: no reference, and no gyro")
    return _by_gyro(log, most)


def offset_of(robot: Robot, reference: Trajectory) -> tuple[float, float]:
    """Where on the robot the point is whose path a reference is [m]."""
    if robot.log.reference is None or reference.child_frame == _BASE:
        return 0.0, 0.0
    return robot.log.reference.mounting[:2]


def _seen(run: Run, reference: Trajectory, most: int, offset: tuple[float, float]) -> Fixes:
    """What a sensor saw while the log ran."""
    stamps, poses = reference.time_ns, reference.poses
    inside = (stamps >= run.log.time_ns[0]) & (stamps <= run.log.time_ns[-1])
    measured = np.isfinite(poses[:, :2]).all(axis=1) | (
        np.isnan(poses[:, :2]).all(axis=1) & np.isfinite(poses[:, 2])
    )
    rows = np.flatnonzero(inside & measured)
    rows = rows[np.concatenate([[True], np.diff(stamps[rows]) > 0])] if len(rows) else rows
    rows = rows[:: max(1, -(-len(rows) // most))]
    if len(rows) < FEWEST:
        raise TooFewData(
            f"{run.name or run.log.source}: {len(rows)} samples of the reference lie beside the log, "
            f"must be {FEWEST} or more; do their clocks agree?"
        )
    return Fixes(moments=(stamps[rows] - run.log.time_ns[0]) * 1e-9, poses=poses[rows], offset=offset)


def _ends(
    log: WheelLog, end: tuple[float, float, float], sigma: tuple[float, float], *, whole_turns: bool = False
) -> Fixes:
    """Where a run ended, seen from where it began."""
    moments = np.array([0.0, log.duration])
    poses = np.array([(0.0, 0.0, 0.0), end])
    return Fixes(moments=moments, poses=poses, sigma=sigma, whole_turns=whole_turns, mounted=False)


def _by_gyro(log: WheelLog, most: int) -> Fixes:
    """The headings that the gyro's rates add up to."""
    assert log.yaw_rate is not None
    rows = np.flatnonzero(np.isfinite(log.yaw_rate))
    rates, moments = log.yaw_rate[rows], (log.time_ns[rows] - log.time_ns[0]) * 1e-9
    poses = np.full((len(rows), 3), np.nan)
    turned = 0.5 * (rates[1:] + rates[:-1]) * np.diff(moments)
    poses[:, 2] = np.concatenate([[0.0], np.cumsum(turned)])
    chosen = slice(None, None, max(1, -(-len(rows) // most)))
    return Fixes(moments=moments[chosen], poses=poses[chosen], whole_turns=True, mounted=False)
