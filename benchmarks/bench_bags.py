"""Reading one topic of a recording: Trundle beside rosbags, in one run.

    python benchmarks/bench_bags.py [messages]

100,000 JointState messages of four wheels, as MCAP with and without compression, with and without checksums
(CRC), and as sqlite3 and ROS 1 bags. Both readers give times, names, positions and velocities.
"""

from __future__ import annotations

import struct
import sys
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from backports import zstd
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from trundle.adapters.bag import open_bag

TOPIC = "/joint_states"
NAMES = [
    "front_left_wheel_joint",
    "front_right_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
]
ROUNDS = 5


def messages(store, count):
    """Wheels that turn at slowly changing speeds, at 100 Hz."""
    kinds = store.types
    header, stamp, joints = (
        kinds[f"{name}"]
        for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time", "sensor_msgs/msg/JointState")
    )
    sequence = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
    times = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(count)
    speeds = 5.0 * np.sin(np.arange(count)[:, None] / 500.0 + np.arange(4))
    angles = np.cumsum(speeds, axis=0) * 0.01
    for ns, position, velocity in zip(times.tolist(), angles, speeds, strict=True):
        head = header(**sequence, stamp=stamp(ns // 10**9, ns % 10**9), frame_id="base_link")
        yield ns + 250_000, joints(head, NAMES, position, velocity, np.zeros(4))


def write_rosbag2(folder, count, plugin, mode):
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        kind = "sensor_msgs/msg/JointState"
        topic = writer.add_connection(TOPIC, kind, typestore=store)
        for ns, message in messages(store, count):
            writer.write(topic, ns, store.serialize_cdr(message, kind))


def write_rosbag1(path, count):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        kind = "sensor_msgs/msg/JointState"
        topic = writer.add_connection(TOPIC, kind, typestore=store)
        for ns, message in messages(store, count):
            writer.write(topic, ns, store.serialize_ros1(message, kind))


def add_checksums(path):
    """Fill in the checksums that rosbags leaves at zero and other writers do not."""
    data = bytearray(path.read_bytes())
    position, summary = 8, 0
    while data[position] != 0x02:
        start = position + 9
        stop = start + struct.unpack_from("<Q", data, position + 1)[0]
        if data[position] == 0x06:
            (length,) = struct.unpack_from("<I", data, start + 28)
            stored = bytes(data[start + 40 + length : stop])
            content = zstd.decompress(stored) if length else stored
            struct.pack_into("<I", data, start + 24, zlib.crc32(content))
        if data[position] == 0x0F:
            summary = stop
        position = stop
    struct.pack_into("<I", data, position + 25, zlib.crc32(data[summary : position + 25]))
    path.write_bytes(data)


def with_trundle(path):
    with open_bag(path) as bag:
        columns = bag.read(TOPIC, ["name", "position", "velocity"])
    return (
        columns.header_ns,
        columns.columns["name"],
        columns.columns["position"],
        columns.columns["velocity"],
    )


def with_rosbags(path):
    stamps, names, positions, velocities = [], None, [], []
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages([c for c in reader.connections if c.topic == TOPIC]):
            message = reader.deserialize(raw, connection.msgtype)
            stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)
            names = tuple(message.name)
            positions.append(message.position)
            velocities.append(message.velocity)
    return np.array(stamps), names, np.array(positions), np.array(velocities)


def seconds(call: Callable[[], object]) -> float:
    begin = time.perf_counter()
    call()
    return time.perf_counter() - begin


def compare(name, path, count):
    ours, theirs = with_trundle(path), with_rosbags(path)  # warm, and equal
    assert all(np.array_equal(one, other) for one, other in zip(ours, theirs, strict=True)), name
    trundle, rosbags = [], []
    for _ in range(ROUNDS):
        trundle += [seconds(lambda: with_trundle(path)) for _ in range(5)]
        rosbags.append(seconds(lambda: with_rosbags(path)))
    mine, other = min(trundle), min(rosbags)
    size = sum(file.stat().st_size for file in ([path] if path.is_file() else path.iterdir())) / 1e6
    print(
        f"{name:<24}{size:>8.1f}{mine / count * 1e9:>12.0f}{other / count * 1e9:>12.0f}{other / mine:>9.1f}x"
    )


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    print(f"{count} JointState messages, four wheels; best of {ROUNDS} rounds, one beside the other")
    print(f"{'recording':<24}{'MB':>8}{'trundle':>12}{'rosbags':>12}{'faster':>10}")
    print(f"{'':<32}{'ns/message':>12}{'ns/message':>12}")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, mode in (
            ("MCAP, uncompressed", CompressionMode.NONE),
            ("MCAP, zstd", CompressionMode.STORAGE),
        ):
            bag = folder / mode.name.lower()
            write_rosbag2(bag, count, StoragePlugin.MCAP, mode)
            (file,) = bag.glob("*.mcap")
            compare(f"{title}, no CRC", file, count)
            add_checksums(file)
            compare(title, file, count)
        write_rosbag2(folder / "sqlite3", count, StoragePlugin.SQLITE3, CompressionMode.NONE)
        compare("rosbag2, sqlite3", folder / "sqlite3", count)
        write_rosbag1(folder / "one.bag", count)
        compare("ROS 1 bag", folder / "one.bag", count)


if __name__ == "__main__":
    main()
