"""Which fixes their neighbours vouch for: a first look for wrong ones, before any number is right."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trundle.calibrate.fixes import Fixes

__all__ = ["vouched"]

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

_NEIGHBOURS = 8  # on either side
_ENOUGH = (0.3, 0.5)
"""Share of the neighbours that must agree with a fix: where nearly half are wrong, and among what is left."""
_LEAST = (0.03, 0.1)  # m, rad
_USUAL, _TIMES = 0.2, 12.0
"""What the better fixes disagree by, and how many times that is too much."""
_SHARE = 0.3
"""Of the way driven, what even bad numbers do not make of it."""


def vouched(path: Floats, fixes: Fixes) -> Flags:
    """Whether enough of a fix's neighbours stand as far from it as the wheels say, shape (N,).

    Distances and turns between two fixes are compared with those between two poses of the path: they
    depend neither on the frame nor on the mounting's angle.

    Args:
        path: Poses by the wheels, at the fixes.
        fixes: What was measured.
    """
    found = np.ones(len(fixes), dtype=bool)
    for enough in _ENOUGH:
        for columns, least in ((slice(0, 2), _LEAST[0]), (slice(2, 3), _LEAST[1])):
            seen = np.flatnonzero(found & np.isfinite(fixes.poses[:, columns]).all(axis=1))
            if len(seen) > 2 * _NEIGHBOURS:
                went, off = _compared(path[seen, columns], fixes.poses[seen, columns])
                found[seen] = _agreed(went, off, enough, least)
    return found


def _compared(went: Floats, saw: Floats) -> tuple[Floats, Floats]:
    """What lies between neighbours by the wheels, and by how much the fixes differ from it."""
    if went.shape[1] == 2:
        expected = _distances(went)
        return expected, _distances(saw) - expected
    turned = _differences(went[:, 0])
    return turned, np.remainder(_differences(saw[:, 0]) - turned + np.pi, 2.0 * np.pi) - np.pi


def _agreed(expected: Floats, off: Floats, enough: float, least: float) -> Flags:
    """Whether enough neighbours are as expected, shape (N,), of both shape (N, neighbours)."""
    excess = np.sort(np.maximum(np.abs(off) - _SHARE * np.abs(expected), 0.0), axis=1)  # NaN comes last
    neighbours = np.isfinite(excess).sum(axis=1)
    asked = (enough * (neighbours - 1)).astype(int)
    score = np.take_along_axis(excess, asked[:, np.newaxis], axis=1)[:, 0]
    agreed: Flags = score <= max(least, _TIMES * float(np.quantile(score, _USUAL)))
    return agreed


def _distances(points: Floats) -> Floats:
    """To each neighbour, shape (N, neighbours); NaN where there is none."""
    found: Floats = np.hypot(_differences(points[:, 0]), _differences(points[:, 1]))
    return found


def _differences(values: Floats) -> Floats:
    count = len(values)
    found = np.full((count, 2 * _NEIGHBOURS), np.nan)
    for k in range(1, _NEIGHBOURS + 1):
        change = values[k:] - values[:-k]
        found[: count - k, 2 * k - 2] = change
        found[k:, 2 * k - 1] = change
    return found
