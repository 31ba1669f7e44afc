"""MCAP recordings, every byte of which is checked as far as the file allows.

The file is walked from its beginning, record by record and chunk by chunk, so that what the index at its end
says is never needed, only compared. Chunks are decompressed where a topic is read that they hold.

Source: https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import mmap
import struct
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from zlib_ng.zlib_ng import crc32

from trundle.adapters.chunk_compression import decompress, require_growth, require_total_growth
from trundle.adapters.damage import Damage, require_mapped
from trundle.adapters.mcap_records import (
    HEAD,
    MESSAGE_FIELDS,
    PREFIX,
    Cut,
    Kind,
    Record,
    RecordFields,
    gaps_between,
    message_heads,
    records_in,
    run_of,
)
from trundle.adapters.message_layout import Serialization
from trundle.adapters.rosmsg import Struct, ros2_name, struct_type
from trundle.adapters.topic_columns import MessageBatch, TopicInfo, earliest_behind
from trundle.errors import LogCorrupt, LogError, LogSchema, LogTruncated

__all__ = ["MAGIC", "McapFile"]

MAGIC = b"\x89MCAP0\r\n"
FOOTER_SIZE = PREFIX.size + 20

CHUNKS_AHEAD = 2  # that a thread decompresses and checks while one is decoded
LOOSE_SECTION = 4 << 20  # bytes of messages outside chunks that are taken together

_ENCODINGS = {"cdr": Serialization.CDR, "ros1": Serialization.ROS1}
_ONLY_IN_DATA = {Kind.MESSAGE, Kind.CHUNK, Kind.MESSAGE_INDEX, Kind.ATTACHMENT, Kind.METADATA}
_ONLY_IN_SUMMARY = {
    Kind.CHUNK_INDEX,
    Kind.ATTACHMENT_INDEX,
    Kind.STATISTICS,
    Kind.METADATA_INDEX,
    Kind.SUMMARY_OFFSET,
}

_Bytes = npt.NDArray[np.uint8]
_Offsets = npt.NDArray[np.int64]


class _Schema(NamedTuple):
    name: str
    encoding: str
    text: bytes


class _Channel(NamedTuple):
    schema: int
    topic: str
    encoding: str


@dataclass(frozen=True, slots=True)
class _Presence:
    """What a chunk holds of one channel."""

    count: int
    first_ns: int
    last_ns: int
    index: tuple[int, int] | None  # range of its offsets in the file


@dataclass(slots=True)
class _Chunk:
    """Where a chunk lies, or a run of messages outside chunks."""

    position: int
    start: int
    stop: int
    size: int  # of its content
    stored: int  # bytes that hold it
    crc: int = 0
    compression: str = ""
    first_ns: int = 0
    last_ns: int = 0
    is_cut: bool = False
    is_loose: bool = False
    channels: dict[int, _Presence] = field(default_factory=dict)

    def __str__(self) -> str:
        if self.is_loose:
            return f"the run of messages at byte {self.position}"
        return f"the chunk at byte {self.position} ({_seconds(self.first_ns)} to {_seconds(self.last_ns)} s)"

    def count(self, channels: set[int]) -> int:
        """Messages of these channels."""
        return sum(self.channels[number].count for number in channels & self.channels.keys())

    def first_of(self, channels: set[int]) -> int:
        """When the first message of these channels was received [ns]."""
        return min(self.channels[number].first_ns for number in channels & self.channels.keys())


class McapFile:
    """An open MCAP file.

    Attributes:
        losses: What could not be read, one sentence each; stays empty unless `salvage`.
        warnings: What could not be checked.
    """

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        self.path = path
        self.losses: list[str] = []
        self.warnings: list[str] = []
        self._salvage = salvage
        with path.open("rb") as file:
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._data: _Bytes = np.frombuffer(self._map, np.uint8)
        self._schemas: dict[int, _Schema] = {}
        self._channels: dict[int, _Channel] = {}
        self._chunks: list[_Chunk] = []
        self._counts: dict[int, int] = {}  # messages by channel, as the statistics say
        self._indexed: set[int] = set()  # where chunks begin, as the index says
        self._summary = 0  # where it begins; 0 as long as the end of the data was not met
        self._walk()
        self._look_inside()
        self._compare()

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name, with counts and receive times."""
        topics: dict[str, TopicInfo] = {}
        for number, channel in sorted(self._channels.items()):
            here = [chunk.channels[number] for chunk in self._chunks if number in chunk.channels]
            schema = self._schemas.get(channel.schema)
            info = TopicInfo(
                ros2_name(schema.name if schema else ""),
                sum(presence.count for presence in here),
                min((presence.first_ns for presence in here), default=None),
                max((presence.last_ns for presence in here), default=None),
            )
            topics[channel.topic] = info.joined(topics[channel.topic]) if channel.topic in topics else info
        return topics

    def message_type(self, topic: str) -> tuple[Struct, Serialization]:
        """How a topic's messages are made.

        Raises:
            LogSchema: If they are no ROS messages, or of several types.
        """
        channels = [channel for channel in self._channels.values() if channel.topic == topic]
        kinds = {(self._schemas.get(channel.schema), channel.encoding) for channel in channels}
        if len(kinds) != 1:
            types = ", ".join(sorted(schema.name if schema else "no type" for schema, _ in kinds))
            raise LogSchema(self.path, "schema", f"{topic} holds messages of several types: {types}")
        schema, encoding = kinds.pop()
        if schema is None or encoding not in _ENCODINGS:
            allowed = ", ".join(_ENCODINGS)
            raise LogSchema(self.path, "schema", f"{topic} is encoded as {encoding!r}; allowed: {allowed}")
        text = schema.text.decode(errors="backslashreplace")
        return struct_type(self.path, schema.name, schema.encoding, text), _ENCODINGS[encoding]

    def close(self) -> None:
        """Let go of the file."""
        self._data = np.empty(0, np.uint8)

    # ------------------------------------------------------------------ messages

    def batches(self, topic: str) -> Iterator[MessageBatch]:
        """Messages of a topic, chunk by chunk.

        Raises:
            LogCorrupt: If a chunk contradicts its checksum or its index.
            LogLimit: If a chunk would grow beyond all measure.
        """
        numbers = {number for number, channel in self._channels.items() if channel.topic == topic}
        chunks = [chunk for chunk in self._chunks if numbers & chunk.channels.keys()]
        self._require_limits(chunks)
        behind = earliest_behind(chunk.first_of(numbers) for chunk in chunks)
        for (chunk, content_of), later_ns in zip(self._prepared(chunks), behind, strict=True):
            try:
                content = content_of()
                yield replace(self._batch(chunk, content, numbers), later_ns=later_ns)
            except Damage as damage:
                error = LogCorrupt(self.path, "corrupt", f"{chunk} {damage}")
                self._lose(error, f"; {chunk.count(numbers)} messages of {topic} are lost")
            self._release(chunk)

    def _prepared(self, chunks: list[_Chunk]) -> Iterator[tuple[_Chunk, Callable[[], _Bytes]]]:
        """Chunks with what gives their content; a thread decompresses ahead of the one that is decoded."""
        if len(chunks) < 2 or not any(chunk.compression for chunk in chunks):
            yield from ((chunk, partial(self._content, chunk)) for chunk in chunks)
            return
        with ThreadPoolExecutor(1) as thread:
            coming: deque[tuple[_Chunk, Future[_Bytes]]] = deque()
            for chunk in chunks:
                coming.append((chunk, thread.submit(self._content, chunk)))
                if len(coming) > CHUNKS_AHEAD:
                    ready, future = coming.popleft()
                    yield ready, future.result
            yield from ((ready, future.result) for ready, future in coming)

    def _content(self, chunk: _Chunk) -> _Bytes:
        """A chunk's records, decompressed and checked."""
        require_mapped(self._map)
        content: _Bytes = self._data[chunk.start : chunk.stop]
        if chunk.compression:
            raw = decompress(content, chunk.compression, chunk.size, is_cut=chunk.is_cut)
            content = np.frombuffer(raw, np.uint8)
        if chunk.is_cut:
            return content
        if len(content) != chunk.size:
            raise Damage(f"holds {len(content)} bytes where it says {chunk.size}")
        if chunk.crc and crc32(content.data) != chunk.crc:
            raise Damage("does not have the checksum (CRC) that was written with it")
        return content

    def _batch(self, chunk: _Chunk, content: _Bytes, numbers: set[int]) -> MessageBatch:
        offsets = self._offsets(chunk, content)
        heads = message_heads(content, offsets)
        channels = heads["channel"]
        wanted = np.isin(channels, list(numbers)) if len(numbers) > 1 else channels == next(iter(numbers))
        if not wanted.all():
            heads, offsets = heads[wanted], offsets[wanted]
        if len(heads) != chunk.count(numbers):
            raise Damage(f"holds {len(heads)} messages where its index says {chunk.count(numbers)}")
        receive = heads["log_time"].astype(np.int64)
        if (receive < 0).any():
            raise Damage("holds a receive time beyond the year 2262")
        sizes = heads["length"].astype(np.int64) - MESSAGE_FIELDS
        return MessageBatch(receive, content, offsets + HEAD.itemsize, sizes)

    def _offsets(self, chunk: _Chunk, content: _Bytes) -> _Offsets:
        """Where a chunk's messages begin: as its index says, if that is true, else found one by one."""
        ranges = [presence.index for presence in chunk.channels.values() if presence.index]
        if len(ranges) == len(chunk.channels):
            entries = [self._data[start:stop].view("<u8")[1::2] for start, stop in ranges]
            offsets = np.sort(np.concatenate(entries).astype(np.int64), kind="stable")
            gaps = gaps_between(content, offsets)
            if gaps is not None and all(self._defines(content, *gap) for gap in gaps):
                return offsets
        return self._find(chunk, content)

    def _defines(self, content: _Bytes, start: int, stop: int) -> bool:
        """Whether there are definitions only in a range of a chunk; they are kept."""
        try:
            for record in records_in(content, start, stop):
                if record.kind is Kind.MESSAGE:
                    return False
                self._define(record, content)
        except Cut:
            return False
        return True

    def _find(self, chunk: _Chunk, content: _Bytes) -> _Offsets:
        """Offsets of a chunk's messages, from record to record."""
        found = [np.empty(0, np.int64)]
        position, end = 0, len(content)
        try:
            while position < end:
                record = next(records_in(content, position, end))
                step, run = record.stop - position, 1
                if record.kind is not Kind.MESSAGE:
                    self._define(record, content)
                elif step < HEAD.itemsize:
                    raise Damage(f"holds a message of {step} bytes at {position}")
                else:
                    run = run_of(content, record)
                    found.append(np.arange(position, position + run * step, step))
                position += run * step
        except Cut as cut:
            if not chunk.is_cut:
                raise Damage(f"holds a record at {cut.position} that reaches beyond its end") from None
        return np.concatenate(found)

    # ------------------------------------------------------------------ the walk

    def _walk(self) -> None:
        """Find all chunks, and what the file says about itself."""
        if self._data[: len(MAGIC)].tobytes() != MAGIC:
            raise LogError(self.path, "format", "does not begin as MCAP does")
        position: int | None = len(MAGIC)
        while position is not None:
            position = self._walk_from(position)

    def _walk_from(self, position: int) -> int | None:
        """Walk to the end. Where damage is in the way, say where to go on behind it."""
        part = "the record"
        try:
            for record in records_in(self._data, position, len(self._data)):
                position, part = record.position, str(record.kind)
                self._take(record)
                position, part = record.stop, "the record"
                if record.kind is Kind.FOOTER:
                    return None
            self._end_early(Cut(len(self._data), None))
        except Cut as cut:
            self._end_early(cut)
        except Damage as damage:
            return self._pass_over(
                position, LogCorrupt(self.path, "corrupt", f"{part} at byte {position} {damage}")
            )
        return None

    def _take(self, record: Record) -> None:
        if record.kind in (_ONLY_IN_DATA if self._summary else _ONLY_IN_SUMMARY):
            raise Damage(f"stands {'behind' if self._summary else 'before'} the end of the data")
        match record.kind:
            case Kind.SCHEMA | Kind.CHANNEL:
                self._define(record, self._data)
            case Kind.MESSAGE:
                self._take_message(record)
            case Kind.CHUNK:
                self._begin(self._chunk(record))
            case Kind.MESSAGE_INDEX:
                self._take_message_index(record)
            case Kind.CHUNK_INDEX:
                self._indexed.add(RecordFields(self._data, record).take("<QQQ")[2])
            case Kind.STATISTICS:
                self._take_statistics(record)
            case Kind.DATA_END:
                self._take_data_end(record)
            case Kind.FOOTER:
                self._take_footer(record)

    def _begin(self, chunk: _Chunk) -> None:
        for former in self._chunks[-1:]:  # whose index has been read as well by now
            self._release(former)
        self._chunks.append(chunk)

    def _take_message(self, record: Record) -> None:
        last = self._chunks[-1] if self._chunks else None
        if last and last.is_loose and last.stop == record.position and last.size < LOOSE_SECTION:
            last.stop = record.stop
            last.size = last.stored = last.stop - last.start
            return
        size = record.stop - record.position
        self._begin(_Chunk(record.position, record.position, record.stop, size, size, is_loose=True))

    def _chunk(self, record: Record) -> _Chunk:
        fields = RecordFields(self._data, record)
        first, last, size, crc = fields.take("<QQQI")
        compression = fields.text()
        (stored,) = fields.take("<Q")
        if stored != fields.left:
            raise Damage(f"says that {stored} bytes follow where there are {fields.left}")
        return _Chunk(
            record.position, fields.position, record.stop, size, stored, crc, compression, first, last
        )

    def _take_message_index(self, record: Record) -> None:
        if not self._chunks or self._chunks[-1].is_loose:
            raise Damage("follows no chunk")
        fields = RecordFields(self._data, record)
        channel, length = fields.take("<HI")
        if length != fields.left or length % 16 or channel in self._chunks[-1].channels:
            raise Damage(f"holds {fields.left} bytes where it says {length}, or repeats channel {channel}")
        if length:
            place = fields.position, record.stop
            stamps = self._data[slice(*place)].view("<u8")[::2]
            presence = _Presence(length // 16, int(stamps.min()), int(stamps.max()), place)
            self._chunks[-1].channels[channel] = presence

    def _take_statistics(self, record: Record) -> None:
        fields = RecordFields(self._data, record)
        *_, length = fields.take("<QHIIIIQQI")
        if length != fields.left or length % 10:
            raise Damage(f"holds {fields.left} bytes of counts where it says {length}")
        for _ in range(length // 10):
            channel, count = fields.take("<HQ")
            self._counts[channel] = count

    def _take_data_end(self, record: Record) -> None:
        (crc,) = RecordFields(self._data, record).take("<I")
        self._summary = record.stop
        if any(chunk.is_loose for chunk in self._chunks):
            if not crc:
                self.warnings.append("unverified: messages outside chunks carry no checksum")
            elif self._checksum(record.position) != crc:
                raise Damage("does not have the checksum (CRC) of the data before it")

    def _checksum(self, stop: int) -> int:
        """CRC of all bytes before one."""
        crc = 0
        for start in range(0, stop, LOOSE_SECTION):
            crc = crc32(self._data[start : min(start + LOOSE_SECTION, stop)].data, crc)
            self._let_go(start, start + LOOSE_SECTION)
        return crc

    def _take_footer(self, record: Record) -> None:
        start, _, crc = RecordFields(self._data, record).take("<QQI")
        ending = self._data[record.stop :].tobytes()
        if ending != MAGIC:
            if MAGIC.startswith(ending):
                raise Cut(record.stop, None)
            raise Damage("is not followed by the end of an MCAP file")
        if not self._summary:
            raise Damage("stands before the end of the data")
        if start != (self._summary if self._summary < record.position else 0):
            raise Damage(f"says that the summary begins at byte {start}, where it begins at {self._summary}")
        if not crc:
            self.warnings.append("unverified: the summary carries no checksum")
        elif crc32(self._data[start or record.position : record.stop - 4].data) != crc:
            raise Damage("does not have the checksum (CRC) of the summary before it")

    # ------------------------------------------------------------------ definitions

    def _define(self, record: Record, content: _Bytes) -> None:
        """Keep a schema or channel; one that was met before must be the same."""
        if record.kind is Kind.PRIVATE:
            return
        if record.kind not in (Kind.SCHEMA, Kind.CHANNEL):
            raise Damage(f"holds {record.kind} where messages should be")
        fields = RecordFields(content, record)
        (number,) = fields.take("<H")
        known: dict[int, Any] = self._schemas if record.kind is Kind.SCHEMA else self._channels
        if record.kind is Kind.SCHEMA:
            new: Any = _Schema(fields.text(), fields.text(), fields.raw())
        else:
            (schema,) = fields.take("<H")
            new = _Channel(schema, fields.text(), fields.text())
            fields.raw()
        if fields.left:
            raise Damage(f"holds {fields.left} bytes more than it says")
        if known.setdefault(number, new) != new:
            raise Damage(f"defines {record.kind.name.lower()} {number} again, otherwise than before")

    def _look_inside(self) -> None:
        """Decompress the chunks that have no index, or messages of channels that are defined nowhere else."""
        self._require_limits(chunk for chunk in self._chunks if not chunk.channels)
        for chunk in list(self._chunks):
            if chunk.channels and chunk.channels.keys() <= self._channels.keys():
                continue
            self._require_limits([chunk])
            try:
                self._note_channels(chunk)
                self._release(chunk)
            except Damage as damage:
                error = LogCorrupt(self.path, "corrupt", f"{chunk} {damage}")
                self._lose(error, "; its messages are lost")
                self._chunks.remove(chunk)

    def _note_channels(self, chunk: _Chunk) -> None:
        content = self._content(chunk)
        heads = message_heads(content, self._find(chunk, content))
        if not chunk.channels:
            for number in np.unique(heads["channel"]).tolist():
                stamps = heads["log_time"][heads["channel"] == number]
                chunk.channels[number] = _Presence(len(stamps), int(stamps.min()), int(stamps.max()), None)
        unknown = chunk.channels.keys() - self._channels.keys()
        if unknown:
            raise Damage(f"holds messages of channel {min(unknown)}, which is defined nowhere before them")

    # ------------------------------------------------------------------ checks

    def _compare(self) -> None:
        """Compare what was found with what the summary says."""
        bare = sum(1 for chunk in self._chunks if not (chunk.crc or chunk.is_loose or chunk.is_cut))
        if bare:
            self.warnings.append(f"unverified: {bare} of {len(self._chunks)} chunks carry no checksum")
        if not self._summary or self.losses:
            return
        found = dict.fromkeys(self._counts, 0)
        for chunk in self._chunks:
            for number, presence in chunk.channels.items():
                found[number] = found.get(number, 0) + presence.count
        problem = ""
        if not self._counts:
            self.warnings.append("unverified: no statistics, so missing messages would not be noticed")
        elif found != self._counts:
            number = min(number for number in found if found[number] != self._counts.get(number))
            topic = self._channels[number].topic if number in self._channels else f"channel {number}"
            promised = self._counts.get(number, 0)
            problem = f"holds {found[number]} messages of {topic}, where its statistics say {promised}"
        elif self._indexed and self._indexed != {c.position for c in self._chunks if not c.is_loose}:
            problem = "holds other chunks than its index says"
        if problem:
            self._lose(LogCorrupt(self.path, "corrupt", problem), "")

    def _require_limits(self, chunks: Iterable[_Chunk]) -> None:
        compressed = [chunk for chunk in chunks if chunk.compression]
        for chunk in compressed:
            require_growth(self.path, chunk, chunk.stored, chunk.size)
        require_total_growth(self.path, (chunk.size for chunk in compressed), len(self._data))

    # ------------------------------------------------------------------ damage

    def _end_early(self, cut: Cut) -> None:
        """Report that the file ends too early, and keep what there is of the last chunk."""
        size = len(self._data)
        inside = f"inside {cut.kind or 'the record'} that begins at byte {cut.position}"
        where = f"ends at byte {size}, {inside if cut.position < size else 'behind a record'}"
        if self._summary:
            self.warnings.append(f"unverified: {where}, in its summary; all data lie before it")
            return
        last = max((chunk.last_ns for chunk in self._chunks), default=0)
        until = f"chunks before it reach until {_seconds(last)} s" if last else "no chunk before it is whole"
        error = LogTruncated(self.path, "truncated", f"{where}; {until}")
        kept = "; what is whole of it is kept" if cut.kind is Kind.CHUNK else ""
        self._lose(error, f"{kept}; what came behind is lost")
        if cut.kind is Kind.CHUNK:
            self._keep_cut_chunk(cut.position)

    def _keep_cut_chunk(self, position: int) -> None:
        record = Record(Kind.CHUNK, position, position + PREFIX.size, len(self._data))
        fields = RecordFields(self._data, record)
        try:
            first, last, size, _ = fields.take("<QQQI")
            compression = fields.text()
            (stored,) = fields.take("<Q")
        except Damage:
            return
        start = fields.position
        self._chunks.append(
            _Chunk(position, start, record.stop, size, stored, 0, compression, first, last, is_cut=True)
        )

    def _pass_over(self, position: int, error: LogCorrupt) -> int | None:
        """Report damage, and say where the next chunk is, if the index at the end of the file knows one."""
        if self._summary:
            self._lose(error, "; all data lie before it")
            return None
        following = min((start for start in self._chunks_of_index() if start > position), default=None)
        until = "the end" if following is None else f"byte {following}"
        self._lose(error, f"; what lies between it and {until} is lost")
        return following

    def _chunks_of_index(self) -> set[int]:
        """Where chunks begin, as the index at the end of the file says; none if that is damaged too."""
        end = len(self._data) - len(MAGIC)
        starts: set[int] = set()
        try:
            *_, footer = records_in(self._data, max(end - FOOTER_SIZE, 0), end)
            start, _, crc = RecordFields(self._data, footer).take("<QQI")
            if crc and crc32(self._data[start : footer.stop - 4].data) != crc:
                return starts
            for record in records_in(self._data, start, footer.position):
                if record.kind is Kind.CHUNK_INDEX:
                    starts.add(RecordFields(self._data, record).take("<QQQ")[2])
        except (Damage, Cut, struct.error, ValueError):
            return set()
        return starts

    def _lose(self, error: LogError, consequence: str) -> None:
        """Raise the error, or note the loss where salvage was asked for."""
        if not self._salvage:
            raise error from None
        self.losses.append(f"{error.problem}{consequence}")

    def _release(self, chunk: _Chunk) -> None:
        indexes = [presence.index[1] for presence in chunk.channels.values() if presence.index]
        self._let_go(chunk.start, max([chunk.stop, *indexes]))

    def _let_go(self, start: int, stop: int) -> None:
        """Let go of pages that were read, so that memory does not grow with the file."""
        if hasattr(self._map, "madvise"):
            start -= start % mmap.PAGESIZE
            self._map.madvise(mmap.MADV_DONTNEED, start, min(stop, len(self._map)) - start)


def _seconds(stamp: int) -> str:
    return f"{stamp // 1_000_000_000}.{stamp % 1_000_000_000:09d}"
