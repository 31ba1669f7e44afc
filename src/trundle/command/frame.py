"""The same motion seen from elsewhere: field or robot axes, another centre of rotation, a period of time."""

from __future__ import annotations

import math

from trundle.errors import InputError
from trundle.geometry import Twist2D

__all__ = ["about", "discretize", "to_field", "to_robot"]


def to_robot(twist: Twist2D, heading: float) -> Twist2D:
    """A twist given along the field's axes, in the robot's axes ("field-relative driving").

    Args:
        twist: Velocity along the field's x and y [m/s], and the yaw rate.
        heading: Of the robot in the field [rad].
    """
    c, s = math.cos(heading), math.sin(heading)
    return Twist2D(c * twist.vx + s * twist.vy, c * twist.vy - s * twist.vx, twist.omega)


def to_field(twist: Twist2D, heading: float) -> Twist2D:
    """A body twist along the field's axes: `v_gx = v_x cos - v_y sin`, `v_gy = v_x sin + v_y cos`.

    Args:
        twist: Body twist.
        heading: Of the robot in the field [rad].
    """
    return to_robot(twist, -heading)


def about(twist: Twist2D, x: float, y: float) -> Twist2D:
    """The body twist of the reference point, from the wanted twist of another point of the body.

    With a pure yaw rate the robot turns about that point ("centre of rotation").

    Args:
        twist: Wanted velocity of the point (x, y), in the robot's axes, and the yaw rate.
        x: Of the point in the body [m].
        y: The same.
    """
    return twist.at(-x, -y)


def discretize(twist: Twist2D, period: float) -> Twist2D:
    """The constant body twist that, held for a period, lands where `twist` means to.

    `twist` means a displacement by `(vx, vy) * period` along the axes that the robot has now, while it
    turns by `omega * period`. Holding it makes the robot drift off sideways as its axes turn with it.
    Only drives that move sideways freely can do otherwise.

    Args:
        twist: Wanted velocity along the robot's present axes.
        period: How long it will be held [s].

    Raises:
        InputError: If it turns by a whole turn or more in a period: no arc does that and lands apart.
    """
    half = 0.5 * twist.omega * period
    if not abs(half) < math.pi:
        raise InputError(f"omega * period = {2.0 * half:g} rad, must be less than a whole turn")
    # SE(2) log (Sola et al. 2018, eq. 157), over the period; its heading is not wrapped here.
    along = half / math.tan(half) if half else 1.0
    return Twist2D(along * twist.vx + half * twist.vy, along * twist.vy - half * twist.vx, twist.omega)
