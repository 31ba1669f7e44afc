"""A `log:` section to start from, guessed from the names and numbers of a log."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from trundle.apps.entry_proposal import field_pose, proposed_entries
from trundle.apps.quantum import quantum_of, unit_of
from trundle.apps.wheel_word import matched, wheel_meant, words_of
from trundle.robot.log_mapping import TableFormat, Unit

__all__ = [
    "Column",
    "Proposal",
    "Topic",
    "propose_for_table",
    "propose_for_topics",
    "section_text",
    "time_unit",
]

Name: TypeAlias = str | int
Floats: TypeAlias = npt.NDArray[np.float64]

_TIME = {"time", "t", "timestamp", "stamp", "sec", "secs", "seconds", "ms", "us", "ns"}
_TRUTH = {"gt", "ref", "reference", "truth", "true", "mocap", "optitrack", "vicon"}
_AXES = ({"x"}, {"y"}, {"theta", "th", "yaw", "heading", "psi"})
_YAW = {"z", "yaw"}
_DEGREES = {"dps", "deg", "degs", "degrees"}
_NOT_MEASURED = {
    "cmd",
    "command",
    "target",
    "setpoint",
    "desired",
    "current",
    "voltage",
    "effort",
    "torque",
    "pwm",
}
_UNITS = {
    **dict.fromkeys(("ticks", "tick", "count", "counts", "enc", "encoder"), "ticks"),
    **dict.fromkeys(("revolutions", "revolution", "revs", "rev", "turns"), "rev"),
    **dict.fromkeys(("velocity", "vel", "speed"), "rad/s"),
    **dict.fromkeys(("distance", "dist", "m"), "m"),
    **{unit: unit for unit in ("rad", "deg", "rpm", "mm", "cm")},
}  # fmt: skip
_OWN = {
    "position": ("rad", "position"),
    "position_delta": ("rad", "increment"),
    "ticks": ("ticks", "position"),
    "ticks_delta": ("ticks", "increment"),
    "revolutions": ("rev", "position"),
    "distance": ("m", "position"),
    "velocity": ("rad/s", "velocity"),
}
_ORDER = ("clock", "table", "time", "wheels", "steering", "gyro", "twist", "reference")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table; its numbers, or None where it holds text."""

    name: Name
    values: Floats | None
    unreadable: int = 0

    @property
    def is_whole(self) -> bool:
        """Whether it holds whole numbers only."""
        return self.values is not None and bool((self.values == np.rint(self.values)).all())

    @property
    def steps_unit(self) -> str:
        """The unit of which its numbers are an encoder's steps; empty where that cannot be seen."""
        quantum = None if self.values is None else quantum_of(self.values)
        return "" if quantum is None else unit_of(quantum)

    @property
    def words(self) -> list[str]:
        """The words of its name."""
        return words_of(str(self.name))


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a recording.

    Attributes:
        name: Of the topic.
        type: Of its messages.
        count: How many there are.
        joints: Where it holds JointStates, for each joint whether its positions are whole numbers, or
            None where there are none or they never change.
        offset: How much later messages were received than stamped, on average [s].
    """

    name: str
    type: str
    count: int
    joints: Mapping[str, bool | None] = field(default_factory=dict)
    offset: float | None = None


@dataclass(slots=True)
class Proposal:
    """What may be written into robot.yaml, and what each column was taken for."""

    section: dict[str, Any] = field(default_factory=dict)
    roles: dict[Name, str] = field(default_factory=dict)

    @property
    def ordered(self) -> dict[str, Any]:
        """The section as people read it."""
        return {key: self.section[key] for key in _ORDER if key in self.section}

    def put(self, path: Sequence[str], mapping: dict[str, Any], role: str) -> None:
        """Map a column or topic."""
        inside = self.section
        for part in path[:-1]:
            inside = inside.setdefault(part, {})
        inside[path[-1]] = mapping
        self.roles[mapping["column"] if "column" in mapping else mapping["topic"]] = role


# --- tables -------------------------------------------------------------------------------------


def propose_for_table(
    columns: Sequence[Column], table: TableFormat, wheels: Sequence[str] = (), steered: Sequence[str] = ()
) -> Proposal:
    """A section for a table.

    Args:
        columns: What it holds.
        table: How it is written.
        wheels: The robot's measured wheels, if the robot is known.
        steered: Its steered wheels.
    """
    proposal = Proposal()
    plain = TableFormat()
    changed = {
        key: getattr(table, key)
        for key in ("delimiter", "header", "decimal")
        if getattr(table, key) != getattr(plain, key)
    }
    if changed:
        proposal.section["table"] = changed
    numbers = [column for column in columns if column.values is not None and len(column.values) > 1]
    time = _time_column(numbers)
    if time is not None:
        unit = time_unit(time)
        proposal.put(("time",), {"column": time.name, "unit": unit}, f"time [{unit}]")
    rest = [column for column in numbers if column is not time]
    _propose_reference(proposal, rest)
    rest = [c for c in rest if c.name not in proposal.roles and not _NOT_MEASURED & set(c.words)]
    angles = [column for column in rest if _steers(str(column.name))]
    _propose_wheels(proposal, [column for column in rest if column not in angles], wheels)
    rest = [column for column in rest if column.name not in proposal.roles]
    _propose_steering(proposal, angles or _unnamed_angles(proposal, rest), steered)
    _propose_gyro(proposal, rest)
    return proposal


def _propose_gyro(proposal: Proposal, columns: Sequence[Column]) -> None:
    """The rate about the axis that points up, where there are several."""
    rates = [column for column in columns if "gyro" in column.words or "yaw_rate" in str(column.name)]
    if rates:
        column = min(rates, key=lambda rate: not _YAW & set(rate.words))
        unit = "deg/s" if _DEGREES & set(column.words) else "rad/s"
        proposal.put(("gyro",), {"column": column.name, "unit": unit}, f"gyro [{unit}]")


def _steers(name: str) -> bool:
    return any(word.startswith("steer") for word in words_of(name))


def _propose_steering(proposal: Proposal, angles: Sequence[Column], steered: Sequence[str]) -> None:
    named = {str(column.name): column for column in angles}
    for wheel, name in matched(steered, list(named)).items():
        column = named[name]
        unit = _angle_unit(column)
        mapping = {"column": column.name, "unit": unit, **_held(column), **_wrapping(column, unit)}
        proposal.put(("steering", wheel), mapping, f"steering of {wheel} [{unit}]")


def _angle_unit(column: Column) -> str:
    """What its name says, else degrees where it is more than a turn in radians."""
    assert column.values is not None
    return "deg" if _DEGREES & set(column.words) or np.abs(column.values).max() > 7.0 else "rad"


def _wrapping(column: Column, unit: str) -> dict[str, Any]:
    """`wraps` for an angle that jumps by a turn, and by little else."""
    assert column.values is not None
    turns = np.abs(np.diff(column.values)) * Unit(unit).factor / math.tau
    jumps = turns > 0.75
    return {"wraps": True} if jumps.any() and turns[~jumps].max(initial=0.0) < 0.25 else {}


def _unnamed_angles(proposal: Proposal, columns: Sequence[Column]) -> list[Column]:
    """In a table without header: what follows the wheels and may be an angle."""
    mapped = [mapping["column"] for mapping in proposal.section.get("wheels", {}).values()]
    wheels = [place for place in mapped if isinstance(place, int)]
    return [
        column
        for column in columns
        if wheels and isinstance(column.name, int) and column.name > min(wheels) and _is_angle(column)
    ]


def _is_angle(column: Column) -> bool:
    return not column.is_whole and bool(np.max(np.abs(column.values)) < 3.2)  # type: ignore[arg-type]


def _time_column(columns: Sequence[Column]) -> Column | None:
    """A column called time, else the first that only grows and is not called something else."""
    named = [column for column in columns if _TIME & set(column.words) and _grows(column, 0.8)]
    others = [column for column in columns if not _is_reading(column) and _grows(column, 0.95)]
    return next(iter((*named, *others)), None)


def _is_reading(column: Column) -> bool:
    """Whether its name says a wheel or a unit that no time has."""
    return bool(wheel_meant(str(column.name)) or set(_UNITS) & set(column.words))


def _grows(column: Column, part: float) -> bool:
    """Whether it grows, and at most of its steps does not shrink."""
    assert column.values is not None
    steps = np.diff(column.values)
    grown = bool(column.values[-1] > column.values[0] and np.median(steps) > 0.0)
    return grown and bool(np.mean(steps >= 0.0) > part)


def time_unit(column: Column) -> str:
    """The unit that its name says, else that under which a robot's log has a rate of 1 to 1000 Hz."""
    named = [unit for unit in ("ns", "us", "ms", "s") if unit in column.words]
    if named:
        return named[0]
    assert column.values is not None
    steps = np.diff(column.values)
    step = float(np.median(steps[steps > 0.0]))
    units = ("s", "ms", "us", "ns")
    return next((unit for unit in units if 0.5e-3 <= step * Unit(unit).factor <= 2.0), "s")


def _propose_reference(proposal: Proposal, columns: Sequence[Column]) -> None:
    found = [
        column
        for axis in _AXES
        for column in columns
        if axis & _loosely(column.words) and _TRUTH & _loosely(column.words)
    ]
    if len(found) in (2, 3):
        proposal.section["reference"] = {"columns": [column.name for column in found]}
        proposal.roles |= {
            column.name: f"reference {axis}" for column, axis in zip(found, ("x", "y", "theta"), strict=False)
        }


def _loosely(words: Sequence[str]) -> set[str]:
    """The words, and those of which two were written together: xgt, thgt."""
    split = {
        part
        for word in words
        for truth in _TRUTH
        if word.endswith(truth)
        for part in (word.removesuffix(truth), truth)
    }
    return set(words) | split


def _propose_wheels(proposal: Proposal, columns: Sequence[Column], wheels: Sequence[str]) -> None:
    speaking = [column for column in columns if wheel_meant(str(column.name))]
    if not speaking and all(isinstance(column.name, int) for column in columns):
        speaking = _unnamed_wheels(columns, len(wheels))
        wheels = wheels or _usual_names(len(speaking))
    readings = {column.name: _reading(column) for column in speaking}
    # Of several readings of one wheel the first of the kind that loses least.
    for kind in ("position", "increment", "velocity"):
        chosen = {str(column.name): column for column in speaking if readings[column.name][1] == kind}
        found = matched(wheels, list(chosen))
        if not found or len(found) < len(wheels):
            continue
        for wheel, name in found.items():
            unit, _ = readings[chosen[name].name]
            said = {} if kind == "velocity" else {"kind": kind}
            mapping = {"column": chosen[name].name, "unit": unit, **said, **_held(chosen[name])}
            proposal.put(("wheels", wheel), mapping, f"{wheel}: {unit}, {kind}")
        return


def _held(column: Column) -> dict[str, Any]:
    """`hold` for a column with so few numbers that it must be written at a lower rate."""
    assert column.values is not None
    return {"hold": True} if column.unreadable > len(column.values) // 4 else {}


def _unnamed_wheels(columns: Sequence[Column], count: int) -> list[Column]:
    """In a table without header: the counters; of too many those that differ; else the last columns.

    Without counters, what has an encoder's steps; without these, what adds up like a counter, if that is all
    there is: beside other columns it may as well be where the robot was.
    """
    moving = [column for column in columns if np.ptp(column.values) > 0.0]  # type: ignore[arg-type]
    counters = [column for column in moving if column.is_whole]
    counters = counters or [column for column in moving if column.steps_unit]
    if not counters:
        counters = [column for column in moving if _is_running_total(column)]
        if len(counters) < len(moving) and not count:
            return []
    totals = [column for column in counters if _is_running_total(column)]
    counters = totals or counters
    if not count or len(counters) == count:
        return counters
    different: list[Column] = []
    for column in counters:
        if not any(_nearly_equal(column, other) for other in different):
            different.append(column)
    return different if len(different) == count else list(columns[-count:])


def _nearly_equal(column: Column, other: Column) -> bool:
    if column.values is None or other.values is None or len(column.values) != len(other.values):
        return False
    return bool(np.max(np.abs(column.values - other.values)) < 0.01 * np.ptp(column.values))


def _usual_names(count: int) -> tuple[str, ...]:
    if count == 2:
        return ("left", "right")
    if count == 4:
        return ("front_left", "front_right", "rear_left", "rear_right")
    return tuple(f"wheel_{k + 1}" for k in range(count))


def _reading(column: Column) -> tuple[str, str]:
    """Unit and kind of a wheel column."""
    own = str(column.name).rpartition(".")[2]
    if own in _OWN:
        return _OWN[own]
    said = [_UNITS[word] for word in column.words if word in _UNITS]
    seen = "ticks" if column.is_whole else column.steps_unit
    unit = next((unit for unit in said if unit != "rad/s"), said[0] if said else seen)
    if "rad/s" in said or unit == "rpm":
        fitting = {"m": "m/s", "mm": "mm/s", "deg": "deg/s", "ticks": "ticks/s"}
        return fitting.get(unit, unit), "velocity"
    if _is_running_total(column):
        return unit or "rad", "position"
    return (unit, "increment") if unit else ("rad/s", "velocity")


def _is_running_total(column: Column) -> bool:
    """Whether steps are small beside what they add up to, and it does not end where it began."""
    values = column.values
    assert values is not None
    wandered = float(np.mean(np.abs(values - np.median(values))))
    gone = abs(float(values[-1] - values[0])) > 0.05 * float(np.ptp(values))
    return gone and float(np.mean(np.abs(np.diff(values)))) < 0.15 * wandered


# --- recordings ---------------------------------------------------------------------------------

_POSES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/Pose2D",
    "geometry_msgs/msg/PointStamped",
    "geometry_msgs/msg/TransformStamped",
    "struct:Pose2d",
)
_TWISTS = (
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/TwistWithCovarianceStamped",
    "geometry_msgs/msg/TwistStamped",
    "geometry_msgs/msg/Twist",
    "struct:ChassisSpeeds",
)
_FAR_APART = 0.5  # [s]: topics whose clocks differ by so much must be put together by receipt


def propose_for_topics(
    topics: Sequence[Topic], wheels: Sequence[str] = (), steered: Sequence[str] = (), *, gyro: bool = False
) -> Proposal:
    """A section for a recording.

    Args:
        topics: What it holds.
        wheels: The robot's measured wheels, if the robot is known.
        steered: Its steered wheels.
        gyro: Whether it measures with a gyro.
    """
    proposal = Proposal()
    filled = [topic for topic in topics if topic.count > 2 and not _NOT_MEASURED & set(words_of(topic.name))]
    used = (
        _propose_joints(proposal, filled, wheels, steered)
        or _propose_entries(proposal, filled, wheels, steered)
        or _propose_twist(proposal, filled)
    )
    inertial = _of_types(filled, ("sensor_msgs/msg/Imu",))
    if gyro and inertial:
        proposal.put(("gyro",), {"topic": inertial[0].name}, "gyro")
    truths = _of_types(filled, _POSES) or [
        topic for topic in _of_types(filled, ("nav_msgs/msg/Odometry",)) if topic not in used
    ]
    if truths:
        truth = max(truths, key=lambda topic: (bool(_TRUTH & set(words_of(topic.name))), topic.count))
        proposal.put(("reference",), {"topic": truth.name}, "reference")
        used.append(truth)
    offsets = [topic.offset for topic in used if topic.offset is not None]
    if offsets and max(offsets) - min(offsets) > _FAR_APART:
        proposal.section = {"clock": "receive", **proposal.section}
    return proposal


def _of_types(topics: Sequence[Topic], types: Sequence[str]) -> list[Topic]:
    """The topics of the first of these types that any has."""
    return next((found for kind in types if (found := [t for t in topics if t.type == kind])), [])


def _propose_joints(
    proposal: Proposal, topics: Sequence[Topic], wheels: Sequence[str], steered: Sequence[str]
) -> list[Topic]:
    for topic in topics:
        found = matched(wheels, [joint for joint in topic.joints if not _steers(joint)])
        if not found or len(found) < len(wheels):
            continue
        for wheel, joint in found.items():
            whole = topic.joints[joint]
            unit = "rad/s" if whole is None else "ticks" if whole else "rad"
            proposal.put(("wheels", wheel), {"topic": topic.name, "name": joint, "unit": unit}, "wheels")
        for wheel, joint in matched(steered, [joint for joint in topic.joints if _steers(joint)]).items():
            proposal.put(("steering", wheel), {"topic": topic.name, "name": joint}, "steering")
        return [topic]
    return []


def _propose_entries(
    proposal: Proposal, topics: Sequence[Topic], wheels: Sequence[str], steered: Sequence[str]
) -> list[Topic]:
    """Entries of a data log."""
    entries = [(topic.name, topic.type) for topic in topics]
    for what, found in zip(("wheels", "steering"), proposed_entries(entries, wheels, steered), strict=True):
        for wheel, mapping in found.items():
            proposal.put((what, wheel), mapping, what)
    used = [topic for topic in topics if topic.name in proposal.roles]
    field = field_pose(entries)
    if field is not None:
        proposal.put(("reference",), dict(field), "reference")
    return used


def _propose_twist(proposal: Proposal, topics: Sequence[Topic]) -> list[Topic]:
    unlike_truth = [topic for topic in topics if not _TRUTH & set(words_of(topic.name))]
    found = _of_types(unlike_truth, _TWISTS)
    if not found:
        return []
    own = max(found, key=lambda topic: topic.name.rpartition("/")[2] == "odom")
    proposal.put(("twist",), {"topic": own.name}, "twist")
    return [own]


# --- text ---------------------------------------------------------------------------------------

_PLAIN = re.compile(r"[A-Za-z_/][A-Za-z0-9_/.]*|(rad|deg|rev|ticks|m|mm|cm)/s")
_NOT_TEXT = {"true", "false", "null", "yes", "no", "on", "off", "y", "n", "nan", "inf"}


def section_text(section: Mapping[str, Any], name: str = "log") -> list[str]:
    """The section as lines of YAML: the outer mappings on lines of their own, the innermost in one."""
    if not any(isinstance(value, Mapping) for value in section.values()):
        return [f"{_flow(name)}: {_flow(section)}"]
    lines = [f"{_flow(name)}:"]
    for key, value in section.items():
        inner = section_text(value, key) if isinstance(value, Mapping) else [f"{_flow(key)}: {_flow(value)}"]
        lines += [f"  {line}" for line in inner]
    return lines


def _flow(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_flow(key)}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str) and _PLAIN.fullmatch(value) and value.lower() not in _NOT_TEXT:
        return value
    return _quoted(value) if isinstance(value, str) else json.dumps(value)


def _quoted(text: str) -> str:
    """YAML's double quotes know more of Unicode than JSON's."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
