"""Rows of logs and trajectories in the order of their stamps."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import LogError
from trundle.records import Trajectory, WheelLog

__all__ = ["MOST_LATE_NS", "in_order", "pieces_in_order", "poses_in_order"]

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
    ordered, count, most = _ordered(log, sort=sort)
    return dataclasses.replace(ordered, warnings=(*log.warnings, *_warning(count, most)))


def pieces_in_order(pieces: Iterable[WheelLog]) -> Iterator[WheelLog]:
    """What `in_order` makes of the pieces put together, in pieces: the last second waits for late rows.

    Raises:
        LogError: `unsorted`, as `in_order`; its row counts from the piece's beginning.
    """
    waiting: WheelLog | None = None
    total, worst = 0, 0
    for piece in pieces:
        log, count, most = _ordered(piece if waiting is None else _joined(waiting, piece))
        total, worst = total + count, max(worst, most)
        settled = 0
        if len(log):
            border = max(int(log.time_ns[-1]) - MOST_LATE_NS, np.iinfo(np.int64).min)
            settled = int(np.searchsorted(log.time_ns, np.int64(border), side="right"))
        yield _with_rows(log, itemgetter(slice(settled)))
        waiting = _with_rows(log, itemgetter(slice(settled, None)))
        waiting = dataclasses.replace(waiting, rejected={}, warnings=(), losses=(), reference=None)
    if waiting is not None:
        yield dataclasses.replace(waiting, warnings=_warning(total, worst))


def poses_in_order(source: object, trajectory: Trajectory) -> Trajectory:
    """A trajectory whose stamps rise: late rows are put in order, those that repeat a stamp are left out.

    Args:
        source: The file, for errors.
        trajectory: Rows as they were recorded.

    Returns:
        `events` counts those that were `reordered`; `rejected` those that were left out, as `duplicate`, or
        `duplicate_conflict` where the pose is another than the one above.

    Raises:
        LogError: `unsorted`, if a row is more than a second late.
    """
    late = _lateness(trajectory.time_ns)
    if late.any():
        remedy = "the clock was set, or one run follows another: put each into a file of its own"
        _refuse_late(source, trajectory.time_ns, late, remedy)
        trajectory = trajectory.take(np.argsort(trajectory.time_ns, kind="stable"))
    again = np.diff(trajectory.time_ns) == 0
    same = again & ((trajectory.poses[1:] == trajectory.poses[:-1]) | np.isnan(trajectory.poses[1:])).all(
        axis=1
    )
    refused = Counter(duplicate=int(same.sum()), duplicate_conflict=int((again & ~same).sum()))
    if again.any():
        trajectory = trajectory.take(np.append(True, ~again))
    return dataclasses.replace(
        trajectory,
        rejected=Counter(trajectory.rejected) + refused,
        events=Counter(trajectory.events) + Counter(reordered=int((late > 0).sum())),
    )


def _ordered(log: WheelLog, *, sort: bool = False) -> tuple[WheelLog, int, int]:
    """The log in order, how many rows were not, and how late the worst of them was [ns]."""
    late = _lateness(log.time_ns)
    if not late.any():
        return log, 0, 0
    if not sort:
        remedy = (
            "sort=True (--sort) puts all rows in order: right where rows were shuffled, wrong where the clock"
            " was set or one run follows another"
        )
        _refuse_late(log.source, log.time_ns, late, remedy)
    order = np.argsort(log.time_ns, kind="stable")
    return _with_rows(log, lambda column: column[order]), int((late > 0).sum()), int(late.max())


def _lateness(time_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.uint64]:
    """How long before the latest row above it each row is stamped [ns]; as unsigned numbers, no overflow."""
    return (np.maximum.accumulate(time_ns) - time_ns).view(np.uint64)


def _refuse_late(
    source: object, time_ns: npt.NDArray[np.int64], late: npt.NDArray[np.uint64], remedy: str
) -> None:
    if not (late > MOST_LATE_NS).any():
        return
    row = int((late > MOST_LATE_NS).argmax())
    stamp, late_by = _seconds(int(time_ns[row])), _seconds(int(late[row]))
    problem = (
        f"row {row} is stamped {stamp} s, {late_by} s before a row above it, must be at most"
        f" {_seconds(MOST_LATE_NS)} s. {remedy}"
    )
    raise LogError(source, "unsorted", problem)


def _warning(count: int, most: int) -> tuple[str, ...]:
    if not count:
        return ()
    rows = "1 row was" if count == 1 else f"{count} rows were"
    return (f"{rows} not in the order of time, the worst {_seconds(most)} s late; they were put in order",)


def _joined(one: WheelLog, other: WheelLog) -> WheelLog:
    """The rows of both, and what else the other says."""
    former = iter([one.time_ns, one.wheels, one.steering, one.yaw_rate, one.twists])
    return _with_rows(
        other, lambda column: np.concatenate([next(f for f in former if f is not None), column])
    )


def _with_rows(log: WheelLog, change: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> WheelLog:
    """The log with other rows, the same in every column."""
    return dataclasses.replace(
        log,
        time_ns=change(log.time_ns),
        wheels=None if log.wheels is None else change(log.wheels),
        steering=None if log.steering is None else change(log.steering),
        yaw_rate=None if log.yaw_rate is None else change(log.yaw_rate),
        twists=None if log.twists is None else change(log.twists),
    )


def _seconds(nanoseconds: int) -> str:
    whole, part = divmod(abs(nanoseconds), 1_000_000_000)
    digits = f"{part:09d}".rstrip("0")
    return f"{'-' if nanoseconds < 0 else ''}{whole}{'.' if digits else ''}{digits}"
