"""Records of WPILOG 1.0: an entry's number, a size, a time and content, one after the other.

Source: WPILib, wpiutil/doc/datalog.adoc, version 1.0.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.damage import Damage

__all__ = ["HEADER", "MAGIC", "VERSION", "Finish", "Index", "Start", "control_of", "walk"]

MAGIC = b"WPILOG"
VERSION = 0x0100
HEADER = struct.Struct("<6sHI")  # magic, version, length of the extra header

AT_ONCE = 1 << 16  # records whose places are kept as Python numbers

_START, _FINISH, _METADATA = range(3)
_LATEST = (2**63 - 1) // 1000  # microseconds that fit into 64 bits as nanoseconds

_Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Index:
    """Where records lie, in the order of the file.

    Attributes:
        positions: Of their first bytes.
        entries: Number of the entry that each belongs to; 0: it is about entries.
        time_ns: Their times [ns].
        starts: Where their content begins.
        sizes: Bytes of content.
        end: Where the last whole record ends.
        problem: Why the walk ended before the file did; empty where it did not.
    """

    positions: npt.NDArray[np.int64]
    entries: npt.NDArray[np.int64]
    time_ns: npt.NDArray[np.int64]
    starts: npt.NDArray[np.int64]
    sizes: npt.NDArray[np.int64]
    end: int
    problem: str


class Start(NamedTuple):
    """An entry begins."""

    entry: int
    name: str
    type: str
    metadata: str


class Finish(NamedTuple):
    """An entry has ended; its number may be used for another one."""

    entry: int


def walk(data: _Bytes, position: int) -> Index:
    """Find every record from a position on.

    Args:
        data: The whole file.
        position: Of the first record.
    """
    raw, end = data.data, len(data)
    # By its first byte: how many bytes of entry, of size, and of all its head a record has.
    heads = [(1 + (b & 3), 1 + (b >> 2 & 3), 4 + (b & 3) + (b >> 2 & 3) + (b >> 4 & 7)) for b in range(128)]
    blocks: list[npt.NDArray[np.int64]] = []
    block: list[int] = []
    problem = ""
    while position < end:
        first = raw[position]
        if first > 127:
            problem = "has a reserved bit set"
            break
        entry, size, head = heads[first]
        at = position + 1 + entry
        if position + head > end:
            problem = "is cut"
            break
        length = raw[at] if size == 1 else int.from_bytes(raw[at : at + size], "little")
        if length > end - position - head:
            problem = "is cut"
            break
        block.append(position)
        position += head + length
        if len(block) == AT_ONCE:
            blocks.append(np.array(block, np.int64))
            block.clear()
    positions = np.concatenate([*blocks, np.array(block, np.int64)])
    return _index(data, positions, position, problem)


def _index(data: _Bytes, positions: npt.NDArray[np.int64], end: int, problem: str) -> Index:
    """Read the heads of records, all of one width at a time."""
    first = data[positions]
    columns = np.zeros((3, len(positions)), np.uint64)
    widths = np.stack([1 + (first & 3), 1 + (first >> 2 & 3), 1 + (first >> 4 & 7)]).astype(np.int64)
    at = positions + 1
    for column, width in zip(columns, widths, strict=True):
        for byte in range(int(width.max(initial=0))):
            there = width > byte
            column[there] |= data[at[there] + byte].astype(np.uint64) << np.uint64(8 * byte)
        at = at + width
    entries, sizes, times = columns
    whole, late = slice(None), np.flatnonzero(times > _LATEST)
    if late.size:
        whole = slice(int(late[0]))
        end, problem = int(positions[late[0]]), "bears a time beyond 292 years"
    return Index(
        positions[whole],
        entries[whole].astype(np.int64),
        times[whole].astype(np.int64) * 1000,
        at[whole],
        sizes[whole].astype(np.int64),
        end,
        problem,
    )


def control_of(content: bytes) -> Start | Finish | None:
    """What a record of entry 0 says; None where it only describes an entry anew.

    Raises:
        Damage: If it says nothing that is known, or ends too early.
    """
    if len(content) < 5 or content[0] > _METADATA:
        raise Damage("says nothing that is known about an entry")
    kind, entry = struct.unpack_from("<BI", content)
    if kind == _METADATA:
        return None
    if kind == _FINISH:
        return Finish(entry)
    texts, position = [], 5
    for _ in range(3):
        if position + 4 > len(content):
            raise Damage("ends inside the description of an entry")
        (length,) = struct.unpack_from("<I", content, position)
        text = content[position + 4 : position + 4 + length]
        if len(text) < length:
            raise Damage("ends inside the description of an entry")
        texts.append(text.decode(errors="backslashreplace"))
        position += 4 + length
    if entry == 0 or position != len(content):
        raise Damage("describes entry 0, or more than an entry")
    return Start(entry, *texts)
