"""Wheel logs from tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.content import beginning_of
from trundle.adapters.conversion import (
    Conversion,
    check_steering,
    check_time,
    scalar_conversion,
    wheel_conversions,
    wheel_names,
)
from trundle.adapters.default_columns import default_time, with_default_columns
from trundle.adapters.doubts import WheelColumn, doubts
from trundle.adapters.motive import is_motive, read_motive
from trundle.adapters.numeral import Real, Stamp
from trundle.adapters.reference import reference_trajectory
from trundle.adapters.table import ColumnName, LongTable, Rows, Table, Wanted, open_table
from trundle.adapters.text_table import TextTable
from trundle.errors import ConfigError, LogSchema, LogTruncated
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Robot
from trundle.robot.log_mapping import Kind, LogMapping, ReferenceMapping, ScalarMapping, TimeMapping, Unit

__all__ = ["has_reference", "read_table_log", "table_log_pieces", "wheel_log_of"]

Array = npt.NDArray[Any]

PIECE = 1 << 17  # rows: as many as it takes to tell what is doubtful about a log


def read_table_log(path: Path, robot: Robot, mapping: LogMapping, *, salvage: bool = False) -> WheelLog:
    """A table as a wheel log.

    What the mapping does not name is looked for under Trundle's own column names.

    Args:
        path: Text or Parquet.
        robot: Whose wheels it holds.
        mapping: Where they stand.
        salvage: Read what there is of a file that was cut; `losses` then say so.

    Raises:
        LogTruncated: If the file ends inside a row.
        LogSchema: If a column is missing or ambiguous, or cannot be in its unit.
        LogError: If the file cannot be read.
        ConfigError: If the mapping does not fit the robot, or is one of topics.
    """
    return wheel_log_of(open_table(path, mapping.table), robot, mapping, salvage=salvage)


def has_reference(path: Path, robot: Robot, mapping: LogMapping) -> bool:
    """Whether a table says where the robot really was.

    Raises:
        LogSchema: As `read_table_log`.
        LogError: As `read_table_log`.
        ConfigError: As `read_table_log`.
    """
    return _Plan(open_table(path, mapping.table), robot, mapping).mapping.reference is not None


def table_log_pieces(
    path: Path, robot: Robot, mapping: LogMapping, *, salvage: bool = False
) -> Iterator[WheelLog]:
    """A table as a wheel log in pieces, in memory that does not depend on its length if it is a `LongTable`.

    The first piece has the reference, and what is doubtful about the whole; the last one what was left out.
    A reference is held as a whole.

    Args:
        path: As for `read_table_log`.
        robot: As for `read_table_log`.
        mapping: As for `read_table_log`.
        salvage: As for `read_table_log`.

    Raises:
        LogSchema: As for `read_table_log`; when the piece comes that is at fault.
        LogError: As for `read_table_log`.
        ConfigError: As for `read_table_log`.
    """
    table = open_table(path, mapping.table)
    if not isinstance(table, LongTable):
        yield wheel_log_of(table, robot, mapping, salvage=salvage)
        return
    plan = _Plan(table, robot, mapping, salvage=salvage)
    reference, warnings = _reference(table, plan)
    for number, rows in enumerate(table.pieces(plan.wanted.columns, PIECE)):
        log = plan.log(rows, is_first=not number)
        yield log if number else replace(log, reference=reference, warnings=(*log.warnings, *warnings))


def wheel_log_of(table: Table, robot: Robot, mapping: LogMapping, *, salvage: bool = False) -> WheelLog:
    """An open table as a wheel log; see `read_table_log`."""
    plan = _Plan(table, robot, mapping, salvage=salvage)
    rows = table.read(plan.wanted.columns)
    log = plan.log(rows)
    reference, warnings = _reference(table, plan)
    if reference is not None and plan.time.kind is Kind.INCREMENT and rows.rejected:
        reference, warnings = None, ("the log's reference is left out: rows without a time lie between",)
    return replace(log, reference=reference, warnings=(*log.warnings, *warnings))


class _Plan:
    """What is wanted of a table, and what becomes of its rows.

    Attributes:
        mapping: With the default columns that the table has.
        time: Where its time stands.
        declared_time: What the description says of it, if anything.
        wanted: The columns.
    """

    def __init__(self, table: Table, robot: Robot, mapping: LogMapping, *, salvage: bool = False) -> None:
        path = table.path
        self.salvage = salvage
        dialect = table.dialect_hint if isinstance(table, TextTable) else ""
        self.declared_time = mapping.time
        mapping = with_default_columns(mapping, robot, path, table.names, dialect)
        self.path, self.robot, self.mapping = path, robot, mapping
        self.time = mapping.time or default_time(table.names)
        self.wheels = {name: mapping.wheels[name] for name in _names(robot, mapping)}
        self.reading, self.conversions = (
            wheel_conversions(robot, self.wheels) if self.wheels else (Reading.POSITION, {})
        )
        self.wanted = wanted = _WantedColumns(path)
        wanted.add("time", Wanted(self.time.column, Stamp(self.time.unit)))
        for name, wheel in self.wheels.items():
            wanted.add_scalar(f"log.wheels.{name}", wheel, self.conversions[name])
        for name, scalar in mapping.steering.items():
            field = f"log.steering.{name}"
            wanted.add_scalar(field, scalar, scalar_conversion(field, scalar, Unit.RAD))
        if mapping.gyro is not None:
            conversion = scalar_conversion("log.gyro", mapping.gyro, Unit.RAD_S)
            wanted.add_scalar("log.gyro", mapping.gyro, conversion)
        self.twist = _twist_columns(path, mapping)
        for column in self.twist:
            wanted.add(f"log.twist.{column}", Wanted(column, Real()))
        self._elapsed = 0  # [ns], of the last row

    @np.errstate(over="ignore", invalid="ignore")
    def log(self, rows: Rows, *, is_first: bool = True) -> WheelLog:
        """Rows as a wheel log without a reference; units and the like are judged by the first ones."""
        path, robot, mapping, reading = self.path, self.robot, self.mapping, self.reading
        take = self.wanted.taker(rows)
        time_ns, seconds = _times(path, take("time"), self.time, self._elapsed)
        if len(time_ns):
            self._elapsed = int(time_ns[-1])
        losses = self._losses(rows)
        if is_first:
            check_time(path, time_ns, self.time.unit)
        for name, scalar in mapping.steering.items():
            check_steering(path, robot, name, scalar, take(f"log.steering.{name}"))
        columns = [
            WheelColumn(name, wheel, reading, self.conversions[name], time_ns, take(f"log.wheels.{name}"))
            for name, wheel in self.wheels.items()
        ]
        readings = _beside([column.values for column in columns])
        doubtful = doubts(robot, columns) if is_first else ()
        if seconds is not None and readings is not None and reading is Reading.VELOCITY:
            readings, reading = readings * seconds[:, None], Reading.INCREMENT
        return WheelLog(
            time_ns=time_ns,
            wheel_names=tuple(self.wheels),
            wheels=readings,
            reading=reading,
            steering_names=tuple(mapping.steering),
            steering=_beside([take(f"log.steering.{name}") for name in mapping.steering]),
            yaw_rate=None if mapping.gyro is None else take("log.gyro"),
            twists=_beside([take(f"log.twist.{column}") for column in self.twist]),
            rejected=rows.rejected,
            warnings=(*losses, *rows.warnings, *doubtful),
            losses=losses,
            source=str(path),
        )

    def _losses(self, rows: Rows) -> tuple[str, ...]:
        """What is missing at the end of the file, of which these are the last rows.

        Raises:
            LogTruncated: If that is certain, and not to be salvaged.
        """
        if rows.ending is None:
            return ()
        if rows.ending.is_cut and not self.salvage:
            seconds, nanoseconds = divmod(self._elapsed, 1_000_000_000)
            until = f"the rows before it reach until {seconds}.{nanoseconds:09} s"
            raise LogTruncated(self.path, "truncated", f"{rows.ending.words}; {until}")
        return (rows.ending.loss,)


def _times(path: Path, column: Array, mapping: TimeMapping, elapsed: int = 0) -> tuple[Array, Array | None]:
    """Stamps [ns], and how long each row took [s] where that is what the log says, after so many ns."""
    if mapping.kind is not Kind.INCREMENT:
        return column, None
    if abs(elapsed) + float(np.abs(column.astype(np.float64)).sum()) >= 2.0**63:
        raise LogSchema(path, "unit", "its rows took more than 292 years: declare the unit of the time")
    return elapsed + np.cumsum(column), column * 1e-9


class _WantedColumns:
    """What is read in one pass, by what it is for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.columns: list[Wanted] = []
        self._places: dict[str, tuple[int, Conversion]] = {}

    def add(self, purpose: str, wanted: Wanted, factor: float = 1) -> None:
        self._places[purpose] = len(self.columns), Conversion(wanted.numeral, factor)
        self.columns.append(wanted)

    def add_scalar(self, field: str, mapping: ScalarMapping, conversion: Conversion) -> None:
        if mapping.column is None:
            raise _needs_columns(self.path, f"{field}.topic", mapping.topic)
        self.add(field, Wanted(mapping.column, conversion.numeral, mapping.hold), conversion.factor)

    def taker(self, rows: Rows) -> Callable[[str], Array]:
        def take(purpose: str) -> Array:
            place, conversion = self._places[purpose]
            return conversion.of(rows.columns[place])

        return take


def _names(robot: Robot, mapping: LogMapping) -> tuple[str, ...]:
    return wheel_names(robot, mapping.wheels) if mapping.wheels else ()


def _twist_columns(path: Path, mapping: LogMapping) -> tuple[ColumnName, ...]:
    if mapping.twist is None:
        return ()
    if mapping.twist.columns is None:
        raise _needs_columns(path, "log.twist.topic", mapping.twist.topic)
    return mapping.twist.columns


def _needs_columns(path: Path, field: str, topic: str | None) -> ConfigError:
    return ConfigError(field, f"{topic!r}, but {path} is a table: must be a column")


def _beside(columns: list[Array]) -> Array | None:
    return np.stack(columns, axis=-1) if columns else None


# --- the reference -------------------------------------------------------------------------------


def _reference(table: Table, plan: _Plan) -> tuple[Trajectory | None, tuple[str, ...]]:
    """The reference and what was wrong with some of its rows.

    It is read in a pass of its own: where tracking was lost, the wheels still turned.
    """
    reference, time = plan.mapping.reference, plan.time
    if reference is None:
        return None, ()
    if reference.file is not None:
        other = table.path.parent / reference.file
        if is_motive(beginning_of(other)):
            return _take(other, reference), ()
        table = open_table(other, plan.mapping.table)
        time = reference.time or plan.declared_time or default_time(table.names)
    if reference.columns is None:
        raise _needs_columns(table.path, "log.reference.topic", reference.topic)
    try:
        rows = table.read(
            [Wanted(time.column, Stamp(time.unit)), *(Wanted(c, Real()) for c in reference.columns)]
        )
    except LogSchema as error:
        if error.reason != "parse":
            raise
        return None, (f"the log has reference columns, but no row of them is whole: {error.problem}",)
    if Kind.INCREMENT in (time.kind, reference.kind):
        broken = rows.warnings or ("a number of it is not finite",) * (not _is_finite(rows))
        if broken:
            return None, (f"the log's reference adds up row by row, so all must be whole: {broken[0]}",)
    time_ns, _ = _times(table.path, rows.columns[0], time)
    check_time(table.path, time_ns, time.unit)
    trajectory = _trajectory(table.path, rows, time_ns, reference)
    return trajectory, tuple(f"reference: {warning}" for warning in rows.warnings)


def _take(path: Path, mapping: ReferenceMapping) -> Trajectory:
    """The rigid body that the mapping's topic names, as OptiTrack saw it."""
    seen = read_motive(path, mapping.topic)
    x, y, theta = seen.poses.T
    reference = reference_trajectory(path, seen.time_ns, x, y, theta, mapping)
    return replace(reference, rejected=seen.rejected)


def _is_finite(rows: Rows) -> bool:
    return all(bool(np.isfinite(column).all()) for column in rows.columns)


def _trajectory(path: Path, rows: Rows, time_ns: Array, mapping: ReferenceMapping) -> Trajectory:
    _, x, y, *theta = rows.columns
    return reference_trajectory(path, time_ns, x, y, theta[0] if theta else None, mapping)
