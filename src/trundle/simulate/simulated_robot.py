"""A robot that does not exist and takes one wheel command after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.errors import (
    ConfigError,
    InputError,
    ShapeError,
    require_finite,
    require_numbers,
    require_positive,
    require_type,
    shown,
)
from trundle.geometry import Pose2D, Twist2D
from trundle.robot import Kinematics, Noise, Robot, WheelCommand
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
from trundle.simulate.wheel_motion import rolling_rate

__all__ = ["SimulatedReading", "SimulatedRobot"]

Floats = npt.NDArray[np.float64]


class SimulatedReading(msgspec.Struct, frozen=True, gc=False):
    """What the sensors say after a step; it fits `WheelOdometry.update`.

    Attributes:
        time_ns: Stamp [ns].
        positions: Cumulative wheel angles [rad], in `measured_names` order; not quantised.
        ticks: The same as encoders count it, or empty where a wheel has none.
        steering: Steering angles [rad], in `steered_names` order.
        yaw_rate: At the stamp [rad/s], or None without a gyro.
    """

    time_ns: int
    positions: tuple[float, ...]
    ticks: tuple[int, ...] = ()
    steering: tuple[float, ...] = ()
    yaw_rate: float | None = None


class SimulatedRobot:
    """A body on wheels that follow commands, for loops that are to be closed.

    Each wheel's motor takes its set point at no more than `max_wheel_acceleration` and follows it
    with a first-order lag; each steering motor turns at no more than `max_steering_rate`. The body
    moves as the drive's measured wheels say, on an arc from step to step.

    Args:
        robot: The true one; see `simulate`.
        seed: The same seed and commands give the same readings.
        noise: None means what the robot's description says; `NOISELESS` means none.
        gyro: As for `simulate`.
        lag: Time constant of the wheels' speed [s].
        max_wheel_acceleration: [rad/s^2].
        max_steering_rate: [rad/s].
        pose: Where it begins.
        time_ns: Time at which it begins [ns].

    Attributes:
        pose: Where it really is.
        twist: How its body really moved over the last step, on average.
        time_ns: Its time.
        speeds: Of all wheels [rad/s], in `wheel_names` order.
        steering: Of all steered wheels [rad], in `steered_names` order.

    Raises:
        ConfigError: If a limit is impossible.
    """

    def __init__(
        self,
        robot: Robot | Kinematics,
        *,
        seed: Seed = 0,
        noise: Noise | None = None,
        gyro: Gyro | None = None,
        lag: float = 0.0,
        max_wheel_acceleration: float = math.inf,
        max_steering_rate: float = math.inf,
        pose: Pose2D | None = None,
        time_ns: int = 0,
    ) -> None:
        self.robot = robot if isinstance(robot, Robot) else Robot(drive=robot)
        self.noise = self.robot.noise if noise is None else noise
        drive, measuring = self.robot.drive, self.robot.measuring
        if require_finite("lag", lag) < 0.0:
            raise ConfigError("lag", f"{lag:g}, must be >= 0")
        self._lag = lag
        self._most_acceleration = _limit("max_wheel_acceleration", max_wheel_acceleration)
        self._most_steering_rate = _limit("max_steering_rate", max_steering_rate)
        self.pose = pose or Pose2D()
        self.twist = Twist2D()
        self.time_ns = time_ns
        self.speeds = (0.0,) * len(drive.wheel_names)
        self.steering = (0.0,) * len(drive.steered_names)
        self._set_points = self.speeds
        self._wheels = [measuring.wheel(name) for name in measuring.measured_names]
        self._radii = [wheel.radius for wheel in self._wheels]
        counted = all(name in self.robot.encoders for name in measuring.measured_names)
        self._encoders = self.robot.encoders_of(measuring.measured_names) if counted else ()
        self._positions = [0.0] * len(self._wheels)
        self._gyro = (gyro or Gyro()) if gyro is not None or measuring.gyro else None
        self._bias = self._gyro.bias if self._gyro else 0.0
        self._yaw_rate = self._bias if self._gyro else None
        self._chance = {source: generator(seed, source) for source in Source}
        self._angle_errors = self._wandered(None, np.zeros((0, len(measuring.steered_names))))

    def step(self, command: WheelCommand, dt: float) -> SimulatedReading:
        """Drive for a while.

        Args:
            command: Speeds and steering angles that the motors are to reach.
            dt: For how long [s].

        Returns:
            The readings at the end of it.

        Raises:
            InputError: If a number is not finite, or dt not above zero.
            ShapeError: If the command is not one for this drive.
            Unobservable: If at these steering angles the measured wheels leave the motion open.
        """
        drive = self.robot.drive
        self._check(command, dt)
        middle = self._steer(command.steering, dt)
        turned = self._turn(command.speeds, dt)
        rolled = drive.forward(WheelCommand(tuple([angle / dt for angle in turned]), middle))
        self.twist = self._slipping(rolled, middle, dt)
        if self._gyro is not None:
            end = drive.forward(WheelCommand(self.speeds, self.steering))
            self._yaw_rate = self._feel(end.omega + self.twist.omega - rolled.omega, self._gyro, dt)
        self.pose = self.pose @ Pose2D.exp(self.twist * dt)
        self.time_ns += round(dt * 1e9)
        return self._read(turned, rolled, dt)

    def reading(self) -> SimulatedReading:
        """What the sensors say before the first step."""
        return self._reading(
            self.steering
            if self.robot.measuring is self.robot.drive
            else (0.0,) * len(self.robot.measuring.steered_names)
        )

    def _check(self, command: WheelCommand, dt: float) -> None:
        require_type("step", "command", command, WheelCommand)
        if not (isinstance(dt, Real) and 0.0 < dt < math.inf):
            raise InputError(f"dt: {shown(dt)}, must be seconds > 0")
        drive = self.robot.drive
        for field, values, names in (
            ("speeds", command.speeds, drive.wheel_names),
            ("steering", command.steering, drive.steered_names),
        ):
            require_numbers("step", row={field: values})
            if len(values) != len(names):
                raise ShapeError(f"{field}: {len(values)} values, must be {len(names)} {names}")
            if not math.isfinite(math.fsum(values)):
                raise InputError(f"{field}: {tuple(values)}, must be finite")

    def _steer(self, wanted: Sequence[float], dt: float) -> tuple[float, ...]:
        """Turn the steering motors; the angles in the middle of the step."""
        before = self.steering
        most = self._most_steering_rate * dt
        self.steering = tuple([_towards(now, angle, most) for now, angle in zip(before, wanted, strict=True)])
        return tuple([0.5 * (a + b) for a, b in zip(before, self.steering, strict=True)])

    def _turn(self, wanted: Sequence[float], dt: float) -> list[float]:
        """Run the wheel motors; what each wheel turned [rad]."""
        most = self._most_acceleration * dt
        self._set_points = tuple(
            [_towards(now, speed, most) for now, speed in zip(self._set_points, wanted, strict=True)]
        )
        kept = math.exp(-dt / self._lag) if self._lag else 0.0
        behind = [speed - goal for speed, goal in zip(self.speeds, self._set_points, strict=True)]
        self.speeds = tuple([goal + kept * rest for goal, rest in zip(self._set_points, behind, strict=True)])
        slide = self._lag * (1.0 - kept)
        return [goal * dt + rest * slide for goal, rest in zip(self._set_points, behind, strict=True)]

    def _slipping(self, rolled: Twist2D, steering: Sequence[float], dt: float) -> Twist2D:
        """The twist with the slip that no wheel notices."""
        if not self.noise.lateral_slip:
            return rolled
        step = np.array([[rolled.vx * dt, rolled.vy * dt, rolled.omega * dt]])
        chance = self._chance[Source.GROUND]
        slip = draw_body_slip(chance, self.robot.drive, self.noise, np.array([steering]), step)
        x, y, theta = slip[0].tolist()
        return Twist2D(rolled.vx + x / dt, rolled.vy + y / dt, rolled.omega + theta / dt)

    def _read(self, turned: Sequence[float], rolled: Twist2D, dt: float) -> SimulatedReading:
        drive, measuring = self.robot.drive, self.robot.measuring
        steering: Sequence[float] = self.steering
        if measuring is drive:
            angles, moved = drive.select(turned), rolled
        else:
            moved = self.twist
            steering = measuring.inverse(moved).steering if measuring.steered_names else ()
            toward = dict(zip(measuring.steered_names, steering, strict=True))
            angles = [dt * rolling_rate(wheel, moved, toward.get(wheel.name, 0.0)) for wheel in self._wheels]
        errors = draw_wheel_errors(
            self._chance[Source.WHEELS], self.noise, self._radii, np.abs(np.array([angles]))
        )
        for k, error in enumerate(errors[0].tolist()):
            self._positions[k] += angles[k] + error
        if steering:
            wheels = [measuring.wheel(name) for name in measuring.steered_names]
            ways = [moved.at(wheel.x, wheel.y) for wheel in wheels]
            distances = np.array([[dt * math.hypot(way.vx, way.vy) for way in ways]])
            self._angle_errors = self._wandered(self._angle_errors, distances)
        return self._reading(steering)

    def _wandered(self, before: Floats | None, distances: Floats) -> Floats:
        return draw_steering_errors(self._chance[Source.STEERING], self.noise, distances, before)[-1:]

    def _reading(self, steering: Sequence[float]) -> SimulatedReading:
        return SimulatedReading(
            time_ns=self.time_ns,
            positions=tuple(self._positions),
            ticks=tuple(
                [int(ticks_of(e, angle)) for e, angle in zip(self._encoders, self._positions, strict=True)]
                if self._encoders
                else ()
            ),
            steering=tuple([a + e for a, e in zip(steering, self._angle_errors[0].tolist(), strict=True)]),
            yaw_rate=self._yaw_rate,
        )

    def _feel(self, omega: float, gyro: Gyro, dt: float) -> float:
        """What the gyro shows."""
        white, wander = draw_gyro_errors(self._chance[Source.GYRO], self.noise, gyro, np.array([dt]))
        self._bias += float(wander[0])
        return gyro.scale * omega + self._bias + float(white[0])


def _towards(now: float, wanted: float, most: float) -> float:
    """The wanted value, or what can be reached of it."""
    return wanted if abs(wanted - now) <= most else now + math.copysign(most, wanted - now)


def _limit(field: str, value: float) -> float:
    return value if value == math.inf else require_positive(field, value)
