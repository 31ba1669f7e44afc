"""What a gyro shows while the robot stands still: its bias, and nothing that turns the robot."""

from __future__ import annotations

import math
from collections.abc import Sequence

__all__ = ["Standstill"]

AFTER = 1.0
"""Wheels that have not moved for so long [s] stand still."""
MEMORY = 60.0
"""Standstill that the bias is averaged over [s]; biases wander."""
CREDIBLE = 0.1
"""A gyro that shows more than this beside its bias [rad/s] is turning, whatever the wheels say."""
UNKNOWN = 0.02
"""How far a bias is off before it was ever seen [rad/s]: about a degree per second."""
WANDER = 5e-4
"""How far it is off at best [rad/s]."""


class Standstill:
    """Watches for it, and learns the gyro's bias meanwhile (zero-velocity update).

    A wheel stands while it stays within one count of where it was. From `AFTER` on the robot is
    taken to stand still, and its steps, with the one that ends it, are taken by the wheels alone: so
    a robot that creeps by a count now and then loses nothing.

    Args:
        ticks: Per measured wheel, what one count is [rad], or 0.
        white: The gyro's white noise [rad/s per sqrt(Hz)].

    Attributes:
        bias: Of the gyro [rad/s].
    """

    __slots__ = ("_learned", "_seconds", "_shown", "_ticks", "_way", "_white", "bias")

    def __init__(self, ticks: Sequence[float], white: float) -> None:
        self._ticks = [1.001 * abs(tick) for tick in ticks]
        self._white = white
        self.bias = 0.0
        self._learned = 0.0
        self.restart()

    @property
    def doubt(self) -> float:
        """How far the bias may be off [rad/s]."""
        if not self._learned:
            return UNKNOWN
        return max(WANDER, self._white / math.sqrt(self._learned))

    @property
    def ticks(self) -> Sequence[float]:
        """Per measured wheel, what it may turn and still stand [rad]."""
        return self._ticks

    def restart(self) -> None:
        """Begin to wait anew."""
        self._way = [0.0] * len(self._ticks)
        self._seconds = self._shown = 0.0

    def step(self, turned: Sequence[float], seconds: float, rate: float | None) -> bool:
        """Take one step; whether it is to be taken by the wheels alone.

        Args:
            turned: By each wheel [rad].
            seconds: How long the step took.
            rate: What the gyro showed on average, bias included; None where it was silent.
        """
        was_still = self._seconds >= AFTER
        if rate is not None and abs(rate - self.bias) > CREDIBLE:
            self.restart()
            return False
        for k, (angle, tick) in enumerate(zip(turned, self._ticks, strict=True)):
            self._way[k] += angle
            if abs(angle) > tick or abs(self._way[k]) > tick:
                self.restart()
                return was_still
        if rate is None:
            self.restart()
            return was_still
        self._seconds += seconds
        self._shown += seconds * (rate - self.bias)
        if self._seconds < AFTER:
            return False
        # All that was shown since the wheels came to rest, then step by step.
        span = seconds if was_still else self._seconds
        shown = seconds * (rate - self.bias) if was_still else self._shown
        self._learned = min(self._learned + span, MEMORY)
        self.bias += shown / self._learned
        return True
