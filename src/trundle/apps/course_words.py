"""Courses as people type them: `straight 10, spin 5, spin -5`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from trundle.errors import ConfigError, InputError, did_you_mean

if TYPE_CHECKING:
    from trundle.simulate import Course, Manoeuvre

__all__ = ["COURSES", "course_of"]

REST = 0.5  # [s] of standing still between manoeuvres


class _Pace(NamedTuple):
    """How fast: [m/s], [rad/s]."""

    speed: float
    yaw_rate: float


class _Word(NamedTuple):
    """One manoeuvre.

    Attributes:
        arguments: Names of its numbers.
        make: Makes it.
    """

    arguments: tuple[str, ...]
    make: Callable[..., Iterable[Manoeuvre]]


def _straight(pace: _Pace, metres: float) -> Iterable[Manoeuvre]:
    from trundle.simulate import straight

    return [straight(metres, pace.speed)]


def _slide(pace: _Pace, forward: float, left: float) -> Iterable[Manoeuvre]:
    from trundle.simulate import slide

    return [slide(forward, left, pace.speed)]


def _spin(pace: _Pace, turns: float) -> Iterable[Manoeuvre]:
    from trundle.simulate import spin

    return [spin(math.tau * turns, pace.yaw_rate)]


def _arc(pace: _Pace, radius: float, turns: float) -> Iterable[Manoeuvre]:
    from trundle.simulate import arc

    return [arc(radius, math.tau * turns, pace.speed)]


def _square(pace: _Pace, side: float) -> Iterable[Manoeuvre]:
    from trundle.simulate import square

    return square(abs(side), pace.speed, yaw_rate=pace.yaw_rate, clockwise=side < 0.0)


def _eight(pace: _Pace, radius: float) -> Iterable[Manoeuvre]:
    from trundle.simulate import figure_eight

    return figure_eight(radius, pace.speed)


_WORDS: Mapping[str, _Word] = {
    "straight": _Word(("metres",), _straight),
    "slide": _Word(("forward", "left"), _slide),
    "spin": _Word(("turns",), _spin),
    "arc": _Word(("radius", "turns"), _arc),
    "square": _Word(("side",), _square),
    "eight": _Word(("radius",), _eight),
}
COURSES = ", ".join(f"{name} {' '.join(word.arguments).upper()}" for name, word in _WORDS.items())


def course_of(text: str, *, speed: float, yaw_rate: float) -> Course:
    """A course in words.

    Lengths are in m; turns are whole ones, left positive; a square with a negative side is driven clockwise.

    Args:
        text: Manoeuvres with commas between them.
        speed: [m/s].
        yaw_rate: On the spot [rad/s].

    Raises:
        InputError: If a word is no manoeuvre, or a number is missing or impossible.
    """
    from trundle.simulate import Course, stop

    pieces: list[Manoeuvre] = []
    for part in filter(None, (one.strip() for one in text.split(","))):
        pieces += [*_manoeuvres(part, _Pace(speed, yaw_rate)), stop(REST)]
    if not pieces:
        raise InputError(f"a course needs at least one of {COURSES}")
    return Course.of(*pieces)


def _manoeuvres(text: str, pace: _Pace) -> Iterable[Manoeuvre]:
    name, *numbers = text.split()
    if name not in _WORDS:
        raise InputError(f"course: {text!r}, {did_you_mean(name, _WORDS)}")
    word = _WORDS[name]
    if len(numbers) != len(word.arguments):
        wanted = f"{name} {' '.join(word.arguments).upper()}"
        raise InputError(f"course: {text!r}, must be {wanted}")
    try:
        return word.make(pace, *map(float, numbers))
    except ConfigError as error:
        raise InputError(f"course: {text!r}: {error}") from None
    except ValueError:
        raise InputError(f"course: {text!r}: {' '.join(numbers)} must be plain numbers") from None
