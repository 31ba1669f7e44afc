"""The node: clocks, topics, services and parameters of rclpy around a `Base`, which decides."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from trundle.apps.ros2 import messages
from trundle.apps.ros2.base import Base, Prepared, Report
from trundle.apps.ros2.command_topics import CommandTopics
from trundle.apps.ros2.diagnostics import Diagnostics, Status
from trundle.apps.ros2.endpoints import Endpoint, QoS, mismatches
from trundle.apps.ros2.installation import message_type
from trundle.apps.ros2.parameters import configured, declared
from trundle.command import DriveCommand, Reason
from trundle.errors import ConfigError, InputError
from trundle.geometry import Pose2D
from trundle.odometry.covariance import ZERO
from trundle.robot import Robot, WheelCommand

__all__ = ["RobotNode", "lifecycle_node"]

NO_TF = "/tf is not published: there is no tf2_msgs here (a ROS installation has it, PyPI does not)"
NO_DIAGNOSTICS = "/diagnostics is not published: there is no diagnostic_msgs here"

_JOINT_DEPTH = 1000  # samples that wait while the node is busy: a second of fast ones
_SHOUTED = (Reason.TIMEOUT, Reason.EMERGENCY_STOP, Reason.LOOP_STALLED)


def lifecycle_node(name: str, turned: Callable[[str], None]) -> Any:
    """A lifecycle node whose `polled()` names subscriptions that no executor may take from.

    Args:
        name: Its name.
        turned: Called when it is turned to `activate`, `deactivate` or `shutdown`.
    """
    from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

    class Managed(LifecycleNode):  # type: ignore[misc, unused-ignore]
        """Hands its transitions on, and keeps what is polled from its executor."""

        polled: Callable[[], list[Any]] = staticmethod(list)

        @property
        def subscriptions(self) -> Iterator[Any]:
            own = self.polled()
            return (one for one in super().subscriptions if one not in own)

        def on_activate(self, state: Any) -> Any:
            turned("activate")
            return super().on_activate(state)

        def on_deactivate(self, state: Any) -> Any:
            turned("deactivate")
            return super().on_deactivate(state)

        def on_shutdown(self, _state: Any) -> Any:
            turned("shutdown")
            return TransitionCallbackReturn.SUCCESS

    return Managed(name)


class RobotNode:
    """A robot on ROS 2.

    Args:
        robot: Its description.
        name: Of the node.

    Attributes:
        node: rclpy's.
        base: What decides.

    Raises:
        ConfigError: If a parameter is impossible.
    """

    def __init__(self, robot: Robot, *, name: str = "trundle") -> None:
        from rclpy.clock import Clock, ClockType

        self.node = lifecycle_node(name, self._turn)
        self._robot = robot
        self._declared = declared(robot)
        self._pending: Prepared | None = None
        self.base = Base(configured(robot, self._declare()))
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._log = self.node.get_logger()
        self._shouted: Reason | None = None
        self._closed = False
        self._unmatched: list[str] = []
        self._publish()
        self._subscribe()
        self._serve()
        self._diagnostics = Diagnostics(self.base, time.monotonic_ns())
        self._every(1.0 / self.base.settings.update_rate, self._tick)
        self._every(0.1, self._commands.follow)
        self._every(1.0, self._diagnose)
        joints, told = self.base.joints, self.base.joints.command(self.base.rest())
        self._log.info(
            f"{robot.name}: reads {', '.join(joints.names)} of {joints.topic}; "
            f"drives {', '.join((*told.velocities, *told.positions))}"
        )
        self._warn(*self._missing)

    def start(self) -> None:
        """Configure and activate."""
        self.node.trigger_configure()
        self.node.trigger_activate()

    def close(self) -> None:
        """Stop the wheels, wait until they know, and go."""
        from rclpy.duration import Duration

        if self._closed:
            return
        self._closed = True
        self._send(self.base.deactivate())
        for publisher in self._wheel_publishers:
            publisher.wait_for_all_acked(Duration(seconds=0.2))
        self.node.destroy_node()

    # --- parameters -----------------------------------------------------------------------------

    def _declare(self) -> dict[str, Any]:
        """Declare every parameter; their values.

        Raises:
            ConfigError: If one was given another type than it has.
        """
        from rclpy.exceptions import InvalidParameterTypeException
        from rclpy.parameter import Parameter

        descriptor = message_type("rcl_interfaces.msg", "ParameterDescriptor")
        values = {}
        for name, parameter in self._declared.items():
            described = descriptor(description=parameter.description, read_only=not parameter.live)
            try:
                values[name] = self.node.declare_parameter(name, parameter.default, described).value
            except InvalidParameterTypeException as error:
                wanted = Parameter.Type.from_parameter_value(parameter.default).name.lower()
                raise ConfigError(name, f"must be of type {wanted}: {error}") from None
        self.node.add_on_set_parameters_callback(self._check_parameters)
        self.node.add_post_set_parameters_callback(self._adopt_parameters)
        return values

    def _check_parameters(self, changed: Sequence[Any]) -> Any:
        """Whether all of these can be at once; if not, none of them is."""
        result = message_type("rcl_interfaces.msg", "SetParametersResult")
        new = {one.name: one.value for one in changed if one.name in self._declared}
        if not new:
            return result(successful=True)
        values = {name: self.node.get_parameter(name).value for name in self._declared} | new
        try:
            self._pending = self.base.prepared(configured(self._robot, values))
        except ConfigError as error:
            return result(successful=False, reason=str(error))
        return result(successful=True)

    def _adopt_parameters(self, _changed: Sequence[Any]) -> None:
        pending, self._pending = self._pending, None
        if pending is not None:
            self.base.adopt(pending)
            self._name_frames()
            self._warn()

    def _warn(self, *others: str) -> None:
        """Say what a person must know whenever it is so."""
        for warning in (*self.base.settings.robot.limits.warnings, *others):
            self._log.warning(warning)

    # --- topics ---------------------------------------------------------------------------------

    def _publish(self) -> None:
        """Publishers, and the messages that are filled in again and again."""
        from geometry_msgs.msg import TransformStamped
        from nav_msgs.msg import Odometry

        self._missing: list[str] = []
        self._odom = self._publisher(Odometry, "odom", 100)
        self._odometry = Odometry()
        self._transform = TransformStamped()
        self._name_frames()
        self._tf: Any = None
        self._tf_message: Any = None
        if (tf_type := message_type("tf2_msgs.msg", "TFMessage")) is not None:
            self._tf = self._publisher(tf_type, "/tf", 100)
            self._tf_message = tf_type(transforms=[self._transform])
        elif self.base.settings.enable_odom_tf:
            self._missing.append(NO_TF)
        self._status_type = message_type("diagnostic_msgs.msg", "DiagnosticStatus")
        self._status: Any = None
        if self._status_type is None:
            self._missing.append(NO_DIAGNOSTICS)
        else:
            array = message_type("diagnostic_msgs.msg", "DiagnosticArray")
            self._status = self._publisher(array, "/diagnostics", 10)
        self._wheel_publishers = self._wheel_topics()

    def _wheel_topics(self) -> list[Any]:
        from sensor_msgs.msg import JointState
        from std_msgs.msg import Float64MultiArray

        if self.base.settings.wheel_command_type == "joint_state":
            return [self._publisher(JointState, "joint_commands", 1)]
        told = self.base.joints.command(self.base.rest())
        topics = [("forward_velocity_controller/commands", told.velocities)]
        topics += [("forward_position_controller/commands", told.positions)]
        return [self._publisher(Float64MultiArray, topic, 1) for topic, joints in topics if joints]

    def _publisher(self, kind: Any, topic: str, depth: int) -> Any:
        from rclpy.qos_overriding_options import QoSOverridingOptions

        options = QoSOverridingOptions.with_default_policies()
        return self.node.create_publisher(kind, topic, depth, qos_overriding_options=options)

    def _subscription(self, kind: Any, topic: str, callback: Callable[..., None], qos: Any) -> Any:
        from rclpy.qos_overriding_options import QoSOverridingOptions

        options = QoSOverridingOptions.with_default_policies()
        return self.node.create_subscription(kind, topic, callback, qos, qos_overriding_options=options)

    def _subscribe(self) -> None:
        from geometry_msgs.msg import PoseWithCovarianceStamped
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import Imu, JointState

        joints = self.base.joints
        self._subscriptions = [
            self._subscription(JointState, joints.topic, self._on_joint_states, _JOINT_DEPTH),
            self._subscription(PoseWithCovarianceStamped, "set_pose", self._on_set_pose, 10),
        ]
        if joints.imu_topic is not None:
            imu = self._subscription(Imu, joints.imu_topic, self._on_imu, qos_profile_sensor_data)
            self._subscriptions.append(imu)
        self._commands = CommandTopics(self.node, self.base.settings.cmd_vel_topics)
        self.node.polled = lambda: self._commands.subscriptions

    def _serve(self) -> None:
        from std_srvs.srv import Trigger

        answers = {
            "~/reset": self._reset,
            "~/emergency_stop": self._emergency_stop,
            "~/release": self.base.release,
        }

        def answering(answer: Callable[[], str]) -> Callable[[Any, Any], Any]:
            def respond(_request: Any, response: Any) -> Any:
                response.success, response.message = True, answer()
                return response

            return respond

        self._services = [
            self.node.create_service(Trigger, name, answering(answer)) for name, answer in answers.items()
        ]

    def _every(self, seconds: float, callback: Callable[[], None]) -> None:
        self.node.create_timer(seconds, callback, clock=self._steady)

    def _name_frames(self) -> None:
        settings = self.base.settings
        for message in (self._odometry, self._transform):
            message.header.frame_id = settings.odom_frame_id
            message.child_frame_id = settings.base_frame_id

    def _clock_ns(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)

    # --- what happens ---------------------------------------------------------------------------

    def _on_joint_states(self, message: Any) -> None:
        stamp = messages.read_stamp(message.header.stamp)
        now, base = time.monotonic_ns(), self.base
        clock = self._clock_ns() if base.joints.receive_clock else 0
        self._report(base.on_joint_states(message.name, message, stamp, now, clock))

    def _on_imu(self, message: Any) -> None:
        self.base.on_imu(message.angular_velocity.z, time.monotonic_ns())

    def _on_set_pose(self, message: Any) -> None:
        try:
            pose, covariance = messages.read_pose(message, self.base.settings.odom_frame_id)
        except InputError as error:
            self.base.counts["refused set_pose"] += 1
            self._log.warning(f"set_pose: {error}")
            return
        self.base.set_pose(pose, covariance)

    def _report(self, report: Report | None) -> None:
        if report is None or not 0 <= report.state.time_ns <= messages.LATEST_NS:
            return
        messages.write_odometry(self._odometry, report)
        self._odom.publish(self._odometry)
        if self._tf is not None and self.base.settings.enable_odom_tf:
            messages.write_transform(self._transform, report.state.time_ns, report.state.pose)
            self._tf.publish(self._tf_message)

    def _tick(self) -> None:
        now, clock = time.monotonic_ns(), self._clock_ns()
        for twist, source, stamp in self._commands.take():
            self.base.on_command(twist, source, now, clock, stamp)
        if not self.base.active:
            return
        command, report = self.base.on_tick(now, clock)
        self._command(command)
        self._report(report)

    def _command(self, command: DriveCommand) -> None:
        self._send(command.wheels)
        shouted = next((reason for reason in command.reasons if reason in _SHOUTED), None)
        if shouted is not self._shouted:
            self._shouted = shouted
            if shouted is not None:
                self._log.warning(f"stopped: {shouted.value}")

    def _send(self, command: WheelCommand) -> None:
        told = self.base.joints.command(command)
        if self.base.settings.wheel_command_type == "joint_state":
            self._send_joint_state(told.velocities, told.positions)
            return
        from std_msgs.msg import Float64MultiArray

        groups = [group for group in (told.velocities, told.positions) if group]
        for publisher, group in zip(self._wheel_publishers, groups, strict=True):
            publisher.publish(Float64MultiArray(data=list(group.values())))

    def _send_joint_state(self, velocities: dict[str, float], positions: dict[str, float]) -> None:
        from sensor_msgs.msg import JointState

        names = list(dict.fromkeys((*velocities, *positions)))
        message = JointState(name=names)
        messages.write_stamp(message.header.stamp, self._clock_ns())
        message.velocity = [velocities.get(name, math.nan) for name in names]
        message.position = [positions.get(name, math.nan) for name in names] if positions else []
        self._wheel_publishers[0].publish(message)

    def _turn(self, transition: str) -> None:
        if transition == "activate":
            self.base.activate()
        elif not self._closed:
            self._send(self.base.deactivate())

    def _reset(self) -> str:
        self.base.set_pose(Pose2D(), ZERO)
        return "the pose is zero"

    def _emergency_stop(self) -> str:
        self._command(self.base.emergency_stop(time.monotonic_ns()))
        return "stopped; ~/release lifts it"

    # --- the graph and diagnostics ----------------------------------------------------------------

    def _diagnose(self) -> None:
        mine, others = self._endpoints()
        found = mismatches(mine, others)
        for sentence in found:
            if sentence not in self._unmatched:
                self._log.error(sentence)
        self._unmatched = found
        if self._status is None:
            return
        holder = self.base.lease.holder
        driver = "" if holder is None else self._commands.sender(holder)
        lacking = [*self._missing, *self._commands.crowded()]
        statuses = self._diagnostics.report(time.monotonic_ns(), found, lacking, driver)
        array = self._status.msg_type(status=[self._status_message(one) for one in statuses])
        messages.write_stamp(array.header.stamp, self._clock_ns())
        self._status.publish(array)

    def _status_message(self, status: Status) -> Any:
        pair = message_type("diagnostic_msgs.msg", "KeyValue")
        return self._status_type(
            level=bytes([status.level]),
            name=f"{self.node.get_name()}: {status.name}",
            message=status.message,
            hardware_id=self._robot.name,
            values=[pair(key=key, value=value) for key, value in status.values.items()],
        )

    def _endpoints(self) -> tuple[list[Endpoint], list[Endpoint]]:
        """This node's endpoints on its topics, and those of all others there."""
        node = self.node
        name = (node.get_name(), node.get_namespace())
        topics = [one.topic_name for one in (*self._subscriptions, self._odom, *self._wheel_publishers)]
        topics += self._commands.names
        mine: list[Endpoint] = []
        others: list[Endpoint] = []
        for topic in topics:
            for publishes, infos in (
                (True, node.get_publishers_info_by_topic(topic)),
                (False, node.get_subscriptions_info_by_topic(topic)),
            ):
                for info in infos:
                    group = mine if (info.node_name, info.node_namespace) == name else others
                    group.append(_endpoint(topic, info, publishes=publishes))
        return mine, others


def _endpoint(topic: str, info: Any, *, publishes: bool) -> Endpoint:
    from rclpy.qos import DurabilityPolicy, LivelinessPolicy, ReliabilityPolicy

    profile = info.qos_profile
    qos = QoS(
        reliable=profile.reliability == ReliabilityPolicy.RELIABLE,
        transient_local=profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
        deadline=_seconds(profile.deadline),
        manual_liveliness=profile.liveliness == LivelinessPolicy.MANUAL_BY_TOPIC,
        lease=_seconds(profile.liveliness_lease_duration),
    )
    node = f"{info.node_namespace.rstrip('/')}/{info.node_name}"
    return Endpoint(node, topic, info.topic_type, publishes, qos)


def _seconds(duration: Any) -> float:
    """A time of DDS, where none at all and nearly three hundred years are both endless."""
    nanoseconds = int(duration.nanoseconds)
    return math.inf if nanoseconds <= 0 or nanoseconds >= 2**62 else nanoseconds * 1e-9
