"""Pure pursuit: drive on the arc that meets the path some way ahead."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec

from trundle.errors import ConfigError, PathError, require_positive
from trundle.follow.curve import project
from trundle.follow.guidance import Guidance, Status, Supervision
from trundle.follow.path import Path
from trundle.geometry import Pose2D, Twist2D

__all__ = ["PurePursuit", "PursuitState"]


class PursuitState(msgspec.Struct, frozen=True):
    """How far along the robot is.

    Attributes:
        leg: Which part between cusps it is on, from 0.
        distance: Along that leg [m].
        ended: Why it stopped, or None.
    """

    leg: int = 0
    distance: float = 0.0
    ended: Guidance | None = None


class PurePursuit:
    """Follows a path by its shape alone, without times. Immutable: the state is yours to keep.

    The robot aims at the point of the path one look-ahead further than where it is; beyond the end of a
    leg the path goes on straight, so that the last metre is as steady as the first. It keeps to its place
    along the path, so that paths may cross themselves, and stops at cusps before it backs.

    Args:
        path: Where to go.
        speed: Wanted [m/s].
        deceleration: With which it slows down towards the end of a leg [m/s^2].
        lookahead: [m] at rest.
        lookahead_time: Added per wanted speed [s]: the look-ahead is `lookahead + lookahead_time * speed`.
        max_curvature: The tightest arc of a robot that cannot turn on the spot [1/m]. None: it can, and
            does so where the path lies behind it.
        max_yaw_rate: [rad/s], for turning on the spot.
        max_lateral_acceleration: Speed squared times curvature [m/s^2].
        feasible_speed: As in `SpeedLimits`: the greatest speed at a pose with a curvature.
        tolerance: Distance from the end of a leg at which it has been reached [m].
        supervision: When to give up.

    Raises:
        ConfigError: If a number is not above zero (`lookahead_time` may be zero).
        PathError: If the path is `facing` somewhere; that needs `HolonomicPid`.

    Source:
        Coulter 1992, "Implementation of the pure pursuit path tracking algorithm": curvature = 2 y / L^2,
        with the aim (x, y) in the robot's frame at the distance L.
    """

    def __init__(
        self,
        path: Path,
        *,
        speed: float,
        deceleration: float = 0.5,
        lookahead: float = 0.3,
        lookahead_time: float = 0.0,
        max_curvature: float | None = None,
        max_yaw_rate: float = 1.0,
        max_lateral_acceleration: float | None = None,
        feasible_speed: Callable[[Pose2D, float], float] | None = None,
        tolerance: float = 0.01,
        supervision: Supervision | None = None,
    ) -> None:
        if path.facing is not None:
            raise PathError(
                "pure pursuit: the robot must point along the path, this one is `facing` somewhere"
            )
        self.path = path
        self.legs = path.legs
        self.speed = require_positive("speed", speed)
        self.deceleration = require_positive("deceleration", deceleration)
        if not 0.0 <= lookahead_time < math.inf:
            raise ConfigError("lookahead_time", f"{lookahead_time!r} s, must be >= 0")
        self.lookahead = require_positive("lookahead", lookahead) + lookahead_time * speed
        self.max_curvature = max_curvature and require_positive("max_curvature", max_curvature)
        self.max_yaw_rate = require_positive("max_yaw_rate", max_yaw_rate)
        self.max_lateral_acceleration = max_lateral_acceleration
        self.feasible_speed = feasible_speed
        self.tolerance = require_positive("tolerance", tolerance)
        self.supervision = supervision or Supervision()

    def start(self, pose: Pose2D | None = None) -> PursuitState:
        """The state at the beginning of the path; or where its first leg is nearest to a pose."""
        if pose is None or not math.isfinite(pose.x + pose.y):
            return PursuitState()
        return PursuitState(0, self.legs[0].nearest(pose.x, pose.y))

    def step(
        self, state: PursuitState, now_ns: int, pose: Pose2D | None, stamp_ns: int
    ) -> tuple[Guidance, PursuitState]:
        """What to do now, and the next state; for the arguments see `TrajectoryFollower.step`."""
        if state.ended is not None:
            return state.ended, state
        if pose is None or not self.supervision.has_pose(now_ns, pose, stamp_ns):
            return _end(state, Guidance.stop(Status.NO_POSE))
        leg = self.legs[state.leg]
        distance = project(leg, pose.x, pose.y, state.distance, self.lookahead)
        nearest = leg.at(distance)
        deviation = math.dist((pose.x, pose.y), (nearest.x, nearest.y))
        state = PursuitState(state.leg, distance)
        end = leg.at(leg.length).pose.inverse() @ pose
        beyond = (-end.x if leg.backward else end.x) + self.tolerance
        if distance >= leg.length - self.lookahead and beyond >= 0.0 and deviation <= self.lookahead:
            if state.leg + 1 == len(self.legs):
                return _end(state, Guidance.stop(Status.ARRIVED, deviation))
            return self.step(PursuitState(state.leg + 1), now_ns, pose, stamp_ns)
        if deviation > self.supervision.max_deviation:
            return _end(state, Guidance.stop(Status.OFF_PATH, deviation))
        twist = self._pursue(leg, distance, pose)
        return Guidance(twist, Status.FOLLOWING, deviation), state

    def _pursue(self, leg: Path, distance: float, pose: Pose2D) -> Twist2D:
        beyond = distance + self.lookahead - leg.length
        sign = -1.0 if leg.backward else 1.0
        aim = leg.at(distance + self.lookahead).pose @ Pose2D(sign * max(beyond, 0.0), 0.0)
        seen = pose.inverse() @ aim
        ahead, aside = sign * seen.x, seen.y
        if ahead <= 0.0:
            # No arc of less than a half turn meets the aim: first turn to it, by the shorter way.
            side = math.copysign(1.0, aside)
            if self.max_curvature is None:
                return Twist2D(0.0, 0.0, sign * side * self.max_yaw_rate)
            curvature = side * self.max_curvature
        else:
            curvature = 2.0 * aside / (ahead * ahead + aside * aside)
        if self.max_curvature is not None:
            curvature = min(max(curvature, -self.max_curvature), self.max_curvature)
        speed = self._speed(leg.length - distance, pose, curvature)
        return Twist2D(sign * speed, 0.0, sign * speed * curvature)

    def _speed(self, remaining: float, pose: Pose2D, curvature: float) -> float:
        # Never less than what takes it over the end within the tolerance.
        slowing = math.sqrt(2.0 * self.deceleration * max(remaining, 0.5 * self.tolerance))
        speed = min(self.speed, slowing)
        if self.max_lateral_acceleration is not None and curvature:
            speed = min(speed, math.sqrt(self.max_lateral_acceleration / abs(curvature)))
        if self.feasible_speed is not None:
            feasible = self.feasible_speed(pose, curvature)
            speed = min(speed, feasible) if feasible > 0.0 else 0.0
        return speed


def _end(state: PursuitState, guidance: Guidance) -> tuple[Guidance, PursuitState]:
    return guidance, PursuitState(state.leg, state.distance, guidance)
