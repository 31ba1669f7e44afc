"""The node's parameters: names of ros2_controllers, values of a robot description, all or nothing.

ROS keeps a parameter's type for good, so a limit that does not exist is NaN there, as in ros2_controllers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from trundle.adapters.robot_data import robot_from_data, robot_to_data
from trundle.errors import ConfigError
from trundle.robot import Robot

__all__ = ["WHEEL_COMMANDS", "Parameter", "Settings", "configured", "declared"]

WHEEL_COMMANDS = ("forward_controllers", "joint_state")

# What a description calls a limit. Decelerations are below zero in ros2_controllers.
_LIMITS = {
    "linear.x.max_velocity": "max_speed",
    "linear.x.max_acceleration": "max_acceleration",
    "linear.x.max_deceleration": "max_deceleration",
    "linear.x.max_jerk": "max_jerk",
    "linear.y.max_velocity": "max_lateral_speed",
    "angular.z.max_velocity": "max_yaw_rate",
    "angular.z.max_acceleration": "max_yaw_acceleration",
}
_NEGATIVE = "linear.x.max_deceleration"

_TWO_SIDES = {"wheel_separation": "track_width", "wheel_radius": "wheel_radius"}
_GEOMETRY: Mapping[str, Mapping[str, str]] = {
    "differential": _TWO_SIDES,
    "skid_steer": _TWO_SIDES,
    "mecanum": {"kinematics.wheels_radius": "wheel_radius"},
    "omni": {"robot_radius": "robot_radius", "wheel_radius": "wheel_radius"},
    "bicycle": {"wheelbase": "wheelbase", "traction_wheel_radius": "wheel_radius"},
    "ackermann": {
        "wheelbase": "wheelbase",
        "traction_track_width": "track_width",
        "traction_wheels_radius": "wheel_radius",
    },
    "tricycle": {
        "wheelbase": "wheelbase",
        "traction_track_width": "track_width",
        "traction_wheels_radius": "wheel_radius",
    },
}
_SEPARATION = "wheel_separation_multiplier"
_SIDES = {"left": "left_wheel_radius_multiplier", "right": "right_wheel_radius_multiplier"}


class Parameter(NamedTuple):
    """A parameter as the node declares it.

    Attributes:
        default: What it is unless somebody sets it; its type is the parameter's.
        description: For `ros2 param describe`.
        live: Whether it may change while the node runs.
    """

    default: Any
    description: str
    live: bool = True


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """What the parameters amount to.

    Attributes:
        robot: The description with everything that parameters changed.
        odom_frame_id: Frame of the pose.
        base_frame_id: Frame of the robot.
        enable_odom_tf: Whether `/tf` is published.
        open_loop: Count on what the wheels were told in place of what they measured.
        update_rate: Commands to the wheels per second.
        cmd_vel_topics: Where commands come from; the first has the highest priority.
        wheel_command_type: One of `WHEEL_COMMANDS`.
    """

    robot: Robot
    odom_frame_id: str = "odom"
    base_frame_id: str = "base_link"
    enable_odom_tf: bool = True
    open_loop: bool = False
    update_rate: float = 50.0
    cmd_vel_topics: tuple[str, ...] = ("cmd_vel",)
    wheel_command_type: str = WHEEL_COMMANDS[0]

    def __post_init__(self) -> None:
        for field in ("odom_frame_id", "base_frame_id"):
            frame = getattr(self, field)
            if not frame or frame.startswith("/"):
                raise ConfigError(field, f"{frame!r}, must be the name of a frame, without a slash before it")
        if self.odom_frame_id == self.base_frame_id:
            raise ConfigError("base_frame_id", f"{self.base_frame_id!r} is odom_frame_id too")
        if not 1.0 <= self.update_rate <= 1000.0:
            raise ConfigError("update_rate", f"{self.update_rate:g} Hz, must be from 1 to 1000")
        if not self.cmd_vel_topics or len(set(self.cmd_vel_topics)) < len(self.cmd_vel_topics):
            raise ConfigError(
                "cmd_vel_topics", f"{self.cmd_vel_topics}, must be one topic or more, each once"
            )
        if self.wheel_command_type not in WHEEL_COMMANDS:
            allowed = " or ".join(WHEEL_COMMANDS)
            raise ConfigError("wheel_command_type", f"{self.wheel_command_type!r}, must be {allowed}")


def declared(robot: Robot) -> dict[str, Parameter]:
    """The parameters of a robot's node, in its own terms: those of its drive and its limits."""
    limits, plain = robot.limits, Settings(robot=robot)
    found = {
        "odom_frame_id": Parameter(plain.odom_frame_id, "Frame in which the pose is given."),
        "base_frame_id": Parameter(plain.base_frame_id, "Frame of the robot, in which its twist is given."),
        "enable_odom_tf": Parameter(plain.enable_odom_tf, "Publish odom -> base on /tf."),
        "open_loop": Parameter(plain.open_loop, "Integrate commands in place of what the wheels measured."),
        "cmd_vel_timeout": Parameter(
            limits.command_lifetime, "A command older than this stops the robot [s]; .inf: never."
        ),
        "update_rate": Parameter(plain.update_rate, "Wheel commands per second [Hz].", live=False),
        "cmd_vel_topics": Parameter(
            list(plain.cmd_vel_topics), "Topics of commands, the highest priority first.", live=False
        ),
        "wheel_command_type": Parameter(
            plain.wheel_command_type, f"How wheels are told: {' or '.join(WHEEL_COMMANDS)}.", live=False
        ),
    }
    for name, field in _LIMITS.items():
        value = getattr(limits, field)
        size = math.nan if value is None else (-value if name == _NEGATIVE else value)
        found[name] = Parameter(size, f"limits.{field} of the description; .nan: no limit.")
    drive = robot_to_data(robot)["drive"]
    for name, key in _GEOMETRY.get(drive["type"], {}).items():
        if isinstance(drive.get(key), float | int):
            found[name] = Parameter(float(drive[key]), f"drive.{key} of the description [m].")
    if "wheel_separation" in found:
        for name in (_SEPARATION, *_SIDES.values()):
            found[name] = Parameter(1.0, "Factor that calibration found.")
    return found


def configured(robot: Robot, values: Mapping[str, Any]) -> Settings:
    """What a node does with these values.

    Args:
        robot: The description that the node was started with.
        values: Of every parameter in `declared(robot)`.

    Raises:
        ConfigError: If any value, or any two of them together, cannot be; it names the parameter.
    """
    return Settings(
        robot=_described(robot, values),
        odom_frame_id=values["odom_frame_id"],
        base_frame_id=values["base_frame_id"],
        enable_odom_tf=values["enable_odom_tf"],
        open_loop=values["open_loop"],
        update_rate=values["update_rate"],
        cmd_vel_topics=tuple(values["cmd_vel_topics"]),
        wheel_command_type=values["wheel_command_type"],
    )


def _described(robot: Robot, values: Mapping[str, Any]) -> Robot:
    """The description with the parameters' values in it; the same object where nothing changed."""
    before = robot_to_data(robot)
    limits = dict(before.get("limits", {}))
    names = {"command_timeout": "cmd_vel_timeout"}
    limits["command_timeout"] = _timeout(values["cmd_vel_timeout"])
    for name, field in _LIMITS.items():
        names[field] = name
        limits[field] = _limit(name, values[name])
    drive = dict(before["drive"])
    for name, key in _GEOMETRY.get(drive["type"], {}).items():
        if name in values:
            names[key] = name
            drive[key] = values[name]
    if _SEPARATION in values:
        _multiply(drive, robot, values)
    data = {**before, "limits": {key: one for key, one in limits.items() if one is not None}, "drive": drive}
    try:
        after = robot_from_data(data)
    except ConfigError as error:
        key = error.field.split(".")[1] if "." in error.field else error.field
        raise ConfigError(names.get(key, error.field), error.problem) from None
    return robot if robot_to_data(after) == before else after


def _timeout(value: float) -> float | str:
    if math.isnan(value) or value <= 0.0:
        raise ConfigError("cmd_vel_timeout", f"{value:g} s, must be > 0; only .inf switches it off")
    return "never" if value == math.inf else value


def _limit(name: str, value: float) -> float | None:
    if not math.isfinite(value):
        return None
    if name == _NEGATIVE:
        if value >= 0.0:
            raise ConfigError(name, f"{value:g}, must be < 0, as in ros2_controllers; .nan is no limit")
        return -value
    return value


def _multiply(drive: dict[str, Any], robot: Robot, values: Mapping[str, Any]) -> None:
    for name in (_SEPARATION, *_SIDES.values()):
        if not (math.isfinite(values[name]) and values[name] > 0.0):
            raise ConfigError(name, f"{values[name]:g}, must be > 0")
    drive["track_width"] *= values[_SEPARATION]
    factors = {side: values[name] for side, name in _SIDES.items()}
    if set(factors.values()) != {1.0}:
        radius = drive["wheel_radius"]
        drive["wheel_radius"] = {
            wheel: _radius_of(radius, wheel) * factor
            for side, factor in factors.items()
            for wheel in _wheels_of(robot.drive.wheel_names, side)
        }


def _wheels_of(names: Sequence[str], side: str) -> list[str]:
    return [name for name in names if side in name.split("_")]


def _radius_of(radius: Any, wheel: str) -> float:
    return float(radius[wheel] if isinstance(radius, Mapping) else radius)
