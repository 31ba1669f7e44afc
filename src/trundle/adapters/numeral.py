"""Numbers in tables: one strict grammar, and as many digits as their use needs.

A number is what C and Python write: an optional sign, ASCII digits with an optional decimal sign and
exponent, or `nan`, `inf`, `infinity`; blanks around it do not matter. Nothing else is a number: not an
empty cell, not `1_000`, not full-width digits, which Python's `float` would take.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Context, Decimal
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from trundle.robot.log_mapping import Unit

__all__ = ["Beyond", "Count", "Nonfinite", "Numeral", "Real", "Stamp", "plain"]

Tokens = Sequence[bytes]
Column = npt.NDArray[np.float64] | npt.NDArray[np.int64]

_LETTERS = b"0123456789+- \taefintyAEFINTY"
_WHOLE = b"0123456789+- \t"
# Below this many nanoseconds the product of a float and a power of ten is off by less than half of one.
_EXACT_AS_FLOAT = 1e15
_NANOSECONDS = {Unit.S: 9, Unit.MS: 6, Unit.US: 3, Unit.NS: 0}
_EXACT = Context(prec=60, rounding=ROUND_HALF_EVEN)


class Nonfinite(ValueError):
    """A number that is NaN or infinite where only a finite one can be kept."""


class Beyond(ValueError):
    """A number that is too large for what it is: a time in another unit."""


class Numeral(Protocol):
    """How the numbers of one column are kept.

    Attributes:
        whole: Whether they are whole numbers already where they are written.
    """

    @property
    def whole(self) -> bool: ...  # noqa: D102 - see above

    def of_text(self, tokens: Tokens) -> Column:
        """The column that these cells say.

        Raises:
            ValueError: If a cell is not such a number.
        """

    def of_numbers(self, values: npt.NDArray[Any]) -> tuple[Column, npt.NDArray[np.bool_]]:
        """The column that these numbers say, and which of them cannot be kept."""

    def is_exact(self, column: Column) -> bool:
        """Whether a column that `of_numbers` made of floats is what `of_text` makes of their texts."""


def plain(tokens: Tokens, decimal: str = ".") -> Tokens:
    """The cells with a decimal point, all of them free of what no number has.

    Raises:
        ValueError: If one holds anything else. Python's `float` and `int` take of the rest what the
            grammar allows, and nothing more.
    """
    text = b"\n".join(tokens)
    if text.translate(None, _LETTERS + b"\n" + decimal.encode()):
        raise ValueError("not a number")
    return tokens if decimal == "." else text.replace(decimal.encode(), b".").split(b"\n")


@dataclass(frozen=True, slots=True)
class Real:
    """Measured numbers, as float64; NaN and infinity among them."""

    @property
    def whole(self) -> bool:
        """See `Numeral`."""
        return False

    def of_text(self, tokens: Tokens) -> Column:
        """See `Numeral`."""
        return np.fromiter(map(float, tokens), np.float64, len(tokens))

    def of_numbers(self, values: npt.NDArray[Any]) -> tuple[Column, npt.NDArray[np.bool_]]:
        """See `Numeral`."""
        return values.astype(np.float64), np.zeros(values.shape, dtype=bool)

    def is_exact(self, column: Column) -> bool:
        """See `Numeral`."""
        return column.dtype == np.float64


@dataclass(frozen=True, slots=True)
class Count:
    """Whole numbers, exactly, as int64. Unsigned 64-bit counters come modulo 2^64.

    Attributes:
        bits: Width of the counter; only with 64 may a number lie above the greatest int64.
    """

    bits: int | None = None

    def of_text(self, tokens: Tokens) -> Column:
        """See `Numeral`."""
        try:
            counts = list(map(int, tokens))
        except ValueError:
            counts = list(map(_whole, tokens))
        return self._fitting(counts)

    def of_numbers(self, values: npt.NDArray[Any]) -> tuple[Column, npt.NDArray[np.bool_]]:
        """See `Numeral`."""
        if values.dtype.kind == "u" and self.bits == 64:
            return values.astype(np.uint64).view(np.int64), np.zeros(values.shape, dtype=bool)
        if values.dtype.kind in "iu":
            return values.astype(np.int64), values > np.iinfo(np.int64).max
        numbers = values.astype(np.float64)
        refused = ~(np.abs(numbers) < 2.0**63) | (np.rint(numbers) != numbers)
        return np.where(refused, 0.0, numbers).astype(np.int64), refused

    @property
    def whole(self) -> bool:
        """See `Numeral`."""
        return True

    def is_exact(self, column: Column) -> bool:
        """See `Numeral`."""
        return column.dtype == np.int64

    def _fitting(self, counts: list[int]) -> npt.NDArray[np.int64]:
        try:
            return np.array(counts, dtype=np.int64)
        except OverflowError:
            if self.bits != 64 or max(counts) >= 1 << 64 or min(counts) < -1 << 63:
                raise ValueError("beyond 64 bits") from None
            return np.array([count & (1 << 64) - 1 for count in counts], dtype=np.uint64).view(np.int64)


@dataclass(frozen=True, slots=True)
class Stamp:
    """Times, as int64 nanoseconds, exact to the last one.

    Attributes:
        unit: What they are written in.
    """

    unit: Unit = Unit.S

    @property
    def _exponent(self) -> int:
        return _NANOSECONDS[self.unit]

    def of_text(self, tokens: Tokens) -> Column:
        """See `Numeral`."""
        if not b"".join(tokens).translate(None, _WHOLE):
            return self._scaled(Count().of_text(tokens))
        times = np.fromiter(map(float, tokens), np.float64, len(tokens))
        if not np.isfinite(times).all():
            raise Nonfinite("a time that is not finite")
        scaled = self._as_nanoseconds(times)
        beyond = np.flatnonzero(np.abs(scaled) >= _EXACT_AS_FLOAT).tolist()
        scaled[beyond] = 0.0
        stamps = np.rint(scaled).astype(np.int64)
        try:
            stamps[beyond] = [int(_nanoseconds(tokens[k], self._exponent)) for k in beyond]
        except OverflowError:
            raise Beyond("beyond 292 years") from None
        return stamps

    def of_numbers(self, values: npt.NDArray[Any]) -> tuple[Column, npt.NDArray[np.bool_]]:
        """See `Numeral`."""
        limit = np.iinfo(np.int64).max // 10**self._exponent
        if values.dtype.kind in "iu":
            refused = (values > limit) | (values.astype(np.int64) < -limit)
            return np.where(refused, 0, values).astype(np.int64) * 10**self._exponent, refused
        scaled = self._as_nanoseconds(values.astype(np.float64))
        refused = ~(np.abs(scaled) < 2.0**63)
        return np.rint(np.where(refused, 0.0, scaled)).astype(np.int64), refused

    @property
    def whole(self) -> bool:
        """See `Numeral`."""
        return self._exponent == 0

    def is_exact(self, column: Column) -> bool:
        """See `Numeral`."""
        return self.whole or bool(np.abs(column).max(initial=0) < _EXACT_AS_FLOAT)

    def _as_nanoseconds(self, times: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        with np.errstate(over="ignore"):
            return times * 10.0**self._exponent

    def _scaled(self, times: Column) -> npt.NDArray[np.int64]:
        stamps, refused = self.of_numbers(times)
        if refused.any():
            raise Beyond("beyond 292 years")
        return stamps.astype(np.int64, copy=False)


def _whole(token: bytes) -> int:
    """A whole number, also one that is written with a decimal sign or an exponent."""
    try:
        return int(token)
    except ValueError:
        rounded = float(token)
    if not np.isfinite(rounded):
        raise Nonfinite("a count that is not finite")
    exact = Decimal(token.decode())
    if abs(rounded) > 2.0**64 or exact != exact.to_integral_value():
        raise ValueError("not a whole number")
    return int(exact)


def _nanoseconds(token: bytes, exponent: int) -> Decimal:
    return Decimal(token.decode()).scaleb(exponent, _EXACT).to_integral_value(ROUND_HALF_EVEN)
