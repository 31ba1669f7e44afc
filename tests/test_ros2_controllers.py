"""ros2_controllers' parameter files: read, written, and read back; every error says where."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import trundle as tr
from trundle.adapters.robot_data import robot_to_data
from trundle.adapters.ros2_controllers import controllers_text, robot_from_controllers
from trundle.adapters.ros2_parameters import FAMILIES, find_controllers
from trundle.adapters.yaml_document import parse_yaml

STAMP, HEADER = "builtin_interfaces/msg/Time", "std_msgs/msg/Header"
STATE = "sensor_msgs/msg/JointState"

DIFF = """
controller_manager:
  ros__parameters:
    update_rate: 50
    base: {type: diff_drive_controller/DiffDriveController}
    joint_state_broadcaster: {type: joint_state_broadcaster/JointStateBroadcaster}
base:
  ros__parameters:
    left_wheel_names: [port_joint]
    right_wheel_names: [starboard_joint]
    wheel_separation: 0.4
    wheel_radius: 0.05
"""
STEERING = """
car:
  ros__parameters:
    type: {package}/{plugin}
    traction_joints_names: {traction}
    steering_joints_names: {steering}
    wheelbase: 0.3
"""


@pytest.fixture
def robot_of(tmp_path):
    """Reads a robot from a text."""

    def read(text, **choice):
        path = tmp_path / "controllers.yaml"
        path.write_text(text)
        return robot_from_controllers(path, **choice)

    return read


@pytest.fixture
def again(robot_of):
    """Writes a robot and reads it back."""
    return lambda robot, **words: robot_of(controllers_text(robot, **words))


def steering(package, plugin, traction, steered, *lines):
    text = STEERING.format(package=package, plugin=plugin, traction=traction, steering=steered)
    return text + "".join(f"    {line}\n" for line in lines)


def ackermann(*lines):
    lines = lines or ("traction_track_width: 0.2", "traction_wheels_radius: 0.03")
    names = ("ackermann_steering_controller", "AckermannSteeringController")
    return steering(*names, "[rr, rl]", "[fr, fl]", *lines)


def joints(robot):
    return {name: mapping.name for name, mapping in robot.log.wheels.items()}


# --- reading -------------------------------------------------------------------------------------


def test_diff_drive(robot_of):
    robot = robot_of(DIFF)
    assert robot.name == "base"
    assert robot.drive.parameters == {"track_width": 0.4, "wheel_radius": 0.05}
    assert joints(robot) == {"left": "port_joint", "right": "starboard_joint"}
    left = robot.log.wheels["left"]
    assert (left.topic, left.unit, left.kind) == ("/joint_states", None, None)  # positions [rad]
    assert robot.limits == tr.Limits()


def test_multipliers_multiply(robot_of):
    lines = (
        "    wheel_separation_multiplier: 1.1\n"
        "    left_wheel_radius_multiplier: 0.98\n    right_wheel_radius_multiplier: 1.01\n"
    )
    drive = robot_of(DIFF + lines).drive
    assert drive.wheel("left").y - drive.wheel("right").y == pytest.approx(0.44, rel=1e-15)
    assert [drive.wheel(name).radius for name in ("left", "right")] == pytest.approx([0.049, 0.0505])


def test_several_wheels_a_side_turn_over_the_separation(robot_of):
    text = DIFF.replace("[port_joint]", "[l1, l2, l3]").replace("[starboard_joint]", "[r1, r2, r3]")
    robot = robot_of(text)
    assert joints(robot) == {name: name for name in ("l1", "l2", "l3", "r1", "r2", "r3")}
    # As the controller has it: the mean of a side is that side's speed.
    twist = robot.drive.forward([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    alone = tr.Differential(track_width=0.4, wheel_radius=0.05).forward([2.0, 5.0])
    assert (twist.vx, twist.vy, twist.omega) == pytest.approx((alone.vx, alone.vy, alone.omega))


MECANUM = """
/**:
  wheels:
    ros__parameters:
      front_left_wheel_command_joint_name: fl
      front_right_wheel_command_joint_name: fr
      rear_right_wheel_command_joint_name: rr
      rear_left_wheel_command_joint_name: rl
      rear_left_wheel_state_joint_name: rl_state
      kinematics:
        base_frame_offset: {x: 0.1, y: -0.2, theta: %s}
        wheels_radius: 0.05
        sum_of_robot_center_projection_on_X_Y_axis: 0.35
      reference_timeout: 0.9
"""


@pytest.mark.parametrize("theta", [0.0, 0.7])
def test_mecanum_reports_its_base_frame(robot_of, theta):
    robot = robot_of(MECANUM % theta)
    assert joints(robot)["rear_left"] == "rl_state"
    assert robot.limits.command_timeout == 0.9
    speeds = fl, fr, rl, rr = 3.0, 1.0, -2.0, 5.0
    twist = robot.drive.forward(speeds)
    # ros2_controllers' own formulas: the centre's twist, moved to the offset and turned.
    vx, vy = 0.05 / 4 * (fl + fr + rl + rr), 0.05 / 4 * (-fl + fr + rl - rr)
    omega = 0.05 / 4 / 0.35 * (-fl + fr - rl + rr)
    at_x, at_y = vx - omega * -0.2, vy + omega * 0.1
    c, s = math.cos(-theta), math.sin(-theta)
    expected = (c * at_x - s * at_y, s * at_x + c * at_y, omega)
    assert (twist.vx, twist.vy, twist.omega) == pytest.approx(expected, abs=1e-12)


def test_omni_is_as_its_controller_has_it(robot_of):
    text = (
        "o:\n  ros__parameters:\n    wheel_names: [a, b, c, d]\n    wheel_offset: 0.3\n"
        "    robot_radius: 0.5\n    wheel_radius: 0.1\n"
    )
    robot = robot_of(text)
    assert list(joints(robot).values()) == ["a", "b", "c", "d"]
    command = robot.drive.inverse(tr.Twist2D(1.0, 2.0, 3.0))
    angles = [0.3 + k * math.pi / 2 for k in range(4)]
    expected = [(math.sin(a) * 1.0 - math.cos(a) * 2.0 - 0.5 * 3.0) / 0.1 for a in angles]
    assert command.speeds == pytest.approx(expected)


def test_steering_joints_come_right_then_left(robot_of):
    robot = robot_of(ackermann())
    assert joints(robot) == {"rear_left": "rl", "rear_right": "rr"}
    assert {name: one.name for name, one in robot.log.steering.items()} == {
        "front_left": "fl",
        "front_right": "fr",
    }
    assert robot.log.wheels["rear_left"].unit.value == "rad/s"  # position_feedback is false here
    assert robot.limits.command_timeout == 1.0


def test_two_tracks_of_an_ackermann(robot_of):
    text = ackermann(
        "traction_track_width: 0.2", "steering_track_width: 0.16", "traction_wheels_radius: 0.03"
    )
    drive = robot_of(text).drive
    assert [drive.wheel(name).y for name in ("front_left", "rear_left")] == [0.08, 0.1]
    same = robot_of(text.replace("0.16", "0.0")).drive  # 0 means the other one's
    assert same.type_name == "ackermann"


def test_old_names_of_steering_controllers(robot_of):
    new = robot_of(ackermann()).drive
    lines = ("front_wheel_track: 0.2", "rear_wheel_track: 0.2", "rear_wheels_radius: 0.03")
    old = ackermann(*lines, "front_wheels_radius: 0.05", "front_steering: true")
    old = old.replace("traction_joints_names", "rear_wheels_names")
    old = old.replace("steering_joints_names", "front_wheels_names")
    robot = robot_of(old)
    assert robot.drive.parameters == new.parameters
    assert joints(robot)["rear_left"] == "rl"
    turned = robot_of(old.replace("front_steering: true", "front_steering: false"))
    assert turned.drive.wheel("rear_left").radius == 0.05
    assert joints(turned)["rear_left"] == "fl"


def test_bicycle_and_tricycles(robot_of):
    names = ("bicycle_steering_controller", "BicycleSteeringController")
    bicycle = robot_of(steering(*names, "[r]", "[s]", "traction_wheel_radius: 0.03"))
    assert (bicycle.drive.type_name, bicycle.drive.measured_names) == ("bicycle", ("rear",))
    names = ("tricycle_steering_controller", "TricycleSteeringController")
    lines = ("traction_wheels_radius: 0.03", "traction_track_width: 0.25")
    rear = robot_of(steering(*names, "[rr, rl]", "[s]", *lines))
    assert rear.drive.measured_names == ("rear_left", "rear_right")
    assert joints(rear) == {"rear_left": "rl", "rear_right": "rr"}
    front = robot_of(steering(*names, "[t]", "[s]", lines[0]))
    assert front.drive.measured_names == ("front",)


def test_the_older_tricycle_counts_milliseconds(robot_of):
    text = (
        "t:\n  ros__parameters:\n    traction_joint_name: t\n    steering_joint_name: s\n    wheelbase: 1.2\n"
        "    wheel_radius: 0.1\n    cmd_vel_timeout: 250\n    steering: {max_position: 1.3}\n"
        "    traction.max_velocity: 20.0\n"
    )
    robot = robot_of(text)
    assert robot.limits == tr.Limits(command_timeout=0.25, max_steering=1.3, max_wheel_speed=20.0)
    twist = robot.drive.forward([2.0], [0.4])  # v = w r cos(steering), omega = w r sin(steering) / wheelbase
    assert twist.vx == pytest.approx(0.2 * math.cos(0.4))
    assert twist.omega == pytest.approx(0.2 * math.sin(0.4) / 1.2)
    assert robot_of(text.replace("250", "0")).limits.command_timeout == 0.5


def test_limits_by_dots_or_nested(robot_of):
    dotted = (
        "    linear.x.max_velocity: 1.5\n    linear.x.max_deceleration: -2.5\n    angular.z.max_jerk: .nan\n"
    )
    nested = "    linear: {x: {max_velocity: 1.5, max_deceleration: -2.5}}\n    cmd_vel_timeout: 0.0\n"
    assert robot_of(DIFF + dotted).limits == tr.Limits(max_speed=1.5, max_deceleration=2.5)
    limits = robot_of(DIFF + nested).limits
    assert limits == tr.Limits(max_speed=1.5, max_deceleration=2.5, command_timeout="never")
    off = robot_of(DIFF + dotted + "    linear.x.has_velocity_limits: false\n")
    assert off.limits.max_speed is None


def test_controllers_are_known_by_type_name_or_parameters():
    lengths = "wheel_separation: 1.0, wheel_radius: 0.1"
    bare = f"base:\n  ros__parameters: {{left_wheel_names: [a], right_wheel_names: [b], {lengths}}}"
    named = "/robot/bicycle_steering_controller/:\n  ros__parameters: {wheelbase: 1.0}"
    everywhere = "/**:\n  ros__parameters: {use_sim_time: true}\n" + bare
    found = {text: find_controllers(parse_yaml(text.encode(), "")) for text in (bare, named, everywhere)}
    kinds = [[one.family.package for one in ones] for ones in found.values()]
    assert kinds == [["diff_drive_controller"], ["bicycle_steering_controller"], ["diff_drive_controller"]]
    assert found[everywhere][0].values["use_sim_time"] is True


def test_one_of_several_is_chosen_by_name(robot_of):
    two = DIFF + ackermann()
    assert robot_of(two, controller="car").drive.type_name == "ackermann"
    with pytest.raises(tr.ConfigError, match=r"configures base, car: say which"):
        robot_of(two)
    with pytest.raises(tr.ConfigError, match=r"no wheeled controller 'cra', did you mean 'car'"):
        robot_of(two, controller="cra")


def without(text, *names):
    return "".join(line for line in text.splitlines(True) if not any(name in line for name in names))


BROKEN = {
    "missing": (without(DIFF, "wheel_radius"), r"base.ros__parameters.wheel_radius: missing"),
    "zero": (DIFF.replace("0.05", "0.0"), r"wheel_radius: 0, must be > 0 \(line 12\)"),
    "millimetres": (
        DIFF.replace("0.05", "50.0"),
        r"wheel_radius: 50 m is implausible .*metres here \(line 12",
    ),
    "milliseconds": (
        DIFF + "    cmd_vel_timeout: 500.0\n",
        r"cmd_vel_timeout: 500 s is implausible .*: it is in s here",
    ),
    "text": (DIFF.replace("0.05", "'0.05'"), r"wheel_radius: '0.05' is text, must be a number"),
    "nan": (DIFF.replace("0.05", ".nan"), r"wheel_radius: nan, must be finite"),
    "bool": (DIFF + "    position_feedback: yes\n", r"position_feedback: 'yes', must be true or false"),
    "typo": (
        DIFF + "    wheel_seperation_multiplier: 1.1\n",
        r"unknown parameter, did you mean 'wheel_separation_multiplier'\?",
    ),
    "twice": (
        DIFF + "    linear.x.max_velocity: 1.0\n    linear: {x: {max_velocity: 2.0}}\n",
        r"linear.x.max_velocity: is given twice",
    ),
    "uneven": (DIFF.replace("[port_joint]", "[a, b]"), r"right_wheel_names: 1 joints, must be 2"),
    "shared": (DIFF.replace("port_joint", "starboard_joint"), r"starboard_joint: is a left wheel too"),
    "no list": (DIFF.replace("[port_joint]", "port_joint"), r"'port_joint', must be a list of joint names"),
    "no name": (DIFF.replace("[port_joint]", "[1]"), r"1 at 0, must be the name of a joint"),
    "one steers": (ackermann().replace("[fr, fl]", "[f]"), r"steering_joints_names: 1 joints, must be 2"),
    "late": (DIFF + "    cmd_vel_timeout: -1.0\n", r"cmd_vel_timeout: -1, must be >= 0"),
    "plugin": (
        DIFF.replace("DiffDriveController", "DiffDriveControler"),
        r"no such controller, did you mean 'diff_drive_controller/DiffDriveController'",
    ),
    "ambiguous": (
        without(ackermann(), "type:"),
        r"could be ackermann_steering_controller/.* or tricycle_steering_controller/.*: say its type",
    ),
    "nothing": ("a: 1\n", r"configures no wheeled controller"),
    "list": ("- 1\n", r"must be a mapping"),
    "empty": ("", r"empty, must be a mapping"),
}


@pytest.mark.parametrize("row", BROKEN)
def test_what_cannot_be_is_refused_with_its_place(robot_of, row):
    text, words = BROKEN[row]
    with pytest.raises(tr.ConfigError, match=words) as caught:
        robot_of(text)
    assert str(caught.value.source).endswith("controllers.yaml")


HOSTILE = {
    "object": b"a: !!python/object/apply:os.system ['true']\n",
    "alias": b"a: &a [x]\nb: [*a, *a]\n",
    "large": b"#" * (1 << 20) + b"#\n",
    "deep": b"[" * 40,
    "bytes": b"\xff\xfe\xfa",
    "double key": b"base: 1\nbase: 2\n",
}


@pytest.mark.parametrize("row", HOSTILE)
def test_hostile_files_are_refused(tmp_path, row):
    path = tmp_path / "c.yaml"
    path.write_bytes(HOSTILE[row])
    with pytest.raises(tr.ConfigError):
        robot_from_controllers(path)


def test_no_file(tmp_path):
    with pytest.raises(tr.ConfigError, match="cannot be read"):
        robot_from_controllers(tmp_path / "none.yaml")
    with pytest.raises(tr.ConfigError, match="is not a file"):
        robot_from_controllers(tmp_path)


# --- writing -------------------------------------------------------------------------------------

sizes = st.floats(0.01, 2.0)
drives = st.one_of(
    st.builds(
        tr.Differential,
        track_width=sizes,
        wheel_radius=st.fixed_dictionaries({"left": sizes, "right": sizes}),
    ),
    st.builds(
        tr.Mecanum, track_width=sizes, wheelbase=sizes, wheel_radius=sizes, reference=st.tuples(sizes, sizes)
    ),
    st.builds(
        tr.Omni,
        robot_radius=sizes,
        wheel_radius=sizes,
        wheel_count=st.integers(3, 6),
        first_wheel_angle=st.floats(-3.0, 3.0),
    ),
    st.builds(tr.SkidSteer, track_width=sizes, wheelbase=sizes, wheel_radius=sizes),
    st.builds(tr.Ackermann, track_width=sizes, wheelbase=sizes, wheel_radius=sizes),
    st.builds(tr.Bicycle, wheelbase=sizes, wheel_radius=sizes),
    st.builds(tr.Tricycle, wheelbase=sizes, wheel_radius=sizes),
    st.builds(
        tr.Tricycle,
        wheelbase=sizes,
        wheel_radius=sizes,
        track_width=sizes,
        measured=st.just(("rear_left", "rear_right")),
    ),
)
limits = st.builds(
    tr.Limits,
    max_speed=st.none() | sizes,
    max_yaw_rate=st.none() | sizes,
    max_acceleration=st.none() | sizes,
    max_deceleration=st.none() | sizes,
    command_timeout=st.integers(1, 5000).map(lambda ms: ms / 1000),
)


@settings(max_examples=60, deadline=None)
@given(drive=drives, limits=limits)
def test_what_is_written_reads_back(tmp_path_factory, drive, limits):
    path = tmp_path_factory.mktemp("written") / "c.yaml"
    text = controllers_text(tr.Robot(drive=drive, limits=limits))
    path.write_text(text)
    robot = robot_from_controllers(path)
    count = len(drive.measured_names)
    angles = [0.3] * len(drive.steered_names)
    if len(angles) == 2:
        angles = list(drive.expand_steering([0.3]))
    speeds = dict(zip(drive.measured_names, (1.0 + k for k in range(count)), strict=True))
    renamed = {one: name for name in speeds for one in robot.drive.measured_names if one.startswith(name)}
    here = drive.forward(list(speeds.values()), angles)
    there = robot.drive.forward([speeds[renamed[name]] for name in robot.drive.measured_names], angles)
    assert (there.vx, there.vy, there.omega) == pytest.approx(
        (here.vx, here.vy, here.omega), rel=1e-9, abs=1e-9
    )
    assert robot.limits.command_timeout == pytest.approx(limits.command_timeout)
    if "linear:" in text:
        assert robot.limits.max_speed == limits.max_speed
        assert robot.limits.max_deceleration == limits.max_deceleration
    assert {mapping.name for mapping in robot.log.wheels.values()} == {
        f"{name}_joint" if "wheel" in name else f"{name}_wheel_joint" for name in speeds
    }


def test_every_family_but_none_else_is_written():
    size = {"wheelbase": 0.3, "wheel_radius": 0.05}
    robots = [
        tr.Differential(track_width=0.3, wheel_radius=0.05),
        tr.Mecanum(track_width=0.3, **size),
        tr.Omni(robot_radius=0.3, wheel_radius=0.05),
        tr.Ackermann(track_width=0.3, **size),
        tr.Bicycle(**size),
        tr.Tricycle(track_width=0.3, measured=("rear_left", "rear_right"), **size),
        tr.Tricycle(**size),
    ]
    written = [controllers_text(tr.Robot(drive=drive)) for drive in robots]
    for text, family in zip(written, FAMILIES.values(), strict=True):
        assert f"type: {family.plugin}\n" in text
        (controller,) = find_controllers(parse_yaml(text.encode(), ""))
        assert all(family.knows(name) for name in controller.values)
        assert set(family.required) <= set(controller.values)
    with pytest.raises(tr.InputError, match="four_wheel_steering"):
        controllers_text(tr.Robot(drive=tr.FourWheelSteering(track_width=0.3, **size)))


def test_two_tracks_survive(robot_of, again):
    text = ackermann(
        "traction_track_width: 0.2", "steering_track_width: 0.16", "traction_wheels_radius: 0.03"
    )
    robot = robot_of(text)
    assert robot_to_data(again(robot, name="car")) == robot_to_data(robot)


def test_a_calibration_becomes_the_three_multipliers():
    nominal = tr.Robot(drive=tr.Differential(track_width=0.4, wheel_radius=0.05))
    calibrated = nominal.replace(
        drive=tr.Differential(track_width=0.412, wheel_radius={"left": 0.0495, "right": 0.0505})
    )
    text = controllers_text(calibrated, nominal=nominal)
    (controller,) = find_controllers(parse_yaml(text.encode(), ""))
    assert controller.values["wheel_separation"] == 0.4
    assert controller.values["wheel_radius"] == 0.05
    assert controller.values["wheel_separation_multiplier"] == pytest.approx(1.03)
    assert controller.values["left_wheel_radius_multiplier"] == pytest.approx(0.99)
    assert controller.values["right_wheel_radius_multiplier"] == pytest.approx(1.01)


def test_what_a_controller_cannot_say():
    size = {"wheelbase": 0.3, "wheel_radius": 0.05}
    moved = tr.Robot(drive=tr.Bicycle(**size, reference=(0.1, 0.0)))
    with pytest.raises(tr.InputError, match="only the mecanum controller"):
        controllers_text(moved)
    never = tr.Robot(drive=tr.Bicycle(**size), limits=tr.Limits(command_timeout="never"))
    with pytest.raises(tr.InputError, match="never"):
        controllers_text(never)
    aside = tr.Robot(drive=tr.Tricycle(**size, front_y=0.1))
    with pytest.raises(tr.InputError, match="front_y"):
        controllers_text(aside)
    with pytest.raises(tr.InputError, match="name 'a-b'"):
        controllers_text(tr.Robot(drive=tr.Bicycle(**size)), name="a-b")
    fast = tr.Robot(drive=tr.Bicycle(**size), limits=tr.Limits(max_speed=2.0))
    assert "# limits that this controller does not know: max_speed: 2.0" in controllers_text(fast)


def test_a_joint_that_turns_the_other_way_is_no_controllers_business(robot_of):
    robot = robot_of(DIFF)
    right = msgspec.structs.replace(robot.log.wheels["right"], sign=-1)
    wheels = {**robot.log.wheels, "right": right}
    turned = robot.replace(log=msgspec.structs.replace(robot.log, wheels=wheels))
    with pytest.raises(tr.InputError, match="starboard_joint: sign -1"):
        controllers_text(turned)


# --- a recording ---------------------------------------------------------------------------------


@pytest.mark.parametrize("feedback", ["true", "false"])
def test_a_recording_of_joint_states_is_tracked(robot_of, tmp_path, feedback):
    """The file that drives the robot is all that its recording needs, whatever order the joints come in."""
    robot = robot_of(f"{DIFF}    position_feedback: {feedback}\n")
    store = get_typestore(Stores.ROS2_HUMBLE)
    header, stamp, state = (store.types[name] for name in (HEADER, STAMP, STATE))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", STATE, typestore=store)
        for k in range(11):
            names = ["starboard_joint", "arm", "port_joint"]
            message = state(
                header=header(stamp=stamp(sec=k, nanosec=0), frame_id=""),
                name=names,
                position=np.array([2.0 * k, 7.0, 1.0 * k]),
                velocity=np.array([2.0, 0.0, 1.0]),
                effort=np.zeros(0),
            )
            writer.write(connection, k * 10**9, store.serialize_cdr(message, STATE))
    trajectory = tr.integrate(robot, tr.read_log(tmp_path / "bag", robot))
    assert trajectory.poses[-1][2] == pytest.approx(10 * 0.05 * (2.0 - 1.0) / 0.4)
    assert trajectory.twists[-1] == pytest.approx([0.075, 0.0, 0.125])
