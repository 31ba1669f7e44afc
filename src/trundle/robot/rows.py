"""What one wheel states about the body twist (vx, vy, omega), as rows of coefficients.

Plain arithmetic on whatever numbers come in: floats, or traced scalars when somebody
differentiates through a drive. Source: DESIGN.md section 1; for Swedish wheels Campion, Bastin and
D'Andrea-Novel 1996, "Structural properties and classification of wheeled mobile robots".
"""

from __future__ import annotations

from trundle.robot.traced import trigonometry
from trundle.robot.wheel import Wheel, WheelKind

__all__ = ["Row", "along", "contact", "rolling", "sideways"]

Row = tuple[float, float, float]


def along(c: float, s: float, x: float, y: float) -> Row:
    """Row of the speed of the body's point (x, y) along the direction (c, s)."""
    return (c, s, x * s - y * c)


def contact(wheel: Wheel) -> tuple[Row, Row]:
    """Rows of the two components of the contact point's velocity, along x and along y."""
    return (1.0, 0.0, -wheel.y), (0.0, 1.0, wheel.x)


def rolling(wheel: Wheel) -> Row:
    """Row whose value is `radius * wheel speed`, for a wheel at steering angle zero."""
    trig = trigonometry(wheel.heading)
    c, s = trig.cos(wheel.heading), trig.sin(wheel.heading)
    row = along(c, s, wheel.x, wheel.y)
    if wheel.kind is not WheelKind.SWEDISH or wheel.free_direction is None:
        return row
    # The contact slides along f, so only the component along its normal g counts:
    # (g . v) / (g . d), which is d . v + cot(heading - f) n . v.
    slide = wheel.heading - wheel.free_direction
    slope = 1.0 / trigonometry(slide).tan(slide)
    a, b, turn = along(-s, c, wheel.x, wheel.y)
    return (row[0] + slope * a, row[1] + slope * b, row[2] + slope * turn)


def sideways(wheel: Wheel) -> Row:
    """Row of the contact's speed to the left of the wheel, at steering angle zero."""
    trig = trigonometry(wheel.heading)
    return along(-trig.sin(wheel.heading), trig.cos(wheel.heading), wheel.x, wheel.y)
