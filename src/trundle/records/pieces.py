"""Trajectories cut into pieces."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trundle.records.trajectory import Trajectory

__all__ = ["pieces"]


def pieces(trajectory: Trajectory, at: Sequence[int] | npt.NDArray[np.int64]) -> list[Trajectory]:
    """A trajectory, cut.

    Args:
        trajectory: What is cut, in order of time. What it says of itself as a whole, in `rejected` and
            `events`, stays with the whole.
        at: Stamps at which new pieces begin [ns], in order.

    Returns:
        One piece more than there are cuts; a piece may be empty.
    """
    cuts = np.searchsorted(trajectory.time_ns, np.asarray(at, np.int64)).tolist()
    parts = [slice(first, stop) for first, stop in zip([0, *cuts], [*cuts, len(trajectory)], strict=True)]
    return [
        dataclasses.replace(
            trajectory,
            time_ns=trajectory.time_ns[part],
            poses=trajectory.poses[part],
            twists=None if trajectory.twists is None else trajectory.twists[part],
            covariances=None if trajectory.covariances is None else trajectory.covariances[part],
            rejected={},
            events={},
        )
        for part in parts
    ]
