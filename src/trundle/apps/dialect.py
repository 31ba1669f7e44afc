"""How a text table seems to be written. Reading guesses nothing; a first look may."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from trundle.adapters.text_table import TextTable
from trundle.errors import LogError
from trundle.robot.log_mapping import TableFormat

__all__ = ["seeming_format"]

_DELIMITERS = (",", ";", "\t", "|", " ")
_SAMPLE = 50  # lines
_NUMBER = re.compile(rb"\s*[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?\s*|\s*[+-]?(nan|inf)\s*", re.IGNORECASE)

Cells = Sequence[Sequence[bytes]]


def seeming_format(path: Path) -> TableFormat:
    """The format under which most cells of a table are numbers; plain CSV where none fits.

    Args:
        path: A text table.

    Raises:
        LogError: If it cannot be read.
    """
    looks = [
        (_numeric(cells), delimiter, cells) for delimiter in _DELIMITERS if (cells := _cells(path, delimiter))
    ]
    if not looks:
        return TableFormat()
    _, delimiter, cells = max(looks, key=lambda look: look[0])  # of equals the first
    numbers = [cell for row in cells[1:] for cell in row if _NUMBER.fullmatch(cell)]
    decimal = delimiter != "," and any(b"," in cell for cell in numbers)
    return TableFormat(delimiter=delimiter, header=_has_header(cells), decimal="," if decimal else ".")


def _cells(path: Path, delimiter: str) -> Cells:
    """The first rows; none where they differ in width or have a single cell."""
    try:
        table = TextTable(path, TableFormat(delimiter=delimiter, header=False))
    except LogError as error:
        if error.reason in ("empty", "encoding", "unreadable"):
            raise
        return ()
    rows = [cells for _, cells in table.lines(*next(table.blocks()))][:_SAMPLE]
    widths = {len(cells) for cells in rows}
    return rows if len(widths) == 1 and widths != {1} else ()


def _numeric(rows: Cells) -> float:
    """Which part of the cells below the first row are numbers."""
    cells = [cell for row in rows[1:] for cell in row]
    return sum(_NUMBER.fullmatch(cell) is not None for cell in cells) / max(len(cells), 1)


def _has_header(rows: Cells) -> bool:
    """Whether the first row holds words where numbers stand below."""
    first, *body = rows
    return any(
        not _NUMBER.fullmatch(cell) and cell.strip() and all(_NUMBER.fullmatch(below) for below in column)
        for cell, column in zip(first, zip(*body, strict=True), strict=False)
    )
