"""From the units and habits of a log to SI: what each of its numbers has to be multiplied by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.numeral import Count, Numeral, Real
from trundle.errors import ConfigError, LogSchema, did_you_mean
from trundle.records import Reading
from trundle.robot import Encoder, Robot
from trundle.robot.log_mapping import Kind, ScalarMapping, Unit, WheelMapping

__all__ = [
    "Conversion",
    "check_steering",
    "check_time",
    "scalar_conversion",
    "wheel_conversions",
    "wheel_names",
]

# Odometry at a slower pace, or at a faster one, is a time in another unit.
LONGEST_STEP = 5.0
SHORTEST_STEP = 1e-6
LIKELY_STEP = 0.5e-3


@dataclass(frozen=True, slots=True)
class Conversion:
    """How a column of numbers becomes one of a WheelLog.

    Attributes:
        numeral: How its numbers are kept.
        factor: What they are multiplied by; 1 or -1 for raw counts.
    """

    numeral: Numeral
    factor: float | int

    def of(self, numbers: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The column in SI units, or of raw counts with their sign."""
        return numbers if self.factor == 1 else numbers * self.factor


def wheel_names(robot: Robot, mapped: Mapping[str, WheelMapping]) -> tuple[str, ...]:
    """The measured wheels, each of which the mapping must know.

    Raises:
        ConfigError: If it lacks one, or knows one that the robot does not have.
    """
    known = tuple(dict.fromkeys((*robot.measuring.wheel_names, *robot.drive.wheel_names)))
    for name in mapped:
        if name not in known:
            raise ConfigError(f"log.wheels.{name}", f"no such wheel; {did_you_mean(name, known)}")
    names = tuple(name for name in robot.measuring.measured_names if name != "gyro")
    missing = [name for name in names if name not in mapped]
    if missing:
        wanted = f"the log must say where each of {', '.join(names)} is"
        raise ConfigError(f"log.wheels.{missing[0]}", f"missing; {wanted}")
    return names


def wheel_conversions(
    robot: Robot, wheels: Mapping[str, WheelMapping]
) -> tuple[Reading, dict[str, Conversion]]:
    """What the wheels' columns say, and how they become one block of readings.

    Counters of a known width stay raw, since their wraps are for odometry to judge. Everything else
    becomes an angle or a speed.

    Args:
        robot: Says radii and encoders.
        wheels: Mapping of each wheel.

    Raises:
        ConfigError: If a wheel's unit cannot be converted, or the wheels do not all say the same kind
            of thing.
    """
    plans = {name: _Plan.of(robot, name, mapping) for name, mapping in wheels.items()}
    kinds = {plan.kind for plan in plans.values()}
    raw = all(plan.is_counter for plan in plans.values())
    if len(kinds) > 1:
        says = ", ".join(f"{name}: {plan.kind.value}" for name, plan in plans.items())
        raise ConfigError("log.wheels", f"{says}; all must be of one kind")
    if raw and any(plan.bits is not None for plan in plans.values()):
        counters = {n: Conversion(Count(plan.bits), plan.sign) for n, plan in plans.items()}
        return Reading.TICKS, counters
    for name, plan in plans.items():
        if plan.kind is Kind.POSITION and plan.bits is not None:
            raise ConfigError(
                f"encoders.{name}.bits", "this counter wraps, so every wheel must be given in ticks"
            )
    reading = Reading(kinds.pop().value)
    return reading, {name: Conversion(Real(), plan.factor) for name, plan in plans.items()}


@dataclass(frozen=True, slots=True)
class _Plan:
    """What one wheel's column says."""

    kind: Kind
    factor: float
    sign: int
    is_counter: bool
    bits: int | None

    @classmethod
    def of(cls, robot: Robot, name: str, mapping: WheelMapping) -> _Plan:
        unit = mapping.unit or (Unit.RAD_S if mapping.kind is Kind.VELOCITY else Unit.RAD)
        dimension, is_speed = unit.dimension.removesuffix("/s"), unit.dimension.endswith("/s")
        kind = mapping.kind or (Kind.VELOCITY if is_speed else Kind.POSITION)
        counter = dimension == "ticks" and kind is Kind.POSITION
        if dimension == "length":
            factor = unit.factor / _radius(robot, name)
            bits = None
        elif dimension == "ticks":
            encoder = _encoder(robot, name)
            factor = encoder.radians_per_tick
            bits = encoder.bits if counter else None
        else:
            factor, bits = unit.factor, None
        return cls(kind, mapping.sign * factor, mapping.sign, counter, bits)


def _radius(robot: Robot, name: str) -> float:
    return robot.measuring.wheel(name).radius


def _encoder(robot: Robot, name: str) -> Encoder:
    if name not in robot.encoders:
        raise ConfigError(
            f"encoders.{name}", "missing; the log gives this wheel in ticks: say ticks_per_revolution"
        )
    return robot.encoders[name]


def scalar_conversion(field: str, mapping: ScalarMapping, unit: Unit) -> Conversion:
    """How a number of a known quantity becomes SI.

    Args:
        field: Where the mapping stands, for errors.
        mapping: Its unit, if it says one, and its sign.
        unit: SI unit of the quantity.

    Raises:
        ConfigError: If the mapping's unit is of another quantity; an angle may be in ticks that have a gain.
    """
    given = mapping.unit or unit
    if given is Unit.TICKS and unit is Unit.RAD:
        if mapping.gain == 1.0:
            raise ConfigError(f"{field}.gain", "missing; it must say the radians per tick")
        return Conversion(Real(), mapping.sign * mapping.gain)
    if given.dimension != unit.dimension:
        allowed = ", ".join(other.value for other in Unit if other.dimension == unit.dimension)
        angle = given.dimension == "angle" and unit is Unit.RAD_S
        hint = "; a heading is not read, log the rate at which it turns" if angle else ""
        raise ConfigError(f"{field}.unit", f"{given.value!r}, must be one of {allowed}{hint}")
    return Conversion(Real(), mapping.sign * given.factor)


def check_steering(source: object, robot: Robot, name: str, mapping: ScalarMapping, angles: Any) -> None:
    """Refuse steering angles that must be degrees.

    A wheel without limits may turn round more than once, where robot.yaml says what its log is in.

    Raises:
        LogSchema: With reason `unit`.
    """
    wheels = robot.measuring
    free = name in wheels.steered_names and wheels.wheel(name).steering_range is None
    if mapping.wraps or (mapping.unit is not None and free):
        return
    finite = np.abs(angles[np.isfinite(angles)])
    greatest = float(finite.max(initial=0.0))
    if greatest > math.tau:
        raise LogSchema(
            source,
            "unit",
            f"steering {name!r} reaches {greatest:.4g} rad, must be within one turn; "
            "if it is logged in degrees, declare unit: deg",
        )


def check_time(source: object, time_ns: npt.NDArray[np.int64], unit: Unit) -> None:
    """Refuse stamps whose steps cannot be those of a wheel log: a time in another unit.

    Raises:
        LogSchema: With reason `unit`; the message says the unit that would do.
    """
    if len(time_ns) < 3:
        return
    if (steps := np.diff(time_ns)).min() < 0:  # rows out of order say nothing about the unit
        steps = np.diff(np.sort(time_ns))
    step = float(np.median(steps)) * 1e-9
    duration = float(time_ns.max() - time_ns.min()) * 1e-9
    if not (step > LONGEST_STEP or 0.0 < duration < SHORTEST_STEP * (len(time_ns) - 1)):
        return
    step = step or duration / (len(time_ns) - 1)  # most of them were rounded away
    fitting = [
        other.value
        for other in Unit
        if other.dimension == unit.dimension and LIKELY_STEP <= step * other.factor / unit.factor <= 1.0
    ]
    advice = f"declare log.time.unit: {fitting[0]}?" if fitting else "is log.time.column the time?"
    raise LogSchema(
        source,
        "unit",
        f"its rows are {step:.3g} s apart if their time is in {unit.value}, {len(time_ns)} rows in "
        f"{duration:.3g} s; {advice}",
    )
