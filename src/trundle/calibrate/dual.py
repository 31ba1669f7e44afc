"""Numbers that carry their derivatives: a drive that is made of them differentiates itself.

Forward mode, for many parameters and many steps at once. The drives' arithmetic asks nothing more of a
number than this (`robot/traced.py`), so that one equation also gives the exact Jacobians.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Dual", "DualMath", "seeds"]

Number = Any
Floats = npt.NDArray[np.float64]


class Dual:
    """A number, or an array of them, and its derivatives by each parameter.

    Attributes:
        value: Float, or shape (steps,).
        slopes: Derivatives, shape (parameters,) or (parameters, steps).
    """

    __slots__ = ("slopes", "value")
    __array_ufunc__ = None  # NumPy's arrays leave the arithmetic to this class

    def __init__(self, value: Number, slopes: Floats) -> None:
        self.value = value
        self.slopes = slopes

    def detach(self) -> Number:
        """The value alone, to decide by."""
        return self.value

    def __add__(self, other: Number) -> Dual:
        if isinstance(other, Dual):
            return Dual(self.value + other.value, _plus(self.slopes, other.slopes))
        return Dual(self.value + other, _times(self.slopes, np.ones_like(other)))

    __radd__ = __add__

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slopes)

    def __sub__(self, other: Number) -> Dual:
        return self.__add__(-other)

    def __rsub__(self, other: Number) -> Dual:
        return self.__neg__().__add__(other)

    def __mul__(self, other: Number) -> Dual:
        if isinstance(other, Dual):
            slopes = _plus(_times(self.slopes, other.value), _times(other.slopes, self.value))
            return Dual(self.value * other.value, slopes)
        return Dual(self.value * other, _times(self.slopes, other))

    __rmul__ = __mul__

    def __truediv__(self, other: Number) -> Dual:
        if isinstance(other, Dual):
            ratio = self.value / other.value
            slopes = _plus(_times(self.slopes, 1.0 / other.value), _times(other.slopes, -ratio / other.value))
            return Dual(ratio, slopes)
        return self.__mul__(1.0 / other)

    def __rtruediv__(self, other: Number) -> Dual:
        ratio = other / self.value
        return Dual(ratio, _times(self.slopes, -ratio / self.value))

    def __abs__(self) -> Dual:
        return Dual(abs(self.value), _times(self.slopes, np.sign(self.value)))

    def __lt__(self, other: Number) -> Any:
        return self.value < _value(other)

    def __gt__(self, other: Number) -> Any:
        return self.value > _value(other)

    def __le__(self, other: Number) -> Any:
        return self.value <= _value(other)

    def __ge__(self, other: Number) -> Any:
        return self.value >= _value(other)

    def __eq__(self, other: object) -> Any:
        return self.value == _value(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.slopes!r})"


class DualMath:
    """What drives take from `math`, for numbers of either kind."""

    @staticmethod
    def cos(angle: Number) -> Number:
        """Cosine."""
        if not isinstance(angle, Dual):
            return np.cos(angle)
        return Dual(np.cos(angle.value), _times(angle.slopes, -np.sin(angle.value)))

    @staticmethod
    def sin(angle: Number) -> Number:
        """Sine."""
        if not isinstance(angle, Dual):
            return np.sin(angle)
        return Dual(np.sin(angle.value), _times(angle.slopes, np.cos(angle.value)))

    @staticmethod
    def atan2(y: Number, x: Number) -> Number:
        """Angle of the point (x, y)."""
        if not isinstance(y, Dual) and not isinstance(x, Dual):
            return np.arctan2(y, x)
        square = _value(x) ** 2 + _value(y) ** 2
        slopes = _plus(_times(_slopes(y), _value(x) / square), _times(_slopes(x), -_value(y) / square))
        return Dual(np.arctan2(_value(y), _value(x)), slopes)

    @staticmethod
    def any(condition: Any) -> Any:
        """Whether a condition holds anywhere."""
        return np.any(condition)


def seeds(values: Floats) -> list[Dual]:
    """Parameters that begin to carry derivatives by themselves."""
    return [Dual(float(value), row) for value, row in zip(values, np.eye(len(values)), strict=True)]


def _value(number: Number) -> Any:
    return number.value if isinstance(number, Dual) else number


def _slopes(number: Number) -> Floats:
    return number.slopes if isinstance(number, Dual) else np.zeros(1)


def _times(slopes: Floats, factor: Number) -> Floats:
    if slopes.ndim == 1 and np.ndim(factor):
        slopes = slopes[:, np.newaxis]
    scaled: Floats = slopes * factor
    return scaled


def _plus(first: Floats, second: Floats) -> Floats:
    if first.ndim < second.ndim:
        first = first[:, np.newaxis]
    elif second.ndim < first.ndim:
        second = second[:, np.newaxis]
    return first + second
