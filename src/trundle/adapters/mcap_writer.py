"""MCAP files: chunks with checksums, an index and statistics, so that every reader finds its way.

Source: https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import BinaryIO, NamedTuple, Self

import numpy as np
import numpy.typing as npt
from zlib_ng.zlib_ng import crc32

from trundle.adapters.chunk_compression import compress
from trundle.adapters.mcap import MAGIC
from trundle.adapters.mcap_records import PREFIX, Kind

__all__ = ["Channel", "McapWriter"]

COMPRESSION = "zstd"

Numbers = npt.NDArray[np.int64]


class Channel(NamedTuple):
    """A topic and the type of its messages.

    Attributes:
        topic: Its name.
        type: Name of the type, such as `nav_msgs/msg/Odometry`.
        schema: Its definition and those of all that it contains, as ROS 2 concatenates them.
    """

    topic: str
    type: str
    schema: str


class _Chunk(NamedTuple):
    """What the index says of a chunk."""

    first_ns: int
    last_ns: int
    position: int
    length: int
    index_offsets: Mapping[int, int]
    index_length: int
    stored: int
    size: int


class McapWriter:
    """An MCAP file of ROS 2 messages (CDR) that is being written, for a `with` block.

    Channels have the numbers 1, 2, ... in their order.
    """

    def __init__(self, file: BinaryIO, channels: Sequence[Channel]) -> None:
        self._file = file
        self._crc = 0
        self._position = 0
        self._chunks: list[_Chunk] = []
        self._counts = dict.fromkeys(range(1, len(channels) + 1), 0)
        self._schemas = b"".join(
            _record(
                Kind.SCHEMA,
                struct.pack("<H", number) + _text(kind) + _text("ros2msg") + _text(schema),
            )
            for number, (_, kind, schema) in enumerate(channels, 1)
        )
        self._channels = b"".join(
            _record(
                Kind.CHANNEL,
                struct.pack("<HH", number, number)
                + _text(channel.topic)
                + _text("cdr")
                + struct.pack("<I", 0),
            )
            for number, channel in enumerate(channels, 1)
        )
        self._write(MAGIC + _record(Kind.HEADER, _text("ros2") + _text("trundle")))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._finish()

    def add(self, records: bytes, messages: Mapping[int, tuple[Numbers, Numbers]]) -> None:
        """Write a chunk.

        Args:
            records: Its message records.
            messages: By channel, their stamps [ns] and where in `records` they begin; none of them empty.
        """
        before = b"" if self._chunks else self._schemas + self._channels
        content = before + records
        stored = compress(content, COMPRESSION)
        first = min(int(stamps.min()) for stamps, _ in messages.values())
        last = max(int(stamps.max()) for stamps, _ in messages.values())
        position = self._position
        fields = struct.pack("<QQQI", first, last, len(content), crc32(content)) + _text(COMPRESSION)
        self._write(_record(Kind.CHUNK, fields + struct.pack("<Q", len(stored)) + stored))
        length, offsets = self._position - position, {}
        for channel, (stamps, starts) in messages.items():
            offsets[channel] = self._position
            self._counts[channel] += len(stamps)
            entries = np.stack([stamps, starts + len(before)], axis=-1).astype("<u8").tobytes()
            self._write(_record(Kind.MESSAGE_INDEX, struct.pack("<HI", channel, len(entries)) + entries))
        index_length = self._position - position - length
        self._chunks.append(
            _Chunk(first, last, position, length, offsets, index_length, len(stored), len(content))
        )

    def _finish(self) -> None:
        """Write what comes behind the data: where everything is, and how much there is of it."""
        self._write(_record(Kind.DATA_END, struct.pack("<I", self._crc)))
        start, self._crc = self._position, 0
        groups = {
            Kind.SCHEMA: self._schemas,
            Kind.CHANNEL: self._channels,
            Kind.STATISTICS: self._statistics(),
            Kind.CHUNK_INDEX: b"".join(map(_chunk_index, self._chunks)),
        }
        offsets = b""
        for kind, records in groups.items():
            if records:
                place = struct.pack("<BQQ", kind, self._position, len(records))
                offsets += _record(Kind.SUMMARY_OFFSET, place)
            self._write(records)
        offset_start = self._position
        self._write(offsets)
        # The footer's checksum covers the summary and the footer up to itself.
        footer = PREFIX.pack(Kind.FOOTER, 20) + struct.pack("<QQ", start, offset_start)
        self._write(footer)
        self._write(struct.pack("<I", self._crc) + MAGIC)

    def _statistics(self) -> bytes:
        first = min((chunk.first_ns for chunk in self._chunks), default=0)
        last = max((chunk.last_ns for chunk in self._chunks), default=0)
        counts = b"".join(struct.pack("<HQ", *count) for count in self._counts.items())
        kinds = len(self._counts)
        fields = struct.pack(
            "<QHIIIIQQI", sum(self._counts.values()), kinds, kinds, 0, 0, len(self._chunks), first, last,
            len(counts),
        )  # fmt: skip
        return _record(Kind.STATISTICS, fields + counts)

    def _write(self, content: bytes) -> None:
        self._position += self._file.write(content)
        self._crc = crc32(content, self._crc)


def _chunk_index(chunk: _Chunk) -> bytes:
    offsets = b"".join(struct.pack("<HQ", *offset) for offset in chunk.index_offsets.items())
    return _record(
        Kind.CHUNK_INDEX,
        struct.pack("<QQQQI", *chunk[:4], len(offsets))
        + offsets
        + struct.pack("<Q", chunk.index_length)
        + _text(COMPRESSION)
        + struct.pack("<QQ", chunk.stored, chunk.size),
    )


def _record(kind: Kind, content: bytes) -> bytes:
    return PREFIX.pack(kind, len(content)) + content


def _text(text: str) -> bytes:
    content = text.encode()
    return struct.pack("<I", len(content)) + content
