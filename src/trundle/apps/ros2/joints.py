"""A robot's joints: which of a JointState are its wheels, in which units they are, and how they are told.

The description's `log:` section says it for logs, and what it says of topics holds live too. What it does
not say has a default: `joint_states`, a joint per wheel with the wheel's name, `<wheel>_steering` for the
angle of a steered one, radians.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from trundle.adapters.conversion import scalar_conversion, wheel_conversions, wheel_names
from trundle.errors import ConfigError
from trundle.records import Reading
from trundle.robot import Robot, WheelCommand
from trundle.robot.log_mapping import Clock, LogMapping, ScalarMapping, Unit, WheelMapping

__all__ = ["MISSING_JOINT", "Joint", "JointCommand", "JointReading", "Joints"]

JOINT_STATES = "joint_states"
IMU = "imu"
MISSING_JOINT = "missing_joint"
_FIELDS = ("position", "velocity", "effort")


class Joint(NamedTuple):
    """A number of a JointState.

    Attributes:
        name: Of the joint.
        field: Of the message: position, velocity or effort.
        factor: What it is multiplied by to be SI, or a count with its sign.
    """

    name: str
    field: str
    factor: float


class JointReading(NamedTuple):
    """What `WheelOdometry.update` takes.

    Attributes:
        wheels: In `measured_names` order.
        steering: [rad].
    """

    wheels: tuple[float, ...]
    steering: tuple[float, ...]


class JointCommand(NamedTuple):
    """What joints are told, by name.

    Attributes:
        velocities: Of the driven wheels [rad/s].
        positions: Of the steered ones [rad].
    """

    velocities: dict[str, float]
    positions: dict[str, float]


class Joints:
    """Reads the joints of one robot, and names them. Knows nothing of ROS but its names.

    Args:
        robot: What measures and what drives, and the `log:` section.

    Attributes:
        topic: Of the JointState.
        imu_topic: Of the Imu; None where the robot declares no gyro.
        clock: Which stamps count.
        reading: What the wheels say.
        keyword: What `WheelOdometry.update` calls that.

    Raises:
        ConfigError: If the `log:` section wants what live topics do not have.
    """

    def __init__(self, robot: Robot) -> None:
        drive, log = robot.measuring, robot.log
        self.clock = log.clock
        wheels = _wheel_mappings(robot)
        steering = _steering_mappings(robot)
        self.topic = _only_topic([*wheels.items()], [*steering.items()])
        self.reading, conversions = wheel_conversions(robot, wheels)
        self.keyword = {Reading.INCREMENT: "increments", Reading.VELOCITY: "velocities"}.get(
            self.reading, "ticks" if self.reading is Reading.TICKS else "positions"
        )
        speed = self.reading is Reading.VELOCITY
        self._wheels = [
            _joint(f"log.wheels.{name}", one, name, conversions[name].factor, speed=speed)
            for name, one in wheels.items()
        ]
        self._steering = [
            _joint(f"log.steering.{name}", one, f"{name}_steering", _angle_factor(name, one), speed=False)
            for name, one in steering.items()
        ]
        self._wanted = (*self._wheels, *self._steering)
        self._names: Sequence[str] = ()
        self._places: list[tuple[int, str, float]] | None = None
        self.imu_topic: str | None = None
        self._yaw_factor = 1.0
        if drive.gyro:
            self.imu_topic, self._yaw_factor = _gyro(log)
        self._driven = _driven_joints(robot, log)
        self._count = len(robot.drive.wheel_names)

    @property
    def names(self) -> list[str]:
        """The joints that are read."""
        return [joint.name for joint in self._wanted]

    @property
    def factors(self) -> list[float]:
        """What makes readings of what the message says."""
        return [joint.factor for joint in self._wanted]

    @property
    def receive_clock(self) -> bool:
        """Whether the receiver's clock stamps what comes, because the sender's are not to be used."""
        return self.clock is Clock.RECEIVE

    def read(self, names: Sequence[str], message: Any) -> JointReading | str:
        """The wheels and the steering of a message.

        Args:
            names: Of its joints, in any order; others may be among them.
            message: Has `position` and `velocity` as sequences, either of which may be empty.

        Returns:
            The reading, or why there is none.
        """
        if names != self._names:
            self._places = self._find(names)
            self._names = list(names)
        if self._places is None:
            return MISSING_JOINT
        try:
            values = [getattr(message, field)[at] * factor for at, field, factor in self._places]
        except IndexError:
            return MISSING_JOINT
        count = len(self._wheels)
        return JointReading(tuple(values[:count]), tuple(values[count:]))

    def yaw_rate(self, shown: float) -> float:
        """The gyro's yaw rate [rad/s] of what an Imu shows about z."""
        return self._yaw_factor * shown

    def command(self, command: WheelCommand) -> JointCommand:
        """What each joint is told; wheels without a motor are told nothing."""
        velocities = {
            joint.name: joint.factor * command.speeds[index] for index, joint in self._driven.speeds
        }
        positions = {
            joint.name: joint.factor * angle
            for joint, angle in zip(self._driven.steering, command.steering, strict=True)
        }
        return JointCommand(velocities, positions)

    def told(self, velocities: Mapping[str, float], positions: Mapping[str, float]) -> WheelCommand:
        """The command that these joints were told: the way back. What is not told stands still."""
        speeds = [0.0] * self._count
        for index, joint in self._driven.speeds:
            speeds[index] = velocities.get(joint.name, 0.0) / joint.factor
        angles = [positions.get(joint.name, 0.0) / joint.factor for joint in self._driven.steering]
        return WheelCommand(tuple(speeds), tuple(angles))

    def message(
        self, wheels: Sequence[float], steering: Sequence[float]
    ) -> tuple[list[str], list[float], list[float]]:
        """Names, positions and velocities of a JointState that `read` reads as this: the way back."""
        names = list(dict.fromkeys(joint.name for joint in self._wanted))
        fields: dict[str, list[float]] = {}
        for joint, value in zip(self._wanted, (*wheels, *steering), strict=True):
            column = fields.setdefault(joint.field, [math.nan] * len(names))
            column[names.index(joint.name)] = value / joint.factor
        return names, fields.get("position", []), fields.get("velocity", [])

    def _find(self, names: Sequence[str]) -> list[tuple[int, str, float]] | None:
        """Where in the message each wanted joint is; None where one is missing."""
        place = {name: at for at, name in enumerate(names)}
        if not all(joint.name in place for joint in self._wanted):
            return None
        return [(place[joint.name], joint.field, joint.factor) for joint in self._wanted]


class _Driven(NamedTuple):
    """Joints that are told something: driven wheels by their place in a command, and steered ones."""

    speeds: list[tuple[int, Joint]]
    steering: list[Joint]


def _wheel_mappings(robot: Robot) -> dict[str, WheelMapping]:
    """Of the measured wheels, in their order."""
    mapped = {name: one for name, one in robot.log.wheels.items() if one.topic is not None}
    if not mapped:
        mapped = {name: WheelMapping(topic=JOINT_STATES) for name in robot.measuring.measured_names}
    return {name: mapped[name] for name in wheel_names(robot, mapped)}


def _steering_mappings(robot: Robot) -> dict[str, ScalarMapping]:
    """Of the steered wheels, or the one angle that stands for all."""
    names = robot.measuring.steered_names
    mapped = {name: one for name, one in robot.log.steering.items() if one.topic is not None}
    if not mapped:
        return {name: ScalarMapping(topic=JOINT_STATES) for name in names}
    if set(mapped) == set(names):
        return {name: mapped[name] for name in names}
    if len(mapped) > 1:
        missing = ", ".join(name for name in names if name not in mapped)
        raise ConfigError("log.steering", f"lacks {missing}; name every steered wheel, or one angle for all")
    return mapped


def _only_topic(*groups: Sequence[tuple[str, ScalarMapping]]) -> str:
    topics = dict.fromkeys(str(one.topic) for group in groups for _, one in group)
    if len(topics) > 1:
        named = ", ".join(topics)
        raise ConfigError("log.wheels", f"wheels and steering are on {named}; live they must be on one topic")
    return next(iter(topics))


def _joint(field: str, mapping: ScalarMapping, name: str, factor: float, *, speed: bool) -> Joint:
    part = mapping.field or ("velocity" if speed else "position")
    if part not in _FIELDS:
        allowed = ", ".join(_FIELDS)
        raise ConfigError(f"{field}.field", f"{part!r}; live it is one of a JointState: {allowed}")
    if isinstance(mapping.name, int):
        raise ConfigError(f"{field}.name", f"{mapping.name}; live joints go by name, not by number")
    return Joint(mapping.name or name, part, factor)


def _angle_factor(name: str, mapping: ScalarMapping) -> float:
    return scalar_conversion(f"log.steering.{name}", mapping, Unit.RAD).factor


def _gyro(log: LogMapping) -> tuple[str, float]:
    mapping = log.gyro
    if mapping is None or mapping.topic is None:
        return IMU, 1.0
    return mapping.topic, scalar_conversion("log.gyro", mapping, Unit.RAD_S).factor


def _driven_joints(robot: Robot, log: LogMapping) -> _Driven:
    drive = robot.drive

    def joint(mappings: Mapping[str, ScalarMapping], wheel: str, name: str, field: str) -> Joint:
        mapping = mappings.get(wheel)
        if mapping is None or mapping.topic is None:
            return Joint(name, field, 1.0)
        return Joint(mapping.name if isinstance(mapping.name, str) else name, field, mapping.sign)

    speeds = [
        (index, joint(log.wheels, name, name, "velocity"))
        for index, name in enumerate(drive.wheel_names)
        if drive.wheel(name).driven
    ]
    return _Driven(
        speeds, [joint(log.steering, name, f"{name}_steering", "position") for name in drive.steered_names]
    )
