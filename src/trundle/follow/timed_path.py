"""Trajectories to follow: a path with a time for every place."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import PathError
from trundle.follow.path import Path
from trundle.follow.path_speed import SpeedLimits, profile_along
from trundle.follow.profile import Profile
from trundle.geometry import Pose2D, Twist2D

__all__ = ["Reference", "TimedPath"]

_UNEVEN = 1e-6  # between the lengths of a path and its profile [m]


class Reference(msgspec.Struct, frozen=True, gc=False):
    """Where a robot ought to be at one time, and how it ought to move: the feed-forward.

    Attributes:
        time: Since the beginning [s].
        distance: Along the path [m].
        pose: In the field.
        twist: In the robot's own axes, as `drive.inverse` takes it.
        acceleration: (forward [m/s^2], leftward [m/s^2], yaw [rad/s^2]) in the robot's own axes, as it
            would be felt at its reference point: with the centripetal part.
    """

    time: float
    distance: float
    pose: Pose2D
    twist: Twist2D
    acceleration: tuple[float, float, float]

    @property
    def field_velocity(self) -> Twist2D:
        """The velocity along the axes of the field; the yaw rate is the same in both."""
        vx, vy = _turned(self.twist.vx, self.twist.vy, self.pose.theta)
        return Twist2D(vx, vy, self.twist.omega)

    @property
    def field_acceleration(self) -> tuple[float, float, float]:
        """The acceleration along the axes of the field: the derivative of `field_velocity`."""
        ax, ay, alpha = self.acceleration
        return (*_turned(ax, ay, self.pose.theta), alpha)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


class TimedPath:
    """A path and how far along it to be after how long. Immutable.

    Args:
        path: Where.
        profile: When, over the same length.

    Attributes:
        duration: [s].

    Raises:
        PathError: If the lengths differ.
    """

    def __init__(self, path: Path, profile: Profile) -> None:
        if not abs(path.length - profile.length) <= _UNEVEN:
            raise PathError(
                f"the path is {path.length:g} m long, its profile {profile.length:g} m: must be the same"
            )
        self.path = path
        self.profile = profile
        self.duration = profile.duration

    @staticmethod
    def fastest(path: Path, limits: SpeedLimits, *, spacing: float = 0.01) -> TimedPath:
        """Along the path as fast as the limits allow, from rest to rest; see `profile_along`."""
        return TimedPath(path, profile_along(path, limits, spacing=spacing))

    def at(self, time: float) -> Reference:
        """What ought to be at a time [s]; before the beginning and after the end, rest.

        Raises:
            InputError: If the time is not a number.
        """
        motion = self.profile.at(time)
        point = self.path.at(motion.distance)
        speed, acceleration = motion.speed, motion.acceleration
        square = speed * speed
        forward, leftward = point.forward, point.leftward
        centripetal = square * point.curvature
        return Reference(
            time,
            point.distance,
            point.pose,
            Twist2D(speed * forward, speed * leftward, speed * point.turn),
            (
                acceleration * forward - centripetal * leftward,
                acceleration * leftward + centripetal * forward,
                acceleration * point.turn + square * point.turn_change,
            ),
        )
