"""WPILOG data logs, of robots of the FIRST Robotics Competition (FRC): entries as topics.

An entry has one type. A plain number is the field `value`; numbers in an array are `value.0`, `value.1`, ...;
a struct's members are `translation.x`, and in an array of structs `speed.0` or `speed` with an element's
number. Whatever was logged is stamped once, so a topic's header stamps are its receive times.

The format has no checksums: what is checked is that all records, entries and sizes fit together.
"""

from __future__ import annotations

import mmap
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from trundle.adapters.content import content_of
from trundle.adapters.damage import Damage, require_mapped
from trundle.adapters.topic_columns import Column, TopicColumns, TopicInfo, rows_of
from trundle.adapters.wpilog_records import HEADER, MAGIC, VERSION, Start, control_of, walk
from trundle.adapters.wpilog_struct import UnknownStruct, dtype_of
from trundle.errors import LogCorrupt, LogError, LogSchema, LogTruncated, listed, no_such

__all__ = ["WpilogFile", "open_wpilog"]

LONGEST_DISORDER_NS = 1_000_000_000  # by which records may be out of order

_NUMBERS = {"boolean": "?", "int64": "<i8", "float": "<f4", "double": "<f8"}
_SCHEMA = "/.schema/struct:"

Numbers = npt.NDArray[np.int64]


class _Span(NamedTuple):
    """From where to where in the log a number means an entry."""

    start: Start
    first: int  # number of its first record, among all
    stop: int


class WpilogFile:
    """An open data log, for a `with` block.

    Attributes:
        path: The file.
        topics: Its entries by name, with their types as WPILib writes them: `double`, `struct:Pose2d[]`.
        losses: What could not be read, one sentence each. Stays empty unless opened with `salvage`.
        warnings: What a person should know, one sentence each.
        metadata: What the log says about its entries, by name.
    """

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        self.path = path
        self.topics: dict[str, TopicInfo] = {}
        self.losses: list[str] = []
        self.warnings: list[str] = []
        self.metadata: dict[str, str] = {}
        self._salvage = salvage
        with ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._data = np.frombuffer(self._map, np.uint8)
        self._index = walk(self._data, self._first_record())
        self._end = len(self._index.entries)
        self._spans = self._find_spans()
        self._members = self._find_members()
        self._check_end()
        self._schemas: dict[str, str] | None = None
        for name, members in self._members.items():
            stamps = self._index.time_ns[members]
            first, last = (int(stamps.min()), int(stamps.max())) if len(stamps) else (None, None)
            self.topics[name] = TopicInfo(self._spans[name][0].start.type, len(stamps), first, last)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._data = np.empty(0, np.uint8)

    def read(self, topic: str, fields: Sequence[str]) -> TopicColumns:
        """Columns of the named fields of an entry's values.

        Args:
            topic: Name of the entry.
            fields: `value`, `value.0`, `translation.x`, `speed.0`, ...

        Raises:
            LogSchema: If entry or field does not exist, or is of a type that holds no numbers.
            LogError: If its times go back by more than a second (`unsorted`), unless `salvage`.
        """
        if topic not in self.topics:
            raise LogSchema(self.path, "topic", no_such("topic", topic, sorted(self.topics)))
        members = self._in_order(topic)
        stamps = self._index.time_ns[members]
        parts = self._values(topic, members)
        columns = {field: self._column(topic, field, parts, len(members)) for field in fields}
        return TopicColumns(stamps, stamps, columns)

    # ------------------------------------------------------------------ values

    def _in_order(self, topic: str) -> Numbers:
        """The records of an entry, by time."""
        members = self._members[topic]
        stamps = self._index.time_ns[members]
        steps = np.diff(stamps)
        if not (steps < 0).any():
            return members
        back = int((np.maximum.accumulate(stamps) - stamps).max())
        if back > LONGEST_DISORDER_NS:
            problem = f"{topic}: its times go back by {back * 1e-9:.3g} s: the robot's clock started anew"
            if not self._salvage:
                raise LogError(self.path, "unsorted", problem)
            self.losses.append(f"{problem}; its values were sorted")
        return members[np.argsort(stamps, kind="stable")]

    def _values(self, topic: str, members: Numbers) -> list[tuple[Numbers, npt.NDArray[Any]]]:
        """An entry's values as arrays (n, elements), one for each number of elements, and which they are."""
        try:
            require_mapped(self._map)
        except Damage as damage:
            raise LogTruncated(self.path, "truncated", str(damage)) from None
        kind, _ = self._dtype(topic)
        starts, sizes = self._index.starts[members], self._index.sizes[members]
        parts = []
        for size in np.unique(sizes):
            rows = np.flatnonzero(sizes == size)
            matrix = rows_of(self._data, starts[rows], int(size))
            if matrix.strides[-1] != 1 or not matrix.flags.c_contiguous:
                matrix = np.ascontiguousarray(matrix)
            parts.append((rows, matrix.view(kind).reshape(len(rows), int(size) // kind.itemsize)))
        return parts

    def _dtype(self, topic: str) -> tuple[np.dtype[Any], bool]:
        """Type of one element of an entry, and whether its values are arrays of them."""
        name = self.topics[topic].type
        element = name.removesuffix("[]")
        if element in _NUMBERS:
            return np.dtype(_NUMBERS[element]), name != element
        if not element.startswith("struct:"):
            known = ", ".join(_NUMBERS)
            raise LogSchema(
                self.path, "type", f"{topic} is {name}, must be one of {known}, struct:..., or an array"
            )
        try:
            kind = dtype_of(element.removeprefix("struct:"), self.schemas)
        except UnknownStruct as error:
            raise LogSchema(self.path, "schema", f"{topic}: {error}") from None
        wrong = np.flatnonzero(self._misfits(self._members[topic], kind.itemsize, is_array=name != element))
        if wrong.size:
            bad = self._members[topic][wrong[0]]
            raise LogCorrupt(
                self.path,
                "corrupt",
                f"the record at byte {self._index.positions[bad]} gives {topic} "
                f"{self._index.sizes[bad]} bytes; {name} has {kind.itemsize}",
            )
        return kind, name != element

    @property
    def schemas(self) -> dict[str, str]:
        """Schemas of structs by name, as the log holds them."""
        if self._schemas is None:
            self._schemas = {}
            for name, members in self._members.items():
                _, found, struct = name.partition(_SCHEMA)
                if found and len(members):
                    content = self._content(int(members[-1]))
                    self._schemas[struct] = content.decode(errors="backslashreplace")
        return self._schemas

    def _column(
        self, topic: str, field: str, parts: list[tuple[Numbers, npt.NDArray[Any]]], count: int
    ) -> Column:
        """One field of all values: (n,), or (n, k) of arrays, or a list of arrays of several lengths."""
        _, is_array = self._dtype(topic)
        taken = [(rows, self._member(topic, field, values)) for rows, values in parts]
        if not is_array or all(values.ndim == 1 for _, values in taken):
            taken = [(rows, values[:, 0] if values.ndim > 1 else values) for rows, values in taken]
        if not taken:
            return np.empty(0)
        first = taken[0][1]
        if all(values.shape[1:] == first.shape[1:] for _, values in taken):
            kind = np.result_type(*(values.dtype for _, values in taken))
            column = np.zeros((count, *first.shape[1:]), kind)
            for rows, values in taken:
                column[rows] = values
            return column
        uneven: list[npt.NDArray[Any]] = [first[0]] * count
        for rows, values in taken:
            for row, value in zip(rows.tolist(), values, strict=True):
                uneven[row] = value
        return uneven

    def _member(self, topic: str, field: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A field of values (n, elements): (n, elements), (n, elements, k), or (n,) of a single element."""
        parts = field.split(".")
        element = int(parts.pop()) if parts[-1].isdecimal() and parts[-1].isascii() else None
        if values.dtype.names is None and parts == ["value"]:
            parts = []
        for part in parts:
            if values.dtype.names is None or part not in values.dtype.names:
                fields = listed(_leaves(values.dtype) or ["value"], like=field)
                raise LogSchema(self.path, "field", f"{topic} has no field {field!r}; it has {fields}")
            values = values[part]
        if values.dtype.names is not None:
            fields = listed(_leaves(values.dtype, ".".join(parts)), like=field)
            raise LogSchema(self.path, "field", f"{topic}: {field!r} is a whole struct; it has {fields}")
        if values.ndim > 2:
            values = values.reshape(len(values), -1)
        if element is None:
            return values
        if element < values.shape[1]:
            return values[:, element]
        return np.full(len(values), np.nan)

    # ------------------------------------------------------------------ entries

    def _first_record(self) -> int:
        """Where the records begin."""
        size = len(self._data)
        if self._data[: len(MAGIC)].tobytes() != MAGIC[:size]:
            raise LogError(self.path, "format", "does not begin as WPILOG does")
        if size < HEADER.size:
            raise LogTruncated(self.path, "truncated", f"ends at byte {size}, inside its header")
        _, version, extra = HEADER.unpack_from(self._data.data)
        if version >> 8 != VERSION >> 8:
            major, minor = divmod(version, 256)
            raise LogError(self.path, "format", f"is WPILOG {major}.{minor}, must be 1.0")
        if HEADER.size + extra > size:
            raise LogTruncated(self.path, "truncated", f"ends at byte {size}, inside its header")
        return HEADER.size + int(extra)

    def _find_spans(self) -> dict[str, list[_Span]]:
        """By name, in which parts of the log which number means the entry."""
        running: dict[int, tuple[Start, int]] = {}
        spans: dict[str, list[_Span]] = {}

        def close(number: int, stop: int) -> None:
            start, first = running.pop(number)
            spans.setdefault(start.name, []).append(_Span(start, first, stop))

        for at in np.flatnonzero(self._index.entries == 0).tolist():
            try:
                control = control_of(self._content(at))
                if isinstance(control, Start):
                    self._require_same_type(control, running, spans)
            except Damage as damage:
                self._break_off(at, str(damage))
                break
            # A finished entry may still get values from another thread; a number is free with the next start.
            if isinstance(control, Start):
                if control.entry in running:
                    close(control.entry, at)
                running[control.entry] = control, at
                self.metadata[control.name] = control.metadata
        for number in list(running):
            close(number, self._end)
        return spans

    def _require_same_type(
        self, new: Start, running: dict[int, tuple[Start, int]], spans: dict[str, list[_Span]]
    ) -> None:
        before = [span.start for span in spans.get(new.name, ())]
        before += [start for start, _ in running.values() if start.name == new.name]
        if any(start.type != new.type for start in before):
            raise Damage(f"starts {new.name!r} anew as {new.type!r}, which was {before[0].type!r}")

    def _find_members(self) -> dict[str, Numbers]:
        """By name, which records hold an entry's values."""
        entries = self._index.entries[: self._end]
        order = np.argsort(entries, kind="stable")
        numbers, firsts = np.unique(entries[order], return_index=True)
        stops = [*firsts[1:].tolist(), len(order)]
        of_number = {
            number: order[first:stop]
            for number, first, stop in zip(numbers.tolist(), firsts.tolist(), stops, strict=False)
        }
        nothing = np.empty(0, np.int64)
        of_number.pop(0, None)
        known = np.zeros(len(entries), dtype=bool)
        known[entries == 0] = True
        members: dict[str, Numbers] = {}
        bad = self._end
        for name, spans in self._spans.items():
            found = [nothing]
            for span in spans:
                own = of_number.get(span.start.entry, nothing)
                own = own[np.searchsorted(own, span.first) : np.searchsorted(own, span.stop)]
                known[own] = True
                found.append(own)
            members[name] = np.sort(np.concatenate(found))
            element = spans[0].start.type.removesuffix("[]")
            if element in _NUMBERS:
                is_array = element != spans[0].start.type
                size = np.dtype(_NUMBERS[element]).itemsize
                wrong = members[name][self._misfits(members[name], size, is_array=is_array)]
                bad = min(bad, *wrong[:1].tolist(), self._end)
        strange = np.flatnonzero(~known)
        if strange.size and strange[0] <= bad:
            self._break_off(int(strange[0]), f"is of entry {entries[strange[0]]}, which was never started")
        elif bad < self._end:
            self._break_off(bad, f"has {self._index.sizes[bad]} bytes, which its entry cannot have")
        return {name: found[found < self._end] for name, found in members.items()}

    def _misfits(self, members: Numbers, size: int, *, is_array: bool) -> npt.NDArray[np.bool_]:
        """Which of an entry's records have a size that its type cannot have."""
        sizes = self._index.sizes[members]
        misfits: npt.NDArray[np.bool_] = sizes % size != 0 if is_array else sizes != size
        return misfits

    def _content(self, record: int) -> bytes:
        start = int(self._index.starts[record])
        return self._data[start : start + int(self._index.sizes[record])].tobytes()

    # ------------------------------------------------------------------ damage

    def _break_off(self, record: int, problem: str) -> None:
        """Where one record is wrong, nothing says that the next ones are read at the right place."""
        position = int(self._index.positions[record])
        problem = f"the record at byte {position} {problem}"
        if not self._salvage:
            raise LogCorrupt(self.path, "corrupt", problem)
        self.losses.append(f"{problem}; what lies behind it is lost")
        self._end = record

    def _check_end(self) -> None:
        index = self._index
        if not index.problem or self._end < len(index.entries):
            return
        last = int(index.time_ns.max(initial=0)) * 1e-9
        if index.problem == "is cut":
            problem = (
                f"ends at byte {len(self._data)}, inside the record that begins at byte {index.end}; "
                f"records before it reach until {last:.6f} s"
            )
            error: LogError = LogTruncated(self.path, "truncated", problem)
        else:
            error = LogCorrupt(self.path, "corrupt", f"the record at byte {index.end} {index.problem}")
        if not self._salvage:
            raise error
        self.losses.append(f"{error.problem}; what lies behind is lost")


def open_wpilog(path: str | Path, *, salvage: bool = False) -> WpilogFile:
    """Open a data log.

    Args:
        path: The file.
        salvage: Read what can be read of a damaged log; `losses` then says what could not.

    Raises:
        LogError: If there is no such file, it is empty, or no WPILOG 1.
        LogTruncated: If it ends too early, as where a robot loses its power.
        LogCorrupt: If its bytes contradict themselves.
    """
    content_of(path)
    return WpilogFile(Path(path), salvage=salvage)


def _leaves(kind: np.dtype[Any], above: str = "") -> list[str]:
    """Dotted paths of all numbers in a struct."""
    if kind.base.names is None:
        return [above] if above else []
    paths = []
    for name in kind.base.names:
        paths += _leaves(kind.base[name], f"{above}.{name}" if above else name)
    return paths
