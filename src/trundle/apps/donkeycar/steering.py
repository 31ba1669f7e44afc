"""Steering as donkeycar has it: from -1, full left, to 1, full right; and what two wheels make of it."""

from __future__ import annotations

from trundle.apps.donkeycar.clipping import Clipping, as_number, clip
from trundle.command.joystick import dead_band
from trundle.errors import ConfigError, require_positive

__all__ = [
    "NormalizeSteeringAngle",
    "TwoWheelSteeringThrottle",
    "UnnormalizeSteeringAngle",
    "differential_steering",
]


class NormalizeSteeringAngle(Clipping):
    """A steering angle in radians, left positive, as a number from -1, full left, to 1, full right.

    Args:
        max_steering_angle: What -1 means [rad].
        steering_zero: Numbers up to it are 0. What is beyond is not shifted, so that the way back through
            `UnnormalizeSteeringAngle` leads to the same angle.
        parity: Do not clip, as donkeycar.

    Raises:
        ConfigError: If the greatest angle is not above zero.
    """

    def __init__(
        self, max_steering_angle: float, steering_zero: float = 0.0, *, parity: bool = False
    ) -> None:
        self.max_steering_angle = require_positive("max_steering_angle", max_steering_angle)
        self.steering_zero = steering_zero
        self.parity = parity

    def run(self, steering_angle: object) -> float:
        """The steering from -1, left, to 1, right; 0 where the angle [rad] is no number."""
        angle = as_number(steering_angle)
        share = 0.0 if angle is None else angle / self.max_steering_angle
        steering = share if self.parity else clip(share, 1.0)
        self._report(angle is None or steering != share)
        return 0.0 if abs(steering) <= self.steering_zero else -steering


class UnnormalizeSteeringAngle(Clipping):
    """The steering angle in radians, left positive, of a number from -1, full left, to 1, full right.

    Args:
        max_steering_angle: What -1 means [rad].
        steering_zero: Numbers up to it mean 0.

    Raises:
        ConfigError: If the greatest angle is not above zero.
    """

    def __init__(self, max_steering_angle: float, steering_zero: float = 0.0) -> None:
        self.max_steering_angle = require_positive("max_steering_angle", max_steering_angle)
        self.steering_zero = steering_zero

    def run(self, steering: object) -> float:
        """The angle [rad], left positive; 0 where the steering is no number."""
        number = as_number(steering)
        allowed = 0.0 if number is None else clip(number, 1.0)
        self._report(number != allowed)
        return 0.0 if abs(allowed) <= self.steering_zero else -self.max_steering_angle * allowed


def differential_steering(
    throttle: object, steering: object, steering_zero: float = 0.0, *, parity: bool = False
) -> tuple[float, float]:
    """Throttles of the left and the right wheel: the wheel inside the turn is slowed.

    This is for a person's sticks. It is not inverse kinematics: the forward speed falls with the steering.

    Args:
        throttle: -1, backwards, to 1.
        steering: -1, full left, to 1, full right.
        steering_zero: Dead band of the steering, continuous beyond it.
        parity: Let the steering jump at the end of the dead band, as donkeycar.

    Returns:
        From -1 to 1 each; zeros where an argument is no number.
    """
    speed, turn = as_number(throttle), as_number(steering)
    if speed is None or turn is None:
        return 0.0, 0.0
    speed, turn = clip(speed, 1.0), clip(turn, 1.0)
    if not parity:
        turn = dead_band(turn, steering_zero)
    elif abs(turn) <= steering_zero:
        turn = 0.0
    return speed * (1.0 + min(turn, 0.0)), speed * (1.0 - max(turn, 0.0))


class TwoWheelSteeringThrottle(Clipping):
    """Throttles of the left and the right wheel; see `differential_steering`.

    Args:
        steering_zero: Dead band of the steering, from 0 to below 1.
        parity: As donkeycar.

    Raises:
        ConfigError: If the dead band is impossible.
    """

    def __init__(self, steering_zero: float = 0.01, *, parity: bool = False) -> None:
        zero = as_number(steering_zero)
        if zero is None or not 0.0 <= zero <= 1.0 or (zero == 1.0 and not parity):
            raise ConfigError("steering_zero", f"{steering_zero!r}, must be a number from 0 to below 1")
        self.steering_zero = zero
        self.parity = parity

    def run(self, throttle: object, steering: object) -> tuple[float, float]:
        """Throttles of the left and the right wheel, from -1 to 1.

        Args:
            throttle: -1, backwards, to 1.
            steering: -1, full left, to 1, full right.
        """
        numbers = (as_number(throttle), as_number(steering))
        self._report(any(number is None or abs(number) > 1.0 for number in numbers))
        return differential_steering(throttle, steering, self.steering_zero, parity=self.parity)
