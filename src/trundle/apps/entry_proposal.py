"""Which entries of a data log say what swerve modules and wheels do; all are logged when they change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from trundle.apps.wheel_word import matched, words_of

__all__ = ["field_pose", "proposed_entries"]

_NUMBERS = ("double", "float", "int64")
_OF_SPEED = {"velocity", "vel", "speed"}
_OF_WAY = {"position", "distance"}
_OF_STEERING = {"steer", "steering", "turn", "turning", "azimuth", "angle"}
_NOT_WHEELS = {"omega", "heading", "gyro", "yaw", "current", "target"}
_UNITS = {
    **dict.fromkeys(("feet", "ft"), "ft"),
    **dict.fromkeys(("meters", "metres", "m"), "m"),
    **dict.fromkeys(("inches", "inch"), "in"),
    **dict.fromkeys(("degrees", "degree", "deg"), "deg"),
    **dict.fromkeys(("radians", "radian", "rad"), "rad"),
    **dict.fromkeys(("rotations", "revolutions", "rev"), "rev"),
}
_SPEEDS = {"ft": "ft/s", "m": "m/s", "deg": "deg/s", "rad": "rad/s", "rev": "rev/s"}
# Arrays of structs: their field for the wheel, and its unit.
_MODULES = {
    "struct:SwerveModulePosition[]": ("distance", "m"),
    "struct:SwerveModuleState[]": ("speed", "m/s"),
    "struct:SwerveModuleVelocity[]": ("speed", "m/s"),
}
_USUAL = ("front_left", "front_right", "rear_left", "rear_right")  # WPILib's order

Mappings = dict[str, dict[str, Any]]


def proposed_entries(
    entries: Sequence[tuple[str, str]], wheels: Sequence[str], steered: Sequence[str]
) -> tuple[Mappings, Mappings]:
    """Mappings of wheels and of their steering; both empty where no entry says all wheels.

    Args:
        entries: Name and type of each, but those of targets.
        wheels: The robot's measured wheels, if the robot is known.
        steered: Its steered wheels.
    """
    for kind, (field, unit) in _MODULES.items():
        names = [name for name, its_kind in entries if its_kind == kind]
        if names and len(wheels or _USUAL) == len(_USUAL):
            return _of_modules(names[0], field, unit, wheels or _USUAL)
    numbers = [name for name, kind in entries if kind in _NUMBERS and not _NOT_WHEELS & _words(name)]
    steering = [name for name in numbers if _OF_STEERING & _words(name) and not _OF_SPEED & _words(name)]
    for what in (_OF_WAY, _OF_SPEED):
        found = matched(wheels, [name for name in numbers if what & _words(name) and name not in steering])
        if len(found) < max(len(wheels), 2):
            continue
        angles = matched(steered, steering)
        return (
            {wheel: _mapping(name, _unit(name, what)) for wheel, name in found.items()},
            {wheel: _mapping(name, _unit(name, _OF_STEERING)) for wheel, name in angles.items()},
        )
    return {}, {}


def field_pose(entries: Sequence[tuple[str, str]]) -> dict[str, str] | None:
    """The reference of a Field2d, whose robot is an array of metres, metres and degrees."""
    found = [name for name, kind in entries if kind == "double[]" and name.endswith("/Robot")]
    return {"topic": found[0], "angle_unit": "deg"} if found else None


def _of_modules(topic: str, field: str, unit: str, wheels: Sequence[str]) -> tuple[Mappings, Mappings]:
    places = list(enumerate(wheels))
    return (
        {
            wheel: {"topic": topic, "field": field, "name": k, "unit": unit, "hold": True}
            for k, wheel in places
        },
        {wheel: {"topic": topic, "field": "angle.value", "name": k, "hold": True} for k, wheel in places},
    )


def _mapping(name: str, unit: str) -> dict[str, Any]:
    return {"topic": name, "unit": unit, "hold": True}


def _unit(name: str, what: set[str]) -> str:
    """The unit that a name says, else that of WPILib: metres, and angles in radians."""
    said = next((_UNITS[word] for word in words_of(name) if word in _UNITS), "")
    if what is _OF_SPEED:
        return "rpm" if "rpm" in words_of(name) else _SPEEDS.get(said, "m/s")
    if what is _OF_STEERING:
        return said if said in ("deg", "rad", "rev") else "rad"
    return said or "m"


def _words(name: str) -> set[str]:
    return set(words_of(name))
