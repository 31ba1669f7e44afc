"""NumPy archives (`.npz`) of plain numbers. What would have to be unpickled is refused, never loaded."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from trundle.adapters.archive import zip_names
from trundle.adapters.chunk_compression import require_archive_growth
from trundle.adapters.number_columns import kept_rows
from trundle.adapters.table import ColumnName, Rows, Wanted, column_index
from trundle.errors import LogCorrupt, LogError, LogSchema

__all__ = ["NpzTable", "npy_type"]

_Header: TypeAlias = tuple[tuple[int, ...], bool, np.dtype[Any]]
_HEADERS: dict[tuple[int, int], Callable[..., _Header]] = {
    (1, 0): npy.read_array_header_1_0,
    (2, 0): npy.read_array_header_2_0,
}
_SUFFIX = ".npy"


class NpzTable:
    """Arrays with one entry per row; of shape (N, 2), `wheels` is the columns `wheels.0` and `wheels.1`.

    Raises:
        LogError: `unsafe` if an array holds Python objects, `unsafe_path` if a member is no plain file name.
        LogCorrupt: If the archive contradicts itself.
        LogLimit: If it would grow beyond measure.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        members = zip_names(path)
        with zipfile.ZipFile(path) as archive:
            require_archive_growth(
                path, sum(archive.getinfo(name).file_size for name in members), path.stat().st_size
            )
            arrays = {name.removesuffix(_SUFFIX): self._array(archive, name) for name in members}
        self._columns: dict[str, npt.NDArray[Any]] = {}
        for name, array in arrays.items():
            if array.ndim == 1:
                self._columns[name] = array
            elif array.ndim == 2:
                self._columns |= {f"{name}.{place}": column for place, column in enumerate(array.T)}
        self.names: tuple[ColumnName, ...] = tuple(self._columns)

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """See `Table`."""
        names = [str(self.names[column_index(self.path, self.names, want.column)]) for want in wanted]
        columns = [self._columns[name] for name in names]
        for name, column in zip(names, columns, strict=True):
            if column.dtype.kind not in "iuf":
                raise LogSchema(self.path, "type", f"array {name!r} holds {column.dtype}, must be numbers")
            if len(column) != len(columns[0]):
                problem = f"arrays {names[0]!r} and {name!r} have {len(columns[0])} and {len(column)} rows"
                raise LogSchema(self.path, "type", f"{problem}, must be as many")
        if not len(columns[0]):
            raise LogError(self.path, "empty", "holds no row")
        pieces = []
        for want, column in zip(wanted, columns, strict=True):
            values, refused = want.numeral.of_numbers(column)
            finite = np.isfinite(column)
            pieces.append((values, refused & finite, refused & ~finite))
        return kept_rows(self.path, wanted, pieces)

    def _array(self, archive: zipfile.ZipFile, member: str) -> npt.NDArray[Any]:
        try:
            content = archive.read(member)
            file = io.BytesIO(content)
            shape, by_columns, dtype = _header(self.path, member, file)
            values = np.frombuffer(content, dtype, offset=file.tell())
            return values.reshape(shape, order="F" if by_columns else "C")
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            ValueError,
            RuntimeError,
            NotImplementedError,
        ) as error:
            if isinstance(error, LogError):
                raise
            raise LogCorrupt(self.path, "corrupt", f"array {member!r} is not whole: {error}") from error


def npy_type(path: Path) -> np.dtype[Any]:
    """What the array of a `.npy` file holds.

    Raises:
        LogError: `unsafe` if that is Python objects.
        LogCorrupt: If its header says nothing of the kind.
    """
    with path.open("rb") as file:
        try:
            return _header(path, path.name, file)[2]
        except ValueError as error:
            if isinstance(error, LogError):
                raise
            raise LogCorrupt(path, "corrupt", f"is not whole as a NumPy array: {error}") from error


def _header(path: Path, name: str, file: Any) -> _Header:
    version = npy.read_magic(file)
    if version not in _HEADERS:
        raise LogError(path, "format", f"array {name!r} is of NumPy's format {version}; known: 1.0, 2.0")
    shape, by_columns, dtype = _HEADERS[version](file)
    if dtype.hasobject:
        problem = f"array {name!r} holds Python objects: loading them runs whatever code the file names"
        raise LogError(path, "unsafe", f"{problem}; save plain numbers")
    return shape, by_columns, dtype
