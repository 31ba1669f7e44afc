"""How far off one step is: the noise of its readings, and the faults of the description itself."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from trundle.odometry.covariance import ZERO, Six, outer, weighted_sum
from trundle.robot import Encoder, Kinematics, Noise
from trundle.robot.observability import length_scale
from trundle.robot.rows import contact
from trundle.robot.solver import Gains
from trundle.robot.wheel import WheelKind

__all__ = ["ErrorModel"]

Number = Any
Vector = Sequence[Number]


class ErrorModel:
    """What `Noise` means for a step. Works on floats, or on arrays with `trig` their namespace.

    Independent from step to step, and growing with distance (the gyro's with time), so that the sum
    over a path does not depend on how finely it was sampled:

    - rolling of each measured wheel: `wheel_distance^2 * distance` [m^2]
    - sideways motion that the wheels deny: `lateral_slip^2 * distance` [m^2]
    - sideways rows of steered wheels: `lateral_slip^2 * distance`, and `steering^2 * distance * 1 m`
      for an angle that is off by `steering`, anew from one metre to the next
    - gyro: `gyro^2 * time` [rad^2]

    Bounded, because counts are cumulative: a reading is anywhere within its tick, at the baseline
    (where it is a wrong heading that stays), at the present one, and in between at random.

    The same all along, so that it adds up and never averages out (Schmidt's consider terms): every
    wheel's radius, off by the fraction `wheel_radius`; and all distances between wheels together, off
    by the fraction `track_width`, which turns every turn into another and leaves the rest as it is.
    """

    def __init__(self, drive: Kinematics, noise: Noise, encoders: Mapping[str, Encoder]) -> None:
        self._drive = drive
        self._noise = noise
        wheels = [drive.wheel(name) for name in drive.measured_names]
        self._radii = [wheel.radius for wheel in wheels]
        ticks = [encoders[w.name].radians_per_tick if w.name in encoders else 0.0 for w in wheels]
        self._ticks = [abs(tick) * w.radius for tick, w in zip(ticks, wheels, strict=True)]
        speaking = [(w.x, w.y) for w in drive.wheels if w.kind is not WheelKind.CASTER]
        *_, self._lever = length_scale(speaking)
        self._contacts = [contact(drive.wheel(name)) for name in drive.steered_names]
        self._sideways = noise.lateral_slip**2 + noise.steering**2
        self._constant: dict[bool, tuple[Gains, list[Six], Six]] = {}

    @property
    def drifts(self) -> int:
        """How many numbers of the description are uncertain."""
        return (len(self._radii) if self._noise.wheel_radius else 0) + (1 if self._noise.track_width else 0)

    @property
    def ticks(self) -> bool:
        """Whether wheels are read in ticks of known size."""
        return any(self._ticks)

    def gains(self, steering: Vector, gyro: bool, trig: Any = math) -> tuple[Gains, list[Six], Six]:
        """Gains at these angles; the independent terms, each to be weighted; and what one tick makes."""
        if not self._drive.steered_names and gyro in self._constant:
            return self._constant[gyro]
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
        # Evenly spread over a tick.
        quantum = ZERO
        if self.ticks:
            halves = [
                outer(c, tick * tick / 12.0) for c, tick in zip(gains.rolling, self._ticks, strict=True)
            ]
            quantum = weighted_sum([1.0] * len(halves), halves)
        found = (gains, terms, quantum)
        if not self._drive.steered_names:
            self._constant[gyro] = found
        return found

    def noise(
        self,
        gains: tuple[Gains, list[Six], Six],
        turned: Vector,
        step: Vector,
        seconds: Number,
        gyro: bool,
        trig: Any = math,
    ) -> Six:
        """Covariance of the displacement, of what is independent from step to step.

        Args:
            gains: From `gains`, at the mid-step steering angles.
            turned: What each measured wheel turned [rad].
            step: The displacement (x, y, theta) that came of it.
            seconds: Duration of the step [s].
            gyro: Whether the gyro took part.
            trig: `math`, or the arrays' namespace.
        """
        _, terms, quantum = gains
        weights = [abs(angle) for angle in turned]
        if len(weights) < len(terms):
            weights += self._other_weights(step, seconds, gyro, trig, len(terms) - len(weights))
        if trig is math or self._drive.steered_names:
            xx, xy, yy, xt, yt, tt = weighted_sum(weights, terms)
        else:
            matrix = trig.asarray(terms).T
            xx, xy, yy, xt, yt, tt = trig.tensordot(matrix, trig.stack(weights), axes=1)
        wrong = quantum[5]  # the heading along which the step was walked
        dx, dy, _ = step
        return (xx + wrong * dy * dy, xy - wrong * dx * dy, yy + wrong * dx * dx, xt, yt, tt)

    def drift(
        self, gains: tuple[Gains, list[Six], Six], turned: Vector, step: Vector, turn: Number | None
    ) -> list[Vector]:
        """What one sigma of each uncertain number of the description changes in the displacement."""
        found: list[Vector] = []
        scale = self._noise.wheel_radius
        if scale:
            for column, radius, angle in zip(gains[0].rolling, self._radii, turned, strict=True):
                distance = scale * radius * angle
                x, y, theta = column
                found.append((x * distance, y * distance, theta * distance))
        if self._noise.track_width:
            by_wheels = step[2] if turn is None else step[2] - gains[0].gyro[0][2] * turn
            found.append([0.0 * step[2], 0.0 * step[2], -self._noise.track_width * by_wheels])
        return found

    def _other_weights(
        self, step: Vector, seconds: Number, gyro: bool, trig: Any, count: int
    ) -> list[Number]:
        """Distances of the steered contacts and of the body, and the time for the gyro."""
        weights: list[Number] = []
        dx, dy, angle = step
        if self._sideways:
            for (xx, xy, xt), (yx, yy, yt) in self._contacts:
                ux, uy = xx * dx + xy * dy + xt * angle, yx * dx + yy * dy + yt * angle
                weights.append(trig.sqrt(ux * ux + uy * uy))
        body = count - len(weights) - (1 if gyro else 0)
        if body:
            weights += [trig.sqrt(dx * dx + dy * dy) + self._lever * abs(angle)] * body
        if gyro:
            weights.append(seconds)
        return weights
