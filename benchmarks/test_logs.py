"""Recordings to columns and to trajectory files: ns per message, beside rosbags, wpimath and NumPy's savetxt.

100,000 JointState messages of four wheels at 100 Hz, as MCAP with and without compression, with and without
checksums (CRC), and as sqlite3 and ROS 1 bags. Both readers give times, names, positions and velocities.
They take turns, with as many rounds each.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np
import pytest
from backports import zstd
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import trundle as tr
from trundle.adapters.bag import open_bag
from trundle.robot.log_mapping import LogMapping, WheelMapping

TOPIC = "/joint_states"
NAMES = [
    "front_left_wheel_joint",
    "front_right_wheel_joint",
    "rear_left_wheel_joint",
    "rear_right_wheel_joint",
]
COUNT = 100_000
ROBOT = tr.Robot(
    drive=tr.Differential(track_width=0.2, wheel_radius=0.042),
    log=LogMapping(
        wheels={
            side: WheelMapping(topic=TOPIC, name=name)
            for side, name in zip(("left", "right"), NAMES[:2], strict=True)
        }
    ),
)
RECORDINGS = ["MCAP", "MCAP, no CRC", "MCAP zstd", "MCAP zstd, no CRC", "sqlite3", "ROS 1 bag"]


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


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Each recording by its name; written once."""
    folder = tmp_path_factory.mktemp("recordings")
    paths = {}
    for name, mode in (("MCAP", CompressionMode.NONE), ("MCAP zstd", CompressionMode.STORAGE)):
        for checksums in (False, True):
            bag = folder / f"{mode.name}{checksums}"
            write_rosbag2(bag, COUNT, StoragePlugin.MCAP, mode)
            (file,) = bag.glob("*.mcap")
            if checksums:
                add_checksums(file)
            paths[name if checksums else f"{name}, no CRC"] = file
    write_rosbag2(folder / "sqlite3", COUNT, StoragePlugin.SQLITE3, CompressionMode.NONE)
    write_rosbag1(folder / "one.bag", COUNT)
    return paths | {"sqlite3": folder / "sqlite3", "ROS 1 bag": folder / "one.bag"}


# ------------------------------------------------------------------------------ one topic's columns


@pytest.mark.parametrize("name", RECORDINGS)
def test_columns(name, recordings, in_turns):
    path = recordings[name]
    ours, theirs = with_trundle(path), with_rosbags(path)
    assert all(np.array_equal(one, other) for one, other in zip(ours, theirs, strict=True))
    readers = {"trundle": lambda: with_trundle(path), "rosbags": lambda: with_rosbags(path)}
    in_turns(f"JointState, {name}", "columns", readers, COUNT, rounds=9)


# ----------------------------------------------------------------------------- log to trajectory file


def test_from_log_to_file(recordings, in_turns, tmp_path):
    """Theirs as their manuals have it: message by message, pose by pose, and savetxt at the end."""
    kinematics = pytest.importorskip("wpimath.kinematics", reason="robotpy-wpimath is not installed here")
    rotation = pytest.importorskip("wpimath.geometry").Rotation2d
    path, output = recordings["MCAP"], {name: tmp_path / f"{name}.tum" for name in ("ours", "theirs")}
    radius, track = 0.042, 0.2

    def with_trundle(*, covariance):
        trajectory = tr.integrate(ROBOT, tr.read_log(path, ROBOT), covariance=covariance)
        tr.write_trajectory(trajectory, output["ours"], force=True)

    def with_others():
        odometry = kinematics.DifferentialDriveOdometry(rotation(0.0), 0.0, 0.0)
        rows, first = [], None
        with AnyReader([path]) as reader:
            for connection, _, raw in reader.messages([c for c in reader.connections if c.topic == TOPIC]):
                message = reader.deserialize(raw, connection.msgtype)
                stamp = message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
                turned = dict(zip(message.name, message.position.tolist(), strict=True))
                left, right = turned[NAMES[0]] * radius, turned[NAMES[1]] * radius
                first = (left, right) if first is None else first
                left, right = left - first[0], right - first[1]
                pose = odometry.update(rotation((right - left) / track), left, right)
                half = 0.5 * pose.rotation().radians()
                rows.append((stamp, pose.X(), pose.Y(), 0.0, 0.0, 0.0, math.sin(half), math.cos(half)))
        np.savetxt(output["theirs"], rows)

    ways = {
        "trundle": lambda: with_trundle(covariance=False),
        "trundle, covariance too": lambda: with_trundle(covariance=True),
        "rosbags, wpimath, savetxt": with_others,
    }
    in_turns("log to trajectory file", "MCAP to TUM", ways, COUNT, rounds=5)
    assert len(output["ours"].read_text().splitlines()) == COUNT
    ours = tr.integrate(ROBOT, tr.read_log(path, ROBOT), integrator="arc").poses
    np.testing.assert_allclose(np.loadtxt(output["theirs"])[:, 1:3], ours[:, :2], atol=1e-6)
