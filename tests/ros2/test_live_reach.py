"""The node at work: every sample counts, live equals the log, and simulated robots are driven over ROS."""

from __future__ import annotations

import math
import os
import pty
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from trundle import integrate, load_robot, read_log, read_trajectory
from trundle.adapters.mcap_records import HEAD, MESSAGE_FIELDS, Kind
from trundle.adapters.mcap_writer import Channel, McapWriter
from trundle.apps.cli import main

SECOND = 10**9
SEPARATOR = "\n" + "=" * 80 + "\n"
JOINT_STATE = SEPARATOR.join(
    (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id",
        "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec",
    )
)


def stamp_ns(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def record(path, messages):
    """A session as an MCAP, with Trundle's own writer: what was on the wire, byte for byte."""
    from rclpy.serialization import serialize_message

    channel = Channel("/joint_states", "sensor_msgs/msg/JointState", JOINT_STATE)
    with path.open("wb") as file, McapWriter(file, [channel]) as writer:
        records, starts = b"", []
        for number, message in enumerate(messages):
            data, stamp = serialize_message(message), stamp_ns(message)
            starts.append(len(records))
            head = np.zeros(1, HEAD)
            head[0] = (Kind.MESSAGE, MESSAGE_FIELDS + len(data), 1, number, stamp, stamp)
            records += head.tobytes() + data
        stamps = np.array([stamp_ns(message) for message in messages])
        writer.add(records, {1: (stamps, np.array(starts))})


def wobble(k, rate):
    """What the wheels turn in the k-th step [rad]: a drive of many curves within the robot's limits."""
    t = k / rate
    return [(8.0 + 4.0 * math.sin(f * t)) / rate for f in (0.7, 1.1)]


def session(live, rate, seconds):
    """Publish samples at a rate, in time; what was sent, and when."""
    sent, times = [], {}
    began = time.perf_counter()
    for k in range(round(rate * seconds)):
        wait = began + k / rate - time.perf_counter()
        live.spin(max(wait, 0.0))
        message = live.sample(*wobble(k, rate), after=SECOND // rate)
        times[stamp_ns(message)] = time.monotonic()
        sent.append(message)
    return sent, times


def assert_live_equals_the_log(live, sent, folder):
    """None lost; the poses those of `trundle track` on the same samples, recorded as MCAP."""
    live.until(lambda: len(live.odom) >= len(sent), 20)
    assert [stamp_ns(message) for message in live.odom] == [stamp_ns(message) for message in sent]
    recording, tracked = folder / "session.mcap", folder / "session.csv"
    record(recording, sent)
    description = folder / "robot.yaml"
    assert main(["track", str(recording), "--robot", str(description), "-o", str(tracked)]) == 0
    poses = read_trajectory(tracked).poses
    positions = np.array([(m.pose.pose.position.x, m.pose.pose.position.y) for m in live.odom])
    turns = np.array([(m.pose.pose.orientation.z, m.pose.pose.orientation.w) for m in live.odom])
    headings = 2.0 * np.arctan2(*turns.T)
    assert np.abs(positions - poses[:, :2]).max() < 1e-9
    assert np.abs(np.remainder(headings - poses[:, 2] + math.pi, math.tau) - math.pi).max() < 1e-9
    robot = load_robot(description)
    trajectory = integrate(robot, read_log(recording, robot), covariance=True)
    live_doubt = np.array([message.pose.covariance[35] for message in live.odom])
    np.testing.assert_allclose(live_doubt, trajectory.covariances[:, 2, 2], rtol=1e-9, atol=1e-15)


def percentiles(live, topic, times):
    """From each sample to the message with its stamp [ms]: median, and what one in a hundred exceeds."""
    ms = sorted(1e3 * (came - times[stamp_ns(message)]) for came, message in live.heard[topic])
    return ms[len(ms) // 2], ms[round(len(ms) * 0.99)]


def test_200_hz_for_ten_seconds(start, tmp_path):
    live = start().ready()
    sent, _ = session(live, 200, 10.0)
    assert_live_equals_the_log(live, sent, tmp_path / "0")


BARE = """
import rclpy
from nav_msgs.msg import Odometry
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("bare")
publisher = node.create_publisher(Odometry, "bare", 100)
message = Odometry()
def take(joints):
    message.header.stamp = joints.header.stamp
    publisher.publish(message)
node.create_subscription(JointState, "joint_states", take, 100)
executor = EventsExecutor()
executor.add_node(node)
while True:
    executor.spin_once(timeout_sec=1.0)
"""


@pytest.mark.verify
def test_200_hz_for_a_minute(start, tmp_path):
    """And how late: within 5 ms, or where the machine is too busy for that, hardly later than rclpy alone."""
    from nav_msgs.msg import Odometry

    live = start().ready()
    bare = subprocess.Popen([sys.executable, "-c", BARE], env=live.environment)
    try:
        live.hear(Odometry, "bare")
        live.until(lambda: live.joints.get_subscription_count() == 2, 20)
        sent, times = session(live, 200, 60.0)
        assert_live_equals_the_log(live, sent, tmp_path / "0")
    finally:
        bare.kill()
        bare.wait()
    (middle, late), (bare_middle, bare_late) = (percentiles(live, topic, times) for topic in ("odom", "bare"))
    print(
        f"joint_states -> odom -> here: median {middle:.2f} ms, p99 {late:.2f} ms, {len(live.odom)} of "
        f"{len(sent)}; rclpy alone beside it: median {bare_middle:.2f} ms, p99 {bare_late:.2f} ms"
    )
    assert late < max(5.0, 1.5 * bare_late)


def cpu_seconds(process):
    """What a process has computed so far."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


@pytest.mark.verify
def test_1_khz_on_half_a_core(start):
    """The node keeps up; what it computes is measured, whatever else the machine does."""
    live = start().ready()
    live.node.destroy_subscription(next(one for one in live.node.subscriptions if one.topic_name == "/odom"))
    before, began = cpu_seconds(live.process), time.monotonic()
    count = 10_000
    for k in range(count):
        wait = began + k / 1000 - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
        live.sample(*wobble(k, 1000), after=SECOND // 1000)
    seconds = time.monotonic() - began
    load = (cpu_seconds(live.process) - before) / seconds
    live.until(lambda: int(live.status("odometry")[2].get("accepted", 0)) == count, 20)
    print(f"{count / seconds:.0f} Hz: the node computes {load:.2f} of a core; every sample counted")
    assert load < 0.5


# ------------------------------------------------------------------------------- simulation

CAR = """
name: car
drive: {type: ackermann, wheelbase: 0.3, track_width: 0.2, wheel_radius: 0.05,
        measured: [rear_left, rear_right, gyro]}
limits: {max_speed: 1.0, max_steering: 0.6}
noise: {wheel_distance: 0.001, gyro: 0.001}
"""


@pytest.mark.parametrize("how", ["forward_controllers", "joint_state"])
def test_a_simulated_car_is_driven_with_plain_twists(how, start):
    """Twist in place of TwistStamped; gyro, steering and both kinds of wheel commands; the truth is found."""
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry

    live = start("--simulate", robot=CAR, ros=("-p", f"wheel_command_type:={how}"))
    live.node.destroy_publisher(live.commands)
    live.hear(Odometry, "ground_truth")
    live.commands = live.node.create_publisher(Twist, "cmd_vel", 10)
    live.until(lambda: live.heard["ground_truth"] and live.odom, 20)
    message = Twist()
    message.linear.x, message.angular.z = 0.8, 0.8

    def far():
        return live.heard["ground_truth"][-1][1].pose.pose.position.x > 0.5

    live.until(far, 20, meanwhile=lambda: live.commands.publish(message))
    live.spin(1.0)  # it stops by itself
    truth, found = live.heard["ground_truth"][-1][1].pose.pose, live.odom[-1].pose.pose
    assert math.hypot(truth.position.x - found.position.x, truth.position.y - found.position.y) < 0.05
    assert abs(live.odom[-1].twist.twist.linear.x) < 0.02  # the gyro is never quite still
    assert truth.orientation.z > 0.1


def test_the_keyboard_example_drives(shared, checkout):
    """In a terminal of its own: faster, an emergency stop that holds, its release, and off again."""
    live = shared
    keyboard, terminal = pty.openpty()
    script = checkout / "examples" / "ros2" / "teleop.py"
    teleop = subprocess.Popen(
        [sys.executable, str(script)], stdin=terminal, stdout=subprocess.PIPE, env=live.environment
    )

    def press(keys):
        os.write(keyboard, keys.encode())

    def speed():
        return live.wheels[-1][0] * 0.05

    try:
        assert b"w, s" in teleop.stdout.readline()  # from now on it takes single keys
        press("www")
        live.until(lambda: speed() == pytest.approx(0.3), 20)
        press("e")
        live.until(lambda: speed() == 0.0)
        press("w")
        live.spin(0.5)
        assert speed() == 0.0
        press("r ")
        live.spin(0.5)
        press("s")
        live.until(lambda: speed() == pytest.approx(-0.1))
        press("q")
        assert teleop.wait(timeout=10) == 0
        live.until(lambda: speed() == 0.0)
    finally:
        teleop.kill()
        teleop.wait()
        teleop.stdout.close()
        os.close(keyboard)
        os.close(terminal)


def test_a_pose_is_set_and_reset(shared):
    from geometry_msgs.msg import PoseWithCovarianceStamped

    live = shared
    poses = live.node.create_publisher(PoseWithCovarianceStamped, "set_pose", 1)
    live.until(poses.get_subscription_count)
    message = PoseWithCovarianceStamped()
    message.header.frame_id = "odom"
    message.pose.pose.position.x = 3.0
    message.pose.pose.orientation.z = message.pose.pose.orientation.w = math.sqrt(0.5)
    message.pose.covariance[0], message.pose.covariance[7], message.pose.covariance[35] = 0.25, 0.01, 0.1
    poses.publish(message)
    live.until(lambda: live.odom and live.pose[0] == 3.0, meanwhile=live.sample)
    assert live.odom[-1].pose.covariance[0] >= 0.25
    assert live.odom[-1].pose.covariance[7] < 0.1
    message.header.frame_id = "map"
    message.pose.pose.position.x = 9.0
    poses.publish(message)
    live.spin(0.2)
    assert live.trigger("reset") == "the pose is zero"
    live.until(lambda: abs(live.pose[0]) < 0.1, meanwhile=live.sample)
    assert max(message.pose.pose.position.x for message in live.odom) < 4.0


def test_what_ros_does_not_understand_is_refused(start):
    refused = {
        ("-p", "wheel_radius:=-1.0"): "trundle: wheel_radius: -1, must be > 0",
        ("-p", "wheel_radius:=big"): "wheel_radius: must be of type double",
        ("--nonsense",): "--nonsense",
    }
    lives = {words: start(ros=arguments) for arguments, words in refused.items()}
    for words, live in lives.items():
        assert live.process.wait(timeout=20) == 2
        assert words in live.complaint().splitlines()[-1]
