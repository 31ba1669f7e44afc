"""ros2_controllers' parameter files: a robot from the controller that drives it, and the other way round.

What a controller knows and a robot description does not (frames, covariances, rates) is not kept; what a
description knows and the controller does not is said in a comment of the text that is written.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from msgspec.structs import replace

from trundle.adapters.description_file import read_description
from trundle.adapters.quantity import DURATION, LENGTH, RADIUS, read_number
from trundle.adapters.ros2_parameters import FAMILIES, Controller, find_controllers
from trundle.adapters.typed_section import read_list, shown
from trundle.adapters.yaml_document import YamlDocument, parse_yaml
from trundle.errors import ConfigError, InputError, did_you_mean, require_type
from trundle.robot import (
    Ackermann,
    Bicycle,
    Custom,
    Differential,
    Kinematics,
    Limits,
    LogMapping,
    Mecanum,
    Omni,
    Robot,
    SkidSteer,
    Tricycle,
    Wheel,
    WheelKind,
)
from trundle.robot.log_mapping import Kind, ScalarMapping, Unit, WheelMapping

__all__ = ["controllers_text", "read_controllers_document", "robot_from_controller", "robot_from_controllers"]

JOINT_STATES = "/joint_states"


# ------------------------------------------------------------------------------------- reading


def robot_from_controllers(path: str | Path, *, controller: str | None = None) -> Robot:
    """The robot that a ros2_controllers parameter file describes.

    Its wheels are read from `/joint_states` by the joints' names: positions where the controller's
    `position_feedback` says so, else velocities. A mecanum controller knows only the sum of half the track
    width and half the wheelbase: both are given that sum, which moves alike. A diff_drive_controller with
    several wheels a side, an Ackermann one with two different tracks, or a mecanum one whose base frame is
    turned become a custom drive.

    Args:
        path: A YAML file with `ros__parameters`.
        controller: Name of the controller, where the file configures several.

    Raises:
        ConfigError: If it cannot be read, configures no such controller or several, or a parameter is missing
            or impossible; the message says which, and the line.
    """
    document = read_controllers_document(path)
    try:
        return robot_from_controller(_chosen(find_controllers(document), controller))
    except ConfigError as error:
        raise document.located(error) from None


def read_controllers_document(path: str | Path) -> YamlDocument:
    """The file as plain data that knows its lines.

    Raises:
        ConfigError: If it cannot be read, or is no plain YAML 1.2.
    """
    return parse_yaml(read_description(path), str(path))


def robot_from_controller(controller: Controller) -> Robot:
    """The robot that one controller describes.

    Raises:
        ConfigError: If a parameter is missing, unknown but near to one that matters, or impossible.
    """
    given = _Given(controller)
    given.refuse_typos()
    layout = _READERS[controller.family.package](given)
    velocity = not given.flag("position_feedback")
    return Robot(
        drive=layout.drive,
        name=controller.name,
        limits=_read_limits(given),
        log=LogMapping(
            wheels={
                name: _wheel_mapping(layout.wheels[name], velocity)
                for name in layout.drive.wheel_names
                if name in layout.wheels
            },
            steering={
                name: ScalarMapping(topic=JOINT_STATES, name=layout.steering[name])
                for name in layout.drive.steered_names
            },
        ),
    )


def _chosen(found: Sequence[Controller], name: str | None) -> Controller:
    names = [one.name for one in found]
    known = "; known: " + ", ".join(family.plugin for family in FAMILIES.values())
    if name is not None:
        require_type("robot_from_controllers", "controller", name, str)
        for one in found:
            if one.name == name:
                return one
        raise ConfigError("", f"no wheeled controller {name!r}, {did_you_mean(name, names)}")
    if not found:
        raise ConfigError("", f"configures no wheeled controller of ros2_controllers{known}")
    if len(found) > 1:
        raise ConfigError("", f"configures {', '.join(names)}: say which one (controller=)")
    return found[0]


def _wheel_mapping(joint: str, velocity: bool) -> WheelMapping:
    return WheelMapping(topic=JOINT_STATES, name=joint, unit=Unit.RAD_S if velocity else None)


class _Layout(NamedTuple):
    """A drive, and the joint of each wheel and of each steered wheel."""

    drive: Kinematics
    wheels: dict[str, str]
    steering: dict[str, str]


class _Given:
    """A controller's parameters as checked values."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller

    def refuse_typos(self) -> None:
        """An unknown name close to one that matters must not leave that one at its default."""
        family = self.controller.family
        for name in self.controller.values:
            if not family.knows(name):
                missing = [one for one in family.parameters if one not in self.controller.values]
                if near := difflib.get_close_matches(name, missing, 1, 0.85):
                    raise self.wrong(name, f"unknown parameter, did you mean {near[0]!r}?")

    def __contains__(self, name: str) -> bool:
        return name in self.controller.values

    def wrong(self, name: str, problem: str) -> ConfigError:
        """An error at a parameter."""
        return ConfigError(self.controller.place(name), problem)

    def flag(self, name: str) -> bool:
        """A bool; False where the controller has no such parameter."""
        value = self.controller.value(name)
        if value is not None and not isinstance(value, bool):
            raise self.wrong(name, f"{shown(value)}, must be true or false")
        return bool(value)

    def number(self, name: str) -> float:
        """A finite number."""
        value = self.controller.value(name)
        if value is None and name not in self:
            raise self.wrong(name, f"missing; a {self.controller.family.package} needs it")
        return read_number(self.controller.place(name), value)

    def positive(self, name: str, *others: str) -> float:
        """A multiplier or a plausible length above zero, under its name or under one of its old names."""
        used = next((one for one in (name, *others) if one in self and self.number(one) != 0.0), name)
        value = self.number(used)
        if not value > 0.0:
            raise self.wrong(used, f"{value:g}, must be > 0")
        wheel = used.endswith(("wheel_radius", "wheels_radius"))
        quantity = RADIUS if wheel else LENGTH
        if not used.endswith("_multiplier") and not quantity.holds(value):
            limits = f"{quantity.least:g} to {quantity.most:g} m"
            raise self.wrong(used, f"{value:g} m is implausible ({limits}): lengths are metres here")
        return value

    def text(self, name: str) -> str:
        """A text that is not empty."""
        value = self.controller.value(name)
        if not isinstance(value, str) or not value:
            problem = f"{shown(value)}, must be the name of a joint" if name in self else "missing"
            raise self.wrong(name, problem)
        return value

    def texts(self, name: str, *counts: int) -> tuple[str, ...]:
        """A list of different joint names, of one of these lengths."""
        value = read_list(self.controller.place(name), self.controller.value(name), "a list of joint names")
        for k, one in enumerate(value):
            if not isinstance(one, str) or not one:
                raise self.wrong(name, f"{shown(one)} at {k}, must be the name of a joint")
        if len(set(value)) < len(value):
            raise self.wrong(name, f"{shown(list(value))}: a joint is named twice")
        if not value or (counts and len(value) not in counts):
            allowed = " or ".join(map(str, counts)) if counts else "at least 1"
            raise self.wrong(name, f"{len(value)} joints, must be {allowed}")
        return tuple(value)


# --- the controllers, one by one ------------------------------------------------------------------


def _read_diff_drive(given: _Given) -> _Layout:
    lefts, rights = given.texts("left_wheel_names"), given.texts("right_wheel_names")
    if len(lefts) != len(rights):
        raise given.wrong("right_wheel_names", f"{len(rights)} joints, must be {len(lefts)} as on the left")
    if both := set(lefts) & set(rights):
        raise given.wrong("right_wheel_names", f"{', '.join(sorted(both))}: is a left wheel too")
    track = given.positive("wheel_separation") * given.positive("wheel_separation_multiplier")
    radius = given.positive("wheel_radius")
    left, right = (radius * given.positive(f"{side}_wheel_radius_multiplier") for side in ("left", "right"))
    if len(lefts) == 1:
        radii = left if left == right else {"left": left, "right": right}
        drive = Differential(track_width=track, wheel_radius=radii)
        return _Layout(drive, {"left": lefts[0], "right": rights[0]}, {})
    # Where along x they stand the controller does not know, and its odometry does not depend on it.
    wheels = [
        Wheel(joint, 0.0, y, one, kind=WheelKind.SKID)
        for joints, y, one in ((lefts, track / 2, left), (rights, -track / 2, right))
        for joint in joints
    ]
    return _Layout(Custom(wheels=wheels), {joint: joint for joint in (*lefts, *rights)}, {})


def _read_mecanum(given: _Given) -> _Layout:
    names = ("front_left", "front_right", "rear_left", "rear_right")
    joints = {}
    for name in names:
        state = given.controller.value(f"{name}_wheel_state_joint_name")
        joints[name] = given.text(f"{name}_wheel_{'state' if state else 'command'}_joint_name")
    half_sum = given.positive("kinematics.sum_of_robot_center_projection_on_X_Y_axis")
    radius = given.positive("kinematics.wheels_radius")
    x, y, theta = (given.number(f"kinematics.base_frame_offset.{part}") for part in ("x", "y", "theta"))
    drive: Kinematics = Mecanum(
        track_width=half_sum, wheelbase=half_sum, wheel_radius=radius, reference=(x, y)
    )
    return _Layout(_turned(drive, -theta) if theta else drive, joints, {})


def _turned(drive: Kinematics, angle: float) -> Custom:
    """The same wheels, seen from a frame in which they stand turned by `angle`."""
    c, s = math.cos(angle), math.sin(angle)
    wheels = [
        replace(
            wheel,
            x=c * wheel.x - s * wheel.y,
            y=s * wheel.x + c * wheel.y,
            heading=wheel.heading + angle,
            free_direction=None if wheel.free_direction is None else wheel.free_direction + angle,
        )
        for wheel in drive.wheels
    ]
    return Custom(wheels=wheels)


def _read_omni(given: _Given) -> _Layout:
    joints = given.texts("wheel_names")
    if len(joints) < 3:
        raise given.wrong("wheel_names", f"{len(joints)} joints, must be at least 3")
    drive = Omni(
        robot_radius=given.positive("robot_radius"),
        wheel_radius=given.positive("wheel_radius"),
        wheel_count=len(joints),
        first_wheel_angle=given.number("wheel_offset"),
    )
    return _Layout(drive, dict(zip(drive.wheel_names, joints, strict=True)), {})


class _SteeringJoints(NamedTuple):
    traction: tuple[str, ...]
    steering: tuple[str, ...]
    traction_axle: str
    steering_axle: str


def _steering_joints(given: _Given, traction: Sequence[int], steering: int) -> _SteeringJoints:
    """The joints by the new names or the old ones. With rear steering the formulas are the same."""
    rear_steers = "front_steering" in given and not given.flag("front_steering")
    axles = ("front", "rear") if rear_steers else ("rear", "front")
    found = []
    for role, axle, counts in zip(("traction", "steering"), axles, (traction, (steering,)), strict=True):
        new = f"{role}_joints_names"
        name = new if new in given or f"{axle}_wheels_names" not in given else f"{axle}_wheels_names"
        joints = given.texts(name, *counts)
        for state in (f"{role}_joints_state_names", f"{axle}_wheels_state_names"):
            if given.controller.value(state):
                joints = given.texts(state, len(joints))
        found.append(joints)
    return _SteeringJoints(found[0], found[1], *axles)


def _read_ackermann(given: _Given) -> _Layout:
    joints = _steering_joints(given, (2,), 2)
    front, rear = joints.steering_axle, joints.traction_axle
    length = given.positive("wheelbase")
    track = given.positive("traction_track_width", f"{rear}_wheel_track")
    radius = given.positive("traction_wheels_radius", f"{rear}_wheels_radius")
    steered = next(
        (
            given.positive(name)
            for name in ("steering_track_width", f"{front}_wheel_track")
            if name in given and given.number(name) != 0.0
        ),
        track,
    )
    drive: Kinematics = Ackermann(wheelbase=length, track_width=track, wheel_radius=radius)
    if steered != track:
        wheels = [
            replace(wheel, y=math.copysign(steered / 2, wheel.y)) if wheel.x else wheel
            for wheel in drive.wheels
        ]
        drive = Custom(wheels=wheels, measured=drive.measured_names)
    # The controllers' order is right, left.
    return _Layout(
        drive,
        dict(zip(("rear_right", "rear_left"), joints.traction, strict=True)),
        dict(zip(("front_right", "front_left"), joints.steering, strict=True)),
    )


def _read_bicycle(given: _Given) -> _Layout:
    joints = _steering_joints(given, (1,), 1)
    radius = given.positive("traction_wheel_radius", f"{joints.traction_axle}_wheel_radius")
    drive = Bicycle(wheelbase=given.positive("wheelbase"), wheel_radius=radius)
    return _Layout(drive, {"rear": joints.traction[0]}, {"front": joints.steering[0]})


def _read_tricycle_steering(given: _Given) -> _Layout:
    joints = _steering_joints(given, (1, 2), 1)
    length = given.positive("wheelbase")
    radius = given.positive("traction_wheels_radius", f"{joints.traction_axle}_wheels_radius")
    steering = {"front": joints.steering[0]}
    if len(joints.traction) == 1:  # then it is the steered wheel that is driven
        return _Layout(
            Tricycle(wheelbase=length, wheel_radius=radius), {"front": joints.traction[0]}, steering
        )
    rear = ("rear_right", "rear_left")
    track = given.positive("traction_track_width", "wheel_track")
    drive = Tricycle(wheelbase=length, wheel_radius=radius, track_width=track, measured=rear[::-1])
    return _Layout(drive, dict(zip(rear, joints.traction, strict=True)), steering)


def _read_tricycle(given: _Given) -> _Layout:
    drive = Tricycle(
        wheelbase=given.positive("wheelbase"),
        wheel_radius=given.positive("wheel_radius"),
        max_steering=_optional(given, "steering.max_position"),
    )
    joints = (given.text("traction_joint_name"), given.text("steering_joint_name"))
    return _Layout(drive, {"front": joints[0]}, {"front": joints[1]})


_READERS: Mapping[str, Callable[[_Given], _Layout]] = {
    "diff_drive_controller": _read_diff_drive,
    "mecanum_drive_controller": _read_mecanum,
    "omni_wheel_drive_controller": _read_omni,
    "ackermann_steering_controller": _read_ackermann,
    "bicycle_steering_controller": _read_bicycle,
    "tricycle_steering_controller": _read_tricycle_steering,
    "tricycle_controller": _read_tricycle,
}


# --- limits ---------------------------------------------------------------------------------------

# Limit, the parameter that says it forwards, and the old flag that switches that off.
_LIMITS = (
    ("max_speed", "linear.x.max_velocity", "linear.x.has_velocity_limits"),
    ("max_lateral_speed", "linear.y.max_velocity", ""),
    ("max_yaw_rate", "angular.z.max_velocity", "angular.z.has_velocity_limits"),
    ("max_acceleration", "linear.x.max_acceleration", "linear.x.has_acceleration_limits"),
    ("max_deceleration", "linear.x.max_deceleration", "linear.x.has_acceleration_limits"),
    ("max_deceleration", "linear.x.min_acceleration", "linear.x.has_acceleration_limits"),
    ("max_yaw_acceleration", "angular.z.max_acceleration", "angular.z.has_acceleration_limits"),
    ("max_jerk", "linear.x.max_jerk", "linear.x.has_jerk_limits"),
    ("max_wheel_speed", "traction.max_velocity", ""),  # rad/s: the limiter sees the wheel
    ("max_steering", "steering.max_position", ""),
)


def _read_limits(given: _Given) -> Limits:
    limits: dict[str, Any] = {}
    for field, name, switch in _LIMITS:
        off = switch in given and not given.flag(switch)
        if field not in limits and not off and (value := _optional(given, name)) is not None:
            limits[field] = value
    timeout = _read_timeout(given)
    if timeout is not None:
        limits["command_timeout"] = timeout
    return Limits(**limits)


def _optional(given: _Given, name: str) -> float | None:
    """A limit's size; .nan, .inf and 0 switch it off."""
    value = given.controller.value(name)
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return None
    return abs(given.number(name)) or None


def _read_timeout(given: _Given) -> float | str | None:
    """Seconds; None where a zero says what a description cannot."""
    family = given.controller.family
    value = given.number(family.timeout)
    if value < 0.0:
        raise given.wrong(family.timeout, f"{value:g}, must be >= 0")
    if value == 0.0:
        return "never" if family.package == "diff_drive_controller" else None
    if not DURATION.holds(seconds := value * family.timeout_unit):
        unit = "s" if family.timeout_unit == 1.0 else "ms"
        limits = f"{DURATION.least:g} to {DURATION.most:g} s"
        raise given.wrong(family.timeout, f"{value:g} {unit} is implausible ({limits}): it is in {unit} here")
    return seconds


# ------------------------------------------------------------------------------------- writing


def controllers_text(robot: Robot, *, name: str | None = None, nominal: Robot | None = None) -> str:
    """A ros2_controllers parameter file for a robot.

    The joints' names are those of the `log:` section where it reads a topic, else
    `<wheel>_wheel_joint` (`wheel_1_joint`) and `<wheel>_steering_joint`.

    Args:
        robot: A differential, skid steer, mecanum, omni, Ackermann, bicycle or tricycle drive, or a custom
            one like them.
        name: Name of the controller; its package's by default.
        nominal: For differential drives: the robot before it was calibrated. Its lengths are written as
            they are, and what calibration changed goes into the three multipliers.

    Raises:
        InputError: If there is no controller for such a drive, or a joint turns the other way round (the
            controllers know no signs).
    """
    require_type("controllers_text", "robot", robot, Robot)
    require_type("controllers_text", "nominal", robot if nominal is None else nominal, Robot)
    require_type("controllers_text", "name", "" if name is None else name, str)
    package, values = _written_drive(robot, robot if nominal is None else nominal)
    family = FAMILIES[package]
    title = name or package
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", title):
        raise InputError(f"name {title!r}: must be letters, digits and _, and not begin with a digit")
    if "position_feedback" in family.parameters:
        values["position_feedback"] = not _reads_velocity(robot)
    values |= _written_limits(robot, package)
    values |= dict.fromkeys(family.covariances, _VARIANCES)
    lines = [
        *("controller_manager:", "  ros__parameters:", f"    {title}:", f"      type: {family.plugin}", ""),
        *(f"{title}:", "  ros__parameters:"),
        *(f"    # {comment}" for comment in _lost(robot, package)),
        *_nested(values, family.covariances[0]),
    ]
    return "\n".join([*lines, ""])


# Of x, y, z, roll, pitch, yaw. A robot on a floor does not know three of them: large, never 0.
_VARIANCES = [0.001, 0.001, 1e6, 1e6, 1e6, 0.01]
_ABOUT_VARIANCES = "variances of x, y, z, roll, pitch, yaw; a start: put in what your robot shows"

Values = dict[str, Any]


def _written_drive(robot: Robot, nominal: Robot) -> tuple[str, Values]:
    """The package, and the parameters that say where the wheels stand."""
    drive = robot.drive
    if drive.reference != (0.0, 0.0) and not isinstance(drive, Mecanum):
        problem = f"reference {drive.reference}: only the mecanum controller reports another point"
        raise InputError(f"{drive.type_name}: {problem}")
    if isinstance(drive, Mecanum):
        return "mecanum_drive_controller", _written_mecanum(robot)
    if isinstance(drive, Omni):
        return "omni_wheel_drive_controller", _written_omni(robot)
    if isinstance(drive, Bicycle) and drive.measured_names == ("rear",):
        return "bicycle_steering_controller", {
            **_traction_and_steering(robot, ["rear"], ["front"]),
            "wheelbase": float(drive.parameters["wheelbase"]),
            "traction_wheel_radius": drive.wheel("rear").radius,
        }
    if isinstance(drive, Bicycle | Tricycle):
        return _written_tricycle(robot)
    sides = {wheel.kind for wheel in drive.wheels} <= {WheelKind.FIXED, WheelKind.SKID}
    if isinstance(drive, Differential | SkidSteer) or (isinstance(drive, Custom) and sides):
        return "diff_drive_controller", _written_sides(robot, nominal)
    if isinstance(drive, Ackermann | Custom):
        return "ackermann_steering_controller", _written_ackermann(robot)
    known = ", ".join(FAMILIES)
    raise InputError(f"{drive.type_name}: ros2_controllers has no controller for it; it has {known}")


def _written_sides(robot: Robot, nominal: Robot) -> Values:
    lefts, rights, track = _sides(robot.drive)
    *_, track_before = _sides(nominal.drive)
    radii = [_mean([wheel.radius for wheel in side]) for side in (lefts, rights)]
    radius = radii[0]
    if nominal is not robot:
        radius = _mean([wheel.radius for wheel in nominal.drive.wheels])
    return {
        "left_wheel_names": [_joint(robot, wheel.name) for wheel in lefts],
        "right_wheel_names": [_joint(robot, wheel.name) for wheel in rights],
        "wheel_separation": track_before,
        "wheel_separation_multiplier": track / track_before,
        "wheel_radius": radius,
        "left_wheel_radius_multiplier": radii[0] / radius,
        "right_wheel_radius_multiplier": radii[1] / radius,
    }


def _sides(drive: Kinematics) -> tuple[list[Wheel], list[Wheel], float]:
    """The left wheels, the right ones, and the distance between them."""
    offsets = {wheel.y for wheel in drive.wheels}
    half = max(offsets)
    straight = all(wheel.heading == 0.0 and wheel.kind is not WheelKind.STEERED for wheel in drive.wheels)
    if not straight or len(offsets) != 2 or not math.isclose(min(offsets), -half, rel_tol=1e-9):
        problem = "a diff_drive_controller has wheels that look ahead, left and right of the middle"
        raise InputError(f"{drive.type_name}: {problem}; these are others")
    if drive.parameters.get("icr_x"):
        raise InputError(f"{drive.type_name}: icr_x: a diff_drive_controller knows no such thing")
    lefts = [wheel for wheel in drive.wheels if wheel.y > 0.0]
    rights = [wheel for wheel in drive.wheels if wheel.y < 0.0]
    if len(lefts) != len(rights):
        raise InputError(
            f"{drive.type_name}: {len(lefts)} wheels left and {len(rights)} right, must be equal"
        )
    return lefts, rights, 2.0 * half


def _written_mecanum(robot: Robot) -> Values:
    drive = robot.drive
    x, y = drive.reference
    return {
        **{
            f"{corner}_wheel_command_joint_name": _joint(robot, corner)
            for corner in ("front_left", "front_right", "rear_right", "rear_left")
        },
        "kinematics.wheels_radius": _radius(drive, drive.wheel_names),
        "kinematics.sum_of_robot_center_projection_on_X_Y_axis": (
            float(drive.parameters["track_width"] + drive.parameters["wheelbase"]) / 2
        ),
        "kinematics.base_frame_offset.x": x,
        "kinematics.base_frame_offset.y": y,
        "kinematics.base_frame_offset.theta": 0.0,
    }


def _written_omni(robot: Robot) -> Values:
    drive = robot.drive
    return {
        "wheel_names": [_joint(robot, name) for name in drive.wheel_names],
        "wheel_offset": float(drive.parameters["first_wheel_angle"]),
        "robot_radius": float(drive.parameters["robot_radius"]),
        "wheel_radius": _radius(drive, drive.wheel_names),
    }


def _written_ackermann(robot: Robot) -> Values:
    drive = robot.drive
    fixed, steered = (
        sorted((wheel for wheel in drive.wheels if wheel.kind is kind), key=lambda wheel: wheel.y)
        for kind in (WheelKind.FIXED, WheelKind.STEERED)
    )
    tracks = [_axle(wheels) for wheels in (fixed, steered)]
    as_measured = set(drive.measured_names) == {wheel.name for wheel in fixed}
    if None in tracks or len(drive.wheels) != 4 or fixed[0].x != 0.0 or not as_measured:
        problem = "ros2_controllers has no controller for it; for steered ones it has one that measures"
        raise InputError(f"{drive.type_name}: {problem} two fixed wheels at x = 0 behind two steered ones")
    return {
        **_traction_and_steering(robot, [wheel.name for wheel in fixed], [wheel.name for wheel in steered]),
        "wheelbase": steered[0].x,
        "traction_track_width": tracks[0],
        "steering_track_width": tracks[1],
        "traction_wheels_radius": _radius(drive, drive.measured_names),
    }


def _axle(wheels: Sequence[Wheel]) -> float | None:
    """The distance between two wheels that look ahead, right and left of the middle; None if they do not."""
    if len(wheels) != 2 or wheels[0].x != wheels[1].x or any(wheel.heading for wheel in wheels):
        return None
    right, left = (wheel.y for wheel in wheels)
    return left - right if math.isclose(left, -right, rel_tol=1e-9) else None


def _written_tricycle(robot: Robot) -> tuple[str, Values]:
    drive = robot.drive
    length = float(drive.parameters["wheelbase"])
    if drive.parameters.get("front_y"):
        raise InputError(f"{drive.type_name}: front_y: the controllers have the steered wheel in the middle")
    if drive.measured_names == ("front",):
        return "tricycle_controller", {
            "traction_joint_name": _joint(robot, "front"),
            "steering_joint_name": _steering_joint(robot, "front"),
            "wheelbase": length,
            "wheel_radius": drive.wheel("front").radius,
        }
    rear = ("rear_right", "rear_left")
    if set(drive.measured_names) != set(rear):
        problem = f"{', '.join(drive.measured_names)}: the controllers measure the front or the rear wheels"
        raise InputError(f"{drive.type_name}: measured: {problem}")
    return "tricycle_steering_controller", {
        **_traction_and_steering(robot, rear, ["front"]),
        "wheelbase": length,
        "traction_track_width": float(drive.parameters["track_width"]),
        "traction_wheels_radius": _radius(drive, rear),
    }


def _traction_and_steering(robot: Robot, traction: Sequence[str], steered: Sequence[str]) -> Values:
    return {
        "traction_joints_names": [_joint(robot, name) for name in traction],
        "steering_joints_names": [_steering_joint(robot, name) for name in steered],
    }


def _radius(drive: Kinematics, names: Sequence[str]) -> float:
    """The one radius that a controller knows: the mean where they differ."""
    return _mean([drive.wheel(name).radius for name in names])


def _mean(values: Sequence[float]) -> float:
    """The mean; to the last bit where all are equal."""
    return values[0] if len(set(values)) == 1 else statistics.fmean(values)


def _joint(robot: Robot, wheel: str) -> str:
    kind = "joint" if "wheel" in wheel else "wheel_joint"
    return _joint_of(robot.log.wheels.get(wheel), f"{wheel}_{kind}")


def _steering_joint(robot: Robot, wheel: str) -> str:
    return _joint_of(robot.log.steering.get(wheel), f"{wheel}_steering_joint")


def _joint_of(mapping: ScalarMapping | None, default: str) -> str:
    if mapping is None or mapping.topic is None or not isinstance(mapping.name, str):
        return default
    if mapping.sign != 1:
        problem = "sign -1: the controllers know no signs; turn the joint's axis round in the URDF"
        raise InputError(f"{mapping.name}: {problem}")
    return mapping.name


def _reads_velocity(robot: Robot) -> bool:
    """Whether the log's wheels are speeds."""
    mappings = robot.log.wheels.values()
    return any(
        one.kind is Kind.VELOCITY or (one.unit is not None and one.unit.dimension.endswith("/s"))
        for one in mappings
    )


# --- limits and what is lost ------------------------------------------------------------------------


def _written_limits(robot: Robot, package: str) -> Values:
    family, limits = FAMILIES[package], robot.limits
    timeout = limits.command_timeout
    if timeout == "never":
        if package != "diff_drive_controller":
            raise InputError(f"limits.command_timeout: never: a {package} has no word for it, give seconds")
        timeout = 0.0
    ticks = float(timeout) / family.timeout_unit
    values: Values = {family.timeout: max(round(ticks), 1) if family.timeout_unit != 1.0 else ticks}
    for field, name in _written_limit_names(package):
        value = getattr(limits, field)
        if value is None:
            continue
        axis, _, kind = name.rpartition(".")
        values[name] = -float(value) if kind == "max_deceleration" else float(value)
        if kind in ("max_velocity", "max_jerk") and axis != "traction":
            values[f"{axis}.{kind.replace('max', 'min')}"] = -float(value)
    return values


def _written_limit_names(package: str) -> Iterator[tuple[str, str]]:
    for field, name, _ in _LIMITS:
        if name in FAMILIES[package].parameters:
            yield field, name


def _lost(robot: Robot, package: str) -> Iterator[str]:
    """What the description says and this controller cannot."""
    kept = {"command_timeout", *(field for field, _ in _written_limit_names(package))}
    lost = [
        f"{field}: {getattr(robot.limits, field)!r}"
        for field in robot.limits.__struct_fields__
        if field not in kept and getattr(robot.limits, field) is not None
    ]
    if lost:
        yield f"limits that this controller does not know: {', '.join(lost)}"
    measured = robot.drive.measured_names
    radii = sorted({robot.drive.wheel(name).radius for name in measured})
    if len(radii) > 1 and package != "diff_drive_controller":
        yield f"wheel radius: the mean of {', '.join(map(repr, radii))}"


# --- text -------------------------------------------------------------------------------------------


def _nested(values: Values, first_covariance: str) -> Iterator[str]:
    """Lines of dotted parameters, those with a common beginning below it."""
    before: list[str] = [""]
    indent = "    "
    for path, value in _grouped(values):
        shared = 0
        while shared < min(len(path), len(before)) - 1 and path[shared] == before[shared]:
            shared += 1
        for depth in range(shared, len(path) - 1):
            yield f"{indent}{'  ' * depth}{path[depth]}:"
        if ".".join(path) == first_covariance:
            yield f"{indent}{'  ' * (len(path) - 1)}# {_ABOUT_VARIANCES}"
        yield f"{indent}{'  ' * (len(path) - 1)}{path[-1]}: {_scalar(value)}"
        before = path


def _grouped(values: Values) -> list[tuple[list[str], Any]]:
    """Dotted names as lists, with those of one section side by side, in the order of their firsts."""
    order: dict[tuple[str, ...], int] = {}
    for name in values:
        parts = name.split(".")
        for depth in range(1, len(parts)):
            order.setdefault(tuple(parts[:depth]), len(order))
        order.setdefault(tuple(parts), len(order))

    def rank(name: str) -> list[int]:
        parts = tuple(name.split("."))
        return [order[parts[:depth]] for depth in range(1, len(parts) + 1)]

    return [(name.split("."), values[name]) for name in sorted(values, key=rank)]


def _scalar(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_scalar, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
