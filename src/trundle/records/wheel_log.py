"""What the sensors of a robot said, as columns."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, require_choice, require_type
from trundle.records.columns import column, counts, names, stamps
from trundle.records.trajectory import Trajectory

__all__ = ["Reading", "WheelLog"]

Floats = npt.NDArray[np.float64]


class Reading(enum.Enum):
    """What a wheel column says."""

    POSITION = "position"
    """Cumulative angle [rad], forward positive."""
    INCREMENT = "increment"
    """Angle since the previous row [rad], forward positive."""
    VELOCITY = "velocity"
    """Speed at the stamp [rad/s], forward positive."""
    TICKS = "ticks"
    """Raw counter value, int64: wraps and inversion are still in it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class WheelLog:
    """Wheel readings over time, and what else the same robot measured.

    A log states wheels, or body twists (a robot that publishes only its own odometry), or both.
    Rows are as they were recorded, hostile ones included: odometry decides what to accept.

    Attributes:
        time_ns: Stamps [ns], int64, shape (N,).
        wheel_names: Names of the wheel columns.
        wheels: Readings, shape (N, wheels); int64 for TICKS, else float64.
        reading: What the wheel columns say.
        steering_names: Names of the steered wheels whose angles were measured.
        steering: Steering angles [rad], left positive, shape (N, steered).
        yaw_rate: Gyro yaw rate [rad/s], shape (N,), or None.
        twists: Body twists (vx, vy, omega) [m/s, m/s, rad/s], shape (N, 3), or None.
        reference: Where the robot really was, on its own stamps, or None.
        rejected: Rows that could not even be read, by reason.
        warnings: What the reader noticed and a person should know, as sentences.
        losses: Those of the warnings that say which part of a damaged recording is missing.
        source: File that it came from.
    """

    time_ns: npt.NDArray[np.int64]
    wheel_names: tuple[str, ...] = ()
    wheels: npt.NDArray[Any] | None = None
    reading: Reading = Reading.POSITION
    steering_names: tuple[str, ...] = ()
    steering: Floats | None = None
    yaw_rate: Floats | None = None
    twists: Floats | None = None
    reference: Trajectory | None = None
    rejected: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    source: str = ""

    def __post_init__(self) -> None:
        put: Any = object.__setattr__
        put(self, "time_ns", stamps("time_ns", self.time_ns))
        count = len(self.time_ns)
        put(self, "reading", require_choice("reading", self.reading, Reading))
        for texts in ("wheel_names", "steering_names", "warnings", "losses"):
            put(self, texts, names(texts, getattr(self, texts)))
        if self.reference is not None:
            require_type("WheelLog", "reference", self.reference, Trajectory)
        if self.wheels is None and self.twists is None:
            raise InputError("a WheelLog needs wheels, or twists")
        if self.wheels is not None:
            dtype = np.int64 if self.reading is Reading.TICKS else np.float64
            shape = (count, len(self.wheel_names))
            put(self, "wheels", column("wheels", self.wheels, shape, dtype))
        if self.steering is not None:
            shape = (count, len(self.steering_names))
            put(self, "steering", column("steering", self.steering, shape))
        if self.yaw_rate is not None:
            put(self, "yaw_rate", column("yaw_rate", self.yaw_rate, (count,)))
        if self.twists is not None:
            put(self, "twists", column("twists", self.twists, (count, 3)))
        put(self, "rejected", counts("rejected", self.rejected))

    def __repr__(self) -> str:
        wheels = f"{self.reading.value} of {', '.join(self.wheel_names)}" if self.wheels is not None else ""
        parts = {
            "steering": self.steering,
            "yaw_rate": self.yaw_rate,
            "twists": self.twists,
            "reference": self.reference,
            f"{sum(self.rejected.values())} rejected": self.rejected or None,
            f"{len(self.warnings)} warned of": self.warnings or None,
        }
        said = "; ".join(
            filter(None, (wheels, *(name for name, there in parts.items() if there is not None)))
        )
        return f"<WheelLog of {len(self)} rows, {self.duration:.6g} s: {said}>"

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def duration(self) -> float:
        """Time from the first to the last row [s]."""
        return float(self.time_ns[-1] - self.time_ns[0]) * 1e-9 if len(self) else 0.0
