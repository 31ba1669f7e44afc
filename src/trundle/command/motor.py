"""The motors' side of a wheel command: the dead band, the speed below which they stall, and -1 to 1."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from trundle.errors import ConfigError, InputError, require_finite, require_positive

__all__ = ["Motor"]


class Motor(msgspec.Struct, frozen=True, kw_only=True):
    """What the motors of one robot can turn, all alike.

    Attributes:
        max_speed: Wheel speed at full effort [rad/s].
        min_speed: Slowest wheel speed that a motor holds without stalling [rad/s].
        dead_band: When no wheel is faster, all stand still [rad/s].
    """

    max_speed: float
    min_speed: float = 0.0
    dead_band: float = 0.0

    def __post_init__(self) -> None:
        require_positive("max_speed", self.max_speed)
        for field in ("min_speed", "dead_band"):
            value = require_finite(field, getattr(self, field))
            if not 0.0 <= value < self.max_speed:
                raise ConfigError(field, f"{value:g}, must be >= 0 and below max_speed ({self.max_speed:g})")

    def settle(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """The nearest speeds that the motors can hold.

        A wheel slower than `min_speed` stands still, or turns at it, whichever is nearer.

        Args:
            speeds: Wheel speeds [rad/s].
        """
        if max(map(abs, speeds), default=0.0) <= self.dead_band:
            return (0.0,) * len(speeds)
        return tuple(self._held(speed) for speed in speeds)

    def _held(self, speed: float) -> float:
        if abs(speed) >= self.min_speed:
            return speed
        if abs(speed) < 0.5 * self.min_speed:
            return 0.0
        return self.min_speed if speed > 0.0 else -self.min_speed

    def normalize(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """Speeds as shares of the greatest, from -1 to 1.

        Where one is beyond, all are scaled, so that their ratios stay.

        Args:
            speeds: Wheel speeds [rad/s].

        Raises:
            InputError: If one is not finite.
        """
        whole = max([self.max_speed, *map(abs, speeds)])
        if not abs(sum(speeds)) < float("inf"):
            raise InputError(f"speeds {tuple(speeds)}: must be finite")
        return tuple(speed / whole for speed in speeds)

    def speeds(self, efforts: Sequence[float]) -> tuple[float, ...]:
        """Wheel speeds [rad/s] from shares of the greatest; the inverse of `normalize` within -1 to 1."""
        return tuple(effort * self.max_speed for effort in efforts)
