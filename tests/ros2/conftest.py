"""The real node in a process of its own, and the rest of a ROS graph in this one, on one domain."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

ROBOT = """
name: rover
drive: {type: differential, track_width: 0.2, wheel_radius: 0.05}
limits: {max_speed: 1.0, max_yaw_rate: 4.0, max_acceleration: 1.0,
         max_deceleration: 2.0, command_timeout: 0.5}
noise: {wheel_distance: 0.01, lateral_slip: 0.01, wheel_radius: 0.005}
log:
  wheels: {left: {topic: /joint_states, name: left_joint}, right: {topic: /joint_states, name: right_joint}}
"""
JOINTS = ("left_joint", "right_joint")
WHEELS = "forward_velocity_controller/commands"
SECOND = 1_000_000_000

# Half of the domains for either process of tests; they begin anywhere, for who tests beside us.
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 2
_domains = itertools.count(os.getpid() % 50)


@pytest.fixture(scope="session", autouse=True)
def rclpy():
    """rclpy; these tests are for the environment that has it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # what rclpy imports is older than this Python
        pytest.importorskip("rosidl_generator_py", reason="rclpy lives in .envs/ros2")
        return pytest.importorskip("rclpy", reason="rclpy lives in .envs/ros2")


class Live:
    """A `trundle ros2` process, and a node that talks to it."""

    def __init__(self, folder: Path, *arguments: str, program: str = "", robot: str = ROBOT, ros: tuple = ()):
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self.domain = 1 + 50 * WORKER + next(_domains) % 50
        description = folder / "robot.yaml"
        description.write_text(robot)
        program = program or "import sys; from trundle.apps.cli import main; sys.exit(main())"
        words = ["ros2", "--robot", str(description), *arguments]
        words += ["--", "--ros-args", *ros] if ros else []
        self.environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(self.domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_LOCALHOST_ONLY": "1",
            "ROS_LOG_DIR": str(folder / "log"),
        }
        os.environ.update({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_LOG_DIR": str(folder / "log")})
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = rclpy.create_node("tester", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: dict[str, list] = {}
        self.stamp_ns = time.time_ns()
        self.turned = [0.0, 0.0]
        self._listen()
        self.errors = (folder / "stderr").open("w+")
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *words], env=self.environment, stderr=self.errors
        )

    def _listen(self):
        from diagnostic_msgs.msg import DiagnosticArray
        from geometry_msgs.msg import TwistStamped
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray

        for kind, topic in (
            (Odometry, "odom"),
            (Float64MultiArray, WHEELS),
            (DiagnosticArray, "/diagnostics"),
        ):
            self.hear(kind, topic)
        self.joints = self.node.create_publisher(JointState, "joint_states", 100)
        self.commands = self.node.create_publisher(TwistStamped, "cmd_vel", 10)

    def hear(self, kind, topic, qos=1000):
        """Keep what comes on a topic, with the time at which it came."""
        heard = self.heard.setdefault(topic, [])
        return self.node.create_subscription(
            kind, topic, lambda message: heard.append((time.monotonic(), message)), qos
        )

    # --- this side -------------------------------------------------------------------------------

    def spin(self, seconds: float):
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)

    def until(self, condition, timeout=10.0, meanwhile=lambda: None):
        """Spin until something is so; what it is."""
        end = time.monotonic() + timeout
        while not (found := condition()):
            assert self.process.poll() is None, self.complaint()
            assert time.monotonic() < end, f"waited {timeout} s for {condition}; {self.complaint()}"
            meanwhile()
            self.spin(0.02)
        return found

    def ready(self):
        """Wait until both sides have found each other."""
        self.until(
            lambda: self.joints.get_subscription_count() and self.commands.get_subscription_count(), 20
        )
        self.until(lambda: self.heard[WHEELS], 20)
        return self

    def sample(self, left=0.01, right=0.01, *, names=JOINTS, stamp_ns=None, after=SECOND // 200):
        """Wheels that have rolled on by this [rad]."""
        from sensor_msgs.msg import JointState

        self.stamp_ns += after
        self.turned = [self.turned[0] + left, self.turned[1] + right]
        by_name = dict(zip(JOINTS, self.turned, strict=True))
        message = JointState(name=list(names), position=[by_name.get(name, 7.0) for name in names])
        stamp_ns = self.stamp_ns if stamp_ns is None else stamp_ns
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND)
        self.joints.publish(message)
        return message

    def command(self, vx=0.5, omega=0.0, *, publisher=None, stamp_ns=None):
        from geometry_msgs.msg import TwistStamped

        message = TwistStamped()
        stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, SECOND)
        message.twist.linear.x, message.twist.angular.z = vx, omega
        (publisher or self.commands).publish(message)

    def drive(self, seconds: float, *args, **kwargs):
        """Command at 20 Hz."""
        for _ in range(round(20 * seconds)):
            self.command(*args, **kwargs)
            self.spin(0.05)

    # --- the other side --------------------------------------------------------------------------

    @property
    def odom(self):
        return [message for _, message in self.heard["odom"]]

    @property
    def wheels(self):
        return [list(message.data) for _, message in self.heard[WHEELS]]

    @property
    def pose(self):
        position = self.odom[-1].pose.pose.position
        return position.x, position.y

    def statuses(self):
        """Of the last report, by name."""
        reports = self.heard["/diagnostics"]
        return {status.name: status for status in reports[-1][1].status} if reports else {}

    def status(self, name):
        """Level, message and values of one part."""
        status = self.statuses().get(f"trundle: {name}")
        if status is None:
            return 0, "", {}
        return status.level[0], status.message, {pair.key: pair.value for pair in status.values}

    def call(self, kind, name, request=None):
        """What a service answers."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(kind.Request() if request is None else request)
        return self.until(lambda: future.result() if future.done() else None)

    def trigger(self, name):
        from std_srvs.srv import Trigger

        return self.call(Trigger, f"/trundle/{name}").message

    def rest(self):
        """Let the wheels come to rest, and forget what was heard."""
        self.until(lambda: self.wheels and not any(self.wheels[-1]))
        self.spin(0.1)
        for heard in self.heard.values():
            heard.clear()

    def signal(self, number):
        """Send a signal and wait; the exit code, and how long that took [s]."""
        began = time.monotonic()
        self.process.send_signal(number)
        code = self.process.wait(timeout=20)
        took = time.monotonic() - began
        self.spin(0.2)
        return code, took

    def complaint(self):
        self.errors.flush()
        return Path(self.errors.name).read_text()

    def close(self):
        if self.process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                self.process.send_signal(signal.SIGCONT)
            self.process.send_signal(signal.SIGINT)
            self.process.wait(timeout=20)
        self.errors.close()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def start(tmp_path):
    """Start a node; it is ended behind the test."""
    began: list[Live] = []

    def begin(*arguments, **options) -> Live:
        folder = tmp_path / str(len(began))
        folder.mkdir()
        began.append(Live(folder, *arguments, **options))
        return began[-1]

    yield begin
    for live in began:
        live.close()


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """One node for the tests of a module that leave it as they find it."""
    live = Live(tmp_path_factory.mktemp("node"), ros=("-p", "cmd_vel_topics:=[joy_vel, cmd_vel]")).ready()
    yield live
    live.close()
