"""What donkeycar's path-follow template does, with a car that does not exist.

    .envs/donkeycar/bin/python examples/donkeycar/follow_path.py [FOLDER]

A real donkeycar `Vehicle` is driven around a course and records its path; then it follows the path by
itself. Vehicle, path, cross-track error and pilot are donkeycar's; the kinematics and the car are Trundle's,
so that it is known where the car really was.
"""

from __future__ import annotations

import logging
import math
import sys
import tempfile
from pathlib import Path

import msgspec
import numpy as np

from trundle.adapters.myconfig import robot_from_myconfig
from trundle.donkeycar import Bicycle, UnnormalizeSteeringAngle
from trundle.geometry import Pose2D, Twist2D
from trundle.robot import Noise, Robot
from trundle.simulate import SimulatedRobot

try:
    from donkeycar.parts.path import CTE, CsvThrottlePath, PID_Pilot
    from donkeycar.vehicle import Vehicle
except ModuleNotFoundError as missing:
    sys.exit(
        f"{missing.name} is not installed here. donkeycar has an environment of its own:\n"
        f"    make .envs/donkeycar/ready && .envs/donkeycar/bin/python {sys.argv[0]}"
    )

PERIOD = 0.05  # s, donkeycar's 20 turns of the loop per second
THROTTLE = 0.4
AS_FAST_AS_IT_GOES = 1e9  # Hz; time is simulated

# Length [m] and normalised steering of each part of the course: straights, and half circles to the left.
COURSE = ((2.0, 0.0), (3.2, -0.493), (2.0, 0.0), (3.2, -0.493))


class Driver:
    """Steers along the course."""

    def run(self, distance: float) -> tuple[float, float]:
        """Throttle and steering after a distance [m]."""
        for length, steering in COURSE:
            if distance < length:
                return THROTTLE, steering
            distance -= length
        return 0.0, 0.0


class Car:
    """A car with a servo, a motor and an encoder at its front wheel, slipping and counting as real ones do.

    Attributes:
        places: Where its front axle really was, from where it began [m].
    """

    def __init__(self, robot: Robot, seed: int) -> None:
        self.robot = robot
        self.simulated = SimulatedRobot(robot, seed=seed, noise=Noise(), lag=0.1, max_steering_rate=6.0)
        self.front = Pose2D(robot.drive.wheel("front").x, 0.0, 0.0)
        self.places: list[tuple[float, float]] = []

    def run(self, throttle: float, steering: float) -> tuple[float, float]:
        """Drive for a turn of the loop: distance that the encoder counted [m], and the time [s]."""
        speed = throttle * self.robot.limits.max_speed
        angle = -steering * self.robot.limits.max_steering
        body = Twist2D(speed * math.cos(angle), 0.0, speed * math.sin(angle) / self.front.x)
        command = self.robot.drive.inverse(body, self.simulated.steering)
        # At rest the wheels point nowhere; the servo turns them all the same.
        reading = self.simulated.step(msgspec.structs.replace(command, steering=(angle,)), PERIOD)
        place = self.front.inverse() @ self.simulated.pose @ self.front
        self.places.append((place.x, place.y))
        turned = reading.ticks[0] * self.robot.encoders["front"].radians_per_tick
        return turned * self.robot.drive.wheel("front").radius, reading.time_ns * 1e-9


class Pid:
    """PID on simulated time; donkeycar's `PIDController` takes the wall clock's.

    Args:
        p: Steering per metre of donkeycar's cross-track error, which is negative to the left of the path.
        i: Steering per metre and second of it.
        d: Steering per metre per second of it.
    """

    def __init__(self, p: float, i: float, d: float) -> None:
        self.p, self.i, self.d = p, i, d
        self._before: float | None = None
        self._sum = 0.0

    def run(self, error: float) -> float:
        """Steering, from -1 to 1, for an error [m]."""
        rate = 0.0 if self._before is None else (error - self._before) / PERIOD
        self._before = error
        self._sum += error * PERIOD
        return max(-1.0, min(1.0, self.p * error + self.i * self._sum + self.d * rate))


def vehicle_of(robot: Robot, seed: int, parity: bool) -> tuple[Vehicle, Car]:
    """A donkeycar that knows where it is, with parity as donkeycar computes it."""
    vehicle, car = Vehicle(), Car(robot, seed)
    vehicle.mem["throttle"] = vehicle.mem["steering"] = 0.0
    vehicle.add(car, inputs=["throttle", "steering"], outputs=["enc/distance", "timestamp"])
    vehicle.add(
        UnnormalizeSteeringAngle(robot.limits.max_steering), inputs=["steering"], outputs=["steering/angle"]
    )
    vehicle.add(
        Bicycle(robot.drive.wheel("front").x, parity=parity),
        inputs=["enc/distance", "steering/angle", "timestamp"],
        outputs=[
            *("odom/distance", "enc/speed", "pos/x", "pos/y", "pos/angle"),
            *("vel/x", "vel/y", "vel/angle", "odom/timestamp"),
        ],
    )
    return vehicle, car


def record(robot: Robot, file: Path, *, parity: bool = False) -> None:
    """Drive the course once and save the path."""
    vehicle, _ = vehicle_of(robot, 1, parity)
    vehicle.add(Driver(), inputs=["enc/distance"], outputs=["throttle", "steering"])
    vehicle.mem["recording"] = True
    path = CsvThrottlePath(min_dist=0.1)
    inputs = ["recording", "pos/x", "pos/y", "throttle"]
    vehicle.add(path, inputs=inputs, outputs=["path", "throttles"])
    drive(vehicle, robot)
    path.save(str(file))


def follow(robot: Robot, file: Path, *, parity: bool = False) -> np.ndarray:
    """Follow a saved path for a lap; where the car really was, shape (N, 2)."""
    vehicle, car = vehicle_of(robot, 2, parity)
    path = CsvThrottlePath()
    path.load(str(file))
    vehicle.mem["path"], vehicle.mem["throttles"] = path.path, path.throttles
    vehicle.add(
        CTE(look_ahead=1, look_behind=1, num_pts=10),
        inputs=["path", "pos/x", "pos/y", "cte/closest_pt"],
        outputs=["cte/error", "cte/closest_pt"],
    )
    vehicle.add(
        PID_Pilot(Pid(p=-8.0, i=-16.0, d=-1.0), THROTTLE, use_constant_throttle=True),
        inputs=["cte/error", "throttles", "cte/closest_pt"],
        outputs=["steering", "throttle"],
    )
    drive(vehicle, robot)
    return np.array(car.places)


def drive(vehicle: Vehicle, robot: Robot) -> None:
    """Let the vehicle run until its car has gone the length of the course."""
    seconds = sum(length for length, _ in COURSE) / (THROTTLE * robot.limits.max_speed)
    vehicle.start(rate_hz=AS_FAST_AS_IT_GOES, max_loop_count=math.ceil(seconds / PERIOD))


def distances(places: np.ndarray, path: np.ndarray) -> np.ndarray:
    """How far places are from a closed path [m], shape (N,)."""
    start, along = path, np.roll(path, -1, axis=0) - path
    apart = places[:, None, :] - start
    share = np.clip((apart * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    return np.linalg.norm(apart - share[..., None] * along, axis=-1).min(axis=1)


def main(folder: Path) -> dict[bool, tuple[float, float]]:
    """Record, follow, and say how well, with Trundle's pose and with donkeycar's.

    Returns:
        Root mean square and greatest distance from the path [m]; by whether the pose was donkeycar's.
    """
    robot = robot_from_myconfig(Path(__file__).with_name("myconfig.py"))
    off = {}
    for parity, words in ((False, "Trundle's"), (True, "donkeycar's")):
        file = folder / f"{words[:-2]}_path.csv"
        record(robot, file, parity=parity)
        path = np.loadtxt(file, delimiter=",")[:, :2]
        error = distances(follow(robot, file, parity=parity), path)
        off[parity] = float(np.sqrt((error**2).mean())), float(error.max())
        rms, most = (1e3 * value for value in off[parity])
        print(
            f"With {words} Bicycle the car was really {rms:.0f} mm off its path (RMS), {most:.0f} mm at most."
        )
    return off


if __name__ == "__main__":
    logging.getLogger().setLevel(logging.WARNING)  # donkeycar logs each step
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
