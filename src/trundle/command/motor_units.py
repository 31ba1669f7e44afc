"""Wheel speeds in the unit and with the sign that a motor controller wants, and back."""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Sequence

from trundle.errors import ConfigError, ShapeError, did_you_mean
from trundle.robot import Robot

__all__ = ["MotorUnit", "MotorUnits"]


class MotorUnit(enum.Enum):
    """Unit of a wheel's speed."""

    RAD_PER_S = "rad/s"
    RPM = "rpm"
    METRES_PER_S = "m/s"
    COUNTS_PER_S = "counts/s"
    """Counts of the wheel's encoder, gears and quadrature included."""


class MotorUnits:
    """Converts wheel speeds by a robot's own description. Immutable.

    Args:
        robot: Its wheel radii and encoders are used.
        unit: A MotorUnit or its word.
        inverted: Names of the wheels whose motors are mounted mirrored, so that forward is negative;
            None means those whose encoders say so.

    Raises:
        ConfigError: If the unit or a name is unknown.
        InputError: If counts are wanted and a wheel has no encoder.
    """

    def __init__(
        self, robot: Robot, unit: MotorUnit | str, *, inverted: Collection[str] | None = None
    ) -> None:
        names = robot.drive.wheel_names
        words = [known.value for known in MotorUnit]
        if not isinstance(unit, MotorUnit) and unit not in words:
            raise ConfigError("unit", f"{unit!r}, {did_you_mean(str(unit), words)}")
        self.unit = MotorUnit(unit)
        if inverted is None:
            inverted = [name for name, encoder in robot.encoders.items() if encoder.inverted]
            inverted = [name for name in inverted if name in names]
        for name in inverted:
            if name not in names:
                raise ConfigError("inverted", f"{name!r}, {did_you_mean(name, names)}")
        if self.unit is MotorUnit.RAD_PER_S:
            factors = [1.0] * len(names)
        elif self.unit is MotorUnit.RPM:
            factors = [60.0 / math.tau] * len(names)
        elif self.unit is MotorUnit.METRES_PER_S:
            factors = [robot.drive.wheel(name).radius for name in names]
        else:
            factors = [encoder.ticks_per_revolution / math.tau for encoder in robot.encoders_of(names)]
        signs = [-1.0 if name in inverted else 1.0 for name in names]
        self._factors = [factor * sign for factor, sign in zip(factors, signs, strict=True)]

    def to_motor(self, speeds: Sequence[float]) -> tuple[float, ...]:
        """Speeds as the motor controllers want them.

        Args:
            speeds: Wheel speeds [rad/s], in the drive's `wheel_names` order.

        Raises:
            ShapeError: If there is not one per wheel.
        """
        return tuple(speed * factor for speed, factor in self._pairs(speeds))

    def to_wheel(self, values: Sequence[float]) -> tuple[float, ...]:
        """Wheel speeds [rad/s] from what the motor controllers say; the inverse of `to_motor`."""
        return tuple(value / factor for value, factor in self._pairs(values))

    def _pairs(self, values: Sequence[float]) -> list[tuple[float, float]]:
        if len(values) != len(self._factors):
            raise ShapeError(f"speeds: {len(values)} values, must be {len(self._factors)}, one per wheel")
        return list(zip(values, self._factors, strict=True))
