"""ROS message types, as a recording's own schema text defines them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

from trundle.errors import LogSchema

__all__ = [
    "Array",
    "MessageType",
    "Primitive",
    "Struct",
    "Text",
    "Unreadable",
    "leaves",
    "ros2_name",
    "struct_type",
]

MOST_LEAVES = 2000  # that an error message looks through; a type may nest into many more


@dataclass(frozen=True, slots=True)
class Primitive:
    """A number.

    Attributes:
        code: NumPy's letter and size, such as `f8`; the byte order is the message's.
        size: Bytes, which is also the alignment.
    """

    code: str
    size: int


@dataclass(frozen=True, slots=True)
class Text:
    """A string of bytes (UTF-8)."""


@dataclass(frozen=True, slots=True)
class Array:
    """Several of one type; `length` is None where each message says how many."""

    element: MessageType
    length: int | None


@dataclass(frozen=True, slots=True)
class Struct:
    """A message type: fields in the order in which they are written.

    Attributes:
        name: In ROS 2 form, such as `geometry_msgs/msg/Pose`.
        fields: Types by name.
        is_empty: Whether it takes no byte (in ROS 1; ROS 2 writes one into an empty message).
    """

    name: str
    fields: dict[str, MessageType]
    is_empty: bool = False


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A type without a layout that all writers agree about (wstring, long double)."""

    name: str


MessageType: TypeAlias = Primitive | Text | Array | Struct | Unreadable

_PRIMITIVES: dict[str, MessageType] = {
    name: Primitive(code, int(code[1:]))
    for name, code in {
        "bool": "b1",
        "char": "u1",
        "float32": "f4",
        "float64": "f8",
        "int8": "i1",
        "int16": "i2",
        "int32": "i4",
        "int64": "i8",
        "uint8": "u1",
        "uint16": "u2",
        "uint32": "u4",
        "uint64": "u8",
    }.items()
}
_WORDS = (
    _PRIMITIVES | {"string": Text()} | {name: Unreadable(name) for name in ("wstring", "wchar", "float128")}
)

_SEPARATOR = re.compile(r"^={80}[ \t]*\r?\n(?:MSG|IDL): *(\S+)[ \t]*\r?\n", re.MULTILINE)
_INCLUDE = re.compile(r"^[ \t]*#.*$", re.MULTILINE)
_LINE = re.compile(
    r"\s*(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<constant>=)?"
)
_NOTHING = re.compile(r"\s*(#.*|@.*)?$")

# What every ROS has, for recordings that leave it out. ROS 1 counts seconds without a sign.
_STAMP = "{second} sec\nuint32 nanosec"
_EVERYWHERE = {
    "builtin_interfaces/msg/Duration": _STAMP.format(second="int32"),
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
}
_SHORT = {
    "Header": "std_msgs/msg/Header",
    "duration": "builtin_interfaces/msg/Duration",
    "time": "builtin_interfaces/msg/Time",
}

# Fields of a definition: name, word for the type, whether it is an array, its length.
_Fields: TypeAlias = list[tuple[str, str, bool, int | None]]


def ros2_name(name: str) -> str:
    """A type's name in ROS 2 form: `sensor_msgs/JointState` is `sensor_msgs/msg/JointState`."""
    package, _, rest = name.partition("/")
    return name if "/" in rest or not rest else f"{package}/msg/{rest}"


def struct_type(source: object, name: str, encoding: str, text: str) -> Struct:
    """The type that a recording's schema defines, with everything that it contains.

    Args:
        source: The recording, for error messages.
        name: Type name, in ROS 1 or ROS 2 form.
        encoding: `ros1msg`, `ros2msg` or `ros2idl`.
        text: Concatenated definitions, as bags and MCAP files carry them.

    Raises:
        LogSchema: If the text is not such a definition, or does not define what it uses.
    """
    name = ros2_name(name)
    try:
        if encoding in ("ros1msg", "ros2msg"):
            definitions = _definitions_of_msg(name, text)
        elif encoding in ("ros2idl", "omgidl"):
            definitions = _definitions_of_idl(text)
        else:
            raise LogSchema(source, "schema", f"{name} is encoded as {encoding!r}, not as a ROS message")
        return _Resolver(definitions, is_ros1=encoding == "ros1msg").struct(name)
    except _BadSchema as error:
        raise LogSchema(source, "schema", f"the schema of {name} {error}") from None


def leaves(kind: MessageType, path: str = "") -> Iterator[str]:
    """Dotted paths of the values that a type holds, at most the first few thousand."""
    for count, leaf in enumerate(_all_leaves(kind, path)):
        if count == MOST_LEAVES:
            return
        yield leaf


class _BadSchema(Exception):
    """A definition that cannot be read; the words follow `the schema of TYPE`."""


def _all_leaves(kind: MessageType, path: str) -> Iterator[str]:
    match kind:
        case Array():
            yield from _all_leaves(kind.element, path)
        case Struct():
            for name, field in kind.fields.items():
                yield from _all_leaves(field, f"{path}.{name}" if path else name)
        case _:
            yield path


class _Resolver:
    """Turns the words of definitions into types, each type once."""

    def __init__(self, definitions: dict[str, _Fields], *, is_ros1: bool) -> None:
        self.is_ros1 = is_ros1
        second = "uint32" if is_ros1 else "int32"
        known = _EVERYWHERE | {"builtin_interfaces/msg/Time": _STAMP.format(second=second)}
        self.definitions = {name: list(_fields_of_msg(text)) for name, text in known.items()} | definitions
        self.words = _WORDS | {"byte": _PRIMITIVES["int8" if is_ros1 else "uint8"]}
        self.structs: dict[str, Struct | None] = {}

    def struct(self, name: str) -> Struct:
        if name not in self.structs:
            self.structs[name] = None  # being made
            self.structs[name] = self._made(name)
        found = self.structs[name]
        if found is None:
            raise _BadSchema(f"contains itself through {name}")
        return found

    def _made(self, name: str) -> Struct:
        if name not in self.definitions:
            raise _BadSchema(f"does not define {name}")
        fields: dict[str, MessageType] = {}
        for field, word, is_array, length in self.definitions[name]:
            element = self.words[word] if word in self.words else self.struct(self._full(word, name))
            fields[field] = Array(element, length) if is_array else element
        if not fields and not self.is_ros1:
            fields["structure_needs_at_least_one_member"] = _PRIMITIVES["uint8"]
        return Struct(name, fields, is_empty=all(_is_empty(kind) for kind in fields.values()))

    def _full(self, word: str, owner: str) -> str:
        if "/" in word:
            return ros2_name(word)
        sibling = f"{owner.rpartition('/')[0]}/{word}"
        return sibling if sibling in self.definitions else _SHORT.get(word, sibling)


def _is_empty(kind: MessageType) -> bool:
    if isinstance(kind, Array):
        return kind.length == 0 or (kind.length is not None and _is_empty(kind.element))
    return isinstance(kind, Struct) and kind.is_empty


def _definitions_of_msg(name: str, text: str) -> dict[str, _Fields]:
    first, *others = _SEPARATOR.split(text)
    texts = {name: first} | {
        ros2_name(other): body for other, body in zip(others[::2], others[1::2], strict=True)
    }
    return {name: list(_fields_of_msg(body)) for name, body in texts.items()}


def _fields_of_msg(text: str) -> Iterator[tuple[str, str, bool, int | None]]:
    for line in text.splitlines():
        if _NOTHING.match(line):
            continue
        found = _LINE.match(line)
        if found is None:
            raise _BadSchema(f"holds a line that is no field: {line.strip()[:80]!r}")
        if not found["constant"]:
            array = found["array"]
            length = array.strip("[]") if array else ""
            yield found["name"], found["type"], bool(array), int(length) if length.isdecimal() else None


def _definitions_of_idl(text: str) -> dict[str, _Fields]:
    """IDL is a language of its own; rosbags reads it, all but `#include`, which names what comes along."""
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import TypesysError, get_types_from_idl

    definitions: dict[str, _Fields] = {}
    bodies = _SEPARATOR.split(_INCLUDE.sub("", text))[::2]
    try:
        for body in bodies if bodies[0].strip() else bodies[1:]:
            for name, (_, fields) in get_types_from_idl(body).items():
                definitions[name] = [(field, *_idl_type(kind, Nodetype)) for field, kind in fields]
    except (TypesysError, AssertionError, RecursionError) as error:
        raise _BadSchema(f"is not IDL: {str(error)[:200]}") from None
    return definitions


def _idl_type(kind: Any, nodes: Any) -> tuple[str, bool, int | None]:
    node, what = kind
    if node in (nodes.ARRAY, nodes.SEQUENCE):
        word, _, _ = _idl_type(what[0], nodes)
        return word, True, what[1] if node == nodes.ARRAY else None
    return (what[0] if node == nodes.BASE else what), False, None
