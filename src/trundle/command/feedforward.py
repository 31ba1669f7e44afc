"""From the wanted motion of a motor to the effort that it takes, before any error is seen."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import ConfigError, InputError, require_finite, require_numbers, require_positive

__all__ = ["FeedForward"]


class FeedForward(msgspec.Struct, frozen=True):
    """A permanent-magnet motor: `effort = kS sign(speed) + kV speed + kA acceleration`.

    Effort is in whatever unit the gains are: volts, or -1 to 1.

    Attributes:
        ks: Effort that only just overcomes static friction.
        kv: Effort per wheel speed [per rad/s].
        ka: Effort per wheel acceleration [per rad/s^2].
    """

    ks: float = 0.0
    kv: float = 0.0
    ka: float = 0.0

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            if require_finite(field, getattr(self, field)) < 0.0:
                raise ConfigError(field, f"{getattr(self, field):g}, must be >= 0")

    def effort(self, speed: float, acceleration: float = 0.0) -> float:
        """Effort for a speed and an acceleration. At rest it takes none.

        Friction acts against the motion; from rest, against the motion that is about to begin.

        Args:
            speed: Wheel speed [rad/s].
            acceleration: [rad/s^2].
        """
        try:
            return self._friction(speed, acceleration) + self.kv * speed + self.ka * acceleration
        except (TypeError, ValueError):
            require_numbers("effort", one={"speed": speed, "acceleration": acceleration})
            raise InputError(f"effort: speed {speed}, acceleration {acceleration}: must be numbers") from None

    def effort_to_reach(self, speed: float, wanted: float, period: float) -> float:
        """Constant effort that takes the wheel from one speed to another in a period, exactly.

        Args:
            speed: Wheel speed now [rad/s].
            wanted: Wheel speed at the end [rad/s].
            period: [s].

        Source:
            Zero-order hold of `ka dw/dt + kv w = effort - friction`.
        """
        require_positive("period", period)
        require_finite("speed", speed)
        require_finite("wanted", wanted)
        if self.ka == 0.0:  # without inertia it is there at once
            return self.effort(wanted)
        friction = self._friction(speed, wanted - speed)
        if self.kv == 0.0:
            return friction + self.ka * (wanted - speed) / period
        # What is left of a difference of speeds after the period.
        gone = -math.expm1(-self.kv / self.ka * period)
        return friction + self.kv * (speed + (wanted - speed) / gone)

    def _friction(self, speed: float, change: float) -> float:
        direction = speed or change
        return math.copysign(self.ks, direction) if direction else 0.0
