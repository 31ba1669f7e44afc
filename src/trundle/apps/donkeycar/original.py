"""donkeycar's own arithmetic, operation by operation, for `parity=True`.

Source:
    donkeycar 5, donkeycar/parts/kinematics.py. What is wrong in it is wrong here, on purpose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

__all__ = ["Motion", "bicycle_motion", "front_wheel_pose", "inverse_unicycle_speeds", "unicycle_motion"]

Pose = tuple[float, float, float]


class Motion(NamedTuple):
    """A step: where it led, and how fast on average.

    Attributes:
        pose: x, y [m] and angle [rad] after it.
        rates: Their rates [m/s, m/s, rad/s].
        velocity: Of what the odometer measures [m/s].
    """

    pose: Pose
    rates: Pose
    velocity: float


def _limited(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))


def unicycle_motion(pose: Pose, left: float, right: float, axle_length: float, seconds: float) -> Motion:
    """`Unicycle`: along the chord's direction by the length of the arc."""
    distance = (left + right) / 2
    turn = (right - left) / axle_length
    along = _limited(pose[2] + turn / 2)
    x = pose[0] + distance * math.cos(along)
    y = pose[1] + distance * math.sin(along)
    rates = ((x - pose[0]) / seconds, (y - pose[1]) / seconds, turn / seconds)
    return Motion((x, y, _limited(pose[2] + turn)), rates, distance / seconds)


def bicycle_motion(pose: Pose, distance: float, steering: float, wheel_base: float, seconds: float) -> Motion:
    """`Bicycle`: what the front wheel rolled, along the heading of the body."""
    velocity = distance / seconds
    omega = velocity * math.sin(_limited(steering)) / wheel_base
    turn = omega * seconds
    along = _limited(pose[2] + turn / 2)
    vx, vy = velocity * math.cos(along), velocity * math.sin(along)
    after = (pose[0] + vx * seconds, pose[1] + vy * seconds, _limited(pose[2] + turn))
    return Motion(after, (vx, vy, omega), velocity)


def front_wheel_pose(pose: Pose, wheel_base: float, steering: float, distance: float) -> Pose:
    """`update_bicycle_front_wheel_pose`: a straight line along the heading after the turn."""
    x, y, theta = pose
    if steering != 0:
        theta = _limited(theta + math.tan(steering) * distance / wheel_base)
    return x + distance * math.cos(theta), y + distance * math.sin(theta), theta


def inverse_unicycle_speeds(velocity: float, omega: float, axle_length: float) -> tuple[float, float]:
    """`InverseUnicycle`: without any limit."""
    return velocity - omega * axle_length / 2, velocity + omega * axle_length / 2
