"""Trajectories as WPILOG data logs, which AdvantageScope opens.

Entries: `/trundle/pose` (struct:Pose2d), `/trundle/twist` (struct:ChassisSpeeds), `/trundle/covariance`
(double[], the matrix row by row), and `/trundle/time_ns` (int64), since a log's own stamps are microseconds.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.adapters.topic_columns import TopicColumns
from trundle.adapters.topic_fields import pose_fields, twist_fields
from trundle.adapters.wpilog import WpilogFile, open_wpilog
from trundle.adapters.wpilog_records import HEADER, MAGIC, VERSION
from trundle.adapters.wpilog_struct import STRUCTS
from trundle.errors import InputError, LogError, LogSchema
from trundle.records import Trajectory

__all__ = ["read_wpilog_trajectory", "write_wpilog"]

_FOLDER = "/trundle/"
_POSE, _TWIST, _COVARIANCE, _TIME = (_FOLDER + name for name in ("pose", "twist", "covariance", "time_ns"))
_SCHEMAS = ("Rotation2d", "Translation2d", "Pose2d", "ChassisSpeeds")

Floats = npt.NDArray[np.float64]
Rows = TypeVar("Rows", bound=npt.NDArray[Any])


class _Entry(NamedTuple):
    """What is written under one name, a row per stamp."""

    name: str
    type: str
    rows: npt.NDArray[np.uint8]


class _Frames(msgspec.Struct):
    """What the metadata of the poses says."""

    frame: str = "odom"
    child_frame: str = "base_link"


def write_wpilog(trajectory: Trajectory, path: Path) -> None:
    """Write poses, and twists and covariances where there are any, with the schemas of their structs.

    Raises:
        InputError: If a stamp is negative, which the format cannot hold.
    """
    if len(trajectory) and trajectory.time_ns.min() < 0:
        raise InputError(f"a stamp is {trajectory.time_ns.min()} ns, must be >= 0 in a .wpilog file")
    entries = [
        _Entry(_TIME, "int64", _bytes(trajectory.time_ns, "<i8")),
        _Entry(_POSE, "struct:Pose2d", _bytes(trajectory.poses, "<f8")),
    ]
    if trajectory.twists is not None:
        entries.append(_Entry(_TWIST, "struct:ChassisSpeeds", _bytes(trajectory.twists, "<f8")))
    if trajectory.covariances is not None:
        entries.append(_Entry(_COVARIANCE, "double[]", _bytes(trajectory.covariances, "<f8")))
    frames = _Frames(trajectory.frame, trajectory.child_frame)
    metadata = msgspec.json.encode({"source": "trundle", **msgspec.to_builtins(frames)}).decode()
    first = int(trajectory.time_ns[0]) // 1000 if len(trajectory) else 0
    with path.open("wb") as file:
        file.write(HEADER.pack(MAGIC, VERSION, 0))
        number = 0
        for name in _SCHEMAS:
            number += 1
            file.write(_start(number, f"/.schema/struct:{name}", "structschema", "", first))
            file.write(_record(number, first, STRUCTS[name].encode()))
        for entry in entries:
            number += 1
            file.write(_start(number, entry.name, entry.type, metadata, first))
        file.write(_rows(trajectory.time_ns, entries, number - len(entries) + 1).tobytes())


def read_wpilog_trajectory(path: Path) -> Trajectory:
    """Read what `write_wpilog` writes; of other logs, the only entry that holds a robot's pose.

    Raises:
        LogSchema: If there is none, or several.
        LogError: If the log cannot be read.
    """
    with open_wpilog(path) as log:
        if _POSE not in log.topics:
            return _of_others(log)
        time_ns, poses = _poses(log, _POSE)
        if _TIME in log.topics:
            time_ns = np.asarray(log.read(_TIME, ["value"]).columns["value"], np.int64)
        frames = _frames(log.metadata.get(_POSE, ""))
        return Trajectory(
            time_ns=_as_many(log, _TIME, time_ns, len(poses)),
            poses=poses,
            twists=_block(log, _TWIST, twist_fields(path, _TWIST, "struct:ChassisSpeeds"), len(poses)),
            covariances=_covariances(log, len(poses)),
            frame=frames.frame,
            child_frame=frames.child_frame,
        )


# ------------------------------------------------------------------------------------ reading


def _of_others(log: WpilogFile) -> Trajectory:
    found = [name for name, info in log.topics.items() if info.type == "struct:Pose2d" and info.count]
    if len(found) != 1:
        has = f"several entries are poses: {', '.join(found)}" if found else "no entry is a struct:Pose2d"
        raise LogSchema(log.path, "topic", f"{has}; a trajectory is one, or {_POSE}")
    time_ns, poses = _poses(log, found[0])
    return Trajectory(time_ns=time_ns, poses=poses)


def _poses(log: WpilogFile, topic: str) -> tuple[npt.NDArray[np.int64], Floats]:
    position, heading = pose_fields(log.path, topic, log.topics[topic].type)
    columns = log.read(topic, [*position, *heading])
    return columns.receive_ns, _stacked(columns, [*position, *heading])


def _block(log: WpilogFile, topic: str, fields: Sequence[str], count: int) -> Floats | None:
    if topic not in log.topics:
        return None
    return _as_many(log, topic, _stacked(log.read(topic, fields), fields), count)


def _covariances(log: WpilogFile, count: int) -> Floats | None:
    block = _block(log, _COVARIANCE, [f"value.{k}" for k in range(9)], count)
    return None if block is None else block.reshape(count, 3, 3)


def _stacked(columns: TopicColumns, fields: Sequence[str]) -> Floats:
    return np.stack([np.asarray(columns.columns[field], np.float64) for field in fields], axis=-1)


def _as_many(log: WpilogFile, topic: str, rows: Rows, count: int) -> Rows:
    if len(rows) != count:
        problem = f"{topic} has {len(rows)} values where {_POSE} has {count}"
        raise LogError(log.path, "unmatched", problem)
    return rows


def _frames(metadata: str) -> _Frames:
    """Frames, where the metadata says them."""
    try:
        return msgspec.json.decode(metadata, type=_Frames)
    except (msgspec.MsgspecError, ValueError):
        return _Frames()


# ------------------------------------------------------------------------------------ writing


def _bytes(values: npt.NDArray[np.generic], code: str) -> npt.NDArray[np.uint8]:
    """Each row's numbers as bytes."""
    rows = np.ascontiguousarray(values.reshape(len(values), math.prod(values.shape[1:])), code)
    return rows.view(np.uint8)


def _rows(time_ns: npt.NDArray[np.int64], entries: Sequence[_Entry], first: int) -> npt.NDArray[np.void]:
    """All records of all rows: those of one stamp side by side."""
    members: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    for entry in entries:
        width = (entry.rows.shape[1],)
        members += [(f"{entry.name} head", "u1", (4,)), (f"{entry.name} time", "<u8")]
        members.append((entry.name, "u1", width))
    records = np.zeros(len(time_ns), np.dtype(members))
    for number, entry in enumerate(entries, first):
        # One byte of entry, two of size, eight of time.
        records[f"{entry.name} head"] = 0x70 | 0x04, number, *divmod(entry.rows.shape[1], 256)[::-1]
        records[f"{entry.name} time"] = time_ns // 1000
        records[entry.name] = entry.rows
    return records


def _record(entry: int, microseconds: int, content: bytes) -> bytes:
    """A record with the widest head."""
    return struct.pack("<BIIQ", 0x7F, entry, len(content), microseconds) + content


def _start(entry: int, name: str, kind: str, metadata: str, microseconds: int) -> bytes:
    texts = b"".join(struct.pack("<I", len(t.encode())) + t.encode() for t in (name, kind, metadata))
    return _record(0, microseconds, struct.pack("<BI", 0, entry) + texts)
