"""Numbers as decimal text: as few digits as it takes to read back the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

__all__ = ["decimal_blocks", "decimal_rows"]

ROWS_AT_ONCE = 4096  # few enough for their texts to stay in the cache


def decimal_rows(columns: Sequence[npt.NDArray[Any]]) -> Iterator[tuple[str, ...]]:
    """The rows of a table.

    Args:
        columns: Numbers, each column of shape (n,).
    """
    for block in decimal_blocks(columns):
        yield from zip(*block, strict=True)


def decimal_blocks(columns: Sequence[npt.NDArray[Any]]) -> Iterator[list[Sequence[str]]]:
    """The columns of a table, some rows at a time.

    Args:
        columns: As for `decimal_rows`.
    """
    for start in range(0, len(columns[0]), ROWS_AT_ONCE):
        yield [_decimals(column[start : start + ROWS_AT_ONCE]) for column in columns]


def _decimals(column: npt.NDArray[Any]) -> Sequence[str]:
    """A list of numbers in JSON is their shortest decimals, written five times as fast as `repr` does."""
    if not np.isfinite(column).all():  # for which JSON has no words
        return [repr(value) for value in column.tolist()]
    return msgspec.json.encode(column.tolist())[1:-1].decode("ascii").split(",")
