"""Cubic and quintic Hermite splines: curves that leave and arrive as they are told."""

from __future__ import annotations

import math

import msgspec
import numpy as np

from trundle.errors import PathError
from trundle.follow.spline import Spline
from trundle.geometry import Pose2D

__all__ = ["Knot", "cubic_hermite", "quintic_between", "quintic_hermite"]

# Columns: ascending powers of u. Rows: p(0), p'(0), p(1), p'(1); then with p''(0) and p''(1).
_CUBIC = np.array([[1.0, 0, -3, 2], [0, 1, -2, 1], [0, 0, 3, -2], [0, 0, -1, 1]])
_QUINTIC = np.array(
    [
        [1.0, 0, 0, -10, 15, -6],
        [0, 1, 0, -6, 8, -3],
        [0, 0, 0.5, -1.5, 1.5, -0.5],
        [0, 0, 0, 10, -15, 6],
        [0, 0, 0, -4, 7, -3],
        [0, 0, 0, 0.5, -1, 0.5],
    ]
)


class Knot(msgspec.Struct, frozen=True, gc=False):
    """An end of a spline: a point, and its derivatives by the parameter, which runs from 0 to 1.

    Attributes:
        x: [m].
        y: [m].
        dx: First derivative [m]: its direction is the course, its size how far the course is kept.
        dy: The same.
        ddx: Second derivative [m]; quintic splines only.
        ddy: The same.
    """

    x: float
    y: float
    dx: float
    dy: float
    ddx: float = 0.0
    ddy: float = 0.0


def cubic_hermite(start: Knot, end: Knot) -> Spline:
    """The cubic with these ends; second derivatives are as they come out.

    Raises:
        PathError: As `Spline`.
    """
    ends = [[k.x, k.y] if part == 0 else [k.dx, k.dy] for k in (start, end) for part in (0, 1)]
    return Spline((np.array(ends).T @ _CUBIC)[None])


def quintic_hermite(start: Knot, end: Knot) -> Spline:
    """The quintic with these ends; quintics joined at a knot are continuous in curvature too.

    Raises:
        PathError: As `Spline`.
    """
    ends = [pair for k in (start, end) for pair in ((k.x, k.y), (k.dx, k.dy), (k.ddx, k.ddy))]
    return Spline((np.array(ends).T @ _QUINTIC)[None])


def quintic_between(start: Pose2D, end: Pose2D) -> Spline:
    """The quintic that leaves one pose and arrives at another along their headings.

    Its first derivatives are as long as the poses are apart and the second ones zero (the curvature is
    zero at both ends), as Road Runner's `splineTo` has it.

    Raises:
        PathError: If both are at the same place, or as `Spline`.
    """
    size = math.dist((start.x, start.y), (end.x, end.y))
    if not 0.0 < size < math.inf:
        raise PathError(f"a spline from {start} to {end}: must be between two different, finite places")
    first, last = (
        Knot(pose.x, pose.y, size * math.cos(pose.theta), size * math.sin(pose.theta))
        for pose in (start, end)
    )
    return quintic_hermite(first, last)
