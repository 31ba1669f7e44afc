"""The frame in which a path began: where to lay a predicted path so that it meets its fixes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trundle.calibrate.fixes import Fixes
from trundle.geometry import se2

__all__ = ["first_frame", "residuals"]

Floats = npt.NDArray[np.float64]

_TRIALS = 300


def residuals(frames: Floats, tracked: Floats, fixes: Fixes) -> Floats:
    """Predicted minus measured components, shape (N, 3); zero where nothing was measured.

    Args:
        frames: Shape (N, 3), or one frame for all, shape (3,).
        tracked: What the wheels predict of the tracked point, shape (N, 3).
        fixes: What was measured.
    """
    poses = se2.compose(np.broadcast_to(frames, tracked.shape), tracked)
    found = poses - fixes.poses
    if not fixes.whole_turns:
        found[:, 2] = np.remainder(found[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return np.where(np.isfinite(fixes.poses), found, 0.0)


def first_frame(tracked: Floats, fixes: Fixes) -> Floats:
    """The one frame that lays half of the fixes nearest: least median of squares.

    Candidates lay one fix exactly, or two; they are drawn the same way every time.

    Source:
        Rousseeuw 1984, "Least median of squares regression".
    """
    if not fixes.positions:
        off = residuals(np.zeros(3), tracked, fixes)[:, 2]
        return np.array([0.0, 0.0, -float(np.median(off[np.isfinite(fixes.poses[:, 2])]))])
    if fixes.headings and not fixes.whole_turns and len(fixes) > 2:
        candidates = _by_one(tracked, fixes)
    elif len(fixes) > 2:
        candidates = _by_two(tracked, fixes.poses)
    else:
        measured = np.nan_to_num(fixes.poses[:1])
        candidates = se2.compose(measured, se2.inverse(tracked[:1]))
    scores = [np.median(np.hypot(*residuals(frame, tracked, fixes)[:, :2].T)) for frame in candidates]
    nearest: Floats = candidates[int(np.argmin(scores))]
    return nearest


def _by_one(tracked: Floats, fixes: Fixes) -> Floats:
    whole = np.flatnonzero(np.isfinite(fixes.poses).all(axis=1))
    chosen = whole[np.linspace(0, len(whole) - 1, min(len(whole), _TRIALS)).astype(int)]
    frames: Floats = se2.compose(fixes.poses[chosen], se2.inverse(tracked[chosen]))
    return frames


def _by_two(tracked: Floats, measured: Floats) -> Floats:
    """Frames that lay one position exactly, and another in its direction."""
    seen = np.flatnonzero(np.isfinite(measured[:, 0]))
    draw = np.random.default_rng(0)
    first, second = draw.choice(seen, _TRIALS), draw.choice(seen, _TRIALS)
    went, saw = (points[second, :2] - points[first, :2] for points in (tracked, measured))
    turn = np.arctan2(saw[:, 1], saw[:, 0]) - np.arctan2(went[:, 1], went[:, 0])
    rotation = np.stack([0.0 * turn, 0.0 * turn, turn], axis=-1)
    laid = se2.compose(rotation, tracked[first])
    return np.stack([*(measured[first, :2] - laid[:, :2]).T, turn], axis=-1)
