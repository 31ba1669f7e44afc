"""ROS 1 recordings (`.bag`, version 2.0), walked from their beginning, so that an index is never needed.

Source: https://wiki.ros.org/Bags/Format/2.0
"""

from __future__ import annotations

import enum
import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.chunk_compression import decompress, require_growth, require_total_growth
from trundle.adapters.damage import Damage, require_mapped
from trundle.adapters.message_layout import Serialization
from trundle.adapters.rosmsg import Struct, ros2_name, struct_type
from trundle.adapters.topic_columns import MessageBatch, TopicInfo, earliest_behind, rows_of
from trundle.errors import LogCorrupt, LogError, LogSchema, LogTruncated

__all__ = ["MAGIC", "Rosbag1File"]

MAGIC = b"#ROSBAG V2.0\n"

_COMPRESSIONS = {"none": "", "bz2": "bz2", "lz4": "lz4"}
_NS = 1_000_000_000

_TIME = b"\x0d\0\0\0time="  # a header field of eight bytes
_Bytes = npt.NDArray[np.uint8]
_Table = npt.NDArray[np.int64]  # one message per row: receive time, begin of its data, size


class _Kind(enum.IntEnum):
    """What a record is."""

    UNKNOWN = 0
    MESSAGE = 2
    BAG = 3
    INDEX = 4
    CHUNK = 5
    CHUNK_INFO = 6
    CONNECTION = 7

    def __str__(self) -> str:
        return f"the {self.name.lower().replace('_', ' ')} record" if self else "the record"


class _Record(NamedTuple):
    kind: _Kind
    position: int
    header: dict[str, bytes]
    start: int  # of its data
    stop: int


class _Connection(NamedTuple):
    topic: str
    type: str
    text: bytes


@dataclass(frozen=True, slots=True)
class _Presence:
    """What a chunk holds of one connection."""

    count: int
    first_ns: int
    last_ns: int
    index: tuple[int, int] | None  # range of its entries in the file


@dataclass(slots=True)
class _Chunk:
    position: int
    start: int
    stop: int
    size: int
    compression: str
    is_cut: bool = False
    connections: dict[int, _Presence] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"the chunk at byte {self.position}"

    def count(self, numbers: set[int]) -> int:
        """Messages of these connections."""
        return sum(self.connections[number].count for number in numbers & self.connections.keys())

    def first_of(self, numbers: set[int]) -> int:
        """When the first message of these connections was received [ns]."""
        return min(self.connections[number].first_ns for number in numbers & self.connections.keys())


class _Cut(Exception):
    """The file ends inside a record."""

    def __init__(self, position: int) -> None:
        self.position = position


class Rosbag1File:
    """An open ROS 1 bag.

    The format has no checksums, so that damage inside a number cannot be noticed; `warnings` says so.

    Attributes:
        losses: What could not be read, one sentence each; stays empty unless `salvage`.
        warnings: What could not be checked.
    """

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        self.path = path
        self.losses: list[str] = []
        self.warnings = ["unverified: ROS 1 bags carry no checksums"]
        self._salvage = salvage
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._data: _Bytes = np.frombuffer(self._map, np.uint8)
        self._connections: dict[int, _Connection] = {}
        self._chunks: list[_Chunk] = []
        self._index_position = 0
        self._infos: dict[
            int, dict[int, int]
        ] = {}  # by chunk: messages by connection, as the end of the file says
        self._walk()
        self._look_inside()
        self._compare()

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name, with counts and receive times."""
        topics: dict[str, TopicInfo] = {}
        for number, connection in sorted(self._connections.items()):
            here = [chunk.connections[number] for chunk in self._chunks if number in chunk.connections]
            info = TopicInfo(
                ros2_name(connection.type),
                sum(presence.count for presence in here),
                min((presence.first_ns for presence in here), default=None),
                max((presence.last_ns for presence in here), default=None),
            )
            topic = connection.topic
            topics[topic] = info.joined(topics[topic]) if topic in topics else info
        return topics

    def message_type(self, topic: str) -> tuple[Struct, Serialization]:
        """How a topic's messages are made.

        Raises:
            LogSchema: If they are of several types.
        """
        kinds = {(c.type, c.text) for c in self._connections.values() if c.topic == topic}
        if len(kinds) != 1:
            names = ", ".join(sorted(name for name, _ in kinds))
            raise LogSchema(self.path, "schema", f"{topic} holds messages of several types: {names}")
        name, text = kinds.pop()
        kind = struct_type(self.path, name, "ros1msg", text.decode(errors="backslashreplace"))
        return kind, Serialization.ROS1

    def batches(self, topic: str) -> Iterator[MessageBatch]:
        """Messages of a topic, chunk by chunk.

        Raises:
            LogCorrupt: If a chunk contradicts its index.
            LogLimit: If a chunk would grow beyond all measure.
        """
        numbers = {number for number, connection in self._connections.items() if connection.topic == topic}
        chunks = [chunk for chunk in self._chunks if numbers & chunk.connections.keys()]
        self._require_limits(chunks)
        behind = earliest_behind(chunk.first_of(numbers) for chunk in chunks)
        for chunk, later_ns in zip(chunks, behind, strict=True):
            try:
                content = self._content(chunk)
                table = self._table(chunk, content, numbers)
                if len(table) != chunk.count(numbers):
                    raise Damage(f"holds {len(table)} messages where its index says {chunk.count(numbers)}")  # noqa: TRY301
                yield MessageBatch(table[:, 0], content, table[:, 1], table[:, 2], later_ns)
            except (Damage, struct.error) as damage:
                error = LogCorrupt(self.path, "corrupt", f"{chunk} {damage}")
                self._lose(error, f"; {chunk.count(numbers)} messages of {topic} are lost")
            self._release(chunk)

    def close(self) -> None:
        """Let go of the file."""
        self._data = np.empty(0, np.uint8)

    # ------------------------------------------------------------------ chunks

    def _content(self, chunk: _Chunk) -> _Bytes:
        require_mapped(self._map)
        stored = self._data[chunk.start : chunk.stop]
        if chunk.compression:
            raw = decompress(stored, chunk.compression, chunk.size, is_cut=chunk.is_cut)
            return np.frombuffer(raw, np.uint8)
        if len(stored) != chunk.size and not chunk.is_cut:
            raise Damage(f"holds {len(stored)} bytes where it says {chunk.size}")
        return stored

    def _table(self, chunk: _Chunk, content: _Bytes, numbers: set[int]) -> _Table:
        """Messages of some connections: receive time, begin of their data, size."""
        indexed: list[_Table] = []
        for number in numbers & chunk.connections.keys():
            index = chunk.connections[number].index
            if index is not None:
                offsets = self._data[slice(*index)].view("<u4")[2::3]
                table = _indexed(content, np.sort(offsets.astype(np.int64)), number)
                indexed += [] if table is None else [table]
        if len(indexed) == len(numbers & chunk.connections.keys()):
            table = np.concatenate(indexed)
            return table[np.argsort(table[:, 1], kind="stable")]
        found = [entry for number, entry in self._messages(chunk, content) if number in numbers]
        return np.array(found, np.int64).reshape(-1, 3)

    def _messages(self, chunk: _Chunk, content: _Bytes) -> Iterator[tuple[int, tuple[int, int, int]]]:
        """Connection and table row of each message of a chunk. Connections are noted on the way."""
        position, end = 0, len(content)
        while position < end:
            try:
                start, stop = _data_range(content, position)
            except _Cut:
                if chunk.is_cut:
                    return
                raise Damage(f"ends inside a record at {position}") from None
            header = _fields(content[position + 4 : start - 4].tobytes())
            number = self._noted(_Record(_kind(header), position, header, start, stop), content)
            if number is not None:
                seconds, nanoseconds = struct.unpack("<II", header.get("time", b""))
                yield number, (seconds * _NS + nanoseconds, start, stop - start)
            position = stop

    def _noted(self, record: _Record, content: _Bytes) -> int | None:
        """The connection of a message; None for a connection record, which is kept."""
        if record.kind is _Kind.MESSAGE:
            return _number(record.header, "conn")
        if record.kind is not _Kind.CONNECTION:
            raise Damage(f"holds {record.kind} where messages should be")
        self._connect(record, content)
        return None

    def _connect(self, record: _Record, content: _Bytes) -> None:
        about = _fields(content[record.start : record.stop].tobytes())
        if "type" not in about or "message_definition" not in about:
            raise Damage("holds a connection without a type")
        topic = record.header.get("topic", b"").decode(errors="backslashreplace")
        name = about["type"].decode(errors="backslashreplace")
        new = _Connection(topic, name, about["message_definition"])
        if self._connections.setdefault(_number(record.header, "conn"), new) != new:
            raise Damage(f"defines the connection of {topic} again, otherwise than before")

    def _require_limits(self, chunks: list[_Chunk]) -> None:
        compressed = [chunk for chunk in chunks if chunk.compression]
        for chunk in compressed:
            require_growth(self.path, chunk, chunk.stop - chunk.start, chunk.size)
        require_total_growth(self.path, (chunk.size for chunk in compressed), len(self._data))

    # ------------------------------------------------------------------ the walk

    def _walk(self) -> None:
        """Find all chunks, connections and indexes."""
        position, kind = len(MAGIC), _Kind.UNKNOWN
        try:
            while position < len(self._data):
                kind = _Kind.UNKNOWN
                start, stop = _data_range(self._data, position, may_be_cut=True)
                header = _fields(self._data[position + 4 : start - 4].tobytes())
                kind = _kind(header)
                if stop > len(self._data):
                    break
                self._take(_Record(kind, position, header, start, stop))
                position = stop
            if not self._index_position or position < max(self._index_position, len(self._data)):
                self._cut_at(position, kind)
        except _Cut:
            self._cut_at(position, kind)
        except (Damage, struct.error) as damage:
            error = LogCorrupt(self.path, "corrupt", f"{kind} at byte {position} {damage}")
            self._lose(error, "; what lies behind it is lost")

    def _take(self, record: _Record) -> None:
        match record.kind:
            case _Kind.BAG:
                if record.header.get("encryptor"):
                    raise LogError(self.path, "format", "is encrypted")
                (self._index_position,) = struct.unpack("<Q", record.header.get("index_pos", b""))
            case _Kind.CHUNK:
                for former in self._chunks[-1:]:  # whose index has been read as well by now
                    self._release(former)
                self._chunks.append(_chunk(record))
            case _Kind.INDEX:
                self._take_index(record)
            case _Kind.CONNECTION:
                self._connect(record, self._data)
            case _Kind.CHUNK_INFO:
                self._take_info(record)
            case _:
                raise Damage("stands outside of a chunk")

    def _take_index(self, record: _Record) -> None:
        count, number = _number(record.header, "count"), _number(record.header, "conn")
        if record.stop - record.start != 12 * count or not self._chunks:
            raise Damage(f"holds {record.stop - record.start} bytes for {count} messages")
        if number in self._chunks[-1].connections:
            raise Damage(f"is a second index of connection {number}")
        if count:
            times = self._data[record.start : record.stop].view("<u4").reshape(count, 3).astype(np.int64)
            stamps = times[:, 0] * _NS + times[:, 1]
            place = record.start, record.stop
            presence = _Presence(count, int(stamps.min()), int(stamps.max()), place)
            self._chunks[-1].connections[number] = presence

    def _take_info(self, record: _Record) -> None:
        (position,) = struct.unpack("<Q", record.header.get("chunk_pos", b""))
        if record.stop - record.start != 8 * _number(record.header, "count"):
            raise Damage("holds counts of another length than it says")
        pairs = self._data[record.start : record.stop].view("<u4").reshape(-1, 2)
        self._infos[position] = {int(number): int(count) for number, count in pairs if count}

    def _look_inside(self) -> None:
        """Read the chunks that have no index, or messages of connections that are defined nowhere else."""
        self._require_limits([chunk for chunk in self._chunks if not chunk.connections])
        for chunk in list(self._chunks):
            if chunk.connections and chunk.connections.keys() <= self._connections.keys():
                continue
            self._require_limits([chunk])
            try:
                self._note_connections(chunk)
                self._release(chunk)
            except (Damage, struct.error) as damage:
                error = LogCorrupt(self.path, "corrupt", f"{chunk} {damage}")
                self._lose(error, "; its messages are lost")
                self._chunks.remove(chunk)

    def _note_connections(self, chunk: _Chunk) -> None:
        times: dict[int, list[int]] = {}
        for number, (time, _, _) in self._messages(chunk, self._content(chunk)):
            times.setdefault(number, []).append(time)
        if not chunk.connections:
            for number, stamps in times.items():
                chunk.connections[number] = _Presence(len(stamps), min(stamps), max(stamps), None)
        unknown = chunk.connections.keys() - self._connections.keys()
        if unknown:
            raise Damage(f"holds messages of connection {min(unknown)}, which is defined nowhere")

    def _compare(self) -> None:
        """What was found against what the end of the file says."""
        if self.losses:
            return
        found = {
            chunk.position: {number: presence.count for number, presence in chunk.connections.items()}
            for chunk in self._chunks
        }
        if self._infos != found:
            position = min(p for p in {*found, *self._infos} if found.get(p) != self._infos.get(p))
            if position in found and position not in self._infos:
                self.warnings.append("unverified: the index at the end is not whole")
                return
            problem = f"the chunk at byte {position} holds other messages than the index at the end says"
            self._lose(LogCorrupt(self.path, "corrupt", problem), "")

    # ------------------------------------------------------------------ damage

    def _cut_at(self, position: int, kind: _Kind) -> None:
        size = len(self._data)
        if self._index_position and position >= self._index_position:
            self.warnings.append(f"unverified: ends at byte {size}, inside its index; all data lie before it")
            return
        where = f"inside {kind} that begins at byte {position}" if position < size else "before its index"
        here = [presence for chunk in self._chunks for presence in chunk.connections.values()]
        last = max((presence.last_ns for presence in here), default=0)
        until = (
            f"chunks before it reach until {last // _NS}.{last % _NS:09d} s"
            if last
            else "no chunk before it is whole"
        )
        error = LogTruncated(self.path, "truncated", f"ends at byte {size}, {where}; {until}")
        kept = "; what is whole of it is kept" if kind is _Kind.CHUNK and position < size else ""
        self._lose(error, f"{kept}; what came behind is lost")
        if kind is _Kind.CHUNK and position < size:
            start, _ = _data_range(self._data, position, may_be_cut=True)
            header = _fields(self._data[position + 4 : start - 4].tobytes())
            try:
                chunk = _chunk(_Record(kind, position, header, start, size))
            except (Damage, struct.error):
                return
            chunk.is_cut = True
            self._chunks.append(chunk)

    def _release(self, chunk: _Chunk) -> None:
        """Let go of pages that were read, so that memory does not grow with the file."""
        if hasattr(self._map, "madvise"):
            start = chunk.start - chunk.start % mmap.PAGESIZE
            indexes = [presence.index[1] for presence in chunk.connections.values() if presence.index]
            self._map.madvise(mmap.MADV_DONTNEED, start, max([chunk.stop, *indexes]) - start)

    def _lose(self, error: LogError, consequence: str) -> None:
        """Raise the error, or note the loss where salvage was asked for."""
        if not self._salvage:
            raise error from None
        self.losses.append(f"{error.problem}{consequence}")


def _indexed(content: _Bytes, offsets: npt.NDArray[np.int64], number: int) -> _Table | None:
    """Table of a connection's messages at these ascending offsets; None where there are others.

    Headers of one connection differ in their time only, and that has its place.
    """
    if offsets[-1] + 8 > len(content):
        return None
    try:
        start, _ = _data_range(content, int(offsets[0]), may_be_cut=True)
    except _Cut:
        return None
    size = start - int(offsets[0])
    if offsets[-1] + size > len(content):
        return None
    first = content[offsets[0] : start].tobytes()
    header, time = _fields(first[4:-4]), first.find(_TIME) + len(_TIME)
    if _kind(header) is not _Kind.MESSAGE or _number(header, "conn") != number or first.count(_TIME) != 1:
        return None
    rows = rows_of(content, offsets, size)
    if (rows[:, :time] != rows[0, :time]).any() or (rows[:, time + 8 : -4] != rows[0, time + 8 : -4]).any():
        return None
    stamps = rows[:, time : time + 8].copy().view("<u4").astype(np.int64)
    starts, sizes = offsets + size, rows[:, -4:].copy().view("<u4")[:, 0].astype(np.int64)
    if starts[-1] + sizes[-1] > len(content) or (starts[:-1] + sizes[:-1] > offsets[1:]).any():
        return None
    return np.column_stack([stamps[:, 0] * _NS + stamps[:, 1], starts, sizes])


def _chunk(record: _Record) -> _Chunk:
    compression = record.header.get("compression", b"").decode(errors="backslashreplace")
    if compression not in _COMPRESSIONS:
        raise Damage(f"is compressed as {compression!r}; known are {', '.join(_COMPRESSIONS)}")
    size = _number(record.header, "size")
    return _Chunk(record.position, record.start, record.stop, size, _COMPRESSIONS[compression])


def _data_range(content: _Bytes, position: int, *, may_be_cut: bool = False) -> tuple[int, int]:
    """Where the data of the record at a position begin and end."""
    lengths = []
    for _ in ("header", "data"):
        if position + 4 > len(content):
            raise _Cut(position)
        lengths.append(struct.unpack_from("<I", content.data, position)[0])
        position += 4 + lengths[-1]
    if position > len(content) and not may_be_cut:
        raise _Cut(position)
    return position - lengths[-1], position


def _fields(header: bytes) -> dict[str, bytes]:
    """Fields of a header: each a length, and `name=value`."""
    fields: dict[str, bytes] = {}
    position = 0
    while position < len(header):
        if position + 4 > len(header):
            raise Damage("has a header that ends inside a field")
        (length,) = struct.unpack_from("<I", header, position)
        name, separator, value = header[position + 4 : position + 4 + length].partition(b"=")
        position += 4 + length
        if position > len(header) or not separator:
            raise Damage("has a header field that is no `name=value`")
        fields[name.decode(errors="backslashreplace")] = value
    return fields


def _kind(header: dict[str, bytes]) -> _Kind:
    op = header.get("op", b"")
    if len(op) != 1 or op[0] not in list(_Kind)[1:]:
        raise Damage(f"is of unknown kind {op!r}")
    return _Kind(op[0])


def _number(header: dict[str, bytes], name: str) -> int:
    if len(header.get(name, b"")) != 4:
        raise Damage(f"has no {name!r} in its header")
    number: int = struct.unpack("<I", header[name])[0]
    return number
