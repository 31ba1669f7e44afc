"""Angles in radians, counter-clockwise positive."""

from __future__ import annotations

import math

from trundle.errors import InputError, require_numbers, shown

__all__ = ["excess", "sinc", "wrap"]


def wrap(angle: float) -> float:
    """The same direction in (-pi, pi].

    `math.remainder` is exact, so a heading of a million turns loses nothing here.
    """
    try:
        wrapped = math.remainder(angle, math.tau)
    except (TypeError, ValueError, OverflowError):
        require_numbers("wrap", one={"angle": angle})
        raise InputError(f"wrap: angle {shown(angle)}, must be finite") from None
    return math.pi if wrapped == -math.pi else wrapped


def sinc(angle: float) -> float:
    """sin(angle) / angle, with its limit 1 at zero.

    The plain quotient is within one unit in the last place down to the smallest float:
    there is nothing for a series near zero to mend.
    """
    return math.sin(angle) / angle if angle else 1.0


def excess(angle: float) -> float:
    """(angle - sin(angle)) / angle^2, which is angle/6 near zero; the quotient loses digits there."""
    if abs(angle) > 0.05:
        return (angle - math.sin(angle)) / (angle * angle)
    square = angle * angle
    return angle * (1.0 / 6.0 - square * (1.0 / 120.0 - square * (1.0 / 5040.0 - square / 362880.0)))
