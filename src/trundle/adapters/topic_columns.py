"""Whole columns of one topic's messages: bytes in, arrays out.

Nearly all messages of a topic have one layout: the same names, the same lengths. So the layout of the first
message is found value by value, every further message of that size is checked against it in NumPy (all
lengths equal means all offsets equal), and its columns are taken in one stride. Messages with another layout
form groups of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from trundle.adapters.damage import Damage
from trundle.adapters.message_layout import Layout, Selection, Serialization, Slot
from trundle.adapters.rosmsg import Struct

__all__ = [
    "EARLIEST",
    "LATEST",
    "Column",
    "ColumnDecoder",
    "MessageBatch",
    "TopicColumns",
    "TopicInfo",
    "earliest_behind",
    "rows_of",
]

Column: TypeAlias = (
    npt.NDArray[Any] | list[npt.NDArray[Any]] | str | list[str] | tuple[str, ...] | list[tuple[str, ...]]
)
_Rows: TypeAlias = slice | npt.NDArray[np.int64]  # numbers of messages, in the order of the file
_Matrix: TypeAlias = npt.NDArray[np.uint8]  # one message of the same size per row

MOST_GROUPS = 16  # layouts that are looked for in one batch before its other messages are read one by one
ROWS_COMPARED = 256  # at once: few enough to stay in the cache
MOST_KNOWN = 64  # layouts that are remembered for one size
EARLIEST = int(np.iinfo(np.int64).min)  # [ns]
LATEST = int(np.iinfo(np.int64).max)  # [ns]


@dataclass(frozen=True, slots=True)
class TopicInfo:
    """What a recording holds under one topic.

    Attributes:
        type: Message type in ROS 2 form, such as `sensor_msgs/msg/JointState`, for ROS 1 too.
        count: Number of messages.
        first_ns: Receive time of the first message [ns since 1970], None where there is none.
        last_ns: Receive time of the last message [ns], None where there is none.
    """

    type: str
    count: int
    first_ns: int | None
    last_ns: int | None

    def joined(self, other: TopicInfo) -> TopicInfo:
        """Both together: one topic in two files, or from two senders."""
        stamps = [
            stamp for info in (self, other) for stamp in (info.first_ns, info.last_ns) if stamp is not None
        ]
        return TopicInfo(
            self.type, self.count + other.count, min(stamps, default=None), max(stamps, default=None)
        )


@dataclass(frozen=True, slots=True)
class TopicColumns:
    """Fields of one topic's messages, in the order in which they were received.

    Attributes:
        receive_ns: When the recorder got each message [ns since 1970], shape (N,).
        header_ns: Stamp of each message's std_msgs Header [ns], shape (N,); None where the type has none.
        columns: By field: numbers (N,); arrays (N, k), or a list of N arrays where lengths differ; a string
            as `str` where all messages have the same, else a list of N; an array of strings as a tuple where
            all messages have the same, else a list of N.
    """

    receive_ns: npt.NDArray[np.int64]
    header_ns: npt.NDArray[np.int64] | None
    columns: dict[str, Column]


@dataclass(frozen=True, slots=True)
class MessageBatch:
    """Messages of one topic in one buffer.

    Attributes:
        receive_ns: Receive times [ns], shape (n,).
        buffer: Bytes that hold all of them.
        starts: Where each begins in the buffer, shape (n,).
        sizes: Bytes of each, shape (n,).
        later_ns: No message of the topic behind these in the file was received earlier [ns], as far as the
            file says.
    """

    receive_ns: npt.NDArray[np.int64]
    buffer: npt.NDArray[np.uint8]
    starts: npt.NDArray[np.int64]
    sizes: npt.NDArray[np.int64]
    later_ns: int = EARLIEST


def earliest_behind(first_ns: Iterable[int]) -> list[int]:
    """For each of several parts, the earliest beginning of those behind it; `LATEST` for the last."""
    behind = accumulate(reversed([*first_ns, LATEST]), min)
    return list(behind)[-2::-1]


class ColumnDecoder:
    """Collects batches of one topic and gives their columns.

    Attributes:
        losses: What could not be decoded, one sentence per message.
    """

    def __init__(
        self,
        kind: Struct,
        fields: Sequence[str],
        serialization: Serialization,
        capacity: int = 0,
        before: int = 0,
    ) -> None:
        """Start with no messages.

        Args:
            kind: The message type.
            fields: Dotted paths of what is wanted.
            serialization: How messages became bytes.
            capacity: About how many messages will come.
            before: How many came before these, for what `losses` calls them.

        Raises:
            UnknownField: If a path leads nowhere.
        """
        self._fields = list(dict.fromkeys(fields))
        self._stamp = _stamp_fields(kind)
        self._selection = Selection(kind, list(dict.fromkeys([*self._fields, *self._stamp])))
        self._serialization = serialization
        self._before = before
        self._known: dict[int, list[Layout]] = {}
        self._builders: list[_Numbers | _Texts] = [
            _Numbers(slot, capacity) if slot.code else _Texts(slot) for slot in self._selection.slots
        ]
        self._receive: list[npt.NDArray[np.int64]] = []
        self._count = 0
        self._bad: list[int] = []
        self.losses: list[str] = []

    @property
    def count(self) -> int:
        """How many messages were appended."""
        return self._count

    def append(self, batch: MessageBatch) -> None:
        """Decode a batch. A message that cannot be decoded becomes a loss."""
        if not len(batch.starts):
            return
        self._receive.append(batch.receive_ns)
        begin, self._count = self._count, self._count + len(batch.starts)
        if (batch.sizes == batch.sizes[0]).all():
            self._append_group(batch, slice(begin, self._count), slice(None))
            return
        for size in np.unique(batch.sizes):
            members = np.flatnonzero(batch.sizes == size)
            self._append_group(batch, members + begin, members)

    def finish(self) -> TopicColumns:
        """The columns of everything that was appended, by receive time."""
        receive = np.concatenate([np.empty(0, np.int64), *self._receive])
        order: _Rows = slice(None)
        if self._bad:
            order = np.delete(np.arange(self._count), self._bad)
        times = receive[order]
        if (times[1:] < times[:-1]).any():
            by_time = np.argsort(times, kind="stable")
            order = np.arange(self._count)[order][by_time]
        columns = {builder.slot.path: builder.column(self._count, order) for builder in self._builders}
        header = None
        if self._stamp:
            seconds, nanoseconds = (np.asarray(columns[path]) for path in self._stamp)
            header = seconds.astype(np.int64)
            header *= 1_000_000_000
            header += nanoseconds
        return TopicColumns(receive[order], header, {path: columns[path] for path in self._fields})

    def _append_group(self, batch: MessageBatch, rows: _Rows, members: _Rows) -> None:
        """Take messages of one size, layout by layout, and one by one where there are too many layouts."""
        starts = batch.starts[members]
        matrix = rows_of(batch.buffer, starts, int(batch.sizes[members][0]))
        for _ in range(MOST_GROUPS):
            matrix, rows = self._append_alike(matrix, rows)
            if not len(matrix):
                return
        for row in range(len(matrix)):
            self._append_alike(matrix[row : row + 1], _part(rows, slice(row, row + 1)))

    def _append_alike(self, matrix: _Matrix, rows: _Rows) -> tuple[_Matrix, _Rows]:
        """Take the messages that have the layout of the first one. What is left is returned."""
        first = matrix[0].tobytes()
        try:
            layout = self._layout(first)
        except Damage as damage:
            number = _numbers(rows)[0]
            self._bad.append(number)
            self.losses.append(f"message {self._before + number} {damage}")
            return matrix[1:], _part(rows, slice(1, None))
        if all(_agree(matrix, first, start, stop) for start, stop in layout.spans):
            self._take(layout, matrix, rows, texts_agree=True)
            return matrix[:0], rows
        alike = np.ones(len(matrix), bool)
        for start, stop in layout.guards:
            alike &= (matrix[:, start:stop] == matrix[0, start:stop]).all(axis=1)
        same, others = np.flatnonzero(alike), np.flatnonzero(~alike)
        self._take(layout, matrix[same], _part(rows, same), texts_agree=False)
        return matrix[others], _part(rows, others)

    def _take(self, layout: Layout, matrix: _Matrix, rows: _Rows, *, texts_agree: bool) -> None:
        for builder, places in zip(self._builders, layout.places, strict=True):
            builder.take(matrix, rows, places, layout.byte_order, agree=texts_agree)

    def _layout(self, message: bytes) -> Layout:
        known = self._known.setdefault(len(message), [])
        for layout in known:
            if layout.fits(message):
                return layout
        layout = Layout.of(message, self._selection, self._serialization)
        if len(known) < MOST_KNOWN:
            known.append(layout)
        return layout


class _Numbers:
    """A numeric column that grows, row by row or many at once."""

    def __init__(self, slot: Slot, capacity: int) -> None:
        self.slot = slot
        self.capacity = capacity
        self.width = 1
        self.whole: npt.NDArray[Any] | None = None  # (rows, width), as long as all rows have one width
        self.uneven: dict[int, npt.NDArray[Any]] = {}  # else, by row

    def take(
        self, matrix: _Matrix, rows: _Rows, places: list[tuple[int, int]], byte_order: str, *, agree: bool
    ) -> None:
        del agree
        code = self.slot.code
        stored = np.dtype("u1" if code == "b1" else byte_order + code)
        values = [np.ascontiguousarray(_range(matrix, start, stop)).view(stored) for start, stop in places]
        part = (
            values[0]
            if len(values) == 1
            else np.concatenate([np.empty((len(matrix), 0), stored), *values], axis=1)
        )
        if self.whole is None and not self.uneven:
            self.width = part.shape[1]
            self.whole = np.empty((self.capacity, self.width), code)
        if self.whole is not None and part.shape[1] != self.width:
            self.uneven = dict(enumerate(self.whole))
            self.whole = None
        if self.whole is None:
            numbers = _numbers(rows)
            self.uneven.update(zip(numbers, part.astype(code), strict=True))
            return
        end = rows.stop if isinstance(rows, slice) else int(rows[-1]) + 1
        if end > len(self.whole):
            more = np.empty((max(end, 2 * len(self.whole)), self.width), code)
            more[: len(self.whole)] = self.whole
            self.whole = more
        self.whole[rows] = part

    def column(self, count: int, order: _Rows) -> Column:
        if self.uneven:
            nothing = np.empty(0, self.slot.code)
            return [self.uneven.get(row, nothing) for row in np.arange(count)[order].tolist()]
        width = int(not self.slot.is_array)
        whole = np.empty((0, width), self.slot.code) if self.whole is None else self.whole[:count]
        whole = whole[order]
        return whole if self.slot.is_array else whole[:, 0]


class _Texts:
    """A column of texts, in parts: one value for many rows where they agree."""

    def __init__(self, slot: Slot) -> None:
        self.slot = slot
        self.parts: list[tuple[_Rows, tuple[str, ...]]] = []
        self.known: dict[tuple[bytes, ...], tuple[str, ...]] = {}

    def take(
        self, matrix: _Matrix, rows: _Rows, places: list[tuple[int, int]], byte_order: str, *, agree: bool
    ) -> None:
        del byte_order
        if agree:
            self.parts.append((rows, self._words(matrix[0], places)))
            return
        for number, message in zip(_numbers(rows), matrix, strict=True):
            self.parts.append((slice(number, number + 1), self._words(message, places)))

    def _words(self, message: npt.NDArray[np.uint8], places: list[tuple[int, int]]) -> tuple[str, ...]:
        raw = tuple(message[start:stop].tobytes() for start, stop in places)
        if raw not in self.known:
            self.known[raw] = tuple(word.decode(errors="backslashreplace") for word in raw)
        return self.known[raw]

    def column(self, count: int, order: _Rows) -> Column:
        different = {words for _, words in self.parts}
        if len(different) == 1:
            words = different.pop()
            return words if self.slot.is_array else words[0]
        whole: dict[int, tuple[str, ...]] = {}
        for rows, words in self.parts:
            whole.update(dict.fromkeys(_numbers(rows), words))
        wanted = [whole[row] for row in np.arange(count)[order].tolist()]
        return wanted if self.slot.is_array else [words[0] for words in wanted]


def _stamp_fields(kind: Struct) -> tuple[str, ...]:
    """Paths of seconds and nanoseconds of the type's own std_msgs Header; nothing where it has none."""
    for name, inner in kind.fields.items():
        if isinstance(inner, Struct) and inner.name == "std_msgs/msg/Header":
            return f"{name}.stamp.sec", f"{name}.stamp.nanosec"
    return ()


def _agree(matrix: _Matrix, first: bytes, start: int, stop: int) -> bool:
    """Whether a range holds the same bytes in all rows as in the first."""
    if stop - start in (1, 2, 4, 8):
        words = matrix[:, start:stop].view(f"u{stop - start}")[:, 0]
        return bool((words == words[0]).all())
    expected = first[start:stop] * ROWS_COMPARED
    for row in range(0, len(matrix), ROWS_COMPARED):
        found = _range(matrix[row : row + ROWS_COMPARED], start, stop).tobytes()
        if found != expected[: len(found)]:
            return False
    return True


def _range(matrix: _Matrix, start: int, stop: int) -> npt.NDArray[np.void]:
    """A range of bytes of all rows, each as one item (n, 1): NumPy copies those three times as fast."""
    items: npt.NDArray[np.void] = matrix[:, start:stop].view(f"V{stop - start}")
    return items


def _part(rows: _Rows, chosen: slice | npt.NDArray[np.int64]) -> _Rows:
    """Some of the rows; a slice stays one where it can."""
    if isinstance(rows, slice):
        rows = np.arange(rows.start, rows.stop)
    return rows[chosen]


def _numbers(rows: _Rows) -> list[int]:
    return list(range(rows.start, rows.stop)) if isinstance(rows, slice) else rows.tolist()


def rows_of(buffer: npt.NDArray[np.uint8], starts: npt.NDArray[np.int64], size: int) -> _Matrix:
    """Byte ranges of one size as rows: a view where they lie in one stride, else a copy.

    Raises:
        ValueError: If one reaches beyond the buffer.
    """
    count = len(starts)
    if not size or not count:
        return np.empty((count, size), np.uint8)
    step = int(starts[1] - starts[0]) if count > 1 else 0
    if (np.diff(starts) == step).all():
        return np.ndarray((count, size), np.uint8, buffer, int(starts[0]), (step, 1))
    windows = np.ndarray((len(buffer) - size + 1,), f"V{size}", buffer, 0, (1,))
    return windows[starts].view(np.uint8).reshape(count, size)
