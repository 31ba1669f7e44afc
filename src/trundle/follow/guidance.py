"""What a controller answers: a motion, and whether it still knows what it is doing."""

from __future__ import annotations

import enum
import math

import msgspec

from trundle.errors import require_positive
from trundle.geometry import Pose2D, Twist2D

__all__ = ["Guidance", "Status", "Supervision"]


class Status(enum.Enum):
    """How it goes, in words for people."""

    FOLLOWING = "on its way"
    ARRIVED = "arrived"
    OFF_PATH = "stopped: too far from the path"
    NO_POSE = "stopped: the pose is missing or too old"

    @property
    def stops(self) -> bool:
        """Whether the robot must not move any more."""
        return self is not Status.FOLLOWING


class Guidance(msgspec.Struct, frozen=True, gc=False):
    """What the robot is to do now.

    Attributes:
        twist: Wanted body twist; zero where `status` stops the robot.
        status: How it goes.
        deviation: Distance from where the robot ought to be [m]; NaN without a pose.
    """

    twist: Twist2D
    status: Status
    deviation: float = 0.0

    @staticmethod
    def stop(status: Status, deviation: float = math.nan) -> Guidance:
        """Stand still, for a reason."""
        return Guidance(Twist2D(), status, deviation)


class Supervision(msgspec.Struct, frozen=True, kw_only=True):
    """When to give up. What it stops stays stopped until it is started again.

    Attributes:
        max_deviation: Distance from the path [m].
        pose_timeout: Age of the pose [s].
    """

    max_deviation: float = 0.5
    pose_timeout: float = 0.25

    def __post_init__(self) -> None:
        require_positive("max_deviation", self.max_deviation)
        require_positive("pose_timeout", self.pose_timeout)

    def has_pose(self, now_ns: int, pose: Pose2D | None, stamp_ns: int) -> bool:
        """Whether a pose is there, finite, and not older than it may be (or from the future by as much)."""
        if pose is None or not math.isfinite(pose.x + pose.y + pose.theta):
            return False
        return abs(now_ns - stamp_ns) <= self.pose_timeout * 1e9
