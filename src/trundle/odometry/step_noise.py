"""How uncertain the displacement of one step is: `K R K^T + J S J^T` of DESIGN.md section 1, filled in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trundle.odometry.covariance import Six, outer, weighted_sum
from trundle.robot import Kinematics, Noise
from trundle.robot.observability import length_scale
from trundle.robot.rows import contact
from trundle.robot.wheel import WheelKind

__all__ = ["StepNoise"]

Number = Any


class StepNoise:
    """Noise of a step, from what the wheels turned in it. Floats, or arrays with `trig` their namespace.

    All of it grows with distance (the gyro's with time), so that the sum over a path does not
    depend on how finely it was sampled:

    - rolling of each measured wheel: `wheel_distance^2 * distance` [m^2]
    - sideways motion that the wheels deny: `lateral_slip^2 * distance` [m^2]
    - sideways rows of steered wheels: `lateral_slip^2 * distance`, and `steering^2 * distance * 1 m`
      for an angle that is off by `steering`, anew from one metre to the next
    - gyro: `gyro^2 * time` [rad^2]
    """

    def __init__(self, drive: Kinematics, noise: Noise) -> None:
        self._drive = drive
        self._noise = noise
        self._radii = [drive.wheel(name).radius for name in drive.measured_names]
        *_, self._lever = length_scale([(w.x, w.y) for w in drive.wheels if w.kind is not WheelKind.CASTER])
        self._contacts = [contact(drive.wheel(name)) for name in drive.steered_names]
        self._sideways = noise.lateral_slip**2 + noise.steering**2
        self._constant: dict[bool, list[Six]] = {}

    def __call__(
        self,
        turned: Sequence[Number],
        steering: Sequence[Number],
        step: Sequence[Number],
        seconds: Number,
        gyro: bool,
        trig: Any = math,
    ) -> Six:
        """Covariance of the displacement.

        Args:
            turned: What each measured wheel turned [rad].
            steering: Mid-step steering angles [rad].
            step: The displacement (x, y, theta) that came of it.
            seconds: Duration of the step [s].
            gyro: Whether the gyro took part.
            trig: `math`, or the arrays' namespace.
        """
        if self._drive.steered_names:
            terms = self._terms(steering, trig, gyro)
        else:
            if gyro not in self._constant:
                self._constant[gyro] = self._terms((), math, gyro)
            terms = self._constant[gyro]
        weights = [abs(angle) for angle in turned]
        if len(weights) < len(terms):
            weights += self._other_weights(step, seconds, gyro, trig, len(terms) - len(weights))
        return weighted_sum(weights, terms)

    def _terms(self, steering: Sequence[Number], trig: Any, gyro: bool) -> list[Six]:
        gains = self._drive.gains(steering, trig, gyro=gyro)
        noise = self._noise
        terms = [
            outer(column, noise.wheel_distance**2 * radius)
            for column, radius in zip(gains.rolling, self._radii, strict=True)
        ]
        if self._sideways:
            terms += [outer(column, self._sideways) for column in gains.sideways]
        if noise.lateral_slip:
            terms += [outer(column, noise.lateral_slip**2) for column in gains.slip]
        if gyro:
            terms += [outer(column, noise.gyro**2) for column in gains.gyro]
        return terms

    def _other_weights(
        self, step: Sequence[Number], seconds: Number, gyro: bool, trig: Any, count: int
    ) -> list[Number]:
        """Distances of the steered contacts and of the body, and the time for the gyro."""
        weights: list[Number] = []
        if self._sideways:
            for x, y in self._contacts:
                ux = sum(a * b for a, b in zip(x, step, strict=True))
                uy = sum(a * b for a, b in zip(y, step, strict=True))
                weights.append(trig.sqrt(ux * ux + uy * uy))
        body = count - len(weights) - (1 if gyro else 0)
        if body:
            dx, dy, angle = step
            weights += [trig.sqrt(dx * dx + dy * dy) + self._lever * abs(angle)] * body
        if gyro:
            weights.append(seconds)
        return weights
