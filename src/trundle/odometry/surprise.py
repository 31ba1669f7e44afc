"""Steps that no body makes so soon after the one before: glitches too small to be refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trundle.odometry.covariance import Six, outer
from trundle.robot import Robot
from trundle.robot.observability import length_scale
from trundle.robot.wheel import WheelKind

__all__ = ["Surprise"]

Number = Any
Vector = Sequence[Number]

ANY_GRIP = 10.0
"""Harder than this no wheel pulls or brakes [m/s^2]: the bound where a description gives no limits."""
FACTOR = 1.5  # as for speeds, FAULTS.md S12


class Surprise:
    """What a step owes to its reading rather than to motion, if it is more than motion can explain (S13).

    A body goes on as it did, give or take what it can accelerate and what ticks hide. Floats or arrays.
    """

    def __init__(self, robot: Robot, ticks: Sequence[float]) -> None:
        """`ticks`: per measured wheel, what one count is [m], or 0."""
        drive, limits = robot.measuring, robot.limits
        speaking = [(wheel.x, wheel.y) for wheel in drive.wheels if wheel.kind is not WheelKind.CASTER]
        *_, self._lever = length_scale(speaking)
        declared = max(limits.max_acceleration or 0.0, limits.max_deceleration or 0.0)
        turning = self._lever * (limits.max_yaw_acceleration or 0.0)
        self._acceleration = FACTOR * math.hypot(declared, turning) if declared else ANY_GRIP
        self._tick = max(ticks)

    def of(
        self, step: Vector, before: Vector, seconds: Number, seconds_before: Number
    ) -> tuple[Vector, Number]:
        """How far a step is from the one before carried on, and whether that is too far.

        Args:
            step: Displacement (x, y, theta) as measured.
            before: That of the step before.
            seconds: Duration of the step.
            seconds_before: Duration of the step before.
        """
        ratio = seconds / seconds_before
        x, y, turn = (now - ratio * then for now, then in zip(step, before, strict=True))
        # Under a constant acceleration a the two differ by a h1 (h0 + h1) / 2; readings by a tick each.
        slack = 0.5 * self._acceleration * seconds * (seconds_before + seconds) + (1.0 + ratio) * self._tick
        way = self._lever * turn
        return (x, y, turn), x * x + y * y + way * way > slack * slack

    @staticmethod
    def on_pose(off: Vector, step: Vector) -> Six:
        """What the pose owes to it, until the counters take it back: a covariance of one sigma."""
        (x, y, turn), (dx, dy, angle) = off, step
        # The right Jacobian, to first order in the step.
        return outer((x - 0.5 * (dy * turn - angle * y), y - 0.5 * (angle * x - dx * turn), turn))

    @staticmethod
    def detour(noise: Six, doubt: Number, step: Vector) -> Six:
        """Noise of a step with what stays: there and back, it was walked along half a wrong heading.

        Args:
            noise: Covariance of the step.
            doubt: Variance of the heading by this step's surprise and by that of the step before [rad^2].
            step: The displacement (x, y, theta) as measured.
        """
        xx, xy, yy, xt, yt, tt = noise
        dx, dy, _ = step
        wx, wy = 0.25 * doubt * dx, 0.25 * doubt * dy
        return (xx + wy * dy, xy - wx * dy, yy + wx * dx, xt, yt, tt)
