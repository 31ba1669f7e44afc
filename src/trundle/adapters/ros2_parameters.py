"""The wheeled controllers of ros2_controllers: their parameters, and where they stand in a YAML file.

Source of names, types and defaults: ros2_controllers 6.9, and for what it calls deprecated 2.x to 5.x.
"""

from __future__ import annotations

import difflib
import enum
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from trundle.adapters.typed_section import read_mapping, shown
from trundle.adapters.yaml_document import YamlDocument
from trundle.errors import ConfigError

__all__ = ["FAMILIES", "Controller", "Family", "Parameter", "ParameterType", "find_controllers"]


class ParameterType(enum.Enum):
    """Types of ROS parameters. They do not convert: an integer is no double."""

    BOOL = "bool"
    INT = "int"
    DOUBLE = "double"
    STRING = "string"
    DOUBLES = "double_array"
    STRINGS = "string_array"


class Parameter(NamedTuple):
    """What a controller declares.

    Attributes:
        type: Its type.
        default: What it is where the file does not say it; None where there is nothing useful.
    """

    type: ParameterType
    default: Any = None


Parameters = Mapping[str, Parameter]


@dataclass(frozen=True, kw_only=True, slots=True)
class Family:
    """One kind of controller.

    Attributes:
        plugin: What controller_manager calls it.
        parameters: By dotted name.
        required: Names without which it does not start; by them it is known where its type is not said.
        deprecated: Old name to what takes its place.
        timeout: Name of its command timeout.
        timeout_unit: What that is in, as seconds.
        zero_timeout: What 0 means there.
        covariances: Names of the pose's and the twist's variances.
    """

    plugin: str
    parameters: Parameters
    required: tuple[str, ...]
    deprecated: Mapping[str, str] = field(default_factory=dict)
    timeout: str = "cmd_vel_timeout"
    timeout_unit: float = 1.0
    zero_timeout: str = "every command counts as too old: the robot never moves"
    covariances: tuple[str, str] = ("pose_covariance_diagonal", "twist_covariance_diagonal")

    @property
    def package(self) -> str:
        """`diff_drive_controller`, and so on."""
        return self.plugin.partition("/")[0]

    def knows(self, name: str) -> bool:
        """Whether such a parameter does something, here or in every controller."""
        return (
            name in self.parameters
            or name in self.deprecated
            or name in _EVERYWHERE
            or name.startswith(_EVERYWHERE_BELOW)
        )


_EVERYWHERE = ("type", "use_sim_time", "update_rate", "is_async", "thread_priority", "params_file")
_EVERYWHERE_BELOW = ("qos_overrides.", "async_parameters.")


# ---------------------------------------------------------------------------------- the tables


def _declared(kind: ParameterType, names: str, default: Any = None) -> dict[str, Parameter]:
    return dict.fromkeys(names.split(), Parameter(kind, default))


_BOOL, _INT, _DOUBLE = ParameterType.BOOL, ParameterType.INT, ParameterType.DOUBLE
_STRING, _DOUBLES, _STRINGS = ParameterType.STRING, ParameterType.DOUBLES, ParameterType.STRINGS

_LIMITS = (
    *("max_velocity", "min_velocity", "max_acceleration", "max_deceleration"),
    *("max_acceleration_reverse", "max_deceleration_reverse", "max_jerk", "min_jerk"),
)


def _limits(*axes: str) -> dict[str, Parameter]:
    return _declared(_DOUBLE, " ".join(f"{axis}.{name}" for axis in axes for name in _LIMITS))


_ZEROS = (0.0,) * 6
_INDICES = (0.0, 7.0, 14.0, 21.0, 28.0, 35.0)
_FRAMES = _declared(_STRING, "base_frame_id odom_frame_id tf_frame_prefix") | _declared(
    _BOOL, "tf_frame_prefix_enable enable_odom_tf open_loop"
)
_DIAGONALS = "pose_covariance_diagonal twist_covariance_diagonal"

_DIFF_DRIVE = Family(
    plugin="diff_drive_controller/DiffDriveController",
    required=("left_wheel_names", "right_wheel_names", "wheel_separation", "wheel_radius"),
    parameters={
        **_declared(_STRINGS, "left_wheel_names right_wheel_names"),
        **_declared(_DOUBLE, "wheel_separation wheel_radius"),
        **_declared(
            _DOUBLE,
            "wheel_separation_multiplier left_wheel_radius_multiplier right_wheel_radius_multiplier",
            1.0,
        ),
        **_FRAMES,
        **_declared(_DOUBLES, _DIAGONALS, _ZEROS),
        **_declared(_BOOL, "position_feedback", True),
        **_declared(_DOUBLE, "cmd_vel_timeout", 0.5),
        **_declared(_BOOL, "publish_limited_velocity"),
        **_declared(_INT, "velocity_rolling_window_size"),
        **_limits("linear.x", "angular.z"),
    },
    deprecated={
        "use_stamped_vel": "nothing: since Jazzy ~/cmd_vel is a TwistStamped",
        "publish_rate": "nothing: odometry is published at the controller's rate",
        "wheels_per_side": "left_wheel_names and right_wheel_names, which say how many there are",
        **{
            f"{axis}.has_{limit}_limits": "the limits themselves: .nan, or no line, is no limit"
            for axis in ("linear.x", "angular.z")
            for limit in ("velocity", "acceleration", "jerk")
        },
        "linear.x.min_acceleration": "linear.x.max_deceleration, a number below zero",
        "angular.z.min_acceleration": "angular.z.max_deceleration, a number below zero",
    },
    zero_timeout="no timeout: the last command holds even when its source has died",
)

_CORNERS = ("front_left", "front_right", "rear_right", "rear_left")
_MECANUM_DRIVE = Family(
    plugin="mecanum_drive_controller/MecanumDriveController",
    required=(
        *(f"{corner}_wheel_command_joint_name" for corner in _CORNERS),
        "kinematics.wheels_radius",
        "kinematics.sum_of_robot_center_projection_on_X_Y_axis",
    ),
    parameters={
        **_declared(_STRING, " ".join(f"{corner}_wheel_command_joint_name" for corner in _CORNERS)),
        **_declared(_STRING, " ".join(f"{corner}_wheel_state_joint_name" for corner in _CORNERS), ""),
        **_declared(
            _DOUBLE, "kinematics.wheels_radius kinematics.sum_of_robot_center_projection_on_X_Y_axis"
        ),
        **_declared(
            _DOUBLE, " ".join(f"kinematics.base_frame_offset.{part}" for part in ("x", "y", "theta")), 0.0
        ),
        **_declared(_DOUBLE, "reference_timeout", 0.0),
        **{name: one for name, one in _FRAMES.items() if name != "open_loop"},
        **_declared(_DOUBLES, _DIAGONALS, (0.1,) * 6),
        **_limits("linear.x", "linear.y", "angular.z"),
    },
    timeout="reference_timeout",
    zero_timeout="each command holds for one cycle of the controller only",
)

_OMNI_WHEEL_DRIVE = Family(
    plugin="omni_wheel_drive_controller/OmniWheelDriveController",
    required=("wheel_names", "wheel_offset", "robot_radius", "wheel_radius"),
    parameters={
        **_declared(_STRINGS, "wheel_names"),
        **_declared(_DOUBLE, "wheel_offset robot_radius wheel_radius"),
        **_FRAMES,
        **_declared(_DOUBLES, "diagonal_covariance.pose diagonal_covariance.twist", _ZEROS),
        **_declared(_BOOL, "position_feedback", True),
        **_declared(_DOUBLE, "cmd_vel_timeout", 0.5),
    },
    covariances=("diagonal_covariance.pose", "diagonal_covariance.twist"),
)

_STEERING_LIBRARY: Parameters = {
    **_declared(_STRINGS, "traction_joints_names steering_joints_names"),
    **_declared(_STRINGS, "traction_joints_state_names steering_joints_state_names", ()),
    **_declared(_DOUBLE, "reference_timeout", 1.0),
    **_FRAMES,
    **_declared(_DOUBLES, _DIAGONALS, _INDICES),
    **_declared(_BOOL, "position_feedback", False),
    **_declared(_BOOL, "reduce_wheel_speed_until_steering_reached use_twist_input"),
    **_declared(_INT, "velocity_rolling_window_size"),
}
_OLD_STEERING_NAMES = {
    "front_steering": "nothing: traction_joints_names and steering_joints_names say which wheels steer",
    "rear_wheels_names": "traction_joints_names, or steering_joints_names where the rear wheels steer",
    "front_wheels_names": "steering_joints_names, or traction_joints_names where the rear wheels steer",
    "rear_wheels_state_names": "traction_joints_state_names, or steering_joints_state_names",
    "front_wheels_state_names": "steering_joints_state_names, or traction_joints_state_names",
}
_STEERING_JOINTS = ("traction_joints_names", "steering_joints_names", "wheelbase")
_ONE_CYCLE = "each command holds for one cycle of the controller only"

_ACKERMANN_STEERING = Family(
    plugin="ackermann_steering_controller/AckermannSteeringController",
    required=(*_STEERING_JOINTS, "traction_track_width", "traction_wheels_radius"),
    parameters={
        **_STEERING_LIBRARY,
        **_declared(_DOUBLE, "wheelbase traction_track_width traction_wheels_radius"),
        **_declared(_DOUBLE, "steering_track_width", 0.0),
    },
    deprecated={
        **_OLD_STEERING_NAMES,
        "front_wheel_track": "steering_track_width",
        "rear_wheel_track": "traction_track_width",
        "front_wheels_radius": "traction_wheels_radius, the radius of the driven wheels",
        "rear_wheels_radius": "traction_wheels_radius, the radius of the driven wheels",
    },
    timeout="reference_timeout",
    zero_timeout=_ONE_CYCLE,
)

_BICYCLE_STEERING = Family(
    plugin="bicycle_steering_controller/BicycleSteeringController",
    required=(*_STEERING_JOINTS, "traction_wheel_radius"),
    parameters={**_STEERING_LIBRARY, **_declared(_DOUBLE, "wheelbase traction_wheel_radius")},
    deprecated={
        **_OLD_STEERING_NAMES,
        "front_wheel_radius": "traction_wheel_radius, the radius of the driven wheel",
        "rear_wheel_radius": "traction_wheel_radius, the radius of the driven wheel",
    },
    timeout="reference_timeout",
    zero_timeout=_ONE_CYCLE,
)

_TRICYCLE_STEERING = Family(
    plugin="tricycle_steering_controller/TricycleSteeringController",
    required=(*_STEERING_JOINTS, "traction_wheels_radius"),
    parameters={
        **_STEERING_LIBRARY,
        **_declared(_DOUBLE, "wheelbase traction_wheels_radius"),
        **_declared(_DOUBLE, "traction_track_width", 0.0),
    },
    deprecated={
        **_OLD_STEERING_NAMES,
        "wheel_track": "traction_track_width",
        "front_wheels_radius": "traction_wheels_radius, the radius of the driven wheels",
        "rear_wheels_radius": "traction_wheels_radius, the radius of the driven wheels",
    },
    timeout="reference_timeout",
    zero_timeout=_ONE_CYCLE,
)

_TRICYCLE = Family(
    plugin="tricycle_controller/TricycleController",
    required=("traction_joint_name", "steering_joint_name", "wheelbase", "wheel_radius"),
    parameters={
        **_declared(_STRING, "traction_joint_name steering_joint_name"),
        **_declared(_DOUBLE, "wheelbase wheel_radius"),
        **_FRAMES,
        **_declared(_DOUBLES, _DIAGONALS, _ZEROS),
        **_declared(_INT, "cmd_vel_timeout", 500),
        **_declared(_BOOL, "odom_only_twist publish_ackermann_command"),
        **_declared(_INT, "velocity_rolling_window_size"),
        **_declared(_DOUBLE, "steering_track_error_exponent steering_min_speed_scale"),
        **_declared(
            _DOUBLE,
            "traction.max_velocity traction.min_velocity traction.max_acceleration "
            "traction.min_acceleration traction.max_deceleration traction.min_deceleration "
            "traction.max_jerk traction.min_jerk steering.max_position steering.min_position "
            "steering.max_velocity steering.min_velocity steering.max_acceleration "
            "steering.min_acceleration",
        ),
    },
    timeout_unit=1e-3,
)

FAMILIES: Mapping[str, Family] = {
    family.package: family
    for family in (
        _DIFF_DRIVE,
        _MECANUM_DRIVE,
        _OMNI_WHEEL_DRIVE,
        _ACKERMANN_STEERING,
        _BICYCLE_STEERING,
        _TRICYCLE_STEERING,
        _TRICYCLE,
    )
}
"""By the package that holds them."""


# --------------------------------------------------------------------------------- in a document


@dataclass(frozen=True, slots=True)
class Controller:
    """A controller as a file configures it.

    Attributes:
        name: Of its node.
        family: What it is.
        values: What the file says, by dotted parameter name.
        paths: Where in the document each of them stands.
        path: Where its parameters stand.
    """

    name: str
    family: Family
    values: Mapping[str, Any]
    paths: Mapping[str, str]
    path: str

    def place(self, name: str) -> str:
        """Path of a parameter, be it there or not."""
        return self.paths.get(name, f"{self.path}.{name}")

    def value(self, name: str) -> Any:
        """What the file says, or the controller's default."""
        declared = self.family.parameters.get(name)
        return self.values.get(name, declared.default if declared else None)


class _Block(NamedTuple):
    """The parameters of one node; `**` stands for every node."""

    node: str
    path: str
    values: dict[str, Any]
    paths: dict[str, str]


def find_controllers(document: YamlDocument) -> list[Controller]:
    """The wheeled controllers that a ROS 2 parameter file configures.

    What kind one is, is said by its `type` (in controller_manager or beside its parameters), or else by
    its name, or else by parameters that only one kind has.

    Args:
        document: Nodes, each with `ros__parameters`; dotted and nested names are the same.

    Raises:
        ConfigError: If this is no such file, or says a parameter twice.
    """
    blocks = list(_blocks(read_mapping("", document.data), "", "**"))
    types = dict(_types(blocks))
    shared = [block for block in blocks if block.node == "**"]
    names = dict.fromkeys(block.node for block in blocks if block.node != "**")
    names.update(dict.fromkeys(types))
    found = []
    for name in names:
        own = [block for block in blocks if block.node == name]
        values: dict[str, Any] = {}
        paths: dict[str, str] = {}
        for block in [*shared, *own]:
            values.update(block.values)
            paths.update(block.paths)
        family = _family(name, types.get(name), values)
        if family is not None:
            home = (own or shared)[-1].path if own or shared else f"{name}.ros__parameters"
            found.append(Controller(name, family, values, paths, home))
    return found


def _blocks(value: Mapping[str, Any], path: str, node: str) -> Iterator[_Block]:
    for key, one in value.items():
        place = f"{path}.{key}" if path else key
        if key == "ros__parameters":
            block = _Block(node, place, {}, {})
            _flatten(read_mapping(place, one), place, "", block)
            yield block
        elif isinstance(one, Mapping):
            last = key.rstrip("/").rpartition("/")[2]
            yield from _blocks(one, place, "**" if last in ("*", "**") else last)


def _flatten(value: Mapping[str, Any], path: str, prefix: str, block: _Block) -> None:
    for key, one in value.items():
        place, name = f"{path}.{key}", f"{prefix}{key}"
        if isinstance(one, Mapping):
            _flatten(one, place, f"{name}.", block)
        elif name in block.values:
            raise ConfigError(place, "is given twice, nested and with dots")
        else:
            block.values[name] = one
            block.paths[name] = place


def _types(blocks: list[_Block]) -> Iterator[tuple[str, str]]:
    """The plugin of each controller that has one said."""
    plugins = [family.plugin for family in FAMILIES.values()]
    for block in blocks:
        for name, value in block.values.items():
            node = block.node if name == "type" else name.removesuffix(".type")
            if not (name == "type" or name.endswith(".type")) or not isinstance(value, str):
                continue
            if value not in plugins and (near := difflib.get_close_matches(value, plugins, 1, 0.92)):
                problem = f"{shown(value)}: no such controller, did you mean {near[0]!r}?"
                raise ConfigError(block.paths[name], problem)
            yield node, value


def _family(name: str, plugin: str | None, values: Mapping[str, Any]) -> Family | None:
    """What kind of controller this is; None for nodes that are none of them."""
    if plugin is not None:
        return next((family for family in FAMILIES.values() if family.plugin == plugin), None)
    if name in FAMILIES:
        return FAMILIES[name]
    fitting = [family for family in FAMILIES.values() if set(family.required) <= set(values)]
    if len(fitting) > 1:
        kinds = " or ".join(family.plugin for family in fitting)
        raise ConfigError(name, f"could be {kinds}: say its type in controller_manager")
    return fitting[0] if fitting else None
