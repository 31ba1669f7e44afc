"""What wheels do while the body moves: where they point, and how fast they roll."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trundle.geometry import Twist2D
from trundle.robot import Kinematics, Wheel, WheelKind
from trundle.robot.rows import along, rolling

__all__ = ["rolling_rate", "rolling_rates", "steering_angles"]

Floats = npt.NDArray[np.float64]


def steering_angles(drive: Kinematics, twists: Floats) -> Floats:
    """Steering angles along a motion: continuous, unwrapped, held while a wheel stands still.

    Wheels begin as the first motion wants them. Where a wheel's range forces it, it turns by half
    a turn within no time.

    Args:
        drive: Whose wheels steer.
        twists: Body twists in order of time, shape (n, 3).

    Returns:
        Angles [rad], shape (n, steered).

    Raises:
        Infeasible: If the drive cannot move like that.
    """
    speeds: Floats
    angles: Floats
    speeds, angles = drive.inverse_batch(twists)
    for k, name in enumerate(drive.steered_names):
        angle = np.unwrap(
            _held(angles[:, k], speeds[:, drive.wheel_names.index(name)] != 0.0), period=math.pi
        )
        angles[:, k] = _into_range(angle, drive.wheel(name).steering_range)
    return angles


def rolling_rates(drive: Kinematics, twists: Floats, steering: Floats) -> Floats:
    """How fast the measured wheels of a drive turn [rad/s], shape (..., measured).

    Args:
        drive: Whose wheels turn.
        twists: Body twists, shape (..., 3).
        steering: Steering angles [rad], shape (..., steered).
    """
    vx, vy, omega = twists[..., 0], twists[..., 1], twists[..., 2]
    rates = []
    for name in drive.measured_names:
        wheel = drive.wheel(name)
        if wheel.kind is WheelKind.STEERED:
            toward = wheel.heading + steering[..., drive.steered_names.index(name)]
            ahead = np.cos(toward) * (vx - omega * wheel.y) + np.sin(toward) * (vy + omega * wheel.x)
        else:
            a, b, turn = rolling(wheel)
            ahead = a * vx + b * vy + turn * omega
        rates.append(ahead / wheel.radius)
    return np.stack(rates, axis=-1) if rates else np.zeros((*vx.shape, 0))


def rolling_rate(wheel: Wheel, twist: Twist2D, steering: float = 0.0) -> float:
    """How fast one wheel turns [rad/s]; the scalar twin of `rolling_rates`."""
    if wheel.kind is WheelKind.STEERED:
        toward = wheel.heading + steering
        a, b, turn = along(math.cos(toward), math.sin(toward), wheel.x, wheel.y)
    else:
        a, b, turn = rolling(wheel)
    return (a * twist.vx + b * twist.vy + turn * twist.omega) / wheel.radius


def _held(angle: Floats, moving: npt.NDArray[np.bool_]) -> Floats:
    """The last angle of a moving wheel, or the first one to come."""
    if not moving.any():
        return angle
    last = np.maximum.accumulate(np.where(moving, np.arange(len(angle)), -1))
    return angle[np.where(last < 0, int(np.argmax(moving)), last)]


def _into_range(angle: Floats, steering_range: Sequence[float] | None) -> Floats:
    if steering_range is None:
        return angle
    least, greatest = steering_range
    below, above = np.ceil((least - angle) / math.pi), np.floor((greatest - angle) / math.pi)
    turns = np.where(angle < least, below, np.where(angle > greatest, above, 0.0))
    return angle + math.pi * turns
