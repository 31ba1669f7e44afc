"""What wheels turned between the rows of a log, whatever the log calls it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from array_api_compat import numpy as standard

from trundle.errors import InputError
from trundle.odometry.encoder_counts import count_differences
from trundle.records import Reading, WheelLog
from trundle.robot import Kinematics, Robot

__all__ = ["LIMIT", "WheelSteps", "wheel_steps"]

Floats = npt.NDArray[np.float64]
Counts = npt.NDArray[np.int64]


LIMIT = 1e12
"""No wheel turns so far: numbers beyond it, and those that are not finite, are no readings."""


@dataclass(frozen=True, slots=True, eq=False)
class WheelSteps:
    """The steps from each usable row of a log to the next, in the order of the drive's wheels.

    Attributes:
        rows: The usable rows, shape (steps + 1,).
        moments: When they were taken, from the first of them [s], shape (steps + 1,).
        turned: What each measured wheel turned in a step [rad], shape (steps, measured).
        steering: Angles in the middle of the steps [rad], shape (steps, steered).
    """

    rows: Counts
    moments: Floats
    turned: Floats
    steering: Floats

    def __len__(self) -> int:
        return len(self.turned)


def wheel_steps(robot: Robot, log: WheelLog) -> WheelSteps:
    """The steps of a log. Counters that are not declared to wrap do not.

    Args:
        robot: Whose wheels they are.
        log: Readings of its measured wheels. Rows that are no readings, or not later than the row before,
            are passed over.

    Raises:
        InputError: If the log has no wheels, lacks one of them or a steering angle, or has fewer than two
            usable rows; if ticks come without encoders.
    """
    drive = robot.measuring
    if log.wheels is None:
        raise InputError("the log holds the robot's own twists and no wheels: there is nothing to look into")
    wheels = log.wheels[:, _places("wheel", drive.measured_names, log.wheel_names)]
    steering = _steering(drive, log)
    rows = _usable(log.time_ns, wheels, steering)
    if len(rows) < 2:
        raise InputError(f"the log has {len(rows)} usable rows, must have two or more")
    moments = 1e-9 * (log.time_ns[rows] - log.time_ns[rows[0]]).astype(np.float64)
    turned = _turned(robot, log.reading, wheels[rows], np.diff(moments))
    angles = steering[rows]
    return WheelSteps(rows, moments, turned, 0.5 * (angles[1:] + angles[:-1]))


def _places(what: str, wanted: tuple[str, ...], found: tuple[str, ...]) -> list[int]:
    missing = [name for name in wanted if name not in found]
    if missing:
        there = ", ".join(found) or "none"
        raise InputError(f"the log has no {what} of {', '.join(missing)}; it has {there}")
    return [found.index(name) for name in wanted]


def _steering(drive: Kinematics, log: WheelLog) -> Floats:
    """One angle per steered wheel and row; one angle in the log may stand for all."""
    if not drive.steered_names:
        return np.zeros((len(log), 0))
    if log.steering is not None and log.steering.shape[1] == 1 < len(drive.steered_names):
        return np.stack(drive.expand_steering([log.steering[:, 0]], standard), axis=-1)
    if log.steering is not None and log.steering.shape[1] == len(drive.steered_names) == 1:
        return log.steering
    places = _places("steering angle", drive.steered_names, log.steering_names)
    assert log.steering is not None  # it has names
    return log.steering[:, places]


def _usable(time_ns: Counts, wheels: npt.NDArray[np.generic], steering: Floats) -> Counts:
    sound = (np.abs(wheels.astype(np.float64)) < LIMIT).all(axis=1) & (np.abs(steering) < LIMIT).all(axis=1)
    rows = np.flatnonzero(sound)
    latest = np.maximum.accumulate(time_ns[rows])
    return rows[np.concatenate([[True], time_ns[rows][1:] > latest[:-1]])] if len(rows) else rows


def _turned(robot: Robot, reading: Reading, wheels: npt.NDArray[np.generic], seconds: Floats) -> Floats:
    """What each wheel turned from row to row [rad]."""
    if reading is Reading.TICKS:
        counts = wheels.astype(np.int64)
        encoders = robot.encoders_of(robot.measuring.measured_names)
        columns = [
            count_differences(column[1:], column[:-1], encoder.bits) * encoder.radians_per_tick
            for column, encoder in zip(counts.T, encoders, strict=True)
        ]
        return np.stack(columns, axis=-1)
    values = wheels.astype(np.float64)
    if reading is Reading.INCREMENT:
        return values[1:]
    if reading is Reading.VELOCITY:
        return 0.5 * seconds[:, np.newaxis] * (values[1:] + values[:-1])
    return np.diff(values, axis=0)
