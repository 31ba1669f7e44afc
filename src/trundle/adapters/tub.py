"""donkeycar's tubs, version 2: folders of JSON records, one per turn of the vehicle's loop."""

from __future__ import annotations

import contextlib
import datetime as dt
import json
import secrets
import shutil
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.adapters.atomic import atomic_path
from trundle.adapters.table import ColumnName, Rows, Wanted, column_index
from trundle.errors import (
    InputError,
    LogCorrupt,
    LogError,
    LogLimit,
    LogSchema,
    LogTruncated,
    OutputError,
    ShapeError,
)

__all__ = ["MANIFEST", "TIME", "Tub", "write_tub"]

Record: TypeAlias = Mapping[str, Any]
Column: TypeAlias = npt.NDArray[np.float64]

MANIFEST = "manifest.json"
TIME = "_timestamp_ms"
NUMBERS = {"float", "int", "boolean"}
LONGEST_LINE = 1 << 20
LONGEST_MANIFEST = 16 << 20
PER_CATALOG = 1000  # records, as donkeycar's default

_Record = msgspec.json.Decoder(dict[str, Any])


class _Sessions(msgspec.Struct):
    all_full_ids: list[str] = []


class _About(msgspec.Struct):
    """Fourth line of a manifest."""

    sessions: _Sessions = msgspec.field(default_factory=_Sessions)


class _Catalogs(msgspec.Struct):
    """Fifth line of a manifest."""

    paths: list[str]
    current_index: int = 0
    deleted_indexes: list[int] = []


class Tub:
    """A tub, as a table whose columns are its channels.

    Records that are marked as deleted do not count. An odometer starts at zero with every session; its
    channel (`.../distance`) goes on from where the last session ended.

    Attributes:
        path: The folder.
        channels: What each channel holds, by name: `float`, `int`, `str`, `image_array`, ...
        names: Names of the columns: the channels, and donkeycar's own `_timestamp_ms` and `_index`.
        sessions: Names of the runs of the vehicle that are in it.

    Raises:
        LogError: If the folder cannot be read, or is no tub.
        LogTruncated: If its manifest ends too early.
        LogCorrupt: If its manifest contradicts itself.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        lines = _manifest(path)
        inputs, types = _json(path, lines[0], list[str]), _json(path, lines[1], list[str])
        if len(inputs) != len(types):
            raise LogCorrupt(path, "corrupt", f"names {len(inputs)} channels of {len(types)} types")
        self.channels = dict(zip(inputs, types, strict=True))
        self.names: tuple[ColumnName, ...] = (*self.channels, TIME, "_index")
        self.sessions = tuple(_json(path, lines[3], _About).sessions.all_full_ids)
        self._catalogs: _Catalogs = _json(path, lines[4], _Catalogs)
        for name in self._catalogs.paths:
            if Path(name).name != name or name in ("", "..") or "\0" in name:
                problem = f"names the catalog {name!r}, must be a file of the tub"
                raise LogCorrupt(path, "unsafe_path", problem)

    def __len__(self) -> int:
        """How many records its manifest counts."""
        return self._catalogs.current_index - len(set(self._catalogs.deleted_indexes))

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """See `Table`."""
        names = [str(self.names[column_index(self.path, self.names, want.column)]) for want in wanted]
        for name in names:
            if self.channels.get(name, "int") not in NUMBERS:
                raise LogSchema(
                    self.path, "type", f"channel {name!r} holds {self.channels[name]}, must be numbers"
                )
        reading, deleted = _Reading(self.path, names, wanted), set(self._catalogs.deleted_indexes)
        missing = []
        for catalog in self._catalogs.paths:
            if not (self.path / catalog).is_file():
                missing.append(catalog)
                continue
            for line in _lines(self.path / catalog):
                reading.take(line, deleted)
        if len(missing) == len(self._catalogs.paths):
            raise LogError(self.path, "empty", "holds none of the catalogs that its manifest names")
        if missing:
            reading.warnings.append(f"{_listed(missing, 'catalog')} of the manifest not there")
        return reading.rows()


class _Reading:
    """One pass over the records of a tub."""

    def __init__(self, path: Path, names: Sequence[str], wanted: Sequence[Wanted]) -> None:
        self.path = path
        self.names = names
        self.wanted = wanted
        self.warnings: list[str] = []
        self._rejected: Counter[str] = Counter()
        self._deleted = 0
        self._rows: list[list[float]] = []
        self._starts: list[int] = []
        self._session: object = None

    def take(self, line: bytes, deleted: Collection[int]) -> None:
        """Take a record, if it can be read and has a number in each channel."""
        try:
            record = _Record.decode(line)
        except (msgspec.DecodeError, RecursionError, UnicodeDecodeError):
            self._rejected["parse"] += 1
            return
        if record.get("_index") in deleted:
            self._deleted += 1
            return
        row: list[Any] = [record.get(name) for name in self.names]
        for place, want in enumerate(self.wanted):
            if want.hold and row[place] is None and self._rows:
                row[place] = self._rows[-1][place]
        if not all(isinstance(value, int | float) for value in row):
            self._rejected["parse"] += 1
            return
        if record.get("_session_id") != self._session:
            self._session = record.get("_session_id")
            self._starts.append(len(self._rows))
        self._rows.append(row)

    def rows(self) -> Rows:
        """What was read.

        Raises:
            LogError: If there is no record.
            LogSchema: If none has a number in each of the channels.
        """
        if not self._rows and not self._rejected:
            raise LogError(self.path, "empty", "holds no record")
        columns, keep = [], np.ones(len(self._rows), dtype=bool)
        for place, want in enumerate(self.wanted):
            values = _numbers([row[place] for row in self._rows])
            if self.names[place].endswith("distance"):
                values = _continued(values, self._starts)
            column, refused = want.numeral.of_numbers(values)
            columns.append(column)
            keep &= ~refused
        self._rejected["time_range"] += int(np.count_nonzero(~keep))
        if not keep.any():
            problem = f"no record holds a number in each of {', '.join(dict.fromkeys(self.names))}"
            raise LogSchema(self.path, "parse", problem)
        return Rows(tuple(column[keep] for column in columns), +self._rejected, tuple(self._account()))

    def _account(self) -> Iterator[str]:
        yield from self.warnings
        if len(self._starts) > 1:
            yield f"{len(self._starts)} sessions are joined: how the car moved between them is not in the tub"
        if self._deleted:
            yield f"{self._deleted} records are marked as deleted"
        if refused := self._rejected.total():
            yield f"{refused} records were left out as unreadable, or without a number in each channel"


def _numbers(values: list[float]) -> npt.NDArray[Any]:
    if all(type(value) is int for value in values):
        with contextlib.suppress(OverflowError):
            return np.array(values, dtype=np.int64)
    return np.array([_as_float(value) for value in values], dtype=np.float64)


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return np.inf if value > 0 else -np.inf


def _continued(distances: npt.NDArray[Any], starts: Sequence[int]) -> Column:
    """Running totals that begin anew at each start, as one that goes on."""
    total = distances.astype(np.float64)
    for start in starts[1:]:
        total[start:] += total[start - 1] - total[start]
    return total


def _manifest(path: Path) -> list[bytes]:
    """Its five lines."""
    try:
        with (path / MANIFEST).open("rb") as file:
            text = file.read(LONGEST_MANIFEST + 1)
    except OSError as error:
        raise LogError(path, "unreadable", f"its {MANIFEST} cannot be read: {error.strerror}") from error
    if len(text) > LONGEST_MANIFEST:
        raise LogLimit(path, "line", f"its {MANIFEST} is longer than {LONGEST_MANIFEST} bytes")
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 5:
        raise LogTruncated(path, "truncated", f"its {MANIFEST} has {len(lines)} lines, must be 5")
    return lines


def _json(path: Path, line: bytes, shape: type[Any]) -> Any:
    try:
        return msgspec.json.decode(line, type=shape)
    except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise LogCorrupt(path, "corrupt", f"its {MANIFEST} is none of donkeycar's: {error}") from None


def _lines(path: Path) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            while line := file.readline(LONGEST_LINE + 1):
                if len(line) > LONGEST_LINE:
                    raise LogLimit(path, "line", f"a record is longer than {LONGEST_LINE} bytes")
                if not line.isspace():
                    yield line
    except OSError as error:
        raise LogError(path, "unreadable", f"cannot be read: {error.strerror or error}") from error


def _listed(names: Sequence[str], what: str) -> str:
    shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
    return f"{len(names)} {what}{'s' if len(names) > 1 else ''} ({shown})"


# --- writing ---------------------------------------------------------------------------------------


def write_tub(
    path: str | Path, time_ns: npt.NDArray[np.int64], channels: Mapping[str, npt.NDArray[Any]]
) -> None:
    """Write channels of numbers as a new tub, which donkeycar reads.

    The folder appears when it is complete.

    Args:
        path: The folder to make.
        time_ns: Stamps [ns], shape (N,); a tub keeps milliseconds.
        channels: One column of N finite numbers per channel.

    Raises:
        InputError: If there is no row, a number is not finite, or two stamps are the same millisecond.
        ShapeError: If a channel has another length than the stamps.
        OutputError: If there is something of that name already, or the folder cannot be written.
    """
    target = Path(path)
    stamps = np.rint(np.asarray(time_ns) / 1e6).astype(np.int64)
    _check(stamps, channels)
    partial = target.with_name(f".trundle-{secrets.token_hex(8)}")
    if target.exists():
        raise OutputError(f"{target}: exists; a tub is written into a folder of its own")
    try:
        partial.mkdir()
        try:
            _write(partial, stamps, channels)
            partial.rename(target)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error.strerror or error}") from error


def _check(stamps: npt.NDArray[np.int64], channels: Mapping[str, npt.NDArray[Any]]) -> None:
    if not len(stamps):
        raise InputError("time_ns: no row to write")
    if (np.diff(stamps) == 0).any():
        raise InputError("time_ns: two rows within one millisecond, which is all that a tub can tell apart")
    for name, values in channels.items():
        if values.shape != stamps.shape:
            raise ShapeError(f"{name}: shape {values.shape}, must be {stamps.shape}")
        if not np.isfinite(values).all():
            raise InputError(f"{name}: every number must be finite")


def _write(folder: Path, stamps: npt.NDArray[np.int64], channels: Mapping[str, npt.NDArray[Any]]) -> None:
    begun = int(stamps[0]) / 1e3
    day = dt.datetime.fromtimestamp(begun, tz=dt.UTC)
    session = f"{day:%y-%m-%d}_0"
    columns = {name: values.tolist() for name, values in channels.items()}
    columns |= {TIME: stamps.tolist(), "_index": list(range(len(stamps)))}
    catalogs = []
    for number, start in enumerate(range(0, len(stamps), PER_CATALOG)):
        rows = zip(*(column[start : start + PER_CATALOG] for column in columns.values()), strict=True)
        records = [dict(zip(columns, row, strict=True)) | {"_session_id": session} for row in rows]
        lines = [json.dumps(record, allow_nan=False, sort_keys=True) + "\n" for record in records]
        catalogs.append(f"catalog_{number}.catalog")
        _put(folder / catalogs[-1], lines)
        about = {"created_at": begun, "line_lengths": [len(line) for line in lines]}
        about |= {"path": f"{catalogs[-1]}_manifest", "start_index": start}
        _put(folder / f"{catalogs[-1]}_manifest", [json.dumps(about, sort_keys=True) + "\n"])
    sessions = {"all_full_ids": [session], "last_id": 0, "last_full_id": session}
    manifest: tuple[Any, ...] = (
        list(channels),
        ["float"] * len(channels),
        {},
        {"created_at": begun, "sessions": sessions},
        {
            "paths": catalogs,
            "current_index": len(stamps),
            "max_len": PER_CATALOG,
            "deleted_indexes": [],
        },
    )
    _put(folder / MANIFEST, [json.dumps(part) + "\n" for part in manifest])


def _put(path: Path, lines: Sequence[str]) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text("".join(lines), encoding="ascii", newline="\n")
