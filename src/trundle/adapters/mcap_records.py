"""Records of MCAP: a kind, a length, and content, one after the other, in a file as in a chunk.

Source: https://mcap.dev/spec, version 0.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.damage import Damage
from trundle.adapters.topic_columns import rows_of

__all__ = [
    "HEAD",
    "MESSAGE_FIELDS",
    "PREFIX",
    "Cut",
    "Kind",
    "Record",
    "RecordFields",
    "gaps_between",
    "message_heads",
    "records_in",
    "run_of",
]

PREFIX = struct.Struct("<BQ")  # kind and length, before the content of a record
PRIVATE = 0x80  # kinds from here on are anyone's own, to be passed over

# What stands before the data of a message: the prefix, and the fields of its record.
HEAD = np.dtype(
    [
        ("kind", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
MESSAGE_FIELDS = HEAD.itemsize - PREFIX.size  # bytes of a message record before its data

_Bytes = npt.NDArray[np.uint8]
_Offsets = npt.NDArray[np.int64]


class Kind(enum.IntEnum):
    """What a record is."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    ATTACHMENT = 0x09
    ATTACHMENT_INDEX = 0x0A
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    SUMMARY_OFFSET = 0x0E
    DATA_END = 0x0F
    PRIVATE = 0x80  # any from here on

    @classmethod
    def of(cls, opcode: int) -> Kind | None:
        """The kind with this opcode, None where there is none."""
        return cls.PRIVATE if opcode >= PRIVATE else _KINDS.get(opcode)

    def __str__(self) -> str:
        return f"the {self.name.lower().replace('_', ' ')} record"


_KINDS = {int(kind): kind for kind in Kind}


class Record(NamedTuple):
    """Where a record lies."""

    kind: Kind
    position: int  # of its prefix
    start: int  # of its content
    stop: int


class Cut(Exception):
    """The bytes end inside a record.

    Attributes:
        position: Where the record begins.
        kind: What it is, None where even that is missing.
    """

    def __init__(self, position: int, kind: Kind | None) -> None:
        self.position = position
        self.kind = kind


def records_in(content: _Bytes, position: int, end: int) -> Iterator[Record]:
    """Records from a position on.

    Raises:
        Damage: If a record is of no known kind.
        Cut: If the last one reaches beyond the end.
    """
    while position < end:
        if end - position < PREFIX.size:
            raise Cut(position, None)
        opcode, length = PREFIX.unpack_from(content.data, position)
        kind = Kind.of(opcode)
        if kind is None:
            raise Damage(f"holds a record of unknown kind {opcode} at byte {position}")
        start = position + PREFIX.size
        if length > end - start:
            raise Cut(position, kind)
        yield Record(kind, position, start, start + length)
        position = start + length


class RecordFields:
    """Takes the fields of a record, one after the other."""

    def __init__(self, content: _Bytes, record: Record) -> None:
        self.content = content
        self.position = record.start
        self.stop = record.stop

    def take(self, form: str) -> tuple[Any, ...]:
        """Numbers, as the struct module names them.

        Raises:
            Damage: If the record ends before.
        """
        return struct.unpack(form, self._bytes(struct.calcsize(form)))

    def raw(self) -> bytes:
        """Bytes with their length before them."""
        return self._bytes(self.take("<I")[0])

    def text(self) -> str:
        """Text with its length before it."""
        return self.raw().decode(errors="backslashreplace")

    @property
    def left(self) -> int:
        """Bytes that were not taken."""
        return self.stop - self.position

    def _bytes(self, size: int) -> bytes:
        start, self.position = self.position, self.position + size
        if self.position > self.stop:
            raise Damage(f"ends inside a field of {size} bytes at byte {start}")
        return self.content[start : self.position].tobytes()


def message_heads(content: _Bytes, offsets: _Offsets) -> npt.NDArray[Any]:
    """What stands before the data of the messages at these offsets, as rows of `HEAD`."""
    return rows_of(content, offsets, HEAD.itemsize).view(HEAD)[:, 0]


def gaps_between(content: _Bytes, offsets: _Offsets) -> list[tuple[int, int]] | None:
    """What messages at these ascending offsets leave free; None where there are no such messages."""
    if not len(offsets):
        return [(0, len(content))] if len(content) else []
    if offsets[0] < 0 or offsets[-1] > len(content) - HEAD.itemsize:
        return None
    heads = message_heads(content, offsets)
    lengths = heads["length"].astype(np.int64)  # one beyond all measure becomes negative
    if (
        (heads["kind"] != Kind.MESSAGE).any()
        or lengths.min() < MESSAGE_FIELDS
        or lengths.max() > len(content)
    ):
        return None
    starts = np.append(0, offsets + lengths + PREFIX.size)
    stops = np.append(offsets, len(content))
    if (starts > stops).any():
        return None
    free = np.flatnonzero(starts < stops)
    return list(zip(starts[free].tolist(), stops[free].tolist(), strict=True))


def run_of(content: _Bytes, message: Record) -> int:
    """How many messages of one length follow each other, from one on."""
    step = message.stop - message.position
    most = (len(content) - message.position) // step
    prefixes = np.ndarray((most, PREFIX.size), np.uint8, content, message.position, (step, 1))
    length, look = 1, 8
    while length < most:
        ahead = prefixes[length : length + look]
        same = (ahead == prefixes[0]).all(axis=1)
        if not same.all():
            return length + int(np.argmin(same))
        length, look = length + len(ahead), look * 4
    return length
