"""Logs of any format, by their content."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from trundle.adapters.content import Content, content_of
from trundle.adapters.sensor_correction import corrected
from trundle.adapters.stamp_order import in_order, pieces_in_order
from trundle.adapters.steady_file import SteadyFile
from trundle.errors import LogCorrupt, LogError, LogTruncated, TrundleError, require_path
from trundle.records import WheelLog
from trundle.robot import Kinematics, LogMapping, Robot

__all__ = ["LONG", "is_long", "read_log", "read_log_pieces"]

LONG = 16 << 20  # bytes of text, whose columns and poses would take ten to twenty times as much
PACKED = 16  # times as many rows as in text are in as many bytes of Parquet

Reader = Callable[[Path, Robot, LogMapping, bool], WheelLog]
Cutter = Callable[[Path, Robot, bool], Iterator[WheelLog]]


def read_log(
    path: str | os.PathLike[str],
    robot: Robot | Kinematics,
    *,
    mapping: LogMapping | None = None,
    salvage: bool = False,
    sort: bool = False,
) -> WheelLog:
    """What the sensors of a robot said, from a log of any known format.

    Args:
        path: A text table, Parquet, MCAP, a rosbag, a rosbag2 folder, or a donkeycar tub;
            told apart by content.
        robot: Whose log it is; or just its drive.
        mapping: How the log says it, in place of the robot's own `log` section.
        salvage: Of a damaged file, read what can be read; `warnings` say what could not. Parquet, NumPy
            archives and tubs are read whole or not at all.
        sort: Put rows in the order of their stamps however late they come; without it, up to one second.

    Returns:
        Readings of the robot's measured wheels, or its body twists, in SI units or raw counts; rows as
        they were recorded, in the order of time, except those that could not be read, which are counted in
        `rejected`.

    Raises:
        LogError: If the file cannot be read; its `reason` says why: `not_a_file`, `empty`, `format`,
            `encoding`, `unreadable`, `unsorted`, `changed` (while it was read), `unsafe`, `unsafe_path`.
            LogTruncated, LogCorrupt and LogLimit for damaged recordings.
        LogSchema: If it does not hold what the mapping says: `column`, `topic`, `field`, `ambiguous`,
            `parse`, `unit`, `type`.
        ConfigError: If the mapping does not fit the robot.
        MissingExtra: If the format needs a package that is not installed.
    """
    path = require_path(path)
    described = robot if isinstance(robot, Robot) else Robot(drive=robot)
    content, file = content_of(path), SteadyFile(path)
    # NaN and infinity go through units and mountings as they are: odometry judges them.
    with np.errstate(over="ignore", invalid="ignore"), _remedied(content, salvage=salvage):
        log = _read(content, file, described, mapping or described.log, salvage=salvage)
    log = in_order(corrected(log, mapping or described.log), sort=sort)
    return dataclasses.replace(log, warnings=(*log.warnings, *_silence(log, described)))


def read_log_pieces(
    path: str | os.PathLike[str], robot: Robot | Kinematics, *, salvage: bool = False
) -> Iterator[WheelLog]:
    """What `read_log` returns, in pieces: in memory that does not depend on how many rows there are.

    Tables come so, and bags where one topic says everything, without a reference; NumPy archives, WPILOG and
    tubs come as one piece. The first rows decide what is doubtful about the log. The first piece has the
    reference, the last ones say what was left out or put in order.

    Args:
        path: As for `read_log`.
        robot: As for `read_log`.
        salvage: As for `read_log`.

    Raises:
        LogError: As `read_log`; when the piece comes that is at fault.
        LogSchema: So too.
        ConfigError: As `read_log`.
        MissingExtra: As `read_log`.
    """
    path = require_path(path)
    cut = _CUTTERS.get(content_of(path))
    if cut is None:
        yield read_log(path, robot, salvage=salvage)
        return
    described, file = robot if isinstance(robot, Robot) else Robot(drive=robot), SteadyFile(path)
    with _remedied(content_of(path), salvage=salvage):
        yield from pieces_in_order(_steady(cut(path, described, salvage), file, described, salvage=salvage))


def is_long(path: Path, robot: Robot) -> bool:
    """Whether a log should be read in pieces: long and without a reference, which is held as a whole."""
    if not path.exists() or _size(path) * PACKED <= LONG:
        return False
    content = content_of(path)
    if content not in _CUTTERS or _size(path) * (PACKED if content is Content.PARQUET else 1) <= LONG:
        return False
    if _CUTTERS[content] is _bag_pieces:
        return robot.log.reference is None
    from trundle.adapters.table_log import has_reference

    return not has_reference(path, robot, robot.log)


def _size(path: Path) -> int:
    """Bytes of a file, or of the files in a folder."""
    return sum(file.stat().st_size for file in (path.iterdir() if path.is_dir() else (path,)))


def _table_pieces(path: Path, robot: Robot, salvage: bool) -> Iterator[WheelLog]:
    from trundle.adapters.table_log import table_log_pieces

    return table_log_pieces(path, robot, robot.log, salvage=salvage)


def _bag_pieces(path: Path, robot: Robot, salvage: bool) -> Iterator[WheelLog]:
    from trundle.adapters.bag_log import bag_log_pieces

    return bag_log_pieces(path, robot, robot.log, salvage=salvage)


def _steady(
    pieces: Iterator[WheelLog], file: SteadyFile, robot: Robot, *, salvage: bool
) -> Iterator[WheelLog]:
    """Pieces, corrected, of a file that must not change until the last one."""
    log: WheelLog | None = None
    with _readable(file):
        for piece in pieces:
            said: tuple[str, ...] = ()
            if log is None:
                said = _silence(piece, robot)
            else:
                yield log
            with np.errstate(over="ignore", invalid="ignore"):
                log = dataclasses.replace(corrected(piece, robot.log), warnings=(*piece.warnings, *said))
    if log is not None:
        yield _while_same(file, log, salvage=salvage)


def _silence(log: WheelLog, robot: Robot) -> tuple[str, ...]:
    if robot.measuring.gyro and log.wheels is not None and log.yaw_rate is None:
        return ("the robot measures with a gyro, but its log has none (log.gyro)",)
    return ()


def _read(
    content: Content, file: SteadyFile, robot: Robot, mapping: LogMapping, *, salvage: bool
) -> WheelLog:
    """The log, unless its file changed meanwhile; with `salvage`, that is a loss."""
    with _readable(file):
        log = _READERS[content](file.path, robot, mapping, salvage)
    return _while_same(file, log, salvage=salvage)


@contextmanager
def _remedied(content: Content, *, salvage: bool) -> Iterator[None]:
    """Errors of damaged files name `salvage` where that helps and was not asked for."""
    try:
        yield
    except (LogTruncated, LogCorrupt) as error:
        if salvage or content not in _SALVAGED or error.reason not in ("truncated", "corrupt"):
            raise
        problem = f"{error.problem}; salvage=True (--salvage) reads what is whole"
        raise type(error)(error.source, error.reason, problem) from error


@contextmanager
def _readable(file: SteadyFile) -> Iterator[None]:
    """Errors while a file is read, as they are told: that it changed comes first."""
    try:
        yield
    except OSError as error:
        if isinstance(error, TrundleError):
            raise
        file.require_same()
        raise LogError(file.path, "unreadable", f"cannot be read: {error.strerror or error}") from error
    except LogError:
        file.require_same()
        raise


def _while_same(file: SteadyFile, log: WheelLog, *, salvage: bool) -> WheelLog:
    """The log, if what it was read from is still the same; with `salvage` that it is not is a loss."""
    if not salvage:
        file.require_same()
    elif difference := file.difference:
        loss = f"{difference}; what came later is lost"
        return dataclasses.replace(log, warnings=(loss, *log.warnings), losses=(loss, *log.losses))
    return log


def _read_table(path: Path, robot: Robot, mapping: LogMapping, salvage: bool) -> WheelLog:
    from trundle.adapters.table_log import read_table_log

    return read_table_log(path, robot, mapping, salvage=salvage)


def _read_bag(path: Path, robot: Robot, mapping: LogMapping, salvage: bool) -> WheelLog:
    from trundle.adapters.bag_log import read_bag_log

    return read_bag_log(path, robot, mapping, salvage=salvage)


def _read_wpilog(path: Path, robot: Robot, mapping: LogMapping, salvage: bool) -> WheelLog:
    from trundle.adapters.wpilog_log import read_wpilog_log

    return read_wpilog_log(path, robot, mapping, salvage=salvage)


def _read_tub(path: Path, robot: Robot, mapping: LogMapping, _salvage: bool) -> WheelLog:
    from trundle.adapters.tub_log import read_tub_log

    return read_tub_log(path, robot, mapping)


# Formats of which damaged files are read as far as they are whole.
_SALVAGED = (Content.TEXT, Content.JSON, Content.MCAP, Content.ROSBAG1, Content.ROSBAG2, Content.WPILOG)
# Formats that load nothing until they are read.
_CUTTERS: dict[Content, Cutter] = {
    Content.TEXT: _table_pieces,
    Content.PARQUET: _table_pieces,
    Content.JSON: _table_pieces,
    Content.MCAP: _bag_pieces,
    Content.ROSBAG1: _bag_pieces,
    Content.ROSBAG2: _bag_pieces,
}
_READERS: dict[Content, Reader] = {
    Content.TEXT: _read_table,
    Content.PARQUET: _read_table,
    Content.JSON: _read_table,
    Content.NPZ: _read_table,
    Content.MCAP: _read_bag,
    Content.ROSBAG1: _read_bag,
    Content.ROSBAG2: _read_bag,
    Content.WPILOG: _read_wpilog,
    Content.TUB: _read_tub,
}
