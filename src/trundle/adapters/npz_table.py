"""NumPy archives (`.npz`) of plain numbers. What would have to be unpickled is refused, never loaded."""

from __future__ import annotations

import ast
import math
import re
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.archive import zip_names
from trundle.adapters.chunk_compression import require_archive_growth
from trundle.adapters.number_columns import RowAccount
from trundle.adapters.table import ColumnName, Rows, Wanted, column_index
from trundle.errors import LogCorrupt, LogError, LogSchema

__all__ = ["NpzTable", "npy_type"]

_SUFFIX = ".npy"
_MAGIC = b"\x93NUMPY"
_LENGTH_BYTES = {b"\1\0": 2, b"\2\0": 4, b"\3\0": 4}  # of the header's length, by version
_LONGEST_HEADER = 10_000  # as NumPy's own limit
_NUMBERS = re.compile(r"[<>|=]?[iuf][1248]")
_OBJECTS = re.compile(r"'[<>|=]?O\d*'")
_BROKEN = (
    zipfile.BadZipFile, zlib.error, EOFError, ValueError, RuntimeError, NotImplementedError,
    SyntaxError, TypeError, KeyError, MemoryError, RecursionError,
)  # fmt: skip


class _Array(NamedTuple):
    """What a header says."""

    type: str
    by_columns: bool
    shape: tuple[int, ...]


class _Column(NamedTuple):
    """Where a column lies."""

    member: str
    place: int | None


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
            size = sum(archive.getinfo(member).file_size for member in members)
            require_archive_growth(path, size, path.stat().st_size)
            self._arrays = {member: self._header(archive, member) for member in members}
        self._columns: dict[str, _Column] = {}
        for member, array in self._arrays.items():
            name = member.removesuffix(_SUFFIX)
            if len(array.shape) == 1:
                self._columns[name] = _Column(member, None)
            elif len(array.shape) == 2 and array.shape[1] <= array.shape[0]:
                places = range(array.shape[1])
                self._columns |= {f"{name}.{place}": _Column(member, place) for place in places}
        self.names: tuple[ColumnName, ...] = tuple(self._columns)

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """See `Table`."""
        names = [str(self.names[column_index(self.path, self.names, want.column)]) for want in wanted]
        arrays = self._load({self._columns[name].member for name in names})
        pieces = []
        for name, want in zip(names, wanted, strict=True):
            member, place = self._columns[name]
            column = arrays[member] if place is None else arrays[member][:, place]
            values, refused = want.numeral.of_numbers(column)
            finite = np.isfinite(column)
            pieces.append((values, refused & finite, refused & ~finite))
        lengths = {name: len(values) for name, (values, _, _) in zip(names, pieces, strict=True)}
        if len(set(lengths.values())) > 1:
            rows = ", ".join(f"{name!r} {length}" for name, length in lengths.items())
            raise LogSchema(self.path, "type", f"its arrays have different numbers of rows: {rows}")
        return RowAccount(self.path, wanted).last(pieces)

    def _header(self, archive: zipfile.ZipFile, member: str) -> _Array:
        try:
            with archive.open(member) as file:
                return _header(self.path, member, file)
        except _BROKEN as error:
            raise _as_ours(self.path, member, error) from error

    def _load(self, members: set[str]) -> dict[str, npt.NDArray[Any]]:
        with zipfile.ZipFile(self.path) as archive:
            return {member: self._array(archive, member) for member in members}

    def _array(self, archive: zipfile.ZipFile, member: str) -> npt.NDArray[Any]:
        kind, by_columns, shape = self._arrays[member]
        if not _NUMBERS.fullmatch(kind):
            raise LogSchema(self.path, "type", f"array {member!r} holds {kind}, must be numbers")
        try:
            with archive.open(member) as file:
                _header(self.path, member, file)
                values = np.frombuffer(file.read(), kind)
            if len(values) != math.prod(shape):
                raise ValueError(f"{len(values)} numbers where its shape is {shape}")
        except _BROKEN as error:
            raise _as_ours(self.path, member, error) from error
        return values.reshape(shape, order="F" if by_columns else "C")


def npy_type(path: Path) -> str:
    """What the array of a `.npy` file holds, as NumPy writes it.

    Raises:
        LogError: `unsafe` if that is Python objects.
        LogCorrupt: If its header says nothing of the kind.
    """
    with path.open("rb") as file:
        try:
            return _header(path, path.name, file).type
        except _BROKEN as error:
            raise _as_ours(path, path.name, error) from error


def _header(path: Path, name: str, file: IO[bytes]) -> _Array:
    """The header of a `.npy` file, which is a Python literal."""
    start = file.read(8)
    if start[:6] != _MAGIC or start[6:] not in _LENGTH_BYTES:
        raise ValueError(f"begins with {start!r}, must be NumPy's format 1.0 to 3.0")
    length = int.from_bytes(file.read(_LENGTH_BYTES[start[6:]]), "little")
    if length > _LONGEST_HEADER:
        raise ValueError(f"a header of {length} bytes, at most {_LONGEST_HEADER} are allowed")
    about = ast.literal_eval(file.read(length).decode().strip())
    kind, shape = about["descr"], tuple(about["shape"])
    kind = kind if isinstance(kind, str) else repr(kind)
    if _OBJECTS.search(repr(kind) if "'" not in kind else kind):
        problem = f"array {name!r} holds Python objects: loading them runs whatever code the file names"
        raise LogError(path, "unsafe", f"{problem}; save plain numbers")
    if not all(type(side) is int and side >= 0 for side in shape):
        raise ValueError(f"a shape of {shape!r}")
    return _Array(kind, bool(about["fortran_order"]), shape)


def _as_ours(path: Path, member: str, error: BaseException) -> LogError:
    if isinstance(error, LogError):
        return error
    return LogCorrupt(path, "corrupt", f"array {member!r} is not whole: {error}")
