"""Arcs of circles."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import PathError
from trundle.follow.curve import CurvePoint
from trundle.geometry import Pose2D, Twist2D

__all__ = ["CircularArc"]


class CircularArc(msgspec.Struct, frozen=True):
    """An arc that leaves a pose along its heading.

    Attributes:
        start: Where it begins, and in which direction.
        radius: [m], above zero.
        angle: How far it turns [rad], left positive; more than a whole turn is allowed.

    Raises:
        PathError: If a number is not finite, the radius is not above zero, or the angle is zero.
    """

    start: Pose2D
    radius: float
    angle: float

    def __post_init__(self) -> None:
        pose = self.start
        if not (0.0 < self.length < math.inf and self.radius > 0.0):
            raise PathError(
                f"an arc of radius {self.radius} m over {self.angle} rad: the radius must be > 0, the angle "
                "not 0, both finite; a turn on the spot is no path"
            )
        if not math.isfinite(pose.x + pose.y + pose.theta):
            raise PathError(f"an arc that begins at {pose}: every number must be finite")

    @property
    def length(self) -> float:
        """From end to end [m]."""
        return self.radius * abs(self.angle)

    @property
    def curvature(self) -> float:
        """One by the radius [1/m], left positive."""
        return math.copysign(1.0 / self.radius, self.angle)

    def at(self, distance: float) -> CurvePoint:
        """The point after a distance from the beginning [m]."""
        pose = self.start @ Pose2D.exp(Twist2D(distance, 0.0, self.curvature * distance))
        return CurvePoint(pose.x, pose.y, pose.theta, self.curvature)

    def nearest(self, x: float, y: float) -> float:
        """The distance along the arc [m] of the point that is nearest to (x, y)."""
        seen = self.start.inverse() @ Pose2D(x, y)
        side = math.copysign(1.0, self.angle)
        # The angle about the centre (0, side * radius), seen from the start of the arc.
        angle = math.atan2(seen.x, self.radius - side * seen.y) % math.tau
        if angle <= abs(self.angle):
            return angle * self.radius
        end = self.at(self.length)
        to_end = math.dist((x, y), (end.x, end.y))
        return self.length if to_end < math.hypot(seen.x, seen.y) else 0.0
