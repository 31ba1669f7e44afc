"""PID: proportional, integral and derivative feedback of one error."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import ConfigError, require_finite

__all__ = ["Pid"]


class Pid(msgspec.Struct, frozen=True, kw_only=True):
    """Gains of one axis.

    Attributes:
        kp: Per error.
        ki: Per error and second.
        kd: Per error by second.
        max_integral: Greatest part of the output that the integral may have, either way.
    """

    kp: float
    ki: float = 0.0
    kd: float = 0.0
    max_integral: float = math.inf

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if field == "max_integral" and value == math.inf:
                continue
            if require_finite(field, value) < 0.0:
                raise ConfigError(field, f"{value:g}, must be >= 0")

    def integrate(self, integral: float, error: float, dt: float) -> float:
        """The integral's part of the output after another `dt` [s]; it does not wind up beyond its limit."""
        return min(max(integral + self.ki * error * dt, -self.max_integral), self.max_integral)

    def output(self, integral: float, error: float, rate: float) -> float:
        """What to do about an error that changes at a rate.

        Args:
            integral: What `integrate` returned.
            error: Wanted minus actual.
            rate: Its derivative by time.
        """
        return self.kp * error + integral + self.kd * rate
