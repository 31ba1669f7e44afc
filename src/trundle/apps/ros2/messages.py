"""Plain values to and from the fields of messages.

Messages are anything with the fields of the ROS type, so that all of this is tested without ROS.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trundle.apps.ros2.base import Report
from trundle.errors import InputError
from trundle.geometry import Pose2D, Twist2D
from trundle.odometry.covariance import Six, rotated

__all__ = [
    "LATEST_NS",
    "UNKNOWN",
    "read_pose",
    "read_stamp",
    "read_twist",
    "write_covariance",
    "write_odometry",
    "write_pose",
    "write_stamp",
    "write_transform",
]

UNKNOWN = 1e6
"""Variance of what a planar robot does not know (z, roll, pitch): large, but a filter can invert it."""
LATEST_NS = 2**31 * 10**9 - 1
"""Seconds of a stamp are an int32."""

_LEAST_TWIST_VARIANCE = 1e-9  # (m/s)^2, (rad/s)^2: zero would be certainty
_SECOND = 1_000_000_000
_NORM_TOLERANCE = 1e-3
_FURTHEST = 1e8  # m; beyond, a float no longer knows micrometres
_SYMMETRY_TOLERANCE = 1e-6

# Covariances go row by row over (x, y, z, roll, pitch, yaw): places of the planar triangle, and its mirror.
_TRIANGLE = (0, 1, 7, 5, 11, 35)
_MIRROR = (0, 6, 7, 30, 31, 35)


# ------------------------------------------------------------------------------------ reading


def read_stamp(stamp: Any) -> int:
    """A builtin_interfaces/Time as nanoseconds."""
    return int(stamp.sec) * _SECOND + int(stamp.nanosec)


def read_twist(twist: Any) -> Twist2D:
    """The planar part of a geometry_msgs/Twist; NaN where any part of it is no number (FAULTS.md K1)."""
    linear, angular = twist.linear, twist.angular
    if not math.isfinite(linear.z + angular.x + angular.y):
        return Twist2D(math.nan, math.nan, math.nan)
    return Twist2D(linear.x, linear.y, angular.z)


def read_pose(message: Any, frame: str) -> tuple[Pose2D, Six]:
    """The planar pose of a PoseWithCovarianceStamped, and the covariance of its body-frame error.

    Args:
        message: The message.
        frame: The frame that it must be in.

    Raises:
        InputError: If it is in another frame, not finite, no rotation, or its covariance is none.
    """
    given = message.header.frame_id
    if given not in (frame, ""):
        raise InputError(f"pose in frame {given!r}, must be in {frame!r}")
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    numbers = (position.x, position.y, turn.x, turn.y, turn.z, turn.w)
    if not all(abs(number) < _FURTHEST for number in numbers):
        raise InputError(f"pose: every number must be finite, and within {_FURTHEST:g} m")
    norm = math.hypot(turn.x, turn.y, turn.z, turn.w)
    if abs(norm - 1.0) > _NORM_TOLERANCE:
        raise InputError(f"pose: its quaternion has the norm {norm:g}, must be 1")
    theta = math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z)
    )
    six = _planar_covariance(message.pose.covariance)
    return Pose2D(position.x, position.y, theta), rotated(six, math.cos(theta), -math.sin(theta))


def _planar_covariance(flat: Sequence[float]) -> Six:
    """The upper triangle for x, y and yaw.

    Raises:
        InputError: If it is not the covariance of anything (FAULTS.md S22, S23).
    """
    upper = [float(flat[place]) for place in _TRIANGLE]
    lower = [float(flat[place]) for place in _MIRROR]
    if not all(map(math.isfinite, (*upper, *lower))):
        raise InputError("pose covariance: every number must be finite")
    xx, xy, yy, xt, yt, tt = upper
    size = max(map(abs, upper))
    if size > UNKNOWN:
        raise InputError(f"pose covariance: {size:g}, must be at most {UNKNOWN:g}")
    if any(abs(a - b) > _SYMMETRY_TOLERANCE * size for a, b in zip(upper, lower, strict=True)):
        raise InputError("pose covariance: must be symmetric")
    # Sylvester: no principal minor below zero, but for rounding.
    slack = -1e-9
    minors = (xx * yy - xy * xy, xx * tt - xt * xt, yy * tt - yt * yt)
    whole = xx * (yy * tt - yt * yt) - xy * (xy * tt - yt * xt) + xt * (xy * yt - yy * xt)
    if min(xx, yy, tt) < 0.0 or min(minors) < slack * size**2 or whole < slack * size**3:
        raise InputError("pose covariance: must be positive semi-definite")
    return (xx, xy, yy, xt, yt, tt)


# ------------------------------------------------------------------------------------ writing


def write_stamp(stamp: Any, time_ns: int) -> None:
    """Nanoseconds as a builtin_interfaces/Time."""
    stamp.sec, stamp.nanosec = divmod(time_ns, _SECOND)


def write_pose(pose: Any, planar: Pose2D) -> None:
    """A geometry_msgs/Pose on the plane."""
    pose.position.x, pose.position.y = planar.x, planar.y
    half = 0.5 * math.remainder(planar.theta, math.tau)
    pose.orientation.z, pose.orientation.w = math.sin(half), math.cos(half)


def write_covariance(flat: Any, six: Six, least: float = 0.0) -> None:
    """The planar part of a 6 x 6 covariance; what a planar robot does not know is `UNKNOWN`.

    Args:
        flat: 36 numbers, row by row; all those that are not written are zero.
        six: Upper triangle for x, y and yaw.
        least: A variance is at least this.
    """
    flat[14] = flat[21] = flat[28] = UNKNOWN
    for place, mirror, value in zip(_TRIANGLE, _MIRROR, six, strict=True):
        flat[place] = flat[mirror] = value
    for place in (0, 7, 35):
        flat[place] += least


def write_odometry(message: Any, report: Report) -> None:
    """Stamp, pose, twist and covariances of a nav_msgs/Odometry."""
    state = report.state
    write_stamp(message.header.stamp, state.time_ns)
    write_pose(message.pose.pose, state.pose)
    write_covariance(message.pose.covariance, report.covariance)
    twist = message.twist.twist
    twist.linear.x, twist.linear.y, twist.angular.z = state.twist.vx, state.twist.vy, state.twist.omega
    write_covariance(message.twist.covariance, report.twist_covariance, _LEAST_TWIST_VARIANCE)


def write_transform(message: Any, time_ns: int, pose: Pose2D) -> None:
    """A geometry_msgs/TransformStamped on the plane."""
    write_stamp(message.header.stamp, time_ns)
    moved, turned = message.transform.translation, message.transform.rotation
    moved.x, moved.y = pose.x, pose.y
    half = 0.5 * math.remainder(pose.theta, math.tau)
    turned.z, turned.w = math.sin(half), math.cos(half)
