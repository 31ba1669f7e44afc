"""A piece of a path in the plane, measured by the distance along it."""

from __future__ import annotations

import math
from typing import Protocol

import msgspec

__all__ = ["Curve", "CurvePoint", "project"]


class CurvePoint(msgspec.Struct, frozen=True, gc=False):
    """Where a curve is after some distance, and how it bends there.

    Attributes:
        x: [m].
        y: [m].
        course: Direction in which it runs [rad], not wrapped.
        curvature: Change of the course per distance [1/m], left positive.
        curvature_change: Change of the curvature per distance [1/m^2].
    """

    x: float
    y: float
    course: float
    curvature: float = 0.0
    curvature_change: float = 0.0


class Curve(Protocol):
    """What lines, arcs and splines have in common: they run at one metre per metre."""

    @property
    def length(self) -> float:
        """From end to end [m]."""

    def at(self, distance: float) -> CurvePoint:
        """The point after a distance from the beginning [m], which lies in [0, length]."""

    def nearest(self, x: float, y: float) -> float:
        """The distance along the curve [m] of the point that is nearest to (x, y)."""


class _Place(Protocol):
    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def course(self) -> float: ...
    @property
    def curvature(self) -> float: ...


class _Course(Protocol):
    @property
    def length(self) -> float: ...
    def at(self, distance: float, /) -> _Place: ...


def project(curve: _Course, x: float, y: float, guess: float, window: float = math.inf) -> float:
    """The distance along a curve of the nearest point in a neighbourhood, by Newton's method.

    Where a curve crosses itself, the guess decides which of its branches is meant.

    Args:
        curve: The curve, or a path.
        x: Of the point that is projected [m].
        y: The same.
        guess: Distance at which to begin [m].
        window: How far from the guess the answer may lie [m].
    """
    least, greatest = max(0.0, guess - window), min(curve.length, guess + window)
    distance = min(max(guess, least), greatest)
    for _ in range(10):
        point = curve.at(distance)
        dx, dy = x - point.x, y - point.y
        c, s = math.cos(point.course), math.sin(point.course)
        ahead, aside = c * dx + s * dy, c * dy - s * dx
        # A point aside of a bend moves along it by 1/(1 - curvature * aside); at the bend's centre by any.
        step = ahead / max(1.0 - point.curvature * aside, 0.5)
        before, distance = distance, min(max(distance + step, least), greatest)
        if abs(distance - before) < 1e-9:
            break
    return distance
