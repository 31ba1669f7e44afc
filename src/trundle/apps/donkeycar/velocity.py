"""Speeds and yaw rates, to wheels and steering, and to the range from -1 to 1 and back."""

from __future__ import annotations

import math
import time

from trundle import robot
from trundle.apps.donkeycar.clipping import Clipping, as_number, clip
from trundle.apps.donkeycar.original import inverse_unicycle_speeds
from trundle.apps.donkeycar.pose import METRE_PER_RADIAN, limit_angle
from trundle.command.motor import Motor
from trundle.errors import ConfigError, InputError, require_positive
from trundle.geometry import Twist2D

__all__ = [
    "BicycleNormalizeAngularVelocity",
    "BicycleUnnormalizeAngularVelocity",
    "InverseBicycle",
    "InverseUnicycle",
    "UnicycleNormalizeAngularVelocity",
    "UnicycleUnnormalizeAngularVelocity",
    "bicycle_angular_velocity",
    "bicycle_steering_angle",
    "unicycle_angular_velocity",
    "unicycle_max_angular_velocity",
    "wheel_rotational_velocity",
]

# --- formulas ------------------------------------------------------------------------------------


def wheel_rotational_velocity(wheel_radius: float, speed: float) -> float:
    """How fast a wheel turns [rad/s] that rolls at a speed [m/s]."""
    return speed / require_positive("wheel_radius", wheel_radius)


def unicycle_angular_velocity(
    wheel_radius: float, axle_length: float, left_velocity: float, right_velocity: float
) -> float:
    """Yaw rate [rad/s] of a differential drive whose wheels roll at these speeds [m/s].

    The radius cancels; it is an argument because donkeycar has it.
    """
    left = wheel_rotational_velocity(wheel_radius, left_velocity)
    right = wheel_rotational_velocity(wheel_radius, right_velocity)
    return wheel_radius / require_positive("axle_length", axle_length) * (right - left)


def unicycle_max_angular_velocity(
    wheel_radius: float, axle_length: float, max_forward_velocity: float
) -> float:
    """Yaw rate [rad/s] with one wheel at full speed and the other still.

    On the spot a differential drive turns twice as fast.
    """
    return unicycle_angular_velocity(wheel_radius, axle_length, 0.0, max_forward_velocity)


def bicycle_angular_velocity(
    wheel_base: float, forward_velocity: float, steering_angle: float, *, reference: str = "front"
) -> float:
    """Yaw rate [rad/s] of a car.

    Args:
        wheel_base: Distance between front and rear axle [m].
        forward_velocity: Speed of the reference wheel along itself [m/s].
        steering_angle: Of the front wheel [rad], left positive.
        reference: "front": v sin(steering) / wheel_base; "rear": v tan(steering) / wheel_base.
    """
    slope = math.sin if _is_front(reference) else math.tan
    return forward_velocity * slope(steering_angle) / require_positive("wheel_base", wheel_base)


def bicycle_steering_angle(
    wheel_base: float, forward_velocity: float, angular_velocity: float, *, reference: str = "front"
) -> float:
    """Steering angle [rad] with which a car turns as fast as wanted, or as nearly so as it can.

    Args:
        wheel_base: Distance between front and rear axle [m].
        forward_velocity: Speed of the reference wheel along itself [m/s]; negative is backwards.
        angular_velocity: Wanted yaw rate [rad/s].
        reference: "front" or "rear".

    Returns:
        From -pi/2 to pi/2. A front wheel cannot make its car turn faster than speed / wheel_base; at
        rest the angle is 0 where no turn is wanted, else a quarter turn to its side.
    """
    turn = angular_velocity * require_positive("wheel_base", wheel_base)
    if not forward_velocity:
        return math.copysign(math.pi / 2, turn) if turn else 0.0
    ratio = turn / forward_velocity
    return limit_angle(math.asin(clip(ratio, 1.0)) if _is_front(reference) else math.atan(ratio))


def _is_front(reference: str) -> bool:
    if reference not in ("front", "rear"):
        raise ConfigError("reference", f"{reference!r}, must be 'front' or 'rear'")
    return reference == "front"


# --- from a twist to wheels ------------------------------------------------------------------------


class InverseUnicycle(Clipping):
    """Wheel speeds of a differential drive, from forward speed and yaw rate.

    A wheel that would be faster than `max_speed` slows both by one factor, so that the path keeps its
    shape; where neither reaches `min_speed`, both stand still. `clipped` says that either happened.

    Args:
        axle_length: Distance between the wheels [m].
        wheel_radius: [m]; speeds of wheels in m/s do not depend on it.
        min_speed: Below it the motors stall [m/s].
        max_speed: Of a wheel [m/s].
        steering_zero: Not used: a dead band of donkeycar's 0.01 would hide yaw rates up to
            0.01 * max_speed / axle_length, where a controller needs them most.
        debug: Not used.
        parity: Like donkeycar, which does not use the limits either.

    Raises:
        ConfigError: If a length or limit is impossible.
    """

    def __init__(
        self,
        axle_length: float,
        wheel_radius: float,
        min_speed: float,
        max_speed: float,
        steering_zero: float = 0.01,
        debug: bool = False,
        *,
        parity: bool = False,
    ) -> None:
        self.axle_length = axle_length
        self.wheel_radius = require_positive("wheel_radius", wheel_radius)
        self.min_speed = min_speed
        self.max_speed = max_speed
        self.steering_zero = steering_zero
        self.debug = debug
        self.parity = parity
        self.timestamp: float = 0
        self._drive = robot.Differential(track_width=axle_length, wheel_radius=METRE_PER_RADIAN)
        self._motor = Motor(max_speed=max_speed, dead_band=min_speed)

    def run(
        self, forward_velocity: object, angular_velocity: object, timestamp: float | None = None
    ) -> tuple[float, float, float]:
        """Left and right wheel speed [m/s], and the time.

        Args:
            forward_velocity: [m/s]
            angular_velocity: [rad/s], counter-clockwise positive.
            timestamp: [s]; now if None.
        """
        self.timestamp = time.time() if timestamp is None else timestamp
        speed, omega = as_number(forward_velocity), as_number(angular_velocity)
        if speed is None or omega is None:
            self._report(True)
            return 0.0, 0.0, self.timestamp
        if self.parity:
            return *inverse_unicycle_speeds(speed, omega, self.axle_length), self.timestamp
        try:
            wanted = self._drive.inverse(Twist2D(speed, 0.0, omega)).speeds
            left, right = reached = self._motor.settle(self._scaled(wanted))
        except InputError:  # beyond what a float holds
            self._report(True)
            return 0.0, 0.0, self.timestamp
        self._report(reached != wanted)
        return left, right, self.timestamp

    def _scaled(self, wanted: tuple[float, ...]) -> tuple[float, ...]:
        if max(map(abs, wanted)) <= self.max_speed:
            return wanted
        return self._motor.speeds(self._motor.normalize(wanted))


class InverseBicycle(Clipping):
    """Speed and steering angle of a car, from forward speed and yaw rate.

    A turn that is too tight becomes the tightest that there is, and `clipped` says so. At rest the wheel
    stays where it is.

    Args:
        wheel_base: Distance between front and rear axle [m].
        debug: Not used.
        reference: Whose speed is given: the "front" wheel's along itself (as donkeycar computes), or
            that of the "rear" wheel (as donkeycar's documentation says).
        max_steering_angle: Greatest steering angle either way [rad].

    Raises:
        ConfigError: If a number is impossible, or the reference is neither.
    """

    def __init__(
        self,
        wheel_base: float,
        debug: bool = False,
        *,
        reference: str = "front",
        max_steering_angle: float = math.pi / 2,
    ) -> None:
        self.wheel_base = require_positive("wheel_base", wheel_base)
        self.debug = debug
        self.reference = reference
        self.max_steering_angle = require_positive("max_steering_angle", max_steering_angle)
        self.timestamp: float = 0
        self._steering = 0.0
        _is_front(reference)

    def run(
        self, forward_velocity: object, angular_velocity: object, timestamp: float | None = None
    ) -> tuple[float, float, float]:
        """The speed as it came [m/s], the steering angle [rad], left positive, and the time.

        Args:
            forward_velocity: Of the reference wheel [m/s].
            angular_velocity: [rad/s], counter-clockwise positive.
            timestamp: [s]; now if None.
        """
        self.timestamp = time.time() if timestamp is None else timestamp
        speed, omega = as_number(forward_velocity), as_number(angular_velocity)
        if speed is None or omega is None:
            self._report(True)
            return 0.0, self._steering, self.timestamp
        clipped = omega != 0.0
        if speed:
            wanted = bicycle_steering_angle(self.wheel_base, speed, omega, reference=self.reference)
            self._steering = clip(wanted, self.max_steering_angle)
            too_tight = _is_front(self.reference) and abs(omega * self.wheel_base) > abs(speed)
            clipped = too_tight or self._steering != wanted
        self._report(clipped)
        return speed, self._steering, self.timestamp


# --- from a yaw rate to -1..1 and back ---------------------------------------------------------------


class _AngularVelocityScale(Clipping):
    """A yaw rate as a share of the greatest: +1 is counter-clockwise, unlike normalised steering.

    Raises:
        ConfigError: If the greatest yaw rate is not above zero.
    """

    def __init__(self, max_angular_velocity: float, parity: bool) -> None:
        self.max_angular_velocity = require_positive("max_angular_velocity", max_angular_velocity)
        self.parity = parity

    def _clip(self, value: object, most: float) -> float:
        """The value within -most and most; 0 where it is no number."""
        number = as_number(value)
        allowed = 0.0 if number is None else number if self.parity else clip(number, most)
        self._report(number != allowed)
        return allowed

    def _normalize(self, angular_velocity: object) -> float:
        return self._clip(angular_velocity, self.max_angular_velocity) / self.max_angular_velocity

    def _unnormalize(self, normalized: object) -> float:
        return self._clip(normalized, 1.0) * self.max_angular_velocity


class BicycleNormalizeAngularVelocity(_AngularVelocityScale):
    """Yaw rate of a car, as a share of its greatest.

    Args:
        wheel_base: Distance between front and rear axle [m].
        max_forward_velocity: Of the front wheel [m/s].
        max_steering_angle: [rad].
        parity: Do not clip, as donkeycar.

    Attributes:
        max_angular_velocity: What 1 means [rad/s].

    Raises:
        ConfigError: If the greatest yaw rate is not above zero.
    """

    def __init__(
        self,
        wheel_base: float,
        max_forward_velocity: float,
        max_steering_angle: float,
        *,
        parity: bool = False,
    ) -> None:
        super().__init__(
            bicycle_angular_velocity(wheel_base, max_forward_velocity, max_steering_angle), parity
        )

    def run(self, angular_velocity: object) -> float:
        """The yaw rate [rad/s] as a number from -1 to 1, counter-clockwise positive."""
        return self._normalize(angular_velocity)


class BicycleUnnormalizeAngularVelocity(_AngularVelocityScale):
    """Yaw rate of a car, from a share of its greatest.

    Args:
        wheel_base: Distance between front and rear axle [m].
        max_forward_velocity: Of the front wheel [m/s].
        max_steering_angle: [rad].
        parity: Do not clip, as donkeycar.

    Attributes:
        max_angular_velocity: What 1 means [rad/s].

    Raises:
        ConfigError: If the greatest yaw rate is not above zero.
    """

    def __init__(
        self,
        wheel_base: float,
        max_forward_velocity: float,
        max_steering_angle: float,
        *,
        parity: bool = False,
    ) -> None:
        super().__init__(
            bicycle_angular_velocity(wheel_base, max_forward_velocity, max_steering_angle), parity
        )

    def run(self, normalized_angular_velocity: object) -> float:
        """The yaw rate [rad/s] that a number from -1 to 1 means, counter-clockwise positive."""
        return self._unnormalize(normalized_angular_velocity)


class UnicycleNormalizeAngularVelocity(_AngularVelocityScale):
    """Yaw rate of a differential drive, as a share of that with one wheel still.

    Args:
        wheel_radius: [m].
        axle_length: Distance between the wheels [m].
        max_forward_velocity: Of a wheel [m/s].
        parity: Do not clip, as donkeycar.

    Attributes:
        max_angular_velocity: What 1 means [rad/s].

    Raises:
        ConfigError: If the greatest yaw rate is not above zero.
    """

    def __init__(
        self, wheel_radius: float, axle_length: float, max_forward_velocity: float, *, parity: bool = False
    ) -> None:
        super().__init__(
            unicycle_max_angular_velocity(wheel_radius, axle_length, max_forward_velocity), parity
        )

    def run(self, angular_velocity: object) -> float:
        """The yaw rate [rad/s] as a number from -1 to 1, counter-clockwise positive."""
        return self._normalize(angular_velocity)


class UnicycleUnnormalizeAngularVelocity(_AngularVelocityScale):
    """Yaw rate of a differential drive, from a share of that with one wheel still.

    Args:
        wheel_radius: [m].
        axle_length: Distance between the wheels [m].
        max_forward_velocity: Of a wheel [m/s].
        parity: Do not clip, as donkeycar.

    Attributes:
        max_angular_velocity: What 1 means [rad/s].

    Raises:
        ConfigError: If the greatest yaw rate is not above zero.
    """

    def __init__(
        self, wheel_radius: float, axle_length: float, max_forward_velocity: float, *, parity: bool = False
    ) -> None:
        super().__init__(
            unicycle_max_angular_velocity(wheel_radius, axle_length, max_forward_velocity), parity
        )

    def run(self, normalized_angular_velocity: object) -> float:
        """The yaw rate [rad/s] that a number from -1 to 1 means, counter-clockwise positive."""
        return self._unnormalize(normalized_angular_velocity)
