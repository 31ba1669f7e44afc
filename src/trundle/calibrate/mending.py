"""Descriptions with one thing put right: what a fault's cure looks like in robot.yaml."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from msgspec.structs import replace

from trundle.errors import TrundleError
from trundle.robot import Custom, Kinematics, LogMapping, Robot, Wheel
from trundle.robot.log_mapping import Unit, WheelMapping

__all__ = [
    "LENGTHS",
    "Mending",
    "rebuilt",
    "with_bits",
    "with_exchanged",
    "with_gyro_scaled",
    "with_gyro_turned",
    "with_inverted",
    "with_layout",
    "with_radius_scaled",
    "with_steering_scaled",
    "with_steering_turned",
    "with_ticks_scaled",
    "with_unit",
    "without_wheels",
]

Mending = Callable[[], Robot | None]

LENGTHS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "differential": (("track_width",),),
    "skid_steer": (("track_width",),),
    "bicycle": (("wheelbase",),),
    "ackermann": (("wheelbase",), ("track_width",)),
    "tricycle": (("wheelbase",), ("track_width",)),
    "four_wheel_steering": (("wheelbase",), ("track_width",), ("wheelbase", "track_width")),
    "mecanum": (("track_width", "wheelbase"), ("track_width",), ("wheelbase",)),
    "omni": (("robot_radius",),),
    "swerve": (("modules",),),
    "tracking_wheels": (("wheels",),),
    "custom": (("wheels",),),
}
"""Parameters of each drive that may be written as their half, one by one or together."""


def rebuilt(drive: Kinematics, **changes: Any) -> Kinematics:
    """The same drive with other parameters.

    Raises:
        ConfigError: If there is no such drive.
    """
    measured = (*drive.measured_names, *(("gyro",) if drive.gyro else ()))
    arguments = {"measured": measured, **drive.parameters, "reference": drive.reference, **changes}
    return type(drive)(**arguments)


def with_layout(robot: Robot, names: Sequence[str], factor: float) -> Robot:
    """The robot whose lengths of these names are so many times what they are."""
    drive = robot.measuring
    changes = {name: _scaled(drive.parameters[name], factor) for name in names}
    return _measured_by(robot, rebuilt(drive, **changes))


def with_radius_scaled(robot: Robot, names: Sequence[str], factor: float) -> Robot:
    """The robot of whose wheels these are so many times as large."""
    drive = robot.measuring
    if isinstance(drive, Custom):
        wheels = [
            replace(wheel, radius=factor * wheel.radius) if wheel.name in names else wheel
            for wheel in drive.parameters["wheels"]
        ]
        return _measured_by(robot, rebuilt(drive, wheels=wheels))
    given = drive.parameters["wheel_radius"]
    if not isinstance(given, Mapping) and set(names) >= set(drive.measured_names):
        return _measured_by(robot, rebuilt(drive, wheel_radius=factor * given))
    radii = {name: drive.wheel(name).radius for name in drive.wheel_names}
    radii |= {name: factor * radii[name] for name in names}
    return _measured_by(robot, rebuilt(drive, wheel_radius=radii))


def with_ticks_scaled(robot: Robot, names: Sequence[str], factor: float) -> Robot:
    """The robot of whose encoders these count so many times as much per turn."""
    return _encoders(
        robot, names, lambda one: replace(one, ticks_per_revolution=factor * one.ticks_per_revolution)
    )


def with_bits(robot: Robot, names: Sequence[str], bits: int) -> Robot:
    """The robot of whose counters these wrap."""
    return _encoders(robot, names, lambda one: replace(one, bits=bits))


def with_inverted(robot: Robot, spoken: LogMapping, names: Sequence[str], *, counted: bool) -> Robot | None:
    """The robot whose wheels of these names count the other way; None where nothing says how they count."""
    if counted:
        return _encoders(robot, names, lambda one: replace(one, inverted=not one.inverted))
    return _wheels(robot, spoken, names, lambda one: replace(one, sign=-one.sign))


def with_unit(robot: Robot, spoken: LogMapping, names: Sequence[str], unit: Unit) -> Robot | None:
    """The robot in whose logs these wheels are written in another unit."""
    return _wheels(robot, spoken, names, lambda one: replace(one, unit=unit))


def with_exchanged(
    robot: Robot, spoken: LogMapping, pairs: Sequence[tuple[str, str]], *, turned: bool, steering: bool
) -> Robot | None:
    """The robot in whose logs each of a pair stands where the other did."""
    other = {**dict(pairs), **{b: a for a, b in pairs}}
    log = robot.log
    if turned:
        if not set(other) <= set(spoken.wheels):
            return None
        log = replace(log, wheels={name: spoken.wheels[other.get(name, name)] for name in spoken.wheels})
    if steering:
        if not set(other) <= set(spoken.steering):
            return None
        columns = {name: spoken.steering[other.get(name, name)] for name in spoken.steering}
        log = replace(log, steering=columns)
    return robot.replace(log=log)


def with_steering_turned(robot: Robot, spoken: LogMapping, names: Iterable[str]) -> Robot | None:
    """The robot whose logged steering angles of these names are positive to the other side."""
    if not spoken.steering:
        return None
    chosen = set(names) if len(spoken.steering) > 1 else set(spoken.steering)
    columns = {
        name: replace(one, sign=-one.sign) if name in chosen else one for name, one in spoken.steering.items()
    }
    return robot.replace(log=replace(robot.log, steering=columns))


def with_steering_scaled(robot: Robot, spoken: LogMapping, unit: Unit) -> Robot | None:
    """The robot whose logged steering angles are written in another unit."""
    if not spoken.steering:
        return None
    columns = {name: replace(one, unit=unit) for name, one in spoken.steering.items()}
    return robot.replace(log=replace(robot.log, steering=columns))


def with_gyro_turned(robot: Robot, spoken: LogMapping) -> Robot | None:
    """The robot whose gyro is positive the other way."""
    if spoken.gyro is None:
        return None
    return robot.replace(log=replace(robot.log, gyro=replace(spoken.gyro, sign=-spoken.gyro.sign)))


def with_gyro_scaled(robot: Robot, spoken: LogMapping, unit: Unit) -> Robot | None:
    """The robot whose gyro is written in another unit."""
    if spoken.gyro is None:
        return None
    return robot.replace(log=replace(robot.log, gyro=replace(spoken.gyro, unit=unit)))


def without_wheels(robot: Robot, names: Sequence[str]) -> Robot | None:
    """The robot that does not listen to these wheels; None where it cannot do without."""
    drive = robot.measuring
    left = [name for name in drive.measured_names if name not in names]
    try:
        return _measured_by(robot, rebuilt(drive, measured=[*left, *(("gyro",) if drive.gyro else ())]))
    except TrundleError:
        return None


def _measured_by(robot: Robot, drive: Kinematics) -> Robot:
    return robot.replace(drive=drive) if robot.localizer is None else robot.replace(localizer=drive)


def _encoders(robot: Robot, names: Sequence[str], change: Callable[[Any], Any]) -> Robot:
    changed = {name: change(one) if name in names else one for name, one in robot.encoders.items()}
    return robot.replace(encoders=changed)


def _wheels(
    robot: Robot, spoken: LogMapping, names: Sequence[str], change: Callable[[WheelMapping], WheelMapping]
) -> Robot | None:
    if not set(names) <= set(spoken.wheels):
        return None
    columns = {name: change(one) if name in names else one for name, one in spoken.wheels.items()}
    return robot.replace(log=replace(robot.log, wheels=columns))


def _scaled(value: Any, factor: float) -> Any:
    """A length, or places whose coordinates are lengths, times a factor."""
    if isinstance(value, Wheel):
        return replace(value, x=factor * value.x, y=factor * value.y)
    if isinstance(value, Mapping):
        return {name: _place(one, factor) for name, one in value.items()}
    if isinstance(value, Sequence):
        return [_place(one, factor) for one in value]
    return factor * value


def _place(value: Any, factor: float) -> Any:
    if isinstance(value, Wheel):
        return _scaled(value, factor)
    x, y, *heading = value
    return (factor * x, factor * y, *heading)
