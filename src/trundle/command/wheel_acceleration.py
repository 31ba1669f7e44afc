"""The acceleration-level inverse: what wheels must do while the body's motion changes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from trundle.geometry import Twist2D
from trundle.robot import Kinematics, WheelKind
from trundle.robot.rows import rolling

__all__ = ["Acceleration2D", "WheelAcceleration", "inverse_acceleration"]


class Acceleration2D(msgspec.Struct, frozen=True, gc=False):
    """Acceleration of a body as an accelerometer at the reference point feels it, in the body's axes.

    Attributes:
        ax: Forward [m/s^2].
        ay: Leftward [m/s^2]; on a circle at constant speed it is `omega * vx`, not zero.
        alpha: Yaw acceleration [rad/s^2].
    """

    ax: float = 0.0
    ay: float = 0.0
    alpha: float = 0.0

    @staticmethod
    def of(twist: Twist2D, rate: Twist2D) -> Acceleration2D:
        """From a body twist and how fast its components change; the axes turn with the body.

        Args:
            twist: Body twist.
            rate: d(vx, vy, omega)/dt.
        """
        return Acceleration2D(rate.vx - twist.omega * twist.vy, rate.vy + twist.omega * twist.vx, rate.omega)

    def rate(self, twist: Twist2D) -> Twist2D:
        """How fast the components of the body twist change; the inverse of `of`."""
        return Twist2D(self.ax + twist.omega * twist.vy, self.ay - twist.omega * twist.vx, self.alpha)

    def at(self, x: float, y: float, omega: float) -> tuple[float, float]:
        """Acceleration of the body's point (x, y) [m/s^2]; `omega^2` times its arm is centripetal."""
        return self.ax - self.alpha * y - omega * omega * x, self.ay + self.alpha * x - omega * omega * y


class WheelAcceleration(msgspec.Struct, frozen=True, gc=False):
    """What the wheels do.

    Attributes:
        speeds: Rates of the wheel speeds [rad/s^2], in `wheel_names` order.
        steering_rates: [rad/s], in `steered_names` order.
        contacts: Accelerations (x, y) of the steered wheels' contact points, in the body's axes
            [m/s^2]: what the tyres must hold.
    """

    speeds: tuple[float, ...]
    steering_rates: tuple[float, ...]
    contacts: tuple[tuple[float, float], ...]


def inverse_acceleration(
    drive: Kinematics, twist: Twist2D, acceleration: Acceleration2D, steering: Sequence[float] | None = None
) -> WheelAcceleration:
    """Wheel accelerations and steering rates of a drive.

    A wheel at `r` moves with `u = v + omega x r` and accelerates by `a + alpha x r - omega^2 r`. Along
    its direction `d` that is the rate of its speed; across it, divided by the speed, it is how fast the
    direction turns in the world, of which the body turns `omega`. The centripetal term is there without
    any acceleration of the chassis. A wheel that stands still has no direction: its steering rate is 0.

    Args:
        drive: The drive.
        twist: Body twist that it can do.
        acceleration: Of the reference point.
        steering: Present angles [rad], as for `drive.inverse`.

    Raises:
        Infeasible, ShapeError: As `drive.inverse`.
    """
    command = drive.inverse(twist, steering)
    rate = acceleration.rate(twist)
    angles = iter(command.steering)
    speeds, rates, contacts = [], [], []
    for name, speed in zip(drive.wheel_names, command.speeds, strict=True):
        wheel = drive.wheel(name)
        if wheel.kind is not WheelKind.STEERED:
            a, b, turn = rolling(wheel)
            speeds.append((a * rate.vx + b * rate.vy + turn * rate.omega) / wheel.radius)
            continue
        direction = wheel.heading + next(angles)
        c, s = math.cos(direction), math.sin(direction)
        ax, ay = acceleration.at(wheel.x, wheel.y, twist.omega)
        contacts.append((ax, ay))
        speeds.append((c * ax + s * ay) / wheel.radius)
        across = c * ay - s * ax
        rates.append(across / (speed * wheel.radius) - twist.omega if speed else 0.0)
    return WheelAcceleration(tuple(speeds), tuple(rates), tuple(contacts))
