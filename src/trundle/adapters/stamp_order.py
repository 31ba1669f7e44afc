"""Rows of a log in the order of their stamps."""

from __future__ import annotations

import dataclasses

import numpy as np

from trundle.errors import LogError
from trundle.records import WheelLog

__all__ = ["MOST_LATE_NS", "in_order"]

MOST_LATE_NS = (
    1_000_000_000  # messages overtake each other by less; more is a clock that was set, or another run
)


def in_order(log: WheelLog, *, sort: bool = False) -> WheelLog:
    """A log whose stamps never go back; rows of one stamp stay as they were recorded.

    Args:
        log: Rows as they were recorded.
        sort: However late a row is; without it one second at most.

    Raises:
        LogError: `unsorted`, if a row is later than that.
    """
    latest = np.maximum.accumulate(log.time_ns)
    late = (latest - log.time_ns).view(np.uint64)  # as unsigned numbers these differences cannot overflow
    if not late.any():
        return log
    most = int(late.max())
    if most > MOST_LATE_NS and not sort:
        row = int((late > MOST_LATE_NS).argmax())
        stamp, late_by = _seconds(int(log.time_ns[row])), _seconds(int(late[row]))
        problem = (
            f"row {row} is stamped {stamp} s, {late_by} s before a row above it, must be at most"
            f" {_seconds(MOST_LATE_NS)} s. sort=True (--sort) puts all rows in order: right where rows were"
            " shuffled, wrong where the clock was set or one run follows another"
        )
        raise LogError(log.source, "unsorted", problem)
    count = int((late > 0).sum())
    rows = "1 row was" if count == 1 else f"{count} rows were"
    warning = f"{rows} not in the order of time, the worst {_seconds(most)} s late; they were put in order"
    order = np.argsort(log.time_ns, kind="stable")
    return dataclasses.replace(
        log,
        time_ns=log.time_ns[order],
        wheels=None if log.wheels is None else log.wheels[order],
        steering=None if log.steering is None else log.steering[order],
        yaw_rate=None if log.yaw_rate is None else log.yaw_rate[order],
        twists=None if log.twists is None else log.twists[order],
        warnings=(*log.warnings, warning),
    )


def _seconds(nanoseconds: int) -> str:
    whole, part = divmod(abs(nanoseconds), 1_000_000_000)
    digits = f"{part:09d}".rstrip("0")
    return f"{'-' if nanoseconds < 0 else ''}{whole}{'.' if digits else ''}{digits}"
