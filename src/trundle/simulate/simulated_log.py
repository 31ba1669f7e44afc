"""A whole drive at once: a robot and a course in, a log with known truth out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, did_you_mean, require_finite, require_positive, require_type
from trundle.geometry import Pose2D
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Kinematics, Noise, Robot
from trundle.simulate.course import Course
from trundle.simulate.quadrature import Quadrature
from trundle.simulate.sensor_noise import (
    Gyro,
    Seed,
    Source,
    draw_body_slip,
    draw_gyro_errors,
    draw_steering_errors,
    draw_wheel_errors,
    generator,
    ticks_of,
)
from trundle.simulate.wheel_motion import rolling_rates, steering_angles

__all__ = ["WheelSlip", "simulate"]

Floats = npt.NDArray[np.float64]


class WheelSlip(msgspec.Struct, frozen=True, kw_only=True):
    """One wheel turns more, or less, than the ground goes by.

    Attributes:
        wheel: Its name.
        start: When it begins to slip [s].
        stop: When it grips again [s].
        factor: What it turns per what it would: 1.2 spins, 0 is locked.
    """

    wheel: str
    start: float
    stop: float
    factor: float

    def __post_init__(self) -> None:
        for field in ("start", "stop", "factor"):
            require_finite(field, getattr(self, field))


def simulate(
    robot: Robot | Kinematics,
    course: Course,
    *,
    rate: float = 50.0,
    seed: Seed = 0,
    noise: Noise | None = None,
    slips: Sequence[WheelSlip] = (),
    gyro: Gyro | None = None,
    reading: Reading | None = None,
    jitter: float = 0.0,
    stamp_jitter: float = 0.0,
    dropped: float = 0.0,
    start: Pose2D | None = None,
    start_ns: int = 0,
) -> WheelLog:
    """What a robot's sensors say while it drives a course, and where it really was.

    The robot that is given is the true one: describe it with the numbers that it has, and track its
    log with the numbers that somebody believes. Wheels roll as the course wants; lateral slip moves
    the body over the ground and they do not notice; wheel noise and slipping wheels are in the
    readings alone.

    Args:
        robot: Whose wheels are read: its localizer's, or its drive's measured ones.
        course: Body twist over time. The robot's reference point moves with it.
        rate: Rows per second [Hz].
        seed: The same seed gives the same log, whatever else runs.
        noise: None means what the robot's description says; `NOISELESS` means none.
        slips: Wheels that lose their grip.
        gyro: A yaw rate sensor; without one, a perfect one up to `noise.gyro` if the robot declares any.
        reading: What wheels say; None means ticks where every wheel has an encoder, else positions,
            which like velocities are not quantised.
        jitter: Rows are taken up to this early or late, and stamped with when they were [s].
        stamp_jitter: Standard deviation of what stamps are wrong by [s]; the truth keeps right ones.
        dropped: Share of rows that get lost, the first excepted; 0 to below 1.
        start: Where it begins.
        start_ns: Stamp of the first row.

    Returns:
        Readings, with the truth as `reference`, row by row.

    Raises:
        Infeasible: If the drive cannot move like that.
        InputError: If an argument is impossible.
        ConfigError: If rate is not above zero.
    """
    described = robot if isinstance(robot, Robot) else Robot(drive=robot)
    require_type("simulate", "course", course, Course)
    noise = described.noise if noise is None else noise
    drive, measuring = described.drive, described.measuring
    _check(measuring, slips, stamp_jitter, dropped)
    clock = generator(seed, Source.CLOCK)
    time_ns = _instants(course.duration, rate, jitter, clock)
    edges = [moment for slip in slips for moment in (slip.start, slip.stop)]
    integral = Quadrature(1e-9 * time_ns.astype(np.float64), [*course.knots, *edges])

    wanted = _Along(
        course.at(integral.nodes.ravel()).reshape(*integral.nodes.shape, 3), course.at(integral.samples)
    )
    driven = _steering(drive, wanted, integral)
    true = wanted
    if noise.lateral_slip:
        true = _slipping(wanted, driven, generator(seed, Source.GROUND), drive, noise, integral)
    # Wheels that drive roll as the course wants; others roll as the body moves.
    felt = wanted if measuring is drive else true
    steering = driven if measuring is drive else _steering(measuring, felt, integral)
    sensors = _Sensors(described, noise, seed, integral)

    kind, wheels = sensors.wheels(felt, steering, slips, reading)
    angles = sensors.steering(felt, steering)
    if measuring.gyro:
        gyro = gyro or Gyro()
    yaw_rate = None if gyro is None else sensors.yaw_rate(true, gyro)
    begin = start or Pose2D()
    poses = integral.poses(true.nodes, (begin.x, begin.y, begin.theta))
    stamps = time_ns + np.rint(stamp_jitter * 1e9 * clock.standard_normal(len(time_ns))).astype(np.int64)
    kept = generator(seed, Source.LOSS).random(len(time_ns)) >= dropped
    kept[0] = True
    return WheelLog(
        time_ns=start_ns + stamps[kept],
        wheel_names=measuring.measured_names,
        wheels=wheels[kept],
        reading=kind,
        steering_names=measuring.steered_names,
        steering=None if angles is None else angles[kept],
        yaw_rate=None if yaw_rate is None else yaw_rate[kept],
        reference=Trajectory(time_ns=start_ns + time_ns[kept], poses=poses[kept], twists=true.samples[kept]),
    )


class _Along(NamedTuple):
    """Values along a motion.

    Attributes:
        nodes: At the nodes of a quadrature, shape (sub-steps, 3, ...).
        samples: At its samples, shape (samples, ...).
    """

    nodes: Floats
    samples: Floats


def _check(measuring: Kinematics, slips: Sequence[WheelSlip], stamp_jitter: float, dropped: float) -> None:
    for slip in slips:
        if slip.wheel not in measuring.measured_names:
            raise InputError(f"slips: {slip.wheel!r}, {did_you_mean(slip.wheel, measuring.measured_names)}")
    if not 0.0 <= dropped < 1.0:
        raise InputError(f"dropped: {dropped!r}, must be a share from 0 to below 1")
    if not 0.0 <= stamp_jitter < math.inf:
        raise InputError(f"stamp_jitter: {stamp_jitter!r}, must be seconds >= 0")


def _instants(
    duration: float, rate: float, jitter: float, clock: np.random.Generator
) -> npt.NDArray[np.int64]:
    """When rows are taken [ns], the first at 0."""
    period = 1.0 / require_positive("rate", rate)
    if not 0.0 <= jitter < 0.5 * period:
        raise InputError(f"jitter: {jitter!r} s, must be from 0 to below half a period ({0.5 * period:g} s)")
    count = math.floor(duration * rate * (1.0 + 1e-12)) + 1
    if count < 2:
        raise InputError(f"rate: {rate:g} Hz gives one row in {duration:g} s, must give two or more")
    early_or_late = jitter * clock.uniform(-1.0, 1.0, count)
    early_or_late[0] = 0.0
    instants: npt.NDArray[np.int64] = np.rint((np.arange(count) * period + early_or_late) * 1e9).astype(
        np.int64
    )
    return instants


def _steering(drive: Kinematics, twists: _Along, integral: Quadrature) -> _Along:
    """Steering angles of a drive, which depend on what came before: nodes and samples in order of time."""
    moments = np.concatenate([integral.nodes.ravel(), integral.samples])
    order = np.argsort(moments, kind="stable")
    angles = np.empty((len(moments), len(drive.steered_names)))
    angles[order] = steering_angles(
        drive, np.concatenate([twists.nodes.reshape(-1, 3), twists.samples])[order]
    )
    nodes = angles[: integral.nodes.size].reshape(*integral.nodes.shape, -1)
    return _Along(nodes, angles[integral.nodes.size :])


def _slipping(
    twists: _Along,
    steering: _Along,
    chance: np.random.Generator,
    drive: Kinematics,
    noise: Noise,
    integral: Quadrature,
) -> _Along:
    """The twists with the slip of the ground: one velocity from sample to sample."""
    steps = np.diff(integral(twists.nodes), axis=0)
    middle = 0.5 * (steering.samples[1:] + steering.samples[:-1])
    slip = draw_body_slip(chance, drive, noise, middle, steps) / np.diff(integral.samples)[:, np.newaxis]
    before, after = np.concatenate([slip[:1], slip]), np.concatenate([slip, slip[-1:]])
    return _Along(
        twists.nodes + slip[integral.interval][:, np.newaxis], twists.samples + 0.5 * (before + after)
    )


def _slipped(rates: _Along, slip: WheelSlip, drive: Kinematics, integral: Quadrature) -> _Along:
    """The rates of all wheels while one of them has no grip."""
    wheel = np.asarray([name == slip.wheel for name in drive.measured_names])

    def factor(moments: Floats) -> Floats:
        during = (moments >= slip.start) & (moments < slip.stop)
        return np.where(during[..., np.newaxis] & wheel, slip.factor, 1.0)

    return _Along(rates.nodes * factor(integral.nodes), rates.samples * factor(integral.samples))


def _contact_speeds(drive: Kinematics, twists: Floats) -> Floats:
    """How fast the contacts of the steered wheels move [m/s]."""
    vx, vy, omega = twists[..., 0], twists[..., 1], twists[..., 2]
    wheels = [drive.wheel(name) for name in drive.steered_names]
    return np.stack([np.hypot(vx - omega * wheel.y, vy + omega * wheel.x) for wheel in wheels], axis=-1)


class _Sensors:
    """What sensors say of a motion, errors included."""

    def __init__(self, robot: Robot, noise: Noise, seed: Seed, integral: Quadrature) -> None:
        self.robot = robot
        self.drive = robot.measuring
        self.noise = noise
        self.seed = seed
        self.integral = integral

    def wheels(
        self, twists: _Along, steering: _Along, slips: Sequence[WheelSlip], reading: Reading | None
    ) -> tuple[Reading, npt.NDArray[Any]]:
        """Rotation of the measured wheels, and what it is given as."""
        names = self.drive.measured_names
        if reading is None:
            counted = all(name in self.robot.encoders for name in names)
            reading = Reading.TICKS if counted else Reading.POSITION
        rates = _Along(*(rolling_rates(self.drive, t, s) for t, s in zip(twists, steering, strict=True)))
        for slip in slips:
            rates = _slipped(rates, slip, self.drive, self.integral)
        errors = self._wheel_errors(rates)
        if reading is Reading.VELOCITY:
            seconds = np.diff(self.integral.samples)[:, np.newaxis]
            return reading, rates.samples + np.concatenate([np.zeros_like(errors[:1]), errors[1:] / seconds])
        positions = self.integral(rates.nodes) + np.cumsum(errors, axis=0)
        if reading is Reading.INCREMENT:
            return reading, np.diff(positions, axis=0, prepend=positions[:1])
        if reading is Reading.TICKS:
            columns = zip(self.robot.encoders_of(names), positions.T, strict=True)
            return reading, np.stack([ticks_of(encoder, column) for encoder, column in columns], axis=-1)
        return reading, positions

    def _wheel_errors(self, rates: _Along) -> Floats:
        """Of what the wheels turned since the sample before [rad]; none at the first."""
        rolled = np.diff(self.integral(np.abs(rates.nodes)), axis=0)
        radii = [self.drive.wheel(name).radius for name in self.drive.measured_names]
        errors = draw_wheel_errors(generator(self.seed, Source.WHEELS), self.noise, radii, rolled)
        return np.concatenate([np.zeros_like(errors[:1]), errors])

    def steering(self, twists: _Along, steering: _Along) -> Floats | None:
        """Measured steering angles [rad]; None where nothing steers."""
        if not self.drive.steered_names:
            return None
        ways = np.diff(self.integral(_contact_speeds(self.drive, twists.nodes)), axis=0)
        chance = generator(self.seed, Source.STEERING)
        return steering.samples + draw_steering_errors(chance, self.noise, ways)

    def yaw_rate(self, twists: _Along, gyro: Gyro) -> Floats:
        """What the gyro shows [rad/s]."""
        # The first sample has as long a past as the second.
        seconds = np.diff(self.integral.samples)
        seconds = np.concatenate([seconds[:1], seconds])
        white, wander = draw_gyro_errors(generator(self.seed, Source.GYRO), self.noise, gyro, seconds)
        return gyro.scale * twists.samples[:, 2] + gyro.bias + np.cumsum(wander) + white
