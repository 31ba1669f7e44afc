"""Arcs: a radius and how fast, as left and right speeds, and back.

The radius is signed: its centre (ICC, ICR) lies to the left where it is positive. A straight line has
an infinite radius and curvature 0, a turn on the spot has radius 0; both are exact.
"""

from __future__ import annotations

import math

import msgspec

from trundle.errors import Infeasible, InputError, require_positive
from trundle.geometry import Twist2D

__all__ = ["Arc", "arc", "arc_of_sides"]


class Arc(msgspec.Struct, frozen=True, gc=False):
    """Motion on a circle.

    Attributes:
        speed: Of the middle of the axle [m/s].
        yaw_rate: [rad/s], counter-clockwise positive.
    """

    speed: float
    yaw_rate: float

    @property
    def radius(self) -> float:
        """Signed distance to the turning centre [m], left positive; infinite when straight or at rest.

        Source: `R = L/2 (v_r + v_l) / (v_r - v_l)`, which is `speed / yaw_rate`.
        """
        return self.speed / self.yaw_rate if self.yaw_rate else math.inf

    @property
    def curvature(self) -> float:
        """`yaw_rate / speed` [1/m]; 0 when straight or at rest, infinite (signed) on the spot."""
        if self.speed:
            return self.yaw_rate / self.speed
        return math.copysign(math.inf, self.yaw_rate) if self.yaw_rate else 0.0

    @property
    def twist(self) -> Twist2D:
        """The same motion as a body twist."""
        return Twist2D(self.speed, 0.0, self.yaw_rate)

    def sides(self, track_width: float) -> tuple[float, float]:
        """Speeds of the left and the right side [m/s].

        Args:
            track_width: Distance between the sides [m].

        Source:
            Kohanbash 2016: `v_right = w (R + B/2)`, `v_left = w (R - B/2)`. Multiplied out, so that
            a straight line does not become zero times infinity.
        """
        half = 0.5 * require_positive("track_width", track_width) * self.yaw_rate
        return self.speed - half, self.speed + half


def arc(radius: float, *, yaw_rate: float | None = None, speed: float | None = None) -> Arc:
    """The arc of a radius, driven at a yaw rate or at a speed.

    Args:
        radius: Signed [m], left positive; infinite means straight, 0 on the spot.
        yaw_rate: [rad/s]; in place of `speed`.
        speed: Of the middle of the axle [m/s]; in place of `yaw_rate`.

    Raises:
        InputError: If not exactly one of the two is given, or a number is NaN or cannot be finite.
        Infeasible: If the two contradict each other: a speed on radius 0, a yaw rate on a straight line.
    """
    if (yaw_rate is None) == (speed is None):
        raise InputError("arc needs exactly one of yaw_rate= [rad/s] and speed= [m/s]")
    given = yaw_rate if speed is None else speed
    if math.isnan(radius) or given is None or not math.isfinite(given):
        raise InputError(
            f"arc: radius {radius}, yaw_rate {yaw_rate}, speed {speed}: only the radius may be infinite"
        )
    if yaw_rate is not None:
        if math.isinf(radius) and yaw_rate:
            raise Infeasible(f"yaw_rate {yaw_rate:g} on a straight line (infinite radius): give speed= there")
        return Arc(0.0 if math.isinf(radius) else radius * yaw_rate, yaw_rate)
    if radius == 0.0 and given:
        raise Infeasible(f"speed {given:g} on radius 0 (a turn on the spot): give yaw_rate= there")
    return Arc(given, given / radius if radius else 0.0)


def arc_of_sides(left: float, right: float, track_width: float) -> Arc:
    """The arc that two side speeds drive.

    Args:
        left: Speed of the left side [m/s].
        right: Speed of the right side [m/s].
        track_width: Distance between the sides [m].

    Source:
        `w = (v_r - v_l) / L`, `v_x = (v_r + v_l) / 2`; `Arc.radius` is the signed R of the ICC.
    """
    return Arc(0.5 * (left + right), (right - left) / require_positive("track_width", track_width))
