"""Parquet tables, through pyarrow."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.arrow_column import numbers_of
from trundle.adapters.number_columns import Mask, kept_rows
from trundle.adapters.numeral import Numeral, Stamp
from trundle.adapters.table import ColumnName, Rows, Wanted, column_index
from trundle.errors import LogCorrupt, LogError, LogSchema, MissingExtra
from trundle.robot.log_mapping import Unit

__all__ = ["ParquetTable"]


class ParquetTable:
    """A Parquet file with columns of numbers; missing values are rows that cannot be read."""

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
        import pyarrow.parquet

        places = [column_index(self.path, self.names, want.column) for want in wanted]
        for want, place in zip(wanted, places, strict=True):
            self._require_numbers(want, place)
        names = [str(self.names[place]) for place in places]
        with self.path.open("rb") as file, _reading(self.path):
            table = pyarrow.parquet.ParquetFile(file).read(columns=list(dict.fromkeys(names)))
            pieces = [_column(table.column(name), want) for name, want in zip(names, wanted, strict=True)]
        if not table.num_rows:
            raise LogError(self.path, "empty", "holds no row")
        return kept_rows(self.path, wanted, pieces)

    def _require_numbers(self, want: Wanted, place: int) -> None:
        from pyarrow import types

        kind = self._types[place]
        stamp = types.is_timestamp(kind) and isinstance(want.numeral, Stamp)
        if not (stamp or types.is_integer(kind) or types.is_floating(kind)):
            raise LogSchema(self.path, "type", f"column {want.column!r} holds {kind}, must be numbers")


def _column(column: Any, want: Wanted) -> tuple[npt.NDArray[Any], Mask, Mask]:
    """Values, which of them are no such numbers, and which are not finite where they must be."""
    from pyarrow import compute, types

    numeral: Numeral = want.numeral
    if types.is_timestamp(column.type):
        column, numeral = column.cast("timestamp[ns]").cast("int64"), Stamp(Unit.NS)
    if want.hold:
        column = compute.fill_null_forward(column)
    absent = numbers_of(column.is_null().cast("uint8")).astype(bool)
    if absent.any():
        column = compute.fill_null(column, 0)
    numbers = numbers_of(column)
    values, refused = numeral.of_numbers(numbers)
    finite = np.isfinite(numbers)
    return values, absent | (refused & finite), refused & ~finite


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    """What pyarrow complains of, as an error of ours."""
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError, UnicodeError) as error:
        reason = str(error).split("\n", 1)[0]
        raise LogCorrupt(path, "corrupt", f"is not whole as a Parquet file: {reason}") from error
