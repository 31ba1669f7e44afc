"""donkeycar's myconfig.py: read without being run, and written as lines to put into one."""

from __future__ import annotations

import ast
import math
import operator
import statistics
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeAlias

from trundle.errors import ConfigError, InputError, require_path
from trundle.robot import Ackermann, Bicycle, Differential, Encoder, Limits, Robot

__all__ = ["myconfig_text", "read_myconfig", "robot_from_myconfig", "unsaid_in_myconfig"]

Value: TypeAlias = float | bool | str | None
Values: TypeAlias = Mapping[str, Value]

MOST_READ = 1 << 20
NEEDED = (
    *("AXLE_LENGTH", "WHEEL_BASE", "WHEEL_RADIUS", "MIN_SPEED", "MAX_SPEED", "MAX_STEERING_ANGLE"),
    *("ENCODER_PPR", "MM_PER_TICK", "HAVE_ODOM_2", "DRIVE_TRAIN_TYPE"),
)
AGREE = 0.01  # MM_PER_TICK is rounded, or measured

_CONSTANTS = {"math.pi": math.pi, "np.pi": math.pi, "numpy.pi": math.pi, "math.tau": math.tau}
_FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "math.radians": math.radians,
    "np.radians": math.radians,
    "np.deg2rad": math.radians,
    "float": float,
}
_SIGNS: Mapping[type[ast.unaryop], Callable[[float], float]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}
_OPERATORS: Mapping[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}


# --- reading ---------------------------------------------------------------------------------------


def robot_from_myconfig(path: str | Path, *, config: str | Path | None = None) -> Robot:
    """The robot that a donkeycar's configuration describes.

    A car is a bicycle whose front wheel is measured, as in donkeycar; with HAVE_ODOM_2, or a
    DRIVE_TRAIN_TYPE of "DC_TWO_WHEEL...", it is a differential drive. Counts per turn of a wheel are
    ENCODER_PPR, or else what MM_PER_TICK says.

    Args:
        path: A myconfig.py.
        config: The config.py with the values that it leaves as they are.

    Raises:
        ConfigError: If a file cannot be read, or a value that is needed is missing, impossible, or not to be
            known without running the file.
    """
    mine = read_myconfig(path)
    base = read_myconfig(config) if config is not None else {}
    try:
        return _robot({**base, **mine}, mine if {"ENCODER_PPR", "MM_PER_TICK"} & set(mine) else base)
    except ConfigError as error:
        raise error.inside("", source=str(path)) from None


def read_myconfig(path: str | Path) -> dict[str, Value]:
    """What a myconfig.py says about the robot, by donkeycar's names; nothing in it is run.

    Args:
        path: A myconfig.py, or a config.py.

    Returns:
        Those of `AXLE_LENGTH`, `WHEEL_BASE`, `WHEEL_RADIUS`, `MIN_SPEED`, `MAX_SPEED`, `MAX_STEERING_ANGLE`,
        `ENCODER_PPR`, `MM_PER_TICK`, `HAVE_ODOM_2` and `DRIVE_TRAIN_TYPE` that the file assigns: literals,
        and numbers computed from numbers, from earlier names and from math.pi.

    Raises:
        ConfigError: If the file cannot be read, is no Python, or assigns one of them in another way.
    """
    known: dict[str, Value] = {}
    try:
        for statement in _parsed(require_path(path)).body:
            _take(statement, known)
    except ConfigError as error:
        raise error.inside("", source=str(path)) from None
    return {name: known[name] for name in NEEDED if name in known}


class _Unknown(ValueError):
    """What only running the file could tell."""


def _parsed(path: Path) -> ast.Module:
    try:
        with path.open("rb") as file:
            text = file.read(MOST_READ + 1)
    except (OSError, ValueError) as error:
        raise ConfigError("", f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if len(text) > MOST_READ:
        raise ConfigError("", f"is larger than {MOST_READ} bytes: no myconfig.py")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Python's advice on how it is written
            return ast.parse(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise ConfigError("", f"is no Python: {error}") from None


def _take(statement: ast.stmt, known: dict[str, Value]) -> None:
    """Add to what is known what a statement assigns; forget what it makes uncertain."""
    names = _bound(statement, known)
    for name in names:
        known.pop(name, None)
    try:
        value = _assigned_value(statement, known) if names else None
    except _Unknown as unknown:
        for name in sorted(names & set(NEEDED)):
            problem = f"line {statement.lineno}: {unknown}; must be a literal, or computed from numbers"
            raise ConfigError(name, problem) from None
    else:
        known.update(dict.fromkeys(names, value))


def _bound(statement: ast.stmt, known: Values) -> set[str]:
    """The names that a statement may give a value, at whatever depth."""
    names: set[str] = set()
    for node in ast.walk(statement):
        match node:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                names.add(name)
            case ast.alias(name="*"):
                names |= set(known)
            case ast.alias(name=name, asname=other):
                names.add(other or name.split(".")[0])
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
    return names


def _assigned_value(statement: ast.stmt, known: Values) -> Value:
    """What a plain assignment assigns.

    Raises:
        _Unknown: If the statement is no plain assignment, or its value cannot be known.
    """
    match statement:
        case ast.Assign(targets=targets, value=value) if all(isinstance(one, ast.Name) for one in targets):
            pass
        case ast.AnnAssign(target=ast.Name(), value=ast.expr() as value):
            pass
        case _:
            raise _Unknown("is assigned in a way that only running the file could tell")
    try:
        return _value(value, known)
    except (ArithmeticError, ValueError, RecursionError) as error:
        raise error if isinstance(error, _Unknown) else _Unknown(f"{error}") from None


def _value(node: ast.expr, known: Values) -> Value:
    match node:
        case ast.Constant(value=bool() | int() | float() | str() | None as value):
            return value
        case ast.Name(id=name) if name in known:
            return known[name]
        case ast.Attribute() if (name := ast.unparse(node)) in _CONSTANTS:
            return _CONSTANTS[name]
        case ast.UnaryOp(op=sign, operand=operand) if type(sign) in _SIGNS:
            return _SIGNS[type(sign)](_number(operand, known))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
            return _OPERATORS[type(op)](_number(left, known), _number(right, known))
        case ast.Call(func=func, args=[argument], keywords=[]) if (name := ast.unparse(func)) in _FUNCTIONS:
            return _FUNCTIONS[name](_number(argument, known))
    raise _Unknown(f"{ast.unparse(node)[:60]!r} cannot be known without running it")


def _number(node: ast.expr, known: Values) -> float:
    value = _value(node, known)
    if isinstance(value, bool | str) or value is None:
        raise _Unknown(f"{ast.unparse(node)[:60]!r} is no number")
    return float(value)


# --- values to a robot --------------------------------------------------------------------------------


def _robot(values: Values, counted: Values) -> Robot:
    radius = _required(values, "WHEEL_RADIUS")
    steering = None
    drive: Bicycle | Differential
    two_wheels = str(values.get("DRIVE_TRAIN_TYPE")).startswith("DC_TWO_WHEEL")
    if two_wheels or values.get("HAVE_ODOM_2"):
        drive = Differential(track_width=_required(values, "AXLE_LENGTH"), wheel_radius=radius)
    else:
        length, steering = _required(values, "WHEEL_BASE"), _positive(values, "MAX_STEERING_ANGLE")
        drive = Bicycle(wheelbase=length, wheel_radius=radius, measured="front", max_steering=steering)
    limits = Limits(
        min_speed=_positive(values, "MIN_SPEED") if values.get("MIN_SPEED") else None,
        max_speed=_positive(values, "MAX_SPEED"),
        max_steering=steering,
    )
    encoder = _encoder(counted, radius)
    encoders = {} if encoder is None else dict.fromkeys(drive.measured_names, encoder)
    return Robot(drive=drive, name="donkeycar", encoders=encoders, limits=limits)


def _encoder(values: Values, radius: float) -> Encoder | None:
    """Counts per turn of a wheel, from the file that says them."""
    pulses, step = _positive(values, "ENCODER_PPR"), _positive(values, "MM_PER_TICK")
    if step is not None:
        rolled = math.tau * 1000.0 * (_positive(values, "WHEEL_RADIUS") or radius) / step
        if pulses is not None and abs(rolled / pulses - 1.0) > AGREE:
            problem = f"{step:g} means {rolled:.4g} pulses per turn of the wheel, ENCODER_PPR is {pulses:g}"
            raise ConfigError("MM_PER_TICK", f"{problem}; leave one of them out")
        pulses = pulses or math.tau * 1000.0 * radius / step
    return None if pulses is None else Encoder(ticks_per_revolution=pulses)


def _required(values: Values, name: str) -> float:
    value = _positive(values, name)
    if value is None:
        raise ConfigError(name, "missing; take it out of the comments and measure it, or give config=")
    return value


def _positive(values: Values, name: str) -> float | None:
    """The number of that name, above zero; None where there is none."""
    value = values.get(name)
    if value is None:
        return None
    if isinstance(value, bool | str) or not 0.0 < value < math.inf:
        raise ConfigError(name, f"{value!r}, must be a number > 0")
    return float(value)


# --- writing ------------------------------------------------------------------------------------------


def myconfig_text(robot: Robot) -> str:
    """Lines for a donkeycar's myconfig.py that say what a robot's description says.

    donkeycar knows one wheel radius: where the wheels differ, it gets their mean, and a comment says so.

    Args:
        robot: A differential drive, or a car (bicycle, Ackermann).

    Raises:
        InputError: If donkeycar has no words for such a drive, or its encoders differ.
    """
    values = {**_lengths(robot), **_speeds(robot), **_counts(robot)}
    lines = [f"{name} = {value!r}  # {unit}" for name, (value, unit) in values.items()]
    remarks = [f"# {words}" for words in unsaid_in_myconfig(robot)]
    return "\n".join(["# MEASURED ROBOT PROPERTIES, in m, m/s and rad", *remarks, *lines, ""])


def unsaid_in_myconfig(robot: Robot) -> tuple[str, ...]:
    """What `myconfig_text` cannot say of a robot, as sentences; none as a rule."""
    radii = {name: robot.drive.wheel(name).radius for name in robot.drive.measured_names}
    if len(set(radii.values())) < 2:
        return ()
    several = ", ".join(f"{name} {1000.0 * radius:.4g} mm" for name, radius in radii.items())
    return (f"donkeycar knows one wheel radius: the mean of {several}",)


def _lengths(robot: Robot) -> dict[str, tuple[float | bool, str]]:
    drive = robot.drive
    lengths: dict[str, tuple[float | bool, str]] = {}
    if isinstance(drive, Differential):
        lengths["HAVE_ODOM_2"] = (True, "two encoders: a differential drive")
    elif not isinstance(drive, Bicycle | Ackermann):
        problem = "donkeycar knows differential drives and cars (bicycle, ackermann)"
        raise InputError(f"{drive.type_name}: {problem}")
    for name, parameter in (("AXLE_LENGTH", "track_width"), ("WHEEL_BASE", "wheelbase")):
        if parameter in drive.parameters:
            lengths[name] = (float(drive.parameters[parameter]), "m")
    lengths["WHEEL_RADIUS"] = (_radius(robot), "m")
    return lengths


def _radius(robot: Robot) -> float:
    return statistics.fmean(robot.drive.wheel(name).radius for name in robot.drive.measured_names)


def _speeds(robot: Robot) -> dict[str, tuple[float, str]]:
    limits = robot.limits
    steering = limits.max_steering or robot.drive.parameters.get("max_steering")
    speeds = {
        "MIN_SPEED": (limits.min_speed, "m/s, below it the motors stall"),
        "MAX_SPEED": (limits.max_speed, "m/s, at full throttle"),
        "MAX_STEERING_ANGLE": (steering, "rad, at steering -1"),
    }
    return {name: (float(value), unit) for name, (value, unit) in speeds.items() if value is not None}


def _counts(robot: Robot) -> dict[str, tuple[float, str]]:
    counts = {
        robot.encoders[name].ticks_per_revolution
        for name in robot.drive.measured_names
        if name in robot.encoders
    }
    if len(counts) > 1:
        raise InputError(f"encoders: {sorted(counts)} ticks per revolution, must be one: donkeycar has one")
    if not counts:
        return {}
    pulses = counts.pop()
    step = math.tau * 1000.0 * _radius(robot) / pulses
    if pulses.is_integer():
        pulses = int(pulses)
    return {"ENCODER_PPR": (pulses, "per turn of the wheel"), "MM_PER_TICK": (step, "mm")}
