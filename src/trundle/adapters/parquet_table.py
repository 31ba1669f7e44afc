"""Parquet tables, through pyarrow."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from trundle.adapters.arrow_column import numbers_of
from trundle.adapters.number_columns import NumberColumn, RowAccount
from trundle.adapters.numeral import Numeral, Stamp
from trundle.adapters.table import ColumnName, Rows, Wanted, column_index
from trundle.errors import LogCorrupt, LogSchema, MissingExtra
from trundle.robot.log_mapping import Unit

__all__ = ["ParquetTable"]

BUFFER = 1 << 20  # bytes of a column that are read at a time


class ParquetTable:
    """A Parquet file with columns of numbers; missing values are rows that cannot be read.

    Checksums of its pages are checked where it has them.
    """

    def __init__(self, path: Path) -> None:
        try:
            import pyarrow.parquet
        except ImportError:
            raise MissingExtra("pyarrow", "parquet") from None
        self.path = path
        with path.open("rb") as file, _reading(path):
            schema = pyarrow.parquet.ParquetFile(file).schema_arrow
        self.names: tuple[ColumnName, ...] = tuple(schema.names)
        self._types = list(schema.types)

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """See `Table`."""
        (rows,) = self._rows(wanted, None)
        return rows

    def pieces(self, wanted: Sequence[Wanted], least: int) -> Iterator[Rows]:
        """See `LongTable`."""
        return self._rows(wanted, least)

    def _rows(self, wanted: Sequence[Wanted], least: int | None) -> Iterator[Rows]:
        """So many rows at a time; without a number all at once."""
        places = [column_index(self.path, self.names, want.column) for want in wanted]
        for want, place in zip(wanted, places, strict=True):
            self._require_numbers(want, place)
        names = [str(self.names[place]) for place in places]
        account = RowAccount(self.path, wanted)
        readers = [_Column(want) for want in wanted]
        former: list[NumberColumn] | None = None
        for table in self._tables(list(dict.fromkeys(names)), least):
            if former is not None:
                yield Rows(account.kept(former))
            with _reading(self.path):
                former = [reader.of(table.column(name)) for name, reader in zip(names, readers, strict=True)]
        assert former is not None  # a file without rows is a table without rows
        yield account.last(former)

    def _tables(self, names: list[str], least: int | None) -> Iterator[Any]:
        """Columns of so many rows at a time, decoded page by page; without a number of all rows."""
        import pyarrow as pa
        from pyarrow import parquet

        opened = partial(parquet.ParquetFile, page_checksum_verification=True)
        with self.path.open("rb") as file, _reading(self.path):
            if least is None:
                yield opened(file).read(columns=names)
                return
            content = opened(file, pre_buffer=False, buffer_size=BUFFER)
            batches = content.iter_batches(least, columns=names)
            yield from (pa.Table.from_batches([batch], batch.schema) for batch in batches)
            if not content.metadata.num_rows:
                yield content.read(columns=names)

    def _require_numbers(self, want: Wanted, place: int) -> None:
        from pyarrow import types

        kind = self._types[place]
        stamp = types.is_timestamp(kind) and isinstance(want.numeral, Stamp)
        if not (stamp or types.is_integer(kind) or types.is_floating(kind)):
            raise LogSchema(self.path, "type", f"column {want.column!r} holds {kind}, must be numbers")


class _Column:
    """What is wanted of a column, piece by piece."""

    def __init__(self, want: Wanted) -> None:
        self.want = want
        self.held: Any = None  # the last row, if its value holds

    def of(self, column: Any) -> NumberColumn:
        """Values, which of them are no such numbers, and which are not finite where they must be."""
        from pyarrow import compute, types

        numeral: Numeral = self.want.numeral
        if types.is_timestamp(column.type):
            column, numeral = column.cast("timestamp[ns]").cast("int64"), Stamp(Unit.NS)
        if self.want.hold:
            column = self._filled(column)
        absent = numbers_of(column.is_null().cast("uint8")).astype(bool)
        if absent.any():
            column = compute.fill_null(column, 0)
        numbers = numbers_of(column)
        values, refused = numeral.of_numbers(numbers)
        finite = np.isfinite(numbers)
        return values, absent | (refused & finite), refused & ~finite

    def _filled(self, column: Any) -> Any:
        import pyarrow as pa
        from pyarrow import compute

        before = 0 if self.held is None else 1
        chunks = [*(self.held.chunks if before else ()), *column.chunks]
        column = compute.fill_null_forward(pa.chunked_array(chunks, column.type))
        self.held = column.slice(max(len(column) - 1, 0))
        return column.slice(before)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """What pyarrow complains of, as an error of ours."""
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError, UnicodeError) as error:
        reason = str(error).split("\n", 1)[0]
        raise LogCorrupt(path, "corrupt", f"is not whole as a Parquet file: {reason}") from error
