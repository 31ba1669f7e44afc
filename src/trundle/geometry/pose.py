"""Scalar poses and twists of the plane: floats in, floats out, no arrays.

The array twins of these formulas stand in `geometry.se2`; a test holds the two together.
"""

from __future__ import annotations

import math

import msgspec

from trundle.errors import InputError, shown
from trundle.geometry.angle import sinc, wrap

__all__ = ["Pose2D", "Twist2D"]

# Values are made a thousand times a second, so nothing is asked until something went wrong.
_UNUSABLE = (AttributeError, TypeError, ValueError, OverflowError)


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
        try:
            return Twist2D(self.vx * factor, self.vy * factor, self.omega * factor)
        except _UNUSABLE:
            raise InputError(f"{self!r} * {shown(factor)}: must be a twist of numbers and a number") from None

    __rmul__ = __mul__

    def at(self, x: float, y: float) -> Twist2D:
        """Velocity of the body's point (x, y) [m], in the axes of the body."""
        try:
            return Twist2D(self.vx - self.omega * y, self.vy + self.omega * x, self.omega)
        except _UNUSABLE:
            raise InputError(f"{self!r}.at({shown(x)}, {shown(y)}): must be numbers") from None

    @property
    def curvature(self) -> float:
        """Signed curvature of the path [1/m], left positive; NaN at rest, inf on the spot.

        Curvature, not its radius: a straight line has none, instead of an infinite one.
        """
        try:
            speed = math.hypot(self.vx, self.vy)
            if speed:
                return math.copysign(1.0, self.vx) * self.omega / speed
            return math.copysign(math.inf, self.omega) if self.omega else math.nan
        except _UNUSABLE:
            raise InputError(f"curvature of {self!r}: must be a twist of numbers") from None


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
        except _UNUSABLE:
            raise InputError(
                f"{self!r} @ {shown(other)}: both must be poses of numbers, headings finite"
            ) from None

    def inverse(self) -> Pose2D:
        """The pose that undoes this one: `pose @ pose.inverse()` is the identity."""
        try:
            c, s = math.cos(self.theta), math.sin(self.theta)
            return Pose2D(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)
        except _UNUSABLE:
            raise InputError(f"inverse of {self!r}: must be a pose of finite numbers") from None

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
        try:
            half = 0.5 * twist.omega
            chord = sinc(half)
            c, s = chord * math.cos(half), chord * math.sin(half)
            return Pose2D(c * twist.vx - s * twist.vy, s * twist.vx + c * twist.vy, twist.omega)
        except _UNUSABLE:
            raise InputError(f"exp of {shown(twist)}: must be a twist of finite numbers") from None

    def log(self) -> Twist2D:
        """The shortest twist that reaches this pose in one unit of time; inverse of `exp`.

        The heading is wrapped first: the group does not count turns.

        Source:
            Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 157.
        """
        try:
            theta = wrap(self.theta)
            half = 0.5 * theta
            along = half / math.tan(half) if half else 1.0
            return Twist2D(along * self.x + half * self.y, along * self.y - half * self.x, theta)
        except _UNUSABLE:
            raise InputError(f"log of {self!r}: must be a pose of finite numbers") from None

    def adjoint(self) -> tuple[tuple[float, float, float], ...]:
        """Matrix that takes a twist in this pose's frame to the frame that the pose is in."""
        try:
            c, s = math.cos(self.theta), math.sin(self.theta)
            left, right = -self.x, self.y
        except _UNUSABLE:
            raise InputError(f"adjoint of {self!r}: must be a pose of finite numbers") from None
        return ((c, -s, right), (s, c, left), (0.0, 0.0, 1.0))
