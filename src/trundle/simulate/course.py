"""Where a simulated robot goes: a body twist for every moment."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.errors import (
    ConfigError,
    InputError,
    ShapeError,
    require_finite,
    require_positive,
    row_of,
    shown,
)

__all__ = [
    "Course",
    "Manoeuvre",
    "arc",
    "figure_eight",
    "glide",
    "hold",
    "slalom",
    "slide",
    "spin",
    "square",
    "stop",
    "straight",
]

Floats = npt.NDArray[np.float64]
TwistOfTime = Callable[[Floats], Floats]


@dataclass(frozen=True, slots=True)
class Manoeuvre:
    """One thing that a robot does.

    Attributes:
        duration: How long it takes [s].
        twists: Body twists (n, 3) at times (n,) [s] since it began. They are asked for a little
            before the beginning and after the end too, where neighbours are blended.
    """

    duration: float
    twists: TwistOfTime

    def __post_init__(self) -> None:
        require_positive("duration", self.duration)


@dataclass(frozen=True, slots=True)
class Course:
    """A body twist for every moment from 0 to `duration`.

    Attributes:
        twists: Body twists (vx, vy, omega) [m/s, m/s, rad/s], shape (n, 3), at times (n,) [s].
        duration: [s].
        knots: Moments at which the twists are not smooth [s].
    """

    twists: TwistOfTime
    duration: float
    knots: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        require_positive("duration", self.duration)

    @classmethod
    def of(cls, *manoeuvres: Manoeuvre | Iterable[Manoeuvre], blend: float = 0.5) -> Course:
        """Manoeuvres one after the other, from rest to rest.

        Each fades into the next over `blend` seconds, acceleration and jerk beginning and ending at
        zero or finite. A constant twist keeps its integral, so turns turn by what they say, and
        lengths are as long as they say; corners are cut a little.

        Args:
            *manoeuvres: Manoeuvres, or lists of them.
            blend: [s].

        Raises:
            ConfigError: If there are none, or blend is not above zero.
        """
        require_positive("blend", blend)
        pieces: list[Manoeuvre] = []
        for entry in manoeuvres:
            listed = [entry] if isinstance(entry, Manoeuvre) else row_of(entry)
            if listed is None or not all(isinstance(one, Manoeuvre) for one in listed):
                raise ConfigError("manoeuvres", f"{shown(entry)}, must be Manoeuvres or lists of them")
            pieces += listed
        if not pieces:
            raise ConfigError("manoeuvres", "none given, a course needs at least one")
        starts = np.concatenate([[0.0], np.cumsum([piece.duration for piece in pieces])])

        def twists(time: Floats) -> Floats:
            total = np.zeros((len(time), 3))
            risen = _smooth_step(time / blend)
            for piece, start, end in zip(pieces, starts[:-1], starts[1:], strict=True):
                fallen = _smooth_step((time - end) / blend)
                present = np.flatnonzero(risen != fallen)
                local = piece.twists(time[present] - start - 0.5 * blend)
                total[present] += (risen - fallen)[present, np.newaxis] * local
                risen = fallen
            return total

        knots = sorted({*starts.tolist(), *(starts + blend).tolist()})
        return cls(twists, float(starts[-1]) + blend, tuple(knots))

    def at(self, time: Floats) -> Floats:
        """Body twists at these times [s], shape (n, 3).

        Raises:
            ShapeError: If the course gives another shape.
            InputError: If it gives numbers that are not finite.
        """
        twists = np.asarray(self.twists(time), dtype=np.float64)
        if twists.shape != (len(time), 3):
            raise ShapeError(f"course: twists of shape {twists.shape}, must be {(len(time), 3)}")
        if not np.isfinite(twists).all():
            bad = int(np.argmin(np.isfinite(twists).all(axis=1)))
            raise InputError(f"course: twist {twists[bad]} at {time[bad]:g} s, must be finite")
        return twists


def hold(duration: float, *, vx: float = 0.0, vy: float = 0.0, omega: float = 0.0) -> Manoeuvre:
    """One body twist [m/s, m/s, rad/s] for some time [s]."""
    twist = np.array([require_finite("vx", vx), require_finite("vy", vy), require_finite("omega", omega)])
    return Manoeuvre(duration, lambda time: np.broadcast_to(twist, (len(time), 3)))


def stop(duration: float) -> Manoeuvre:
    """Standing still [s]."""
    return hold(duration)


def straight(distance: float, speed: float) -> Manoeuvre:
    """Straight on [m]; backwards where the distance is negative. `speed` [m/s] is above zero."""
    return slide(distance, 0.0, speed)


def slide(forward: float, left: float, speed: float) -> Manoeuvre:
    """A straight way to a point (forward, left) [m] without turning, for drives that can."""
    distance = math.hypot(require_finite("forward", forward), require_finite("left", left))
    duration = require_positive("distance", distance) / require_positive("speed", speed)
    return hold(duration, vx=forward / duration, vy=left / duration)


def arc(radius: float, angle: float, speed: float) -> Manoeuvre:
    """Part of a circle.

    Args:
        radius: [m], above zero.
        angle: By which the heading changes [rad], left positive.
        speed: [m/s]; negative drives backwards.
    """
    length = abs(require_finite("angle", angle)) * require_positive("radius", radius)
    duration = require_positive("length", length) / require_positive(
        "speed", abs(require_finite("speed", speed))
    )
    return hold(duration, vx=speed, omega=angle / duration)


def spin(angle: float, yaw_rate: float) -> Manoeuvre:
    """On the spot by an angle [rad], left positive. `yaw_rate` [rad/s] is above zero."""
    size = require_positive("angle", abs(require_finite("angle", angle)))
    duration = size / require_positive("yaw_rate", yaw_rate)
    return hold(duration, omega=angle / duration)


def slalom(distance: float, speed: float, *, heading: float, wavelength: float) -> Manoeuvre:
    """Swinging left and right: heading(s) = heading * sin(2 pi s / wavelength).

    Args:
        distance: Length of the path [m]; a whole number of wavelengths ends as it began.
        speed: [m/s].
        heading: Greatest heading either way [rad].
        wavelength: Length of the path of one swing [m].
    """
    rate = math.tau * require_positive("speed", speed) / require_positive("wavelength", wavelength)
    greatest = require_finite("heading", heading) * rate

    def twists(time: Floats) -> Floats:
        return np.stack(
            [np.full(len(time), speed), np.zeros(len(time)), greatest * np.cos(rate * time)], axis=-1
        )

    return Manoeuvre(require_positive("distance", distance) / speed, twists)


def glide(distance: float, speed: float, *, yaw_rate: float, direction: float = 0.0) -> Manoeuvre:
    """A straight way while spinning, for drives that can.

    Args:
        distance: [m].
        speed: [m/s].
        yaw_rate: [rad/s].
        direction: Of the way, from the heading that the robot begins with [rad].
    """
    require_positive("speed", speed)
    rate, first = require_finite("yaw_rate", yaw_rate), require_finite("direction", direction)

    def twists(time: Floats) -> Floats:
        toward = first - rate * time
        return np.stack([speed * np.cos(toward), speed * np.sin(toward), np.full(len(time), rate)], axis=-1)

    return Manoeuvre(require_positive("distance", distance) / speed, twists)


def square(
    side: float, speed: float, *, yaw_rate: float = 1.0, radius: float = 0.0, clockwise: bool = False
) -> list[Manoeuvre]:
    """Four sides [m] and four corners.

    Args:
        side: Length of each straight part [m].
        speed: [m/s].
        yaw_rate: In corners that are turned on the spot [rad/s].
        radius: Of corners that are driven, for cars [m]; 0 turns on the spot.
        clockwise: Right turns in place of left ones.
    """
    quarter = -math.pi / 2 if clockwise else math.pi / 2
    corner = arc(radius, quarter, speed) if radius else spin(quarter, yaw_rate)
    return [straight(side, speed), corner] * 4


def figure_eight(radius: float, speed: float) -> list[Manoeuvre]:
    """A circle [m] to the left, then one to the right."""
    return [arc(radius, math.tau, speed), arc(radius, -math.tau, speed)]


def _smooth_step(fraction: Floats) -> Floats:
    """0 up to 0, 1 from 1 on, with two continuous derivatives in between."""
    x = np.clip(fraction, 0.0, 1.0)
    return x * x * x * (x * (6.0 * x - 15.0) + 10.0)
