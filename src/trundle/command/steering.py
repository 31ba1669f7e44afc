"""Which way each steered wheel turns: the shorter way, without changing its mind at every sample."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence

import msgspec

from trundle.errors import ConfigError, ShapeError, require_finite
from trundle.geometry import Twist2D
from trundle.robot import Kinematics, Wheel, WheelCommand

__all__ = ["Flip", "Steering", "SteeringState"]

_QUARTER = math.pi / 2.0


class Flip(enum.Enum):
    """Who decides whether a wheel turns by half a turn less and drives backwards."""

    EACH = "each"
    """Every wheel for itself: each takes the shorter way."""
    TOGETHER = "together"
    """All wheels drive forwards or all backwards, whichever has the shorter longest way. Half of them
    never flip while the others turn, which would tear the robot around."""


class SteeringState(msgspec.Struct, frozen=True, gc=False):
    """What the next step needs of the last one.

    Attributes:
        angles: Last commanded angles [rad], in `steered_names` order, not wrapped.
        backwards: Which wheels were driving backwards.
        held: Which wheels kept their angle because they were all but still.
    """

    angles: tuple[float, ...]
    backwards: tuple[bool, ...]
    held: tuple[bool, ...]


class Steering:
    """Turns body twists into wheel commands for drives that steer. Immutable.

    Args:
        drive: Its `inverse` says where each wheel must point.
        flip: Who decides about driving backwards.
        hysteresis: A wheel (or, together, the wheel with the longest way) keeps its direction until it
            would have to turn by this angle more than a quarter turn [rad].
        hold_below: A wheel whose contact is slower keeps its angle [m/s]; it still rolls as fast as the
            contact moves along it.
        release_above: It steers again when its contact is faster [m/s]; twice `hold_below` by default.
        cosine_scaling: Slow each wheel by the cosine of the angle that it is still off, where
            measured angles are given, so that it does not push the robot sideways while it turns.

    Raises:
        ConfigError: If a number is negative, or the release is below the hold.
    """

    def __init__(
        self,
        drive: Kinematics,
        *,
        flip: Flip | str = Flip.EACH,
        hysteresis: float = math.radians(5.0),
        hold_below: float = 0.01,
        release_above: float | None = None,
        cosine_scaling: bool = True,
    ) -> None:
        self.drive = drive
        self.flip = Flip(flip)
        self.cosine_scaling = cosine_scaling
        self._hysteresis = _from_zero("hysteresis", hysteresis)
        self._hold = _from_zero("hold_below", hold_below)
        self._release = (
            2.0 * hold_below if release_above is None else _from_zero("release_above", release_above)
        )
        if self._release < self._hold:
            raise ConfigError("release_above", f"{self._release:g}, must be >= hold_below ({self._hold:g})")
        steered = set(drive.steered_names)
        self._wheels: list[tuple[int, Wheel]] = [
            (index, drive.wheel(name)) for index, name in enumerate(drive.wheel_names) if name in steered
        ]

    def start(self, angles: Sequence[float] | None = None) -> SteeringState:
        """The state before the first step.

        Args:
            angles: Measured angles [rad]; all zero if None.
        """
        count = len(self._wheels)
        known = (0.0,) * count if angles is None else tuple(angles)
        return SteeringState(self._checked(known), (False,) * count, (False,) * count)

    def step(
        self, state: SteeringState, twist: Twist2D, measured: Sequence[float] | None = None
    ) -> tuple[WheelCommand, SteeringState]:
        """Wheel speeds and angles for a twist.

        Args:
            state: The state before.
            twist: Body twist that the drive can do.
            measured: Present angles [rad]; the last commanded ones if None, and for each that is not finite.

        Raises:
            Infeasible: If the drive cannot do it (`saturate` comes before).
            ShapeError: If there is not one angle per steered wheel.
        """
        angles = state.angles
        if measured is not None:
            pairs = zip(self._checked(tuple(measured)), angles, strict=True)
            angles = tuple(now if math.isfinite(now) else last for now, last in pairs)
        nearest = self.drive.inverse(twist, angles)
        if not self._wheels:
            return nearest, state
        speeds, held, wanted = list(nearest.speeds), [], []
        backwards = self._directions(nearest, angles, state)
        for k, (index, wheel) in enumerate(self._wheels):
            angle, speed = nearest.steering[k], speeds[index]
            contact = abs(speed) * wheel.radius
            held.append(contact < (self._release if state.held[k] else self._hold))
            if held[k]:
                speeds[index] = speed * math.cos(angle - state.angles[k])
                wanted.append(state.angles[k])
                continue
            if speed and backwards[k] != (speed < 0.0):
                angle, speed = _opposite(angle, angles[k]), -speed
            if measured is not None and self.cosine_scaling:
                speed *= max(0.0, math.cos(angle - angles[k]))
            speeds[index] = speed
            wanted.append(angle)
        keep = tuple(state.backwards[k] if held[k] else backwards[k] for k in range(len(held)))
        command = WheelCommand(tuple(speeds), tuple(wanted))
        return command, SteeringState(command.steering, keep, tuple(held))

    def _directions(self, nearest: WheelCommand, angles: Sequence[float], state: SteeringState) -> list[bool]:
        """Per wheel, whether it will drive backwards."""
        moving = [k for k, (index, _) in enumerate(self._wheels) if nearest.speeds[index]]
        each = list(state.backwards)
        for k in moving:
            each[k] = nearest.speeds[self._wheels[k][0]] < 0.0
        if self.flip is Flip.TOGETHER:
            ways = [self._longest_way(nearest, angles, moving, backwards) for backwards in (False, True)]
            now = sum(state.backwards) > len(state.backwards) / 2
            change = ways[not now] < ways[now] - 2.0 * self._hysteresis
            if min(ways) < math.inf:  # else the ranges allow no common direction
                return [now != change] * len(each)
            return each
        for k in moving:
            if each[k] == state.backwards[k]:
                continue
            kept = _opposite(nearest.steering[k], angles[k])
            if abs(kept - angles[k]) <= _QUARTER + self._hysteresis and _reaches(self._wheels[k][1], kept):
                each[k] = state.backwards[k]
        return each

    def _longest_way(
        self, nearest: WheelCommand, angles: Sequence[float], moving: Sequence[int], backwards: bool
    ) -> float:
        """How far the wheel with the longest way turns if all drive that way; infinite if one cannot."""
        longest = 0.0
        for k in moving:
            index, wheel = self._wheels[k]
            angle = nearest.steering[k]
            if (nearest.speeds[index] < 0.0) != backwards:
                angle = _opposite(angle, angles[k])
                if not _reaches(wheel, angle):
                    return math.inf
            longest = max(longest, abs(angle - angles[k]))
        return longest

    def _checked(self, angles: tuple[float, ...]) -> tuple[float, ...]:
        if len(angles) != len(self._wheels):
            raise ShapeError(
                f"steering: {len(angles)} angles, must be {len(self._wheels)} {self.drive.steered_names}"
            )
        return angles


def _opposite(angle: float, now: float) -> float:
    """The other angle on the same line, nearest to the present one."""
    change = angle - now
    return now + change - math.copysign(math.pi, change)


def _reaches(wheel: Wheel, angle: float) -> bool:
    least, greatest = wheel.steering_range or (-math.inf, math.inf)
    return least <= angle <= greatest


def _from_zero(field: str, value: float) -> float:
    if require_finite(field, value) < 0.0:
        raise ConfigError(field, f"{value:g}, must be >= 0")
    return value
