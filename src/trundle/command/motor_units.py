"""Wheel speeds in the unit and with the sign that a motor controller wants, and back."""

from __future__ import annotations

import enum
import math
import operator
from collections.abc import Callable, Collection, Sequence

from trundle.errors import (
    ConfigError,
    ShapeError,
    did_you_mean,
    require_choice,
    require_numbers,
    require_type,
    row_of,
    shown,
)
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
        require_type("MotorUnits", "robot", robot, Robot)
        names = robot.drive.wheel_names
        self.unit = require_choice("unit", unit, MotorUnit)
        if inverted is None:
            inverted = [name for name, encoder in robot.encoders.items() if encoder.inverted]
            inverted = [name for name in inverted if name in names]
        if isinstance(inverted, str) or row_of(inverted) is None:
            raise ConfigError("inverted", f"{shown(inverted)}, must be a list of wheels")
        for name in inverted:
            if name not in names:
                raise ConfigError("inverted", f"{shown(name)}, {did_you_mean(str(name), names)}")
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
        return self._each(speeds, operator.mul)

    def to_wheel(self, values: Sequence[float]) -> tuple[float, ...]:
        """Wheel speeds [rad/s] from what the motor controllers say; the inverse of `to_motor`."""
        return self._each(values, operator.truediv)

    def _each(self, values: Sequence[float], change: Callable[[float, float], float]) -> tuple[float, ...]:
        try:
            if len(values) != len(self._factors):
                raise ShapeError(f"speeds: {len(values)} values, must be {len(self._factors)}, one per wheel")
            return tuple(map(change, values, self._factors))
        except TypeError:
            require_numbers("MotorUnits", row={"speeds": values})
            raise
