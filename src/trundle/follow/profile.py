"""Motion profiles: how far along after how long, at limited speed, acceleration and jerk."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import pairwise

import msgspec

from trundle.errors import InputError, require_positive

__all__ = ["Profile", "ProfilePoint", "s_curve", "trapezoid"]


class ProfilePoint(msgspec.Struct, frozen=True, gc=False):
    """Motion along a line at one time.

    Attributes:
        distance: [m].
        speed: [m/s].
        acceleration: [m/s^2].
    """

    distance: float
    speed: float
    acceleration: float


class Profile:
    """Phases of constant jerk, one after the other, beginning at distance 0. Immutable.

    Args:
        phases: (duration [s], speed at its beginning [m/s], acceleration there [m/s^2], jerk [m/s^3]) each.

    Attributes:
        duration: [s].
        length: Distance at the end [m].
        end_speed: [m/s].

    Raises:
        InputError: If there is no phase, or a number is not finite.
    """

    def __init__(self, phases: Iterable[tuple[float, float, float, float]]) -> None:
        self._times, self._distances = array("d", [0.0]), array("d", [0.0])
        self._speeds, self._accelerations, self._jerks = array("d"), array("d"), array("d")
        speed = math.nan
        for duration, begin, acceleration, jerk in phases:
            if not (duration >= 0.0 and math.isfinite(duration + begin + acceleration + jerk)):
                raise InputError(f"profile: a phase {(duration, begin, acceleration, jerk)}, must be finite")
            distance = duration * (begin + duration * (acceleration / 2.0 + duration * jerk / 6.0))
            speed = begin + duration * (acceleration + duration * jerk / 2.0)
            self._times.append(self._times[-1] + duration)
            self._distances.append(self._distances[-1] + distance)
            self._speeds.append(begin)
            self._accelerations.append(acceleration)
            self._jerks.append(jerk)
        if not self._jerks:
            raise InputError("profile: no phase was given, must be one or more")
        self.duration = self._times[-1]
        self.length = self._distances[-1]
        self.end_speed = speed

    @property
    def times(self) -> tuple[float, ...]:
        """When phases begin, and when the last one ends [s]."""
        return tuple(self._times)

    @property
    def jerks(self) -> tuple[float, ...]:
        """Of all phases [m/s^3]."""
        return tuple(self._jerks)

    def phase(self, index: int) -> tuple[float, float, float, float]:
        """Duration, and speed, acceleration and jerk at the beginning of a phase."""
        duration = self._times[index + 1] - self._times[index]
        return duration, self._speeds[index], self._accelerations[index], self._jerks[index]

    def at(self, time: float) -> ProfilePoint:
        """The motion at a time [s]; before the beginning and after the end, at rest there.

        Raises:
            InputError: If the time is not a number.
        """
        if math.isnan(time):
            raise InputError("time: nan, must be a number [s]")
        if time < 0.0:
            return ProfilePoint(0.0, 0.0, 0.0)
        if time >= self.duration:
            return ProfilePoint(self.length, self.end_speed if time == self.duration else 0.0, 0.0)
        k = bisect_right(self._times, time) - 1
        t = time - self._times[k]
        speed, acceleration, jerk = self._speeds[k], self._accelerations[k], self._jerks[k]
        return ProfilePoint(
            self._distances[k] + t * (speed + t * (acceleration / 2.0 + t * jerk / 6.0)),
            speed + t * (acceleration + t * jerk / 2.0),
            acceleration + t * jerk,
        )

    def __add__(self, other: Profile) -> Profile:
        """This motion, then the other."""
        if not isinstance(other, Profile):
            return NotImplemented
        parts = [part.phase(k) for part in (self, other) for k in range(len(part._jerks))]
        return Profile(parts)

    def smoothed(self, window: float) -> Profile:
        """The same distance, with the speed averaged over a window of time: jerk is limited then.

        Averaging keeps every limit on speed and acceleration. The motion takes `window` longer.

        Args:
            window: [s].

        Returns:
            Phases of constant jerk, exactly: where the speed is a polyline, its mean is a parabola.

        Raises:
            InputError: If this has jerk already, or does not begin and end at rest.
        """
        require_positive("window", window)
        if any(self._jerks) or abs(self._speeds[0]) > 1e-9 or abs(self.end_speed) > 1e-9:
            raise InputError("smoothed: only motions from rest to rest, in phases of constant acceleration")
        phases = []
        acceleration = speed = 0.0
        for begin, end in pairwise(_breaks(self._times, window)):
            middle, duration = 0.5 * (begin + end), end - begin
            jerk = (self.at(middle).acceleration - self.at(middle - window).acceleration) / window
            phases.append((duration, speed, acceleration, jerk))
            speed += duration * (acceleration + duration * jerk / 2.0)
            acceleration += duration * jerk
        return Profile(phases)

    @property
    def greatest_jerk(self) -> float:
        """[m/s^3]; jumps of the acceleration do not count."""
        return max(map(abs, self._jerks))


def _breaks(times: Sequence[float], window: float) -> list[float]:
    """All times, and all of them a window later, in order and without repetition."""
    merged = sorted([*times, *(time + window for time in times)])
    least = 1e-12 * (merged[-1] + window)
    kept = merged[:1]
    for time in merged[1:]:
        if time - kept[-1] > least:
            kept.append(time)
    return kept


def trapezoid(
    distance: float,
    *,
    max_speed: float,
    max_acceleration: float,
    max_deceleration: float | None = None,
    start_speed: float = 0.0,
    end_speed: float = 0.0,
) -> Profile:
    """The fastest motion over a distance with limited speed and acceleration.

    Args:
        distance: [m].
        max_speed: [m/s].
        max_acceleration: Speeding up [m/s^2].
        max_deceleration: Slowing down [m/s^2]; the acceleration where it is not given.
        start_speed: [m/s].
        end_speed: [m/s].

    Raises:
        ConfigError: If a limit or the distance is not above zero.
        InputError: If a speed is beyond the limit, or the distance too short to change it so much.
    """
    require_positive("distance", distance)
    top = require_positive("max_speed", max_speed)
    up = require_positive("max_acceleration", max_acceleration)
    down = up if max_deceleration is None else require_positive("max_deceleration", max_deceleration)
    for name, speed in (("start_speed", start_speed), ("end_speed", end_speed)):
        if not 0.0 <= speed <= top:
            raise InputError(f"{name}: {speed!r} m/s, must be from 0 to max_speed ({top:g})")
    # Where speeding up from the start and slowing down to the end would meet.
    square = (2.0 * up * down * distance + down * start_speed**2 + up * end_speed**2) / (up + down)
    peak = min(top, math.sqrt(square))
    if peak < max(start_speed, end_speed) * (1.0 - 1e-12):
        raise InputError(
            f"trapezoid: {distance:g} m are too short to go from {start_speed:g} to {end_speed:g} m/s"
        )
    rising, falling = max(peak - start_speed, 0.0) / up, max(peak - end_speed, 0.0) / down
    slopes = 0.5 * (start_speed + peak) * rising + 0.5 * (peak + end_speed) * falling
    level = max(distance - slopes, 0.0) / peak
    phases = ((rising, start_speed, up, 0.0), (level, peak, 0.0, 0.0), (falling, peak, -down, 0.0))
    return Profile(phase for phase in phases if phase[0] > 0.0)


def s_curve(
    distance: float,
    *,
    max_speed: float,
    max_acceleration: float,
    max_jerk: float,
    max_deceleration: float | None = None,
) -> Profile:
    """A motion from rest to rest with limited speed, acceleration and jerk.

    A trapezoid, smoothed over the shortest window that keeps the jerk: time-optimal where it cruises
    for a while; a short hop, where braking begins while speeding up ends, takes a little longer.

    Args:
        distance: [m].
        max_speed: [m/s].
        max_acceleration: [m/s^2].
        max_jerk: [m/s^3].
        max_deceleration: [m/s^2]; the acceleration where it is not given.

    Raises:
        ConfigError: If a limit or the distance is not above zero.
    """
    jerk = require_positive("max_jerk", max_jerk)
    plain = trapezoid(
        distance, max_speed=max_speed, max_acceleration=max_acceleration, max_deceleration=max_deceleration
    )
    down = max_acceleration if max_deceleration is None else max_deceleration
    quick = plain.smoothed(max(max_acceleration, down) / jerk)
    if quick.greatest_jerk <= jerk * (1.0 + 1e-9):
        return quick
    return plain.smoothed((max_acceleration + down) / jerk)
