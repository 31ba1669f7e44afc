"""Columns of binary tables, where each number says for itself whether it can be kept."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from trundle.adapters.numeral import Stamp
from trundle.adapters.table import Rows, Wanted
from trundle.errors import LogSchema

__all__ = ["Mask", "NumberColumn", "kept_rows"]

Mask = npt.NDArray[np.bool_]
# Values; which of them are no such numbers; which are not finite where they must be.
NumberColumn: TypeAlias = tuple[npt.NDArray[Any], Mask, Mask]


def kept_rows(path: Path, wanted: Sequence[Wanted], columns: Sequence[NumberColumn]) -> Rows:
    """The rows that are whole, and an account of the others.

    Args:
        path: The file.
        wanted: What the columns are.
        columns: As many, of one length that is not zero.

    Raises:
        LogSchema: If no row is whole: `unit` where that is because the stamps cannot be, else `parse`.
    """
    missing = np.logical_or.reduce([unreadable for _, unreadable, _ in columns])
    nonfinite = np.logical_or.reduce([refused for _, _, refused in columns]) & ~missing
    bad = missing | nonfinite
    if not bad.any():
        return Rows(tuple(values for values, _, _ in columns))
    rows = np.flatnonzero(bad)
    named = ", ".join(str(row) for row in rows[:5]) + (", ..." if len(rows) > 5 else "")
    culprits = ", ".join(
        repr(want.column) for want, (_, a, r) in zip(wanted, columns, strict=True) if (a | r).any()
    )
    if bad.all():
        raise _complaint(path, wanted, columns, culprits)
    rejected = Counter({"parse": int(missing.sum()), "nonfinite": int(nonfinite.sum())})
    return Rows(
        tuple(values[~bad] for values, _, _ in columns),
        +rejected,
        (f"{len(rows)} rows were left out as unreadable: rows {named}: no number in {culprits}",),
    )


def _complaint(
    path: Path, wanted: Sequence[Wanted], columns: Sequence[NumberColumn], culprits: str
) -> LogSchema:
    for want, (_, unreadable, _) in zip(wanted, columns, strict=True):
        if isinstance(want.numeral, Stamp) and unreadable.all():
            problem = f"no {want.column!r} is a time within 292 years: declare the unit of the time"
            return LogSchema(path, "unit", problem)
    return LogSchema(path, "parse", f"no row holds a number in each of {culprits}")
