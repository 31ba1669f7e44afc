"""Messages of the ROS 2 node as plain values: joints, poses, covariances, and a robot that does not exist."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import (
    Ackermann,
    ConfigError,
    Differential,
    Encoder,
    InputError,
    LogMapping,
    Pose2D,
    Robot,
    Swerve,
    Tricycle,
    Twist2D,
    WheelCommand,
)
from trundle.apps.ros2 import messages
from trundle.apps.ros2.base import Base, Report
from trundle.apps.ros2.joints import JointReading, Joints
from trundle.apps.ros2.lease import Source
from trundle.apps.ros2.parameters import Settings
from trundle.apps.ros2.simulation import SimulatedJoints
from trundle.odometry import OdometryState
from trundle.robot.log_mapping import Kind, ScalarMapping, Unit, WheelMapping
from trundle.simulate import NOISELESS

MS = 1_000_000
DIFFERENTIAL = Differential(track_width=0.2, wheel_radius=0.05)
finite = st.floats(-1e3, 1e3)


def stamped(**fields):
    header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id="")
    return SimpleNamespace(header=header, **fields)


def point():
    return SimpleNamespace(x=0.0, y=0.0, z=0.0)


def pose():
    return SimpleNamespace(position=point(), orientation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0))


def twist(*values):
    x, y, z, roll, pitch, yaw = values or (0.0,) * 6
    return SimpleNamespace(
        linear=SimpleNamespace(x=x, y=y, z=z), angular=SimpleNamespace(x=roll, y=pitch, z=yaw)
    )


def pose_message(*, frame="", covariance=None):
    with_covariance = SimpleNamespace(
        pose=pose(), covariance=[0.0] * 36 if covariance is None else covariance
    )
    message = stamped(pose=with_covariance)
    message.header.frame_id = frame
    return message


def odometry_message():
    return stamped(
        pose=SimpleNamespace(pose=pose(), covariance=np.zeros(36)),
        twist=SimpleNamespace(twist=twist(), covariance=np.zeros(36)),
    )


@given(finite, finite, st.floats(-50.0, 50.0))
def test_poses_survive_the_quaternion(x, y, theta):
    """Norm 1, and the same pose back."""
    message = pose_message()
    messages.write_pose(message.pose.pose, Pose2D(x, y, theta))
    turn = message.pose.pose.orientation
    assert math.hypot(turn.x, turn.y, turn.z, turn.w) == pytest.approx(1.0, abs=1e-9)
    back, six = messages.read_pose(message, "odom")
    assert (back.x, back.y) == (x, y)
    assert math.remainder(back.theta - theta, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert six == (0.0,) * 6


@pytest.mark.parametrize("row", [pytest.param("R6", id="R6")])
def test_fault(row):
    """What a planar robot does not know is 1e6, and what it does stands at its place, twice."""
    message = odometry_message()
    state = OdometryState(1_500_000_002, Pose2D(1.0, 2.0, 3.0), Twist2D(0.1, 0.2, 0.3), True, "")
    six = (1.0, 0.2, 2.0, 0.3, 0.4, 3.0)
    for _ in range(2):  # messages are filled in again and again
        messages.write_odometry(message, Report(state, six, six))
    stamp = message.header.stamp
    assert (stamp.sec, stamp.nanosec) == (1, 500_000_002)
    assert messages.read_stamp(stamp) == 1_500_000_002
    expected = np.zeros((6, 6))
    planar = [[1.0, 0.2, 0.3], [0.2, 2.0, 0.4], [0.3, 0.4, 3.0]]
    expected[np.ix_([0, 1, 5], [0, 1, 5])] = planar
    expected[[2, 3, 4], [2, 3, 4]] = 1e6
    np.testing.assert_array_equal(message.pose.covariance.reshape(6, 6), expected)
    np.testing.assert_allclose(message.twist.covariance.reshape(6, 6), expected, atol=1.1e-9)
    messages.write_odometry(message, Report(state, six, (0.0,) * 6))
    assert np.linalg.eigvalsh(message.twist.covariance.reshape(6, 6)).min() > 0.0
    assert messages.read_twist(message.twist.twist) == Twist2D(0.1, 0.2, 0.3)


def test_transform_is_the_pose():
    message = stamped(transform=SimpleNamespace(translation=point(), rotation=pose().orientation))
    messages.write_transform(message, 5, Pose2D(1.0, 2.0, math.pi / 3 + math.tau))
    assert (message.transform.translation.x, message.transform.translation.y) == (1.0, 2.0)
    turn = message.transform.rotation
    assert (turn.z, turn.w) == pytest.approx((0.5, math.sqrt(0.75)))
    assert message.header.stamp.nanosec == 5


def test_a_twist_with_any_part_that_is_no_number_is_none():
    assert messages.read_twist(twist(1.0, 2.0, 0.0, 0.0, 0.0, 3.0)) == Twist2D(1.0, 2.0, 3.0)
    for place in range(6):
        parts = [0.0] * 6
        parts[place] = math.nan
        read = messages.read_twist(twist(*parts))
        assert not math.isfinite(read.vx + read.vy + read.omega)


def flat(planar):
    matrix = np.zeros((6, 6))
    matrix[np.ix_([0, 1, 5], [0, 1, 5])] = planar
    return matrix.reshape(-1).tolist()


def test_covariance_of_a_pose_is_turned_into_the_body():
    message = pose_message(covariance=flat(np.diag([4.0, 1.0, 0.5])))
    messages.write_pose(message.pose.pose, Pose2D(0.0, 0.0, math.pi / 2))
    _, six = messages.read_pose(message, "odom")
    assert six == pytest.approx((1.0, 0.0, 4.0, 0.0, 0.0, 0.5), abs=1e-12)


def broken_poses():
    yield "frame", pose_message(frame="map")
    for planar in (
        np.diag([-1.0, 1.0, 1.0]),
        np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        np.diag([math.nan, 1.0, 1.0]),
        np.diag([1e308, 1.0, 1.0]),
    ):
        yield "covariance", pose_message(covariance=flat(planar))
    twisted = pose_message()
    twisted.pose.pose.orientation.w = 0.5
    yield "norm", twisted
    lost = pose_message()
    lost.pose.pose.position.x = math.inf
    yield "finite", lost


@pytest.mark.parametrize(("word", "message"), list(broken_poses()))
def test_a_pose_that_cannot_be_is_refused(word, message):
    with pytest.raises(InputError, match=word):
        messages.read_pose(message, "odom")


# ------------------------------------------------------------------------------------ joints


def joint_state(names, positions=(), velocities=()):
    return list(names), SimpleNamespace(position=positions, velocity=velocities, effort=[])


def test_joints_go_by_the_wheels_names_where_nothing_is_said():
    joints = Joints(Robot(drive=DIFFERENTIAL))
    assert joints.topic == "joint_states"
    assert joints.read(*joint_state(["right", "x", "left"], [1.0, 5.0, 2.0])) == JointReading((2.0, 1.0), ())
    assert joints.read(*joint_state(["right", "left"], [], [1.0, 2.0])) == "missing_joint"
    assert joints.read(*joint_state(["right"], [1.0])) == "missing_joint"


def test_joints_are_read_as_the_log_section_says():
    """Ticks in a position, rad/min in a velocity, a joint that turns the other way."""
    encoder = Encoder(ticks_per_revolution=1000.0, bits=16)
    wheels = {
        "left": WheelMapping(topic="/wheels", name="l", unit=Unit.TICKS),
        "right": WheelMapping(topic="/wheels", name="r", unit=Unit.TICKS, sign=-1),
    }
    ticks = Robot(
        drive=DIFFERENTIAL, encoders=dict.fromkeys(("left", "right"), encoder), log=LogMapping(wheels=wheels)
    )
    joints = Joints(ticks)
    assert joints.topic == "/wheels"
    assert joints.keyword == "ticks"
    assert joints.read(*joint_state("lr", [65535.0, 3.0])).wheels == (65535.0, -3.0)
    told = joints.command(WheelCommand((1.0, 2.0)))
    assert told.velocities == {"l": 1.0, "r": -2.0}
    speeds = {name: WheelMapping(topic="j", unit=Unit.RAD_MIN) for name in ("left", "right")}
    joints = Joints(Robot(drive=DIFFERENTIAL, log=LogMapping(wheels=speeds)))
    assert joints.keyword == "velocities"
    assert joints.read(*joint_state(["left", "right"], [], [60.0, 120.0])).wheels == pytest.approx((1.0, 2.0))


def test_commands_go_to_wheels_with_motors_and_to_steering():
    joints = Joints(Robot(drive=Tricycle(wheelbase=1.0, wheel_radius=0.1, track_width=0.5)))
    told = joints.command(WheelCommand((1.0, 2.0, 3.0), (0.5,)))
    assert told.velocities == {"front": 1.0}
    assert told.positions == {"front_steering": 0.5}
    assert joints.told(*told) == WheelCommand((1.0, 0.0, 0.0), (0.5,))


@pytest.mark.parametrize(
    ("field", "mapping"),
    [
        ("log.wheels", {"left": WheelMapping(topic="a"), "right": WheelMapping(topic="b")}),
        ("log.wheels.right", {"left": WheelMapping(topic="a")}),
        ("log.wheels.left.field", dict.fromkeys(("left", "right"), WheelMapping(topic="a", field="data"))),
        ("log.wheels.left.name", dict.fromkeys(("left", "right"), WheelMapping(topic="a", name=3))),
    ],
)
def test_what_live_topics_cannot_give_is_refused(field, mapping):
    with pytest.raises(ConfigError) as caught:
        Joints(Robot(drive=DIFFERENTIAL, log=LogMapping(wheels=mapping)))
    assert caught.value.field == field


def test_one_angle_may_stand_for_two():
    drive = Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05)
    log = LogMapping(
        wheels={name: WheelMapping(topic="j") for name in ("rear_left", "rear_right")},
        steering={"front": ScalarMapping(topic="j", name="servo", unit=Unit.DEG)},
    )
    base = Base(Settings(robot=Robot(drive=drive, log=log)))
    base.activate()
    for k in range(3):
        names, message = joint_state(["servo", "rear_right", "rear_left"], [90.0 * 0.1, 0.1 * k, 0.1 * k])
        base.on_joint_states(names, message, k * 100 * MS, k * 100 * MS, 0)
    assert base.odometry.accepted == 3
    assert base.odometry.state.twist.omega > 0.0


# --------------------------------------------------------------------------------- simulation


def closed_loop(robot, wanted, seconds=2.0):
    """A base that drives the simulated robot, joint by joint; where it thinks it is, and where it is."""
    base, hardware = Base(Settings(robot=robot)), SimulatedJoints(robot, seed=1)
    base.activate()
    said = None
    for k in range(round(seconds * 100)):
        now = k * 10 * MS
        if k % 2 == 0:
            assert base.on_command(wanted, Source("cmd_vel"), now, now) == ""
            command, _ = base.on_tick(now, now)
            hardware.tell(*base.joints.command(command.wheels), now)
        said = hardware.step(now)
        if said.yaw_rate is not None:
            base.on_imu(said.yaw_rate, now)
        names, message = joint_state(said.names, said.positions, said.velocities)
        base.on_joint_states(names, message, now, now, now)
    return base.odometry.state.pose, said.pose


ENCODERS = {name: Encoder(ticks_per_revolution=4096.0, bits=16) for name in ("left", "right")}


def mapped(**how):
    return LogMapping(wheels={name: WheelMapping(topic="/joint_states", **how) for name in ("left", "right")})


@pytest.mark.parametrize(
    "robot",
    [
        pytest.param(Robot(drive=DIFFERENTIAL, noise=NOISELESS), id="position"),
        pytest.param(
            Robot(drive=DIFFERENTIAL, noise=NOISELESS, encoders=ENCODERS, log=mapped(unit=Unit.TICKS)),
            id="ticks",
        ),
        pytest.param(Robot(drive=DIFFERENTIAL, noise=NOISELESS, log=mapped(unit=Unit.RPM)), id="velocity"),
        pytest.param(
            Robot(drive=DIFFERENTIAL, noise=NOISELESS, log=mapped(kind=Kind.INCREMENT)), id="increment"
        ),
        pytest.param(
            Robot(
                drive=Ackermann(
                    wheelbase=0.3,
                    track_width=0.2,
                    wheel_radius=0.05,
                    measured=("rear_left", "rear_right", "gyro"),
                ),
                noise=NOISELESS,
            ),
            id="ackermann",
        ),
        pytest.param(
            Robot(
                drive=Swerve(modules=[(0.2, 0.2), (0.2, -0.2), (-0.2, 0.0)], wheel_radius=0.05),
                noise=NOISELESS,
            ),
            id="swerve",
        ),
    ],
)
def test_a_simulated_robot_is_driven_and_found(robot):
    """Commands out, joints in, in the units of each description: the pose is the truth."""
    found, truth = closed_loop(robot, Twist2D(0.5, 0.0, 0.3))
    assert truth.x > 0.6
    error = truth.inverse() @ found
    assert math.hypot(error.x, error.y) < 5e-3
    assert abs(error.theta) < 5e-3


def test_a_simulated_robot_stops_when_it_is_told_nothing():
    robot = Robot(drive=DIFFERENTIAL, noise=NOISELESS)
    hardware = SimulatedJoints(robot)
    hardware.tell({"left": 10.0, "right": 10.0, "stranger": 1.0}, {}, 0)
    poses = [hardware.step(k * 10 * MS).pose.x for k in range(200)]
    assert poses[49] > 0.2
    assert poses[60] == poses[199]
