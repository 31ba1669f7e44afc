"""Columns of messages whose type only the file's own schema tells, beside rosbags on the same bytes."""

from __future__ import annotations

import struct
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trundle.adapters.bag import open_bag
from trundle.adapters.rosmsg import leaves, struct_type
from trundle.adapters.topic_columns import MOST_GROUPS, MOST_KNOWN
from trundle.errors import LogCorrupt

SEPARATOR = "=" * 80 + "\n"
DRIVE = ["steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk"]
FOREIGN = {  # which no ROS brings by itself, one of them nobody's but ours
    "ackermann_msgs/msg/AckermannDrive": "".join(f"float32 {name}\n" for name in DRIVE),
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nAckermannDrive drive\n",
    "my_msgs/msg/Wheels": "uint8 mode\nfloat64[] ticks\nstring<=20 axle\nint16[3] raw\nfloat64 dt\n",
}
JOINTS = "sensor_msgs/msg/JointState"
KINDS = [
    JOINTS,
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/Twist",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "sensor_msgs/msg/Imu",
    "ackermann_msgs/msg/AckermannDriveStamped",
    "std_msgs/msg/Float64",
    "std_msgs/msg/Float64MultiArray",
    "tf2_msgs/msg/TFMessage",
    "my_msgs/msg/Wheels",
]
ENCODINGS = ["ros2msg", "ros2idl"]
IDL_WORDS = {
    "bool": "boolean",
    "byte": "octet",
    "char": "uint8",
    "float32": "float",
    "float64": "double",
    "string": "string",
}


def typestore(definitions):
    types = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in definitions.items():
        types.register(get_types_from_msg(text, name))
    return types


@cache
def known_types():
    return typestore(FOREIGN)


def schema(types, kind, encoding):
    """The definition of a type with all that it contains, as a recorder writes it."""
    if encoding == "ros2msg":
        return types.generate_msgdef(kind, ros_version=2)[0]
    parts, waiting = {}, [kind]
    while waiting:
        name = waiting.pop()
        parts[name] = idl(name, types.fielddefs[name][1])
        waiting += {what for what in names_in(types.fielddefs[name][1]) if what not in parts}
    return "\n".join(f"{SEPARATOR}IDL: {name}\n{text}" for name, text in parts.items())


def names_in(fields):
    for _, (sort, what) in fields:
        inner = what[0] if sort in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (sort, what)
        if inner[0] == Nodetype.NAME:
            yield inner[1]


def idl(name, fields):
    """As rosidl translates a message: arrays by typedefs, annotations, comments, constants."""
    package, _, last = name.split("/")
    typedefs, members = set(), []
    for field, (sort, what) in fields:
        word = of_idl(what[0] if sort in (Nodetype.ARRAY, Nodetype.SEQUENCE) else (sort, what))
        if sort == Nodetype.SEQUENCE:
            word = f"sequence<{word}, {what[1]}>" if what[1] else f"sequence<{word}>"
        if sort == Nodetype.ARRAY:
            alias = f"{word.replace('::', '__')}__{what[1]}"
            typedefs.add(f"typedef {word} {alias}[{what[1]}];")
            word = alias
        members.append(f'@verbatim (language="comment", text="what it is; {{}}")\n      {word} {field};')
    includes = [f'#include "{what}.idl"' for what in names_in(fields)]
    return "\n".join(
        [
            "// generated from rosidl_adapter/resource/msg.idl.em",
            *includes,
            f"module {package} {{ module msg {{",
            *sorted(typedefs),
            f"module {last}_Constants {{ const uint8 MOST = 3; }};",
            f"    struct {last} {{",
            *members,
            "}; }; };",
        ]
    )


def of_idl(node):
    sort, what = node
    if sort == Nodetype.NAME:
        return what.replace("/", "::")
    word = IDL_WORDS.get(what[0], what[0])
    return f"{word}<{what[1]}>" if what[1] else word


def any_message(types, kind, rng, most):
    """A message of random values; `most` bounds texts and arrays, so that 0 gives one layout only."""

    def value(node):
        sort, what = node
        if sort == Nodetype.NAME:
            return any_message(types, what, rng, most)
        if sort == Nodetype.BASE:
            return text() if what[0] == "string" else number(what[0], 1)[0]
        element, length = what
        count = length if sort == Nodetype.ARRAY else int(rng.integers(0, most + 1)) if most else 2
        if element[0] == Nodetype.BASE and element[1][0] != "string":
            return number(element[1][0], count)
        return [value(element) for _ in range(count)]

    def text():
        return "".join(rng.choice(list("abcé"), int(rng.integers(0, most + 1)))) if most else "text"

    def number(name, count):
        if name.startswith("float"):
            return rng.normal(size=count).astype(name)
        if name == "bool":
            return rng.integers(0, 2, count).astype(bool)
        # A byte of ROS 2 is an octet; rosbags gives it a sign, so that only those below 128 compare.
        dtype = np.dtype({"byte": "int8", "char": "uint8"}.get(name, name))
        return rng.integers(0, np.iinfo(dtype).max, count, dtype)

    fields = types.fielddefs[kind][1]
    return types.types[kind](**{name: value(node) for name, node in fields})


def words(*parts):
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)


def record(op, content):
    return bytes([op]) + struct.pack("<Q", len(content)) + content


def recorded(folder, kind, encoding, text, messages, serialization="cdr"):
    """An MCAP of one chunk without index, checksum, summary."""
    content = record(0x03, struct.pack("<H", 1) + words(kind.encode(), encoding.encode(), text.encode()))
    content += record(0x04, struct.pack("<HH", 1, 1) + words(b"/x", serialization.encode(), b""))
    for k, message in enumerate(messages):
        content += record(0x05, struct.pack("<HIQQ", 1, k, 1000 + k, 1000 + k) + message)
    head = struct.pack("<QQQI", 1000, 1000 + len(messages), len(content), 0) + words(b"")
    magic = b"\x89MCAP0\r\n"
    chunk = record(0x06, head + struct.pack("<Q", len(content)) + content)
    path = Path(folder) / "run.mcap"
    path.write_bytes(
        magic
        + record(0x01, words(b"", b""))
        + chunk
        + record(0x0F, bytes(4))
        + record(0x02, bytes(20))
        + magic
    )
    return path


def follow(value, parts):
    """What a dotted path leads to; through arrays of messages all that it leads to, one after the other."""
    if not parts:
        return value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(value, list):
        found = [follow(each, parts) for each in value]
        return [word for each in found for word in (each if isinstance(each, list) else [each])]
    return follow(getattr(value, parts[0]), parts[1:])


def by_message(column, count):
    """A column as a list of what each message says."""
    if isinstance(column, str | tuple):
        column = [column] * count
    return [each.tolist() if isinstance(each, np.ndarray) else each for each in column]


def assert_as_rosbags(types, kind, encoding, messages):
    """`messages` are `(message, little_endian)`."""
    raws = [bytes(types.serialize_cdr(message, kind, little_endian=little)) for message, little in messages]
    text = schema(types, kind, encoding)
    fields = list(leaves(struct_type("", kind, encoding, text)))
    with (
        tempfile.TemporaryDirectory() as folder,
        open_bag(recorded(folder, kind, encoding, text, raws)) as bag,
    ):
        read = bag.read("/x", fields)
        assert bag.losses == []
    assert read.receive_ns.tolist() == list(range(1000, 1000 + len(raws)))
    told = [types.deserialize_cdr(raw, kind) for raw in raws]
    for field in fields:
        expected = [follow(message, field.split(".")) for message in told]
        column = by_message(read.columns[field], len(raws))
        assert [list(each) if isinstance(each, tuple) else each for each in column] == [
            each.item() if isinstance(each, np.generic) else each for each in expected
        ], field


LAYOUTS = st.lists(st.tuples(st.integers(0, 5), st.sampled_from([0, 0, 3]), st.booleans()), min_size=1)


@settings(max_examples=25)
@given(kind=st.sampled_from(KINDS), encoding=st.sampled_from(ENCODINGS), layouts=LAYOUTS)
def test_types_of_the_field(kind, encoding, layouts):
    """Every type, from either schema language, in both byte orders, with layouts that come and go."""
    types = known_types()
    messages = [
        (any_message(types, kind, np.random.default_rng(seed), most), little)
        for seed, most, little in layouts
    ]
    assert_as_rosbags(types, kind, encoding, messages)


PRIMITIVES = [
    *("bool", "byte", "char", "float32", "float64", "int8", "int16", "int32", "int64"),
    *("uint8", "uint16", "uint32", "uint64", "string"),
]


@st.composite
def definitions(draw):
    """A few message types; each may hold those before it. The last one holds the most."""
    texts = {}
    for name in [f"demo_msgs/msg/Part{k}" for k in range(draw(st.integers(1, 3)))]:
        kinds = st.sampled_from([*PRIMITIVES, *(other.replace("/msg/", "/") for other in texts)])
        arrays = st.sampled_from(["", "", "[]", "[<=4]", "[1]", "[3]"])
        fields = draw(st.lists(st.tuples(kinds, arrays), min_size=1, max_size=5))
        texts[name] = "".join(f"{kind}{array} f{k}\n" for k, (kind, array) in enumerate(fields))
    return texts


@settings(max_examples=25)
@given(texts=definitions(), encoding=st.sampled_from(ENCODINGS), layouts=LAYOUTS)
def test_any_type_at_all(texts, encoding, layouts):
    """Alignment, nesting, sequences and texts in whatever order: what the schema says decides."""
    types, kind = typestore(texts), list(texts)[-1]
    messages = [
        (any_message(types, kind, np.random.default_rng(seed), most), little)
        for seed, most, little in layouts
    ]
    assert_as_rosbags(types, kind, encoding, messages)


@given(
    st.lists(
        st.permutations(["left", "right", "rear"]).flatmap(
            lambda names: st.integers(1, 3).map(lambda count: names[:count])
        )
        | st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=5), max_size=4),
        min_size=1,
        max_size=12,
    )
)
def test_joints_that_change_places_names_and_number(orders):
    types = known_types()
    header = types.types["std_msgs/msg/Header"](types.types["builtin_interfaces/msg/Time"](1, 2), "base")
    messages = [
        (types.types[JOINTS](header, names, np.arange(len(names)) + 0.1 * k, np.zeros(0), np.ones(1)), True)
        for k, names in enumerate(orders)
    ]
    assert_as_rosbags(types, JOINTS, "ros2msg", messages)


def test_more_layouts_than_are_grouped_or_remembered():
    """Of one size all, each of its own layout; then all of them again."""
    types, count = known_types(), MOST_KNOWN + MOST_GROUPS + 10
    header = types.types["std_msgs/msg/Header"](types.types["builtin_interfaces/msg/Time"](1, 2), "")
    messages = [
        (
            types.types[JOINTS](
                header, ["a" * (4 * k), "b" * (4 * (count - k))], np.ones(2) * k, *[np.ones(0)] * 2
            ),
            True,
        )
        for k in [*range(count), *range(count)]
    ]
    assert len({len(types.serialize_cdr(message, JOINTS)) for message, _ in messages}) == 1
    assert_as_rosbags(types, JOINTS, "ros2msg", messages)


@pytest.mark.parametrize(("order", "identifier"), [("<", b"\0\1"), (">", b"\0\0")])
def test_alignment_counts_from_behind_the_header(tmp_path, order, identifier):
    """Laid out by hand: a double lies at a multiple of eight behind the four bytes of the encapsulation."""
    text = "uint8 a\nfloat64 b\nstring c\nuint16 d\nfloat64[] e\nuint8 f\nfloat64[] g\nint64 h\n"
    body = (
        b"\x07" + bytes(7) + struct.pack(order + "d", 1.5)  # a, 7 of padding, b: 0 to 16
        + struct.pack(order + "I", 3) + b"hi\0"  # c: 16 to 23
        + bytes(1) + struct.pack(order + "H", 513)  # d: 24 to 26
        + bytes(2) + struct.pack(order + "I", 1) + struct.pack(order + "d", -2.5)  # e: length at 28, 32 to 40
        + b"\x09"  # f: 40
        + bytes(3) + struct.pack(order + "I", 0)  # g: length at 44, nothing behind it: no padding for it
        + struct.pack(order + "q", -5)  # h: 48 to 56
    )  # fmt: skip
    fields = list("abcdefgh")
    with open_bag(recorded(tmp_path, "demo/msg/All", "ros2msg", text, [identifier + bytes(2) + body])) as bag:
        columns = bag.read("/x", fields).columns
    assert [by_message(columns[field], 1)[0] for field in fields] == [
        *(7, 1.5, "hi", 513, [-2.5], 9, [], -5),
    ]


REPRESENTATIONS = {
    0x0002: "PL_CDR_BE",
    0x0003: "PL_CDR_LE",
    0x0006: "CDR2_BE",
    0x0007: "CDR2_LE",
    0x0008: "D_CDR2_BE",
    0x0009: "D_CDR2_LE",
    0x000A: "PL_CDR2_BE",
    0x000B: "PL_CDR2_LE",
    0x0004: "00 04",  # XML
    0x0100: "01 00",
}


@pytest.mark.parametrize("identifier", REPRESENTATIONS)
def test_other_representations_are_refused_by_name(tmp_path, identifier):
    """XCDR2 aligns doubles to four bytes, and parameter lists put headers between: neither is guessed at."""
    raw = struct.pack(">HH", identifier, 0) + bytes(8)
    path = recorded(tmp_path, "std_msgs/msg/Float64", "ros2msg", "float64 data\n", [raw])
    with open_bag(path) as bag, pytest.raises(LogCorrupt, match=rf"{REPRESENTATIONS[identifier]}.*plain CDR"):
        bag.read("/x", ["data"])


def test_ros1_messages_in_mcap(tmp_path):
    """As `mcap convert` writes them of ROS 1 bags: packed, and nothing aligned."""
    text = "uint8 a\nfloat64 b\ntime c\nHeader header\n" + SEPARATOR
    text += "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    raw = struct.pack("<BdIIIIII", 7, 1.5, 3, 4, 9, 5, 6, 4) + b"base"
    path = recorded(tmp_path, "demo/All", "ros1msg", text, [raw, raw], "ros1")
    with open_bag(path) as bag:
        read = bag.read("/x", ["a", "b", "c.nanosec", "header.frame_id"])
    assert read.header_ns.tolist() == [5_000_000_006] * 2
    assert [by_message(column, 2)[1] for column in read.columns.values()] == [7, 1.5, 4, "base"]
