"""The simulated robot as a node of its own: takes wheel commands, publishes joints, gyro and the truth."""

from __future__ import annotations

import math
import time
from typing import Any

from trundle.apps.ros2 import messages
from trundle.apps.ros2.joints import Joints
from trundle.apps.ros2.simulation import SimulatedJoints
from trundle.robot import Robot

__all__ = ["SimulatorNode"]


class SimulatorNode:
    """A robot that does not exist, on the topics of one that does.

    Args:
        robot: Its description.
        seed: Of its noise.
        rate: Samples per second.

    Attributes:
        node: rclpy's.
    """

    def __init__(self, robot: Robot, *, seed: int = 0, rate: float = 100.0) -> None:
        from nav_msgs.msg import Odometry
        from rclpy.clock import Clock, ClockType
        from rclpy.node import Node
        from rclpy.qos import qos_profile_sensor_data
        from sensor_msgs.msg import Imu, JointState
        from std_msgs.msg import Float64MultiArray

        self.node = Node("trundle_simulator")
        self._joints = SimulatedJoints(robot, seed=seed)
        topics = Joints(robot)
        self._publisher = self.node.create_publisher(JointState, topics.topic, 100)
        self._truth = self.node.create_publisher(Odometry, "ground_truth", 100)
        self._imu: Any = None
        if topics.imu_topic is not None:
            self._imu = self.node.create_publisher(Imu, topics.imu_topic, qos_profile_sensor_data)
        self._types = (JointState, Imu, Odometry)
        told = {
            f"forward_{kind}_controller/commands": (Float64MultiArray, take)
            for kind, take in (("velocity", self._on_velocities), ("position", self._on_positions))
        }
        told["joint_commands"] = (JointState, self._on_joint_commands)
        for topic, (kind, take) in told.items():
            self.node.create_subscription(kind, topic, take, 10)
        self.node.create_timer(1.0 / rate, self._step, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _on_velocities(self, message: Any) -> None:
        self._tell(dict(zip(self._joints.velocity_names, message.data, strict=False)), {})

    def _on_positions(self, message: Any) -> None:
        self._tell({}, dict(zip(self._joints.position_names, message.data, strict=False)))

    def _on_joint_commands(self, message: Any) -> None:
        velocities = dict(zip(message.name, message.velocity, strict=False))
        positions = dict(zip(message.name, message.position, strict=False))
        self._tell(
            {name: one for name, one in velocities.items() if math.isfinite(one)},
            {name: one for name, one in positions.items() if math.isfinite(one)},
        )

    def _tell(self, velocities: dict[str, float], positions: dict[str, float]) -> None:
        self._joints.tell(velocities, positions, time.monotonic_ns())

    def _step(self) -> None:
        joint_state, imu, odometry = self._types
        now = int(self.node.get_clock().now().nanoseconds)
        said = self._joints.step(time.monotonic_ns())
        if said.yaw_rate is not None and self._imu is not None:
            shown = imu()
            messages.write_stamp(shown.header.stamp, now)
            shown.angular_velocity.z = said.yaw_rate
            self._imu.publish(shown)
        message = joint_state(name=said.names, position=said.positions, velocity=said.velocities)
        messages.write_stamp(message.header.stamp, now)
        self._publisher.publish(message)
        truth = odometry()
        messages.write_stamp(truth.header.stamp, now)
        truth.header.frame_id, truth.child_frame_id = "odom", "base_link"
        messages.write_pose(truth.pose.pose, said.pose)
        twist = truth.twist.twist
        twist.linear.x, twist.linear.y, twist.angular.z = said.twist.vx, said.twist.vy, said.twist.omega
        self._truth.publish(truth)
