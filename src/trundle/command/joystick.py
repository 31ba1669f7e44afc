"""What a person's sticks mean: numbers from -1 to 1, as left and right efforts or as a twist.

Axes follow the robot's signs: forward positive, left positive, counter-clockwise positive. Most sticks
report the opposite of all three; the sign is changed where they are read.
"""

from __future__ import annotations

import math

import msgspec

from trundle.errors import ConfigError, InputError, require_finite
from trundle.geometry import Twist2D
from trundle.robot import Limits

__all__ = ["SideEfforts", "arcade_drive", "curvature_drive", "dead_band", "joystick_twist", "tank_drive"]


class SideEfforts(msgspec.Struct, frozen=True, gc=False):
    """Efforts of the two sides, from -1 to 1.

    Attributes:
        left: Of the left side.
        right: Of the right side.
    """

    left: float
    right: float


def dead_band(value: float, band: float, greatest: float = 1.0) -> float:
    """Zero within a band around zero; beyond it continuous, up to the greatest.

    Args:
        value: From a stick; clipped to the greatest either way.
        band: Half width of the band.
        greatest: What the full deflection gives.

    Raises:
        ConfigError: If the band is negative or not below the greatest.
        InputError: If the value is not finite.
    """
    if not 0.0 <= require_finite("band", band) < greatest:
        raise ConfigError("band", f"{band:g}, must be >= 0 and below {greatest:g}")
    size = abs(_axis("value", value, greatest))
    return math.copysign(greatest * (size - band) / (greatest - band), value) if size > band else 0.0


def arcade_drive(forward: float, turn: float, *, square_inputs: bool = True) -> SideEfforts:
    """One stick: how fast, and how much to turn.

    Where both together would be too much for a side, both sides are scaled, so that the turn stays
    what the stick says in every corner of its square.

    Args:
        forward: -1 to 1.
        turn: -1 to 1, counter-clockwise positive.
        square_inputs: Square both (keeping their signs), for finer control at low speed.
    """
    ahead, around = _stick("forward", forward, square_inputs), _stick("turn", turn, square_inputs)
    greater = max(abs(ahead), abs(around))
    if not greater:
        return SideEfforts(0.0, 0.0)
    # The square of stick positions onto the square of efforts, along each ray from the middle.
    scale = greater / (abs(ahead) + abs(around))
    return SideEfforts((ahead - around) * scale, (ahead + around) * scale)


def tank_drive(left: float, right: float, *, square_inputs: bool = True) -> SideEfforts:
    """Two sticks: one per side.

    Args:
        left: -1 to 1.
        right: -1 to 1.
        square_inputs: Square both, keeping their signs.
    """
    return SideEfforts(_stick("left", left, square_inputs), _stick("right", right, square_inputs))


def curvature_drive(forward: float, turn: float, *, turn_in_place: bool = False) -> SideEfforts:
    """One stick like a car's wheel: `turn` says how tight, not how fast ("cheesy drive").

    Args:
        forward: -1 to 1.
        turn: -1 to 1, counter-clockwise positive: curvature, as a share of the greatest.
        turn_in_place: Let `turn` be the yaw rate instead, as in arcade drive.
    """
    ahead, around = _stick("forward", forward, False), _stick("turn", turn, False)
    yaw = around if turn_in_place else abs(ahead) * around
    left, right = ahead - yaw, ahead + yaw
    whole = max(1.0, abs(left), abs(right))
    return SideEfforts(left / whole, right / whole)


def joystick_twist(
    forward: float, left: float, turn: float, limits: Limits, *, band: float = 0.05
) -> Twist2D:
    """The twist that sticks ask for, full deflection being the robot's limits.

    Args:
        forward: -1 to 1.
        left: -1 to 1.
        turn: -1 to 1, counter-clockwise positive.
        limits: `max_speed` and `max_yaw_rate` must be given; `max_speed` serves sideways too where
            `max_lateral_speed` is not given.
        band: Dead band of every axis.

    Raises:
        ConfigError: If a limit that scales an axis is not given.
    """
    if limits.max_speed is None or limits.max_yaw_rate is None:
        missing = "max_speed" if limits.max_speed is None else "max_yaw_rate"
        raise ConfigError(f"limits.{missing}", "must be given: it is what full deflection means")
    sideways = limits.max_speed if limits.max_lateral_speed is None else limits.max_lateral_speed
    return Twist2D(
        limits.max_speed * dead_band(forward, band),
        sideways * dead_band(left, band),
        limits.max_yaw_rate * dead_band(turn, band),
    )


def _axis(name: str, value: float, greatest: float = 1.0) -> float:
    if not math.isfinite(value):
        raise InputError(f"{name}: {value}, must be a number from {-greatest:g} to {greatest:g}")
    return max(-greatest, min(greatest, value))


def _stick(name: str, value: float, square: bool) -> float:
    value = _axis(name, value)
    return value * abs(value) if square else value
