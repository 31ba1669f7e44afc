"""What chance does to wheels, steering, gyro and ground: the noise of `robot.Noise`, drawn.

Everything grows with distance as odometry's covariance expects it to, however finely it is sampled.
Each source draws from a generator of its own, so that one can change without moving the others.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, require_finite
from trundle.robot import Encoder, Kinematics, Noise, WheelKind
from trundle.robot.observability import length_scale

__all__ = [
    "NOISELESS",
    "Gyro",
    "Seed",
    "Source",
    "draw_body_slip",
    "draw_gyro_errors",
    "draw_steering_errors",
    "draw_wheel_errors",
    "generator",
    "ticks_of",
]

Floats = npt.NDArray[np.float64]
Seed = int | Sequence[int]

NOISELESS = Noise(wheel_distance=0.0, lateral_slip=0.0, steering=0.0, gyro=0.0)
"""Readings without error."""

_MEMORY = 0.5
"""Distance [m] after which a steering angle's error has forgotten itself by 1/e: its integral then
grows by `steering^2 * 1 m` per metre, which is what odometry assumes."""


class Source(enum.IntEnum):
    """Where chance comes in. The numbers belong to the seed: they may never change."""

    WHEELS = 0
    GROUND = 1
    STEERING = 2
    GYRO = 3
    CLOCK = 4
    LOSS = 5


class Gyro(msgspec.Struct, frozen=True, kw_only=True):
    """A yaw rate sensor; its white noise stands in `Noise.gyro`.

    Attributes:
        bias: What it shows at rest [rad/s].
        bias_walk: How that wanders [rad/s per sqrt(s)].
        scale: What it shows per rad/s.
    """

    bias: float = 0.0
    bias_walk: float = 0.0
    scale: float = 1.0

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            require_finite(field, getattr(self, field))


def generator(seed: Seed, source: Source) -> np.random.Generator:
    """The generator of one source of chance.

    Args:
        seed: A whole number >= 0, or several, e.g. (seed of the fleet, number of the robot).
        source: What it draws for.

    Raises:
        InputError: If the seed is something else.
    """
    try:
        sequence = np.random.SeedSequence(seed, spawn_key=(int(source),))
    except (TypeError, ValueError):
        raise InputError(f"seed: {seed!r}, must be whole numbers >= 0") from None
    return np.random.Generator(np.random.PCG64(sequence))


def draw_wheel_errors(
    chance: np.random.Generator, noise: Noise, radii: Sequence[float], rolled: Floats
) -> Floats:
    """Errors of what wheels turned [rad], shape (n, wheels).

    Args:
        chance: Generator.
        noise: Its `wheel_distance`.
        radii: Of the wheels [m].
        rolled: Angles that they turned, forth and back alike [rad], shape (n, wheels).
    """
    errors: Floats = (
        noise.wheel_distance * np.sqrt(rolled / np.asarray(radii)) * chance.standard_normal(rolled.shape)
    )
    return errors


def draw_body_slip(
    chance: np.random.Generator, drive: Kinematics, noise: Noise, steering: Floats, steps: Floats
) -> Floats:
    """Displacements of the body that its wheels do not notice, shape (n, 3).

    Args:
        chance: Generator.
        drive: Whose wheels deny them.
        noise: Its `lateral_slip`.
        steering: Steering angles in the middle of the steps [rad], shape (n, steered).
        steps: Displacements without slip (x, y, theta), shape (n, 3).
    """
    gains = drive.gains(list(steering.T), np, gyro=drive.gyro and not drive.observable_without_gyro)
    dx, dy, turn = steps.T
    contacts = [drive.wheel(name) for name in drive.steered_names]
    *_, lever = length_scale([(w.x, w.y) for w in drive.wheels if w.kind is not WheelKind.CASTER])
    distances = [np.hypot(dx - turn * wheel.y, dy + turn * wheel.x) for wheel in contacts]
    distances += [np.hypot(dx, dy) + lever * np.abs(turn)] * len(gains.slip)
    drawn = chance.standard_normal((len(steps), len(distances)))
    slip = np.zeros_like(steps)
    for k, (column, distance) in enumerate(zip([*gains.sideways, *gains.slip], distances, strict=True)):
        amount = noise.lateral_slip * np.sqrt(distance) * drawn[:, k]
        for i in range(3):
            slip[:, i] += column[i] * amount
    return slip


def draw_steering_errors(
    chance: np.random.Generator, noise: Noise, distances: Floats, before: Floats | None = None
) -> Floats:
    """Errors of steering angles [rad] before, between and after n steps, shape (n + 1, steered).

    An angle's error wanders about zero with the distance that its wheel goes, and stays while it
    stands: an Ornstein-Uhlenbeck process of standard deviation `noise.steering`.

    Args:
        chance: Generator.
        noise: Its `steering`.
        distances: That the wheels went in each step [m], shape (n, steered).
        before: Errors before the first step, shape (steered,) or (1, steered); drawn where there are none.
    """
    count, wheels = distances.shape
    errors = np.empty((count + 1, wheels))
    errors[0] = noise.steering * chance.standard_normal(wheels) if before is None else before
    kept = np.exp(-distances / _MEMORY)
    fresh = noise.steering * np.sqrt(1.0 - kept * kept) * chance.standard_normal(distances.shape)
    for row in range(count):
        errors[row + 1] = kept[row] * errors[row] + fresh[row]
    return errors


def draw_gyro_errors(
    chance: np.random.Generator, noise: Noise, gyro: Gyro, seconds: Floats
) -> tuple[Floats, Floats]:
    """White noise, and the change of the bias, of yaw rates sampled after these times [rad/s]."""
    drawn = chance.standard_normal((len(seconds), 2))
    return noise.gyro / np.sqrt(seconds) * drawn[:, 0], gyro.bias_walk * np.sqrt(seconds) * drawn[:, 1]


def ticks_of(encoder: Encoder, positions: Any) -> npt.NDArray[np.int64]:
    """What a counter shows at these wheel angles [rad].

    It begins at 0 in the middle of a tick. Counters of up to 63 bits count from 0 to 2^bits - 1.
    """
    ticks: npt.NDArray[np.int64] = np.floor(positions / encoder.radians_per_tick + 0.5).astype(np.int64)
    if encoder.bits is None or encoder.bits == 64:
        return ticks
    wrapped: npt.NDArray[np.int64] = ticks & np.int64((1 << encoder.bits) - 1)
    return wrapped
