"""Wheels to twist: the forward half of the one equation (DESIGN.md section 1).

One set of measured rows `A xi = z` under exact constraints `C xi = 0`. The same code serves
floats (`trig` is `math`) and arrays of any array library (`trig` is its namespace).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul
from typing import Any, NamedTuple

from trundle.errors import Unobservable
from trundle.robot.least_squares import minimise, pseudo_inverse
from trundle.robot.observability import CONDITION_LIMIT
from trundle.robot.rows import Row
from trundle.robot.traced import nominal, surely

__all__ = ["Driving", "Gains", "Leaning", "Rolling", "Solver"]

Number = Any
Vector = Sequence[Number]

GYRO_SIGMA = 0.1
"""How far a gyro row is trusted against a rolling row: rad/s per m/s of wheel error.

Wheels are good to about 1 cm/s, a cheap gyro to 1 mrad/s. W must be fixed per drive, so this is a
convention and not a measurement; the covariance uses the real noise.
"""


class Rolling(NamedTuple):
    """A measured wheel that does not steer: `row . xi = radius * speed`."""

    row: Row
    speed: int
    radius: float


class Driving(NamedTuple):
    """A steered wheel whose rotation is measured.

    Its rolling and sideways rows, equally weighted, say the same as both components of its contact
    velocity: constant rows, with the angle on the right-hand side.
    """

    rows: tuple[Row, Row]
    speed: int
    radius: float
    angle: int
    heading: float


class Leaning(NamedTuple):
    """A steered wheel whose rotation is not measured: only its sideways row, which turns with it."""

    rows: tuple[Row, Row]
    angle: int
    heading: float


class Gains(NamedTuple):
    """How errors of the single rows become errors of the twist: columns (vx, vy, omega).

    Attributes:
        rolling: Per measured wheel, for an error of its rolling speed [m/s].
        sideways: Per steered wheel, for an error of its sideways speed [m/s].
        slip: Per independent constraint, for motion that it denies [m/s].
        gyro: For an error of the yaw rate, or empty.
    """

    rolling: list[Vector]
    sideways: list[Vector]
    slip: list[Vector]
    gyro: list[Vector]


class Solver:
    """Least squares for one fixed set of rows."""

    def __init__(
        self,
        *,
        rolling: Sequence[Rolling],
        driving: Sequence[Driving],
        leaning: Sequence[Leaning],
        gyro: bool,
        constraints: Sequence[Row],
        null: Sequence[Vector],
        scale: float,
    ) -> None:
        self.rolling = tuple(rolling)
        self.driving = tuple(driving)
        self.leaning = tuple(leaning)
        self.gyro = gyro
        self.constraints = tuple(constraints)
        self.null = null
        sizes = (1.0, 1.0, scale)
        # A column of A N is measured against the size of the body component that it stands for.
        largest = [
            max(abs(nominal(a)) * size for a, size in zip(column, sizes, strict=True)) for column in self.null
        ]
        self._least = [(size / CONDITION_LIMIT) ** 2 for size in largest]
        fixed = [entry.row for entry in self.rolling]
        fixed += [row for entry in self.driving for row in entry.rows]
        if gyro:
            fixed.append((0.0, 0.0, 1.0 / GYRO_SIGMA))
        self._fixed = fixed
        self._fixed_columns = [[_dot(row, column) for row in fixed] for column in self.null]
        self._leaning_columns = [
            [(_dot(x, column), _dot(y, column)) for (x, y), _, _ in self.leaning] for column in self.null
        ]
        # pinv(C^T) is the transpose of C^+: its rows are the columns of C^+.
        self._denied = pseudo_inverse(self.constraints) if self.constraints else []
        self.matrix = None if self.leaning else self._expand(pseudo_inverse(self._fixed_columns))
        """K for the values of `values`, or None where it depends on the steering."""

    def values(self, speeds: Vector, steering: Vector, yaw_rate: Number, trig: Any) -> list[Number]:
        """The right-hand side z: rolling speeds, contact velocities, and the gyro's."""
        values = [radius * speeds[index] for _, index, radius in self.rolling]
        for _, index, radius, angle, heading in self.driving:
            toward = heading + steering[angle]
            speed = radius * speeds[index]
            values += (speed * trig.cos(toward), speed * trig.sin(toward))
        if self.gyro:
            values.append(yaw_rate / GYRO_SIGMA)
        return values

    def solve(self, speeds: Vector, steering: Vector, yaw_rate: Number, trig: Any) -> list[Number]:
        """The twist (vx, vy, omega) that explains the readings best.

        Raises:
            Unobservable: If at these steering angles the rows leave a motion open.
        """
        values = self.values(speeds, steering, yaw_rate, trig)
        if self.matrix is not None:
            return [_dot(row, values) for row in self.matrix]
        solution = minimise(self._columns(steering, trig), values + [0.0] * len(self.leaning))
        self._check(solution.squares, trig)
        return self._expand_vector(solution.unknowns)

    def gains(self, steering: Vector, trig: Any) -> Gains:
        """The columns of K and J at these steering angles."""
        matrix = self.matrix
        if matrix is None:
            matrix = self._expand(pseudo_inverse(self._columns(steering, trig)))
        columns = [list(column) for column in zip(*matrix, strict=True)]
        rolling: dict[int, Vector] = {}
        sideways: dict[int, Vector] = {}
        for position, entry in enumerate(self.rolling):
            rolling[entry.speed] = columns[position]
        for k, driven in enumerate(self.driving):
            first = len(self.rolling) + 2 * k
            toward = driven.heading + steering[driven.angle]
            c, s = trig.cos(toward), trig.sin(toward)
            pair = list(zip(columns[first], columns[first + 1], strict=True))
            rolling[driven.speed] = [c * a + s * b for a, b in pair]
            sideways[driven.angle] = [c * b - s * a for a, b in pair]
        for k, lean in enumerate(self.leaning):
            sideways[lean.angle] = columns[len(self._fixed) + k]
        return Gains(
            rolling=[rolling[index] for index in sorted(rolling)],
            sideways=[sideways[index] for index in sorted(sideways)],
            slip=self._slip_gains(matrix, steering, trig),
            gyro=[[a / GYRO_SIGMA for a in columns[len(self._fixed) - 1]]] if self.gyro else [],
        )

    def residual(
        self, speeds: Vector, steering: Vector, yaw_rate: Number, trig: Any, lateral_slip: float
    ) -> list[Number]:
        """What the best twist leaves unexplained [m/s, rad/s], each row `z - A xi`.

        Order: rolling rows, sideways rows of steered wheels, constraints, gyro.
        """
        rows = [*self._fixed, *self._leaning_rows(steering, trig)]
        values = self.values(speeds, steering, yaw_rate, trig) + [0.0] * len(self.leaning)
        if lateral_slip > 0.0:
            soft = [tuple(a / lateral_slip for a in row) for row in self.constraints]
            columns = [list(column) for column in zip(*rows, *soft, strict=True)]
            rest = minimise(columns, values + [0.0] * len(soft)).remainder
            broken = [a * lateral_slip for a in rest[len(rows) :]]
        else:
            twist = self.solve(speeds, steering, yaw_rate, trig)
            rest = [value - _dot(row, twist) for row, value in zip(rows, values, strict=True)]
            broken = [0.0] * len(self.constraints)
        return self._unweighted(rest, broken, steering, trig)

    def _unweighted(
        self, rest: list[Number], broken: list[Number], steering: Vector, trig: Any
    ) -> list[Number]:
        rolling = {entry.speed: rest[k] for k, entry in enumerate(self.rolling)}
        sideways: dict[int, Number] = {}
        for k, driven in enumerate(self.driving):
            first = len(self.rolling) + 2 * k
            toward = driven.heading + steering[driven.angle]
            c, s = trig.cos(toward), trig.sin(toward)
            rolling[driven.speed] = c * rest[first] + s * rest[first + 1]
            sideways[driven.angle] = c * rest[first + 1] - s * rest[first]
        for k, lean in enumerate(self.leaning):
            sideways[lean.angle] = rest[len(self._fixed) + k]
        gyro = [rest[len(self._fixed) - 1] * GYRO_SIGMA] if self.gyro else []
        return [
            *(rolling[index] for index in sorted(rolling)),
            *(sideways[index] for index in sorted(sideways)),
            *broken,
            *gyro,
        ]

    def _leaning_rows(self, steering: Vector, trig: Any) -> list[list[Number]]:
        rows = []
        for (x, y), angle, heading in self.leaning:
            toward = heading + steering[angle]
            c, s = trig.cos(toward), trig.sin(toward)
            rows.append([c * b - s * a for a, b in zip(x, y, strict=True)])
        return rows

    def _columns(self, steering: Vector, trig: Any) -> list[list[Number]]:
        """A N at these steering angles."""
        toward = [heading + steering[angle] for _, angle, heading in self.leaning]
        turned = [(trig.cos(angle), trig.sin(angle)) for angle in toward]
        return [
            fixed + [c * b - s * a for (c, s), (a, b) in zip(turned, pairs, strict=True)]
            for fixed, pairs in zip(self._fixed_columns, self._leaning_columns, strict=True)
        ]

    def _slip_gains(self, matrix: Sequence[Vector], steering: Vector, trig: Any) -> list[Vector]:
        """Columns of J = (I - K A) C^+."""
        if not self.constraints:
            return []
        rows = [*self._fixed, *self._leaning_rows(steering, trig)]
        gains: list[Vector] = []
        for column in self._denied:
            seen = [_dot(row, column) for row in rows]
            gains.append([a - _dot(gain, seen) for a, gain in zip(column, matrix, strict=True)])
        return gains

    def _check(self, squares: Vector, trig: Any) -> None:
        for square, least in zip(squares, self._least, strict=True):
            low = square < least
            if surely(low if trig is math else trig.any(low)):
                raise Unobservable(
                    "at these steering angles the measured wheels do not determine the motion "
                    "(a wheel steered square to its way of rolling says nothing about it)"
                )

    def _expand(self, reduced: list[list[Number]]) -> list[list[Number]]:
        """N times a matrix given as rows."""
        columns = list(zip(*reduced, strict=True))
        return [[_dot(weights, column) for column in columns] for weights in zip(*self.null, strict=True)]

    def _expand_vector(self, unknowns: Vector) -> list[Number]:
        return [sum([column[i] * u for column, u in zip(self.null, unknowns, strict=True)]) for i in range(3)]


def _dot(row: Vector, vector: Vector) -> Number:
    return sum(map(mul, row, vector))
