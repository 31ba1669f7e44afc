"""Numbers as decimal text: as few digits as it takes to read back the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

__all__ = ["Part", "Seconds", "decimal_lines", "separated"]

ROWS_AT_ONCE = 1024  # few enough for their texts to stay in the cache
NS = 1_000_000_000
DECIMALS = 9  # of seconds


class Seconds(NamedTuple):
    """Nanoseconds, int64 of shape (n,), that are written as seconds, with all nine decimals."""

    time_ns: npt.NDArray[np.int64]


Part: TypeAlias = str | Seconds | npt.NDArray[Any]
"""What a line is made of: text that is the same in all lines, or a column of which each has one number."""


def decimal_lines(parts: Sequence[Part]) -> Iterator[str]:
    """Lines of numbers, some at a time.

    Args:
        parts: Of each line, from left to right, its end included; each column of shape (n,), one at least.
    """
    columns = [part.time_ns if isinstance(part, Seconds) else part for part in parts]
    count = next(len(column) for column in columns if not isinstance(column, str))
    line = [part if isinstance(part, str) else "" for part in parts]
    for start in range(0, count, ROWS_AT_ONCE):
        rows = slice(start, min(start + ROWS_AT_ONCE, count))
        texts = line * (rows.stop - start)
        for place, part in enumerate(parts):
            if isinstance(part, Seconds):
                texts[place :: len(parts)] = _seconds(part.time_ns[rows])
            elif not isinstance(part, str):
                texts[place :: len(parts)] = _decimals(part[rows])
        yield "".join(texts)


def separated(columns: Sequence[npt.NDArray[Any]], separator: str) -> list[Part]:
    """The parts of lines that hold columns and nothing else."""
    parts = [part for column in columns for part in (column, separator)]
    return [*parts[:-1], "\n"]


def _decimals(column: npt.NDArray[Any]) -> Sequence[str]:
    """A list of numbers in JSON is their shortest decimals, written five times as fast as `repr` does."""
    texts = msgspec.json.encode(column.tolist())[1:-1].decode("ascii").split(",")
    for row in np.flatnonzero(~np.isfinite(column)).tolist():  # for which JSON has no words
        texts[row] = repr(float(column[row]))
    return texts


def _seconds(time_ns: npt.NDArray[np.int64]) -> Sequence[str]:
    """Where all have as many digits, the point is put between them as between the columns of a table."""
    first, last = int(time_ns.min()), int(time_ns.max())
    if first < NS or len(str(first)) < len(str(last)):
        return [f"{'-' * (t < 0)}{abs(t) // NS}.{abs(t) % NS:0{DECIMALS}}" for t in time_ns.tolist()]
    digits = msgspec.json.encode(time_ns.tolist())[1:-1] + b","
    table = np.frombuffer(digits, np.uint8).reshape(len(time_ns), -1)
    whole, decimals = np.split(table, [-DECIMALS - 1], axis=1)
    points = np.full((len(table), 1), ord("."), np.uint8)
    table = np.concatenate((whole, points, decimals), axis=1)
    return table.tobytes()[:-1].decode("ascii").split(",")
