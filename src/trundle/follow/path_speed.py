"""How fast a robot may go along a path: from limits to a motion profile."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.errors import PathError, require_positive
from trundle.follow.path import Path, PathPoint
from trundle.follow.profile import Profile
from trundle.geometry import Pose2D, Twist2D

__all__ = ["SpeedLimits", "profile_along"]

Floats = npt.NDArray[np.float64]

_FEWEST = 16  # steps on a curve, however short


class SpeedLimits(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot may do on a path. None means no limit.

    Attributes:
        max_speed: [m/s].
        max_acceleration: Speeding up along the path [m/s^2].
        max_deceleration: Slowing down [m/s^2]; the acceleration where it is not given.
        max_jerk: [m/s^3]. With it every leg takes (acceleration + deceleration) / jerk longer.
        max_lateral_acceleration: Speed squared times curvature [m/s^2].
        max_yaw_rate: [rad/s].
        feasible_speed: The greatest speed [m/s] that the robot can have at a pose with a curvature of
            its path [1/m]: where limits on wheels come in.
        load: What fraction of the robot's limits a body twist uses (1 is the edge), for robots that
            may point anywhere on their path: `command.Envelope(robot).load`. Twice the twist is taken
            to be twice the load.
    """

    max_speed: float
    max_acceleration: float
    max_deceleration: float | None = None
    max_jerk: float | None = None
    max_lateral_acceleration: float | None = None
    max_yaw_rate: float | None = None
    feasible_speed: Callable[[Pose2D, float], float] | None = None
    load: Callable[[Twist2D], float] | None = None

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            if value is not None and not callable(value):
                require_positive(field, value)

    @property
    def deceleration(self) -> float:
        """Slowing down [m/s^2]."""
        return self.max_acceleration if self.max_deceleration is None else self.max_deceleration

    def speed_at(self, point: PathPoint) -> float:
        """The greatest speed at a point of a path [m/s].

        Raises:
            PathError: If it is zero there, or not a number: nothing gets past.
        """
        speed = self.max_speed
        if self.max_lateral_acceleration is not None and point.curvature:
            speed = min(speed, math.sqrt(self.max_lateral_acceleration / abs(point.curvature)))
        if self.max_yaw_rate is not None and point.turn:
            speed = min(speed, self.max_yaw_rate / abs(point.turn))
        if self.feasible_speed is not None:
            speed = _least(speed, self.feasible_speed(point.pose, point.curvature))
        if self.load is not None and (load := self.load(point.motion)):
            speed = _least(speed, 1.0 / load)
        if not speed > 0.0:
            raise PathError(
                f"the robot cannot drive at ({point.x:g}, {point.y:g}) m, {point.distance:g} m along it, "
                f"where the curvature is {point.curvature:g} 1/m: its feasible speed is {speed:g} m/s"
            )
        return speed


def _least(speed: float, other: float) -> float:
    """The smaller one; not a number if one is not."""
    return other if math.isnan(other) else min(speed, other)


def profile_along(path: Path, limits: SpeedLimits, *, spacing: float = 0.01) -> Profile:
    """The fastest motion along a path from rest to rest that keeps all limits; it stops at cusps.

    Limits are looked at every `spacing`, and between two looks the stricter one holds. Without a limit
    on jerk this is the forward and backward pass of time-optimal planning. With one, limits are widened
    by the distance that the smoothing looks across, so that the smoothed motion still keeps them all.

    Args:
        path: The path.
        limits: The limits.
        spacing: [m].

    Raises:
        PathError: If somewhere the robot cannot drive at all.
        ConfigError: If the spacing is not above zero.
    """
    require_positive("spacing", spacing)
    legs = [_profile_of_leg(leg, limits, spacing) for leg in path.legs]
    return Profile(phase for leg in legs for phase in leg)


def _profile_of_leg(
    leg: Path, limits: SpeedLimits, spacing: float
) -> list[tuple[float, float, float, float]]:
    up, down = limits.max_acceleration, limits.deceleration
    distances, speeds = _limits_on(leg, limits, spacing)
    window = 0.0 if limits.max_jerk is None else (up + down) / limits.max_jerk
    if window:
        speeds = _least_within(distances, speeds, window * float(speeds.max()))
    between = np.minimum(speeds[:-1], speeds[1:])
    nodes = np.concatenate([[0.0], np.minimum(between[:-1], between[1:]), [0.0]])
    energy = np.minimum(
        _rising(distances, nodes**2, up), _rising(-distances[::-1], nodes[::-1] ** 2, down)[::-1]
    )
    speed = np.sqrt(np.maximum(energy, 0.0))
    steps = np.diff(distances)
    moving = steps > 0.0
    durations = 2.0 * steps[moving] / (speed[:-1] + speed[1:])[moving]
    accelerations = np.diff(speed)[moving] / durations
    columns = (durations, speed[:-1][moving], accelerations, np.zeros_like(durations))
    phases = list(zip(*(column.tolist() for column in columns), strict=True))
    if not window:
        return phases
    smooth = Profile(phases).smoothed(window)
    return [smooth.phase(k) for k in range(len(smooth.jerks))]


def _limits_on(leg: Path, limits: SpeedLimits, spacing: float) -> tuple[Floats, Floats]:
    """Distances, both ends of every curve among them, and the greatest speeds there."""
    distances: list[float] = []
    speeds: list[float] = []
    for index, (start, curve) in enumerate(leg.curves):
        count = max(_FEWEST, math.ceil(curve.length / spacing))
        for k in range(count + 1):
            local = curve.length * k / count
            distances.append(start + local)
            speeds.append(limits.speed_at(leg.on_curve(index, local)))
    return np.array(distances), np.array(speeds)


def _rising(distances: Floats, squares: Floats, acceleration: float) -> Floats:
    """Greatest squared speeds under `squares` that rise by no more than `2 * acceleration` per metre."""
    slope = 2.0 * acceleration * distances
    rising: Floats = np.minimum.accumulate(squares - slope) + slope
    return rising


def _least_within(distances: Floats, values: Floats, reach: float) -> Floats:
    """The least value within a reach of every distance, from minima over powers of two."""
    first = np.searchsorted(distances, distances - reach, side="left")
    last = np.searchsorted(distances, distances + reach, side="right")
    levels = np.log2(last - first).astype(int)
    least = np.empty_like(values)
    minima = values
    for level in range(int(levels.max()) + 1):
        at = levels == level
        least[at] = np.minimum(minima[first[at]], minima[last[at] - (1 << level)])
        minima = np.minimum(minima[: -(1 << level)], minima[1 << level :])
    return least
