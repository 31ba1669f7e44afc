"""rosbag2 recordings: sqlite3 databases, and folders with a metadata.yaml."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from itertools import islice
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from trundle.adapters.archive import is_inside
from trundle.adapters.chunk_compression import ZSTD_MAGIC, decompress_frame
from trundle.adapters.damage import Damage
from trundle.adapters.message_layout import Serialization
from trundle.adapters.rosmsg import Struct, struct_type
from trundle.adapters.topic_columns import EARLIEST, MessageBatch, TopicInfo, earliest_behind
from trundle.errors import LogCorrupt, LogError, LogSchema, LogTruncated

__all__ = ["MAGIC", "FolderListing", "Rosbag2Database", "list_folder", "unpacked"]

MAGIC = b"SQLite format 3\0"

ROWS_AT_ONCE = 4096
BYTES_AT_ONCE = 4 << 20
MOST_METADATA = 16 << 20  # bytes of a metadata.yaml
MOST_UNPACKED = 64 << 20  # bytes of one batch of messages that were compressed one by one

# Types of the field that no ROS brings by itself, as ackermann_msgs 2.0 defines them.
_DRIVES = {
    "ackermann_msgs/msg/AckermannDrive": "float32 steering_angle\nfloat32 steering_angle_velocity\n"
    "float32 speed\nfloat32 acceleration\nfloat32 jerk\n",
    "ackermann_msgs/msg/AckermannDriveStamped": "std_msgs/Header header\nAckermannDrive drive\n",
}

_FIRST_ROW, _LAST_ROW = -(1 << 63) + 1, (1 << 63) - 1
_PROBLEMS = (sqlite3.Error, UnicodeDecodeError)  # what sqlite3 raises, the second over its own error texts


class FolderListing(NamedTuple):
    """What a rosbag2 folder says that it holds.

    Attributes:
        files: Its recordings, in their order.
        counts: Messages by topic; empty where its metadata do not say.
        warnings: What is amiss with its metadata.
    """

    files: list[Path]
    counts: dict[str, int]
    warnings: list[str]


class _Topic(NamedTuple):
    number: int
    name: str
    type: str
    serialization: str


class _Part(NamedTuple):
    """Rows of messages from one number to another, both included."""

    first: int
    last: int
    stamps: Mapping[int, tuple[int, int | None, int | None]]  # by topic: count, earliest and latest [ns]

    def first_of(self, topics: list[int]) -> int:
        """When the first message of these topics was received [ns]; ages ago where a stamp is no time."""
        earliest = [self.stamps[number][1] for number in topics if number in self.stamps]
        return min(EARLIEST if stamp is None else stamp for stamp in earliest)


def list_folder(folder: Path) -> FolderListing:
    """The recordings of a rosbag2 folder, as its metadata.yaml says, or as they lie there without one.

    Raises:
        LogError: If there is none.
    """
    try:
        about = _metadata(folder / "metadata.yaml")
        files = [_beside(folder, str(name)) for name in about["relative_file_paths"]]
        counts: dict[str, int] = {}
        for entry in about["topics_with_message_count"]:
            name = str(entry["topic_metadata"]["name"])
            counts[name] = counts.get(name, 0) + int(entry["message_count"])
        listing = FolderListing(files, counts, [])
    except Damage as damage:
        listing = FolderListing(_recordings(folder), {}, [f"unverified: metadata.yaml {damage}"])
    except LogError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as problem:
        warning = f"unverified: metadata.yaml is not that of a rosbag2 ({problem!r})"
        listing = FolderListing(_recordings(folder), {}, [warning])
    if not listing.files:
        raise LogError(folder, "format", "holds neither a metadata.yaml nor .mcap or .db3 files")
    return listing


def _beside(folder: Path, name: str) -> Path:
    """A file that metadata.yaml names. Old ones say the folder too; none may lead out of it."""
    if not is_inside(name):
        raise LogError(
            folder, "unsafe_path", f"its metadata.yaml names {name!r}, must be a file of the folder"
        )
    return folder / PurePath(name).name


def unpacked(batch: MessageBatch) -> MessageBatch:
    """A batch of CDR messages, decompressed where they were compressed one by one.

    Raises:
        Damage: If one cannot be decompressed.
    """
    if not len(batch.starts):
        return batch
    messages = [batch.buffer[a : a + size] for a, size in zip(batch.starts[:1], batch.sizes[:1], strict=True)]
    if messages[0][:4].tobytes() != ZSTD_MAGIC:
        return batch
    contents, total = [], 0
    for start, size in zip(batch.starts.tolist(), batch.sizes.tolist(), strict=True):
        contents.append(decompress_frame(batch.buffer[start : start + size].tobytes()))
        total += len(contents[-1])
        if total > MOST_UNPACKED:
            raise Damage(f"grows beyond {MOST_UNPACKED >> 20} MiB in one batch of messages")
    return _batch(batch.receive_ns, contents)


class Rosbag2Database:
    """An open rosbag2 database (sqlite3), which is never written to.

    Attributes:
        losses: What could not be read, one sentence each; stays empty unless `salvage`.
        warnings: What could not be checked.
    """

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        self.path = path
        self.losses: list[str] = []
        self.warnings = ["unverified: sqlite3 databases carry no checksums"]
        self._salvage = salvage
        self._largest = 1 << 16  # bytes of a message, as long as none was read
        self._require_whole()
        with ExitStack() as stack:
            try:
                self._database = self._connect(stack)
                self._topics = self._read_topics()
                self._definitions = self._read_definitions()
                self.topics = self._count()
            except (*_PROBLEMS, TypeError) as error:
                raise LogCorrupt(path, "corrupt", f"sqlite3 says: {error}") from None
            self._stack = stack.pop_all()

    def close(self) -> None:
        """Let go of the database, and of its copy if one was made."""
        self._stack.close()

    def message_type(self, topic: str) -> tuple[Struct, Serialization]:
        """How a topic's messages are made.

        Raises:
            LogSchema: If they are not CDR, of several types, or defined nowhere.
        """
        kinds = {(entry.type, entry.serialization) for entry in self._topics if entry.name == topic}
        if len(kinds) != 1:
            names = ", ".join(sorted(name for name, _ in kinds))
            raise LogSchema(self.path, "schema", f"{topic} holds messages of several types: {names}")
        name, serialization = kinds.pop()
        if serialization != "cdr":
            raise LogSchema(
                self.path, "schema", f"{topic} is encoded as {serialization!r}; Trundle reads cdr"
            )
        encoding, text = self._definitions.get(name) or _known_definition(self.path, name)
        return struct_type(self.path, name, encoding, text), Serialization.CDR

    def batches(self, topic: str) -> Iterator[MessageBatch]:
        """Messages of a topic.

        Raises:
            LogCorrupt: If sqlite3 says so.
        """
        numbers = [entry.number for entry in self._topics if entry.name == topic]
        parts = [part for part in self._parts if part.stamps.keys() & set(numbers)]
        behind = earliest_behind(part.first_of(numbers) for part in parts)
        for part, later_ns in zip(parts, behind, strict=True):
            former: MessageBatch | None = None
            for batch in self._part_batches(part, numbers):
                if former is not None:
                    yield former
                former = batch
            if former is not None:
                yield replace(former, later_ns=later_ns)

    def _part_batches(self, part: _Part, topics: list[int]) -> Iterator[MessageBatch]:
        """Messages of a part, as many at a time as the largest of those before lets fit."""
        rows = self._rows("timestamp, data", topics, part)
        while taken := list(islice(rows, max(1, min(ROWS_AT_ONCE, BYTES_AT_ONCE // self._largest)))):
            good = [row for row in taken if isinstance(row[1], int) and isinstance(row[2], bytes)]
            if len(good) < len(taken):
                self._lose("messages hold rows that are no messages", f"; {len(taken) - len(good)} are lost")
            if good:
                _, stamps, contents = zip(*good, strict=True)
                self._largest = max(1, *map(len, contents))
                yield _batch(np.array(stamps, np.int64), contents)

    # ------------------------------------------------------------------ the database

    def _require_whole(self) -> None:
        """Compare the size of the file with what its header says."""
        with self.path.open("rb") as file:
            header = file.read(100)
        size = self.path.stat().st_size
        if len(header) < 100:
            raise LogTruncated(
                self.path, "truncated", f"ends at byte {size}, inside the header of its database"
            )
        page = int.from_bytes(header[16:18], "big")
        pages = int.from_bytes(header[28:32], "big")
        whole = pages * (65536 if page == 1 else page)
        if header[24:28] == header[92:96] and size < whole:
            error = LogTruncated(self.path, "truncated", f"ends at byte {size} of {whole}")
            if not self._salvage:
                raise error
            self.losses.append(f"{error.problem}; the messages behind are lost")

    def _connect(self, stack: ExitStack) -> sqlite3.Connection:
        """Open the file as it is, or a copy with what a recorder left beside it, where sqlite3 may tidy."""
        path, mode = self.path, "mode=ro&immutable=1"
        beside = [path.with_name(path.name + end) for end in ("-wal", "-journal")]
        left = [file for file in beside if file.is_file() and file.stat().st_size]
        if left:
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="trundle-")))
            for file in (path, *left):
                shutil.copyfile(file, folder / file.name)
            path, mode = folder / path.name, "mode=rw"
            self.warnings.append(
                f"the recorder did not finish: {', '.join(file.name for file in left)} was applied"
            )
        database = sqlite3.connect(f"file:{quote(str(path.absolute()))}?{mode}", uri=True)
        stack.callback(database.close)
        if self._salvage:
            database.execute("PRAGMA writable_schema=ON")  # so that a database that was cut opens at all
        return database

    def _read_topics(self) -> list[_Topic]:
        tables = {
            name for (name,) in self._database.execute("SELECT name FROM sqlite_master WHERE type='table'")
        }
        if not {"topics", "messages"} <= tables:
            listing = ", ".join(sorted(map(str, tables))) or "none"
            raise LogError(self.path, "format", f"is a database, but no rosbag2: its tables are {listing}")
        self._tables = tables
        rows = self._database.execute("SELECT id, name, type, serialization_format FROM topics ORDER BY id")
        return [_Topic(int(row[0]), *map(str, row[1:])) for row in rows]

    def _read_definitions(self) -> dict[str, tuple[str, str]]:
        if "message_definitions" not in self._tables:
            return {}
        rows = self._database.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        return {str(name): (str(encoding), str(text)) for name, encoding, text in rows if text}

    def _count(self) -> dict[str, TopicInfo]:
        try:
            self._parts = list(self._read_parts())
        except _PROBLEMS:
            if not self._salvage:
                raise
            self._parts = [self._count_rows()]
        topics: dict[str, TopicInfo] = {}
        for entry in self._topics:
            info = TopicInfo(entry.type, 0, None, None)
            for part in self._parts:
                if entry.number in part.stamps:
                    info = info.joined(TopicInfo(entry.type, *part.stamps[entry.number]))
            topics[entry.name] = info.joined(topics[entry.name]) if entry.name in topics else info
        return topics

    def _read_parts(self) -> Iterator[_Part]:
        """What there is in so many rows at a time, in the order of their numbers."""
        next_row = "SELECT MIN(rowid) FROM messages WHERE rowid > ?"
        query = (
            "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages"
            " WHERE rowid BETWEEN ? AND ? GROUP BY topic_id"
        )
        last = _FIRST_ROW - 1
        while (first := self._database.execute(next_row, (last,)).fetchone()[0]) is not None:
            last = min(first + ROWS_AT_ONCE - 1, _LAST_ROW)
            found = self._database.execute(query, (first, last)).fetchall()
            yield _Part(first, last, {number: (count, *map(_stamp, ends)) for number, count, *ends in found})

    def _count_rows(self) -> _Part:
        """What there is in all rows that can be read."""
        stamps: dict[int, tuple[int, int, int]] = {}
        everything = _Part(_FIRST_ROW, _LAST_ROW, {})
        numbers = [entry.number for entry in self._topics]
        for _, number, stamp in self._rows("topic_id, timestamp", numbers, everything):
            if isinstance(stamp, int):
                count, first, last = stamps.get(number, (0, stamp, stamp))
                stamps[number] = count + 1, min(first, stamp), max(last, stamp)
        return everything._replace(stamps=stamps)

    def _rows(self, columns: str, topics: list[int], part: _Part) -> Iterator[tuple[Any, ...]]:
        """Rows of messages: from the first on and, behind damage, those that the last one leads to."""
        marks = ",".join("?" * len(topics))
        query = (
            f"SELECT rowid, {columns} FROM messages"  # noqa: S608
            f" WHERE rowid BETWEEN ? AND ? AND topic_id IN ({marks}) ORDER BY rowid"
        )
        last = part.first - 1
        try:
            for row in self._database.execute(query, (part.first, part.last, *topics)):
                last = row[0]
                yield row
        except _PROBLEMS as error:
            self._lose(f"sqlite3 says behind row {last} of messages: {error}", "; rows behind it may be lost")
            yield from self._rows_behind(last, columns, topics, part)

    def _rows_behind(
        self, last: int, columns: str, topics: list[int], part: _Part
    ) -> Iterator[tuple[Any, ...]]:
        behind: list[int] = []
        try:
            for (row,) in self._database.execute(
                "SELECT rowid FROM messages WHERE rowid > ? AND rowid <= ? ORDER BY rowid DESC",
                (last, part.last),
            ):
                behind.append(row)
        except _PROBLEMS:
            pass
        marks = ",".join("?" * len(topics))
        query = f"SELECT rowid, {columns} FROM messages WHERE rowid = ? AND topic_id IN ({marks})"  # noqa: S608
        for number in reversed(behind):
            try:
                yield from self._database.execute(query, (number, *topics)).fetchall()
            except _PROBLEMS:
                self._lose(f"row {number} of messages cannot be read", "; it is lost")

    def _lose(self, problem: str, consequence: str) -> None:
        """Raise the error, or note the loss where salvage was asked for."""
        if not self._salvage:
            raise LogCorrupt(self.path, "corrupt", problem) from None
        sentence = f"{problem}{consequence}"
        if sentence not in self.losses:
            self.losses.append(sentence)


def _stamp(value: object) -> int | None:
    """A time, where it is one: sqlite3 keeps anything anywhere."""
    return value if isinstance(value, int) else None


def _batch(receive_ns: npt.NDArray[np.int64], contents: Sequence[bytes]) -> MessageBatch:
    sizes = np.fromiter(map(len, contents), np.int64, len(contents))
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64)
    return MessageBatch(receive_ns, np.frombuffer(b"".join(contents), np.uint8), starts, sizes)


def _metadata(path: Path) -> dict[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    if not path.is_file():
        raise Damage("is missing")
    if path.stat().st_size > MOST_METADATA:
        raise Damage(f"is larger than {MOST_METADATA >> 20} MiB")
    try:
        about = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    except (YAMLError, UnicodeDecodeError, RecursionError, ValueError):
        raise Damage("cannot be read as YAML") from None
    information: dict[str, Any] = about["rosbag2_bagfile_information"]
    return information


def _recordings(folder: Path) -> list[Path]:
    """Recordings of a folder, `bag_2` before `bag_10`."""
    names = [file for file in folder.iterdir() if re.search(r"\.(mcap|db3)(\.zstd)?$", file.name)]
    return sorted(
        names,
        key=lambda file: [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", file.name)],
    )


def _known_definition(source: Path, name: str) -> tuple[str, str]:
    """Definition of a type that wheels need, for recordings older than Iron, which carry none."""
    from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    for drive, text in _DRIVES.items():
        store.register(get_types_from_msg(text, drive))
    try:
        text, _ = store.generate_msgdef(name, ros_version=2)
    except (TypesysError, KeyError):
        problem = f"carries no definition of {name}, and it is none that every ROS brings"
        raise LogSchema(source, "schema", problem) from None
    return "ros2msg", text
