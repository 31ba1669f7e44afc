"""Whether a reference turns left where the wheels turn right."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from trundle.calibrate.fixes import Fixes

__all__ = ["mirrored"]

Floats = npt.NDArray[np.float64]

_ALIKE = 0.5
"""Correlation from which on both turn alike, or opposite."""
_CHANCE = 3.0
"""Standard deviations of what chance makes of it."""
_FEWEST = 6  # fixes that say anything


def mirrored(path: Floats, fixes: Fixes) -> bool:
    """Whether the fixes turn left where the path turns right: x and y swapped, or one reversed.

    The shortest ways over which both turn alike, or opposite, decide: over these even wrong numbers have not
    gone far, and no frame is needed.

    Args:
        path: Poses by the wheels, at the fixes.
        fixes: What was measured.
    """
    if len(fixes) < _FEWEST:
        return False
    return _opposite(_bends(path, fixes)) or _opposite(_turns(path, fixes))


def _opposite(turns: Iterator[tuple[int, Floats, Floats]]) -> bool:
    """Of what path and fixes turned over one way after another, and how many of these overlap."""
    for overlapping, went, saw in turns:
        squares, size = went * went, math.sqrt(float(went @ went) * float(saw @ saw))
        if size > 0.0:
            alike = float(went @ saw) / size
            independent = float(squares.sum() ** 2 / (squares @ squares)) / overlapping
            if abs(alike) > max(_ALIKE, _CHANCE / math.sqrt(independent)):
                return alike < 0.0
    return False


def _bends(path: Floats, fixes: Fixes) -> Iterator[tuple[int, Floats, Floats]]:
    """How the way bends from fix to fix, as large as the path makes it."""
    seen = np.isfinite(fixes.poses[:, :2]).all(axis=1)
    for apart in _spans(int(seen.sum())):
        went, wide = _bend(path[seen, :2], apart)
        saw, far = _bend(fixes.poses[seen, :2], apart)
        yield 2 * apart, went, wide * saw / np.maximum(far, 1e-300)


def _bend(points: Floats, apart: int) -> tuple[Floats, Floats]:
    """Of one step and the next: their cross product, and the product of their lengths."""
    steps = points[apart:] - points[:-apart]
    before, after = steps[:-apart].T, steps[apart:].T
    return before[0] * after[1] - before[1] * after[0], np.hypot(*before) * np.hypot(*after)


def _turns(path: Floats, fixes: Fixes) -> Iterator[tuple[int, Floats, Floats]]:
    """How headings change from fix to fix."""
    seen = np.isfinite(fixes.poses[:, 2])
    for apart in _spans(int(seen.sum())):
        went, saw = (
            np.sin(poses[apart:] - poses[:-apart]) for poses in (path[seen, 2], fixes.poses[seen, 2])
        )
        yield apart, went, saw


def _spans(count: int) -> Iterator[int]:
    apart = 1
    while apart <= count // _FEWEST:
        yield apart
        apart *= 2
