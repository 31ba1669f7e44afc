"""URDF and xacro: the wheels of a robot, from the joints of its model.

A wheel is a continuous joint whose axis is level; its radius is that of the cylinder or sphere that it turns.
A joint with an upright axis above it steers it.
"""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trundle.adapters.description_file import read_description
from trundle.adapters.xml_document import Element, parse_xml
from trundle.errors import (
    ConfigError,
    InputError,
    MissingExtra,
    did_you_mean,
    require_path,
    require_type,
    row_of,
    shown,
)
from trundle.robot import DRIVES, Custom, Kinematics, LogMapping, Robot, TrackingWheels, Wheel
from trundle.robot.log_mapping import ScalarMapping, WheelMapping

__all__ = ["UrdfWheel", "robot_from_urdf", "urdf_wheels"]

JOINT_STATES = "/joint_states"
AGREE = 1e-3  # wheels that stand this close to where a drive has them stand there [m, rad]
LEVEL = 0.1  # greatest |z| of a level axis
UPRIGHT = 0.9  # least |z| of an upright one
_TINY = 1e-9


class UrdfWheel(NamedTuple):
    """A wheel as a model has it, seen from its base.

    Attributes:
        joint: Name of the joint that it turns on.
        x: Of the joint's origin [m].
        y: Likewise.
        heading: Direction in which it drives, within 90 degrees of ahead [rad].
        sign: -1 where the joint counts down when the wheel drives along its heading.
        radius: [m]; None where the model has only a mesh.
        steering: Name of the joint that steers it, or None.
        steering_sign: -1 where that joint counts up to the right.
        steering_range: Its least and greatest angle, left positive [rad], or None.
        place: Where it stands in the file, for messages.
    """

    joint: str
    x: float
    y: float
    heading: float
    sign: int
    radius: float | None
    steering: str | None
    steering_sign: int
    steering_range: tuple[float, float] | None
    place: str


def robot_from_urdf(
    path: str | Path,
    *,
    drive: str | None = None,
    wheels: Sequence[str] | None = None,
    wheel_radius: float | None = None,
    base: str = "base_link",
) -> Robot:
    """The robot that a URDF or xacro file models.

    Its drive follows from its wheels: two that look ahead are differential; four, skid steer; three or more
    on a circle, omni; one steered and one or two fixed, bicycle and tricycle; two steered ahead of two fixed,
    Ackermann; all steered, swerve; others are custom. Mecanum wheels look like any others in a model: say
    `drive="mecanum"`. The pose that is reported is that of `base`; readings come from `/joint_states` by
    the joints' names, with the sign that their axes give them.

    Args:
        path: The file. A xacro is expanded by the package of that name, which computes the expressions and
            reads the files that it asks for: do that only with files that you trust.
        drive: Another drive, as robot.yaml calls it.
        wheels: The joints that are wheels, where other joints look like wheels too.
        wheel_radius: For wheels without a cylinder or sphere [m].
        base: Link whose motion is reported; the root where there is no such link.

    Raises:
        ConfigError: If it cannot be read, has no wheels, or they cannot be such a drive.
        MissingExtra: If it is a xacro and that package is not installed.
    """
    for field, value in (("drive", drive or ""), ("base", base)):
        require_type("robot_from_urdf", field, value, str)
    if wheels is not None and (isinstance(wheels, str) or row_of(wheels) is None):
        raise InputError(f"robot_from_urdf: wheels {shown(wheels)}, must be a list of joints")
    try:
        name, found = urdf_wheels(path, base=base)
        chosen = _with_radius(_chosen(found, wheels), wheel_radius)
        built, places = _as_drive(chosen, drive)
    except ConfigError as error:
        raise error if error.source else error.inside("", source=str(path)) from None
    return Robot(drive=built, name=name, log=_log_mapping(places))


def urdf_wheels(path: str | Path, *, base: str = "base_link") -> tuple[str, list[UrdfWheel]]:
    """The model's name and its wheels; casters are left out.

    A caster's swivel is told from steering by its name ("caster"), or by what the model says about control:
    where it has `ros2_control` or `transmission` elements, an upright joint without limits and without a
    command is a swivel. Joints that turn no body at all stand for wheels that are there already.

    Args:
        path: A URDF or xacro file.
        base: Link from which they are seen; the root where there is no such link.

    Raises:
        ConfigError: If it cannot be read, or its links and joints are no tree.
        MissingExtra: If it is a xacro and that package is not installed.
    """
    root = _model(require_path(path))
    try:
        tree = _Tree(root)
        tree.look_from(base)
        found = dict(_wheels(tree, _commanded(root)))
        bodily = [wheel for wheel, has_body in found.items() if has_body]
        return root.attributes.get("name") or "robot", bodily or list(found)
    except ConfigError as error:
        raise error.inside("", source=str(path)) from None


# ------------------------------------------------------------------------------------ the file


def _model(path: Path) -> Element:
    root = parse_xml(read_description(path), str(path))
    if _is_xacro(root):
        root = parse_xml(_expanded(path), str(path))
    if root.tag != "robot":
        raise ConfigError("", f"its root is <{root.tag[:40]}>, must be <robot>", source=str(path))
    return root


def _is_xacro(root: Element) -> bool:
    return any(
        one.tag.startswith("xacro:")
        or any("${" in value or "$(" in value for value in one.attributes.values())
        for one in root.walk()
    )


def _expanded(path: Path) -> bytes:
    try:
        xacro = importlib.import_module("xacro")  # it has no types
    except ImportError as error:
        raise MissingExtra("xacro", "xacro") from error
    try:
        text: str = xacro.process_file(str(path)).toxml()
    except Exception as error:  # xacro raises what the expressions in the file raise
        words = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError("", f"xacro cannot expand it: {words}", source=str(path)) from error
    return text.encode()


# ------------------------------------------------------------------------------------- its tree


@dataclass(frozen=True, slots=True)
class _Joint:
    name: str
    kind: str
    parent: str
    child: str
    rotation: Any  # (3, 3), of the child in the parent
    origin: Any  # (3,), [m]
    axis: Any  # (3,), unit vector in the child
    limits: tuple[float, float] | None
    line: int


class _Tree:
    """Links and joints, and the pose of every link with all joints at zero."""

    def __init__(self, root: Element) -> None:
        self.links = {_name(link): link for link in root.all("link")}
        joints = [_joint(one) for one in root.all("joint")]
        self.above = {joint.child: joint for joint in joints}
        self.below: dict[str, list[_Joint]] = {}
        for joint in joints:
            for link in (joint.parent, joint.child):
                if link not in self.links:
                    raise _wrong(joint, f"link {link!r} does not exist, {did_you_mean(link, self.links)}")
            if self.above[joint.child] is not joint:
                raise _wrong(joint, f"link {joint.child!r} has a parent already")
            self.below.setdefault(joint.parent, []).append(joint)
        roots = [link for link in self.links if link not in self.above]
        if len(roots) != 1:
            found = ", ".join(roots) or "none"
            raise ConfigError("", f"links without a parent: {found}; a robot has exactly one")
        self.poses: dict[str, tuple[Any, Any]] = {roots[0]: (np.eye(3), np.zeros(3))}
        reached = [roots[0]]
        for link in reached:
            rotation, origin = self.poses[link]
            for joint in self.below.get(link, ()):
                self.poses[joint.child] = (rotation @ joint.rotation, origin + rotation @ joint.origin)
                reached.append(joint.child)
        if len(reached) < len(self.links):
            lost = sorted(set(self.links) - set(reached))
            raise ConfigError("", f"links that hang in a ring of joints: {', '.join(lost[:5])}")

    def look_from(self, base: str) -> None:
        """Have all poses seen from a link."""
        if base not in self.poses:
            return
        rotation, origin = self.poses[base]
        self.poses = {
            link: (rotation.T @ turned, rotation.T @ (place - origin))
            for link, (turned, place) in self.poses.items()
        }

    def axis(self, joint: _Joint) -> Any:
        """Its axis, seen from the base."""
        return self.poses[joint.child][0] @ joint.axis

    def joints_above(self, joint: _Joint) -> Iterator[_Joint]:
        """The joints between this one and the root, the nearest first."""
        above = self.above.get(joint.parent)
        while above is not None:
            yield above
            above = self.above.get(above.parent)

    def turned_links(self, joint: _Joint) -> Iterator[str]:
        """The links that turn with it as one piece."""
        links = [joint.child]
        for link in links:
            yield link
            links += [one.child for one in self.below.get(link, ()) if one.kind == "fixed"]


def _joint(element: Element) -> _Joint:
    name = _name(element)
    place = f"joint {name!r}"
    parent, child = (
        _attribute(element, element.first(tag), "link", place, tag) for tag in ("parent", "child")
    )
    origin, axis, limit = (element.first(tag) for tag in ("origin", "axis", "limit"))
    direction = np.array(_numbers(axis, "xyz", 3, place, (1.0, 0.0, 0.0)))
    length = float(np.linalg.norm(direction))
    kind = element.attributes.get("type", "")
    if length == 0.0 and kind in ("continuous", "revolute"):
        raise ConfigError(place, f"axis 0 0 0, must have a direction (line {element.line})")
    limits = None
    if limit is not None and kind == "revolute":
        ends = [_numbers(limit, end, 1, place, (0.0,))[0] for end in ("lower", "upper")]
        limits = (ends[0], ends[1])
    return _Joint(
        name=name,
        kind=kind,
        parent=parent,
        child=child,
        rotation=_rotation(origin, place),
        origin=np.array(_numbers(origin, "xyz", 3, place, (0.0,) * 3)),
        axis=direction / (length or 1.0),
        limits=limits,
        line=element.line,
    )


def _rotation(origin: Element | None, place: str) -> Any:
    """R = Rz(yaw) Ry(pitch) Rx(roll), as URDF has it."""
    roll, pitch, yaw = _numbers(origin, "rpy", 3, place, (0.0,) * 3)
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _name(element: Element) -> str:
    name = element.attributes.get("name", "")
    if not name:
        raise ConfigError(element.tag, f"has no name (line {element.line})")
    return name


def _attribute(holder: Element, element: Element | None, key: str, place: str, tag: str) -> str:
    value = element.attributes.get(key) if element is not None else None
    if not value:
        raise ConfigError(place, f"has no <{tag} {key}=...> (line {holder.line})")
    return value


_NUMBER = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]{1,4})?")


def _numbers(
    element: Element | None, key: str, count: int, place: str, default: tuple[float, ...]
) -> tuple[float, ...]:
    """As many finite numbers as there must be."""
    if element is None or key not in element.attributes:
        return default
    words = element.attributes[key].split()
    numbers = tuple(float(word) for word in words if _NUMBER.fullmatch(word))
    if len(words) != count or len(numbers) != count or not all(map(math.isfinite, numbers)):
        wanted = "a number" if count == 1 else f"{count} numbers"
        problem = f"{key}={element.attributes[key][:60]!r}, must be {wanted} (line {element.line})"
        raise ConfigError(place, problem)
    return numbers


def _wrong(joint: _Joint, problem: str) -> ConfigError:
    return ConfigError(f"joint {joint.name!r}", f"{problem} (line {joint.line})")


# ------------------------------------------------------------------------------------ its wheels


_SHAPES = ("collision", "visual")


def _commanded(root: Element) -> set[str]:
    """The joints that the model says are commanded; empty where it says nothing about that."""
    return {
        one.attributes.get("name", "")
        for holder in root.walk()
        if holder.tag in ("ros2_control", "transmission")
        for one in holder.all("joint")
        if holder.tag == "transmission" or one.first("command_interface") is not None
    }


def _wheels(tree: _Tree, commanded: set[str]) -> Iterator[tuple[UrdfWheel, bool]]:
    """Wheels, and whether anything of them can be seen or touched."""
    for joint in tree.above.values():
        above = list(tree.joints_above(joint))
        if not _rolls(tree, joint) or any(_rolls(tree, one) for one in above):
            continue  # rollers of a mecanum wheel turn below a joint that rolls itself
        upright = next((one for one in above if _is_upright(tree, one)), None)
        if _swivels(upright, commanded) or any(
            "caster" in name.lower() for one in (joint, *above) for name in (one.name, one.child)
        ):
            continue
        parts = [tree.links[link] for link in tree.turned_links(joint)]
        yield _wheel(tree, joint, upright), any(part.first(of) for part in parts for of in _SHAPES)


def _swivels(upright: _Joint | None, commanded: set[str]) -> bool:
    if upright is None or upright.limits is not None or not commanded:
        return False
    return upright.name not in commanded


def _rolls(tree: _Tree, joint: _Joint) -> bool:
    return joint.kind == "continuous" and abs(tree.axis(joint)[2]) < LEVEL


def _is_upright(tree: _Tree, joint: _Joint) -> bool:
    return joint.kind in ("continuous", "revolute") and abs(tree.axis(joint)[2]) > UPRIGHT


def _wheel(tree: _Tree, joint: _Joint, upright: _Joint | None) -> UrdfWheel:
    ax, ay, _ = tree.axis(joint)
    heading, sign = math.atan2(-ax, ay), 1  # the axis points to the left of where it rolls
    if not -math.pi / 2 < heading <= math.pi / 2:
        heading, sign = heading - math.copysign(math.pi, heading), -1
    x, y, _ = tree.poses[joint.child][1]
    steering_sign, steering_range = 1, None
    if upright is not None:
        steering_sign = 1 if tree.axis(upright)[2] > 0.0 else -1
        ends = sorted(steering_sign * end for end in upright.limits or ())
        steering_range = (ends[0], ends[1]) if ends and ends[0] < ends[1] else None
    return UrdfWheel(
        joint=joint.name,
        x=0.0 if abs(x) < _TINY else float(x),
        y=0.0 if abs(y) < _TINY else float(y),
        heading=0.0 if abs(heading) < AGREE else heading,
        sign=sign,
        radius=_radius(tree, joint),
        steering=None if upright is None else upright.name,
        steering_sign=steering_sign,
        steering_range=steering_range,
        place=f"link {joint.child!r} (line {tree.links[joint.child].line})",
    )


def _radius(tree: _Tree, joint: _Joint) -> float | None:
    """The greatest radius of what turns about the axis: first of what collides, else of what is seen."""
    for shape in _SHAPES:
        radii = [
            radius
            for link in tree.turned_links(joint)
            for one in tree.links[link].all(shape)
            if (radius := _round(tree, joint, link, one)) is not None
        ]
        if radii:
            return max(radii)
    return None


def _round(tree: _Tree, joint: _Joint, link: str, shape: Element) -> float | None:
    """The radius of a sphere, or of a cylinder about the joint's axis."""
    place = f"link {link!r}"
    geometry = shape.first("geometry")
    for tag in ("cylinder", "sphere"):
        body = geometry.first(tag) if geometry is not None else None
        if body is None:
            continue
        (radius,) = _numbers(body, "radius", 1, place, (0.0,))
        if not radius > 0.0:
            raise ConfigError(place, f"{tag} radius {radius:g}, must be > 0 (line {body.line})")
        along = tree.poses[link][0] @ _rotation(shape.first("origin"), place)[:, 2]
        if tag == "sphere" or abs(float(along @ tree.axis(joint))) > UPRIGHT:
            return radius
    return None


# ------------------------------------------------------------------------------------- its drive


class _Measured(NamedTuple):
    """A wheel whose radius is known."""

    wheel: UrdfWheel
    radius: float


def _chosen(found: Sequence[UrdfWheel], names: Sequence[str] | None) -> list[UrdfWheel]:
    by_name = {wheel.joint: wheel for wheel in found}
    for name in names or ():
        if name not in by_name:
            raise ConfigError(f"joint {name!r}", f"is no wheel joint, {did_you_mean(name, by_name)}")
    chosen = list(found) if names is None else [by_name[name] for name in dict.fromkeys(names)]
    if not chosen:
        raise ConfigError("", "no wheels: no continuous joint has a level axis (and is no caster)")
    return chosen


def _with_radius(wheels: Sequence[UrdfWheel], given: float | None) -> list[_Measured]:
    measured = []
    for wheel in wheels:
        radius = given if wheel.radius is None else wheel.radius
        if radius is None:
            problem = f"joint {wheel.joint!r} looks like a wheel but turns no cylinder or sphere"
            raise ConfigError(wheel.place, f"{problem}: give wheel_radius=, or name the wheels with wheels=")
        measured.append(_Measured(wheel, radius))
    return measured


Places = dict[str, UrdfWheel]


def _as_drive(wheels: Sequence[_Measured], word: str | None) -> tuple[Kinematics, Places]:
    """The drive that was asked for, or that these wheels make."""
    allowed = [name for name in DRIVES if name != TrackingWheels.type_name]
    if word is not None and word not in allowed:
        raise ConfigError("drive", f"{word!r}, {did_you_mean(word, allowed)}")
    wanted = _guess(wheels) if word is None else word
    if wanted != Custom.type_name:
        try:
            return _fitted(wanted, wheels)
        except ConfigError:
            if word is not None:
                raise
    return _custom(wheels)


def _guess(wheels: Sequence[_Measured]) -> str:
    steered = sum(one.wheel.steering is not None for one in wheels)
    fixed = len(wheels) - steered
    if not steered and fixed >= 3 and any(one.wheel.heading for one in wheels):
        return "omni"
    words = {(0, 2): "differential", (0, 4): "skid_steer", (1, 1): "bicycle", (1, 2): "tricycle"}
    return "swerve" if not fixed else {**words, (2, 2): "ackermann"}.get((steered, fixed), "custom")


class _Layout(NamedTuple):
    """What a named drive is built from.

    Attributes:
        names: The wheel that has each of the drive's names.
        centre: Where the drive's own reference point is, from the base.
        lengths: Its parameters.
    """

    names: dict[str, _Measured]
    centre: tuple[float, float]
    lengths: dict[str, Any]


def _fitted(word: str, wheels: Sequence[_Measured]) -> tuple[Kinematics, Places]:
    """A named drive, if these wheels stand where it has them."""
    layout = _LAYOUTS[word](wheels)
    if layout is None:
        raise ConfigError("drive", f"{_counted(wheels)} cannot be a {word} drive")
    radii = {name: one.radius for name, one in layout.names.items()}
    arguments: dict[str, Any] = {
        **layout.lengths,
        "wheel_radius": radii if len(set(radii.values())) > 1 else next(iter(radii.values())),
        "reference": tuple(0.0 - part for part in layout.centre),
    }
    reach = _reach(wheels)
    if reach is not None and word in _STEERS:
        arguments["max_steering"] = reach
    drive = DRIVES[word](**arguments)
    places = {}
    for name, (wheel, _) in layout.names.items():
        there = drive.wheel(name)
        off = math.remainder(wheel.heading - there.heading, math.pi)
        gap = math.hypot(wheel.x - there.x, wheel.y - there.y)
        if gap > AGREE or abs(off) > AGREE:
            problem = (
                f"stands {gap * 1e3:.1f} mm and {math.degrees(off):.1f} deg from where a {word} drive has it"
            )
            raise ConfigError(f"joint {wheel.joint!r}", f"{problem}; drive='custom' takes it as it is")
        turned = math.cos(wheel.heading - there.heading) < 0.0
        places[name] = wheel._replace(sign=-wheel.sign if turned else wheel.sign)
    return drive, places


def _counted(wheels: Sequence[_Measured]) -> str:
    steered = sum(one.wheel.steering is not None for one in wheels)
    return f"{len(wheels) - steered} fixed and {steered} steered wheels"


_STEERS = ("bicycle", "ackermann", "tricycle", "four_wheel_steering", "swerve")


def _reach(wheels: Sequence[_Measured]) -> float | None:
    """The greatest steering angle of any wheel, so that no reading of them is beyond it."""
    ranges = [one.wheel.steering_range for one in wheels if one.wheel.steering is not None]
    if None in ranges or not ranges:
        return None
    return max(abs(end) for both in ranges if both is not None for end in both)


def _split(
    wheels: Sequence[_Measured], steered: int, fixed: int
) -> tuple[list[_Measured], list[_Measured]] | None:
    """The steered wheels and the fixed ones, from left to right; None unless there are that many."""
    ordered = sorted(wheels, key=lambda one: -one.wheel.y)
    turning = [one for one in ordered if one.wheel.steering is not None]
    standing = [one for one in ordered if one.wheel.steering is None]
    return (turning, standing) if (len(turning), len(standing)) == (steered, fixed) else None


def _middle(wheels: Sequence[_Measured]) -> tuple[float, float]:
    count = len(wheels)
    return sum(one.wheel.x for one in wheels) / count, sum(one.wheel.y for one in wheels) / count


def _differential(wheels: Sequence[_Measured]) -> _Layout | None:
    if (parts := _split(wheels, 0, 2)) is None:
        return None
    left, right = parts[1]
    names = {"left": left, "right": right}
    return _Layout(names, _middle(wheels), {"track_width": left.wheel.y - right.wheel.y})


_CORNERS = ("front_left", "front_right", "rear_left", "rear_right")


def _corners(steered: int) -> Callable[[Sequence[_Measured]], _Layout | None]:
    """Four wheels at the corners of a rectangle."""

    def layout(wheels: Sequence[_Measured]) -> _Layout | None:
        if _split(wheels, steered, 4 - steered) is None:
            return None
        names = _named_corners(wheels)
        fl, fr, rl, rr = (names[corner].wheel for corner in _CORNERS)
        lengths = {
            "track_width": (fl.y - fr.y + rl.y - rr.y) / 2,
            "wheelbase": (fl.x - rl.x + fr.x - rr.x) / 2,
        }
        return _Layout(names, _middle(wheels), lengths)

    return layout


def _named_corners(wheels: Sequence[_Measured]) -> dict[str, _Measured]:
    ordered = sorted(wheels, key=lambda one: -one.wheel.x)
    pairs = [sorted(pair, key=lambda one: -one.wheel.y) for pair in (ordered[:2], ordered[2:])]
    return dict(zip(_CORNERS, [one for pair in pairs for one in pair], strict=True))


def _ackermann(wheels: Sequence[_Measured]) -> _Layout | None:
    if (parts := _split(wheels, 2, 2)) is None:
        return None
    steered, fixed = parts
    centre = _middle(fixed)
    lengths = {
        "wheelbase": _middle(steered)[0] - centre[0],
        "track_width": fixed[0].wheel.y - fixed[1].wheel.y,
    }
    return _Layout(dict(zip(_CORNERS, [*steered, *fixed], strict=True)), centre, lengths)


def _bicycle(wheels: Sequence[_Measured]) -> _Layout | None:
    if (parts := _split(wheels, 1, 1)) is None:
        return None
    (front,), (rear,) = parts
    length = front.wheel.x - rear.wheel.x
    return _Layout({"front": front, "rear": rear}, _middle([rear]), {"wheelbase": length})


def _tricycle(wheels: Sequence[_Measured]) -> _Layout | None:
    if (parts := _split(wheels, 1, 2)) is None:
        return None
    (front,), (left, right) = parts
    centre = _middle([left, right])
    aside = front.wheel.y - centre[1]
    lengths = {
        "wheelbase": front.wheel.x - centre[0],
        "track_width": left.wheel.y - right.wheel.y,
        "front_y": 0.0 if abs(aside) < _TINY else aside,
    }
    return _Layout({"front": front, "rear_left": left, "rear_right": right}, centre, lengths)


def _omni(wheels: Sequence[_Measured]) -> _Layout | None:
    if len(wheels) < 3 or any(one.wheel.steering is not None for one in wheels):
        return None
    x, y = _middle(wheels)
    angles = [math.atan2(one.wheel.y - y, one.wheel.x - x) % math.tau for one in wheels]
    angles = [0.0 if math.tau - angle < AGREE else angle for angle in angles]
    order = sorted(range(len(wheels)), key=angles.__getitem__)
    distance = sum(math.hypot(one.wheel.x - x, one.wheel.y - y) for one in wheels) / len(wheels)
    names = {f"wheel_{place + 1}": wheels[k] for place, k in enumerate(order)}
    lengths = {
        "robot_radius": distance,
        "wheel_count": len(wheels),
        "first_wheel_angle": angles[order[0]],
    }
    return _Layout(names, (x, y), lengths)


def _swerve(wheels: Sequence[_Measured]) -> _Layout | None:
    if any(one.wheel.steering is None for one in wheels):
        return None
    names = _named_corners(wheels) if len(wheels) == 4 else {one.wheel.joint: one for one in wheels}
    modules = {name: (one.wheel.x, one.wheel.y) for name, one in names.items()}
    return _Layout(names, (0.0, 0.0), {"modules": modules})


_LAYOUTS: Mapping[str, Callable[[Sequence[_Measured]], _Layout | None]] = {
    "differential": _differential,
    "skid_steer": _corners(0),
    "mecanum": _corners(0),
    "four_wheel_steering": _corners(4),
    "ackermann": _ackermann,
    "bicycle": _bicycle,
    "tricycle": _tricycle,
    "omni": _omni,
    "swerve": _swerve,
}


def _custom(wheels: Sequence[_Measured]) -> tuple[Kinematics, Places]:
    """The wheels as they are. Fixed ones behind each other must slip to turn."""
    steered = [one for one in wheels if one.wheel.steering is not None]
    stations = {round(one.wheel.x / AGREE) for one in wheels}
    straight = all(one.wheel.heading == 0.0 for one in wheels)
    standing = "skid" if not steered and straight and len(stations) > 1 else "fixed"
    built = [
        Wheel(
            wheel.joint,
            wheel.x,
            wheel.y,
            radius,
            heading=wheel.heading,
            kind=standing if wheel.steering is None else "steered",
            steering_range=wheel.steering_range,
        )
        for wheel, radius in wheels
    ]
    return Custom(wheels=built), {one.wheel.joint: one.wheel for one in wheels}


def _log_mapping(places: Places) -> LogMapping:
    return LogMapping(
        wheels={
            name: WheelMapping(topic=JOINT_STATES, name=wheel.joint, sign=1 if wheel.sign > 0 else -1)
            for name, wheel in places.items()
        },
        steering={
            name: ScalarMapping(
                topic=JOINT_STATES, name=wheel.steering, sign=1 if wheel.steering_sign > 0 else -1
            )
            for name, wheel in places.items()
            if wheel.steering is not None
        },
    )
