"""Tables of numbers: text, Parquet, JSON lines and NumPy archives behind one door."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy.typing as npt

from trundle.adapters.content import Content, content_of
from trundle.adapters.numeral import Numeral
from trundle.errors import LogError, LogSchema, listed, no_such
from trundle.robot.log_mapping import TableFormat

__all__ = ["ColumnName", "Ending", "LongTable", "Rows", "Table", "Wanted", "column_index", "open_table"]

ColumnName: TypeAlias = str | int


@dataclass(frozen=True, slots=True)
class Wanted:
    """A column to read.

    Attributes:
        column: Its name, or its number counted from 0.
        numeral: How its numbers are kept.
        hold: Where its cell is empty, the last value still holds.
    """

    column: ColumnName
    numeral: Numeral
    hold: bool = False


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of a file that does not end with a whole row.

    Attributes:
        words: `ends at byte 1027, inside line 33`.
        is_cut: Whether that line is certainly no whole row; else it looks like one.
    """

    words: str
    is_cut: bool

    @property
    def loss(self) -> str:
        """What is missing, as a sentence."""
        if self.is_cut:
            return f"{self.words}; what came behind is lost"
        return f"{self.words} and without a line break; that row is left out, as its last number may be cut"


@dataclass(frozen=True, slots=True)
class Rows:
    """What was read.

    Attributes:
        columns: In the order in which they were wanted, all of one length.
        rejected: Rows that were left out, by reason: `parse`, `nonfinite`.
        warnings: Which rows, and why, as sentences.
        ending: How the file ends, if not as it should.
    """

    columns: tuple[npt.NDArray[Any], ...]
    rejected: Counter[str] = field(default_factory=Counter)
    warnings: tuple[str, ...] = ()
    ending: Ending | None = None


class Table(Protocol):
    """A table that is read column by column.

    Attributes:
        path: The file.
        names: Names of its columns; their numbers from 0 where it names none.
    """

    path: Path
    names: tuple[ColumnName, ...]

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """The wanted columns.

        Raises:
            LogSchema: If one does not exist, is ambiguous, or holds nothing that could be read.
            LogError: If the file cannot be read, or has no rows (`empty`).
        """


@runtime_checkable
class LongTable(Table, Protocol):
    """A table that need not be held as a whole."""

    def pieces(self, wanted: Sequence[Wanted], least: int) -> Iterator[Rows]:
        """What `read` returns, at least so many rows at a time, but for the last ones, which tell of all.

        Raises:
            LogSchema: As `read`; what is true of all rows, at the end.
            LogError: As `read`; when the piece comes that is at fault.
        """


def open_table(path: str | os.PathLike[str], table_format: TableFormat | None = None) -> Table:
    """A table by its content: text, Parquet, JSON lines, or a NumPy archive.

    Args:
        path: The file.
        table_format: How text is written; plain CSV with a header by default.

    Raises:
        LogError: If it is neither, or cannot be read.
    """
    path = Path(path)
    content = content_of(path)
    if content is Content.TEXT:
        from trundle.adapters.text_table import TextTable

        return TextTable(path, table_format or TableFormat())
    if content is Content.PARQUET:
        from trundle.adapters.parquet_table import ParquetTable

        return ParquetTable(path)
    if content is Content.JSON:
        from trundle.adapters.json_lines import JsonTable

        return JsonTable(path)
    if content is Content.NPZ:
        from trundle.adapters.npz_table import NpzTable

        return NpzTable(path)
    raise LogError(
        path, "format", f"is {content.value}, must be a table (text, Parquet, JSON lines or NumPy archive)"
    )


def column_index(path: Path, names: Sequence[ColumnName], column: ColumnName, hint: str = "") -> int:
    """Where a column stands.

    Raises:
        LogSchema: If it does not exist or several have that name; the message lists what exists.
    """
    found = [index for index, name in enumerate(names) if name == column]
    if not found and isinstance(column, int) and 0 <= column < len(names):
        found = [column]
    if len(found) == 1:
        return found[0]
    if found:
        raise LogSchema(path, "column", f"columns {found} are all named {column!r}; choose one by its number")
    words = [str(name) for name in names]
    has = f"{len(words)} column{'s' * (len(words) != 1)}: {listed(words, like=str(column))}"
    problem = no_such("column", column, words, has)
    advice = hint or "trundle info shows what its columns hold, and proposes a log: section"
    raise LogSchema(path, "column", f"{problem}; {advice}")
