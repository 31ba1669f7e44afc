"""Poses over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, shown
from trundle.geometry import Pose2D
from trundle.records.columns import column, counts, stamps

__all__ = ["Trajectory"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trajectory:
    """Stamped poses of one frame in another, with what is known of their errors.

    Attributes:
        time_ns: Stamps [ns], int64, shape (N,).
        poses: (x, y, theta) in [m, m, rad], shape (N, 3). Headings are not wrapped; a heading that
            was not measured (an overhead camera that sees a dot) is NaN.
        twists: Body twists (vx, vy, omega), shape (N, 3), or None.
        covariances: Covariance of the body-frame error e in `true = estimate @ exp(e)`, order
            (x, y, theta), shape (N, 3, 3), or None.
        frame: Frame that the poses are given in.
        child_frame: Frame whose poses they are.
        rejected: Samples that were refused on the way here, by reason.
        events: Things that happened on the way here (gaps, re-baselines, ...), by name.
        timed: Whether the stamps are times. Those of a file that has none (KITTI) only number its rows.
    """

    time_ns: npt.NDArray[np.int64]
    poses: Floats
    twists: Floats | None = None
    covariances: Floats | None = None
    frame: str = "odom"
    child_frame: str = "base_link"
    rejected: Mapping[str, int] = field(default_factory=dict)
    events: Mapping[str, int] = field(default_factory=dict)
    timed: bool = True

    def __post_init__(self) -> None:
        put: Any = object.__setattr__
        put(self, "time_ns", stamps("time_ns", self.time_ns))
        count = len(self.time_ns)
        put(self, "poses", column("poses", self.poses, (count, 3)))
        if self.twists is not None:
            put(self, "twists", column("twists", self.twists, (count, 3)))
        if self.covariances is not None:
            put(self, "covariances", column("covariances", self.covariances, (count, 3, 3)))
        put(self, "rejected", counts("rejected", self.rejected))
        put(self, "events", counts("events", self.events))

    def __repr__(self) -> str:
        parts = {
            "twists": self.twists,
            "covariances": self.covariances,
            f"{sum(self.rejected.values())} rejected": self.rejected or None,
        }
        said = "".join(f", {name}" for name, there in parts.items() if there is not None)
        poses = "1 pose" if len(self) == 1 else f"{len(self)} poses"
        frames = f"{self.child_frame} in {self.frame}"
        time = f"{self.duration:.6g} s" if self.timed else "no times"
        return f"<Trajectory of {poses}, {time}, {self.distance:.6g} m: {frames}{said}>"

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def duration(self) -> float:
        """Time from the first to the last pose [s]."""
        return float(self.time_ns[-1] - self.time_ns[0]) * 1e-9 if len(self) else 0.0

    @property
    def distance(self) -> float:
        """Length of the path, as the sum of its chords [m]."""
        steps = np.diff(self.poses[:, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    def take(self, chosen: npt.NDArray[Any]) -> Trajectory:
        """Some of the samples, by mask or index."""
        return replace(
            self,
            time_ns=self.time_ns[chosen],
            poses=self.poses[chosen],
            twists=None if self.twists is None else self.twists[chosen],
            covariances=None if self.covariances is None else self.covariances[chosen],
        )

    def pose(self, index: int) -> Pose2D:
        """One pose as a scalar value; negative indices count from the end.

        Raises:
            InputError: If there is no such pose.
        """
        if not isinstance(index, Integral) or not -len(self) <= index < len(self):
            raise InputError(f"pose {shown(index)}: must be a whole number, and there are {len(self)} poses")
        return Pose2D(*self.poses[index].tolist())
