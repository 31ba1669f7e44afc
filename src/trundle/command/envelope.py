"""What a robot can do: how much of its limits a twist uses, and whether its wheels can steer there."""

from __future__ import annotations

import math

import msgspec

from trundle.command.frame import discretize
from trundle.command.reason import Reason
from trundle.errors import ConfigError, Infeasible, require_type
from trundle.geometry import Twist2D
from trundle.robot import Kinematics, Robot, WheelKind
from trundle.robot.rows import Row, rolling

__all__ = ["Envelope"]

_ROUNDING = 1e-9  # relative: what rounding leaves of a motion that needs no slip


class Envelope:
    """The motions within a robot's limits. Immutable.

    Args:
        robot: Its drive and limits are used.
        period: Where given, twists are what `discretize` takes: wheels are judged by the twist that
            will be held for this time [s].

    Attributes:
        drive: The drive, its steering within `limits.max_steering` too.
        limits: The robot's.
        holonomic: Whether it moves in any direction without slip.

    Raises:
        ConfigError: If a period is given for a drive that is not holonomic.
    """

    def __init__(self, robot: Robot, *, period: float | None = None) -> None:
        require_type("Envelope", "robot", robot, Robot)
        self.limits = robot.limits
        self.drive = _steering_within(robot.drive, self.limits.max_steering)
        odd = Twist2D(0.3, 0.5, 0.7)  # no direction that a drive prefers
        self.holonomic = self.drive.project(odd) == odd
        self.period = period
        if period is not None and not self.holonomic:
            raise ConfigError(
                "discretize",
                f"{type(robot.drive).__name__} already holds its twists as arcs: it must be holonomic",
            )
        self._bounded_steering = any(wheel.steering_range for wheel in self.drive.wheels)
        self._rows: list[Row] = []
        self._contacts: list[tuple[float, float, float]] = []
        for name in self.drive.wheel_names:
            wheel = self.drive.wheel(name)
            if wheel.kind is WheelKind.STEERED:
                self._contacts.append((wheel.x, wheel.y, wheel.radius))
            else:
                a, b, turn = rolling(wheel)
                self._rows.append((a / wheel.radius, b / wheel.radius, turn / wheel.radius))

    def project(self, twist: Twist2D) -> tuple[Twist2D, bool]:
        """The nearest twist without slip, and whether it differs by more than rounding."""
        if self.holonomic:
            return twist, False
        near = self.drive.project(twist)
        change = max(abs(near.vx - twist.vx), abs(near.vy - twist.vy), abs(near.omega - twist.omega))
        return near, change > _ROUNDING * (abs(twist.vx) + abs(twist.vy) + abs(twist.omega))

    def fastest_wheel(self, twist: Twist2D) -> float:
        """Speed of the fastest wheel [rad/s], whichever way it steers."""
        held = twist if self.period is None else discretize(twist, self.period)
        vx, vy, omega = held.vx, held.vy, held.omega
        fastest = 0.0
        for a, b, turn in self._rows:
            fastest = max(fastest, abs(a * vx + b * vy + turn * omega))
        for x, y, radius in self._contacts:
            fastest = max(fastest, math.hypot(vx - omega * y, vy + omega * x) / radius)
        return fastest

    def speed_load(self, twist: Twist2D) -> float:
        """Fraction of the speed limits that the translation uses.

        The limits are the half axes of an ellipse, so that a diagonal is not faster than they are;
        sideways is limited like forward where nothing else is said.
        """
        limits = self.limits
        sideways = limits.max_speed if limits.max_lateral_speed is None else limits.max_lateral_speed
        ahead = abs(twist.vx) / limits.max_speed if limits.max_speed else 0.0
        return math.hypot(ahead, twist.vy / sideways) if sideways else ahead

    def yaw_load(self, twist: Twist2D) -> float:
        """Fraction of the greatest yaw rate."""
        return abs(twist.omega) / self.limits.max_yaw_rate if self.limits.max_yaw_rate else 0.0

    def wheel_load(self, twist: Twist2D) -> float:
        """Fraction of the greatest wheel speed that the fastest wheel uses."""
        return self.fastest_wheel(twist) / self.limits.max_wheel_speed if self.limits.max_wheel_speed else 0.0

    def load(self, twist: Twist2D) -> float:
        """Greatest fraction of any limit on speed; 1 is the edge. A convex function of the twist."""
        return max(self.speed_load(twist), self.yaw_load(twist), self.wheel_load(twist))

    def exceeded(self, twist: Twist2D) -> tuple[Reason, ...]:
        """The limits on speed that a twist exceeds."""
        loads = (
            (Reason.SPEED, self.speed_load(twist)),
            (Reason.YAW_RATE, self.yaw_load(twist)),
            (Reason.WHEEL_SPEED, self.wheel_load(twist)),
        )
        return tuple(reason for reason, load in loads if load > 1.0)

    def steerable(self, twist: Twist2D) -> bool:
        """Whether every steered wheel can point where the twist (without slip) needs it."""
        if not self._bounded_steering:
            return True
        try:
            self.drive.inverse(twist if self.period is None else discretize(twist, self.period))
        except Infeasible:
            return False
        return True


def _steering_within(drive: Kinematics, max_steering: float | None) -> Kinematics:
    """The drive with every steering range cut to the limit."""
    if max_steering is None or not drive.steered_names:
        return drive
    wheels = []
    for wheel in drive.wheels:
        if wheel.kind is not WheelKind.STEERED:
            wheels.append(wheel)
            continue
        least, greatest = wheel.steering_range or (-math.inf, math.inf)
        reach = (max(least, -max_steering), min(greatest, max_steering))
        wheels.append(msgspec.structs.replace(wheel, steering_range=reach))
    measured = (*drive.measured_names, *(("gyro",) if drive.gyro else ()))
    return Kinematics(wheels, measured=measured)
