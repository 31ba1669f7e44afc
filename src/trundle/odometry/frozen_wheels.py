"""Wheels whose encoder stands still although they must turn (FAULTS.md S14)."""

from __future__ import annotations

import math
from collections.abc import Sequence

from trundle.errors import ConfigError, InputError, Unobservable
from trundle.robot import Kinematics, Noise
from trundle.robot.rows import contact, rolling

__all__ = ["FROZEN_AFTER", "FrozenWheels", "Spare"]

Numbers = Sequence[float]

FROZEN_AFTER = 0.2
"""A wheel is not suspected before it stood for so long while others moved [s]."""
SHARE = 0.25
"""It should have rolled at least this share of what the furthest of the others did: less may be slip."""
SIGMAS = 10.0
"""And at least so many standard deviations of a wheel's way."""
LEAST = 0.005
"""And at least so far [m]; all this beyond what ticks can feign."""


class Spare:
    """A drive without some of its measured wheels.

    Attributes:
        drive: What is left.
        chosen: Places of its measured wheels among those of the whole.
    """

    def __init__(self, whole: Kinematics, out: Sequence[int]) -> None:
        self.chosen = [k for k in range(len(whole.measured_names)) if k not in out]
        self.drive = whole.without([whole.measured_names[k] for k in out])
        self._needs_gyro = self.drive.gyro and not self.drive.observable_without_gyro

    def displacement(self, turned: Numbers, steering: Numbers, turn: float | None) -> Numbers | None:
        """What the wheels that are left say; None where that does not suffice."""
        if turn is None and self._needs_gyro:
            return None
        try:
            return self.drive.displacement([turned[k] for k in self.chosen], steering, turn)
        except Unobservable:
            return None


class _Span:
    """What happened since a wheel came to stand, while others moved."""

    __slots__ = ("furthest", "missed", "owed", "seconds", "wanted")

    def __init__(self) -> None:
        self.seconds = self.owed = self.wanted = self.furthest = 0.0
        self.missed = [0.0, 0.0, 0.0]


class FrozenWheels:
    """Suspects wheels that stand, and convicts those that others say must turn.

    Args:
        drive: What measures.
        noise: How far wheels may be off.
        ticks: Per measured wheel, what one count is [m], or 0.

    Attributes:
        stuck: Places of the convicted among the measured wheels.
        missed: Displacement that the last one kept from the pose before it was convicted.
    """

    def __init__(self, drive: Kinematics, noise: Noise, ticks: Numbers) -> None:
        self._drive = drive
        self._wheels = [drive.wheel(name) for name in drive.measured_names]
        self._ticks = ticks
        self._sigma = noise.wheel_distance
        self._spans: dict[int, _Span] = {}
        self._spares: dict[tuple[int, ...], Spare | None] = {}
        self.redundant = drive.redundancy > 0
        self.stuck: tuple[int, ...] = ()
        self.missed: Numbers = (0.0, 0.0, 0.0)

    @property
    def suspects(self) -> bool:
        """Whether any wheel is being watched or was convicted."""
        return bool(self._spans or self.stuck)

    def restart(self) -> None:
        """Begin to watch anew; convictions stay."""
        self._spans.clear()

    def spare(self, out: tuple[int, ...]) -> Spare | None:
        """The drive without these wheels, or None where it cannot do without."""
        if out not in self._spares:
            try:
                self._spares[out] = Spare(self._drive, out)
            except (ConfigError, InputError):
                self._spares[out] = None
        return self._spares[out]

    def release(self, turned: Numbers) -> bool:
        """Acquit the wheels that turn; whether any had been convicted."""
        for index, angle in enumerate(turned):
            if angle:
                self._spans.pop(index, None)
        left = tuple(index for index in self.stuck if not turned[index])
        released, self.stuck = left != self.stuck, left
        return released

    def convict(
        self,
        turned: Numbers,
        steering: Numbers,
        turn: float | None,
        seconds: float,
        step: Numbers,
        command: Numbers | None,
    ) -> bool:
        """Take one step; whether by it another wheel is found stuck.

        Args:
            turned: By each wheel [rad].
            steering: Mid-step angles [rad].
            turn: What the gyro turned [rad], or None.
            seconds: How long the step took.
            step: The displacement that all wheels made of it.
            command: Speeds that were asked for [rad/s], or None where nobody says.
        """
        rolled = [abs(angle) * wheel.radius for angle, wheel in zip(turned, self._wheels, strict=True)]
        furthest = max(rolled)
        if not furthest:
            return False
        for index, angle in enumerate(turned):
            if angle or index in self.stuck:
                continue
            span = self._spans.setdefault(index, _Span())
            span.seconds += seconds
            span.furthest += furthest
            if command is not None:
                span.wanted += command[index] * self._wheels[index].radius * seconds
            self._expect(span, index, turned, steering, turn, step)
            if span.seconds >= FROZEN_AFTER and self._guilty(span, index, steering, turn):
                self.stuck = (*self.stuck, index)
                self.missed = span.missed
                del self._spans[index]
                return True
        return False

    def _expect(
        self, span: _Span, index: int, turned: Numbers, steering: Numbers, turn: float | None, step: Numbers
    ) -> None:
        told = self._told(index, turned, steering, turn)
        if told is None:
            return
        span.owed += self._way(index, steering, told)
        span.missed = [m + a - b for m, a, b in zip(span.missed, told, step, strict=True)]

    def _told(self, index: int, turned: Numbers, steering: Numbers, turn: float | None) -> Numbers | None:
        """The displacement that the others say; None where they cannot."""
        spare = self.spare((*self.stuck, index)) if self.redundant else None
        return None if spare is None else spare.displacement(turned, steering, turn)

    def _way(self, index: int, steering: Numbers, step: Numbers) -> float:
        """How far a wheel rolls in a displacement of the body [m]."""
        wheel = self._wheels[index]
        if wheel.name in self._drive.steered_names:
            toward = wheel.heading + steering[self._drive.steered_names.index(wheel.name)]
            x, y = (sum(a * b for a, b in zip(row, step, strict=True)) for row in contact(wheel))
            return math.cos(toward) * x + math.sin(toward) * y
        return sum(a * b for a, b in zip(rolling(wheel), step, strict=True))

    def _guilty(self, span: _Span, index: int, steering: Numbers, turn: float | None) -> bool:
        owed = max(abs(span.owed), abs(span.wanted))
        least = max(LEAST, SHARE * span.furthest, SIGMAS * self._sigma * math.sqrt(span.furthest))
        return owed >= least and owed >= least + self._miscounted(index, steering, turn)

    def _miscounted(self, index: int, steering: Numbers, turn: float | None) -> float:
        """What ticks alone can make a wheel seem to be owed [m]: its own, and one of each who says so."""
        most = self._ticks[index]
        for other, (tick, wheel) in enumerate(zip(self._ticks, self._wheels, strict=True)):
            if tick and other != index:
                turned = [0.0] * len(self._wheels)
                turned[other] = tick / wheel.radius
                told = self._told(index, turned, steering, None if turn is None else 0.0)
                most += 0.0 if told is None else abs(self._way(index, steering, told))
        return most
