"""How fast a robot's wheels can possibly turn."""

from __future__ import annotations

import math
from collections.abc import Sequence

from trundle.robot import Robot
from trundle.robot.observability import length_scale
from trundle.robot.rows import Row, rolling
from trundle.robot.wheel import Wheel, WheelKind

__all__ = ["Plausibility"]

FACTOR = 1.5  # FAULTS.md S12
TICKS = 2.0
ANY_ROBOT = 15.0
"""Faster than this no wheel of a robot rolls [m/s]: the bound where a description gives no limits."""

ANY_TURN = 25.0
"""The same for a body that turns [rad/s]: with the factor, what cheap gyros can show at most."""


class Plausibility:
    """Bounds on what wheels turn in a time, from the limits of the description.

    Attributes:
        yaw_rate: Greatest yaw rate that a gyro is believed [rad/s].
        declared: Per measured wheel, its greatest speed by the declared limits [rad/s]; 0 without any.
        body_speed: Greatest speed [m/s] and yaw rate [rad/s] of the body as declared, else 0; the yaw rate
            else what its wheels make of that speed when it turns on the spot.
    """

    def __init__(self, robot: Robot) -> None:
        drive, limits = robot.measuring, robot.limits
        wheels = [drive.wheel(name) for name in drive.measured_names]
        speed = math.hypot(limits.max_speed or 0.0, limits.max_lateral_speed or 0.0)
        *_, lever = length_scale([(w.x, w.y) for w in drive.wheels if w.kind is not WheelKind.CASTER])
        self.body_speed = (speed, limits.max_yaw_rate or speed / lever)
        self.yaw_rate = FACTOR * (limits.max_yaw_rate or ANY_TURN)
        self.declared = []
        for wheel in wheels:
            fastest = limits.max_wheel_speed if robot.localizer is None else None
            if fastest is None and limits.max_speed is not None:
                lateral = limits.max_speed if limits.max_lateral_speed is None else limits.max_lateral_speed
                fastest = (
                    _fastest(wheel, limits.max_speed, lateral, limits.max_yaw_rate or 0.0) / wheel.radius
                )
            self.declared.append(fastest or 0.0)
        self._rates = [
            FACTOR * (fastest or ANY_ROBOT / wheel.radius)
            for fastest, wheel in zip(self.declared, wheels, strict=True)
        ]
        encoders = [robot.encoders.get(wheel.name) for wheel in wheels]
        self._slack = [TICKS * abs(e.radians_per_tick) if e is not None else 0.0 for e in encoders]

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Per measured wheel: greatest believable speed [rad/s], and the angle beyond it [rad]."""
        return list(zip(self._rates, self._slack, strict=True))

    def allows(self, turned: Sequence[float], seconds: float) -> bool:
        """Whether the wheels can have turned so far [rad] in that time [s]."""
        for angle, rate, slack in zip(turned, self._rates, self._slack, strict=True):
            if not abs(angle) <= rate * seconds + slack:  # nor NaN
                return False
        return True


def _fastest(wheel: Wheel, forward: float, lateral: float, yaw_rate: float) -> float:
    """Greatest rolling speed of a wheel [m/s] when the body is as fast as it may be."""
    if wheel.kind is WheelKind.STEERED:
        return math.hypot(forward, lateral) + yaw_rate * math.hypot(wheel.x, wheel.y)
    row: Row = rolling(wheel)
    return abs(row[0]) * forward + abs(row[1]) * lateral + abs(row[2]) * yaw_rate
