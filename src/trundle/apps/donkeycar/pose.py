"""From what the wheels rolled to where the vehicle is: donkeycar's forward kinematics."""

from __future__ import annotations

import logging
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from trundle import geometry, robot
from trundle.apps.donkeycar.clipping import as_number
from trundle.apps.donkeycar.original import Motion, bicycle_motion, front_wheel_pose, unicycle_motion
from trundle.errors import ConfigError, InputError
from trundle.geometry import Twist2D

__all__ = [
    "METRE_PER_RADIAN",
    "Bicycle",
    "Pose2D",
    "Reading",
    "Unicycle",
    "limit_angle",
    "update_bicycle_front_wheel_pose",
]

Reading = tuple[float, float, float, float, float, float, float, float, float]
"""distance, velocity, x, y, angle, x', y', angle', timestamp: what donkeycar's odometry parts return."""

STOPPED: Reading = (0, 0, 0, 0, 0, 0, 0, 0, 0)
METRE_PER_RADIAN = 1.0  # a wheel of this radius turns as many radians as it rolls metres

CLOCK_RESOLUTION = 1e-6  # nothing is divided by less [s]
CLOCK_RESET = 1.0  # time that goes back by this much belongs to a new clock [s]


@dataclass(slots=True)
class Pose2D:
    """Position and heading, or their rates; donkeycar's, which can be changed in place.

    Attributes:
        x: [m].
        y: [m].
        angle: [rad], counter-clockwise positive.
    """

    x: float = 0.0
    y: float = 0.0
    angle: float = 0.0


def limit_angle(angle: float) -> float:
    """The same direction from -pi to pi [rad]; both ends can come out.

    Raises:
        InputError: If the angle is infinite.
    """
    if math.isinf(angle):
        raise InputError(f"angle: {angle}, must be finite")
    return math.atan2(math.sin(angle), math.cos(angle))


class _PosePart(ABC):
    """What the odometry parts share: a clock, refusal of what is no reading, and being a part.

    A reading that is no number, or comes too soon, changes nothing, and the next one bridges it. Time that
    goes back by a second or more begins anew from where the vehicle is.
    """

    poll_delay_secs = 0.01

    def __init__(self, debug: bool, parity: bool) -> None:
        self.debug = debug
        self.parity = parity
        self.timestamp: float = 0
        self.velocity = 0.0
        self.pose = Pose2D()
        self.pose_velocity = Pose2D()
        self.running = True
        self.reading: Reading = STOPPED
        self._last: Sequence[float] | None = None
        self._handed_over: Sequence[object] | None = None

    def shutdown(self) -> None:
        """Stop: from now on results are zero."""
        self.running = False

    def update(self) -> None:
        """Take what `run_threaded` hands over, until `shutdown`; a `Vehicle` runs this in a thread."""
        while self.running:
            inputs, self._handed_over = self._handed_over, None
            if inputs is not None:
                *values, timestamp = inputs
                self._run(values, timestamp)
            time.sleep(self.poll_delay_secs)

    def _hand_over(self, values: Sequence[object], timestamp: object) -> Reading:
        self._handed_over = (*values, time.time() if timestamp is None else timestamp)
        return self.reading if self.running else self._stopped()

    def _run(self, values: Sequence[object], timestamp: object) -> Reading:
        if not self.running:
            return self._stopped()
        now = as_number(time.time() if timestamp is None else timestamp)
        numbers = [number for number in map(as_number, values) if number is not None]
        if now is not None and len(numbers) == len(values):
            self._take(numbers, now)
        pose, rates = self.pose, self.pose_velocity
        distance = 0.0 if self._last is None else self._distance(self._last)
        self.reading = (
            *(distance, self.velocity, pose.x, pose.y, pose.angle),
            *(rates.x, rates.y, rates.angle, self.timestamp),
        )
        if self.debug:
            logging.getLogger(__name__).info("%s", self.reading)
        return self.reading

    def _stopped(self) -> Reading:
        return (*STOPPED[:-1], self.timestamp)

    def _take(self, reading: Sequence[float], now: float) -> None:
        seconds = now - self.timestamp
        if self._last is None or self._begins_anew(seconds):
            self.velocity, self.pose_velocity = 0.0, Pose2D()
            self.timestamp, self._last = now, self._baseline(reading)
        elif seconds > 0.0 if self.parity else seconds >= CLOCK_RESOLUTION:
            try:
                motion = self._motion(self._last, reading, seconds)
            except (ValueError, ArithmeticError):
                return  # beyond what a float holds, or square to the only wheel that is measured
            self.pose, self.pose_velocity = Pose2D(*motion.pose), Pose2D(*motion.rates)
            self.velocity = motion.velocity
            self.timestamp, self._last = now, reading

    def _begins_anew(self, seconds: float) -> bool:
        if not self.parity:
            return seconds <= -CLOCK_RESET
        if self.timestamp == 0:  # donkeycar's word for "not started"
            self.pose = Pose2D()
        return self.timestamp == 0

    def _baseline(self, reading: Sequence[float]) -> Sequence[float]:
        """The reading that the first change is counted from."""
        return reading

    @abstractmethod
    def _distance(self, reading: Sequence[float]) -> float:
        """What the odometer says that was rolled so far [m]."""

    @abstractmethod
    def _motion(self, before: Sequence[float], now: Sequence[float], seconds: float) -> Motion:
        """The step between two readings.

        Raises:
            ValueError: If it is beyond what a float holds.
            Unobservable: If the readings do not determine it.
        """

    @property
    def _at(self) -> tuple[float, float, float]:
        return self.pose.x, self.pose.y, self.pose.angle


class Unicycle(_PosePart):
    """Pose of a differential drive, from what its wheels rolled.

    Reference: the middle of the axle. Steps are exact arcs; `parity=True` is donkeycar's midpoint rule.

    Args:
        axle_length: Distance between the wheels [m].
        debug: Log every result.
        parity: Compute as donkeycar does, faults included.

    Attributes:
        pose: Where it is; may be set.
        pose_velocity: Rates of the pose.
        velocity: Forward [m/s].
        timestamp: Of the last reading that counted [s].
        running: Until `shutdown`.

    Raises:
        ConfigError: If the length is not above zero.
    """

    def __init__(self, axle_length: float, debug: bool = False, *, parity: bool = False) -> None:
        super().__init__(debug, parity)
        self.axle_length = axle_length
        self._drive = robot.Differential(track_width=axle_length, wheel_radius=METRE_PER_RADIAN)

    def run(self, left_distance: object, right_distance: object, timestamp: object = None) -> Reading:
        """Take a reading.

        Args:
            left_distance: What the left wheel rolled so far [m].
            right_distance: The same of the right wheel [m].
            timestamp: Of the reading [s]; now if None.

        Returns:
            distance, velocity, x, y, angle, x', y', angle' [m, m/s, rad, rad/s], timestamp [s].
        """
        return self._run((left_distance, right_distance), timestamp)

    def run_threaded(
        self, left_distance: object, right_distance: object, timestamp: object = None
    ) -> Reading:
        """Hand a reading over to `update`; what is known so far."""
        return self._hand_over((left_distance, right_distance), timestamp)

    def _distance(self, reading: Sequence[float]) -> float:
        return (reading[0] + reading[1]) / 2

    def _motion(self, before: Sequence[float], now: Sequence[float], seconds: float) -> Motion:
        left, right = now[0] - before[0], now[1] - before[1]
        if self.parity:
            return unicycle_motion(self._at, left, right, self.axle_length, seconds)
        step = Twist2D(*self._drive.displacement((left, right)))
        return _along(step, self._at, seconds, step.vx)


class Bicycle(_PosePart):
    """Pose of a car, from what one wheel rolled and the angle that its front wheel is steered to.

    Steps are exact arcs with the steering of the reading that ends them. The pose is that of a point of
    the car: donkeycar takes the front wheel's distance along the heading of the body, instead of along
    the wheel, and so reports a point that is none; `parity=True` does the same.

    Args:
        wheel_base: Distance between front and rear axle [m].
        debug: Log every result.
        reference: "front": distances are the front wheel's, and so is the pose; or "rear".
        parity: Compute as donkeycar does, faults included.

    Attributes:
        pose: Where it is; may be set.
        pose_velocity: Rates of the pose.
        velocity: Of the wheel that is measured [m/s].
        timestamp: Of the last reading that counted [s].
        running: Until `shutdown`.

    Raises:
        ConfigError: If the length is not above zero, or the reference is neither.
    """

    def __init__(
        self, wheel_base: float, debug: bool = False, *, reference: str = "front", parity: bool = False
    ) -> None:
        super().__init__(debug, parity)
        self.wheel_base = wheel_base
        self._drive = _bicycle_drive(wheel_base, reference)

    def run(self, forward_distance: object, steering_angle: object, timestamp: object = None) -> Reading:
        """Take a reading.

        Args:
            forward_distance: What the measured wheel rolled so far [m].
            steering_angle: Of the front wheel [rad], left positive. donkeycar's `user/angle` is not that:
                it goes through `UnnormalizeSteeringAngle` first.
            timestamp: Of the reading [s]; now if None.

        Returns:
            distance, velocity, x, y, angle, x', y', angle' [m, m/s, rad, rad/s], timestamp [s].
        """
        return self._run((forward_distance, steering_angle), timestamp)

    def run_threaded(
        self, forward_distance: object, steering_angle: object, timestamp: object = None
    ) -> Reading:
        """Hand a reading over to `update`; what is known so far."""
        return self._hand_over((forward_distance, steering_angle), timestamp)

    def _baseline(self, reading: Sequence[float]) -> Sequence[float]:
        return (0.0, reading[1]) if self.parity else reading

    def _distance(self, reading: Sequence[float]) -> float:
        return reading[0]

    def _motion(self, before: Sequence[float], now: Sequence[float], seconds: float) -> Motion:
        rolled, steering = now[0] - before[0], now[1]
        if self.parity:
            return bicycle_motion(self._at, rolled, steering, self.wheel_base, seconds)
        step = Twist2D(*self._drive.displacement((rolled,), (steering,)))
        return _along(step, self._at, seconds, rolled)


def update_bicycle_front_wheel_pose(
    front_wheel: Pose2D, wheel_base: float, steering_angle: float, distance: float, *, parity: bool = False
) -> tuple[float, float, float] | Pose2D:
    """Where a car's front wheel is after it has rolled a distance.

    Args:
        front_wheel: Where it was; the angle is the body's.
        wheel_base: Distance between front and rear axle [m].
        steering_angle: Of the front wheel [rad], left positive.
        distance: What the front wheel rolls [m].
        parity: As donkeycar: straight along the heading after the turn, which is that of a rear wheel; and
            `front_wheel` itself where the distance is zero.

    Returns:
        x, y [m] and angle [rad].
    """
    at = (front_wheel.x, front_wheel.y, front_wheel.angle)
    if parity:
        return front_wheel if distance == 0 else front_wheel_pose(at, wheel_base, steering_angle, distance)
    step = _bicycle_drive(wheel_base).displacement((distance,), (steering_angle,))
    return _along(Twist2D(*step), at, 1.0, distance).pose


def _bicycle_drive(wheel_base: float, reference: str = "front") -> robot.Bicycle:
    """The drive whose "front" or "rear" wheel rolls a metre per radian, and is the point reported.

    Raises:
        ConfigError: If the length is not above zero, or the reference is neither.
    """
    if reference not in ("front", "rear"):
        raise ConfigError("reference", f"{reference!r}, must be 'front' or 'rear'")
    return robot.Bicycle(
        wheelbase=wheel_base,
        wheel_radius=METRE_PER_RADIAN,
        measured=reference,
        reference=(wheel_base if reference == "front" else 0.0, 0.0),
    )


def _along(step: Twist2D, at: tuple[float, float, float], seconds: float, rolled: float) -> Motion:
    """The exact arc from one reading to the next.

    Raises:
        ValueError: If it is beyond what a float holds.
    """
    after = (geometry.Pose2D(*at) @ geometry.Pose2D.exp(step)).wrapped()
    rates = ((after.x - at[0]) / seconds, (after.y - at[1]) / seconds, step.omega / seconds)
    motion = Motion((after.x, after.y, after.theta), rates, rolled / seconds)
    if not math.isfinite(sum((*motion.pose, *rates, motion.velocity))):
        raise ValueError("beyond what a float holds")
    return motion
