"""Trundle's own names for the columns of a table (DESIGN.md section 5), for what a mapping leaves unsaid."""

from __future__ import annotations

from pathlib import Path

import msgspec

from trundle.adapters.table import ColumnName, column_index
from trundle.errors import LogSchema
from trundle.robot import Robot
from trundle.robot.log_mapping import (
    Kind,
    LogMapping,
    ReferenceMapping,
    ScalarMapping,
    TimeMapping,
    TwistMapping,
    Unit,
    WheelMapping,
)

__all__ = ["REFERENCE", "TWIST", "default_time", "with_default_columns"]

Names = tuple[ColumnName, ...]

_WHEEL = {
    "position": (Unit.RAD, Kind.POSITION),
    "position_delta": (Unit.RAD, Kind.INCREMENT),
    "ticks": (Unit.TICKS, Kind.POSITION),
    "ticks_delta": (Unit.TICKS, Kind.INCREMENT),
    "revolutions": (Unit.REV, Kind.POSITION),
    "distance": (Unit.M, Kind.POSITION),
    "velocity": (Unit.RAD_S, Kind.VELOCITY),
}
_PROPOSAL = "trundle info proposes a log: section"
_GYRO = "gyro.yaw_rate"
TWIST = ("twist.vx", "twist.vy", "twist.omega")
REFERENCE = ("reference.x", "reference.y", "reference.theta")


def with_default_columns(
    mapping: LogMapping, robot: Robot, path: Path, names: Names, hint: str = ""
) -> LogMapping:
    """The mapping, with Trundle's own columns for everything that it does not say.

    Args:
        mapping: What is said.
        robot: Whose wheels are looked for.
        path: The table, for errors.
        names: Its columns.
        hint: What else may be the matter with the table, for errors.

    Raises:
        LogSchema: If a wheel or steering angle that the robot measures is nowhere, or a wheel is there in
            several ways.
    """
    drive = robot.measuring
    twist = mapping.twist or (TwistMapping(columns=TWIST) if set(TWIST) <= set(names) else None)
    wheels = mapping.wheels or _wheels(drive.measured_names, path, names, hint, optional=twist is not None)
    steering = mapping.steering or (_steering(drive.steered_names, path, names, hint) if wheels else {})
    gyro = mapping.gyro or (ScalarMapping(column=_GYRO) if _GYRO in names else None)
    return msgspec.structs.replace(
        mapping,
        time=mapping.time or default_time(names),
        wheels=wheels,
        steering=steering,
        gyro=gyro,
        twist=twist,
        reference=mapping.reference or _reference(names),
    )


def default_time(names: Names) -> TimeMapping:
    """`time_ns` where there is such a column, else `time` in seconds."""
    return TimeMapping(column="time_ns", unit=Unit.NS) if "time_ns" in names else TimeMapping()


def _wheels(
    wheels: tuple[str, ...], path: Path, names: Names, hint: str, *, optional: bool
) -> dict[str, WheelMapping]:
    begun = [word for word in _WHEEL if any(f"{wheel}.{word}" in names for wheel in wheels)]
    if not begun and optional:
        return {}
    if len(begun) > 1:
        columns = " and ".join(f"<wheel>.{word}" for word in begun)
        raise LogSchema(path, "ambiguous", f"there are {columns} columns; choose one kind in log.wheels")
    word = begun[0] if begun else "position"
    unit, kind = _WHEEL[word]
    for wheel in wheels:
        column_index(path, names, f"{wheel}.{word}", hint or f"log.wheels can say which it is; {_PROPOSAL}")
    return {wheel: WheelMapping(column=f"{wheel}.{word}", unit=unit, kind=kind) for wheel in wheels}


def _steering(wheels: tuple[str, ...], path: Path, names: Names, hint: str) -> dict[str, ScalarMapping]:
    for wheel in wheels:
        column_index(
            path, names, f"{wheel}.steering", hint or f"log.steering can say which it is; {_PROPOSAL}"
        )
    return {wheel: ScalarMapping(column=f"{wheel}.steering") for wheel in wheels}


def _reference(names: Names) -> ReferenceMapping | None:
    there = tuple(column for column in REFERENCE if column in names)
    return ReferenceMapping(columns=there) if there[:2] == REFERENCE[:2] else None
