"""`trundle lint`: what is likely to be wrong in a controller's parameters, and what to write there."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from trundle.apps.exit_code import ExitCode
from trundle.apps.wording import labelled, plural

if TYPE_CHECKING:
    from trundle.adapters.ros2_parameters import Controller
    from trundle.adapters.urdf import UrdfWheel
    from trundle.adapters.yaml_document import YamlDocument

__all__ = ["Finding", "findings", "lint"]


class Finding(NamedTuple):
    """One thing to look at.

    Attributes:
        place: Dotted path in the document.
        what: What stands there, or does not.
        why: What comes of it.
        write: What to write in its place.
    """

    place: str
    what: str
    why: str
    write: str


def lint(file: Path, /, *, urdf: Path | None = None) -> ExitCode:
    """Look for the known traps in a ros2_controllers parameter file, or check a robot.yaml.

    Args:
        file: The YAML file.
        urdf: The robot's model (URDF or xacro), to compare its wheels with the parameters.
    """
    from trundle.adapters.ros2_controllers import read_controllers_document

    document = read_controllers_document(file)
    found = findings(document, urdf)
    for one in found:
        print(f"{file}:{_line(document, one.place)}: {one.place}")
        print(*labelled([("what", one.what), ("why", one.why), ("write", one.write)]), sep="\n")
    print(f"{file}: {plural(len(found), 'finding')}")
    return ExitCode.FOUND if found else ExitCode.FINE


def findings(document: YamlDocument, urdf: Path | None = None) -> list[Finding]:
    """What is likely to be wrong, in the document's order.

    Args:
        document: A ros2_controllers parameter file, or a robot.yaml.
        urdf: The robot's model, or None.

    Raises:
        ConfigError: If the document is neither, or the model cannot be read.
        MissingExtra: If the model is a xacro and that package is not installed.
    """
    from trundle.adapters.ros2_parameters import find_controllers
    from trundle.errors import ConfigError

    if isinstance(document.data, dict) and "drive" in document.data:
        return _in_description(document)
    try:
        controllers = find_controllers(document)
    except ConfigError as error:
        raise document.located(error) from None
    if not controllers:
        problem = "neither a robot.yaml (no drive:) nor a wheeled controller's parameters"
        raise ConfigError("", problem, source=document.source)
    wheels = _model_wheels(urdf)
    found = []
    for controller in controllers:
        own = _own(controller)
        own += _against_model(controller, wheels) if wheels else []
        own += _refusal(controller, {finding.place for finding in own})
        found += own
    return sorted(found, key=lambda finding: _line(document, finding.place))


def _line(document: YamlDocument, place: str) -> int:
    """Line of a place, or of what holds it."""
    while place and place not in document.spans:
        place = place.rpartition(".")[0]
    return document.spans[place].line if place in document.spans else 1


def _in_description(document: YamlDocument) -> list[Finding]:
    from trundle.adapters.robot_data import robot_from_data
    from trundle.errors import ConfigError

    try:
        robot = robot_from_data(document.data)
    except ConfigError as error:
        raise document.located(error) from None
    why = "a robot that nobody commands any more should stand"
    return [
        Finding("limits.command_timeout", words, why, "command_timeout: 0.5")
        for words in robot.limits.warnings
    ]


def _refusal(controller: Controller, known: set[str]) -> list[Finding]:
    """What keeps the parameters from being a robot, unless a check has said it."""
    from trundle.adapters.ros2_controllers import robot_from_controller
    from trundle.errors import ConfigError

    try:
        robot_from_controller(controller)
    except ConfigError as error:
        place = error.field if error.field.startswith(controller.path) else controller.path
        if place not in known:
            why = "these parameters describe no robot: the controller does not start, or drives wrongly"
            return [Finding(place, error.problem, why, "a value that is allowed there")]
    return []


# -------------------------------------------------------------------------------------- names


def _unknown(controller: Controller) -> Iterator[Finding]:
    for name, meant in _meant(controller).items():
        why = "controllers ignore what they do not know, in silence: the default holds"
        advice = f"{meant}: ..." if meant else "nothing: take the line out"
        what = f"{controller.family.package} has no parameter {name}"
        yield Finding(controller.place(name), what, why, advice)


def _meant(controller: Controller) -> dict[str, str]:
    """Of each unknown name the known one that is near; empty where none is."""
    family = controller.family
    absent = [name for name in family.parameters if name not in controller.values]
    meant = {}
    for name in controller.values:
        if not family.knows(name):
            near = difflib.get_close_matches(name, absent, 1, 0.7)
            other_nesting = [family.covariances["twist" in name]] if "covariance" in name else []
            meant[name] = next(iter(near or other_nesting), "")
    return meant


def _deprecated(controller: Controller) -> Iterator[Finding]:
    for name, instead in controller.family.deprecated.items():
        if name in controller.values:
            why = "newer ros2_controllers have dropped it: the default of what took its place would hold"
            yield Finding(controller.place(name), f"{name} is an old name", why, instead)


def _missing(controller: Controller) -> Iterator[Finding]:
    family = controller.family
    in_old_words = " ".join(advice for name, advice in family.deprecated.items() if name in controller.values)
    given = {*controller.values, *_meant(controller).values()}
    for name in family.required:
        if name not in given and name not in in_old_words:
            why = f"a {family.package} does not start without it, or starts with 0"
            yield Finding(controller.place(name), f"{name} is missing", why, f"{name}: ...")


# -------------------------------------------------------------------------------------- types


def _types(controller: Controller) -> Iterator[Finding]:
    why = "ROS converts no types: the controller refuses to start"
    for name, value in controller.values.items():
        parameter = controller.family.parameters.get(name)
        if parameter is None:
            continue
        fitting = _fitting(value, parameter.type.value)
        if fitting is not None:
            wanted = parameter.type.value.replace("_", " ")
            yield Finding(controller.place(name), f"{_yaml(value)} is no {wanted}", why, f"{name}: {fitting}")


def _fitting(value: Any, wanted: str) -> str | None:
    """How the value would have to be written to be of that type; None where it is."""
    if wanted.endswith("_array"):
        single = wanted.removesuffix("_array")
        if not isinstance(value, list):
            return f"[{_fitting(value, single) or _yaml(value)}]"
        parts = [_fitting(one, single) for one in value]
        if not any(parts):
            return None
        return "[" + ", ".join(part or _yaml(one) for part, one in zip(parts, value, strict=True)) + "]"
    if wanted == "bool":
        words = {"yes": "true", "on": "true", "y": "true", "no": "false", "off": "false", "n": "false"}
        return None if isinstance(value, bool) else words.get(str(value).lower(), "true or false")
    if wanted == "string":
        return None if isinstance(value, str) else f'"{_yaml(value)}"'
    return _fitting_number(value, whole=wanted == "int")


def _fitting_number(value: Any, *, whole: bool) -> str | None:
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            return "a number"
        return str(int(value)) if whole and value.is_integer() else repr(value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return "a number"
    if whole:
        return None if isinstance(value, int) else "a whole number"
    return f"{value}.0" if isinstance(value, int) else None


def _yaml(value: Any) -> str:
    if isinstance(value, list):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return "nothing" if value is None else str(value)


# -------------------------------------------------------------------------------- covariances

_AXES = ("x", "y", "z", "roll", "pitch", "yaw")
_START = "[0.001, 0.001, 1000000.0, 1000000.0, 1000000.0, 0.01]"


def _covariances(controller: Controller) -> Iterator[Finding]:
    for name in controller.family.covariances:
        values = controller.value(name)
        problem = _variance_problem(values)
        if problem is not None:
            what, why = problem
            given = name in controller.values
            shown = _yaml(list(values) if isinstance(values, tuple) else values)
            what = f"{shown}: {what}" if given else f"{name} is not set, and by default {shown}: {what}"
            start = f"{name}: {_START}, better what your robot shows"
            yield Finding(controller.place(name), what, why, start)


def _variance_problem(values: Any) -> tuple[str, str] | None:
    if not isinstance(values, list | tuple) or len(values) != 6:
        return "must be six numbers", "the controller reads six variances: x, y, z, roll, pitch, yaw"
    if any(isinstance(one, bool) or not isinstance(one, int | float) for one in values):
        return None  # their type is a finding of its own
    if not all(0.0 <= one < math.inf for one in values):
        return "variances must be finite and >= 0", "a filter that is given these fails"
    if list(values) in ([7.0 * k for k in range(6)], [6.0 * k for k in range(6)]):
        what = "the places of the diagonal in the matrix, taken for its values"
        return what, "a filter then trusts x without a doubt, and believes no heading (35 rad^2 is 340 deg)"
    zeros = [axis for axis, one in zip(_AXES, values, strict=True) if one == 0.0]
    if zeros:
        return (
            f"no variance of {', '.join(zeros)}",
            "0 means certain: a filter trusts it over everything else, or fails on a singular matrix",
        )
    return None


# ------------------------------------------------------------------------- feedback, timeouts


def _feedback(controller: Controller) -> Iterator[Finding]:
    name = "position_feedback"
    if name not in controller.family.parameters or name in controller.values:
        return
    if controller.value("open_loop") is True:
        return
    default = controller.family.parameters[name].default
    other = "the steering controllers" if default else "diff_drive_controller"
    what = f"{name} is not set: here it is {str(default).lower()}, in {other} {str(not default).lower()}"
    why = "whoever moves parameters from one to the other changes which state interface is read"
    yield Finding(controller.place(name), what, why, f"{name}: {str(default).lower()}")


SLOW = 10.0  # a command older than this [s] stops no robot in time
FAST = 0.02  # below this [s] every second command of 50 Hz comes too late


def _timeout(controller: Controller) -> Iterator[Finding]:
    family, name = controller.family, controller.family.timeout
    value = controller.value(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
        return
    seconds = value * family.timeout_unit
    milli = family.timeout_unit != 1.0
    unit = "ms" if milli else "s"
    place, good = controller.place(name), f"{name}: {500 if milli else 0.5}"
    if value == 0.0:
        where = "" if name in controller.values else " (it is not set)"
        yield Finding(place, f"{name} is 0{where}", family.zero_timeout, good)
    elif seconds > SLOW:
        guess = "" if milli else ": milliseconds?"
        why = f"a robot whose commander has died would drive on for {seconds:g} s"
        write = good if milli else f"{name}: {value / 1000.0}"
        yield Finding(place, f"{value:g} {unit}{guess}", why, write)
    elif seconds < FAST:
        guess = ": seconds? Here they are milliseconds" if milli else ""
        write = f"{name}: {round(value * 1000)}" if milli else good
        why = "commands come later than that: the robot would stutter, or never move"
        yield Finding(place, f"{value:g} {unit}{guess}", why, write)


# ------------------------------------------------------------------------------------ lengths


def _lengths(controller: Controller) -> Iterator[Finding]:
    from trundle.adapters.quantity import LENGTH, RADIUS

    for name, value in controller.values.items():
        last = name.rpartition(".")[2]
        wheel = last.endswith(("wheel_radius", "wheels_radius"))
        body = last.endswith(
            ("wheelbase", "track_width", "wheel_track", "separation", "axis", "robot_radius")
        )
        if not (wheel or body) or isinstance(value, bool) or not isinstance(value, int | float):
            continue
        quantity = RADIUS if wheel else LENGTH
        if value <= 0.0 or quantity.least <= value <= quantity.most:
            continue
        factors = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254}
        guesses = {
            unit: factor
            for unit, factor in factors.items()
            if quantity.least <= value * factor <= quantity.most
        }
        unit, factor = next(iter(guesses.items()), ("", 1.0))
        what = f"{value:g} m" + (f": {unit}?" if unit else "")
        write = f"{name}: {value * factor:.6g}" if unit else f"{name}: its length in metres"
        yield Finding(controller.place(name), what, "lengths are metres here", write)


def _halves(controller: Controller) -> Iterator[Finding]:
    """Half a distance where the whole is wanted, or the other way round."""
    for name in controller.family.parameters:
        value = controller.value(name)
        if name.endswith("_multiplier") and _is_twice_or_half(value, 1.0):
            length = "wheel_separation" if "separation" in name else "wheel_radius"
            what = f"{value:g}: makes up for a {length} that is {'half' if value > 1.0 else 'twice'} as large"
            meant = "the whole distance" if length == "wheel_separation" else "no diameter"
            why = f"{length} is {meant}; multipliers are for per cents"
            yield Finding(controller.place(name), what, why, f"{name}: 1.0, and {length} as measured")
    steered, driven = (controller.value(f"{role}_track_width") for role in ("steering", "traction"))
    if "steering_track_width" in controller.family.parameters and _is_twice_or_half(steered, driven):
        what = f"{steered:g} m, while traction_track_width is {driven:g} m"
        why = "both are whole distances, left to right; one of them looks like a half"
        yield Finding(
            controller.place("steering_track_width"), what, why, "the whole distance between the kingpins"
        )


def _is_twice_or_half(value: Any, reference: Any) -> bool:
    both = (value, reference)
    if any(isinstance(one, bool) or not isinstance(one, int | float) or not one > 0.0 for one in both):
        return False
    return abs(abs(math.log2(value / reference)) - 1.0) < 0.02


# -------------------------------------------------------------------------------------- joints


def _sides(controller: Controller) -> Iterator[Finding]:
    """Joints whose names say that they are on the other side."""
    for name, value in controller.values.items():
        joints = value if isinstance(value, list) else [value]
        if not all(isinstance(one, str) for one in joints):
            continue
        if name.startswith(("traction_joints", "steering_joints")) and len(joints) == 2:
            wanted: Sequence[str | None] = ("right", "left")
        elif "joint" in name or name.endswith("wheel_names"):
            wanted = [next((side for side in ("left", "right") if side in name), None)] * len(joints)
        else:
            continue
        wrong = [
            joint
            for joint, side in zip(joints, wanted, strict=True)
            if side and _side(joint) not in (None, side)
        ]
        if wrong:
            pair = len(joints) == 2 and wanted[0] != wanted[1]
            write = f"{name}: [{joints[1]}, {joints[0]}]" if pair else f"{name}: the {wanted[0]} joints"
            why = "left and right change places: odometry and steering turn the wrong way"
            order = "the order here is right, left" if pair else f"this is the {wanted[0]} side"
            yield Finding(controller.place(name), f"{', '.join(wrong)}: {order}", why, write)


def _side(joint: str) -> str | None:
    sides = [side for side in ("left", "right") if side in joint.lower()]
    return sides[0] if len(sides) == 1 else None


_CHECKS: Sequence[Callable[[Controller], Iterator[Finding]]] = (
    *(_unknown, _deprecated, _missing, _covariances),
    *(_feedback, _timeout, _lengths, _halves, _sides),
)


def _own(controller: Controller) -> list[Finding]:
    """What is wrong in one controller's parameters: of each value that is wrong, not its type as well."""
    found = [finding for check in _CHECKS for finding in check(controller)]
    wrong = {finding.place for finding in found}
    return [*(finding for finding in _types(controller) if finding.place not in wrong), *found]


# --------------------------------------------------------------------------- against the model

AGREE = 0.02  # of a length, between the parameters and the model


def _model_wheels(urdf: Path | None) -> list[UrdfWheel]:
    if urdf is None:
        return []
    from trundle.adapters.urdf import urdf_wheels
    from trundle.errors import ConfigError

    _, wheels = urdf_wheels(urdf)
    if not wheels:
        raise ConfigError("", "no wheels: no continuous joint has a level axis", source=str(urdf))
    return wheels


def _against_model(controller: Controller, wheels: Sequence[UrdfWheel]) -> list[Finding]:
    """Where the parameters say something else than the robot's model."""
    from trundle.adapters.ros2_controllers import robot_from_controller
    from trundle.errors import ConfigError, did_you_mean

    try:
        robot = robot_from_controller(controller)
    except ConfigError:
        return []  # that is a finding already
    by_joint = {wheel.joint: wheel for wheel in wheels}
    found, own = [], []
    for mapping in robot.log.wheels.values():
        wheel = by_joint.get(str(mapping.name))
        if wheel is None:
            what = f"{mapping.name}: the model has no such wheel"
            why = "a controller waits for ever for a joint that does not exist"
            found.append(Finding(controller.path, what, why, did_you_mean(str(mapping.name), by_joint)))
            continue
        own.append(wheel)
        if wheel.sign < 0 and not wheel.heading:
            what = f"{wheel.joint}: its axis points to the right in the model"
            why = "controllers know no signs: this wheel would turn, and be counted, backwards"
            found.append(Finding(controller.path, what, why, 'in the model: <axis xyz="0 1 0"/>'))
    if not found:
        found += _lengths_against_model(controller, own, wheels)
    return found


def _lengths_against_model(
    controller: Controller, own: Sequence[UrdfWheel], wheels: Sequence[UrdfWheel]
) -> Iterator[Finding]:
    for name, length in _model_lengths(own, wheels).items():
        value = controller.values.get(name)
        if not isinstance(value, int | float) or not value > 0.0 or length <= 0.0:
            continue
        if abs(value / length - 1.0) > AGREE:
            guess = ""
            if _is_twice_or_half(value, length):
                guess = ": a diameter?" if "radius" in name and value > length else ": half of it, or twice?"
            why = (
                f"the model has {length:.6g} m; odometry and commands are off by {value / length - 1.0:+.1%}"
            )
            write = f"{name}: {length:.6g}, if the model is right"
            yield Finding(controller.place(name), f"{value:g} m{guess}", why, write)


def _model_lengths(own: Sequence[UrdfWheel], wheels: Sequence[UrdfWheel]) -> dict[str, float]:
    """What the parameters of any controller would be by the model."""
    radii = [wheel.radius for wheel in own if wheel.radius is not None]
    radius = sum(radii) / len(radii) if radii else 0.0
    width, length = _span([wheel.y for wheel in own]), _span([wheel.x for wheel in own])
    steered = [wheel for wheel in wheels if wheel.steering is not None]
    fixed = [wheel for wheel in wheels if wheel.steering is None]
    wheelbase = _mean([wheel.x for wheel in steered]) - _mean([wheel.x for wheel in fixed])
    middle = (_mean([wheel.x for wheel in own]), _mean([wheel.y for wheel in own]))
    return {
        **dict.fromkeys(("wheel_radius", "traction_wheel_radius", "traction_wheels_radius"), radius),
        "kinematics.wheels_radius": radius,
        "kinematics.sum_of_robot_center_projection_on_X_Y_axis": (width + length) / 2.0,
        "wheel_separation": width,
        "traction_track_width": width,
        "steering_track_width": _span([wheel.y for wheel in steered]),
        "wheelbase": wheelbase if steered and fixed else 0.0,
        "robot_radius": _mean([math.dist(middle, (wheel.x, wheel.y)) for wheel in own]),
    }


def _span(values: Sequence[float]) -> float:
    return max(values) - min(values) if values else 0.0


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0
