"""FAULTS.md K1 to K4, K11, K12 and R1 to R6 against the real node, over DDS, with real processes."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

# rclpy itself still says `warn`.
pytestmark = pytest.mark.filterwarnings("ignore:Deprecated in favor of:DeprecationWarning")

HOUR = 3600 * 10**9

PUBLISHER = """
import rclpy, time
from geometry_msgs.msg import TwistStamped
rclpy.init()
node = rclpy.create_node("doomed")
publisher = node.create_publisher(TwistStamped, "cmd_vel", 10)
while True:
    message = TwistStamped()
    message.header.stamp = node.get_clock().now().to_msg()
    message.twist.linear.x = 0.5
    publisher.publish(message)
    time.sleep(0.05)
"""


def moving(live):
    return live.wheels and max(map(abs, live.wheels[-1])) > 5.0


def stopped(live):
    return live.wheels and not any(live.wheels[-1])


def assert_falls(wheels):
    """Once it slows down, it slows down to rest and never speeds up."""
    speeds = [max(map(abs, wheel)) for wheel in wheels]
    top = len(speeds) - 1 - speeds[::-1].index(max(speeds))
    falling = speeds[top:]
    assert falling == sorted(falling, reverse=True)
    assert len(falling) > 5  # a ramp, not a step
    assert falling[-1] == 0.0


def fault_k1(live):
    """NaN after good commands: the good one ages, and the robot stops by the ramp."""
    live.until(lambda: moving(live), meanwhile=live.command)
    live.until(lambda: stopped(live), meanwhile=lambda: live.command(math.nan))
    assert_falls(live.wheels)
    counted = "rejected nonfinite"
    live.until(
        lambda: int(live.status("commands")[2].get(counted, 0)) > 5, meanwhile=lambda: live.command(math.inf)
    )


def fault_k2(live):
    """The controller is killed outright."""
    doomed = subprocess.Popen([sys.executable, "-c", PUBLISHER], env=live.environment)
    try:
        live.until(lambda: moving(live), 20)
    finally:
        doomed.kill()
        doomed.wait()
    live.until(lambda: stopped(live))
    assert_falls(live.wheels)
    live.until(lambda: "no command" in live.status("commands")[1])


def fault_k3(live):
    """Commands of another hour do not move the robot; nor does a sample of another hour move its pose."""
    for off in (HOUR, -HOUR, None):
        live.drive(0.3, stamp_ns=0 if off is None else time.time_ns() + off)
    assert not any(any(wheel) for wheel in live.wheels)
    live.until(lambda: {"rejected future", "rejected stale"} <= live.status("commands")[2].keys())
    live.drive(0.2, 0.0)
    for _ in range(20):
        live.sample()
        live.spin(0.005)
    live.sample(stamp_ns=live.stamp_ns + HOUR)
    live.sample(stamp_ns=live.stamp_ns - HOUR)
    live.sample()
    last = live.stamp_ns
    live.until(lambda: stamps(live)[-1:] == [last])
    assert max(stamps(live)) == last
    assert live.odom[-1].pose.covariance[0] < 1e-2


def fault_k4(live):
    """The node itself stands still for a second and a half while commands come: its first word is stop."""
    live.until(lambda: moving(live), meanwhile=live.command)
    live.process.send_signal(signal.SIGSTOP)
    live.drive(1.5)
    live.process.send_signal(signal.SIGCONT)
    live.drive(1.0)
    times = [when for when, _ in live.heard["forward_velocity_controller/commands"]]
    gap = int(np.argmax(np.diff(times))) + 1
    assert times[gap] - times[gap - 1] > 0.8
    after = [max(map(abs, wheel)) for wheel in live.wheels[gap:]]
    assert after[0] == 0.0
    # 1 m/s^2 on wheels of 5 cm, in at most two periods; on a busy machine the stop may be said twice before.
    assert next(speed for speed in after if speed) < 2.0


def fault_k11(live):
    """An emergency stop, while it drives and goes on being told to."""
    live.until(lambda: moving(live), meanwhile=live.command)
    assert "release" in live.trigger("emergency_stop")
    live.spin(0.1)
    heard = len(live.wheels)
    live.drive(0.5)
    assert len(live.wheels) > heard
    assert not any(any(wheel) for wheel in live.wheels[heard:])
    live.until(lambda: live.status("commands")[0] == 2)
    assert "zero" in live.trigger("release")
    live.drive(0.3)
    assert not any(any(wheel) for wheel in live.wheels[heard:])
    live.drive(0.2, 0.0)
    live.until(lambda: moving(live), meanwhile=live.command)


def fault_k12(live):
    """Two controllers on one topic: the first drives. One on a more important topic takes over."""
    from geometry_msgs.msg import TwistStamped

    rival = live.node.create_publisher(TwistStamped, "cmd_vel", 10)
    boss = live.node.create_publisher(TwistStamped, "joy_vel", 10)
    live.until(lambda: rival.get_subscription_count() and boss.get_subscription_count())

    def both():
        live.command(0.5)
        live.command(-0.5, publisher=rival)

    live.until(lambda: moving(live), meanwhile=both)
    assert all(left >= 0.0 for left, _ in live.wheels)
    live.until(lambda: int(live.status("commands")[2].get("rejected no_lease", 0)) > 5, meanwhile=both)
    assert "/tester on /cmd_vel" in live.status("commands")[2]["lease"]

    def all_three():
        both()
        live.command(-0.4, publisher=boss)

    live.until(lambda: live.wheels[-1][0] < -7.9, meanwhile=all_three)
    live.until(lambda: moving(live) and live.wheels[-1][0] > 0.0, meanwhile=live.command)  # it fell silent
    live.node.destroy_publisher(rival)
    live.node.destroy_publisher(boss)


def fault_r1(live):
    """Quality of service and types that do not match are said, with both, while they last."""
    from nav_msgs.msg import Odometry
    from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String

    lossy = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    keen = QoSProfile(depth=5, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = live.node.create_publisher(JointState, "joint_states", lossy)
    late = live.hear(Odometry, "odom", keen)
    stranger = live.node.create_publisher(String, "set_pose", 5)

    def said():
        level, _, values = live.status("topics")
        return values if level == 2 and len(values) == 3 else None

    words = sorted(live.until(said).values())
    assert words[0].startswith("/joint_states: reliability does not match")
    assert "/tester publishes (best_effort, volatile), /trundle subscribes (reliable, volatile)" in words[0]
    assert (
        "/trundle publishes (reliable, volatile), /tester subscribes (reliable, transient_local)" in words[1]
    )
    assert words[2].startswith("/set_pose: type does not match")
    assert "std_msgs/msg/String" in words[2]
    assert "geometry_msgs/msg/PoseWithCovarianceStamped" in words[2]
    for one in (publisher, stranger):
        live.node.destroy_publisher(one)
    live.node.destroy_subscription(late)
    live.until(lambda: live.status("topics")[0] < 2)


def stamps(live):
    return [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in live.odom]


def fault_r3(live):
    """A sample that is published twice, and one that comes late, give no odometry of their own."""
    for _ in range(10):
        live.sample()
        live.joints.publish(live.sample(0.0, 0.0, after=0))
        live.sample(0.0, 0.0, stamp_ns=live.stamp_ns - 10**6, after=0)
    last = live.stamp_ns
    live.until(lambda: stamps(live)[-1:] == [last])
    assert stamps(live) == sorted(set(stamps(live)))
    assert len(live.odom) == 10


def fault_r4(live):
    """Joints in another order are the same joints; a message without one of them is refused."""
    live.sample()
    live.until(lambda: live.odom)
    x, y = live.pose
    for names in (("right_joint", "left_joint"), ("arm", "left_joint", "right_joint")):
        live.sample(0.0, 0.0, names=names)
    live.sample(0.0, 0.0, names=("left_joint", "arm"))
    live.sample(0.0, 0.0)
    last = live.stamp_ns
    live.until(lambda: stamps(live)[-1:] == [last])
    assert len(live.odom) == 4
    assert live.pose == pytest.approx((x, y), abs=1e-12)
    live.until(lambda: "rejected missing_joint" in live.status("odometry")[2])


def fault_r6(live):
    """Rotations of norm 1, covariances that a filter can invert, 1e6 for what nobody knows."""
    for _ in range(50):
        live.sample(0.01, 0.03)
    last = live.stamp_ns
    live.until(lambda: stamps(live)[-1:] == [last])
    for message in live.odom:
        turn = message.pose.pose.orientation
        assert math.hypot(turn.x, turn.y, turn.z, turn.w) == pytest.approx(1.0, abs=1e-9)
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        for flat in (message.pose.covariance, message.twist.covariance):
            matrix = flat.reshape(6, 6)
            np.testing.assert_array_equal(matrix, matrix.T)
            np.testing.assert_array_equal(np.diag(matrix)[2:5], 1e6)
            assert np.linalg.eigvalsh(matrix).min() > 0.0


SHARED = ("C11", "K1", "K2", "K3", "K4", "K11", "K12", "R1", "R3", "R4", "R5", "R6")
ALONE = ("R2",)  # needs another clock


BROKEN = """
import sys
from trundle.apps.cli import main
from trundle.apps.ros2.node import RobotNode
RobotNode._on_set_pose = lambda self, message: 1 / 0
sys.exit(main())
"""


@pytest.mark.parametrize("end", ["SIGINT", "SIGTERM", "crash"])
def test_ends(end, start):
    """However it ends, the last word to the wheels is zero, and it is gone within a second."""
    live = start(program=BROKEN).ready()
    live.until(lambda: moving(live), meanwhile=live.command)
    if end == "crash":
        from geometry_msgs.msg import PoseWithCovarianceStamped

        pose = live.node.create_publisher(PoseWithCovarianceStamped, "set_pose", 1)
        live.until(pose.get_subscription_count)
        pose.publish(PoseWithCovarianceStamped())
        code = live.process.wait(timeout=20)
        live.spin(0.2)
        assert "ZeroDivisionError" in live.complaint()
    else:
        code, took = live.signal(getattr(signal, end))
        assert took < max(1.0, os.getloadavg()[0] / os.cpu_count())  # a second, where nobody else wants it
        assert "Traceback" not in live.complaint()
    assert code == {"SIGINT": 130, "SIGTERM": 143, "crash": 1}[end]
    assert live.wheels[-1] == [0.0, 0.0]


def turn_to(live, transition):
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    number = getattr(Transition, f"TRANSITION_{transition}")
    request = ChangeState.Request(transition=Transition(id=number))
    assert live.call(ChangeState, "/trundle/change_state", request).success


def set_parameters(live, **values):
    """Set parameters all at once; why that did not work, or ""."""
    from rcl_interfaces.srv import SetParametersAtomically
    from rclpy.parameter import Parameter

    request = SetParametersAtomically.Request(
        parameters=[
            Parameter(name.replace("__", "."), value=value).to_parameter_msg()
            for name, value in values.items()
        ]
    )
    answer = live.call(SetParametersAtomically, "/trundle/set_parameters_atomically", request).result
    return "" if answer.successful else answer.reason


def fault_r5(live):
    """Deactivated: one zero, then silence; activated again it waits for a new command."""
    live.until(lambda: moving(live), meanwhile=live.command)
    turn_to(live, "DEACTIVATE")
    live.spin(0.2)
    heard = len(live.wheels)
    assert live.wheels[-1] == [0.0, 0.0]
    live.sample()
    live.drive(0.3)
    assert len(live.wheels) == heard
    assert not live.odom
    turn_to(live, "ACTIVATE")
    live.until(lambda: len(live.wheels) > heard + 5)
    assert not any(any(wheel) for wheel in live.wheels[heard:])
    live.until(lambda: moving(live), meanwhile=live.command)


def fault_r2(start):
    """A simulation that begins anew, and time that is no longer simulated: the pose goes on."""
    from rosgraph_msgs.msg import Clock

    live = start(ros=("-p", "use_sim_time:=true")).ready()
    clock = live.node.create_publisher(Clock, "/clock", 10)
    live.until(clock.get_subscription_count)

    def at(seconds, count):
        """Simulated time from here on."""
        live.stamp_ns = round(seconds * 1e9)
        for _ in range(count):
            message = Clock()
            message.clock.sec, message.clock.nanosec = divmod(live.stamp_ns, 10**9)
            clock.publish(message)
            live.sample()
            live.command(stamp_ns=live.stamp_ns)
            live.spin(0.005)

    at(1000.0, 100)
    live.until(lambda: moving(live), meanwhile=lambda: at(live.stamp_ns / 1e9, 1))
    before = live.pose
    at(0.0, 100)
    last = live.stamp_ns
    live.until(lambda: stamps(live)[-1:] == [last])
    assert last < 10**9
    epochs = np.flatnonzero(np.diff(stamps(live)) < 0)
    assert len(epochs) == 1
    assert live.pose[0] > before[0] + 97 * 0.01 * 0.05
    assert live.odom[-1].pose.covariance[0] < 1.0
    assert set_parameters(live, use_sim_time=False) == ""
    live.stamp_ns = time.time_ns()
    for _ in range(10):
        live.sample()
        live.spin(0.005)
    last = live.stamp_ns
    live.until(lambda: stamps(live)[-1:] == [last])
    live.until(lambda: moving(live), meanwhile=live.command)


def fault_c11(live):
    """A set of parameters of which one is impossible changes nothing; a possible set changes all of it."""

    def turn():
        live.command(0.2, 2.0)

    reason = set_parameters(live, wheel_separation=0.4, wheel_radius=-1.0)
    assert "wheel_radius: -1, must be > 0" in reason
    live.until(lambda: live.wheels[-1] == pytest.approx([0.0, 8.0], abs=1e-6), meanwhile=turn)
    assert set_parameters(live, wheel_separation=0.1, angular__z__max_velocity=1.0) == ""
    live.until(
        lambda: live.wheels[-1] == pytest.approx([1.0, 3.0], abs=1e-6),
        meanwhile=lambda: live.command(0.2, 2.0),
    )
    assert "must be" in set_parameters(live, cmd_vel_timeout=0.0)
    assert "read-only" in set_parameters(live, update_rate=10.0)
    assert set_parameters(live, wheel_separation=0.2, angular__z__max_velocity=4.0) == ""


@pytest.mark.parametrize("row", [pytest.param(row, id=row) for row in (*SHARED, *ALONE)])
def test_fault(row, request):
    if row in SHARED:
        shared = request.getfixturevalue("shared")
        shared.rest()
        globals()[f"fault_{row.lower()}"](shared)
    else:
        globals()[f"fault_{row.lower()}"](request.getfixturevalue("start"))
