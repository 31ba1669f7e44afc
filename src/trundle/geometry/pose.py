"""Scalar poses and twists of the plane: floats in, floats out, no arrays.

The array twins of these formulas stand in `geometry.se2`; a test holds the two together.
"""

from __future__ import annotations

import math

import msgspec

from trundle.errors import InputError
from trundle.geometry.angle import sinc, wrap

__all__ = ["Pose2D", "Twist2D"]


class Twist2D(msgspec.Struct, frozen=True, gc=False):
    """Velocity of a body, in the body's own frame.

    Attributes:
        vx: Forward speed [m/s].
        vy: Leftward speed [m/s].
        omega: Yaw rate [rad/s], counter-clockwise positive.
    """

    vx: float = 0.0
    vy: float = 0.0
    omega: float = 0.0

    def __mul__(self, factor: float) -> Twist2D:
        """The twist scaled, e.g. by a duration, which makes it a displacement."""
        return Twist2D(self.vx * factor, self.vy * factor, self.omega * factor)

    __rmul__ = __mul__

    def at(self, x: float, y: float) -> Twist2D:
        """Velocity of the body's point (x, y) [m], in the axes of the body."""
        return Twist2D(self.vx - self.omega * y, self.vy + self.omega * x, self.omega)

    @property
    def curvature(self) -> float:
        """Signed curvature of the path [1/m], left positive; NaN at rest, inf on the spot.

        Curvature, not its radius: a straight line has none, instead of an infinite one.
        """
        speed = math.hypot(self.vx, self.vy)
        if speed:
            return math.copysign(1.0, self.vx) * self.omega / speed
        return math.copysign(math.inf, self.omega) if self.omega else math.nan


class Pose2D(msgspec.Struct, frozen=True, gc=False):
    """Position and heading of one frame in another: an element of SE(2).

    Attributes:
        x: [m].
        y: [m].
        theta: Heading [rad], counter-clockwise positive, not wrapped.
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __matmul__(self, other: Pose2D) -> Pose2D:
        """The pose `other`, given in this pose's frame, in the frame that this pose is in."""
        try:
            c, s = math.cos(self.theta), math.sin(self.theta)
            return Pose2D(
                self.x + c * other.x - s * other.y,
                self.y + s * other.x + c * other.y,
                self.theta + other.theta,
            )
        except (AttributeError, TypeError):
            raise InputError(f"{self!r} @ {other!r}: both must be poses of numbers") from None

    def inverse(self) -> Pose2D:
        """The pose that undoes this one: `pose @ pose.inverse()` is the identity."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return Pose2D(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)

    def wrapped(self) -> Pose2D:
        """The same pose with its heading in (-pi, pi]."""
        return Pose2D(self.x, self.y, wrap(self.theta))

    @staticmethod
    def exp(twist: Twist2D) -> Pose2D:
        """Pose reached by holding a body twist for one unit of time: an arc of a circle.

        Source:
            Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 156 and 158. Their V(theta) is a
            rotation by theta/2 scaled by sinc(theta/2): the chord of the arc.
        """
        half = 0.5 * twist.omega
        chord = sinc(half)
        c, s = chord * math.cos(half), chord * math.sin(half)
        return Pose2D(c * twist.vx - s * twist.vy, s * twist.vx + c * twist.vy, twist.omega)

    def log(self) -> Twist2D:
        """The shortest twist that reaches this pose in one unit of time; inverse of `exp`.

        The heading is wrapped first: the group does not count turns.

        Source:
            Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 157.
        """
        theta = wrap(self.theta)
        half = 0.5 * theta
        along = half / math.tan(half) if half else 1.0
        return Twist2D(along * self.x + half * self.y, along * self.y - half * self.x, theta)

    def adjoint(self) -> tuple[tuple[float, float, float], ...]:
        """Matrix that takes a twist in this pose's frame to the frame that the pose is in."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return ((c, -s, self.y), (s, c, -self.x), (0.0, 0.0, 1.0))
