"""Steering a unicycle: from a wanted heading to a yaw rate, or to a body twist."""

from __future__ import annotations

import math

from trundle.errors import require_positive
from trundle.geometry import Twist2D, wrap

__all__ = ["point_forward", "regulate_heading", "within_limits"]


def regulate_heading(heading: float, wanted: float, *, gain: float, max_yaw_rate: float = math.inf) -> float:
    """Yaw rate [rad/s] of a proportional regulator: `gain * (wanted - heading)`, the error wrapped.

    It turns by the shorter way: from 170 to -170 degrees are 20 degrees to the left.

    Args:
        heading: Present [rad].
        wanted: [rad].
        gain: [1/s].
        max_yaw_rate: [rad/s].
    """
    return min(max(gain * wrap(wanted - heading), -max_yaw_rate), max_yaw_rate)


def point_forward(heading: float, wanted: float, speed: float, *, distance: float) -> Twist2D:
    """The Point Forward Steering Controller: a point ahead of the axle moves exactly as wanted.

    With a = wanted heading minus heading, `v = cos(a) V` and `omega = sin(a) V / l`. The point at `l`
    ahead can move in any direction at once, as the axle cannot; the heading follows it, at a time
    constant of l / V.

    Args:
        heading: Present [rad].
        wanted: Direction in which the point is to move [rad].
        speed: V, with which it is to move [m/s].
        distance: l, from the axle forward to the point [m].

    Raises:
        ConfigError: If the distance is not above zero.
    """
    require_positive("distance", distance)
    error = wanted - heading
    return Twist2D(math.cos(error) * speed, 0.0, math.sin(error) * speed / distance)


def within_limits(twist: Twist2D, max_speed: float, max_yaw_rate: float) -> Twist2D:
    """The same path, slower: scaled as a whole until neither limit is exceeded.

    Args:
        twist: Body twist.
        max_speed: Of the translation [m/s].
        max_yaw_rate: [rad/s].
    """
    load = max(math.hypot(twist.vx, twist.vy) / max_speed, abs(twist.omega) / max_yaw_rate)
    return twist * (1.0 / load) if load > 1.0 else twist
