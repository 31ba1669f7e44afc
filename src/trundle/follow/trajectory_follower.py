"""Following a trajectory: a controller on a clock, and the reasons to stop."""

from __future__ import annotations

import math
from typing import Generic, Protocol, TypeVar

import msgspec

from trundle.follow.guidance import Guidance, Status, Supervision
from trundle.follow.timed_path import Reference, TimedPath
from trundle.geometry import Pose2D, Twist2D

__all__ = ["Controller", "FollowerState", "TrajectoryFollower"]

State = TypeVar("State")


class Controller(Protocol[State]):
    """Feedback about a reference: `Ramsete`, `HolonomicPid`, or one's own."""

    def start(self) -> State:
        """The state before the first step."""

    def step(self, state: State, reference: Reference, pose: Pose2D, dt: float) -> tuple[Twist2D, State]:
        """The body twist, and the next state."""


class FollowerState(msgspec.Struct, Generic[State], frozen=True):
    """What a follower remembers.

    Attributes:
        start_ns: When the trajectory began [ns].
        now_ns: Of the last step [ns].
        controller: The controller's own state.
        ended: Why it stopped, or None.
    """

    start_ns: int
    now_ns: int
    controller: State
    ended: Guidance | None = None


class TrajectoryFollower(Generic[State]):
    """Keeps a robot on a trajectory. Immutable: the state is yours to keep.

    Args:
        trajectory: Where to be, and when.
        controller: `Ramsete()` for drives that cannot move sideways, else `HolonomicPid()`.
        supervision: When to give up.
    """

    def __init__(
        self, trajectory: TimedPath, controller: Controller[State], supervision: Supervision | None = None
    ) -> None:
        self.trajectory = trajectory
        self.controller = controller
        self.supervision = supervision or Supervision()

    def start(self, now_ns: int) -> FollowerState[State]:
        """The state at the moment at which the trajectory begins."""
        return FollowerState(now_ns, now_ns, self.controller.start())

    def step(
        self, state: FollowerState[State], now_ns: int, pose: Pose2D | None, stamp_ns: int
    ) -> tuple[Guidance, FollowerState[State]]:
        """What to do now, and the next state.

        It ends when the trajectory's time is over, when the pose is lost, or when the robot is too far
        from where it ought to be. What has ended stays ended: `start` begins again.

        Args:
            state: The one that the last step returned.
            now_ns: Time now [ns], on the same monotonic clock as the stamp.
            pose: The latest pose of the robot; None if there is none.
            stamp_ns: Time of the pose [ns].
        """
        if state.ended is not None:
            return state.ended, state
        dt = max(now_ns - state.now_ns, 0) * 1e-9
        if pose is None or not self.supervision.has_pose(now_ns, pose, stamp_ns):
            return self._end(state, now_ns, Guidance.stop(Status.NO_POSE))
        reference = self.trajectory.at((now_ns - state.start_ns) * 1e-9)
        deviation = math.dist((pose.x, pose.y), (reference.pose.x, reference.pose.y))
        if deviation > self.supervision.max_deviation:
            return self._end(state, now_ns, Guidance.stop(Status.OFF_PATH, deviation))
        if reference.time >= self.trajectory.duration:
            return self._end(state, now_ns, Guidance.stop(Status.ARRIVED, deviation))
        twist, inner = self.controller.step(state.controller, reference, pose, dt)
        next_state = FollowerState(state.start_ns, now_ns, inner)
        return Guidance(twist, Status.FOLLOWING, deviation), next_state

    def _end(
        self, state: FollowerState[State], now_ns: int, guidance: Guidance
    ) -> tuple[Guidance, FollowerState[State]]:
        return guidance, FollowerState(state.start_ns, now_ns, state.controller, guidance)
