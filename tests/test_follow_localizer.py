"""Tracking wheels in place of the drive's encoders: Road Runner's localizers, in inches at the door."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trundle import (
    Ackermann,
    ConfigError,
    Differential,
    Mecanum,
    Noise,
    Omni,
    Pose2D,
    Robot,
    SkidSteer,
    Swerve,
    TrackingWheels,
    Twist2D,
    WheelOdometry,
    load_robot,
)
from trundle.follow import (
    Path,
    Ramsete,
    SpeedLimits,
    Status,
    TimedPath,
    TrajectoryFollower,
    quintic_between,
)
from trundle.simulate import SimulatedRobot

INCH = 0.0254
# StandardTrackingWheelLocalizer: left parallel, right parallel, perpendicular.
PLACES = [(2.6, 7.1, 0.0), (2.6, -7.1, 0.0), (-3.75, -0.15, math.radians(90.0))]
MECANUM = Mecanum(track_width=0.36, wheelbase=0.33, wheel_radius=0.048)


def road_runner(inches):
    """`ThreeTrackingWheelLocalizer`: rows [cos a, sin a, x sin a - y cos a], solved exactly; in inches."""
    rows = [[math.cos(a), math.sin(a), x * math.sin(a) - y * math.cos(a)] for x, y, a in PLACES]
    return np.linalg.solve(np.array(rows), np.array(inches))


@pytest.mark.parametrize("inches", [(1.0, 1.0, 0.0), (-1.0, 1.0, 0.0), (0.0, 0.0, 2.0), (1.3, 0.7, -0.4)])
def test_inches_are_road_runners(inches):
    x, y, theta = road_runner(inches)
    twist = TrackingWheels.in_inches(PLACES).forward(inches)
    assert (twist.vx / INCH, twist.vy / INCH, twist.omega) == pytest.approx((x, y, theta), abs=1e-12)


def test_positive_perpendicular_reading_is_leftward():
    assert TrackingWheels.in_inches(PLACES).forward((0.0, 0.0, 1.0)).vy == pytest.approx(INCH)


def test_inches_and_metres_are_one_localizer(tmp_path):
    inches = TrackingWheels.in_inches(PLACES, wheel_radius=0.944882)
    metres = TrackingWheels([(x * INCH, y * INCH, a) for x, y, a in PLACES], wheel_radius=0.944882 * INCH)
    named = TrackingWheels.in_inches(dict(zip(("l", "r", "p"), PLACES, strict=True)), 0.944882)
    document = tmp_path / "robot.yaml"
    document.write_text(
        "drive: {type: mecanum, track_width: 0.36, wheelbase: 0.33, wheel_radius: 0.048}\n"
        "localizer:\n  type: tracking_wheels\n  wheel_radius: 0.944882 in\n"
        "  wheels: [[2.6 in, 7.1 in, 0], [2.6 in, -7.1 in, 0], [-3.75 in, -0.15 in, 90 deg]]\n"
    )
    written = load_robot(document).localizer
    reading = (0.3, 0.5, -0.2)
    twist = metres.forward(reading)
    for other in (inches, named, written):
        found = other.forward(reading)
        assert (found.vx, found.vy, found.omega) == pytest.approx((twist.vx, twist.vy, twist.omega))
    assert named.wheel_names == ("l", "r", "p")
    with pytest.raises(ConfigError):
        TrackingWheels.in_inches([(1.0, 2.0)])


def test_two_wheels_and_a_heading():
    """`TwoTrackingWheelLocalizer`: one parallel, one perpendicular, and the row [0, 0, 1] of an IMU."""
    two = TrackingWheels.in_inches([PLACES[0], PLACES[2]], measured=("wheel_1", "wheel_2", "gyro"))
    turned = 0.3
    # A turn on the spot: the left wheel rolls back by y * omega, the perpendicular one x * omega to its left.
    twist = two.forward((-7.1 * turned, -3.75 * turned), yaw_rate=turned)
    assert (twist.vx, twist.vy, twist.omega) == pytest.approx((0.0, 0.0, turned), abs=1e-12)


DRIVES = {
    "differential": Differential(track_width=0.3, wheel_radius=0.05),
    "skid steer": SkidSteer(track_width=0.5, wheelbase=0.4, wheel_radius=0.1),
    "mecanum": MECANUM,
    "omni": Omni(robot_radius=0.2, wheel_radius=0.05),
    "three tracking wheels": TrackingWheels.in_inches(PLACES),
    "ackermann": Ackermann(wheelbase=0.4, track_width=0.3, wheel_radius=0.05),
    "swerve": Swerve(modules=[(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)], wheel_radius=0.05),
}


@pytest.mark.parametrize("name", DRIVES)
def test_relative_odometry_update_of_every_drive(name):
    """`Kinematics.relativeOdometryUpdate`: wheel displacements, `forward`, and the exact arc."""
    drive = DRIVES[name]
    moved = drive.project(Twist2D(0.2, 0.1, 0.4))  # over one step
    command = drive.inverse(moved)
    turned = drive.select(command.speeds)
    relative = Pose2D.exp(drive.forward(turned, command.steering))
    start = Pose2D(1.0, 2.0, 0.7)
    odometry = WheelOdometry(drive, pose=start, integrator="arc")
    odometry.update(0.0, [0.0] * len(turned), steering=command.steering)
    state = odometry.update(1.0, turned, steering=command.steering)
    expected = start @ relative
    assert (state.pose.x, state.pose.y, state.pose.theta) == pytest.approx(
        (expected.x, expected.y, expected.theta), abs=1e-12
    )
    exact = start @ Pose2D.exp(moved)
    assert (expected.x, expected.y) == pytest.approx((exact.x, exact.y), abs=1e-12)


def off_the_truth(robot):
    """How far odometry is from a robot that followed a path by it [m]."""
    path = Path([quintic_between(Pose2D(), Pose2D(3.0, 1.0, 0.0))])
    trajectory = TimedPath.fastest(path, SpeedLimits(max_speed=0.8, max_acceleration=0.8))
    follower = TrajectoryFollower(trajectory, Ramsete(b=20.0))
    simulated, odometry = SimulatedRobot(robot, seed=5), WheelOdometry(robot)
    reading, following = simulated.reading(), follower.start(0)
    while True:
        state = odometry.update(time_ns=reading.time_ns, positions=reading.positions)
        guidance, following = follower.step(following, simulated.time_ns, state.pose, state.time_ns)
        if guidance.status.stops:
            break
        reading = simulated.step(robot.drive.inverse(guidance.twist), 0.01)
    assert guidance.status is Status.ARRIVED
    return math.dist((simulated.pose.x, simulated.pose.y), (state.pose.x, state.pose.y))


def test_localizer_takes_the_place_of_wheels_that_slip():
    """Sideways slip, which driven wheels cannot see, is what the perpendicular wheel is for."""
    noise = Noise(wheel_distance=0.0, lateral_slip=0.03)
    robot = Robot(drive=DRIVES["differential"], noise=noise)
    tracked = robot.with_localizer(TrackingWheels.in_inches(PLACES))
    assert tracked.drive is robot.drive
    assert tracked.measuring.measured_names == ("wheel_1", "wheel_2", "wheel_3")
    assert off_the_truth(robot) > 0.02
    assert off_the_truth(tracked) < 1e-3
