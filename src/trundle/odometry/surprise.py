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
        off, excess = self._off(step, before, seconds, seconds_before)
        return off, excess > 0.0

    def _off(
        self, step: Vector, before: Vector, seconds: Number, seconds_before: Number
    ) -> tuple[Vector, Number]:
        """How far a step is from the one before carried on, and by how much too far, in squares [m^2]."""
        ratio = seconds / seconds_before
        x, y, turn = (now - ratio * then for now, then in zip(step, before, strict=True))
        # Under a constant acceleration a the two differ by a h1 (h0 + h1) / 2; readings by a tick each.
        slack = 0.5 * self._acceleration * seconds * (seconds_before + seconds) + (1.0 + ratio) * self._tick
        way = self._lever * turn
        return (x, y, turn), x * x + y * y + way * way - slack * slack

    def near(self, step: Vector, before: Vector, seconds: Number, seconds_before: Number) -> Number:
        """Whether a step is what an earlier one, carried on, can become; False where there is none (NaN)."""
        return self._off(step, before, seconds, seconds_before)[1] <= 0.0

    def taken_back(self, step: Vector, past: Sequence[Vector]) -> Number:
        """Whether this step and the last one together are what the one before, carried on, can become.

        So it is after a glitch of a counter that counts on; not after a jump that is there to stay.

        Args:
            step: x, y, theta, seconds.
            past: The steps before it, latest first, alike.
        """
        both = [now + then for now, then in zip(step, past[0], strict=True)]
        return self.near(both[:3], past[1][:3], both[3], past[1][3])

    def resumed(self, step: Vector, past: Sequence[Vector]) -> Number:
        """Whether it goes on as before a surprise: like the last step but one, or but two.

        Args:
            step: As for `taken_back`.
            past: As for `taken_back`.
        """
        one, two = (self.near(step[:3], then[:3], step[3], then[3]) for then in past[1:3])
        return one | two

    @staticmethod
    def by_gyro(off: Vector, gyro: Vector) -> tuple[Vector, Vector]:
        """The part of a surprise that a gyro's rate can have caused, which nothing takes back; and the rest.

        Args:
            off: What came as a surprise (x, y, theta).
            gyro: What the gyro's row makes of the body displacement, per radian.
        """
        x, y, turn = off
        share = turn / gyro[2]
        ux, uy = share * gyro[0], share * gyro[1]
        return (ux, uy, turn), (x - ux, y - uy, 0.0 * turn)

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
