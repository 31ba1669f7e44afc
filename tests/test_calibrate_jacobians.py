"""Predicted paths of `calibrate`: right, and differentiated right, for every drive and every number of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import trundle as tr
from trundle.calibrate.parameter import candidates_of, robot_with
from trundle.calibrate.predicted_path import predict, readings_of
from trundle.geometry import se2
from trundle.simulate import Course, Gyro, arc, simulate, straight

R, TRACK, BASE = 0.05, 0.4, 0.6
SQUARE = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]

DRIVES = {
    "differential": tr.Differential(track_width=TRACK, wheel_radius={"left": 0.049, "right": 0.051}),
    "differential+gyro": tr.Differential(
        track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro")
    ),
    "skid": tr.SkidSteer(track_width=TRACK, wheelbase=BASE, wheel_radius=R),
    "skid icr": tr.SkidSteer(
        track_width=TRACK, wheelbase=BASE, wheel_radius=R, icr_left=0.3, icr_right=-0.25, icr_x=0.0
    ),
    "bicycle": tr.Bicycle(wheelbase=BASE, wheel_radius=R),
    "bicycle front": tr.Bicycle(wheelbase=BASE, wheel_radius=R, measured="front"),
    "bicycle both": tr.Bicycle(wheelbase=BASE, wheel_radius=R, measured=("rear", "front")),
    "ackermann": tr.Ackermann(wheelbase=BASE, track_width=TRACK, wheel_radius=R),
    "ackermann all": tr.Ackermann(
        wheelbase=BASE,
        track_width=TRACK,
        wheel_radius=R,
        measured=("front_left", "front_right", "rear_left", "rear_right"),
    ),
    "tricycle": tr.Tricycle(wheelbase=BASE, wheel_radius=R),
    "forklift": tr.Tricycle(wheelbase=BASE, track_width=TRACK, wheel_radius=R, front_y=0.1),
    "four wheel steering": tr.FourWheelSteering(wheelbase=BASE, track_width=TRACK, wheel_radius=R),
    "mecanum": tr.Mecanum(track_width=TRACK, wheelbase=BASE, wheel_radius=R),
    "omni 3": tr.Omni(robot_radius=0.3, wheel_radius=R),
    "omni 5": tr.Omni(robot_radius=0.3, wheel_radius=R, wheel_count=5, first_wheel_angle=0.2),
    "swerve": tr.Swerve(modules=SQUARE, wheel_radius=R),
    "tracking": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (0.1, -0.2, 0.0), (-0.1, 0.0, math.pi / 2)], wheel_radius=R
    ),
    "tracking+gyro": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (-0.1, 0.0, math.pi / 2)], R, measured=("wheel_1", "wheel_2", "gyro")
    ),
    "rover": tr.Custom(
        wheels=[
            tr.Wheel("fl", 0.5, 0.3, R, kind="steered"),
            tr.Wheel("fr", 0.5, -0.3, R, kind="steered"),
            tr.Wheel("ml", 0.0, 0.3, R),
            tr.Wheel("mr", 0.0, -0.3, R),
        ]
    ),
}
REFERENCE = ("reference.x", "reference.y", "reference.theta")
every_drive = pytest.mark.parametrize("kind", DRIVES)
COURSE = Course.of(straight(0.5, 0.5), arc(1.0, 0.7, 0.5), arc(1.2, -1.0, 0.4))


def driven(kind: str) -> tuple[tr.Robot, tr.WheelLog]:
    drive = DRIVES[kind]
    robot = tr.Robot(drive=drive, noise=tr.Noise(wheel_distance=0.01, lateral_slip=0.01))
    if isinstance(drive, tr.TrackingWheels):
        wheels = tr.Differential(track_width=TRACK, wheel_radius=R)
        robot = robot.replace(drive=wheels, localizer=drive)
    gyro = Gyro(bias=0.01) if drive.gyro else None
    return robot, simulate(robot, COURSE, rate=10.0, seed=3, gyro=gyro)


def all_of(robot: tr.Robot, log: tr.WheelLog):
    return candidates_of(robot, log.steering_names, mounted=True, headings=True, clock=True).all


def values_of(parameters) -> np.ndarray:
    """Not the nominal ones: there, derivatives may vanish by chance."""
    nudges = np.linspace(0.01, 0.03, len(parameters))
    return np.array([one.nominal + one.size * nudge for one, nudge in zip(parameters, nudges, strict=True)])


@every_drive
def test_slopes_are_those_of_differences(kind):
    """By each number alone, at the log's rows and between them."""
    robot, log = driven(kind)
    readings = readings_of(robot, log)
    moments = np.array([0.0, 0.333, 1.0, 2.718, 4.0, 1e-9 * float(log.time_ns[-1])])
    seen: set[str] = set()
    for one in all_of(robot, log):
        values = values_of([one])
        step = 1e-6 * one.size
        found = predict(robot, readings, [one], values, moments)
        ahead, behind = (
            predict(robot, readings, [one], values + change, moments).poses for change in (step, -step)
        )
        difference = se2.log(se2.compose(ahead, se2.inverse(behind))) / (2.0 * step)
        scale = 1.0 + np.abs(difference).max()
        assert found.slopes[:, :, 0] == pytest.approx(difference, abs=2e-7 * scale), one.name
        if np.abs(difference).max() > 1e-6:
            seen.add(one.name)
    of_the_path = {one.name for one in all_of(robot, log)} - {*REFERENCE, "clock"}
    assert seen == of_the_path


@every_drive
def test_slopes_of_several_numbers_stand_side_by_side(kind):
    robot, log = driven(kind)
    readings = readings_of(robot, log)
    parameters = candidates_of(robot, log.steering_names, mounted=False, headings=True, clock=False).needed
    values, moments = values_of(parameters), np.array([1.05, 3.0])
    whole = predict(robot, readings, parameters, values, moments)
    for k, nudge in enumerate(1e-6 * np.diag([one.size for one in parameters])):
        ahead, behind = (
            predict(robot, readings, parameters, values + change, moments).poses for change in (nudge, -nudge)
        )
        difference = se2.log(se2.compose(ahead, se2.inverse(behind))) / (2.0 * nudge[k])
        assert whole.slopes[:, :, k] == pytest.approx(difference, abs=1e-6 * (1.0 + np.abs(difference).max()))


@every_drive
def test_predicted_path_is_the_odometry_of_a_robot_with_these_numbers(kind):
    """What is written into the description drives as it was calibrated."""
    robot, log = driven(kind)
    parameters = [
        one
        for one in candidates_of(robot, (), mounted=False, headings=False, clock=False).needed
        if one.part == "drive"
    ]
    values = values_of(parameters)
    readings = readings_of(robot, log)
    found = predict(robot, readings, parameters, values, readings.moments)
    path = tr.integrate(robot_with(robot, parameters, values), log, integrator="arc", covariance=False)
    assert path.poses == pytest.approx(found.poses, abs=1e-9)


@every_drive
def test_spread_is_the_covariance_of_odometry(kind):
    """Carried to the body, to first order, as integrate does to more."""
    robot, log = driven(kind)
    readings = readings_of(robot, log)
    found = predict(robot, readings, [], np.zeros(0), readings.moments)
    path = tr.integrate(robot, log, covariance=True)
    inward = np.linalg.inv(np.stack([adjoint(pose) for pose in found.poses]))
    body = inward @ found.spread @ np.swapaxes(inward, 1, 2)
    assert body[-1] == pytest.approx(path.covariances[-1], rel=0.05, abs=2e-5)


def adjoint(pose: np.ndarray) -> np.ndarray:
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, y], [s, c, -x], [0.0, 0.0, 1.0]])
