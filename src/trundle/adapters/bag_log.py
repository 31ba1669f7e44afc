"""Wheel logs from recorded topics.

The stamps of the first wheel's topic are the rows of the log; where values are logged when they change, so
are the stamps of all that change. What other topics say is put there: a running total or a speed between its
neighbours, an increment by its running sum, a held value as it was last.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from trundle.adapters.bag import BagReader, open_bag
from trundle.adapters.conversion import (
    Conversion,
    check_steering,
    scalar_conversion,
    wheel_conversions,
    wheel_names,
)
from trundle.adapters.doubts import WheelColumn, doubts
from trundle.adapters.quaternion import yaw_of_quaternion
from trundle.adapters.reference import reference_trajectory
from trundle.adapters.resampling import changes, held, interpolated, summed, turned, unwrapped
from trundle.adapters.topic_columns import TopicColumns
from trundle.adapters.topic_fields import pose_fields, scalar_field, twist_fields
from trundle.adapters.topic_source import Recording, TopicSource
from trundle.errors import ConfigError, LogSchema
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Robot
from trundle.robot.log_mapping import (
    Clock,
    LogMapping,
    ScalarMapping,
    TwistMapping,
    Unit,
    WheelMapping,
)

__all__ = ["bag_log_pieces", "read_bag_log", "recording_log"]

Array = npt.NDArray[Any]
Stamps = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

PIECE = 1 << 17  # messages: as many as it takes to tell what is doubtful about a log


def read_bag_log(path: Path, robot: Robot, mapping: LogMapping, *, salvage: bool = False) -> WheelLog:
    """A recording as a wheel log.

    Args:
        path: MCAP, a rosbag, or a rosbag2 folder.
        robot: Whose wheels it holds.
        mapping: Which topics hold them.
        salvage: Read what can be read of a damaged recording; `warnings` then say what could not.

    Raises:
        LogSchema: If a topic, field or joint does not exist, or cannot be in its unit.
        LogError: If the recording cannot be read.
        ConfigError: If the mapping does not fit the robot, or is one of columns.
    """
    with open_bag(path, salvage=salvage) as bag:
        return recording_log(bag, robot, mapping)


def bag_log_pieces(
    path: Path, robot: Robot, mapping: LogMapping, *, salvage: bool = False
) -> Iterator[WheelLog]:
    """A recording as a wheel log in pieces: part by part, where one topic says everything.

    What several topics say is put together of the whole; so are values that are held, and a topic
    whose messages begin without a stamp. What there is to say about the log, the last piece says.

    Args:
        path: As for `read_bag_log`.
        robot: As for `read_bag_log`.
        mapping: As for `read_bag_log`.
        salvage: As for `read_bag_log`.

    Raises:
        LogSchema: As for `read_bag_log`; when the piece comes that is at fault, or at the end.
        LogError: So too.
        ConfigError: As for `read_bag_log`.
    """
    with open_bag(path, salvage=salvage) as bag:
        plan = _BagLog(TopicSource(bag, mapping.clock), robot, mapping)
        if not plan.comes_in_pieces:
            yield recording_log(bag, robot, mapping)
            return
        former: WheelLog | None = None
        for log in plan.pieces(bag):
            if former is not None:
                yield former
            former = log
        assert former is not None  # a topic without messages has been refused
        losses = tuple(bag.losses)
        said = (*losses, *bag.warnings, *plan.source.warnings, *former.warnings)
        yield dataclasses.replace(former, warnings=said, losses=losses)


def recording_log(recording: Recording, robot: Robot, mapping: LogMapping) -> WheelLog:
    """An open recording as a wheel log.

    Args:
        recording: Of any format.
        robot: Whose wheels it holds.
        mapping: Which topics hold them.

    Raises:
        LogSchema: If a topic, field or joint does not exist, or cannot be in its unit.
        LogError: If the recording cannot be read.
        ConfigError: If the mapping does not fit the robot, or is one of columns.
    """
    log = _BagLog(TopicSource(recording, mapping.clock), robot, mapping).read()
    losses = tuple(recording.losses)
    return dataclasses.replace(log, warnings=(*losses, *recording.warnings, *log.warnings), losses=losses)


@dataclass(frozen=True, slots=True)
class _Signal:
    """One number per message, and what it becomes."""

    topic: str
    path: str
    name: str | int | None
    conversion: Conversion
    hold: bool

    @property
    def names_path(self) -> str:
        """Where the messages name the elements of the array."""
        parent, dot, _ = self.path.rpartition(".")
        return f"{parent}{dot}name"

    @property
    def fields(self) -> tuple[str, ...]:
        return (self.path, self.names_path) if isinstance(self.name, str) else (self.path,)


@dataclass(frozen=True, slots=True)
class _Series:
    """What a signal said."""

    time_ns: Stamps
    values: Array


class _BagLog:
    """One recording, and what is wanted of it."""

    def __init__(self, source: TopicSource, robot: Robot, mapping: LogMapping) -> None:
        self.source = source
        self.path = source.bag.path
        self.robot = robot
        self.mapping = mapping
        self.rejected: Counter[str] = Counter()
        if not mapping.wheels and mapping.twist is None:
            measured = ", ".join(robot.measuring.measured_names)
            wanted = f"must name the topics of {measured}, or log.twist that of the robot's own twist"
            raise LogSchema(self.path, "topic", f"log.wheels {wanted}; it has {source.described()}")
        self.names = wheel_names(robot, mapping.wheels) if mapping.wheels else ()
        wheels = {name: mapping.wheels[name] for name in self.names}
        self.reading, self.conversions = Reading.POSITION, dict[str, Conversion]()
        if wheels:
            self.reading, self.conversions = wheel_conversions(robot, wheels)

    def read(self) -> WheelLog:
        signals = self._signals()
        series = self._series(signals)
        twist = self._twists()
        doubtful = doubts(self.robot, self._wheel_columns(series))
        log = self._log(signals, series, twist)
        if not len(log):
            raise self._unmatched()
        reference = self._reference()
        warnings = (*self.source.warnings, *self.source.differences, *doubtful)
        return dataclasses.replace(log, reference=reference, warnings=warnings)

    @property
    def comes_in_pieces(self) -> bool:
        """Whether each message says all that there is at its time."""
        signals, mapping = self._signals(), self.mapping
        topics = {signal.topic for signal in signals.values()}
        together = mapping.reference is not None or any(signal.hold for signal in signals.values())
        return not together and len(topics) + (mapping.twist is not None) == 1

    def pieces(self, bag: BagReader) -> Iterator[WheelLog]:
        """What `read` returns, in pieces; the last one says what is doubtful about the first.

        What `rejected` counts comes with the next piece that has rows.

        Raises:
            LogSchema: If no piece has the elements that are wanted.
        """
        topic, wanted, fields = self._one_topic()
        doubtful: tuple[str, ...] | None = None
        absent: LogSchema = self._unmatched()
        for time_ns, columns in self.source.stamped(topic, self._cut(bag, topic, fields)):
            series: dict[str, _Series] = {}
            twist = None
            try:
                if wanted:
                    series = self._topic_series(topic, wanted, time_ns, columns)
                else:
                    twist = self._twist_series(topic, fields, time_ns, columns)
            except LogSchema as error:
                if error.reason != "joint":
                    raise
                absent = error  # in all messages of this piece; others may have the joint
                self.rejected["missing_joint"] += len(time_ns)
                continue
            if doubtful is None:
                doubtful = doubts(self.robot, self._wheel_columns(series))
            log = self._log(wanted, series, twist)
            if len(log):
                yield dataclasses.replace(log, warnings=doubtful)
                self.rejected.clear()
        if doubtful is None:
            raise absent

    def _one_topic(self) -> tuple[str, dict[str, _Signal], Sequence[str]]:
        """The topic that says everything, and what is wanted of it."""
        signals = self._signals()
        if self.mapping.twist is not None:
            topic, fields = self._twist_fields(self.mapping.twist)
            return topic, signals, fields
        wanted = dict.fromkeys(field for signal in signals.values() for field in signal.fields)
        return next(iter(signals.values())).topic, signals, list(wanted)

    def _cut(self, bag: BagReader, topic: str, fields: Sequence[str]) -> Iterator[TopicColumns]:
        """A topic in pieces; the whole where its first piece bears no stamp, as those behind it may."""
        pieces = bag.pieces(topic, fields, PIECE)
        first = next(pieces)
        if self.mapping.clock is Clock.HEADER and first.header_ns is not None and not first.header_ns.any():
            pieces.close()
            yield bag.read(topic, fields)
            return
        yield first
        yield from pieces

    def _unmatched(self) -> LogSchema:
        problem = "; ".join(("what is wanted has no time in common", *self.source.differences))
        return LogSchema(self.path, "unmatched", problem)

    @np.errstate(over="ignore", invalid="ignore")
    def _log(
        self, signals: dict[str, _Signal], series: dict[str, _Series], twist: _Series | None
    ) -> WheelLog:
        """What was said, on common rows."""
        if self.reading is Reading.TICKS and not self._can_stay_raw(signals, series):
            self._unwrap(series)
        time_ns = self._rows(signals, series, twist)
        columns, known = {}, np.ones(len(time_ns), dtype=bool)
        for label, own in series.items():
            columns[label], there = self._at(time_ns, own, label, hold=signals[label].hold)
            known &= there
        self.rejected["unmatched"] = int((~known).sum())
        for name, scalar in self.mapping.steering.items():
            check_steering(self.path, self.robot, name, scalar, columns[f"log.steering.{name}"])

        def beside(labels: Sequence[str]) -> Array | None:
            return np.stack([columns[label][known] for label in labels], axis=-1) if labels else None

        return WheelLog(
            time_ns=time_ns[known],
            wheel_names=self.names,
            wheels=beside([f"log.wheels.{name}" for name in self.names]),
            reading=self.reading,
            steering_names=tuple(self.mapping.steering),
            steering=beside([f"log.steering.{name}" for name in self.mapping.steering]),
            yaw_rate=columns["log.gyro"][known] if self.mapping.gyro else None,
            twists=None if twist is None else self._twists_at(time_ns[known], twist),
            rejected=+self.rejected,
            source=str(self.path),
        )

    # --- what is wanted, and what the topics say of it -------------------------------------------

    def _signals(self) -> dict[str, _Signal]:
        """Every scalar, by where its mapping stands; the wheels first."""
        mapping = self.mapping
        signals = {
            f"log.wheels.{name}": self._signal(
                f"log.wheels.{name}", name, mapping.wheels[name], self.conversions[name]
            )
            for name in self.names
        }
        for name, scalar in mapping.steering.items():
            label = f"log.steering.{name}"
            conversion = scalar_conversion(label, scalar, Unit.RAD)
            signals[label] = self._signal(label, name, scalar, conversion)
        if mapping.gyro is not None:
            conversion = scalar_conversion("log.gyro", mapping.gyro, Unit.RAD_S)
            signals["log.gyro"] = self._signal("log.gyro", "gyro", mapping.gyro, conversion)
        return signals

    def _signal(self, label: str, what: str, mapping: ScalarMapping, conversion: Conversion) -> _Signal:
        if mapping.topic is None:
            raise ConfigError(
                f"{label}.column", f"{mapping.column!r}, but {self.path} has topics, no columns"
            )
        kind = self.source.type_of(mapping.topic)
        speed = isinstance(mapping, WheelMapping) and self.reading is Reading.VELOCITY
        path = mapping.field or scalar_field(self.path, mapping.topic, kind, speed=speed)
        name = mapping.name
        if name is None and kind == "sensor_msgs/msg/JointState":
            name = what
        return _Signal(mapping.topic, path, name, conversion, mapping.hold)

    def _series(self, signals: dict[str, _Signal]) -> dict[str, _Series]:
        """What each signal said, a topic at a time: a message that lacks one signal lacks them all."""
        series: dict[str, _Series] = {}
        for topic in dict.fromkeys(signal.topic for signal in signals.values()):
            wanted = {label: signal for label, signal in signals.items() if signal.topic == topic}
            fields = dict.fromkeys(field for signal in wanted.values() for field in signal.fields)
            time_ns, columns = self.source.read(topic, list(fields))
            series |= self._topic_series(topic, wanted, time_ns, columns)
        return {label: series[label] for label in signals}

    @np.errstate(over="ignore", invalid="ignore")
    def _topic_series(
        self, topic: str, wanted: dict[str, _Signal], time_ns: Stamps, columns: TopicColumns
    ) -> dict[str, _Series]:
        """What each signal of one topic said."""
        keep = np.ones(len(time_ns), dtype=bool)
        raw: dict[str, Array] = {}
        for label, signal in wanted.items():
            if signal.name is None:
                raw[label] = self.source.numbers(topic, columns, signal.path)
                continue
            raw[label], present = self.source.elements(
                topic, columns, signal.path, signal.name, signal.names_path
            )
            keep &= present
        self.rejected["missing_joint"] += int((~keep).sum())
        read = {label: signal.conversion.numeral.of_numbers(raw[label]) for label, signal in wanted.items()}
        for label, (_, refused) in read.items():
            finite = np.isfinite(raw[label])
            self.rejected["nonfinite"] += int((keep & refused & ~finite).sum())
            self.rejected["parse"] += int((keep & refused & finite).sum())
            keep &= ~refused
        return {
            label: _Series(time_ns[keep], wanted[label].conversion.of(values[keep]))
            for label, (values, _) in read.items()
        }

    def _wheel_columns(self, series: dict[str, _Series]) -> list[WheelColumn]:
        columns = []
        for name in self.names:
            own, mapping = series[f"log.wheels.{name}"], self.mapping.wheels[name]
            conversion = self.conversions[name]
            columns.append(WheelColumn(name, mapping, self.reading, conversion, own.time_ns, own.values))
        return columns

    # --- common rows -----------------------------------------------------------------------------

    def _rows(self, signals: dict[str, _Signal], series: dict[str, _Series], twist: _Series | None) -> Stamps:
        """The stamps of the log: those of the first wheel, or of the robot's own twist.

        Where that wheel is logged when it changes, whatever else is logged so makes rows as well.
        """
        if self.names:
            first = f"log.wheels.{self.names[0]}"
            if signals[first].hold and self.reading is not Reading.INCREMENT:
                on_change = [own.time_ns for label, own in series.items() if signals[label].hold]
                return changes(self.path, on_change)
            return series[first].time_ns
        assert twist is not None  # a mapping without wheels and twist has been refused
        return twist.time_ns

    def _can_stay_raw(self, signals: dict[str, _Signal], series: dict[str, _Series]) -> bool:
        """Whether no counter has to be known between two of its readings."""
        labels = [f"log.wheels.{name}" for name in self.names]
        first = series[labels[0]].time_ns
        return all(signals[k].hold or np.array_equal(series[k].time_ns, first) for k in labels)

    def _unwrap(self, series: dict[str, _Series]) -> None:
        """Make angles of counters, which alone can be interpolated."""
        self.reading = Reading.POSITION
        for name in self.names:
            label, encoder = f"log.wheels.{name}", self.robot.encoders[name]
            angles = unwrapped(series[label].values, encoder.bits) * encoder.radians_per_tick
            series[label] = _Series(series[label].time_ns, angles)

    def _at(self, time_ns: Stamps, series: _Series, label: str, *, hold: bool) -> tuple[Array, Mask]:
        if np.array_equal(series.time_ns, time_ns):
            return series.values, np.ones(len(time_ns), dtype=bool)
        if hold:
            return held(time_ns, series.time_ns, series.values)
        if label.startswith("log.steering."):
            return turned(time_ns, series.time_ns, series.values)
        increments = label.startswith("log.wheels.") and self.reading is Reading.INCREMENT
        put = summed if increments else interpolated
        return put(time_ns, series.time_ns, series.values)

    # --- twists and the reference ----------------------------------------------------------------

    def _twists(self) -> _Series | None:
        if self.mapping.twist is None:
            return None
        topic, fields = self._twist_fields(self.mapping.twist)
        return self._twist_series(topic, fields, *self.source.read(topic, fields))

    def _twist_fields(self, twist: TwistMapping) -> tuple[str, Sequence[str]]:
        if twist.topic is None:
            raise ConfigError("log.twist.columns", f"{self.path} has topics, no columns")
        return twist.topic, twist_fields(self.path, twist.topic, self.source.type_of(twist.topic))

    def _twist_series(
        self, topic: str, fields: Sequence[str], time_ns: Stamps, columns: TopicColumns
    ) -> _Series:
        parts = [self.source.numbers(topic, columns, field) for field in fields]
        return _Series(time_ns, np.stack(parts, axis=-1))

    def _twists_at(self, time_ns: Stamps, twist: _Series) -> Array:
        """The robot's own twists at the wheels' stamps; NaN where it said none."""
        if np.array_equal(twist.time_ns, time_ns):
            return twist.values
        parts = [interpolated(time_ns, twist.time_ns, column) for column in twist.values.T]
        return np.stack([np.where(known, values, np.nan) for values, known in parts], axis=-1)

    def _reference(self) -> Trajectory | None:
        reference = self.mapping.reference
        if reference is None:
            return None
        if reference.topic is None:
            raise ConfigError("log.reference.columns", f"{self.path} has topics, no columns")
        topic = reference.topic
        position, rotation = pose_fields(self.path, topic, self.source.type_of(topic))
        time_ns, columns = self.source.read(topic, [*position, *rotation])
        x, y = (self.source.numbers(topic, columns, field) for field in position)
        angles = [self.source.numbers(topic, columns, field) for field in rotation]
        if len(angles) == 4:
            # A quaternion has no unit; the mapping's is for headings that are numbers.
            angles, reference = [yaw_of_quaternion(*angles)], replace(reference, angle_unit=Unit.RAD)
        return reference_trajectory(self.path, time_ns, x, y, angles[0] if angles else None, reference)
