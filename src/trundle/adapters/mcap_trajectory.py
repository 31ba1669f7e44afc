"""Trajectories as MCAP files that Foxglove and ROS 2 tools open.

Topics: `/odom` (nav_msgs/msg/Odometry), or `/pose` (geometry_msgs/msg/PoseWithCovarianceStamped) where the
trajectory has no twists; and `/pose_in_frame` (foxglove_msgs/msg/PoseInFrame) for viewers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.bag import BagReader, open_bag
from trundle.adapters.mcap_records import HEAD, MESSAGE_FIELDS, Kind
from trundle.adapters.mcap_writer import Channel, McapWriter
from trundle.adapters.quaternion import quaternion_of_yaw, whole_poses, yaw_of_quaternion
from trundle.adapters.topic_columns import TopicColumns
from trundle.adapters.topic_fields import pose_fields, twist_fields
from trundle.errors import InputError, LogSchema, listed
from trundle.geometry import se2
from trundle.records import Trajectory

__all__ = ["UNKNOWN", "read_mcap_trajectory", "write_mcap"]

UNKNOWN = 1e6
"""Variance of what is not known: large, but a number that every filter can invert."""

LEAST_TWIST_VARIANCE = 1e-9  # (m/s)^2, (rad/s)^2; zero would be certainty
LATEST_NS = 2**31 * 10**9  # seconds of a stamp are an int32
CHUNK = 1 << 20  # bytes of messages

Floats = npt.NDArray[np.float64]

# ROS writes covariances row by row over (x, y, z, roll, pitch, yaw). These are x, y and yaw.
_PLANAR = (0, 1, 5)

_DEFINITIONS = {
    "nav_msgs/msg/Odometry": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "std_msgs/Header header\n"
    "geometry_msgs/PoseWithCovariance pose\n",
    "foxglove_msgs/msg/PoseInFrame": "builtin_interfaces/Time timestamp\nstring frame_id\n"
    "geometry_msgs/Pose pose\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/msg/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
}
# Types that say where a robot is, the best first.
_POSE_TYPES = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/Pose2D",
    "foxglove_msgs/msg/PoseInFrame",
)


class _Message(NamedTuple):
    """A topic's messages, column by column in the order of its fields."""

    topic: str
    type: str
    texts: tuple[str, ...]
    numbers: tuple[Floats, ...]


def write_mcap(trajectory: Trajectory, path: Path) -> None:
    """Write poses, twists and covariances.

    Pose covariances are given along the axes of `frame`, as the message wants them. The covariance of a
    twist is what the pose covariance grew by in its step. What is not known has a variance of 1e6: height,
    roll and pitch of any planar robot, and everything of a trajectory without covariances.

    Raises:
        InputError: If a stamp lies before 1970 or after 2038, or a pose is not finite: the messages cannot
            say that.
    """
    messages = _messages(trajectory)
    channels = [Channel(message.topic, message.type, _schema(message.type)) for message in messages]
    with path.open("wb") as file, McapWriter(file, channels) as writer:
        layout, members = _layout(messages)
        step = max(1, CHUNK // layout.itemsize)
        for first in range(0, len(trajectory), step):
            rows = slice(first, first + step)
            stamps = trajectory.time_ns[rows]
            records = _records(messages, layout, rows, stamps, first)
            starts = np.arange(len(stamps)) * layout.itemsize
            index = {number: (stamps, starts + start) for number, start in members.items()}
            writer.add(records.tobytes(), index)


def read_mcap_trajectory(path: Path) -> Trajectory:
    """Poses of the topic that holds them; headings are continuous, from (-pi, pi] on.

    Raises:
        LogSchema: If no topic holds poses, or several hold the same kind.
        LogError: If the recording cannot be read.
    """
    with open_bag(path) as bag:
        topic = _pose_topic(bag)
        kind = bag.topics[topic].type
        position, rotation = pose_fields(path, topic, kind)
        has_twist = kind == "nav_msgs/msg/Odometry"
        twist = twist_fields(path, topic, kind) if has_twist else []
        covariance = "pose.covariance" if "Covariance" in kind or has_twist else None
        frames = [name for name in _frame_fields(kind) if name]
        fields = [*position, *rotation, *twist, *([covariance] if covariance else []), *frames]
        columns = bag.read(topic, fields)
    angles = [_numbers(columns, name) for name in rotation]
    heading = yaw_of_quaternion(*angles) if len(angles) == 4 else angles[0]
    poses = np.stack([*(_numbers(columns, name) for name in position), heading], axis=-1)
    stamps = columns.header_ns
    if stamps is None or not stamps.any():
        stamps = columns.receive_ns
    words = [columns.columns[name] for name in frames]
    frame, child_frame = (
        word if isinstance(word, str) and word else usual
        for word, usual in zip_longest(words, ("odom", "base_link"))
    )
    trajectory = Trajectory(
        time_ns=stamps,
        poses=poses,
        twists=np.stack([_numbers(columns, name) for name in twist], axis=-1) if twist else None,
        covariances=_body_covariances(_numbers(columns, covariance), heading) if covariance else None,
        frame=frame,
        child_frame=child_frame,
    )
    return whole_poses(path, trajectory)


# ------------------------------------------------------------------------------------ reading


def _pose_topic(bag: BagReader) -> str:
    for kind in _POSE_TYPES:
        found = [topic for topic, info in sorted(bag.topics.items()) if info.type == kind]
        if len(found) > 1:
            raise LogSchema(bag.path, "ambiguous", f"{', '.join(found)} are all {kind}; a trajectory is one")
        if found:
            return found[0]
    has = listed([f"{topic} ({info.type})" for topic, info in sorted(bag.topics.items())], like="pose")
    raise LogSchema(bag.path, "topic", f"no topic is one of {', '.join(_POSE_TYPES)}; it has {has}")


def _frame_fields(kind: str) -> tuple[str, ...]:
    if kind == "nav_msgs/msg/Odometry":
        return "header.frame_id", "child_frame_id"
    if kind == "foxglove_msgs/msg/PoseInFrame":
        return ("frame_id",)
    return () if kind.endswith("Pose2D") else ("header.frame_id",)


def _numbers(columns: TopicColumns, field: str) -> Floats:
    return np.asarray(columns.columns[field], np.float64)


def _body_covariances(flat: Floats, heading: Floats) -> Floats | None:
    """Covariances of body-frame errors from those of a message; None where none is known."""
    planar = flat.reshape(-1, 6, 6)[:, _PLANAR][:, :, _PLANAR]
    if len(planar) and (planar[:, (0, 1, 2), (0, 1, 2)] == UNKNOWN).all():
        return None
    return _turned(planar, -heading)


# ------------------------------------------------------------------------------------ writing


def _messages(trajectory: Trajectory) -> list[_Message]:
    time_ns, poses = trajectory.time_ns, trajectory.poses
    if len(trajectory) and not 0 <= time_ns.min() <= time_ns.max() < LATEST_NS:
        wrong = time_ns.min() if time_ns.min() < 0 else time_ns.max()
        raise InputError(f"a stamp is {wrong} ns, must lie between 1970 and 2038 in a .mcap file")
    unknown = np.flatnonzero(~np.isfinite(poses).all(axis=1))
    if unknown.size:
        pose = poses[unknown[0]].tolist()
        raise InputError(f"pose {unknown[0]} is {pose}, must be finite in a .mcap file; .csv can hold it")
    z, w = quaternion_of_yaw(poses[:, 2])
    nothing = np.zeros(len(poses))
    pose_numbers = np.stack([poses[:, 0], poses[:, 1], nothing, nothing, nothing, z, w], axis=-1)
    planar = trajectory.covariances
    covariance = _covariances(None if planar is None else _turned(planar, poses[:, 2]), len(poses))
    viewed = _Message("/pose_in_frame", "foxglove_msgs/msg/PoseInFrame", (trajectory.frame,), (pose_numbers,))
    if trajectory.twists is None:
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        return [_Message("/pose", kind, (trajectory.frame,), (pose_numbers, covariance)), viewed]
    vx, vy, omega = trajectory.twists.T
    twist = np.stack([vx, vy, nothing, nothing, nothing, omega], axis=-1)
    growth = _covariances(_growth(trajectory), len(poses))
    texts = (trajectory.frame, trajectory.child_frame)
    numbers = (pose_numbers, covariance, twist, growth)
    return [_Message("/odom", "nav_msgs/msg/Odometry", texts, numbers), viewed]


def _turned(planar: Floats, angle: Floats) -> Floats:
    """Covariances (x, y, theta) along axes turned by minus these angles."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.zeros((len(planar), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
    turned: Floats = np.einsum("nij,njk,nlk->nil", turn, planar, turn)
    return turned


def _growth(trajectory: Trajectory) -> Floats | None:
    """Covariances of the twists: what each step added to that of the pose, per square of its duration.

    Behind a step D the covariance of the pose before it is `Ad S Ad^T`, with `Ad` the adjoint of exp(-D).
    """
    known, seconds = trajectory.covariances, np.diff(trajectory.time_ns) * 1e-9
    if known is None or len(seconds) < 1:
        return None
    step = se2.compose(se2.inverse(trajectory.poses[:-1]), trajectory.poses[1:])
    moved = se2.adjoint(se2.inverse(step))
    added = known[1:] - np.einsum("nij,njk,nlk->nil", moved, known[:-1], moved)
    safe = np.where(seconds > 0.0, seconds, np.inf)
    added = 0.5 * (added + added.transpose(0, 2, 1)) / (safe * safe)[:, None, None]
    size, axes = np.linalg.eigh(np.where(np.isfinite(added), added, 0.0))
    size = np.clip(size, LEAST_TWIST_VARIANCE, UNKNOWN)
    growth: Floats = np.einsum("nij,nj,nkj->nik", axes, size, axes)
    return np.concatenate([growth[:1], growth])


def _covariances(planar: Floats | None, count: int) -> Floats:
    """6 x 6 matrices, row by row, from planar ones."""
    matrices = np.zeros((count, 6, 6))
    matrices[:, range(6), range(6)] = UNKNOWN
    if planar is not None:
        for row, i in enumerate(_PLANAR):
            for column, j in enumerate(_PLANAR):
                matrices[:, i, j] = planar[:, row, column]
    return matrices.reshape(count, 36)


def _schema(kind: str) -> str:
    """The definition of a type, then those of all that it contains, as ROS 2 concatenates them."""
    parts, wanted = [], [kind]
    for name in wanted:
        for line in _DEFINITIONS[name].splitlines():
            package, slash, rest = line.split()[0].partition("/")
            inner = f"{package}/msg/{rest}"
            if slash and inner not in wanted:
                wanted.append(inner)
        short = name.replace("/msg/", "/")
        parts.append(_DEFINITIONS[name] if name == kind else f"MSG: {short}\n{_DEFINITIONS[name]}")
    return f"{'=' * 80}\n".join(parts)


def _layout(messages: Sequence[_Message]) -> tuple[np.dtype[np.void], Mapping[int, int]]:
    """One message of every topic side by side, and where each channel's record begins.

    CDR, little endian: numbers lie at multiples of their size, counted from behind the first four bytes.
    """
    names: list[str] = []
    formats: list[np.dtype[np.generic]] = []
    offsets: list[int] = []
    starts: dict[int, int] = {}
    at = 0

    def put(name: str, kind: np.dtype[np.generic], size: int) -> None:
        nonlocal at
        names.append(name)
        formats.append(kind)
        offsets.append(at)
        at += size

    for number, message in enumerate(messages, 1):
        starts[number] = at
        put(f"{number} head", HEAD, HEAD.itemsize)
        put(f"{number} cdr", np.dtype("4u1"), 4)
        body = at
        put(f"{number} stamp", np.dtype([("sec", "<i4"), ("nanosec", "<u4")]), 8)
        for k, text in enumerate(message.texts):
            at = body + _aligned(at - body, 4)
            length = len(text.encode()) + 1
            put(f"{number} length {k}", np.dtype("<u4"), 4)
            put(f"{number} text {k}", np.dtype(f"S{length}"), length)
        at = body + _aligned(at - body, 8)
        for k, block in enumerate(message.numbers):
            put(f"{number} numbers {k}", np.dtype(("<f8", block.shape[1])), 8 * block.shape[1])
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": at}), starts


def _records(
    messages: Sequence[_Message],
    layout: np.dtype[np.void],
    rows: slice,
    stamps: npt.NDArray[np.int64],
    first: int,
) -> npt.NDArray[np.void]:
    """Message records of some rows."""
    records = np.zeros(len(stamps), layout)
    _, starts = _layout(messages)
    ends = [*list(starts.values())[1:], layout.itemsize]
    for (number, start), end, message in zip(starts.items(), ends, messages, strict=True):
        head = records[f"{number} head"]
        head["kind"], head["channel"] = Kind.MESSAGE, number
        head["length"] = end - start - HEAD.itemsize + MESSAGE_FIELDS
        head["sequence"] = np.arange(first, first + len(stamps)) & 0xFFFFFFFF
        head["log_time"] = head["publish_time"] = stamps
        records[f"{number} cdr"] = 0, 1, 0, 0
        records[f"{number} stamp"]["sec"] = stamps // 10**9
        records[f"{number} stamp"]["nanosec"] = stamps % 10**9
        for k, text in enumerate(message.texts):
            records[f"{number} length {k}"] = len(text.encode()) + 1
            records[f"{number} text {k}"] = text.encode()
        for k, block in enumerate(message.numbers):
            records[f"{number} numbers {k}"] = block[rows]
    return records


def _aligned(position: int, size: int) -> int:
    return -(-position // size) * size
