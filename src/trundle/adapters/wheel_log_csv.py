"""Trundle's own CSV log columns (DESIGN.md section 5), written."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.atomic import atomic_path
from trundle.errors import InputError
from trundle.records import Reading, WheelLog

__all__ = ["write_log"]

_SUFFIX = {Reading.POSITION: "position", Reading.TICKS: "ticks", Reading.VELOCITY: "velocity"}


def write_log(log: WheelLog, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a log as CSV that needs no mapping to be read: `time_ns`, wheels, steering, gyro, reference.

    Numbers have as many digits as it takes to read back the same.

    Args:
        log: Wheel readings; the reference, if any, row by row with them.
        path: Where to; the old file or the complete new one, never a part.
        force: Replace a file that exists.

    Raises:
        InputError: If the log has no wheels, its wheels are increments, or its reference has stamps of
            its own: these columns cannot say that.
        OutputError: If the file exists or cannot be written.
    """
    columns = _columns(log)
    text = [",".join(columns)]
    text += [",".join(row) for row in zip(*map(_texts, columns.values()), strict=True)]
    with atomic_path(path, force=force) as temporary:
        temporary.write_text("\n".join(text) + "\n", encoding="utf-8", newline="\n")


def _columns(log: WheelLog) -> dict[str, npt.NDArray[Any]]:
    if log.wheels is None or log.reading not in _SUFFIX:
        what = "body twists alone" if log.wheels is None else f"{log.reading.value}s in rad"
        raise InputError(f"log: {what} have no columns, must be wheel {', '.join(_SUFFIX.values())}")
    columns: dict[str, npt.NDArray[Any]] = {"time_ns": log.time_ns}
    for name, column in zip(log.wheel_names, log.wheels.T, strict=True):
        columns[f"{name}.{_SUFFIX[log.reading]}"] = column
    if log.steering is not None:
        for name, column in zip(log.steering_names, log.steering.T, strict=True):
            columns[f"{name}.steering"] = column
    if log.yaw_rate is not None:
        columns["gyro.yaw_rate"] = log.yaw_rate
    if log.reference is not None:
        if not np.array_equal(log.reference.time_ns, log.time_ns):
            raise InputError(
                "log.reference: has stamps of its own, must have those of the wheels to share their rows"
            )
        for name, column in zip(["x", "y", "theta"], log.reference.poses.T, strict=True):
            columns[f"reference.{name}"] = column
    unfit = [name for name in columns if set(name) & set(',"\n\r')]
    if unfit:
        raise InputError(f"log: {unfit[0]!r} cannot be the name of a CSV column")
    return columns


def _texts(column: npt.NDArray[Any]) -> Sequence[str]:
    """Shortest decimals that read back the same."""
    return [repr(value) for value in column.tolist()]
