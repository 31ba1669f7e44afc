"""Where the values of one serialised ROS message lie: XCDR1 (ROS 2), both byte orders, and ROS 1."""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from trundle.adapters.damage import Damage
from trundle.adapters.rosmsg import Array, MessageType, Primitive, Struct, Text, leaves
from trundle.errors import did_you_mean

__all__ = ["Layout", "Selection", "Serialization", "Slot", "UnknownField"]

ENCAPSULATION = 4  # bytes before a CDR message: representation identifier and options
TRAILING = 15  # bytes that may stand behind a CDR message: rmw_serialize leaves 4 per empty array of doubles
PADDING = 3  # bytes of padding between lengths and texts, which may hold anything

# What other first two bytes of a message mean (DDS-XTypes 1.3, RTPS encapsulation identifiers).
_OTHERS = {
    0x0002: "PL_CDR_BE (parameter lists)",
    0x0003: "PL_CDR_LE (parameter lists)",
    0x0006: "CDR2_BE (XCDR2)",
    0x0007: "CDR2_LE (XCDR2)",
    0x0008: "D_CDR2_BE (XCDR2)",
    0x0009: "D_CDR2_LE (XCDR2)",
    0x000A: "PL_CDR2_BE (XCDR2)",
    0x000B: "PL_CDR2_LE (XCDR2)",
}


class Serialization(enum.Enum):
    """How values become bytes."""

    CDR = "cdr"
    ROS1 = "ros1"


class UnknownField(LookupError):
    """A dotted path that leads nowhere."""


@dataclass(frozen=True, slots=True)
class Slot:
    """One value that is asked for.

    Attributes:
        path: As it was asked for.
        code: NumPy's letter and size of a number, empty for text.
        is_array: Whether a message may hold any number of it.
    """

    path: str
    code: str
    is_array: bool


class Selection:
    """The fields that are wanted of a message type.

    A path runs through arrays of messages: `transforms.transform.translation.x` is an array with one entry
    per transform.

    Attributes:
        kind: The message type.
        slots: One per field.
    """

    def __init__(self, kind: Struct, paths: Sequence[str]) -> None:
        self.kind = kind
        self.slots: list[Slot] = []
        self.tree: dict[str, Any] = {}  # nested by field name; a leaf is the number of its slot
        for path in paths:
            self._add(path)

    def _add(self, path: str) -> None:
        kind: MessageType = self.kind
        branch, is_array = self.tree, False
        *parents, last = path.split(".")
        for part in parents:
            kind, is_array = self._step(kind, part, path, is_array=is_array)
            branch = branch.setdefault(part, {})
        kind, is_array = self._step(kind, last, path, is_array=is_array)
        if isinstance(kind, Array):
            kind, is_array = kind.element, True
        if isinstance(kind, Struct):
            inside = ", ".join(list(leaves(kind, path))[:12])
            raise UnknownField(f"{path!r} is a whole {kind.name}; ask for its values: {inside}")
        branch[last] = len(self.slots)
        self.slots.append(Slot(path, kind.code if isinstance(kind, Primitive) else "", is_array))

    def _step(self, kind: MessageType, part: str, path: str, *, is_array: bool) -> tuple[MessageType, bool]:
        if isinstance(kind, Array):
            kind, is_array = kind.element, True
        if not isinstance(kind, Struct) or part not in kind.fields:
            known = list(leaves(self.kind))
            listing = ", ".join(known[:40]) + (", ..." if len(known) > 40 else "")
            hint = did_you_mean(path, known)
            hint = f"{hint} " if hint.startswith("did") else ""
            raise UnknownField(f"no field {path!r} in {self.kind.name}; {hint}it holds: {listing}")
        return kind.fields[part], is_array


@dataclass(slots=True)
class Layout:
    """Where the wanted values lie in every message with these lengths.

    Attributes:
        size: Bytes of the message.
        byte_order: `<` or `>`.
        guards: Byte ranges `(start, stop)`; a message of this size in which they are equal has this layout.
        places: By slot, the ranges `(start, stop)` that its values fill, one after the other.
        spans: Guards and texts together, merged over padding: equal spans imply equal layout and texts.
        examples: By guard, the bytes that it must hold.
    """

    size: int
    byte_order: str = "<"
    guards: list[tuple[int, int]] = field(default_factory=list)
    places: list[list[tuple[int, int]]] = field(default_factory=list)
    spans: list[tuple[int, int]] = field(default_factory=list)
    examples: list[bytes] = field(default_factory=list)

    @classmethod
    def of(cls, message: bytes, selection: Selection, serialization: Serialization) -> Layout:
        """The layout of one message.

        Raises:
            Damage: If its bytes are no message of this type.
        """
        walk = _CdrWalk if serialization is Serialization.CDR else _Ros1Walk
        return walk(message, selection).layout

    def fits(self, message: bytes) -> bool:
        """Whether a message of this size has this layout."""
        return all(
            message[start:stop] == example
            for (start, stop), example in zip(self.guards, self.examples, strict=True)
        )


class _Walk:
    """One pass over a message's bytes, from length to length."""

    origin = 0  # where alignment counts from
    alignment = 1  # the largest that is kept
    terminator = 0  # bytes that end a text
    most_trailing = 0  # bytes that may follow the last value

    def __init__(self, message: bytes, selection: Selection) -> None:
        self.message = message
        self.end = len(message)
        self.position = self.origin
        self.layout = Layout(len(message), places=[[] for _ in selection.slots])
        self._open()
        self.unpack_length = struct.Struct(f"{self.layout.byte_order}I").unpack_from
        self._struct(selection.kind, selection.tree)
        if self.end - self.position > self.most_trailing:
            raise Damage(f"has {self.end - self.position} bytes more than {selection.kind.name} holds")
        texts = [
            place
            for slot, places in zip(selection.slots, self.layout.places, strict=True)
            for place in places
            if not slot.code
        ]
        self.layout.spans = _merged(sorted(self.layout.guards + texts))
        self.layout.examples = [message[start:stop] for start, stop in self.layout.guards]

    def _open(self) -> None:
        """Read what comes before the first value."""

    def _take(self, size: int, alignment: int) -> tuple[int, int]:
        """The range of the next value, behind which the walk then stands."""
        alignment = min(alignment, self.alignment)
        start = self.position + (self.origin - self.position) % alignment
        self.position = start + size
        if self.position > self.end:
            raise Damage(f"ends after {self.end} bytes, inside a value of {size} bytes at {start}")
        return start, self.position

    def _length(self) -> int:
        place = self._take(4, 4)
        self.layout.guards.append(place)
        length: int = self.unpack_length(self.message, place[0])[0]
        if length > self.end - self.position:
            raise Damage(f"says at byte {place[0]} that {length} values follow in {self.end} bytes")
        return length

    def _struct(self, kind: Struct, want: dict[str, Any]) -> None:
        for name, inner in kind.fields.items():
            self._value(inner, want.get(name))

    def _value(self, kind: MessageType, want: Any) -> None:
        match kind:
            case Primitive(size=size):
                self._place(want, self._take(size, size))
            case Text():
                self._place(want, self._text())
            case Struct():
                self._struct(kind, want or {})
            case Array(Primitive(size=size), length):
                count = self._length() if length is None else length
                if count:
                    self._place(want, self._take(count * size, size))
            case Array(element, length):
                count = self._length() if length is None else length
                if isinstance(element, Struct) and element.is_empty:
                    return
                for _ in range(count):
                    self._value(element, want)
            case _:
                raise Damage(f"holds a {kind.name}, which Trundle cannot read")

    def _text(self) -> tuple[int, int]:
        length = self._length()
        start, stop = self._take(length, 1)
        if length < self.terminator or any(self.message[stop - self.terminator : stop]):
            raise Damage(f"holds a text without its end at byte {start}")
        return start, stop - self.terminator

    def _place(self, slot: int | None, place: tuple[int, int]) -> None:
        if slot is not None:
            self.layout.places[slot].append(place)


class _CdrWalk(_Walk):
    origin = ENCAPSULATION
    alignment = 8
    terminator = 1
    most_trailing = TRAILING

    def _open(self) -> None:
        identifier = self.message[:2]
        if len(self.message) < ENCAPSULATION or identifier not in (b"\0\0", b"\0\1"):
            what = _OTHERS.get(int.from_bytes(identifier), identifier.hex(" ") or "nothing")
            raise Damage(f"begins as {what} does, not as plain CDR (00 00 or 00 01), which Trundle reads")
        self.layout.byte_order = "<" if identifier[1] else ">"
        self.layout.guards.append((0, 2))


class _Ros1Walk(_Walk):
    pass


def _merged(ranges: list[tuple[int, int]]) -> list[tuple[int, int]]:
    merged: list[tuple[int, int]] = []
    for start, stop in ranges:
        if merged and start - merged[-1][1] <= PADDING:
            merged[-1] = merged[-1][0], max(stop, merged[-1][1])
        else:
            merged.append((start, stop))
    return merged
