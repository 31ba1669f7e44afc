"""Straight lines."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import PathError, require_numbers, row_of, shown
from trundle.follow.curve import CurvePoint
from trundle.geometry import Pose2D

__all__ = ["Line"]


class Line(msgspec.Struct, frozen=True):
    """A straight line from one point to another.

    Attributes:
        start: (x, y) [m].
        end: (x, y) [m].

    Raises:
        PathError: If a number is not finite, or both points are the same.
    """

    start: tuple[float, float]
    end: tuple[float, float]

    def __post_init__(self) -> None:
        for point in (self.start, self.end):
            if len(row_of(point) or ()) != 2:
                raise PathError(f"{shown(point)}: a point must be (x, y)")
            require_numbers("Line", row={"point": point})
        if not 0.0 < self.length < math.inf:
            raise PathError(f"a line from {self.start} to {self.end} has no length: two different points")

    @staticmethod
    def ahead(start: Pose2D, length: float) -> Line:
        """The line on which a robot at `start` drives straight on for a length [m]."""
        end = start @ Pose2D(length, 0.0, 0.0)
        return Line((start.x, start.y), (end.x, end.y))

    @property
    def length(self) -> float:
        """From end to end [m]."""
        return math.dist(self.start, self.end)

    def at(self, distance: float) -> CurvePoint:
        """The point after a distance from the beginning [m]."""
        (x, y), (to_x, to_y) = self.start, self.end
        share = distance / self.length
        return CurvePoint(x + share * (to_x - x), y + share * (to_y - y), math.atan2(to_y - y, to_x - x))

    def nearest(self, x: float, y: float) -> float:
        """The distance along the line [m] of the point that is nearest to (x, y)."""
        (x0, y0), (x1, y1), length = self.start, self.end, self.length
        ahead = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / length
        return min(max(ahead, 0.0), length)
