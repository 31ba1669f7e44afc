"""Lengths and angles as people write them, and the sizes at which a unit must be asked for."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any, NamedTuple

from trundle.errors import ConfigError, did_you_mean
from trundle.robot.log_mapping import Unit

__all__ = [
    "ANGLE",
    "LENGTH",
    "POSITION",
    "RADIUS",
    "Quantity",
    "read_number",
    "read_quantity",
    "spell_quantity",
]


class Quantity(NamedTuple):
    """What a number measures, and between which magnitudes it needs no unit.

    Attributes:
        dimension: As of `Unit`.
        si: Unit of a bare number.
        least: Smallest plausible magnitude above zero.
        most: Greatest plausible magnitude.
    """

    dimension: str
    si: Unit
    least: float
    most: float


RADIUS = Quantity("length", Unit.M, 0.001, 5.0)
LENGTH = Quantity("length", Unit.M, 0.005, 50.0)
POSITION = Quantity("length", Unit.M, 0.0, 50.0)
ANGLE = Quantity("angle", Unit.RAD, 0.0, math.tau)

_NUMBER = r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]{1,4})?"
_BARE = re.compile(_NUMBER)
_WITH_UNIT = re.compile(rf"\s*({_NUMBER})\s*([A-Za-z/]+)\s*")


def read_number(path: str, value: Any) -> float:
    """A finite number.

    Raises:
        ConfigError: If it is none, `true` and texts such as `"1e3"` included.
    """
    if isinstance(value, str):
        advice = "; write it without quotes" if _BARE.fullmatch(value.strip()) else ""
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
    """A length or angle in SI units, from a plausible bare number or from a text such as `65 mm`.

    Raises:
        ConfigError: If it is neither. A bare number of implausible size is asked for its unit.
    """
    if isinstance(value, str) and (parts := _WITH_UNIT.fullmatch(value)):
        return _in_si(path, parts[1], parts[2], quantity)
    number = read_number(path, value)
    size = abs(number)
    if size == 0.0 or quantity.least <= size <= quantity.most:
        return number
    si, limits = quantity.si.value, f"{quantity.least:g} to {quantity.most:.4g} {quantity.si.value}"
    guesses = [
        unit.value
        for unit in Unit
        if unit.dimension == quantity.dimension and quantity.least <= size * unit.factor <= quantity.most
    ]
    bare = f"{value:.12g}"
    question = f"{guesses[0]}? Then write {bare} {guesses[0]}" if guesses else "what unit is it in?"
    problem = f"{bare} {si} is implausible ({limits}): {question}; write {bare} {si} if that is meant"
    raise ConfigError(path, problem)


def spell_quantity(path: str, value: Any, quantity: Quantity) -> float | str:
    """How `value` is written so that `read_quantity` reads it: with its unit where that must be said."""
    del path  # the same signature as read_quantity
    number = float(value)
    if number == 0.0 or quantity.least <= abs(number) <= quantity.most:
        return number
    return f"{number!r} {quantity.si.value}"


def _in_si(path: str, number: str, word: str, quantity: Quantity) -> float:
    allowed = [unit.value for unit in Unit if unit.dimension == quantity.dimension]
    if word not in allowed:
        problem = f"{number} {word}: not a unit of {quantity.dimension}; {did_you_mean(word, allowed)}"
        raise ConfigError(path, problem)
    # Decimals, so that 8.4 cm is 0.084 to the last bit.
    value = float(Decimal(number) * Decimal(repr(Unit(word).factor)))
    if not math.isfinite(value):
        raise ConfigError(path, f"{number} {word}, must be finite")
    return value
