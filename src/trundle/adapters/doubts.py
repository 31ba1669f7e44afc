"""What is doubtful about wheel readings: units, kinds and widths that the numbers contradict."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.conversion import Conversion
from trundle.records import Reading
from trundle.robot import Robot
from trundle.robot.log_mapping import Unit, WheelMapping

__all__ = ["WheelColumn", "doubts"]

Floats = npt.NDArray[np.float64]
Stamps = npt.NDArray[np.int64]

ROWS = 1 << 17  # as many as it takes to tell
FASTEST = 15.0  # m/s: no wheel of a robot rolls faster for long
USUAL = 0.5  # m/s: of several units the likeliest makes it this
SLOWEST = 0.02  # m/s
COUNTED = (Unit.TICKS, Unit.TICKS_S)
FAST_ROWS = 1e-4  # s: rows so near to each other are rare
NEVER_SLOWER = 5.0  # s: no robot speeds up for longer
WIDTHS = (8, 10, 12, 14, 16, 24, 32)


@dataclass(frozen=True, slots=True)
class WheelColumn:
    """One wheel's column.

    Attributes:
        name: Of the wheel.
        mapping: How robot.yaml says it.
        reading: What it says.
        conversion: What its numbers were multiplied by.
        time_ns: Its stamps [ns].
        values: Readings in rad, rad/s, or raw counts.
    """

    name: str
    mapping: WheelMapping
    reading: Reading
    conversion: Conversion
    time_ns: Stamps
    values: npt.NDArray[Any]

    @property
    def unit(self) -> Unit:
        """The unit that is written, else the one that is assumed."""
        return self.mapping.unit or (Unit.RAD_S if self.reading is Reading.VELOCITY else Unit.RAD)

    @property
    def seconds(self) -> Floats:
        """How long each step took."""
        return np.diff(self.time_ns[:ROWS]) * 1e-9


def doubts(robot: Robot, columns: Sequence[WheelColumn]) -> tuple[str, ...]:
    """Sentences for people, each with the line of robot.yaml that would settle it; none as a rule.

    Args:
        robot: Whose wheels they are.
        columns: Of all wheels, of one kind of reading.
    """
    said = list(_assumed(columns))
    if columns and all(map(_only_speeds_up, columns)):
        first = columns[0]
        said.append(
            f"log.wheels.{first.name}.unit: {first.unit.value} is a speed, and this one only grows, from"
            " first row to last; a running total has the unit of an angle or a length (ticks, rev, rad, m)"
        )
        return tuple(said)
    for column in columns:
        if found := _wrap(robot, column) or _pace(robot, column):
            return (*said, found)  # what is wrong with one is wrong with all
    return tuple(said)


def _assumed(columns: Sequence[WheelColumn]) -> Iterator[str]:
    silent = [one for one in columns if one.mapping.unit is None and one.mapping.column is not None]
    if silent:
        names, unit, kind = ", ".join(one.name for one in silent), silent[0].unit.value, silent[0].reading
        guess = _named_unit(str(silent[0].mapping.column))
        other = (
            f"or unit: {guess}, as its name says" if guess else "or what it is: ticks, rev, deg, m, rpm, ..."
        )
        yield f"log.wheels: no unit for {names}, taken as {unit} ({kind.value}); write unit: {unit}, {other}"


def _named_unit(column: str) -> str:
    """The unit that a column's name ends in: `left_rpm`, `left.deg`; empty where it says none."""
    word = re.split(r"[^a-z]+", column.lower())[-1]
    return word if len(word) > 1 and word in {unit.value for unit in Unit} - {"in"} else ""


# --- wheels that are too fast -----------------------------------------------------------------------------


def _pace(robot: Robot, column: WheelColumn) -> str:
    """A wheel that is too fast in most of its steps."""
    radius = robot.measuring.wheel(column.name).radius
    typical = radius * _typical(robot, column)
    own = None if robot.localizer is not None else robot.limits.max_wheel_speed
    limit = FASTEST if own is None else min(FASTEST, own * radius)
    if not typical > 1.5 * limit:
        return ""
    bound = "limits.max_wheel_speed," if limit < FASTEST else "any robot,"
    words = f"log.wheels.{column.name}: as {column.unit.value} this wheel rolls at {typical:.3g} m/s"
    words = f"{words}, faster than {bound} {limit:.3g} m/s"
    advice = _other_units(robot, column, typical, limit)
    step = float(np.median(np.abs(column.seconds)))
    if step < FAST_ROWS:
        advice = [f"is log.time.unit right? Its rows are {step:.2g} s apart", *advice]
    return "; ".join((words, *advice))


def _typical(robot: Robot, column: WheelColumn) -> float:
    """Median speed [rad/s] of the steps in which the wheel turned."""
    seconds, turned = column.seconds, _turned(robot, column)
    moving = np.isfinite(turned) & (turned > 0.0) & (seconds > 0.0)
    if np.count_nonzero(moving) < 3:
        return 0.0
    speeds = turned[moving] if column.reading is Reading.VELOCITY else turned[moving] / seconds[moving]
    return float(np.median(speeds))


def _turned(robot: Robot, column: WheelColumn) -> Floats:
    """What the wheel turned in each step [rad]; or its speed [rad/s]."""
    values = column.values[:ROWS]
    change = values[1:] if column.reading in (Reading.VELOCITY, Reading.INCREMENT) else np.diff(values)
    steps: Floats = np.abs(change.astype(np.float64))
    if column.reading is Reading.TICKS:
        encoder = robot.encoders[column.name]
        if encoder.bits is not None:
            steps = np.minimum(steps, np.abs(2.0**encoder.bits - steps))
        steps *= abs(encoder.radians_per_tick)
    return steps


def _other_units(robot: Robot, column: WheelColumn, typical: float, limit: float) -> list[str]:
    """Units in which the same numbers would be a robot's, the likeliest first."""
    now, is_rate = column.unit, column.unit.dimension.endswith("/s")
    speeds = {
        unit: typical / _metres(robot, column.name, now) * _metres(robot, column.name, unit)
        for unit in Unit
        if unit is not now and unit.dimension.endswith("/s") == is_rate and unit.dimension != "time"
    }
    fitting = {unit: speed for unit, speed in speeds.items() if SLOWEST < speed <= limit}
    likely = sorted(fitting, key=lambda unit: (unit not in COUNTED, abs(math.log(fitting[unit] / USUAL))))
    return [f"unit: {unit.value} would make it {fitting[unit]:.2g} m/s" for unit in likely[:2]]


def _metres(robot: Robot, name: str, unit: Unit) -> float:
    """What one of a unit is at the wheel's rim [m]; 0 where nobody knows."""
    radius = robot.measuring.wheel(name).radius
    dimension = unit.dimension.removesuffix("/s")
    if unit in COUNTED:
        encoder = robot.encoders.get(name)
        return 0.0 if encoder is None else radius * abs(encoder.radians_per_tick)
    return unit.factor * (radius if dimension == "angle" else 1.0)


# --- counters that wrap -----------------------------------------------------------------------------------


def _wrap(robot: Robot, column: WheelColumn) -> str:
    """A counter that wraps although no width, or another one, is declared."""
    encoder = robot.encoders.get(column.name)
    totals = column.reading in (Reading.TICKS, Reading.POSITION)
    if encoder is None or not totals or column.unit is not Unit.TICKS:
        return ""
    factor = 1 if column.reading is Reading.TICKS else column.conversion.factor
    bits, times = _seeming_width(np.asarray(column.values[:ROWS] / factor, np.float64))
    if not bits or bits == encoder.bits:
        return ""
    declared = "none" if encoder.bits is None else encoder.bits
    often = "once" if times == 1 else f"{times} times"
    return (
        f"encoders.{column.name}.bits: {declared}, but it jumps by about {2**bits} ticks {often}, as"
        f" a counter of {bits} bits does where it wraps; write bits: {bits}"
    )


def _seeming_width(counts: Floats) -> tuple[int, int]:
    """Bits of a counter that wraps at a power of two, and how often it does; 0 where it does not."""
    steps = np.abs(np.diff(counts[np.isfinite(counts)]))
    for bits in WIDTHS:
        span = 2.0**bits
        far = steps > span / 2
        times = int(np.count_nonzero(far))
        if not times or 4 * times > len(steps) or np.ptp(counts) >= span:
            continue
        usual = float(steps[~far].max())
        # Seen from the other side of the wrap, these steps are like all others.
        if usual < span / 4 and float((span - steps[far]).max()) <= 2.0 * usual + 2.0:
            return bits, times
    return 0, 0


# --- running totals that are taken for speeds -------------------------------------------------------------


def _only_speeds_up(column: WheelColumn) -> bool:
    """Whether a speed only grows, one way or the other, over all of a log that lasts."""
    if column.reading is not Reading.VELOCITY or float(column.seconds.sum()) < NEVER_SLOWER:
        return False
    steps = np.diff(column.values[:ROWS])
    changes = np.count_nonzero(steps)
    return bool(
        changes >= 20 and max(np.count_nonzero(steps > 0.0), np.count_nonzero(steps < 0.0)) == changes
    )
