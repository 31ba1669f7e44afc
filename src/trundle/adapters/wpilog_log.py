"""Wheel logs from WPILOG data logs."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from trundle.adapters.bag_log import recording_log
from trundle.adapters.reference import jumps
from trundle.adapters.wpilog import open_wpilog
from trundle.records import WheelLog
from trundle.robot import Robot
from trundle.robot.log_mapping import LogMapping

__all__ = ["read_wpilog_log"]


def read_wpilog_log(path: Path, robot: Robot, mapping: LogMapping, *, salvage: bool = False) -> WheelLog:
    """A data log as a wheel log.

    Where the reference jumps, the robot was put elsewhere or its simulation was reset: `events` of the
    reference counts it as `jump`, and a warning says when. Wheels do not see that, so the log is one before
    and another one after.

    Args:
        path: A WPILOG.
        robot: Whose wheels it holds.
        mapping: Which entries hold them.
        salvage: Read what can be read of a damaged log; `warnings` then say what could not.

    Raises:
        LogSchema: If an entry or field does not exist, or cannot be in its unit.
        LogError: If the log cannot be read.
        ConfigError: If the mapping does not fit the robot, or is one of columns.
    """
    with open_wpilog(path, salvage=salvage) as recording:
        log = recording_log(recording, robot, mapping)
    if log.reference is None:
        return log
    at = jumps(log.reference)
    if not len(at):
        return log
    when = ", ".join(f"{stamp * 1e-9:.3f} s" for stamp in at[:5].tolist()) + (", ..." if len(at) > 5 else "")
    warning = f"the reference jumps at {when}: compare piece by piece"
    reference = dataclasses.replace(log.reference, events={**log.reference.events, "jump": len(at)})
    return dataclasses.replace(log, reference=reference, warnings=(*log.warnings, warning))
