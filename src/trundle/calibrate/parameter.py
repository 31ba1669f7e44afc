"""The numbers of a description that a calibration may change, and robots with other ones in their place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec

from trundle.errors import InputError, did_you_mean
from trundle.robot import Kinematics, Robot
from trundle.robot.log_mapping import ScalarMapping

__all__ = ["DRIVE", "SENSOR", "Candidates", "Parameter", "candidates_of", "drive_with", "robot_with"]

DRIVE = "drive"
SENSOR = "sensor"

# Distances that only count together, by drive: the displacement depends on their sum, or on their scale.
_TOGETHER = {
    "mecanum": ("lx + ly", ("track_width", "wheelbase")),
    "four_wheel_steering": ("wheel_distance", ("track_width", "wheelbase")),
    "swerve": ("wheel_distance", ("modules",)),
    "tracking_wheels": ("wheel_distance", ("wheels",)),
    "custom": ("wheel_distance", ("wheels",)),
}
_LENGTHS = {
    "differential": ("track_width",),
    "skid_steer": ("track_width",),
    "bicycle": ("wheelbase",),
    "ackermann": ("wheelbase",),
    "tricycle": ("wheelbase",),
    "omni": ("robot_radius",),
}
# What else may be found where the logs can tell, beside what must be.
_MORE_LENGTHS = {"ackermann": ("track_width",)}
# Drives whose wheels each have a radius that turns them: without each of them there is no way straight on.
_EACH_RADIUS = ("differential",)


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number that may be found.

    Attributes:
        name: Its place in robot.yaml, or what it is called.
        unit: "m", "rad", "s", "rad/s", or "" for a ratio.
        nominal: As described.
        size: What its errors are measured against, in its unit.
        part: DRIVE, or SENSOR for what belongs to gyro, steering encoders and the reference.
        belief: How far the description may be off, as its noise section says, in the unit; the prior.
    """

    name: str
    unit: str
    nominal: float
    size: float
    part: str = DRIVE
    belief: float = math.inf


@dataclass(frozen=True, slots=True)
class Candidates:
    """What can be asked of a robot.

    Attributes:
        needed: Without these there is no odometry to speak of.
        more: Further groups, each found together or not at all, in the order of their worth.
        others: Found only where they are asked for by name.
    """

    needed: tuple[Parameter, ...]
    more: tuple[tuple[Parameter, ...], ...]
    others: tuple[Parameter, ...] = ()

    @property
    def all(self) -> tuple[Parameter, ...]:
        """All of them."""
        return (*self.needed, *(one for group in self.more for one in group), *self.others)

    def named(self, names: Sequence[str]) -> tuple[Parameter, ...]:
        """Those of some names; the name of several (`wheel_radius` of each wheel) means the whole.

        Raises:
            InputError: If there is none of a name.
        """
        known = {one.name: one for one in self.all}
        for name in names:
            if name not in known:
                raise InputError(f"parameters: {name!r}, {did_you_mean(name, sorted(known))}")
        return tuple(known[name] for name in dict.fromkeys(names))


def candidates_of(
    robot: Robot, steering: Sequence[str], *, mounted: bool, headings: bool, clock: bool
) -> Candidates:
    """What may be found of a robot.

    Args:
        robot: As described.
        steering: Names of the log's steering angles.
        mounted: Whether a sensor of its own, mounted anywhere, is the reference.
        headings: Whether that sensor sees headings.
        clock: Whether its stamps may be off.
    """
    drive, noise = robot.measuring, robot.noise
    kind, values = drive.type_name, drive.parameters
    radii = {name: drive.wheel(name).radius for name in drive.measured_names}
    common = sum(radii.values()) / len(radii)
    one = Parameter("wheel_radius", "m", common, common, belief=noise.wheel_radius * common)
    each = tuple(
        Parameter(f"wheel_radius.{name}", "m", r, r, belief=noise.wheel_radius * r)
        for name, r in radii.items()
    )
    distances = tuple(_distances(drive, noise.track_width))
    angles = tuple(Parameter(f"steering.{name}.offset", "rad", 0.0, 0.1, SENSOR) for name in steering)
    gains = tuple(Parameter(f"steering.{name}.gain", "", 1.0, 1.0, SENSOR) for name in steering)
    carlike = len(angles) == 1
    # Where a gyro says how it turns, distances between wheels hardly matter.
    turning = () if drive.gyro else distances
    apart = kind in _EACH_RADIUS and not drive.gyro
    needed = (*(each if apart else (one,)), *turning, *(angles if carlike else ()))
    more: list[tuple[Parameter, ...]] = []
    if mounted:
        more.append(tuple(Parameter(f"reference.{axis}", "m", 0.0, 0.1, SENSOR) for axis in "xy"))
        if headings:
            more.append((Parameter("reference.theta", "rad", 0.0, 0.1, SENSOR),))
    if clock:
        more.append((Parameter("clock", "s", 0.0, 0.1, SENSOR),))
    if len(each) > 1 and not apart:
        more.append(each)
    if drive.gyro:
        more.append((Parameter("gyro.bias", "rad/s", 0.0, 0.01, SENSOR),))
        more.append((Parameter("gyro.scale", "", 1.0, 1.0, SENSOR),))
        more.append(distances)
    if kind == "skid_steer" and values["icr_left"] is None:
        more.append(tuple(_icr(drive)))
    more += [
        (Parameter(name, "m", values[name], values[name], belief=noise.track_width * values[name]),)
        for name in _MORE_LENGTHS.get(kind, ())
    ]
    if angles and not carlike:
        more.append(angles)
    # A gain of the steering and the wheelbase do nearly the same; few logs tell them apart well.
    return Candidates(needed, tuple(more), (*((one,) if apart else ()), *gains))


def _distances(drive: Kinematics, belief: float) -> Iterator[Parameter]:
    kind, values = drive.type_name, drive.parameters
    if kind == "skid_steer" and values["icr_left"] is not None:
        yield from _icr(drive)
    elif kind in _LENGTHS:
        for name in _LENGTHS[kind]:
            yield Parameter(name, "m", values[name], values[name], belief=belief * values[name])
    else:
        name, fields = _TOGETHER[kind]
        size = _together(drive, fields)
        yield Parameter(name, "m", size, size, belief=belief * size)


def _icr(drive: Kinematics) -> Iterator[Parameter]:
    half = drive.parameters["track_width"] / 2
    for name, nominal in (("icr_left", half), ("icr_right", -half), ("icr_x", 0.0)):
        given = drive.parameters[name]
        yield Parameter(name, "m", nominal if given is None else given, half)


def _together(drive: Kinematics, fields: Sequence[str]) -> float:
    """Half the sum of the lengths; of places, their mean distance from their middle [m]."""
    values = drive.parameters
    if fields == ("track_width", "wheelbase"):
        return float(values["track_width"] + values["wheelbase"]) / 2
    wheels = [drive.wheel(name) for name in drive.measured_names]
    x, y = (sum(getattr(wheel, axis) for wheel in wheels) / len(wheels) for axis in "xy")
    return sum(math.hypot(wheel.x - x, wheel.y - y) for wheel in wheels) / len(wheels)


# --- robots with other numbers -----------------------------------------------------------------


def drive_with(drive: Kinematics, parameters: Sequence[Parameter], values: Sequence[Any]) -> Kinematics:
    """The drive with other numbers; they may carry derivatives."""
    arguments = {
        **drive.parameters,
        "measured": [*drive.measured_names, *(["gyro"] if drive.gyro else [])],
        "reference": drive.reference,
    }
    radii = {wheel.name: wheel.radius for wheel in drive.wheels}
    for one, value in zip(parameters, values, strict=True):
        if one.part != DRIVE:
            continue
        if one.name.startswith("wheel_radius"):
            _change_radius(radii, one, value)
        elif one.name in ("lx + ly", "wheel_distance"):
            _, fields = _TOGETHER[drive.type_name]
            _scale(arguments, fields, value / one.nominal, drive)
        else:
            arguments[one.name] = value
    if "wheel_radius" in arguments:
        same = not any(one.name.startswith("wheel_radius.") for one in parameters) and not isinstance(
            drive.parameters["wheel_radius"], Mapping
        )
        arguments["wheel_radius"] = next(iter(radii.values())) if same else radii
    else:
        arguments["wheels"] = [
            msgspec.structs.replace(wheel, radius=radii[wheel.name]) for wheel in arguments["wheels"]
        ]
    return type(drive)(**arguments)


def _change_radius(radii: dict[str, Any], one: Parameter, value: Any) -> None:
    """One wheel's radius; or all of them, each by the same factor."""
    _, _, name = one.name.partition(".")
    if name:
        radii[name] = value
        return
    for wheel, radius in radii.items():
        radii[wheel] = radius / one.nominal * value


def _scale(arguments: dict[str, Any], fields: Sequence[str], factor: Any, drive: Kinematics) -> None:
    for field in fields:
        arguments[field] = _scaled(arguments[field], factor)
    x, y = drive.reference
    arguments["reference"] = (x, y) if not x and not y else (x * factor, y * factor)


def _scaled(value: Any, factor: Any) -> Any:
    """A length, or places of wheels, further apart by a factor; directions stay."""
    if isinstance(value, Mapping):
        return {name: _place(place, factor) for name, place in value.items()}
    if isinstance(value, Sequence):
        return [_place(place, factor) for place in value]
    return value * factor


def _place(place: Any, factor: Any) -> Any:
    if hasattr(place, "radius"):
        return msgspec.structs.replace(place, x=place.x * factor, y=place.y * factor)
    return (place[0] * factor, place[1] * factor, *place[2:])


def robot_with(robot: Robot, parameters: Sequence[Parameter], values: Sequence[float]) -> Robot:
    """The robot described by other numbers, those of its sensors in its `log:` section."""
    drive = drive_with(robot.measuring, parameters, [float(value) for value in values])
    found = {one.name: float(value) for one, value in zip(parameters, values, strict=True)}
    replaced = {"localizer": drive} if robot.localizer is not None else {"drive": drive}
    return robot.replace(**replaced, log=_log_with(robot.log, found))


def _log_with(log: Any, found: Mapping[str, float]) -> Any:
    replace = msgspec.structs.replace
    if log.reference is not None:
        from trundle.geometry import se2

        moved = [found.get(f"reference.{axis}", 0.0) for axis in ("x", "y", "theta")]
        mounting = tuple(se2.compose(_row(moved), _row(log.reference.mounting)).tolist())
        delay = log.reference.delay + found.get("clock", 0.0)
        log = replace(log, reference=replace(log.reference, mounting=mounting, delay=delay))
    steering = {
        name: _sensor_with(mapping, found.get(f"steering.{name}.gain"), found.get(f"steering.{name}.offset"))
        for name, mapping in log.steering.items()
    }
    gyro = log.gyro and _sensor_with(log.gyro, found.get("gyro.scale"), found.get("gyro.bias"))
    return replace(log, steering=steering, gyro=gyro)


def _sensor_with(mapping: ScalarMapping, gain: float | None, offset: float | None) -> ScalarMapping:
    """What was found applies to readings that the described gain and offset have already corrected."""
    gain, offset = 1.0 if gain is None else gain, 0.0 if offset is None else offset
    return msgspec.structs.replace(mapping, gain=gain * mapping.gain, offset=gain * mapping.offset + offset)


def _row(values: Sequence[float]) -> Any:
    import numpy as np

    return np.asarray(values, dtype=float)
