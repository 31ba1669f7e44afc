"""Numbers of a recording's topics, message by message, with the time that counts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from trundle.adapters.topic_columns import TopicColumns, TopicInfo
from trundle.errors import LogError, LogSchema, listed, no_such
from trundle.robot.log_mapping import Clock

__all__ = ["Recording", "TopicSource"]

Array = npt.NDArray[Any]
Mask = npt.NDArray[np.bool_]
Stamps = npt.NDArray[np.int64]

SKEW = 0.1  # [s]: clocks that differ by more, on average or as standard deviation, disagree


class Recording(Protocol):
    """An open recording of any format, read topic by topic."""

    path: Path
    topics: dict[str, TopicInfo]

    @property
    def losses(self) -> list[str]:
        """What could not be read, one sentence each."""

    @property
    def warnings(self) -> list[str]:
        """What could not be checked, one sentence each."""

    def read(self, topic: str, fields: Sequence[str]) -> TopicColumns:
        """Columns of the named fields of a topic's messages."""


class TopicSource:
    """A recording whose messages are stamped by one of two clocks.

    Attributes:
        bag: The recording.
        warnings: What a person should know about its clocks, as sentences.
    """

    def __init__(self, bag: Recording, clock: Clock) -> None:
        self.bag = bag
        self.warnings: list[str] = []
        self._clock = clock
        self._late: dict[str, float] = {}  # by topic, how much later than stamped it was received [s]

    def described(self, like: str = "") -> str:
        """Its topics and their types, for errors; of many those most like a word."""
        return listed(
            [f"{topic} ({info.type})" for topic, info in sorted(self.bag.topics.items())], like=like
        )

    @property
    def differences(self) -> list[str]:
        """A sentence if what was read so far is stamped by clocks that differ."""
        if not self._late:
            return []
        first, last = min(self._late, key=self._late.__getitem__), max(self._late, key=self._late.__getitem__)
        apart = self._late[last] - self._late[first]
        if apart <= SKEW:
            return []
        return [
            f"{first} and {last}: their clocks are {apart:.3g} s apart, by the times of receipt; "
            "the stamps are used; log.clock: receive would use the others"
        ]

    def type_of(self, topic: str) -> str:
        """Type of a topic's messages.

        Raises:
            LogSchema: If there is no such topic.
        """
        if topic not in self.bag.topics:
            raise LogSchema(
                self.bag.path, "topic", no_such("topic", topic, self.bag.topics, self.described(topic))
            )
        return self.bag.topics[topic].type

    def read(self, topic: str, fields: Sequence[str]) -> tuple[Stamps, TopicColumns]:
        """Stamps and fields of a topic's messages.

        Raises:
            LogSchema: If topic or field does not exist.
            LogError: If there is no message.
        """
        ((stamps, columns),) = self.stamped(topic, [self.bag.read(topic, fields)])
        return stamps, columns

    def stamped(self, topic: str, pieces: Iterable[TopicColumns]) -> Iterator[tuple[Stamps, TopicColumns]]:
        """Messages that come in pieces, with the time that counts; what is wrong with it is known at the end.

        Args:
            topic: Whose they are.
            pieces: One after the other; whether they bear stamps, the first one says.

        Raises:
            LogError: If there is no message.
        """
        delay: _Delay | None = None
        count = 0
        for columns in pieces:
            header, receive = columns.header_ns, columns.receive_ns
            if not len(receive):
                continue
            if self._clock is Clock.RECEIVE or header is None or (delay is None and not header.any()):
                yield receive, columns
            else:
                delay = delay or _Delay(int(receive[0]), int(header[0]))
                delay.add(receive, header)
                yield header, columns
            count += len(receive)
        if not count:
            raise LogError(self.bag.path, "empty", "; ".join((f"{topic} has no message", *self.bag.losses)))
        if self._clock is Clock.RECEIVE:
            return
        if delay is None:
            self.warnings.append(f"{topic}: its messages bear no stamp; the times of receipt are used")
        self._late[topic] = 0.0 if delay is None else delay.mean
        if delay is not None and (skew := delay.deviation) > SKEW:
            self.warnings.append(
                f"{topic}: stamps and times of receipt disagree (standard deviation {skew:.3g} s); "
                "the stamps are used; log.clock: receive would use the others"
            )

    def numbers(self, topic: str, columns: TopicColumns, path: str) -> Array:
        """A field that holds one number per message.

        Raises:
            LogSchema: If it holds something else.
        """
        values = columns.columns[path]
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "fiub":
            raise LogSchema(self.bag.path, "type", f"{topic}: {path} holds no single numbers")
        if values.ndim != 1:
            raise LogSchema(
                self.bag.path, "field", f"{topic}: {path} is an array; say which element by name: 0, 1, ..."
            )
        return values

    def elements(
        self, topic: str, columns: TopicColumns, path: str, name: str | int, names: str
    ) -> tuple[Array, Mask]:
        """One element of an array field, and in which messages it is there.

        Args:
            topic: For errors.
            columns: What was read.
            path: The array's field.
            name: Its name, as each message says it; or its number from 0.
            names: The field that holds the names.

        Raises:
            LogSchema: If no message has it; the message lists what they have.
        """
        values: Any = columns.columns[path]
        count = len(columns.receive_ns)
        plain = isinstance(values, np.ndarray) and values.ndim == 2 and values.dtype.kind in "fiub"
        if not plain and not (isinstance(values, list) and isinstance(values[0], np.ndarray)):
            raise LogSchema(self.bag.path, "type", f"{topic}: {path} is no array of numbers")
        found, present = np.zeros(count, values[0].dtype), np.zeros(count, dtype=bool)
        known: Counter[str] = Counter()
        for words, rows in _layouts(columns.columns[names] if isinstance(name, str) else None, count):
            known.update(words)
            place = name if isinstance(name, int) else words.index(name) if name in words else None
            if place is None:
                continue
            for row in rows if not plain else ():
                if place < len(values[row]):
                    found[row], present[row] = values[row][place], True
            if plain and place < values.shape[1]:
                found[rows], present[rows] = values[rows, place], True
        if not present.any():
            has = (
                f"they have {listed(sorted(known), like=str(name))}" if known else f"their {path} is shorter"
            )
            raise LogSchema(self.bag.path, "joint", f"{topic}: no message has an element {name!r}; {has}")
        return found, present


class _Delay:
    """How much later than stamped messages were received, summed up piece by piece."""

    def __init__(self, receive_ns: int, header_ns: int) -> None:
        """Start from the first message's times."""
        self._receive, self._header = receive_ns, header_ns
        self._count, self._mean, self._squares = 0, 0.0, 0.0  # [ns], [ns^2] about the mean

    def add(self, receive: Stamps, header: Stamps) -> None:
        """Add messages. Chan, Golub, LeVeque: Updating Formulae and a Pairwise Algorithm (1979)."""
        late = (receive - self._receive) - (header - self._header)
        count, mean = len(late), float(np.mean(late))
        total, apart = self._count + count, mean - self._mean
        self._squares += float(np.sum((late - mean) ** 2)) + apart**2 * self._count * count / total
        self._mean += apart * count / total
        self._count = total

    @property
    def mean(self) -> float:
        """On average [s]."""
        return self._mean * 1e-9 + (self._receive - self._header) * 1e-9

    @property
    def deviation(self) -> float:
        """Standard deviation [s]."""
        return math.sqrt(self._squares / self._count) * 1e-9


def _layouts(names: Any, count: int) -> Iterator[tuple[tuple[str, ...], Array]]:
    """Each order of names with the messages that have it."""
    if names is None or isinstance(names, tuple):
        yield names or (), np.arange(count)
        return
    rows: dict[tuple[str, ...], list[int]] = {}
    for row, words in enumerate(names):
        rows.setdefault(tuple(words), []).append(row)
    for words, members in rows.items():
        yield words, np.array(members)
