"""A robot description as plain data (what YAML and JSON hold), and back."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from trundle.adapters.quantity import (
    ACCELERATION,
    ANGLE,
    DELAY,
    DURATION,
    JERK,
    LENGTH,
    POSITION,
    RADIUS,
    SPEED,
    SPREAD,
    WHEEL_SPEED,
    YAW_ACCELERATION,
    YAW_RATE,
    YAW_RATE_SPREAD,
    Quantity,
    read_number,
    read_quantity,
    spell_quantity,
)
from trundle.adapters.typed_section import check_keys, read_list, read_mapping, read_struct, shown
from trundle.errors import ConfigError, did_you_mean
from trundle.robot import DRIVES, Custom, Encoder, Kinematics, Limits, LogMapping, Noise, Robot, Wheel
from trundle.robot.description import UNMEASURED, CalibrationRecord
from trundle.robot.log_mapping import ReferenceMapping, ScalarMapping, WheelMapping

__all__ = ["SECTIONS", "robot_from_data", "robot_to_data"]

SECTIONS = ("name", "drive", "localizer", "encoders", "limits", "noise", "log", "calibration")

Data = dict[str, Any]
Leaf = Callable[[str, Any, Quantity], Any]
Walk = Callable[[str, Any, Leaf], Any]  # one for both ways: a leaf reads a quantity, or spells it


def robot_from_data(data: Any) -> Robot:
    """The robot that plain data describe. What is not said has its default.

    Args:
        data: Mappings, lists, texts, numbers, booleans and None, as YAML or JSON give them.

    Raises:
        ConfigError: If it describes no robot; the error's field is the path of the value.
    """
    if data is None:
        raise ConfigError("", "empty; the least is  drive: {type: ..., ...}")
    sections = read_mapping("", data)
    check_keys("", sections, SECTIONS)
    if "drive" not in sections:
        raise ConfigError("drive", "missing; the least is  drive: {type: ..., ...}")
    name = sections.get("name", "robot")
    if not isinstance(name, str) or not name:
        raise ConfigError("name", f"{name!r}, must be text; write it in quotes")
    limits = _read_limits(sections.get("limits", {}))
    drive = _read_drive("drive", sections["drive"], limits)
    localizer = _read_drive("localizer", sections["localizer"], limits) if "localizer" in sections else None
    both = [drive] if localizer is None else [drive, localizer]
    return Robot(
        drive=drive,
        name=name,
        encoders=_read_encoders(sections.get("encoders", {}), both),
        limits=limits,
        noise=read_struct("noise", sections["noise"], Noise, _NOISE) if "noise" in sections else UNMEASURED,
        log=_read_log(sections.get("log", {}), both),
        localizer=localizer,
        calibration=_read_calibration(sections.get("calibration")),
    )


# ------------------------------------------------------------------------------------- drives


# What others call the parameters of drives (docs/conventions.md), and ours: the first that the drive has.
# Some say `wheel_base` of left and right, where a drive has no front and rear.
_ELSEWHERE = {
    name: ours
    for names, ours in (
        ("wheel_separation wheel_track axle_length axle_track track tread", (("track_width", ""),)),
        ("traction_track_width steering_track_width wheel_distance", (("track_width", ""),)),
        ("wheel_base base_length axle_distance", (("wheelbase", ""), ("track_width", ""))),
        ("radius wheels_radius traction_wheels_radius traction_wheel_radius", (("wheel_radius", ""),)),
        ("wheel_diameter diameter", (("wheel_radius", ", half of the diameter"),)),
        ("lx", (("wheelbase", ", twice lx where that is a half length"),)),
        ("ly", (("track_width", ", twice ly where that is a half width"),)),
        ("wheel_offset", (("first_wheel_angle", ""),)),
        ("max_steering_angle", (("max_steering", ""),)),
        ("base_radius", (("robot_radius", ""),)),
    )
    for name in names.split()
}


def _read_drive(path: str, value: Any, limits: Limits) -> Kinematics:
    given = read_mapping(path, value)
    if "type" not in given:
        raise ConfigError(f"{path}.type", f"missing; known: {', '.join(DRIVES)}")
    word = given["type"]
    if word not in DRIVES:
        raise ConfigError(f"{path}.type", f"{word!r}, {did_you_mean(str(word), DRIVES)}")
    drive = DRIVES[word]
    wanted = inspect.signature(drive).parameters
    check_keys(path, given, ("type", *wanted), _ELSEWHERE)
    arguments: dict[str, Any] = {}
    for key, parameter in wanted.items():
        if key in given:
            nothing = given[key] is None and parameter.default is None
            walk = _walk(drive, key)
            arguments[key] = None if nothing else walk(f"{path}.{key}", given[key], read_quantity)
        elif key == "max_steering" and limits.max_steering is not None:
            arguments[key] = limits.max_steering
        elif parameter.default is inspect.Parameter.empty:
            raise ConfigError(f"{path}.{key}", f"missing; type {word} needs it")
    try:
        return drive(**arguments)
    except ConfigError as error:
        raise error.inside(path) from None


# What the values of a drive's parameters look like.


def _quantity(quantity: Quantity) -> Walk:
    return lambda path, value, leaf: leaf(path, value, quantity)


def _radius(path: str, value: Any, leaf: Leaf) -> Any:
    """One radius, or one by wheel name."""
    if isinstance(value, Mapping):
        return {name: leaf(f"{path}.{name}", one, RADIUS) for name, one in value.items()}
    return leaf(path, value, RADIUS)


def _row(*quantities: Quantity) -> Walk:
    """As many numbers as there are quantities."""

    def walk(path: str, value: Any, leaf: Leaf) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or len(value) != len(quantities):
            raise ConfigError(path, f"{shown(value)}, must be a list of {len(quantities)} numbers")
        parts = enumerate(zip(value, quantities, strict=True))
        return tuple(leaf(f"{path}[{k}]", one, quantity) for k, (one, quantity) in parts)

    return walk


def _places(*quantities: Quantity) -> Walk:
    """A list of rows, or rows by name."""
    row = _row(*quantities)

    def walk(path: str, value: Any, leaf: Leaf) -> Any:
        if isinstance(value, Mapping):
            return {name: row(f"{path}.{name}", one, leaf) for name, one in value.items()}
        return tuple(row(f"{path}[{k}]", one, leaf) for k, one in enumerate(read_list(path, value)))

    return walk


def _whole_number(path: str, value: Any, leaf: Leaf) -> int:
    del leaf
    if read_number(path, value) != value or not isinstance(value, int):
        raise ConfigError(path, f"{value}, must be a whole number")
    return value


def _names(path: str, value: Any, leaf: Leaf) -> str | tuple[str, ...]:
    if isinstance(value, str):
        return value
    return tuple(_text(f"{path}[{k}]", name, leaf) for k, name in enumerate(read_list(path, value)))


def _text(path: str, value: Any, leaf: Leaf) -> str:
    del leaf
    if not isinstance(value, str):
        raise ConfigError(path, f"{shown(value)}, must be text")
    return value


def _flag(path: str, value: Any, leaf: Leaf) -> bool:
    del leaf
    if not isinstance(value, bool):
        raise ConfigError(path, f"{shown(value)}, must be true or false")
    return value


_WHEEL: dict[str, Walk] = {
    "name": _text,
    "x": _quantity(POSITION),
    "y": _quantity(POSITION),
    "radius": _quantity(RADIUS),
    "heading": _quantity(ANGLE),
    "kind": _text,
    "free_direction": _quantity(ANGLE),
    "steering_range": _row(ANGLE, ANGLE),
    "driven": _flag,
}


def _wheels(path: str, value: Any, leaf: Leaf) -> tuple[Any, ...]:
    return tuple(_wheel(f"{path}[{k}]", one, leaf) for k, one in enumerate(read_list(path, value)))


def _wheel(path: str, value: Any, leaf: Leaf) -> Any:
    if isinstance(value, Wheel):
        return {key: _WHEEL[key](path, one, leaf) for key, one in _changed(value).items()}
    given = read_mapping(path, value)
    check_keys(path, given, _WHEEL)
    for key in ("name", "x", "y", "radius"):
        if key not in given:
            raise ConfigError(f"{path}.{key}", "missing; every wheel needs it")
    fields = {key: _WHEEL[key](f"{path}.{key}", one, leaf) for key, one in given.items()}
    try:
        return Wheel(**fields)
    except ConfigError as error:
        raise error.inside(path) from None


_PARAMETERS: dict[str, Walk] = {
    "track_width": _quantity(LENGTH),
    "wheelbase": _quantity(LENGTH),
    "robot_radius": _quantity(LENGTH),
    "wheel_radius": _radius,
    "icr_left": _quantity(POSITION),
    "icr_right": _quantity(POSITION),
    "icr_x": _quantity(POSITION),
    "front_y": _quantity(POSITION),
    "max_steering": _quantity(ANGLE),
    "first_wheel_angle": _quantity(ANGLE),
    "wheel_count": _whole_number,
    "modules": _places(POSITION, POSITION),
    "wheels": _places(POSITION, POSITION, ANGLE),
    "measured": _names,
    "reference": _row(POSITION, POSITION),
}


def _walk(drive: type[Kinematics], key: str) -> Walk:
    return _wheels if drive is Custom and key == "wheels" else _PARAMETERS[key]


# ----------------------------------------------------------------------------------- encoders


def _read_encoders(value: Any, drives: Sequence[Kinematics]) -> dict[str, Encoder]:
    """Encoders by wheel, from defaults for all measured wheels and entries by wheel name."""
    given = read_mapping("encoders", value)
    known = Encoder.__struct_fields__
    wheels = [name for drive in drives for name in drive.wheel_names]
    check_keys("encoders", given, (*known, *wheels))
    defaults = {key: one for key, one in given.items() if key in known}
    own = {name: read_mapping(f"encoders.{name}", one) for name, one in given.items() if name not in known}
    inverted = defaults.pop("inverted", False)
    if not isinstance(inverted, bool):
        for k, name in enumerate(read_list("encoders.inverted", inverted, "true, false or a list of wheels")):
            if name not in wheels:
                raise ConfigError(f"encoders.inverted[{k}]", f"{name!r}, {did_you_mean(str(name), wheels)}")
    measured = [name for drive in drives for name in drive.measured_names] if defaults else []
    if defaults:  # said once, so checked where it was said
        read_struct("encoders", {"ticks_per_revolution": 1.0, **defaults}, Encoder)
    encoders = {}
    for name in dict.fromkeys([*measured, *own]):
        counts_down = inverted if isinstance(inverted, bool) else name in inverted
        entry = {"inverted": counts_down, **defaults, **own.get(name, {})}
        if "ticks_per_revolution" not in entry:
            raise _missing_ticks(f"encoders.{name}")
        encoders[name] = read_struct(f"encoders.{name}", entry, Encoder)
    if inverted and not encoders:
        raise _missing_ticks("encoders")
    return encoders


def _missing_ticks(path: str) -> ConfigError:
    return ConfigError(f"{path}.ticks_per_revolution", "missing; counts per turn of the wheel")


# ------------------------------------------------------------------------------ typed sections


_LIMITS = {
    "min_speed": SPEED,
    "max_speed": SPEED,
    "max_lateral_speed": SPEED,
    "max_yaw_rate": YAW_RATE,
    "max_acceleration": ACCELERATION,
    "max_deceleration": ACCELERATION,
    "max_yaw_acceleration": YAW_ACCELERATION,
    "max_jerk": JERK,
    "max_wheel_speed": WHEEL_SPEED,
    "max_steering": ANGLE,
}
_TIMEOUT = {"command_timeout": DURATION}
_NOISE = {"wheel_distance": SPREAD, "lateral_slip": SPREAD, "steering": ANGLE, "gyro": YAW_RATE_SPREAD}


def _read_limits(value: Any) -> Limits:
    given = read_mapping("limits", value)
    timeout = given.get("command_timeout", 0.5)
    if isinstance(timeout, str) and timeout != "never" and timeout[:1] not in "0123456789.":
        raise ConfigError("limits.command_timeout", f"{timeout!r}, must be seconds > 0, or the word never")
    if timeout is None:
        raise ConfigError("limits.command_timeout", "empty, must be seconds > 0, or the word never")
    return read_struct("limits", given, Limits, {**_LIMITS, **({} if timeout == "never" else _TIMEOUT)})


def _read_calibration(value: Any) -> CalibrationRecord | None:
    if value is None:
        return None
    given = read_mapping("calibration", value)
    if "version" not in given:
        raise ConfigError("calibration.version", "missing, must be 1")
    if given["version"] == 1:
        return read_struct("calibration", given, CalibrationRecord)
    # Fields of another version are not judged by this one's.
    return read_struct("calibration", {"robot": "", "version": given["version"]}, CalibrationRecord)


def _read_log(value: Any, drives: Sequence[Kinematics]) -> LogMapping:
    given = dict(read_mapping("log", value))
    wheels = [name for drive in drives for name in drive.wheel_names]
    steered = [name for drive in drives for name in drive.steered_names]
    entries: dict[str, Any] = {}
    shapes: tuple[tuple[str, type[ScalarMapping], list[str], dict[str, Quantity]], ...] = (
        ("wheels", WheelMapping, wheels, {}),
        ("steering", ScalarMapping, steered, {"offset": ANGLE}),
    )
    for key, shape, names, units in shapes:
        columns = read_mapping(f"log.{key}", given.pop(key, {}))
        if key == "wheels" or len(columns) > 1:  # one steering angle may stand for all steered wheels
            check_keys(f"log.{key}", columns, names)
        entries[key] = {
            name: read_struct(f"log.{key}.{name}", one, shape, units) for name, one in columns.items()
        }
    reference = given.pop("reference", None)
    if reference is not None:
        entries["reference"] = _read_reference("log.reference", reference)
    return msgspec.structs.replace(read_struct("log", given, LogMapping), **entries)


_MOUNTING = _row(POSITION, POSITION, ANGLE)


def _read_reference(path: str, value: Any) -> ReferenceMapping:
    given = dict(read_mapping(path, value))
    if "mounting" in given:
        given["mounting"] = _MOUNTING(f"{path}.mounting", given["mounting"], read_quantity)
    return read_struct(path, given, ReferenceMapping, {"delay": DELAY})


# ------------------------------------------------------------------------------------ writing


def robot_to_data(robot: Robot) -> Data:
    """Plain data from which `robot_from_data` makes the same robot; defaults are left out."""
    noise, log = _spelled(robot.noise, _NOISE), _changed(robot.log)
    never = robot.limits.command_timeout == "never"
    if "mounting" in log.get("reference", {}):
        log["reference"]["mounting"] = list(_MOUNTING("", log["reference"]["mounting"], spell_quantity))
    sections = {
        "name": None if robot.name == "robot" else robot.name,
        "drive": _drive_data(robot.drive, robot.limits),
        "localizer": None if robot.localizer is None else _drive_data(robot.localizer, robot.limits),
        "encoders": _encoder_data(robot),
        "limits": _spelled(robot.limits, {**_LIMITS, **({} if never else _TIMEOUT)}),
        "noise": None
        if robot.noise == UNMEASURED
        else noise or {"wheel_distance": robot.noise.wheel_distance},
        "log": log,
        "calibration": None
        if robot.calibration is None
        else {"version": robot.calibration.version, **_changed(robot.calibration)},
    }
    return {key: value for key, value in sections.items() if value not in (None, {})}


def _drive_data(drive: Kinematics, limits: Limits) -> Data:
    if type(drive) is Kinematics:
        raise ConfigError("drive", "has no name; make it Custom(wheels=...) to write it down")
    wanted = inspect.signature(type(drive)).parameters
    measured = _measured(drive, wanted["measured"].default)
    given = {**drive.parameters, "reference": drive.reference, "measured": measured}
    implied = {key: parameter.default for key, parameter in wanted.items()}
    if "max_steering" in wanted:
        implied["max_steering"] = limits.max_steering
    data: Data = {"type": drive.type_name}
    for key in wanted:
        if given[key] != implied[key]:
            walk = _walk(type(drive), key)
            data[key] = None if given[key] is None else _plain(walk(key, given[key], spell_quantity))
    return data


def _measured(drive: Kinematics, default: Any) -> Any:
    """What `measured` must say: the default where that is what is measured."""
    names = (*drive.measured_names, *(("gyro",) if drive.gyro else ()))
    usual = (default,) if isinstance(default, str) else default or drive.wheel_names
    return default if names == usual else names


def _encoder_data(robot: Robot) -> Data:
    """Defaults where all measured wheels agree, and what is left by wheel name."""
    drives = [robot.drive] if robot.localizer is None else [robot.drive, robot.localizer]
    order = dict.fromkeys([*(name for drive in drives for name in drive.wheel_names), *robot.encoders])
    encoders = {name: _changed(robot.encoders[name]) for name in order if name in robot.encoders}
    measured = {name for drive in drives for name in drive.measured_names}
    if not measured or not measured <= set(encoders):
        return encoders
    first = encoders[next(iter(encoders))]
    shared: Data = {
        key: first[key]
        for key in ("ticks_per_revolution", "bits")
        if key in first and all(entry.get(key) == first[key] for entry in encoders.values())
    }
    if "ticks_per_revolution" not in shared:
        return encoders
    inverted = [name for name, entry in encoders.items() if entry.pop("inverted", False)]
    own = {
        name: rest
        for name, entry in encoders.items()
        if (rest := {key: value for key, value in entry.items() if key not in shared}) or name not in measured
    }
    return {**shared, **({"inverted": inverted} if inverted else {}), **own}


def _spelled(struct: Any, quantities: Mapping[str, Quantity]) -> Data:
    """Fields that differ from their defaults, with units where numbers need them."""
    return {
        key: spell_quantity(key, value, quantities[key]) if key in quantities else value
        for key, value in _changed(struct).items()
    }


def _changed(struct: Any) -> Data:
    """Fields that differ from their defaults, as plain data."""
    said = {}
    for field in msgspec.structs.fields(struct):
        made = field.default_factory
        default = field.default if made is msgspec.NODEFAULT else made()
        value = getattr(struct, field.name)
        if default is msgspec.NODEFAULT or value != default:
            said[field.name] = _plain(value)
    return said


def _plain(value: Any) -> Any:
    """Structs, enums, tuples and mappings as mappings, lists and scalars."""
    if isinstance(value, msgspec.Struct):
        return _changed(value)
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(value)  # not NumPy's
    return value
