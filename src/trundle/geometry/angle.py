"""Angles in radians, counter-clockwise positive."""

from __future__ import annotations

import math

__all__ = ["sinc", "wrap"]


def wrap(angle: float) -> float:
    """The same direction in (-pi, pi].

    `math.remainder` is exact, so a heading of a million turns loses nothing here.
    """
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def sinc(angle: float) -> float:
    """sin(angle) / angle, with its limit 1 at zero.

    The plain quotient is within one unit in the last place down to the smallest float:
    there is nothing for a series near zero to mend.
    """
    return math.sin(angle) / angle if angle else 1.0
