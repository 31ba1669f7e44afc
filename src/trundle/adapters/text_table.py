"""Text tables: CSV and its relatives, one record per line.

Lines are split into cells; the cells of a block of lines become columns in one go. Where a block holds
anything that is not a number, it is halved until the lines at fault stand alone, so what is accepted and
what is refused does not depend on the way taken. Blocks that hold nothing unusual go through pyarrow
where it is installed; what it does not take goes the other way.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import statistics
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from trundle.adapters.arrow_column import numbers_of
from trundle.adapters.numeral import Beyond, Nonfinite, Numeral, Real, plain
from trundle.adapters.table import ColumnName, Ending, Rows, Wanted, column_index
from trundle.errors import LogError, LogLimit, LogSchema
from trundle.robot.log_mapping import TableFormat

__all__ = ["TextTable"]

Line: TypeAlias = tuple[int, list[bytes]]  # its number in the file, counted from 1, and its cells
Columns: TypeAlias = list[npt.NDArray[Any]]

BLOCK = 1 << 17  # bytes at a time: what is made of them stays in the cache
LONGEST_LINE = 1 << 20
CTRL_Z = b"\x1a"  # DOS ends texts with it
SAMPLE = 50  # lines that the shape of the table is read off
NAMED = 5  # lines at fault that a warning names
WORTH_PYARROW = 4 << 20  # bytes of a file, above which loading pyarrow pays
_REASONS: dict[type[ValueError], str] = {Nonfinite: "nonfinite", Beyond: "time_range"}
# Other delimiters, as YAML writes them. The last two stand in many tables without dividing them.
_LIKELY: dict[bytes | None, str] = {b";": '";"', b"\t": '"\\t"', b"|": '"|"'}
_UNLIKELY: dict[bytes | None, str] = {b",": '","', None: '" "'}
# pyarrow reads quotes, hexadecimal numbers and carriage returns in ways of its own.
_UNUSUAL = b'"\0\rxX'


class TextTable:
    """A text table. Cells are separated as its format says; nothing is guessed.

    UTF-8, and UTF-16 with a byte order mark. Lines end with LF or CR LF. Cells may be quoted as in
    RFC 4180, but a quoted cell ends with its line, so that a quote which is never closed costs one
    line and not the rest of the file. Empty lines and comments do not count. A last line that does not end is
    left out: a file that was cut inside a number still holds a number there, another one.
    """

    def __init__(self, path: Path, table_format: TableFormat) -> None:
        self.path = path
        self.format = table_format
        self._comment = table_format.comment.encode()
        self._delimiter = None if table_format.delimiter == " " else table_format.delimiter.encode()
        texts = itertools.chain.from_iterable(self._texts(*block) for block in _blocks(path))
        sample = list(itertools.islice(texts, SAMPLE))
        if not sample:
            raise LogError(path, "empty", "holds no row")
        self._sample = sample
        self._header_line = sample[0][0] if table_format.header else 0
        self.names = self._read_names(sample)

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """See `Table`."""
        (rows,) = _Reading(self, wanted).pieces(None)
        return rows

    def pieces(self, wanted: Sequence[Wanted], least: int) -> Iterator[Rows]:
        """See `LongTable`."""
        return _Reading(self, wanted).pieces(least)

    @property
    def dialect_hint(self) -> str:
        """What the table looks like, where that is not what its format says; else empty."""
        return self._dialect and f"{self._dialect}; trundle info proposes the whole section"

    @property
    def _dialect(self) -> str:
        lines = [line for _, line in self._sample]
        undivided = all(len(line.split(self._delimiter)) == 1 for line in lines)
        for other, word in (_LIKELY | _UNLIKELY if undivided else _LIKELY).items():
            widths = {len(line.split(other)) for line in lines}
            if other != self._delimiter and len(widths) == 1 and widths != {1}:
                return f"it looks delimited by {word}: if so, declare log.table.delimiter: {word}"
        first = self.cells(lines[0])
        if self.format.header and first and all(_is_number(cell, self.format.decimal) for cell in first):
            return "its first row holds numbers only: if it has no header, declare log.table.header: false"
        return ""

    def cells(self, line: bytes) -> list[bytes]:
        """The cells of a line; none where a quote is never closed."""
        if self._delimiter is None or b'"' not in line:
            return line.split(self._delimiter)
        # Latin-1 gives every byte a character, and the same byte back.
        text = line.decode("latin-1")
        try:
            (cells,) = csv.reader([text], delimiter=self.format.delimiter, strict=True)
        except (csv.Error, ValueError):
            return []
        return [cell.encode("latin-1") for cell in cells]

    def blocks(self) -> Iterator[tuple[int, bytes]]:
        """Whole lines in blocks, each with the number of its first line; the header left out."""
        for first, block in _blocks(self.path):
            into = self._header_line - first + 1
            if 1 <= into <= block.count(b"\n") + (not block.endswith(b"\n")):
                *_, below = block.split(b"\n", into)
                yield self._header_line + 1, below
            else:
                yield first, block

    def lines(self, first: int, block: bytes) -> list[Line]:
        """The cells of the lines of a block that are neither empty nor comments."""
        if self._delimiter is not None and b'"' in block:
            return [(number, self.cells(text)) for number, text in self._texts(first, block)]
        return [(number, text.split(self._delimiter)) for number, text in self._texts(first, block)]

    def is_usual(self, block: bytes) -> bool:
        """Whether pyarrow splits this block into cells as we do."""
        return (
            self._delimiter is not None
            and len(self._delimiter) == 1
            and not any(byte in block for byte in _UNUSUAL)
            and not (self._comment and self._comment in block)
        )

    def _texts(self, first: int, block: bytes) -> Iterator[tuple[int, bytes]]:
        """The lines that are neither empty nor comments, with their numbers."""
        texts = enumerate(block.replace(b"\r\n", b"\n").split(b"\n"), first)
        filled = ((number, text) for number, text in texts if text and not text.isspace())
        if not self._comment or self._comment not in block:
            return filled
        return ((number, text) for number, text in filled if not text.startswith(self._comment))

    def _read_names(self, sample: list[tuple[int, bytes]]) -> tuple[ColumnName, ...]:
        if not self.format.header:
            return tuple(range(statistics.mode(len(self.cells(line)) for _, line in sample)))
        number, line = sample[0]
        try:
            return tuple(cell.decode().strip() for cell in self.cells(line))
        except UnicodeDecodeError as error:
            raise LogError(self.path, "encoding", f"line {number}: no UTF-8 header: {error}") from error


class _Reading:
    """One pass over a table for the wanted columns."""

    def __init__(self, table: TextTable, wanted: Sequence[Wanted]) -> None:
        self.table = table
        self.wanted = wanted
        hint = table.dialect_hint
        self.places = [column_index(table.path, table.names, want.column, hint) for want in wanted]
        self.held = {place: b"" for place, want in zip(self.places, wanted, strict=True) if want.hold}
        self.rejected: Counter[str] = Counter()
        self.faults: list[tuple[int, str]] = []
        self.foreign_decimals = 0
        self.ending: Ending | None = None

    def pieces(self, least: int | None) -> Iterator[Rows]:
        """At least so many rows at a time, but for the last piece; without a number all at once."""
        arrow = _Arrow.for_table(self.table, self.wanted, self.places) if not self.held else None
        parts: list[Columns] = []
        count = 0
        for first, block in self._finished(self.table.blocks()):
            if least is not None and sum(len(columns[0]) for columns in parts) >= least:
                piece = _joined(parts)
                count += len(piece[0])
                yield Rows(piece)
                parts = []
            columns = arrow.columns(block) if arrow and self.table.is_usual(block) else None
            if columns is None:
                columns = self._parsed(self._shaped(self.table.lines(first, block)))
            parts.append(columns)
            self.faults = sorted(self.faults)[:NAMED]
        rest = _joined(parts)
        self._check(count + (len(rest[0]) if rest else 0))
        yield Rows(rest, self.rejected, self._warnings(), self.ending)

    def _finished(self, blocks: Iterator[tuple[int, bytes]]) -> Iterator[tuple[int, bytes]]:
        """Lines that end. Of one that does not, the last number may be cut and still look like a number."""
        for first, block in blocks:
            *whole, rest = block.rpartition(b"\n")
            last = first + block.count(b"\n")
            for line in self.table.lines(last, rest.rstrip(CTRL_Z)):
                self._reject(last, "unfinished", "the file ends inside it, so its last number may be cut")
                size, is_cut = self.table.path.stat().st_size, not self._is_row(line)
                where = "inside" if is_cut else "behind"
                self.ending = Ending(f"ends at byte {size}, {where} line {last}", is_cut)
            yield first, b"".join(whole)

    def _is_row(self, line: Line) -> bool:
        """Whether a line looks like a whole row."""
        if len(line[1]) != len(self.table.names):
            return False
        self._fill([line])
        try:
            self._columns([line])
        except ValueError:
            return False
        return True

    def _shaped(self, lines: list[Line]) -> list[Line]:
        """The lines with as many cells as the table has columns, held values filled in."""
        width = len(self.table.names)
        shaped = [line for line in lines if len(line[1]) == width]
        if len(shaped) < len(lines):
            for number, cells in lines:
                if len(cells) != width:
                    what = f"{len(cells)} cells instead of {width}" if cells else "a quote is never closed"
                    self._reject(number, "parse", what)
        if self.held:
            self._fill(shaped)
        return shaped

    def _fill(self, lines: list[Line]) -> None:
        """Put the last value into empty cells of columns that hold it."""
        for _, cells in lines:
            for place, last in self.held.items():
                if not cells[place].strip():
                    cells[place] = last
                elif _is_number(cells[place], self.table.format.decimal):
                    self.held[place] = cells[place]

    def _parsed(self, lines: list[Line]) -> Columns:
        """The wanted columns of the lines that can be read."""
        try:
            return self._columns(lines)
        except ValueError:
            return self._columns(self._readable(lines))

    def _readable(self, lines: list[Line]) -> list[Line]:
        """The lines whose wanted cells are numbers; the others are counted."""
        try:
            self._columns(lines)
        except ValueError as error:
            if len(lines) > 1:
                half = len(lines) // 2
                return self._readable(lines[:half]) + self._readable(lines[half:])
            number, cells = lines[0]
            self._reject(number, _REASONS.get(type(error), "parse"), self._culprit(cells))
            return []
        return lines

    def _columns(self, lines: list[Line]) -> Columns:
        """The wanted columns of lines.

        Raises:
            ValueError: If a wanted cell is not a number of its kind.
        """
        return [
            self._column(want.numeral, [cells[place] for _, cells in lines])
            for want, place in zip(self.wanted, self.places, strict=True)
        ]

    def _column(self, numeral: Numeral, cells: list[bytes]) -> npt.NDArray[Any]:
        return numeral.of_text(plain(cells, self.table.format.decimal) if cells else cells)

    def _culprit(self, cells: list[bytes]) -> str:
        """The first cell of a line that is at fault, for people."""
        for want, place in zip(self.wanted, self.places, strict=True):
            try:
                self._column(want.numeral, [cells[place]])
            except ValueError:
                other = "," if self.table.format.decimal == "." else "."
                self.foreign_decimals += other.encode() in cells[place] and _is_number(cells[place], other)
                shown = cells[place][:40].decode("utf-8", "backslashreplace")
                return f"column {want.column!r} holds {shown!r}"
        raise AssertionError("a line was refused whose cells are all numbers")

    def _reject(self, number: int, reason: str, what: str) -> None:
        self.rejected[reason] += 1
        self.faults.append((number, f"line {number}: {what}"))

    def _check(self, count: int) -> None:
        """Refuse a table that as a whole is written otherwise than declared."""
        path, refused = self.table.path, self.rejected.total()
        if not count and not refused:
            raise LogError(path, "empty", "has a header, but no row below it")
        if not count and 2 * (beyond := self.rejected["time_range"]) > refused:
            problem = f"{beyond} of {refused} rows are stamped beyond 292 years, as {self.faults[0][1]}"
            raise LogSchema(path, "unit", f"{problem}; declare the unit of the time")
        other = "," if self.table.format.decimal == "." else "."
        if self.foreign_decimals * 10 > count + refused:
            hint = f"it looks like a decimal {other!r}: if so, declare log.table.decimal: {other!r}"
        elif not count:
            hint = self.table.dialect_hint
        else:
            return
        problem = f"{refused} of {refused + count} rows hold no numbers: {self.faults[0][1]}"
        raise LogSchema(path, "parse", "; ".join(filter(None, (problem, hint))))

    def _warnings(self) -> tuple[str, ...]:
        refused = self.rejected.total()
        if not refused:
            return ()
        dots = "; ..." if refused > len(self.faults) else ""
        rows = "1 row was" if refused == 1 else f"{refused} rows were"
        return (f"{rows} left out as unreadable: {'; '.join(fault for _, fault in self.faults)}{dots}",)


class _Arrow:
    """The fast way for usual blocks: pyarrow's CSV reader, told every type and given no freedom."""

    def __init__(self, table: TextTable, wanted: Sequence[Wanted], places: Sequence[int]) -> None:
        import pyarrow as pa
        from pyarrow import csv as reader

        # Its handlers hand a signal to a thread, which may come too late for calls as short as these: now and
        # then a Ctrl-C would be lost.
        pa.enable_signal_handlers(False)
        self.wanted = wanted
        self.places = [f"f{place}" for place in places]
        self.file, self.parse, self.invalid = pa.BufferReader, reader.read_csv, pa.ArrowInvalid
        types = {
            name: pa.int64() if want.numeral.whole else pa.float64()
            for name, want in zip(self.places, wanted, strict=True)
        }
        names = [f"f{place}" for place in range(len(table.names))]
        self.options = {
            "read_options": reader.ReadOptions(use_threads=False, block_size=4 * BLOCK, column_names=names),
            "parse_options": reader.ParseOptions(delimiter=table.format.delimiter, quote_char=False),
            "convert_options": reader.ConvertOptions(
                include_columns=list(types),
                column_types=types,
                null_values=[],
                decimal_point=table.format.decimal,
            ),
        }

    @classmethod
    def for_table(cls, table: TextTable, wanted: Sequence[Wanted], places: Sequence[int]) -> _Arrow | None:
        """The fast way, where it is there and worth the time that loading it takes."""
        if table.path.stat().st_size < WORTH_PYARROW or len(set(places)) < len(places):
            return None
        try:
            return cls(table, wanted, places)
        except ImportError:
            return None

    def columns(self, block: bytes) -> Columns | None:
        """The wanted columns, or None if anything about the block is not plain."""
        try:
            table = self.parse(self.file(block), **self.options)
        except self.invalid:
            return None
        columns = []
        for name, want in zip(self.places, self.wanted, strict=True):
            column, refused = want.numeral.of_numbers(numbers_of(table.column(name)))
            if refused.any() or not want.numeral.is_exact(column):
                return None
            columns.append(column)
        return columns


def _joined(parts: list[Columns]) -> tuple[npt.NDArray[Any], ...]:
    return tuple(np.concatenate(pieces) for pieces in zip(*parts, strict=True))


def _is_number(cell: bytes, decimal: str) -> bool:
    try:
        Real().of_text(plain([cell], decimal))
    except ValueError:
        return False
    return True


def _blocks(path: Path) -> Iterator[tuple[int, bytes]]:
    """The bytes of a file as UTF-8, in blocks that end with a line, each with its first line's number."""
    first, rest = 1, b""
    for piece in _pieces(path):
        cut = piece.rfind(b"\n") + 1
        if cut:
            block, rest = rest + piece[:cut], piece[cut:]
            yield first, block
            first += block.count(b"\n")
        else:
            rest += piece
        if len(rest) > LONGEST_LINE:
            raise LogLimit(path, "line", f"a line is longer than {LONGEST_LINE} bytes: not a table")
    if rest:
        yield first, rest


def _pieces(path: Path) -> Iterator[bytes]:
    """The bytes of a file as UTF-8 without a byte order mark."""
    try:
        with path.open("rb") as file:
            piece = file.read(BLOCK)
            if piece.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
                decoder = codecs.getincrementaldecoder("utf-16")()
                while piece:
                    yield decoder.decode(piece).encode()
                    piece = file.read(BLOCK)
                if decoder.getstate()[0]:  # the file ends inside a character
                    yield "\N{REPLACEMENT CHARACTER}".encode()
                return
            piece = piece.removeprefix(codecs.BOM_UTF8)
            while piece:
                yield piece
                piece = file.read(BLOCK)
    except UnicodeError as error:
        raise LogError(path, "encoding", f"is not UTF-16, as its first bytes say: {error}") from error
    except OSError as error:
        raise LogError(path, "unreadable", f"cannot be read: {error.strerror or error}") from error
