"""ROS recordings as columns: MCAP, rosbag2 (MCAP or sqlite3) and rosbag1, told apart by their content."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Protocol, Self

from trundle.adapters import mcap, rosbag1, rosbag2
from trundle.adapters.chunk_compression import ZSTD_MAGIC, decompress_file
from trundle.adapters.damage import Damage
from trundle.adapters.message_layout import Serialization, UnknownField
from trundle.adapters.rosmsg import Struct
from trundle.adapters.topic_columns import (
    EARLIEST,
    LATEST,
    ColumnDecoder,
    MessageBatch,
    TopicColumns,
    TopicInfo,
)
from trundle.errors import LogCorrupt, LogError, LogSchema, no_such

__all__ = ["BagReader", "open_bag"]

MOST_SENTENCES = 5  # about single messages that could not be decoded


class _Recording(Protocol):
    """One open file, of whatever format."""

    losses: list[str]
    warnings: list[str]

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name."""

    def message_type(self, topic: str) -> tuple[Struct, Serialization]:
        """How a topic's messages are made."""

    def batches(self, topic: str) -> Iterator[MessageBatch]:
        """A topic's messages."""

    def close(self) -> None:
        """Let go of the file."""


class BagReader:
    """An open recording, for a `with` block.

    Attributes:
        path: The file or folder.
        topics: What it holds, by name of topic.
        losses: What could not be read, one sentence each. Stays empty unless opened with `salvage`.
        warnings: What could not be checked, one sentence each.
    """

    def __init__(self, path: Path, *, salvage: bool = False) -> None:
        self.path = path
        self.topics: dict[str, TopicInfo] = {}
        self._salvage = salvage
        self._losses: list[str] = []
        self._warnings: list[str] = []
        self._recordings: list[_Recording] = []
        with ExitStack() as stack:
            if path.is_dir():
                self._open_folder(path, stack)
            else:
                self._open_file(path, stack)
            self._stack = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def losses(self) -> list[str]:  # noqa: D102
        return [loss for recording in self._recordings for loss in recording.losses] + self._losses

    @property
    def warnings(self) -> list[str]:  # noqa: D102
        return [warning for recording in self._recordings for warning in recording.warnings] + self._warnings

    def read(self, topic: str, fields: Sequence[str]) -> TopicColumns:
        """Columns of the named fields of a topic's messages.

        Args:
            topic: Name of the topic.
            fields: Dotted paths such as `pose.position.x`, `name`, `position`. They run through arrays of
                messages: `transforms.transform.translation.x` is an array with one entry per transform.

        Raises:
            LogSchema: If topic or field does not exist; the message lists what does.
            LogCorrupt: If bytes contradict themselves, unless opened with `salvage`.
            LogLimit: If reading would take more memory than it may.
        """
        (columns,) = self.pieces(topic, fields, None)
        return columns

    def pieces(self, topic: str, fields: Sequence[str], least: int | None) -> Generator[TopicColumns]:
        """What `read` returns, cut between messages that were received one after the other.

        Args:
            topic: As for `read`.
            fields: As for `read`.
            least: Messages in a piece; the last one may have less. None: all in one. Where parts of the
                file overlap in time, or the format does not say, they come together.

        Raises:
            LogSchema: As `read`.
            LogCorrupt: As `read`; when the piece comes that is at fault.
            LogLimit: So too.
        """
        if topic not in self.topics:
            raise LogSchema(self.path, "topic", no_such("topic", topic, sorted(self.topics)))
        holders = [recording for recording in self._recordings if topic in recording.topics]
        types = [recording.message_type(topic) for recording in holders]
        if any(other != types[0] for other in types):
            raise LogSchema(self.path, "schema", f"{topic} changes its type from one file to the next")
        kind, serialization = types[0]
        count = self.topics[topic].count
        enough = LATEST if least is None else least

        def begun(before: int) -> ColumnDecoder:
            return ColumnDecoder(kind, fields, serialization, min(max(count - before, 0), enough), before)

        try:
            decoder = begun(0)
        except UnknownField as error:
            raise LogSchema(self.path, "field", f"{topic}: {error}") from None
        lost: list[str] = []
        before, latest, border = 0, EARLIEST, EARLIEST
        for batch in _in_turn(holders, topic):
            self._append(decoder, topic, batch, is_cdr=serialization is Serialization.CDR)
            if batch.receive_ns.min(initial=LATEST) < border:
                self._doubt_order(topic)
            latest = max(latest, int(batch.receive_ns.max(initial=EARLIEST)))
            if decoder.count >= enough and latest <= batch.later_ns:
                lost += decoder.losses
                yield decoder.finish()
                before, border = before + decoder.count, latest
                decoder = begun(before)
        lost += decoder.losses
        self._losses += [f"{topic}: {loss}; it is lost" for loss in lost[:MOST_SENTENCES]]
        if len(lost) > MOST_SENTENCES:
            self._losses.append(f"{topic}: {len(lost) - MOST_SENTENCES} further messages are lost likewise")
        if decoder.count or not before:
            yield decoder.finish()

    def _doubt_order(self, topic: str) -> None:
        problem = f"{topic} holds messages that were received earlier than the index says"
        if not self._salvage:
            raise LogCorrupt(self.path, "corrupt", problem)
        self._losses.append(f"{problem}; they may be out of order")

    def _append(self, decoder: ColumnDecoder, topic: str, batch: MessageBatch, *, is_cdr: bool) -> None:
        try:
            decoder.append(rosbag2.unpacked(batch) if is_cdr else batch)
        except Damage as damage:
            problem = f"{topic}: a message that was compressed by itself {damage}"
            if not self._salvage:
                raise LogCorrupt(self.path, "corrupt", problem) from None
            self._losses.append(f"{problem}; {len(batch.starts)} messages are lost")
        if decoder.losses and not self._salvage:
            raise LogCorrupt(self.path, "corrupt", f"{topic}: {decoder.losses[0]}")

    def _open_folder(self, folder: Path, stack: ExitStack) -> None:
        listing = rosbag2.list_folder(folder)
        self._warnings += listing.warnings
        for path in listing.files:
            try:
                self._open_file(path, stack)
            except LogError as error:
                if not self._salvage:
                    raise
                self._losses.append(f"{path.name} cannot be opened: {error.problem}")
        for topic, promised in listing.counts.items():
            found = self.topics[topic].count if topic in self.topics else 0
            if found != promised:
                problem = f"holds {found} messages of {topic}, where its metadata.yaml says {promised}"
                if not self._salvage:
                    raise LogCorrupt(folder, "corrupt", problem)
                self._losses.append(problem)

    def _open_file(self, path: Path, stack: ExitStack) -> None:
        beginning = _beginning(path)
        if beginning.startswith(ZSTD_MAGIC):
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="trundle-")))
            decompress_file(path, folder / path.stem)
            path, beginning = folder / path.stem, _beginning(folder / path.stem)
        for magic, opener in _FORMATS.items():
            if beginning.startswith(magic):
                recording = opener(path, salvage=self._salvage)
                stack.callback(recording.close)
                self._recordings.append(recording)
                for topic, info in recording.topics.items():
                    self.topics[topic] = info.joined(self.topics[topic]) if topic in self.topics else info
                return
        problem = f"begins with {beginning!r}; recordings begin as MCAP, rosbag2 (sqlite3) or ROS 1 bags do"
        raise LogError(path, "format", problem)


class _Opener(Protocol):
    def __call__(self, path: Path, *, salvage: bool) -> _Recording: ...


_FORMATS: dict[bytes, _Opener] = {
    mcap.MAGIC: mcap.McapFile,
    rosbag1.MAGIC: rosbag1.Rosbag1File,
    rosbag2.MAGIC: rosbag2.Rosbag2Database,
}


def _in_turn(holders: Sequence[_Recording], topic: str) -> Iterator[MessageBatch]:
    """A topic's messages from one file after the other."""
    for number, recording in enumerate(holders):
        firsts = [other.topics[topic].first_ns for other in holders[number + 1 :]]
        later_ns = min((first for first in firsts if first is not None), default=LATEST)
        for batch in recording.batches(topic):
            yield replace(batch, later_ns=min(batch.later_ns, later_ns))


def _beginning(path: Path) -> bytes:
    """The first bytes of a file that must be a regular one and hold something."""
    if not path.is_file():
        raise LogError(path, "not_a_file", "is no regular file" if path.exists() else "does not exist")
    with path.open("rb") as file:
        beginning = file.read(16)
    if not beginning:
        raise LogError(path, "empty", "holds nothing")
    return beginning


def open_bag(path: str | Path, *, salvage: bool = False) -> BagReader:
    """Open a recording: MCAP, sqlite3, a rosbag2 folder, or a ROS 1 bag, told apart by content.

    Args:
        path: File or folder.
        salvage: Read what can be read of a damaged recording; `losses` then says what could not.

    Raises:
        LogError: If it is no recording.
        LogTruncated: If it ends too early.
        LogCorrupt: If its bytes contradict themselves.
        LogLimit: If opening it would take more memory than it may.
    """
    try:
        return BagReader(Path(path), salvage=salvage)
    except OSError as error:
        raise LogError(path, "not_a_file", f"cannot be read: {error.strerror}") from None
