"""Acceleration and jerk limits: from the present twist to the wanted one, straight through twist space."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec

from trundle.errors import InputError, require_positive
from trundle.geometry import Twist2D
from trundle.robot import Limits

__all__ = ["Ramp", "RampState"]

_REST = Twist2D()
_ARRIVED = 1e-9  # nearer than this [m/s, rad/s] the wanted twist is reached
_ROUNDING = 1.0 + 1e-12


class RampState(msgspec.Struct, frozen=True, gc=False):
    """Where the ramp is.

    Attributes:
        twist: Present body twist.
        acceleration: How fast it changes, per second.
    """

    twist: Twist2D = _REST
    acceleration: Twist2D = _REST


class Ramp:
    """Moves a twist towards a wanted one, no faster than acceleration and jerk allow. Immutable.

    All components change together, on the straight line between the two twists: from rest, or to rest,
    the curvature stays what it is. Where the wanted twist changes while the acceleration is limited in
    jerk, the acceleration bends from one line to the other.

    A wanted twist of zero is a stop request, which nothing delays: it sets the jerk limit aside, it does
    not wait for a clock that stands still, and translation does not wait for the yaw rate where that
    takes longer. Elsewhere a step may take any time up to two periods.

    Args:
        limits: Their accelerations and jerk are used.
        period: Nominal time between steps [s].
        load: How much of the limits on speed a twist uses, a convex function with 1 at the edge: with
            a jerk limit a changed mind may carry the twist past the wanted one, but never past these.
    """

    def __init__(self, limits: Limits, period: float, load: Callable[[Twist2D], float] | None = None) -> None:
        self.period = require_positive("period", period)
        faster, slower = limits.max_acceleration, limits.max_deceleration
        self._faster = math.inf if faster is None else faster
        self._slower = self._faster if slower is None else slower
        self._yaw = limits.max_yaw_acceleration or math.inf
        self._jerk = limits.max_jerk or math.inf
        self._load = load or (lambda _: 0.0)

    def step(self, state: RampState, wanted: Twist2D, seconds: float) -> RampState:
        """The state after a step.

        Args:
            state: The state before.
            wanted: Twist to end at.
            seconds: Time since the last step; negative counts as none, and more than two periods as two.

        Raises:
            InputError: If the wanted twist is not finite.
        """
        if not abs(wanted.vx) + abs(wanted.vy) + abs(wanted.omega) < math.inf:
            raise InputError(f"{wanted}: every component must be finite")
        seconds = min(seconds, 2.0 * self.period) if seconds > 0.0 else 0.0
        if wanted == _REST:
            return self._stop(state.twist, seconds or self.period)
        return self._approach(state, wanted, seconds) if seconds else state

    def _stop(self, now: Twist2D, seconds: float) -> RampState:
        moving = _left(math.hypot(now.vx, now.vy), self._slower, seconds)
        turning = _left(abs(now.omega), self._yaw, seconds)
        # On the line to rest where translation takes the longer; it never waits for the yaw rate.
        turning = max(turning, moving)
        rest = Twist2D(moving * now.vx, moving * now.vy, turning * now.omega)
        return RampState(rest, _difference(rest, now) * (1.0 / seconds))

    def _approach(self, state: RampState, wanted: Twist2D, seconds: float) -> RampState:
        now, before = state.twist, state.acceleration
        wanted = self._way_point(now, wanted)
        path = _difference(wanted, now)
        # The acceleration as a share of the path per second, so that with it, and then falling to zero
        # at the jerk limit, the path is not exceeded: rate * seconds + rate^2 * brake / 2 <= 1.
        brake = _length(path) / self._jerk
        rate = 2.0 / (seconds + math.sqrt(seconds * seconds + 2.0 * brake))
        best = self._within(now, path * rate)
        change = _difference(best, before)
        share = _at_most(self._jerk * seconds, _length(change))
        after = best if share == 1.0 else self._within(now, _sum(before, change * share))
        if share < 1.0 and self._leaves_limits(now, before, after, seconds):
            after = before * (1.0 - _at_most(self._jerk * seconds, _length(before)))
        twist = _sum(now, after * seconds)
        rest = _difference(wanted, twist)
        if _length(rest) < _ARRIVED and abs(rest.omega) < _ARRIVED:
            twist = wanted
        return RampState(twist, after)

    def _way_point(self, now: Twist2D, wanted: Twist2D) -> Twist2D:
        """Where on the line the robot is slowest, if it slows and speeds up at different rates."""
        if self._slower == self._faster:
            return wanted
        path = _difference(wanted, now)
        along = now.vx * path.vx + now.vy * path.vy
        length = _length(path)
        if along >= 0.0 or -along <= _ARRIVED * length or -along >= length * length:
            return wanted
        return _sum(now, path * (-along / (length * length)))

    def _within(self, now: Twist2D, acceleration: Twist2D) -> Twist2D:
        """The acceleration, scaled until it is within its limits."""
        size = _length(acceleration)
        slows = now.vx * acceleration.vx + now.vy * acceleration.vy < -_ARRIVED * size
        share = _at_most(self._slower if slows else self._faster, size)
        share = min(share, _at_most(self._yaw, abs(acceleration.omega)))
        return acceleration * share

    def _leaves_limits(self, now: Twist2D, before: Twist2D, after: Twist2D, seconds: float) -> bool:
        """Whether falling to zero at the jerk limit from there ends further out than from here."""
        allowed = max(1.0, self._load(now), self._load(self._end(now, before)))
        return self._load(self._end(_sum(now, after * seconds), after)) > allowed * _ROUNDING

    def _end(self, twist: Twist2D, acceleration: Twist2D) -> Twist2D:
        """The twist once the acceleration has fallen to zero at the jerk limit."""
        return _sum(twist, acceleration * (0.5 * _length(acceleration) / self._jerk))


def _left(speed: float, deceleration: float, seconds: float) -> float:
    """Share of a speed that a deceleration leaves."""
    return max(0.0, 1.0 - deceleration * seconds / speed) if speed else 0.0


def _at_most(limit: float, value: float) -> float:
    """Factor up to 1 that brings a value to its limit."""
    return limit / value if value > limit else 1.0


def _length(twist: Twist2D) -> float:
    return math.hypot(twist.vx, twist.vy)


def _sum(a: Twist2D, b: Twist2D) -> Twist2D:
    return Twist2D(a.vx + b.vx, a.vy + b.vy, a.omega + b.omega)


def _difference(a: Twist2D, b: Twist2D) -> Twist2D:
    return Twist2D(a.vx - b.vx, a.vy - b.vy, a.omega - b.omega)
