"""Logs of any format, by their content."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from trundle.adapters.content import Content, content_of
from trundle.records import WheelLog
from trundle.robot import Kinematics, LogMapping, Robot

__all__ = ["read_log"]

Reader = Callable[[Path, Robot, LogMapping, bool], WheelLog]


def read_log(
    path: str | os.PathLike[str],
    robot: Robot | Kinematics,
    *,
    mapping: LogMapping | None = None,
    salvage: bool = False,
) -> WheelLog:
    """What the sensors of a robot said, from a log of any known format.

    Args:
        path: A text table, Parquet, MCAP, a rosbag, a rosbag2 folder, or a donkeycar tub;
            told apart by content.
        robot: Whose log it is; or just its drive.
        mapping: How the log says it, in place of the robot's own `log` section.
        salvage: Of a damaged recording, read what can be read; `warnings` say what could not.

    Returns:
        Readings of the robot's measured wheels, or its body twists, in SI units or raw counts; rows as
        they were recorded, except those that could not be read, which are counted in `rejected`.

    Raises:
        LogError: If the file cannot be read; its `reason` says why: `not_a_file`, `empty`, `format`,
            `encoding`, `unreadable`. LogTruncated, LogCorrupt and LogLimit for damaged recordings.
        LogSchema: If it does not hold what the mapping says: `column`, `topic`, `field`, `ambiguous`,
            `parse`, `unit`, `type`.
        ConfigError: If the mapping does not fit the robot.
        MissingExtra: If the format needs a package that is not installed.
    """
    path = Path(path)
    described = robot if isinstance(robot, Robot) else Robot(drive=robot)
    content = content_of(path)
    # NaN and infinity go through units and mountings as they are: odometry judges them.
    with np.errstate(over="ignore", invalid="ignore"):
        log = _READERS[content](path, described, mapping or described.log, salvage)
    if described.measuring.gyro and log.wheels is not None and log.yaw_rate is None:
        silent = "the robot measures with a gyro, but its log has none (log.gyro)"
        log = dataclasses.replace(log, warnings=(*log.warnings, silent))
    return log


def _read_table(path: Path, robot: Robot, mapping: LogMapping, _salvage: bool) -> WheelLog:
    from trundle.adapters.table_log import read_table_log

    return read_table_log(path, robot, mapping)


def _read_bag(path: Path, robot: Robot, mapping: LogMapping, salvage: bool) -> WheelLog:
    from trundle.adapters.bag_log import read_bag_log

    return read_bag_log(path, robot, mapping, salvage=salvage)


def _read_wpilog(path: Path, robot: Robot, mapping: LogMapping, salvage: bool) -> WheelLog:
    from trundle.adapters.wpilog_log import read_wpilog_log

    return read_wpilog_log(path, robot, mapping, salvage=salvage)


def _read_tub(path: Path, robot: Robot, mapping: LogMapping, _salvage: bool) -> WheelLog:
    from trundle.adapters.tub_log import read_tub_log

    return read_tub_log(path, robot, mapping)


# Formats that load nothing until they are read.
_READERS: dict[Content, Reader] = {
    Content.TEXT: _read_table,
    Content.PARQUET: _read_table,
    Content.MCAP: _read_bag,
    Content.ROSBAG1: _read_bag,
    Content.ROSBAG2: _read_bag,
    Content.WPILOG: _read_wpilog,
    Content.TUB: _read_tub,
}
