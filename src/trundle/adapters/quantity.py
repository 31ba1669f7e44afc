"""Quantities as people write them, and the sizes at which a unit must be asked for."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any, NamedTuple

from trundle.errors import ConfigError, did_you_mean
from trundle.robot.log_mapping import Unit

__all__ = [
    "ACCELERATION",
    "ANGLE",
    "DELAY",
    "DURATION",
    "JERK",
    "LENGTH",
    "POSITION",
    "RADIUS",
    "SPEED",
    "SPREAD",
    "WHEEL_SPEED",
    "YAW_ACCELERATION",
    "YAW_RATE",
    "YAW_RATE_SPREAD",
    "Quantity",
    "read_number",
    "read_quantity",
    "spell_quantity",
]


class Quantity(NamedTuple):
    """What a number measures, and between which magnitudes it needs no unit.

    Attributes:
        dimension: As of `Unit`, or the rate at which one of these changes: `length/s^2`.
        least: Smallest plausible magnitude above zero.
        most: Greatest plausible magnitude.
    """

    dimension: str
    least: float = 0.0
    most: float = math.inf

    @property
    def units(self) -> dict[str, float]:
        """What may be written behind a number, and what one of it is in SI; the SI unit first."""
        own = {unit.value: unit.factor for unit in Unit if unit.dimension == self.dimension}
        changing, _, power = self.dimension.partition("/s^")
        if power:
            own = {f"{u.value}/s^{power}": u.factor for u in Unit if u.dimension == changing}
        return own

    @property
    def si(self) -> str:
        """Unit of a bare number."""
        return next(iter(self.units))

    def holds(self, size: float) -> bool:
        """Whether a number of this size needs no unit."""
        return size == 0.0 or self.least <= size <= self.most


RADIUS = Quantity("length", 0.001, 5.0)
LENGTH = Quantity("length", 0.005, 50.0)
POSITION = Quantity("length", 0.0, 50.0)
SPREAD = Quantity("length")
ANGLE = Quantity("angle", 0.0, math.tau)
SPEED = Quantity("length/s", 0.0, 100.0)
YAW_RATE = Quantity("angle/s", 0.0, 100.0)
YAW_RATE_SPREAD = Quantity("angle/s")
WHEEL_SPEED = Quantity("angle/s")
ACCELERATION = Quantity("length/s^2")
YAW_ACCELERATION = Quantity("angle/s^2")
JERK = Quantity("length/s^3")
DURATION = Quantity("time", 0.001, 60.0)
DELAY = Quantity("time")

_NUMBER = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]{1,4})?"
_BARE = re.compile(_NUMBER)
_DECIMAL_COMMA = re.compile(r"\s*([-+]?[0-9]*),([0-9]+)(\s*[A-Za-z/]*(?:\^[0-9])?)\s*")
_WITH_UNIT = re.compile(rf"\s*({_NUMBER})\s*([A-Za-z/]+(?:\^[0-9])?)\s*")


def read_number(path: str, value: Any) -> float:
    """A finite number.

    Raises:
        ConfigError: If it is none, `true` and texts such as `"1e3"` included.
    """
    if isinstance(value, str):
        advice = "; write it without quotes" if _BARE.fullmatch(value.strip()) else ""
        if parts := _DECIMAL_COMMA.fullmatch(value):
            advice = f" with a decimal point: {parts[1]}.{parts[2]}{parts[3].rstrip()}"
        raise ConfigError(path, f"{value!r} is text, must be a number{advice}")
    if value is None:
        raise ConfigError(path, "empty, must be a number")
    if isinstance(value, bool) or not isinstance(value, int | float):
        shown = str(value).lower() if isinstance(value, bool) else repr(value)
        raise ConfigError(path, f"{shown}, must be a number")
    if not math.isfinite(value):
        raise ConfigError(path, f"{value}, must be finite")
    return float(value)


def read_quantity(path: str, value: Any, quantity: Quantity) -> float:
    """A quantity in SI units, from a plausible bare number or from a text such as `65 mm` or `3 km/h`.

    Raises:
        ConfigError: If it is neither. A bare number of implausible size is asked for its unit.
    """
    if isinstance(value, str) and (parts := _WITH_UNIT.fullmatch(value)):
        return _in_si(path, parts[1], parts[2], quantity)
    number = read_number(path, value)
    size = abs(number)
    if quantity.holds(size):
        return number
    si, limits = quantity.si, f"{quantity.least:g} to {quantity.most:.4g} {quantity.si}"
    guesses = [unit for unit, factor in quantity.units.items() if quantity.holds(size * factor)]
    bare = f"{value:.12g}"
    question = f"{guesses[0]}? Then write {bare} {guesses[0]}" if guesses else "what unit is it in?"
    problem = f"{bare} {si} is implausible ({limits}): {question}; write {bare} {si} if that is meant"
    raise ConfigError(path, problem)


def spell_quantity(path: str, value: Any, quantity: Quantity) -> float | str:
    """How `value` is written so that `read_quantity` reads it: with its unit where that must be said."""
    del path  # the same signature as read_quantity
    number = float(value)
    return number if quantity.holds(abs(number)) else f"{number!r} {quantity.si}"


def _in_si(path: str, number: str, word: str, quantity: Quantity) -> float:
    if word not in quantity.units:
        known = did_you_mean(word, quantity.units)
        raise ConfigError(path, f"{number} {word}: not a unit of {quantity.dimension}; {known}")
    # Decimals, so that 8.4 cm is 0.084 to the last bit.
    value = float(Decimal(number) * Decimal(repr(quantity.units[word])))
    if not math.isfinite(value):
        raise ConfigError(path, f"{number} {word}, must be finite")
    return value
