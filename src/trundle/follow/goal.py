"""Going to a goal without a path: an angle, a place, a pose. Pure functions of the pose."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import require_finite, require_positive
from trundle.follow.guidance import Guidance, Status
from trundle.follow.unicycle import regulate_heading, within_limits
from trundle.geometry import Pose2D, Twist2D, wrap
from trundle.geometry.angle import sinc

__all__ = ["GoToAngle", "GoToGoal", "GoToPose"]


class _Steady(msgspec.Struct, frozen=True, kw_only=True):
    """Gains, limits and tolerances, all of them positive numbers."""

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if not isinstance(value, bool) and value != math.inf:
                require_positive(field, value)


class GoToAngle(_Steady, frozen=True):
    """Turn on the spot to a heading.

    Attributes:
        gain: [1/s].
        max_yaw_rate: [rad/s].
        tolerance: [rad].
    """

    gain: float = 3.0
    max_yaw_rate: float = math.inf
    tolerance: float = 0.01

    def guide(self, heading: float, wanted: float) -> Guidance:
        """What to do at a heading [rad] to get to the wanted one; `deviation` is 0: the robot stays."""
        if not math.isfinite(heading):
            return Guidance.stop(Status.NO_POSE)
        require_finite("wanted", wanted)
        if abs(wrap(wanted - heading)) <= self.tolerance:
            return Guidance.stop(Status.ARRIVED, 0.0)
        omega = regulate_heading(heading, wanted, gain=self.gain, max_yaw_rate=self.max_yaw_rate)
        return Guidance(Twist2D(0.0, 0.0, omega), Status.FOLLOWING)


class GoToGoal(_Steady, frozen=True):
    """Go to a place; the heading there is as it comes.

    The robot turns towards the goal while it drives, the slower the more it looks aside:
    `v = k rho cos(a)`, `omega = K a` with the distance rho and the bearing a. It converges for K > k.

    Attributes:
        speed_gain: k [1/s].
        heading_gain: K [1/s].
        max_speed: [m/s].
        max_yaw_rate: [rad/s].
        tolerance: [m].
        backward: Whether it may back to a goal behind it; else it turns on the spot first.
    """

    speed_gain: float = 1.0
    heading_gain: float = 3.0
    max_speed: float = math.inf
    max_yaw_rate: float = math.inf
    tolerance: float = 0.01
    backward: bool = False

    def guide(self, pose: Pose2D, goal: tuple[float, float]) -> Guidance:
        """What to do at a pose to get to the place (x, y) [m]."""
        if not math.isfinite(pose.x + pose.y + pose.theta):
            return Guidance.stop(Status.NO_POSE)
        x, y = (require_finite("goal", part) for part in goal)
        distance, bearing = math.dist((pose.x, pose.y), (x, y)), math.atan2(y - pose.y, x - pose.x)
        if distance <= self.tolerance:
            return Guidance.stop(Status.ARRIVED, distance)
        error = wrap(bearing - pose.theta)
        if self.backward and math.cos(error) < 0.0:
            error = wrap(error + math.pi)
            distance = -distance
        ahead = max(math.cos(error), 0.0)
        twist = Twist2D(self.speed_gain * distance * ahead, 0.0, self.heading_gain * error)
        return Guidance(
            within_limits(twist, self.max_speed, self.max_yaw_rate), Status.FOLLOWING, abs(distance)
        )


class GoToPose(_Steady, frozen=True):
    """Go to a place and arrive there with a heading, on one smooth curve.

    Stable from everywhere: with the bearing `a` of the goal seen from the robot, and `b` the bearing seen
    from the goal's heading, `v = k rho cos(a)`, `omega = K a + k cos(a) sin(a)/a (a + h b)`. The last
    bit of heading is turned on the spot, within the tolerance of the place.

    Attributes:
        speed_gain: k [1/s].
        bearing_gain: K [1/s].
        approach: h: how much the heading at the goal matters on the way.
        max_speed: [m/s].
        max_yaw_rate: [rad/s].
        tolerance: [m].
        angle_tolerance: [rad].
        backward: Whether it may back while the goal is behind; else it turns on the spot first.

    Source:
        Aicardi, Casalino, Bicchi, Balestrino 1995, "Closed loop steering of unicycle-like vehicles via
        Lyapunov techniques".
    """

    speed_gain: float = 1.0
    bearing_gain: float = 4.0
    approach: float = 4.0
    max_speed: float = math.inf
    max_yaw_rate: float = math.inf
    tolerance: float = 0.01
    angle_tolerance: float = 0.01
    backward: bool = False

    def guide(self, pose: Pose2D, goal: Pose2D) -> Guidance:
        """What to do at a pose to get to the goal."""
        if not math.isfinite(pose.x + pose.y + pose.theta):
            return Guidance.stop(Status.NO_POSE)
        require_finite("goal", goal.x + goal.y + goal.theta)
        distance = math.dist((pose.x, pose.y), (goal.x, goal.y))
        if distance <= self.tolerance:
            turn = GoToAngle(
                gain=self.bearing_gain, max_yaw_rate=self.max_yaw_rate, tolerance=self.angle_tolerance
            ).guide(pose.theta, goal.theta)
            return Guidance(turn.twist, turn.status, distance)
        direction = math.atan2(goal.y - pose.y, goal.x - pose.x)
        a, b = wrap(direction - pose.theta), wrap(direction - goal.theta)
        ahead = math.cos(a) if self.backward else max(math.cos(a), 0.0)
        omega = self.bearing_gain * a + self.speed_gain * ahead * sinc(a) * (a + self.approach * b)
        twist = Twist2D(self.speed_gain * distance * ahead, 0.0, omega)
        return Guidance(within_limits(twist, self.max_speed, self.max_yaw_rate), Status.FOLLOWING, distance)
