"""The array twin of the slip monitor: many steps at once, and the first whose wheels do not agree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.odometry.slip import PER_METRE, SlipMonitor, threshold

__all__ = ["Scan", "scan_for_slip"]

Floats = npt.NDArray[Any]


class Scan(NamedTuple):
    """What the monitor makes of a block of steps.

    Attributes:
        alarm: The first step at which a window does not add up, or None.
        sums: `SlipMonitor.sums` after the last step.
        mark: Where its present window began.
        moved: What its last window added; None where none ended.
    """

    alarm: int | None
    sums: list[float]
    mark: list[float]
    moved: list[float] | None

    def hand_over(self, monitor: SlipMonitor) -> None:
        """Leave the monitor as the steps, one by one, would have left it."""
        monitor.sums, monitor.mark = self.sums, self.mark
        monitor.window = int(self.sums[0] * PER_METRE)
        if self.moved is not None:
            monitor.moved, monitor.slipping, monitor.streak = self.moved, (), 0


def scan_for_slip(monitor: SlipMonitor, parts: Sequence[Any], count: int, doubt: float) -> Scan:
    """Judge every window that ends among these steps.

    Args:
        monitor: As the step before the first left it, its `gyro` as in these steps.
        parts: `monitor.parts` of the steps, arrays or constants.
        count: How many steps.
        doubt: How far the gyro's bias may be off [rad/s].
    """
    table = np.empty((len(parts), count))
    for row, part in zip(table, parts, strict=True):
        row[:] = part
    # Where windows end is found one step after the other: to the last digit what single steps add up to.
    way = np.cumsum(np.concatenate([monitor.sums[:1], table[0]]))
    windows = (way * PER_METRE).astype(np.int64)
    windows[0] = monitor.window
    ends = np.flatnonzero(windows[1:] != windows[:-1]) + 1
    starts = np.concatenate([[0], ends[ends < count]])
    each = np.add.reduceat(table, starts, axis=1)
    moved, rest = each[:, : len(ends)], each[:, len(ends) :].sum(axis=1)
    mark, last, alarm = monitor.mark, None, None
    sums = np.array(monitor.sums)
    if len(ends):
        begun = sums - mark
        sums += moved.sum(axis=1)
        sums[0] = way[ends[-1]]
        mark = sums.tolist()
        moved[:, 0] += begun
        last = moved[:, -1].tolist()
        freedom = monitor.freedom(monitor.gyro)
        if freedom > 0:
            loud = np.flatnonzero(monitor.chi_square(list(moved), doubt, np) > threshold(freedom))
            alarm = int(ends[loud[0]]) - 1 if len(loud) else None
    sums += rest
    sums[0] = way[-1]
    return Scan(alarm, sums.tolist(), mark, last)
