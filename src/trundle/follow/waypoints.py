"""Smooth curves through points, such as recorded ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import PathError
from trundle.follow.spline import Spline

__all__ = ["spline_through"]

Floats = npt.NDArray[np.float64]


def spline_through(points: Sequence[Sequence[float]] | Floats, *, spacing: float = 1e-6) -> Spline:
    """The cubic Hermite spline through points, in their order; it may cross itself.

    Its direction at a point is that of the parabola through the point and its neighbours, with distances
    between points for the parameter.

    Args:
        points: (x, y) [m], shape (N, 2). Further columns are not looked at.
        spacing: Points nearer than this to the last one that counts are left out [m]: the same point
            twice, a robot that stood still while it was recorded.

    Raises:
        PathError: If fewer than two points are left, a number is not finite, or the points turn back by
            more than a right angle.
    """
    distinct, indices = _thinned(_table(points), spacing)
    steps = np.diff(distinct, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    chords = steps / lengths[:, None]
    back = (chords[1:] * chords[:-1]).sum(axis=1) < -1e-9
    if back.any():
        k = int(np.argmax(back)) + 1
        raise PathError(
            f"points: the path turns back by more than 90 degrees at point {indices[k]}, "
            f"({distinct[k, 0]:g}, {distinct[k, 1]:g}); give `spacing` to leave jitter out, or end the path "
            "there and go on backwards"
        )
    tangents = _tangents(chords, lengths)
    p0, p1 = distinct[:-1], distinct[1:]
    d0, d1 = lengths[:, None] * tangents[:-1], lengths[:, None] * tangents[1:]
    rise = p1 - p0
    return Spline(np.stack([p0, d0, 3.0 * rise - 2.0 * d0 - d1, d0 + d1 - 2.0 * rise], axis=-1))


def _table(points: Any) -> Floats:
    try:
        table = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise PathError("points: must be numbers, (x, y) each") from None
    if not table.size:
        raise PathError("points: none given; a path needs two or more")
    if table.ndim != 2 or table.shape[1] < 2:
        raise PathError(f"points: shape {table.shape}, must be (N, 2): (x, y) each")
    table = table[:, :2]
    if not np.isfinite(table).all():
        k = int(np.argmin(np.isfinite(table).all(axis=1)))
        raise PathError(f"points: point {k} is {tuple(table[k].tolist())}, must be finite")
    return table


def _thinned(table: Floats, spacing: float) -> tuple[Floats, Sequence[int]]:
    """Points that are `spacing` or more away from the one kept before them, and which ones they are."""
    if not spacing > 0.0:
        raise PathError(f"spacing: {spacing!r} m, must be > 0")
    kept = np.arange(len(table))
    steps = np.diff(table, axis=0)
    if (np.hypot(steps[:, 0], steps[:, 1]) < spacing).any():
        kept = np.array(_spaced(table.tolist(), spacing))
    if len(kept) < 2:
        raise PathError(f"points: {len(table)} given, {len(kept)} of them apart; a path needs two or more")
    return table[kept], kept.tolist()


def _spaced(points: list[list[float]], spacing: float) -> list[int]:
    kept = [0]
    (x, y), square = points[0], spacing * spacing
    for k, (to_x, to_y) in enumerate(points):
        if (to_x - x) ** 2 + (to_y - y) ** 2 >= square:
            kept.append(k)
            x, y = to_x, to_y
    return kept


def _tangents(chords: Floats, lengths: Floats) -> Floats:
    """Unit tangents at all points, from the unit chords between them."""
    if len(chords) == 1:
        return np.concatenate([chords, chords])
    before, after = lengths[:-1, None], lengths[1:, None]
    inner = after * chords[:-1] + before * chords[1:]
    inner /= np.hypot(inner[:, 0], inner[:, 1])[:, None]
    # A parabola's chord has the mean of the slopes at its ends.
    outer = 2.0 * chords[[0, -1]] - inner[[0, -1]]
    outer /= np.hypot(outer[:, 0], outer[:, 1])[:, None]
    return np.concatenate([outer[:1], inner, outer[1:]])
