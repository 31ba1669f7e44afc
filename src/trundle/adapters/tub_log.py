"""What donkeycar's channels say, as wheel logs and trajectories, and the same written as a tub.

`enc/distance` [m] and `enc/speed` [m/s] are those of the one wheel that a car measures, or of the middle of
a differential drive, whose wheels are `enc/left/...` and `enc/right/...`. `user/angle` is steering from -1,
full left, to 1, full right. `pos/x`, `pos/y` [m], `pos/angle` [rad] and `vel/x`, `vel/y`, `vel/angle` are
the pose and its rates.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.adapters.numeral import Real, Stamp
from trundle.adapters.table import Wanted
from trundle.adapters.table_log import wheel_log_of
from trundle.adapters.tub import TIME, Tub, write_tub
from trundle.errors import ConfigError, InputError, LogSchema
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Robot
from trundle.robot.log_mapping import Kind, LogMapping, ScalarMapping, TimeMapping, Unit, WheelMapping

__all__ = ["read_tub_log", "read_tub_trajectory", "write_tub_log"]

Floats = npt.NDArray[np.float64]

STEERING = ("steering", "user/angle")  # what the car did, or what its driver asked for
POSE = ("pos/x", "pos/y", "pos/angle")
_WHEEL = {
    "distance": (Unit.M, Kind.POSITION),
    "speed": (Unit.M_S, Kind.VELOCITY),
}


def read_tub_log(path: Path, robot: Robot, mapping: LogMapping) -> WheelLog:
    """A tub as a wheel log.

    Args:
        path: The folder.
        robot: Whose it is. Its greatest steering angle is what full steering means.
        mapping: Channels with other names than donkeycar's; `column` is the name of a channel.

    Raises:
        LogSchema: If the tub holds no encoder channel, or a channel cannot be what it is said to be.
        ConfigError: If the steering means no angle because the robot does not say its greatest.
        LogError: If the tub cannot be read.
    """
    tub = Tub(path)
    said = msgspec.structs.replace(mapping, time=mapping.time or TimeMapping(column=TIME, unit=Unit.MS))
    if not said.wheels and said.twist is None:
        said = msgspec.structs.replace(said, wheels=_wheels(tub, robot))
    shares = bool(said.wheels and robot.measuring.steered_names and not said.steering)
    if shares:
        said = msgspec.structs.replace(said, steering=_steering(tub, robot))
    log = wheel_log_of(tub, robot, said)
    if shares and log.steering is not None:
        most = _greatest_steering(robot)
        log = dataclasses.replace(log, steering=-most * np.clip(log.steering, -1.0, 1.0))
    return log


def _wheels(tub: Tub, robot: Robot) -> dict[str, WheelMapping]:
    """The channel of each measured wheel."""
    measured = robot.measuring.measured_names
    for word, (unit, kind) in _WHEEL.items():
        channels = _wheel_channels(word, measured)
        if set(channels) <= set(tub.channels):
            pairs = zip(measured, channels, strict=True)
            return {name: WheelMapping(column=channel, unit=unit, kind=kind) for name, channel in pairs}
    wanted = " or ".join(", ".join(_wheel_channels(word, measured)) for word in _WHEEL)
    has = ", ".join(tub.channels) or "none"
    problem = f"no channel says what {', '.join(measured)} rolled: must have {wanted}; it has {has}"
    raise LogSchema(tub.path, "column", f"{problem}. donkeycar records odometry with HAVE_ODOM = True")


def _wheel_channels(word: str, measured: tuple[str, ...]) -> list[str]:
    if len(measured) == 1:
        return [f"enc/{word}"]
    return [f"enc/{name.removeprefix('rear_').replace('_', '/')}/{word}" for name in measured]


def _steering(tub: Tub, robot: Robot) -> dict[str, ScalarMapping]:
    for channel in STEERING:
        if channel in tub.channels:
            return {robot.measuring.steered_names[0]: ScalarMapping(column=channel)}
    has = ", ".join(tub.channels) or "none"
    raise LogSchema(tub.path, "column", f"no channel {' or '.join(STEERING)} for the steering; it has {has}")


def _greatest_steering(robot: Robot) -> float:
    bounds = robot.measuring.steering_bounds[0]
    most = robot.limits.max_steering or bounds.greatest
    if not math.isfinite(most):
        problem = "missing; a tub's steering goes from -1 to 1, and this is the angle that 1 means"
        raise ConfigError("limits.max_steering", problem)
    return most


def read_tub_trajectory(path: str | Path) -> Trajectory:
    """The poses that the car itself computed, or got from GPS: `pos/x`, `pos/y` and, if any, `pos/angle`.

    Args:
        path: The folder.

    Raises:
        LogSchema: If the tub holds no poses.
        LogError: If it cannot be read.
    """
    tub = Tub(Path(path))
    names = POSE if POSE[2] in tub.channels else POSE[:2]
    wanted = [Wanted(TIME, Stamp(Unit.MS)), *(Wanted(name, Real()) for name in names)]
    rows = tub.read(wanted)
    time_ns, x, y, *angle = rows.columns
    heading = np.unwrap(angle[0]) if angle else np.full(len(x), np.nan)
    poses = np.stack([x, y, heading], axis=-1)
    return Trajectory(time_ns=time_ns, poses=poses, rejected=rows.rejected)


def write_tub_log(
    log: WheelLog, path: str | Path, robot: Robot, *, trajectory: Trajectory | None = None
) -> None:
    """Write a log as a tub, by donkeycar's names.

    Args:
        log: Positions or velocities of the measured wheels.
        path: The folder to make.
        robot: Says the radii, and the greatest steering angle.
        trajectory: Poses at the stamps of the log, as `pos/...` and, with twists, `vel/...`.

    Raises:
        InputError: If donkeycar has no channels for what the log holds, or the trajectory has other stamps.
        ConfigError: If the steering means no share because the robot does not say its greatest angle.
        OutputError: If the folder exists or cannot be written.
    """
    channels = _wheel_columns(log, robot)
    if log.steering is not None and log.steering.shape[1] == 1:
        channels["user/angle"] = -log.steering[:, 0] / _greatest_steering(robot)
    if trajectory is not None:
        if not np.array_equal(trajectory.time_ns, log.time_ns):
            raise InputError("trajectory: has stamps of its own, must have those of the log")
        channels |= _pose_columns(trajectory)
    write_tub(path, log.time_ns, channels)


def _wheel_columns(log: WheelLog, robot: Robot) -> dict[str, npt.NDArray[Any]]:
    if log.wheels is None or log.reading not in (Reading.POSITION, Reading.VELOCITY):
        what = "twists" if log.wheels is None else log.reading.value
        raise InputError(f"log: holds {what}, must be positions or velocities of wheels")
    word = "distance" if log.reading is Reading.POSITION else "speed"
    names = log.wheel_names
    rolled = [
        column * robot.measuring.wheel(name).radius for name, column in zip(names, log.wheels.T, strict=True)
    ]
    columns = dict(zip(_wheel_channels(word, names), rolled, strict=True))
    columns[f"enc/{word}"] = middle = np.mean(rolled, axis=0)
    if word == "distance":
        seconds = np.diff(log.time_ns) * 1e-9
        columns["enc/speed"] = np.concatenate([[0.0], np.diff(middle) / seconds])
    return columns


def _pose_columns(trajectory: Trajectory) -> dict[str, npt.NDArray[Any]]:
    poses = trajectory.poses.copy()
    columns = dict(zip(POSE, (poses[:, 0], poses[:, 1], _wrapped(poses[:, 2])), strict=True))
    if trajectory.twists is not None:
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        vx, vy, omega = trajectory.twists.T
        columns |= {"vel/x": c * vx - s * vy, "vel/y": s * vx + c * vy, "vel/angle": omega}
    return columns


def _wrapped(angle: Floats) -> Floats:
    return np.arctan2(np.sin(angle), np.cos(angle))
