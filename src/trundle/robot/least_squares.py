"""Small linear algebra in plain arithmetic.

Numbers may be floats (the live path: no NumPy), arrays (the batch path: one solve per element),
or traced scalars (a drive whose parameters are being differentiated). So there are no square
roots to guard, no branches on values, and no library.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from trundle.robot.traced import nominal

__all__ = ["Solution", "minimise", "null_space", "pseudo_inverse"]

Number = Any
Columns = Sequence[Sequence[Number]]


class Solution(NamedTuple):
    """What `minimise` found.

    Attributes:
        unknowns: One per column.
        remainder: What the columns could not explain, one per row.
        squares: Per column the square of what the earlier columns could not explain of it: zero
            where it depends on them.
    """

    unknowns: list[Number]
    remainder: list[Number]
    squares: list[Number]


def minimise(columns: Columns, values: Sequence[Number]) -> Solution:
    """The unknowns u that make `columns @ u` come nearest to the values.

    Modified Gram-Schmidt with the values as last column, which is as stable as Householder's
    method; without square roots, so that symmetric problems keep exactly symmetric answers.

    Source:
        Bjorck 1967, "Solving linear least squares problems by Gram-Schmidt orthogonalization".
    """
    return _against(_orthogonal(columns), values)


def pseudo_inverse(columns: Columns) -> list[list[Number]]:
    """The matrix that takes values to the unknowns of `minimise`, as rows, one per unknown."""
    orthogonal, squares, ratios = _orthogonal(columns)
    rows = [[a / square for a in q] for q, square in zip(orthogonal, squares, strict=True)]
    for j in range(len(rows) - 2, -1, -1):
        for later, ratio in enumerate(ratios[j], start=j + 1):
            rows[j] = [a - ratio * b for a, b in zip(rows[j], rows[later], strict=True)]
    return rows


class _Orthogonal(NamedTuple):
    """Columns made orthogonal, their squares, and per column its share in each of the later ones."""

    columns: list[list[Number]]
    squares: list[Number]
    ratios: list[list[Number]]


def _orthogonal(columns: Columns) -> _Orthogonal:
    work = [list(column) for column in columns]
    squares: list[Number] = []
    ratios: list[list[Number]] = []
    for j, q in enumerate(work):
        square = sum([a * a for a in q])
        row: list[Number] = []
        for later in range(j + 1, len(work)):
            target = work[later]
            ratio = sum([a * b for a, b in zip(q, target, strict=True)]) / square
            work[later] = [b - ratio * a for a, b in zip(q, target, strict=True)]
            row.append(ratio)
        squares.append(square)
        ratios.append(row)
    return _Orthogonal(work, squares, ratios)


def _against(orthogonal: _Orthogonal, values: Sequence[Number]) -> Solution:
    columns, squares, ratios = orthogonal
    rest = list(values)
    unknowns: list[Number] = []
    for q, square in zip(columns, squares, strict=True):
        share = sum([a * b for a, b in zip(q, rest, strict=True)]) / square
        rest = [b - share * a for a, b in zip(q, rest, strict=True)]
        unknowns.append(share)
    for j in range(len(columns) - 2, -1, -1):
        for later, ratio in enumerate(ratios[j], start=j + 1):
            unknowns[j] = unknowns[j] - ratio * unknowns[later]
    return Solution(unknowns, rest, squares)


def null_space(rows: Sequence[Sequence[Number]], scale: Sequence[float]) -> list[list[Number]]:
    """Columns that span the vectors v with `rows @ v = 0`; the rows must be independent.

    Gauss-Jordan, so that the unknowns that remain are components of v themselves.

    Args:
        rows: Independent rows.
        scale: Typical size of each component of v, to choose pivots by.
    """
    width = len(scale)
    work = [list(row) for row in rows]
    pivots: list[int] = []
    for i, row in enumerate(work):
        left = [c for c in range(width) if c not in pivots]
        pivot = max(left, key=lambda c: abs(nominal(row[c])) * scale[c])
        pivots.append(pivot)
        leading = [a / row[pivot] for a in row]
        work[i] = leading
        for k, other in enumerate(work):
            if k != i:
                work[k] = [b - other[pivot] * a for a, b in zip(leading, other, strict=True)]
    columns = []
    for free in (c for c in range(width) if c not in pivots):
        column: list[Number] = [0.0] * width
        column[free] = 1.0
        for pivot, row in zip(pivots, work, strict=True):
            column[pivot] = -row[free]
        columns.append(column)
    return columns
