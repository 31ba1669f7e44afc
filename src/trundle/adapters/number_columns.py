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
from trundle.errors import LogError, LogSchema

__all__ = ["Mask", "NumberColumn", "RowAccount"]

NAMED = 5  # rows at fault that a warning names

Mask = npt.NDArray[np.bool_]
# Values; which of them are no such numbers; which are not finite where they must be.
NumberColumn: TypeAlias = tuple[npt.NDArray[Any], Mask, Mask]


class RowAccount:
    """The rows of a table that are whole, and an account of the others; some rows at a time."""

    def __init__(self, path: Path, wanted: Sequence[Wanted]) -> None:
        """Start with no rows.

        Args:
            path: The file.
            wanted: What the columns are.
        """
        self._path = path
        self._wanted = wanted
        self._count = 0
        self._rejected: Counter[str] = Counter()
        self._named: list[int] = []
        self._faulty = np.zeros(len(wanted), bool)  # columns that hold something else than numbers
        self._unreadable = np.ones(len(wanted), bool)  # columns that hold nothing but that

    def kept(self, columns: Sequence[NumberColumn]) -> tuple[npt.NDArray[Any], ...]:
        """What can be kept of the next rows.

        Args:
            columns: As many as are wanted, of one length.
        """
        missing = np.logical_or.reduce([unreadable for _, unreadable, _ in columns])
        nonfinite = np.logical_or.reduce([refused for _, _, refused in columns]) & ~missing
        bad = missing | nonfinite
        before, self._count = self._count, self._count + len(bad)
        self._unreadable &= [unreadable.all() for _, unreadable, _ in columns]
        if not bad.any():
            return tuple(values for values, _, _ in columns)
        self._faulty |= [(unreadable | refused).any() for _, unreadable, refused in columns]
        self._named += (before + np.flatnonzero(bad)[: NAMED - len(self._named)]).tolist()
        self._rejected.update(parse=int(missing.sum()), nonfinite=int(nonfinite.sum()))
        return tuple(values[~bad] for values, _, _ in columns)

    def last(self, columns: Sequence[NumberColumn]) -> Rows:
        """The last rows, with the account of all of them.

        Raises:
            LogError: `empty`, if there were no rows at all.
            LogSchema: If no row is whole: `unit` where that is because the stamps cannot be, else `parse`.
        """
        kept = self.kept(columns)
        refused = self._rejected.total()
        if not self._count:
            raise LogError(self._path, "empty", "holds no row")
        if refused == self._count:
            raise self._complaint()
        return Rows(kept, +self._rejected, self._warnings() if refused else ())

    @property
    def _culprits(self) -> str:
        return ", ".join(repr(self._wanted[place].column) for place in np.flatnonzero(self._faulty).tolist())

    def _warnings(self) -> tuple[str, ...]:
        refused = self._rejected.total()
        named = ", ".join(map(str, self._named)) + (", ..." if refused > NAMED else "")
        return (f"{refused} rows were left out as unreadable: rows {named}: no number in {self._culprits}",)

    def _complaint(self) -> LogSchema:
        for want, unreadable in zip(self._wanted, self._unreadable, strict=True):
            if isinstance(want.numeral, Stamp) and unreadable:
                problem = f"no {want.column!r} is a time within 292 years: declare the unit of the time"
                return LogSchema(self._path, "unit", problem)
        return LogSchema(self._path, "parse", f"no row holds a number in each of {self._culprits}")
