"""Trundle's own CSV log columns (DESIGN.md section 5), written."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.atomic import atomic_path
from trundle.adapters.decimal_text import decimal_lines, separated
from trundle.adapters.default_columns import REFERENCE, TWIST
from trundle.adapters.resampling import interpolated, turned
from trundle.errors import InputError, require_path, require_type
from trundle.records import Reading, Trajectory, WheelLog

__all__ = ["write_log"]

_SUFFIX = {
    Reading.POSITION: "position",
    Reading.INCREMENT: "position_delta",
    Reading.TICKS: "ticks",
    Reading.VELOCITY: "velocity",
}


def write_log(log: WheelLog, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a log as CSV that needs no mapping to be read: time, wheels, steering, gyro, twist, reference.

    Numbers have as many digits as it takes to read back the same. A reference with stamps of its own is put
    at those of the rows, between its neighbours; where it has none near, its cells are nan.

    Args:
        log: Wheel readings, body twists, or both.
        path: Where to; the old file or the complete new one, never a part.
        force: Replace a file that exists.

    Raises:
        InputError: If a wheel's name cannot be that of a column.
        OutputError: If the file exists or cannot be written.
    """
    require_type("write_log", "log", log, WheelLog)
    path = require_path(path)
    columns = _columns(log)
    with (
        atomic_path(path, force=force) as temporary,
        temporary.open("w", encoding="utf-8", newline="\n") as file,
    ):
        file.write(",".join(columns) + "\n")
        file.writelines(decimal_lines(separated(list(columns.values()), ",")))


def _columns(log: WheelLog) -> dict[str, npt.NDArray[Any]]:
    columns: dict[str, npt.NDArray[Any]] = {"time_ns": log.time_ns}
    if log.wheels is not None:
        for name, column in zip(log.wheel_names, log.wheels.T, strict=True):
            columns[f"{name}.{_SUFFIX[log.reading]}"] = column
    if log.steering is not None:
        for name, column in zip(log.steering_names, log.steering.T, strict=True):
            columns[f"{name}.steering"] = column
    if log.yaw_rate is not None:
        columns["gyro.yaw_rate"] = log.yaw_rate
    if log.twists is not None:
        columns |= dict(zip(TWIST, log.twists.T, strict=True))
    if log.reference is not None:
        columns |= dict(zip(REFERENCE, _at_rows(log.reference, log.time_ns), strict=True))
    unfit = [name for name in columns if set(name) & set(',"\n\r')]
    if unfit:
        raise InputError(f"log: {unfit[0]!r} cannot be the name of a CSV column")
    return columns


def _at_rows(reference: Trajectory, time_ns: npt.NDArray[np.int64]) -> list[npt.NDArray[Any]]:
    """x, y and heading of the reference at other stamps."""
    own, (x, y, theta) = reference.time_ns, reference.poses.T
    if np.array_equal(own, time_ns):
        return [x, y, theta]
    placed = [interpolated(time_ns, own, x), interpolated(time_ns, own, y), turned(time_ns, own, theta)]
    return [np.where(known, values, np.nan) for values, known in placed]
