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
    table = np.empty((len(parts), count + 1))
    table[:, 0] = monitor.sums
    for row, part in zip(table, parts, strict=True):
        row[1:] = part
    sums = np.cumsum(table, axis=1)  # one after the other, so to the last digit what single steps add up to
    windows = (sums[0] * PER_METRE).astype(np.int64)
    windows[0] = monitor.window
    ends = np.flatnonzero(windows[1:] != windows[:-1]) + 1
    mark, last, alarm = monitor.mark, None, None
    if len(ends):
        moved = sums[:, ends]
        moved[:, 1:] -= sums[:, ends[:-1]]
        moved[:, 0] -= mark
        freedom = monitor.freedom(monitor.gyro)
        if freedom > 0:
            loud = np.flatnonzero(monitor.chi_square(list(moved), doubt, np) > threshold(freedom))
            alarm = int(ends[loud[0]]) - 1 if len(loud) else None
        mark, last = sums[:, ends[-1]].tolist(), moved[:, -1].tolist()
    return Scan(alarm, sums[:, -1].tolist(), mark, last)
