"""A trajectory follower for drives that move in any direction: feed-forward and PID for every axis."""

from __future__ import annotations

import math

import msgspec

from trundle.follow.pid import Pid
from trundle.follow.timed_path import Reference
from trundle.geometry import Pose2D, Twist2D, wrap

__all__ = ["HolonomicPid", "HolonomicState"]


class HolonomicState(msgspec.Struct, frozen=True, gc=False):
    """What the follower remembers.

    Attributes:
        integrals: Of forward, leftward and heading errors.
        errors: The last ones, or None at the beginning.
    """

    integrals: tuple[float, float, float] = (0.0, 0.0, 0.0)
    errors: tuple[float, float, float] | None = None


class HolonomicPid(msgspec.Struct, frozen=True, kw_only=True):
    """The reference's velocity, turned into the robot's axes, plus feedback per axis of the robot.

    The velocity is known in the axes of the *reference*; a robot whose heading is off must turn it by
    that error, or it drives off in a wrong direction. (Road Runner 1.0 does not.)

    Attributes:
        forward: Of the error ahead [m].
        leftward: Of the error to the left [m].
        heading: Of the heading [rad].
    """

    forward: Pid = Pid(kp=4.0)
    leftward: Pid = Pid(kp=4.0)
    heading: Pid = Pid(kp=4.0)

    def start(self) -> HolonomicState:
        """The state before the first step."""
        return HolonomicState()

    def step(
        self, state: HolonomicState, reference: Reference, pose: Pose2D, dt: float
    ) -> tuple[Twist2D, HolonomicState]:
        """The body twist that leads from a pose to where the reference moves, and the next state.

        Args:
            state: The one that the last step returned.
            reference: Where to be now.
            pose: The robot's.
            dt: Since the last step [s]; 0 leaves out the integral and the derivative.
        """
        error = pose.inverse() @ reference.pose
        turn = wrap(error.theta)
        errors = (error.x, error.y, turn)
        rates = (0.0, 0.0, 0.0)
        if state.errors is not None and dt > 0.0:
            x, y, theta = state.errors
            rates = ((error.x - x) / dt, (error.y - y) / dt, wrap(turn - theta) / dt)
        axes = (self.forward, self.leftward, self.heading)
        fed = zip(axes, state.integrals, errors, strict=True)
        ix, iy, itheta = (pid.integrate(integral, part, dt) for pid, integral, part in fed)
        c, s = math.cos(turn), math.sin(turn)
        vx, vy = reference.twist.vx, reference.twist.vy
        twist = Twist2D(
            c * vx - s * vy + self.forward.output(ix, errors[0], rates[0]),
            s * vx + c * vy + self.leftward.output(iy, errors[1], rates[1]),
            reference.twist.omega + self.heading.output(itheta, errors[2], rates[2]),
        )
        return twist, HolonomicState((ix, iy, itheta), errors)
