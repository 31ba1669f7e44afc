"""Where a reference jumps: tracking that was lost and found again elsewhere."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trundle.calibrate.fixes import Fixes

__all__ = ["joined"]

Floats = npt.NDArray[np.float64]

_BESIDE = 4
"""Fixes that must agree on either side: an outlier is one fix, a jump is all that follow."""
_LEAST = 0.1  # m
_TIMES = 8.0
_SHARE = 0.3
"""Of the way driven, what even bad numbers do not make of it."""


def joined(path: Floats, fixes: Fixes, believed: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Whether each fix continues the one before it, shape (N - 1,).

    The distance between two fixes is compared with that between two places of the path: it depends neither
    on the frame nor on the mounting's angle.

    Args:
        path: Poses by the wheels, at the fixes.
        fixes: What was measured.
        believed: Which of them are no outliers, shape (N,); only these are looked at.
    """
    together = np.ones(max(len(fixes) - 1, 0), dtype=bool)
    seen = np.flatnonzero(believed & np.isfinite(fixes.poses[:, 0]))
    if len(seen) < 4 * _BESIDE:
        return together
    went, saw = path[seen, :2], fixes.poses[seen, :2]
    off, way = _median_across(went, saw)
    usual = float(np.median(off))
    wrong = off > np.maximum(_LEAST, _TIMES * usual) + _SHARE * way
    for first, last in _stretches(wrong):
        worst = first + int(np.argmax(off[first:last]))
        together[seen[worst + _BESIDE] - 1] = False
    return together


def _median_across(went: Floats, saw: Floats) -> tuple[Floats, Floats]:
    """How far distances across each interval disagree, and how far the path went across it."""
    count = len(went) - 2 * _BESIDE + 1
    pairs = [(i, j) for i in range(_BESIDE) for j in range(_BESIDE, 2 * _BESIDE)]

    def across(points: Floats) -> Floats:
        return np.stack(
            [np.hypot(*(points[j : j + count] - points[i : i + count]).T) for i, j in pairs], axis=-1
        )

    driven = across(went)
    off = np.median(np.abs(across(saw) - driven), axis=-1)
    return off, np.median(driven, axis=-1)


def _stretches(wrong: npt.NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]]).astype(int)))
    return [(int(first), int(last)) for first, last in zip(edges[::2], edges[1::2], strict=True)]
