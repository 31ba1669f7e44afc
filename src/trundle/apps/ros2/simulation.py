"""A robot that does not exist, as hardware: joints that take commands and say where they are. No ROS.

Like good hardware it has a watchdog of its own: wheels that are told nothing any more stop.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from trundle.apps.ros2.joints import Joints
from trundle.geometry import Pose2D, Twist2D
from trundle.records import Reading
from trundle.robot import Robot, WheelCommand
from trundle.simulate import SimulatedReading, SimulatedRobot

__all__ = ["SimulatedJoints", "SimulatedMessage"]

_PATIENCE_NS = 500_000_000
_LONGEST_STEP_NS = 200_000_000  # a simulation that stood still goes on from where it was


class SimulatedMessage(NamedTuple):
    """What is published after a step.

    Attributes:
        names: Of the joints.
        positions: In the units of the description's `log:` section.
        velocities: Likewise.
        yaw_rate: What an Imu shows [rad/s]; None without a gyro.
        pose: The truth.
        twist: The truth.
    """

    names: list[str]
    positions: list[float]
    velocities: list[float]
    yaw_rate: float | None
    pose: Pose2D
    twist: Twist2D


class SimulatedJoints:
    """The joints of a simulated robot.

    Args:
        robot: Which.
        seed: Of its noise.

    Raises:
        ConfigError: If the `log:` section wants what live topics do not have.
    """

    def __init__(self, robot: Robot, *, seed: int = 0) -> None:
        self._robot = SimulatedRobot(robot, seed=seed)
        self._drive = robot.drive
        self._joints = Joints(robot)
        self._reading = self._joints.reading
        told = self._joints.command(WheelCommand((0.0,) * len(self._drive.wheel_names), self._robot.steering))
        self._velocities = dict(told.velocities)
        self._positions = dict(told.positions)
        self._told_ns: int | None = None
        self._now_ns: int | None = None
        self._before = self._robot.reading()

    @property
    def velocity_names(self) -> list[str]:
        """Joints that take a velocity, in the order of a Float64MultiArray."""
        return list(self._velocities)

    @property
    def position_names(self) -> list[str]:
        """Joints that take a position."""
        return list(self._positions)

    def tell(self, velocities: Mapping[str, float], positions: Mapping[str, float], now_ns: int) -> None:
        """Take a command by joint; joints that are not in it go on."""
        self._velocities |= {name: one for name, one in velocities.items() if name in self._velocities}
        self._positions |= {name: one for name, one in positions.items() if name in self._positions}
        if velocities:
            self._told_ns = now_ns

    def step(self, now_ns: int) -> SimulatedMessage:
        """Go on to a time; what the sensors say then.

        Args:
            now_ns: Monotonic clock.
        """
        before, self._now_ns = self._now_ns, now_ns
        reading = self._before
        seconds = 0.0
        if before is not None and now_ns > before:
            seconds = min(now_ns - before, _LONGEST_STEP_NS) * 1e-9
            reading = self._robot.step(self._command(now_ns), seconds)
        wheels = self._wheels(reading, seconds)
        self._before = reading
        names, positions, velocities = self._joints.message(wheels, reading.steering)
        shown = None if reading.yaw_rate is None else reading.yaw_rate / self._joints.yaw_rate(1.0)
        return SimulatedMessage(names, positions, velocities, shown, self._robot.pose, self._robot.twist)

    def _command(self, now_ns: int) -> WheelCommand:
        told = self._told_ns is not None and now_ns - self._told_ns <= _PATIENCE_NS
        return self._joints.told(self._velocities if told else {}, self._positions)

    def _wheels(self, reading: SimulatedReading, seconds: float) -> tuple[float, ...]:
        """The reading as the `log:` section wants it."""
        if self._reading is Reading.TICKS:
            return tuple(map(float, reading.ticks))
        if self._reading is Reading.POSITION:
            return reading.positions
        turned = [now - then for now, then in zip(reading.positions, self._before.positions, strict=True)]
        if self._reading is Reading.INCREMENT:
            return tuple(turned)
        return tuple([angle / seconds for angle in turned]) if seconds else (0.0,) * len(turned)
