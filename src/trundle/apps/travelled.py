"""What a trajectory amounts to, told while it passes by."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from trundle.records import Trajectory, WheelLog

__all__ = ["Travelled"]


@dataclass(slots=True)
class Travelled:
    """Sums over the pieces of a log and of its trajectory.

    Attributes:
        accepted: Poses.
        distance: Length of the path [m].
        first_ns: Stamp of the first pose.
        end: The last pose.
        rejected: Samples that were refused, by reason.
        events: What happened on the way, by name.
        warnings: What the reader noticed.
        losses: Those that say which part of the log is missing.
        gyro: Whether the log holds yaw rates.
    """

    accepted: int = 0
    distance: float = 0.0
    first_ns: int = 0
    end: Trajectory | None = None
    rejected: Counter[str] = field(default_factory=Counter)
    events: Counter[str] = field(default_factory=Counter)
    warnings: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    gyro: bool = False

    @property
    def duration(self) -> float:
        """Time from the first to the last pose [s]."""
        return 0.0 if self.end is None else (int(self.end.time_ns[-1]) - self.first_ns) * 1e-9

    def read(self, pieces: Iterable[WheelLog]) -> Iterator[WheelLog]:
        """Hand pieces of a log on, and keep what their reader noticed."""
        for log in pieces:
            self.warnings += log.warnings
            self.losses += log.losses
            self.gyro |= log.yaw_rate is not None
            yield log

    def travel(self, pieces: Iterable[Trajectory]) -> Iterator[Trajectory]:
        """Hand pieces of a trajectory on, and add them up."""
        for piece in pieces:
            self.rejected.update(piece.rejected)
            self.events.update(piece.events)
            if len(piece):
                self._add(piece)
            yield piece

    def _add(self, piece: Trajectory) -> None:
        start = piece.pose(0)
        if self.end is None:
            self.first_ns = int(piece.time_ns[0])
        else:
            end = self.end.pose(-1)
            self.distance += math.hypot(start.x - end.x, start.y - end.y)
        self.accepted += len(piece)
        self.distance += piece.distance
        covariances = piece.covariances
        self.end = dataclasses.replace(
            piece,
            time_ns=piece.time_ns[-1:].copy(),
            poses=piece.poses[-1:].copy(),
            twists=None,
            covariances=None if covariances is None else covariances[-1:].copy(),
        )
