"""Polynomial curves, re-measured by the distance along them."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right

import numpy as np
import numpy.typing as npt

from trundle.errors import PathError
from trundle.follow.curve import CurvePoint, project

__all__ = ["Spline"]

Floats = npt.NDArray[np.float64]

_PIECES = 1024  # of a whole spline: its distances are then good to about 1e-11 of its length
_SHARPEST = 1.0  # turn within one piece [rad]: beyond, it is a corner or a cusp
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


class Spline:
    """A smooth curve of polynomial pieces (x(u), y(u)), each over u from 0 to 1.

    The pieces are divided further until the parameter is nearly proportional to the distance on each;
    what is left of the relation is a cubic. Points lie on the polynomials exactly.

    Args:
        coefficients: Of ascending powers of u, shape (pieces, 2, degree + 1) [m]. Each piece must begin
            where, and as, the one before it ends.

    Raises:
        PathError: If a number is not finite, the curve stands still, or it turns on the spot (a corner
            or cusp): never is a curvature infinite or NaN.
    """

    __slots__ = ("_coefficients", "_courses", "_distances", "_knots", "_slopes", "_stride")

    def __init__(self, coefficients: Floats) -> None:
        if not np.isfinite(coefficients).all():
            raise PathError("a spline with a number that is not finite")
        pieces = _divided(coefficients)
        rates = _derivative(pieces)
        u = 0.5 * (_NODES + 1.0)
        with np.errstate(over="ignore", invalid="ignore"):
            speeds = np.hypot(*(_values(rates[:, axis], u) for axis in (0, 1)))
            lengths = 0.5 * (speeds @ _WEIGHTS)
        begin, end = rates[:, :, 0], rates.sum(axis=-1)
        knots = np.concatenate([pieces[:, :, 0], pieces[-1:].sum(axis=-1)])
        distances = np.concatenate([[0.0], np.cumsum(lengths)])
        # Slopes du/d(share of distance) at both ends; within (0, 3) the cubic is monotone (Fritsch, Carlson).
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = np.stack([lengths / np.hypot(*begin.T), lengths / np.hypot(*end.T)], axis=-1)
        directions = np.concatenate([begin, end[-1:]])
        courses = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
        turns = np.abs(np.diff(courses))
        sharp = ~((slopes < 3.0).all(axis=-1) & (turns < _SHARPEST) & (lengths > 0.0))
        if sharp.any():
            k = int(np.argmax(sharp))
            raise PathError(
                f"a spline stands still or turns on the spot near ({knots[k, 0]:g}, {knots[k, 1]:g}) m, "
                f"{distances[k]:g} m along it (a corner or cusp): end it there, and let the robot stop"
            )
        self._stride = pieces.shape[-1]
        self._coefficients = array("d", pieces.tobytes())
        self._distances = array("d", distances.tobytes())
        self._slopes = array("d", slopes.tobytes())
        self._courses = array("d", courses.tobytes())
        self._knots = knots

    @property
    def length(self) -> float:
        """From end to end [m]."""
        return self._distances[-1]

    def at(self, distance: float) -> CurvePoint:
        """The point after a distance from the beginning [m]."""
        k = min(max(bisect_right(self._distances, distance) - 1, 0), len(self._distances) - 2)
        begin = self._distances[k]
        share = (distance - begin) / (self._distances[k + 1] - begin)
        m0, m1 = self._slopes[2 * k], self._slopes[2 * k + 1]
        u = share * (m0 + share * (3.0 - 2.0 * m0 - m1 + share * (m0 + m1 - 2.0)))
        width = self._stride
        row = self._coefficients[2 * k * width : 2 * (k + 1) * width]
        x, x1, x2, x3 = _taylor(row[:width], u)
        y, y1, y2, y3 = _taylor(row[width:], u)
        square = x1 * x1 + y1 * y1
        cross = x1 * y2 - y1 * x2
        curvature = cross / (square * math.sqrt(square))
        change = ((x1 * y3 - y1 * x3) * square - 3.0 * cross * (x1 * x2 + y1 * y2)) / square**3
        course = self._courses[k]
        turned = math.remainder(math.atan2(y1, x1) - course, math.tau)
        return CurvePoint(x, y, course + turned, curvature, change)

    def nearest(self, x: float, y: float) -> float:
        """The distance along the spline [m] of the point that is nearest to (x, y)."""
        k = int(np.argmin(np.hypot(self._knots[:, 0] - x, self._knots[:, 1] - y)))
        guess = self._distances[k]
        last = len(self._distances) - 1
        window = max(guess - self._distances[max(k - 1, 0)], self._distances[min(k + 1, last)] - guess)
        return project(self, x, y, guess, window)


def _divided(coefficients: Floats) -> Floats:
    """The same curve in more pieces: p((k + u) / n), expanded in powers of u."""
    count, _, width = coefficients.shape
    n = max(1, math.ceil(_PIECES / count))
    shift = np.array(
        [
            [
                [math.comb(i, j) * k ** (i - j) / n**i if i >= j else 0.0 for i in range(width)]
                for j in range(width)
            ]
            for k in range(n)
        ]
    )
    return np.ascontiguousarray(np.einsum("kji,pai->pkaj", shift, coefficients).reshape(-1, 2, width))


def _derivative(coefficients: Floats) -> Floats:
    powers: Floats = coefficients[..., 1:] * np.arange(1.0, coefficients.shape[-1])
    return powers


def _values(coefficients: Floats, u: Floats) -> Floats:
    """Polynomials, shape (pieces, powers), at some u: shape (pieces, len(u))."""
    value = np.zeros((len(coefficients), len(u)))
    for column in coefficients.T[::-1]:
        value = value * u + column[:, None]
    return value


def _taylor(coefficients: array[float], u: float) -> tuple[float, float, float, float]:
    """Value and first three derivatives of a polynomial, by Horner's scheme."""
    d0 = d1 = d2 = d3 = 0.0
    for coefficient in reversed(coefficients):
        d3 = d3 * u + d2
        d2 = d2 * u + d1
        d1 = d1 * u + d0
        d0 = d0 * u + coefficient
    return d0, d1, 2.0 * d2, 6.0 * d3
