"""Recordings: columns are what rosbags reads message by message, and no damage goes unsaid."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import tempfile
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from backports import zstd
from hypothesis import given, settings
from hypothesis import strategies as st
from lz4 import frame
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from ruamel.yaml import YAML

from trundle.adapters import chunk_compression
from trundle.adapters.bag import open_bag
from trundle.adapters.rosmsg import leaves, struct_type
from trundle.errors import LogCorrupt, LogError, LogLimit, LogSchema, LogTruncated

START = 1_700_000_000_000_000_000
KINDS = {
    name.rpartition("/")[2]: name
    for name in """
        sensor_msgs/msg/JointState nav_msgs/msg/Odometry
        geometry_msgs/msg/Twist geometry_msgs/msg/TwistStamped
        geometry_msgs/msg/PoseStamped geometry_msgs/msg/PoseWithCovarianceStamped sensor_msgs/msg/Imu
        std_msgs/msg/Float64 std_msgs/msg/Float64MultiArray tf2_msgs/msg/TFMessage sensor_msgs/msg/LaserScan
        ackermann_msgs/msg/AckermannDriveStamped my_msgs/msg/Wheels
        std_msgs/msg/Bool std_msgs/msg/String diagnostic_msgs/msg/DiagnosticArray std_msgs/msg/Empty
    """.split()
}
STORAGES = (
    "mcap",
    "mcap-zstd",
    "mcap-message",
    "mcap-file",
    "sqlite3",
    "sqlite3-message",
    "sqlite3-file",
    "bag",
    "bag-lz4",
    "bag-bz2",
)


FOREIGN = {  # which no ROS brings by itself, the last one nobody's but ours
    "ackermann_msgs/msg/AckermannDrive": "".join(
        f"float32 {name}\n"
        for name in ("steering_angle", "steering_angle_velocity", "speed", "acceleration", "jerk")
    ),
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nAckermannDrive drive\n",
    "my_msgs/msg/Wheels": "uint8 mode\nfloat64[] ticks\nint16[3] raw\nfloat64 dt\n",
}


@cache
def store(ros: int = 2):
    types = get_typestore(Stores.ROS2_HUMBLE if ros == 2 else Stores.ROS1_NOETIC)
    for name, text in FOREIGN.items():
        types.register(get_types_from_msg(text, name))
    return types


def any_message(kind, rng, ros=2, most=3):
    """A message with random values; `most` bounds texts and arrays, so that 0 gives one layout only."""
    types = store(ros)

    def value(node):
        sort, what = node
        if sort == Nodetype.NAME:
            return any_message(what, rng, ros, most)
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
        dtype = np.dtype({"byte": "int8", "char": "uint8"}.get(name, name))
        return rng.integers(0, min(np.iinfo(dtype).max, 10**9), count).astype(dtype)

    fields = types.fielddefs[kind][1]
    return types.types[kind](**{name: value(node) for name, node in fields})


def write_bag(folder: Path, storage: str, topics, *, little_endian=True) -> Path:
    """Write `(topic, kind, [(time_ns, message)])` and return what is to be opened."""
    entries = sorted(
        (
            (ns, order, topic, message)
            for topic, kind, rows in topics
            for order, (ns, message) in enumerate(rows)
        ),
        key=lambda entry: entry[:2],
    )
    kinds = {topic: kind for topic, kind, _ in topics}
    name, _, option = storage.partition("-")
    if name == "bag":
        path = folder / "run.bag"
        writer = Writer1(path)
        writer.chunk_threshold = 20_000
        if option:
            writer.set_compression(Writer1.CompressionFormat[option.upper()])
        serialize = store(1).serialize_ros1
    else:
        path = folder / "run"
        writer = Writer(path, version=9, storage_plugin=StoragePlugin[name.upper()])
        mode = {"": "none", "zstd": "storage"}.get(option, option)
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)

        def serialize(message, kind):
            return store().serialize_cdr(message, kind, little_endian=little_endian)

    with writer:
        types = store(1 if name == "bag" else 2)
        connections = {
            topic: writer.add_connection(topic, kind, typestore=types) for topic, kind in kinds.items()
        }
        for ns, _, topic, message in entries:
            writer.write(connections[topic], ns, bytes(serialize(message, kinds[topic])))
    return path


def file_of(bag: Path) -> Path:
    """The one recording in a folder."""
    return next(path for path in bag.iterdir() if path.suffix != ".yaml")


def with_checksums(data: bytes, compression: str | None = None) -> bytes:
    """The same MCAP with the checksums that rosbags leaves at zero; lz4 on request."""
    out = bytearray(data[:8])
    summary, position, shift = 0, 8, {}
    while position < len(data) - 8:
        op = data[position]
        stop = position + 9 + struct.unpack_from("<Q", data, position + 1)[0]
        body = bytearray(data[position + 9 : stop])
        if op == 0x06:
            (length,) = struct.unpack_from("<I", body, 28)
            stored = bytes(body[40 + length :])
            content = zstd.decompress(stored) if length else stored
            struct.pack_into("<I", body, 24, zlib.crc32(content))
            if compression == "lz4":
                packed = frame.compress(content)
                body[28:] = struct.pack("<I", 3) + b"lz4" + struct.pack("<Q", len(packed)) + packed
            shift[position] = len(out)
        if op == 0x08:
            struct.pack_into("<Q", body, 16, shift[struct.unpack_from("<Q", body, 16)[0]])
        if op == 0x02:
            struct.pack_into("<Q", body, 0, summary)
            record = b"\x02" + struct.pack("<Q", 20) + bytes(body[:16])
            struct.pack_into("<I", body, 16, zlib.crc32(bytes(out[summary:]) + record))
        out += bytes([op]) + struct.pack("<Q", len(body)) + body
        if op == 0x0F:
            summary = len(out)
        position = stop
    return bytes(out) + data[-8:]


def chunks_of(data: bytes) -> list[tuple[int, int]]:
    """Where the chunk records of an MCAP begin and end."""
    found, position = [], 8
    while position + 9 <= len(data):
        stop = position + 9 + struct.unpack_from("<Q", data, position + 1)[0]
        if data[position] == 0x06:
            found.append((position, stop))
        position = stop
    return found


def read_by_rosbags(path: Path, topic: str, fields):
    """Receive times, header times and, by field, a list with one entry per message."""
    receive, header = [], []
    values: dict[str, list] = {field: [] for field in fields}
    with AnyReader([path], default_typestore=store()) as reader:
        for connection, ns, raw in reader.messages(reader.topics[topic].connections):
            message = reader.deserialize(raw, connection.msgtype)
            receive.append(ns)
            if hasattr(message, "header"):
                header.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            for field in fields:
                values[field].append(_follow(message, field.split(".")))
    return receive, header or None, values


def _follow(value, parts):
    if not parts:
        return value
    if isinstance(value, list):
        found = [_follow(each, parts) for each in value]
        return [word for each in found for word in (each if isinstance(each, list | np.ndarray) else [each])]
    return _follow(getattr(value, parts[0]), parts[1:])


def same(column, expected) -> bool:
    """Whether a column holds what rosbags read, message by message."""
    if isinstance(column, str | tuple):
        return all(column == (tuple(word) if isinstance(word, list) else word) for word in expected)
    if len(column) != len(expected):
        return False
    for mine, theirs in zip(column, expected, strict=True):
        if isinstance(mine, str | tuple):
            if mine != (tuple(theirs) if isinstance(theirs, list) else theirs):
                return False
        elif not np.array_equal(mine, np.asarray(theirs, mine.dtype).reshape(mine.shape), equal_nan=True):
            return False
    return True


def fields_of(kind, ros=2):
    text, _ = store(ros).generate_msgdef(kind, ros_version=ros)
    return list(leaves(struct_type("test", kind, f"ros{ros}msg", text)))


def assert_as_rosbags(bag, path, topic, fields):
    read = bag.read(topic, fields)
    receive, header, values = read_by_rosbags(path, topic, fields)
    assert read.receive_ns.tolist() == receive
    assert (None if read.header_ns is None else read.header_ns.tolist()) == header
    assert {field for field in fields if not same(read.columns[field], values[field])} == set()


def rows(kind, seed, count, ros, most):
    rng = np.random.default_rng(seed)
    return [(START + 10_000_000 * k + seed % 7, any_message(kind, rng, ros, most)) for k in range(count)]


@settings(max_examples=30)
@given(
    storage=st.sampled_from(STORAGES),
    kinds=st.lists(st.sampled_from(sorted(KINDS)), min_size=1, max_size=3, unique=True),
    seed=st.integers(0, 2**16),
    count=st.integers(1, 30),
    most=st.sampled_from([0, 1, 3]),
    little_endian=st.booleans(),
)
def test_columns_are_what_rosbags_reads(storage, kinds, seed, count, most, little_endian):
    ros = 1 if storage.startswith("bag") else 2
    kinds = [kind for kind in kinds if KINDS[kind] in store(ros).fielddefs] or ["JointState"]
    topics = [
        (f"/{kind}", KINDS[kind], rows(KINDS[kind], seed + n, count, ros, most))
        for n, kind in enumerate(kinds)
    ]
    with tempfile.TemporaryDirectory() as name:
        path = write_bag(Path(name), storage, topics, little_endian=little_endian)
        with open_bag(path) as bag:
            for topic, kind, messages in topics:
                stamps = [ns for ns, _ in messages]
                info = bag.topics[topic]
                assert (info.type, info.count) == (kind, count)
                assert (info.first_ns, info.last_ns) == (stamps[0], stamps[-1])
                assert_as_rosbags(
                    bag, path, topic, [f for f in fields_of(kind, ros) if "structure_needs" not in f]
                )
            assert bag.losses == []


@pytest.mark.parametrize("compression", ["none", "zstd", "lz4"])
def test_mcap_with_checksums(tmp_path, compression):
    topics = [("/a", KINDS["JointState"], rows(KINDS["JointState"], 1, 50, 2, 0))]
    file = file_of(write_bag(tmp_path, "mcap-zstd" if compression == "zstd" else "mcap", topics))
    plain = read_by_rosbags(file, "/a", ["name", "position"])
    file.write_bytes(with_checksums(file.read_bytes(), compression))
    with open_bag(file) as bag:
        read = bag.read("/a", ["name", "position"])
        assert bag.warnings == bag.losses == []
    assert read.receive_ns.tolist() == plain[0]
    assert all(same(read.columns[field], plain[2][field]) for field in ("name", "position"))


@pytest.mark.parametrize("storage", ["sqlite3", "sqlite3-message", "mcap", "mcap-zstd"])
def test_folder_of_several_files(tmp_path, storage):
    """A recording that was split: metadata.yaml names its parts, which are read in their order."""
    kind, folder = KINDS["JointState"], tmp_path / "whole"
    folder.mkdir()
    messages = rows(kind, 5, 60, 2, 3)
    parts, metadata = [], {}
    for number in range(3):
        place = tmp_path / str(number)
        place.mkdir()
        part = write_bag(place, storage, [("/a", kind, messages[20 * number : 20 * number + 20])])
        file = file_of(part)
        parts.append(f"whole_{number}{file.suffix}")
        shutil.copy(file, folder / parts[-1])
        metadata = YAML().load((part / "metadata.yaml").read_text())
    about = metadata["rosbag2_bagfile_information"]
    about["relative_file_paths"] = parts
    about["message_count"] = about["topics_with_message_count"][0]["message_count"] = 60
    YAML().dump(metadata, folder / "metadata.yaml")
    with open_bag(folder) as bag:
        read = bag.read("/a", ["name", "position", "header.frame_id"])
        assert (bag.topics["/a"].count, bag.losses) == (60, [])
    assert read.receive_ns.tolist() == [ns for ns, _ in messages]
    assert same(read.columns["name"], [message.name for _, message in messages])
    assert same(read.columns["position"], [message.position for _, message in messages])
    assert same(read.columns["header.frame_id"], [message.header.frame_id for _, message in messages])


@pytest.mark.parametrize("kind", [*FOREIGN, "sensor_msgs/msg/JointState"])
def test_databases_without_definitions(tmp_path, kind):
    """As ROS 2 wrote them until Humble, by default: what is no type of the field is refused."""
    messages = rows(kind, 5, 20, 2, 0)
    path = write_bag(tmp_path, "sqlite3", [("/a", kind, messages)])
    with sqlite3.connect(file_of(path)) as database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    with open_bag(path) as bag:
        if kind == "my_msgs/msg/Wheels":
            with pytest.raises(LogSchema, match="carries no definition of my_msgs/msg/Wheels"):
                bag.read("/a", ["ticks"])
            return
        fields = fields_of(kind)
        read = bag.read("/a", fields)
    for field in fields:
        assert same(read.columns[field], [_follow(message, field.split(".")) for _, message in messages])


@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
@pytest.mark.parametrize("summary", [True, False], ids=["summary", "no summary"])
@pytest.mark.parametrize("index", [True, False], ids=["index", "no index"])
def test_what_is_optional_may_be_absent(tmp_path, compression, summary, index):
    numbers = [float(n) for n in range(10)]
    body = DEFINITIONS
    entries = b""
    for n, number in enumerate(numbers):
        entries += struct.pack("<QQ", n, len(body))
        body += number_message(n, number)
    data = BEGIN + chunk(body, compression, crc=zlib.crc32(body))
    data += record(0x07, struct.pack("<H", 1) + words(entries)) if index else b""
    data += record(0x0F, bytes(4))
    start, footer = len(data), b"\x02" + struct.pack("<Q", 20)
    data += DEFINITIONS if summary else b""
    with open_bag(write(tmp_path, data + footer + struct.pack("<QQI", start * summary, 0, 0) + MAGIC)) as bag:
        assert bag.read("/x", ["data"]).columns["data"].tolist() == numbers
        assert bag.losses == []


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_chunks_without_the_topic_are_not_decompressed(tmp_path, compression):
    """What cannot be decompressed stands in nobody's way who does not ask for it."""
    other = DEFINITIONS.replace(b"/x", b"/y").replace(struct.pack("<HH", 1, 1), struct.pack("<HH", 2, 1))
    bad = bytearray(chunk(number_message(3, 3.0, channel=2) * 50, compression))
    bad[-40:] = b"\xff" * 40
    parts = [
        chunk(number_message(1, 1.0), compression) + one_entry(1, 1),
        bytes(bad) + one_entry(2, 50),
        chunk(number_message(4, 4.0), compression) + one_entry(1, 1),
    ]
    file = write(tmp_path, BEGIN + DEFINITIONS + other + b"".join(parts) + END)
    with open_bag(file) as bag:
        assert {topic: info.count for topic, info in bag.topics.items()} == {"/x": 2, "/y": 50}
        assert bag.read("/x", ["data"]).columns["data"].tolist() == [1.0, 4.0]
        with pytest.raises(LogCorrupt, match="decompress"):
            bag.read("/y", ["data"])


def one_entry(channel, count):
    """The index of a chunk with so many messages of one length."""
    size = len(number_message(0, 0.0))
    return record(
        0x07,
        struct.pack("<H", channel) + words(b"".join(struct.pack("<QQ", 1, size * n) for n in range(count))),
    )


def test_shape_of_columns(tmp_path):
    names, types = ("left", "right"), store().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](12, 34), "base")

    def joints(count):
        return types["sensor_msgs/msg/JointState"](
            header, list(names), np.arange(2.0), np.ones(count), np.ones(0)
        )

    kind = "sensor_msgs/msg/JointState"
    even = [(START + n, joints(2)) for n in range(5)]
    uneven = [(START + n, joints(n)) for n in range(5)]
    bag = write_bag(tmp_path, "mcap", [("/even", kind, even), ("/uneven", kind, uneven)])
    with open_bag(bag) as reader:
        read = reader.read("/even", ["name", "position", "effort", "header.frame_id", "header.stamp.sec"])
        assert read.columns["name"] == names
        assert read.columns["header.frame_id"] == "base"
        assert read.columns["position"].tolist() == [[0.0, 1.0]] * 5
        assert read.columns["effort"].shape == (5, 0)
        assert read.columns["header.stamp.sec"].tolist() == [12] * 5
        assert read.header_ns.tolist() == [12_000_000_034] * 5
        lists = reader.read("/uneven", ["velocity"]).columns["velocity"]
        assert [len(values) for values in lists] == [0, 1, 2, 3, 4]


def test_order_is_that_of_receiving(tmp_path):
    kind = KINDS["Float64"]
    stamps = [5, 3, 9, 1, 3]
    messages = [store().types[kind](float(n)) for n in range(5)]
    with Writer(tmp_path / "unordered", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/x", kind, typestore=store())
        for stamp, message in zip(stamps, messages, strict=True):
            writer.write(topic, START + stamp, bytes(store().serialize_cdr(message, kind)))
    with open_bag(tmp_path / "unordered") as bag:
        read = bag.read("/x", ["data"])
    assert (read.receive_ns - START).tolist() == [1, 3, 3, 5, 9]
    assert read.columns["data"].tolist() == [3.0, 1.0, 4.0, 0.0, 2.0]


def test_names_in_another_order_are_seen(tmp_path):
    """Names of the same lengths in another order have the same layout, and other names."""
    kind, types = "sensor_msgs/msg/JointState", store().types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    nothing = np.empty(0)
    orders = [["aa", "bb"]] * 3 + [["bb", "aa"]] * 2
    messages = [
        (START + n, types[kind](header, names, np.arange(2.0), nothing, nothing))
        for n, names in enumerate(orders)
    ]
    with open_bag(write_bag(tmp_path, "mcap", [("/joints", kind, messages)])) as bag:
        assert bag.read("/joints", ["name"]).columns["name"] == [tuple(names) for names in orders]


def test_unknown_names_are_answered_with_known_ones(tmp_path):
    kind = "geometry_msgs/msg/PoseStamped"
    with open_bag(write_bag(tmp_path, "mcap", [("/pose", kind, rows(kind, 0, 2, 2, 0))])) as bag:
        with pytest.raises(LogSchema, match=r"did you mean '/pose'.*has /pose"):
            bag.read("/poses", [])
        with pytest.raises(LogSchema, match=r"did you mean 'pose.position.x'"):
            bag.read("/pose", ["pose.positon.x"])
        with pytest.raises(LogSchema, match=r"whole geometry_msgs/msg/Point.*pose.position.y"):
            bag.read("/pose", ["pose.position"])


IDL = """module demo { module msg {
  typedef double double__3[3];
  struct Wheel { string name; sequence<double> ticks; double__3 pose; int32 count; };
}; };"""


def test_idl_gives_the_same_type_as_msg():
    text = "string name\nfloat64[] ticks\nfloat64[3] pose\nint32 count # of ticks\nint32 MOST=3\n"
    assert struct_type("", "demo/Wheel", "ros2msg", text) == struct_type("", "demo/msg/Wheel", "ros2idl", IDL)


@pytest.mark.parametrize("text", ["float64", "Wheel other", "wheel_msgs/Wheel wheel"])
def test_bad_schemas_are_refused(text):
    with pytest.raises(LogSchema):
        struct_type("run.mcap", "demo/Wheel", "ros2msg", text)


@pytest.mark.parametrize(
    "recording",
    ["turtlebot_nav2/nav2_turtlebot.mcap", "polimi_mecanum/bag1.bag", "f1tenth/skidpad_2_5.bag"],
)
def test_real_recordings(shared_data, recording):
    path = shared_data / recording
    with open_bag(path) as bag:
        topics = sorted(bag.topics, key=lambda topic: -bag.topics[topic].count)[:6]
        for topic in topics:
            kind, _ = bag._recordings[0].message_type(topic)
            assert_as_rosbags(bag, path, topic, list(leaves(kind)))
        assert bag.losses == []


def records_of(data: bytes):
    """Kind, begin and end of each record of an MCAP."""
    position = 8
    while position + 9 <= len(data) - 8:
        stop = position + 9 + struct.unpack_from("<Q", data, position + 1)[0]
        yield data[position], position, stop
        position = stop


def split_into_chunks(data: bytes, count: int) -> bytes:
    """An MCAP of one plain chunk as zstd chunks of so many messages, with all indexes and checksums."""
    ((start, stop),) = chunks_of(data)
    content = data[start + 9 + 40 : stop]
    inner = [
        (op, content[a:b])
        for op, a, b in records_of(bytes(8) + content + bytes(8))
        for a, b in [(a - 8, b - 8)]
    ]
    definitions = b"".join(body for op, body in inner if op != 0x05)
    messages = [body for op, body in inner if op == 0x05]
    out, index = bytearray(BEGIN), b""
    for first in range(0, len(messages), count):
        part = messages[first : first + count]
        body = (definitions if not first else b"") + b"".join(part)
        stamps = [struct.unpack_from("<Q", message, 15)[0] for message in part]
        offset, entries = len(body) - sum(map(len, part)), b""
        for stamp, message in zip(stamps, part, strict=True):
            entries += struct.pack("<QQ", stamp, offset)
            offset += len(message)
        packed = zstd.compress(body)
        head = struct.pack("<QQQI", stamps[0], stamps[-1], len(body), zlib.crc32(body)) + words(b"zstd")
        position = len(out)
        out += record(0x06, head + struct.pack("<Q", len(packed)) + packed)
        end = len(out)
        channel = part[0][9:11]
        out += record(0x07, channel + words(entries))
        index += record(
            0x08,
            struct.pack("<QQQQ", stamps[0], stamps[-1], position, end - position)
            + words(channel + struct.pack("<Q", end))
            + struct.pack("<Q", len(out) - end)
            + words(b"zstd")
            + struct.pack("<QQ", len(packed), len(body)),
        )
    out += record(0x0F, bytes(4))
    summary = len(out)
    out += definitions + index
    counts = words(channel + struct.pack("<Q", len(messages)))
    chunks = -(-len(messages) // count)
    out += record(0x0B, struct.pack("<QHIIIIQQ", len(messages), 1, 1, 0, 0, chunks, 0, 0) + counts)
    footer = b"\x02" + struct.pack("<QQQ", 20, summary, 0)
    out += footer + struct.pack("<I", zlib.crc32(bytes(out[summary:]) + footer)) + MAGIC
    return bytes(out)


# ----------------------------------------------------------------------------- damage


@pytest.fixture(scope="module")
def joints(tmp_path_factory):
    """A small MCAP of several compressed chunks with checksums, as bytes, and its columns."""
    folder = tmp_path_factory.mktemp("bag")
    kind = KINDS["JointState"]
    file = file_of(write_bag(folder, "mcap", [("/joints", kind, rows(kind, 3, 240, 2, 0))]))
    data = split_into_chunks(file.read_bytes(), 40)
    file.write_bytes(data)
    with open_bag(file) as bag:
        assert bag.warnings == []
        return data, bag.read("/joints", JOINT_FIELDS)


JOINT_FIELDS = ["name", "position", "velocity", "header.stamp.sec"]


def salvaged(path):
    with open_bag(path, salvage=True) as bag:
        if "/joints" not in bag.topics:
            return None, bag.losses, bag.warnings
        return bag.read("/joints", JOINT_FIELDS), bag.losses, bag.warnings


def assert_subset(part, whole):
    """What was recovered is true: each message is one of the original ones."""
    where = np.searchsorted(whole.receive_ns, part.receive_ns)
    assert np.array_equal(whole.receive_ns[where], part.receive_ns)
    assert part.columns["name"] == whole.columns["name"] or not len(where)
    for field in JOINT_FIELDS[1:]:
        assert np.array_equal(part.columns[field], whole.columns[field][where])


@given(data=st.data())
def test_truncation_is_reported_and_whole_chunks_are_recovered(joints, tmp_path_factory, data):
    whole, columns = joints
    cut = data.draw(st.integers(8, len(whole) - 1))
    file = tmp_path_factory.mktemp("cut") / "cut.mcap"
    file.write_bytes(whole[:cut])
    promised = 40 * sum(1 for _, stop in chunks_of(whole) if stop <= cut)
    end_of_data = data_end(whole)
    if cut >= end_of_data:  # nothing is lost, and what was not checked is said
        with open_bag(file) as bag:
            assert any("unverified" in warning for warning in bag.warnings)
            assert np.array_equal(
                bag.read("/joints", ["position"]).columns["position"], columns.columns["position"]
            )
        return
    with pytest.raises(LogTruncated, match=rf"ends at byte {cut}\b"):
        open_bag(file)
    part, losses, _ = salvaged(file)
    assert losses
    assert (0 if part is None else len(part.receive_ns)) >= promised
    if part is not None:
        assert_subset(part, columns)


@settings(max_examples=200)
@given(data=st.data())
def test_no_bit_flip_is_silent(joints, tmp_path_factory, data):
    whole, columns = joints
    bit = data.draw(st.integers(0, 8 * len(whole) - 1))
    assert_flip_is_not_silent(whole, columns, bit, tmp_path_factory.mktemp("flip") / "flip.mcap")


@pytest.mark.verify
def test_no_bit_flip_of_ten_thousand_is_silent(joints, tmp_path):
    whole, columns = joints
    for bit in np.random.default_rng(0).choice(8 * len(whole), 10_000, replace=False).tolist():
        assert_flip_is_not_silent(whole, columns, bit, tmp_path / "flip.mcap")


@pytest.mark.verify
def test_truncation_at_every_byte(joints, tmp_path):
    whole, columns = joints
    file = tmp_path / "cut.mcap"
    for cut in range(len(whole)):
        file.write_bytes(whole[:cut])
        if cut >= data_end(whole):
            with open_bag(file) as bag:
                assert bag.warnings
                assert bag.topics["/joints"].count == 240
            continue
        with pytest.raises(LogError):
            open_bag(file)
        if cut >= 8:
            part, losses, _ = salvaged(file)
            assert losses
            promised = 40 * sum(1 for _, stop in chunks_of(whole) if stop <= cut)
            assert (0 if part is None else len(part.receive_ns)) >= promised
            assert part is None or assert_subset(part, columns) is None


def assert_flip_is_not_silent(whole, columns, bit, file):
    """The same columns or an error; with salvage true messages and, where some are missing, a loss."""
    flipped = bytearray(whole)
    flipped[bit // 8] ^= 1 << bit % 8
    file.write_bytes(flipped)
    try:
        with open_bag(file) as bag:
            read = bag.read("/joints", JOINT_FIELDS)
        assert np.array_equal(read.receive_ns, columns.receive_ns)
        assert_subset(read, columns)
    except LogError:
        pass
    if bit >= 64:
        try:
            part, losses, _ = salvaged(file)
        except LogError:
            return
        missing = part is None or len(part.receive_ns) < len(columns.receive_ns)
        assert losses or not missing
        if part is not None:
            assert_subset(part, columns)


def data_end(data: bytes) -> int:
    """Where the record that ends the data section ends."""
    return next(stop for op, _, stop in records_of(data) if op == 0x0F)


# ------------------------------------------------------------------------ MCAP by hand


def words(*parts: bytes) -> bytes:
    return b"".join(struct.pack("<I", len(part)) + part for part in parts)


def record(op: int, content: bytes) -> bytes:
    return bytes([op]) + struct.pack("<Q", len(content)) + content


MAGIC = b"\x89MCAP0\r\n"
BEGIN = MAGIC + record(0x01, words(b"", b""))
END = record(0x0F, bytes(4)) + record(0x02, bytes(20)) + MAGIC
DEFINITIONS = record(
    0x03, struct.pack("<H", 1) + words(b"std_msgs/msg/Float64", b"ros2msg", b"float64 data")
) + record(0x04, struct.pack("<HH", 1, 1) + words(b"/x", b"cdr", b""))


def number_message(stamp, value, channel=1):
    return record(
        0x05, struct.pack("<HIQQ", channel, 0, stamp, stamp) + b"\0\1\0\0" + struct.pack("<d", value)
    )


def chunk(content: bytes, compression="", size=None, crc=0):
    packed = {"": bytes, "zstd": zstd.compress, "lz4": frame.compress}[compression](content)
    size = len(content) if size is None else size
    head = (
        struct.pack("<QQQI", 1, 2, size, crc) + words(compression.encode()) + struct.pack("<Q", len(packed))
    )
    return record(0x06, head + packed)


def write(tmp_path, data, name="run.mcap"):
    file = tmp_path / name
    file.write_bytes(data)
    return file


# ----------------------------------------------------------------------------- faults


def refuses(tmp_path, data, error, match):
    with pytest.raises(error, match=match):
        open_bag(write(tmp_path, data))


def fault_empty(tmp_path):
    refuses(tmp_path, b"", LogError, r"holds nothing \[empty\]")


def fault_no_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path / "missing.mcap", tmp_path / ("x" * 300)):
        with pytest.raises(LogError, match="not_a_file"):
            open_bag(path)
    with pytest.raises(LogError, match=r"neither a metadata\.yaml nor"):
        open_bag(tmp_path)


def fault_cut_chunk(tmp_path):
    """Of the last, cut chunk too, every whole message is recovered."""
    content = DEFINITIONS + b"".join(number_message(n, float(n)) for n in range(10))
    for compression in ("", "zstd", "lz4"):
        data = BEGIN + chunk(content, compression)
        file = write(tmp_path, data[: -5 if compression else -50])
        with pytest.raises(
            LogTruncated, match=f"ends at byte {file.stat().st_size}, inside the chunk record"
        ):
            open_bag(file)
        with open_bag(file, salvage=True) as bag:
            if not compression:
                assert bag.read("/x", ["data"]).columns["data"].tolist() == list(range(8))
            kept = "no chunk before it is whole; what is whole of it is kept; what came behind is lost"
            assert bag.losses[0].endswith(kept)


def fault_cut_between(tmp_path):
    """A file that ends between two records is short all the same."""
    refuses(tmp_path, BEGIN + DEFINITIONS + number_message(1, 2.0), LogTruncated, "ends at byte")


def fault_hole(tmp_path):
    """Salvage passes over a damaged chunk and says from when to when."""
    good, bad = DEFINITIONS + number_message(1, 1.0), number_message(2, 2.0)
    parts = [chunk(good, crc=zlib.crc32(good)), chunk(bad, crc=1), chunk(good, crc=zlib.crc32(good))]
    file = write(tmp_path, BEGIN + b"".join(parts) + END)
    start = len(BEGIN) + len(parts[0])
    with pytest.raises(LogCorrupt, match=rf"the chunk at byte {start} \(0.000000001 to 0.000000002 s\).*CRC"):
        open_bag(file)
    with open_bag(file, salvage=True) as bag:
        assert bag.read("/x", ["data"]).columns["data"].tolist() == [1.0, 1.0]
        assert "to 0.000000002 s" in bag.losses[0]


def fault_no_checksums(tmp_path):
    content = DEFINITIONS + b"".join(number_message(n, float(n)) for n in range(4))
    for body in (chunk(content), content):
        with open_bag(write(tmp_path, BEGIN + body + END)) as bag:
            assert bag.read("/x", ["data"]).columns["data"].tolist() == [0.0, 1.0, 2.0, 3.0]
            assert [warning for warning in bag.warnings if "unverified" in warning]
            assert bag.losses == []


def fault_bombs(tmp_path):
    zeros = bytes(64 << 20)
    for compression in ("zstd", "lz4"):
        refuses(tmp_path, BEGIN + chunk(zeros, compression) + END, LogLimit, "allowed are 100 times as many")
        lie = chunk(zeros, compression, size=1000)
        refuses(tmp_path, BEGIN + lie + END, LogCorrupt, "does not decompress to the 1000 bytes")
    refuses(tmp_path, zstd.compress(bytes(1 << 28)), LogLimit, "grows from")


def fault_bomb_in_total(tmp_path, monkeypatch):
    monkeypatch.setattr(chunk_compression, "MOST_IN_TOTAL", 1 << 20)
    body = chunk(DEFINITIONS + record(0x80, bytes(900_000)), "zstd") * 2
    refuses(tmp_path, BEGIN + body + END, LogLimit, "would grow to 1 MiB; allowed are 1 MiB")


def fault_length_lies(tmp_path):
    refuses(tmp_path, BEGIN + b"\x06" + struct.pack("<Q", 4 << 30), LogTruncated, "inside the chunk record")
    nested = chunk(DEFINITIONS + b"\x05" + struct.pack("<Q", 1 << 63))
    refuses(tmp_path, BEGIN + nested + END, LogCorrupt, "reaches beyond its end")
    text = struct.pack("<HIQQ", 1, 0, 1, 1) + b"\0\1\0\0" + struct.pack("<I", 0xFFFFFFFF) + bytes(8)
    schema = record(0x03, struct.pack("<H", 1) + words(b"std_msgs/msg/X", b"ros2msg", b"float64[] data"))
    channel = record(0x04, struct.pack("<HH", 1, 1) + words(b"/x", b"cdr", b""))
    file = write(tmp_path, BEGIN + schema + channel + record(0x05, text) + END)
    with (
        open_bag(file) as bag,
        pytest.raises(LogCorrupt, match="says at byte 4 that 4294967295 values follow"),
    ):
        bag.read("/x", ["data"])


def two_hundred(tmp_path, storage="sqlite3"):
    kind = KINDS["Float64"]
    messages = [(START + n, store().types[kind](float(n))) for n in range(4000)]
    return write_bag(tmp_path, storage, [("/x", kind, messages)])


def fault_sqlite_cut(tmp_path):
    bag_path = two_hundred(tmp_path)
    file = file_of(bag_path)
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(LogTruncated, match=f"of {len(whole)}"):
        open_bag(file)
    with open_bag(file, salvage=True) as bag:
        read = bag.read("/x", ["data"])
        assert 1000 < len(read.receive_ns) < 4000
        assert np.array_equal(read.columns["data"], (read.receive_ns - START).astype(float))
        assert any("lost" in loss for loss in bag.losses)


def fault_sqlite_malformed(tmp_path):
    file = file_of(two_hundred(tmp_path))
    data = bytearray(file.read_bytes())
    data[20 * 4096 : 20 * 4096 + 64] = b"\xff" * 64
    file.write_bytes(data)
    with pytest.raises(LogCorrupt, match="sqlite3 says"), open_bag(file) as bag:
        bag.read("/x", ["data"])
    with open_bag(file, salvage=True) as bag:
        read = bag.read("/x", ["data"])
        assert 3000 < len(read.receive_ns) < 4000
        assert np.array_equal(read.columns["data"], (read.receive_ns - START).astype(float))
        assert any("lost" in loss for loss in bag.losses)


def fault_unfinished(tmp_path):
    """Without metadata, or with those of another bag."""
    for storage in ("sqlite3", "mcap"):
        folder = tmp_path / storage
        folder.mkdir()
        path = two_hundred(folder, storage)
        metadata = path / "metadata.yaml"
        text = metadata.read_text()
        metadata.write_text(text.replace("message_count: 4000", "message_count: 4001"))
        with pytest.raises(LogCorrupt, match=r"4000 messages of /x, where its metadata\.yaml says 4001"):
            open_bag(path)
        for broken in (None, "", "a: [", "- x", "rosbag2_bagfile_information: {}"):
            metadata.unlink() if broken is None else metadata.write_text(broken)
            with open_bag(path) as bag:
                assert len(bag.read("/x", ["data"]).receive_ns) == 4000
                assert any("metadata.yaml" in warning for warning in bag.warnings)


def fault_write_ahead(tmp_path):
    """What a recorder that was killed left in its write-ahead log is read, from a copy."""
    file = file_of(two_hundred(tmp_path))
    database = sqlite3.connect(file)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute(
        "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, ?, data FROM messages LIMIT 1",
        (START + 9999,),
    )
    database.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for path in file.parent.glob("*.db3*"):
        shutil.copy(path, killed / path.name)
    database.close()
    before = {path.name: path.read_bytes() for path in killed.iterdir()}
    with open_bag(killed / file.name) as bag:
        assert bag.topics["/x"].count == 4001
        assert any("did not finish" in warning for warning in bag.warnings)
    assert before == {path.name: path.read_bytes() for path in killed.iterdir()}


def fault_other_content(tmp_path):
    refuses(tmp_path, b"time,left.position\n0,1\n", LogError, r"recordings begin as MCAP.*\[format\]")
    other = tmp_path / "other.db3"
    database = sqlite3.connect(other)
    database.execute("CREATE TABLE songs (name)")
    database.commit()
    database.close()
    with pytest.raises(LogError, match=r": is a database, but no rosbag2: its tables are songs"):
        open_bag(other)


def fault_wrong_suffix(tmp_path):
    file = file_of(two_hundred(tmp_path))
    other = file.rename(file.with_name("run.mcap"))
    with open_bag(other) as bag:
        assert bag.topics["/x"].count == 4000


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(fault_empty, id="L1-empty"),
        pytest.param(fault_no_file, id="L1-no_file"),
        pytest.param(fault_cut_chunk, id="L2-chunk"),
        pytest.param(fault_cut_between, id="L2-between"),
        pytest.param(fault_hole, id="L3"),
        pytest.param(fault_no_checksums, id="L4"),
        pytest.param(fault_bombs, id="L5"),
        pytest.param(fault_length_lies, id="L5-lengths"),
        pytest.param(fault_sqlite_cut, id="L6-cut"),
        pytest.param(fault_sqlite_malformed, id="L6-malformed"),
        pytest.param(fault_unfinished, id="L6-metadata"),
        pytest.param(fault_write_ahead, id="L6-wal"),
        pytest.param(fault_other_content, id="L7-content"),
        pytest.param(fault_wrong_suffix, id="L7-suffix"),
    ],
)
def test_fault(fault, tmp_path):
    fault(tmp_path)


def test_growth_in_total_is_limited(tmp_path, monkeypatch):
    fault_bomb_in_total(tmp_path, monkeypatch)


@pytest.mark.parametrize("compression", ["", "-lz4", "-bz2"])
def test_ros1_bag_that_was_cut(tmp_path, compression):
    kind = KINDS["JointState"]
    file = write_bag(tmp_path, f"bag{compression}", [("/joints", kind, rows(kind, 3, 600, 1, 0))])
    with open_bag(file) as bag:
        columns = bag.read("/joints", JOINT_FIELDS)
        ends = [chunk.stop for chunk in bag._recordings[0]._chunks]
        end_of_data = bag._recordings[0]._index_position
    assert len(ends) > 1
    whole = file.read_bytes()
    for cut in np.linspace(20, len(whole) - 1, 12).astype(int).tolist():
        file.write_bytes(whole[:cut])
        if cut >= end_of_data:
            with open_bag(file) as bag:
                assert bag.topics["/joints"].count == 600
                assert len(bag.warnings) > 1
            continue
        with pytest.raises(LogError):
            open_bag(file)
        part, losses, _ = salvaged(file)
        assert losses
        if part is not None:
            assert_subset(part, columns)
        if cut > ends[0]:
            assert len(part.receive_ns) > 0
