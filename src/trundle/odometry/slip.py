"""Slip: wheels that no single motion of the body can explain.

The rows of a drive that do not turn with the steering are constant, so what they summed up over a
window obeys them however the twist varied meanwhile. What is left of the sums after the best twist,
measured against the noise of the readings, is chi-square where nothing slips.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from operator import add, sub
from typing import Any

from trundle.geometry.angle import excess, sinc
from trundle.odometry.covariance import Six, mapped, outer, weighted_sum
from trundle.robot import Kinematics, Noise
from trundle.robot.least_squares import minimise
from trundle.robot.rows import Row, contact, rolling
from trundle.robot.solver import Gains

__all__ = ["PER_METRE", "SlipMonitor", "slip_monitor", "threshold"]

Number = Any
Vector = Sequence[Number]

PER_METRE = 0.625
"""Windows per metre of the wheel that rolls furthest. Over 1.6 m a tenth of slip is 6.3 sigma of a
mecanum wheel that is good to 1 %."""
TAIL = 3.0902
"""Standard normal quantile of one false alarm in a thousand windows."""
FLOOR = 1e-8
"""Variance that every row has [m^2]: a tenth of a millimetre."""


def threshold(freedom: int) -> float:
    """Chi-square that one window in a thousand exceeds where nothing slips.

    Source:
        Wilson and Hilferty 1931; within 3 % and on the safe side.
    """
    ninth = 2.0 / (9.0 * freedom)
    return freedom * (1.0 - ninth + TAIL * math.sqrt(ninth)) ** 3


def slip_monitor(drive: Kinematics, noise: Noise, ticks: Sequence[float]) -> SlipMonitor | None:
    """A monitor for this drive; None where its readings cannot contradict each other.

    Args:
        drive: What measures.
        noise: Without any of the wheels nothing can be told from it.
        ticks: Per measured wheel, what one count is [m], or 0.
    """
    monitor = SlipMonitor(drive, noise, ticks)
    return monitor if noise.wheel_distance and monitor.freedom(True) > 0 else None


class SlipMonitor:
    """Sums of what the rows read, and their judgement once per window.

    Angles of unmeasured steered wheels take no part: their rows turn under the window.

    Attributes:
        sums: Since the beginning: rolled by the furthest wheel, by each wheel (forth and back
            alike), each row's value [m], the gyro's turn [rad] and its time [s], the displacement.
        mark: `sums` where the present window began.
        window: Its number.
        gyro: Whether the gyro takes part in it.
        moved: What the last window added to `sums`.
        streak: How many windows in a row did not add up.
        slipping: Wheels of which any one would explain the last window that did not add up.
    """

    def __init__(self, drive: Kinematics, noise: Noise, ticks: Sequence[float]) -> None:
        wheels = [drive.wheel(name) for name in drive.measured_names]
        steered = list(drive.steered_names)
        self._noise = noise
        self._names = drive.measured_names
        self._radii = [wheel.radius for wheel in wheels]
        self._ticks = list(ticks)
        self._aims = [
            (steered.index(wheel.name), wheel.heading) if wheel.name in steered else None for wheel in wheels
        ]
        self._rows: list[Row] = []
        self._wheel_of_row: list[int] = []
        for index, (wheel, aim) in enumerate(zip(wheels, self._aims, strict=True)):
            rows = (rolling(wheel),) if aim is None else contact(wheel)
            self._rows += rows
            self._wheel_of_row += [index] * len(rows)
        self._constraints = drive.constraints
        self._declares_gyro = drive.gyro
        # Exact constraints leave the motions that they allow; soft ones are rows among the others.
        soft = noise.lateral_slip > 0.0
        self._free = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)) if soft else drive.free_motions
        self._plain = not any(self._aims)
        width = 1 + len(wheels) + len(self._rows) + 5
        self.sums = [0.0] * width
        self.mark = self.moved = self.sums
        self.window = 0
        self.gyro = drive.gyro
        self.streak = 0
        self.slipping: tuple[str, ...] = ()

    def freedom(self, gyro: bool) -> int:
        """How many of the rows could be spared."""
        return len(self._rows) + (gyro and self._declares_gyro) + len(self._constraints) - 3

    def parts(
        self, turned: Vector, steering: Vector, turn: Number, seconds: Number, step: Vector, trig: Any = math
    ) -> list[Number]:
        """What a step adds to `sums`; floats, or arrays with `trig` their namespace."""
        rolled = [radius * angle for radius, angle in zip(self._radii, turned, strict=True)]
        distances = [abs(way) for way in rolled]
        furthest = max(distances) if trig is math else reduce(trig.maximum, distances)
        values = rolled if self._plain else self._values(rolled, steering, trig)
        by_gyro = (0.0 * furthest, 0.0 * furthest) if turn is None else (turn, seconds)
        return [furthest, *distances, *values, *by_gyro, *step]

    def _values(self, rolled: Vector, steering: Vector, trig: Any) -> list[Number]:
        values: list[Number] = []
        for way, aim in zip(rolled, self._aims, strict=True):
            if aim is None:
                values.append(way)
            else:
                toward = aim[1] + steering[aim[0]]
                values += (way * trig.cos(toward), way * trig.sin(toward))
        return values

    def step(
        self, turned: Vector, steering: Vector, turn: float | None, seconds: float, step: Vector
    ) -> bool:
        """Take one step; whether with it the window is full.

        Args:
            turned: By each wheel [rad].
            steering: Mid-step angles [rad].
            turn: What the gyro turned [rad], or None.
            seconds: How long the step took.
            step: The displacement (x, y, theta) that came of it.
        """
        if (turn is not None) is not self.gyro:
            self.gyro = turn is not None
            self.restart()
        self.sums = list(map(add, self.sums, self.parts(turned, steering, turn, seconds, step)))
        return int(self.sums[0] * PER_METRE) != self.window

    def restart(self) -> None:
        """Begin a window here: what was before has no connection with what comes."""
        self.mark = self.sums
        self.window = int(self.sums[0] * PER_METRE)

    def close(self, doubt: float) -> float:
        """Chi-square of the full window over its degrees of freedom where it is too large, else 0.

        Args:
            doubt: How far the gyro's bias may be off [rad/s].
        """
        self.moved = moved = list(map(sub, self.sums, self.mark))
        self.restart()
        freedom = self.freedom(self.gyro)
        streak, self.streak, self.slipping = self.streak, 0, ()
        if freedom < 1:
            return 0.0
        total = self.chi_square(moved, doubt, math)
        if total <= threshold(freedom):
            return 0.0
        self.streak = streak + 1
        self.slipping = self._culprits(moved, doubt, freedom)
        return float(total) / freedom

    def chi_square(self, moved: Vector, doubt: Number, trig: Any, without: int = -1) -> Number:
        """How badly the rows contradict each other over a window.

        Args:
            moved: What the window added to `sums`; floats or arrays.
            doubt: See `close`.
            trig: `math`, or the arrays' namespace.
            without: A wheel whose rows do not count.
        """
        count = len(self._names)
        values, variances = moved[1 + count : -5], self._variances(moved)
        rows = [
            (row, value / trig.sqrt(variance))
            for row, value, variance in zip(self._rows, values, variances, strict=True)
        ]
        scales = [1.0 / trig.sqrt(variance) for variance in variances]
        kept = [k for k, wheel in enumerate(self._wheel_of_row) if wheel != without]
        table = [(rows[k][0], rows[k][1], scales[k]) for k in kept]
        noise = self._noise
        if self.gyro:
            turn, seconds = moved[-5], moved[-4]
            variance = noise.gyro**2 * seconds + (doubt * seconds) ** 2 + (noise.track_width * turn) ** 2
            scale = 1.0 / trig.sqrt(variance + FLOOR)
            table.append(((0.0, 0.0, 1.0), turn * scale, scale))
        if noise.lateral_slip:
            scale = 1.0 / trig.sqrt(noise.lateral_slip**2 * moved[0] + FLOOR)
            table += [(row, 0.0 * scale, scale) for row in self._constraints]
        columns = [
            [scale * sum(a * b for a, b in zip(row, motion, strict=True)) for row, _, scale in table]
            for motion in self._free
        ]
        rest = minimise(columns, [value for _, value, _ in table]).remainder
        return sum(part * part for part in rest)

    def growth(self, factor: float, gains: Gains) -> Six:
        """What the last window adds to the covariance: the noise of its wheels, `factor` times.

        What slips goes on slipping the same way: over n windows in a row the error, and not its
        variance, grows like n.

        Args:
            factor: Chi-square over its degrees of freedom, by which variances that were too small are
                scaled up (Birge 1932), less the one that is in the covariance already.
            gains: Of the drive at the window's end.
        """
        factor *= 2 * self.streak - 1
        by_wheel = dict(zip(self._wheel_of_row, self._variances(self.moved), strict=True))
        weights = [factor * variance for variance in by_wheel.values()]
        terms = [outer(column) for column in gains.rolling]
        for index, aim in enumerate(self._aims):
            if aim is not None:
                weights.append(factor * by_wheel[index])
                terms.append(outer(gains.sideways[aim[0]]))
        step = self.moved[-3:]
        half = 0.5 * step[2]
        turn = (math.sin(half), math.cos(half))
        return mapped(weighted_sum(weights, terms), step, turn, sinc(half), excess(step[2]))

    def _variances(self, moved: Vector) -> list[Number]:
        """Of each row's sum [m^2]: rolling, both ends of the counting, a wrong radius."""
        noise, count = self._noise, len(self._names)
        distances, values = moved[1 : 1 + count], moved[1 + count : -5]
        net = [0.0 * way for way in distances]
        for wheel, value in zip(self._wheel_of_row, values, strict=True):
            net[wheel] = net[wheel] + value * value
        # Of a steered wheel both components are as uncertain as the worse of its two rows.
        across = noise.lateral_slip**2 + noise.steering**2
        along = noise.wheel_distance**2
        per_metre = [along if aim is None else max(along, across) for aim in self._aims]
        each = [
            rate * way + tick * tick / 6.0 + FLOOR + noise.wheel_radius**2 * square
            for rate, way, tick, square in zip(per_metre, distances, self._ticks, net, strict=True)
        ]
        return [each[wheel] for wheel in self._wheel_of_row]

    def _culprits(self, moved: Vector, doubt: float, freedom: int) -> tuple[str, ...]:
        """Wheels without any one of which the rest agrees; all where none of them alone explains it."""
        found = []
        for index, name in enumerate(self._names):
            left = freedom - self._wheel_of_row.count(index)
            if left == 0 or (
                left > 0 and self.chi_square(moved, doubt, math, without=index) <= threshold(left)
            ):
                found.append(name)
        return tuple(found) or self._names
