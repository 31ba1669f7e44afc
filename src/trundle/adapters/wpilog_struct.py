"""Structs of WPILib: what their schemas say, as NumPy types.

Source: WPILib, wpiutil/doc/struct.adoc. Members follow each other without padding, little-endian.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

__all__ = ["STRUCTS", "UnknownStruct", "dtype_of"]

MOST_BYTES = 1 << 20  # of one struct

_NUMBERS = {
    "bool": "?",
    "char": "i1",
    "int8": "i1",
    "int16": "<i2",
    "int32": "<i4",
    "int64": "<i8",
    "uint8": "u1",
    "uint16": "<u2",
    "uint32": "<u4",
    "uint64": "<u8",
    "float": "<f4",
    "float32": "<f4",
    "double": "<f8",
    "float64": "<f8",
}
_MEMBER = re.compile(r"(?:enum\s*\{[^{}]*\}\s*)?(\w+)\s+(\w+)\s*(?:\[\s*(\d{1,7})\s*\])?")

_MODULE_SPEED = "double speed;Rotation2d angle"
_CHASSIS_SPEED = "double vx;double vy;double omega"

# WPILib's own, under their names of 2026 and of 2027, for logs that do not hold their schemas.
STRUCTS: Mapping[str, str] = {
    "Rotation2d": "double value",
    "Translation2d": "double x;double y",
    "Pose2d": "Translation2d translation;Rotation2d rotation",
    "Twist2d": "double dx;double dy;double dtheta",
    "Quaternion": "double w;double x;double y;double z",
    "Rotation3d": "Quaternion q",
    "Translation3d": "double x;double y;double z",
    "Pose3d": "Translation3d translation;Rotation3d rotation",
    "SwerveModulePosition": "double distance;Rotation2d angle",
    "SwerveModuleState": _MODULE_SPEED,
    "SwerveModuleVelocity": _MODULE_SPEED,
    "ChassisSpeeds": _CHASSIS_SPEED,
    "ChassisVelocities": _CHASSIS_SPEED,
}


class UnknownStruct(LookupError):
    """A struct whose schema is missing, or says nothing that can be read."""


def dtype_of(name: str, schemas: Mapping[str, str]) -> np.dtype[np.void]:
    """The NumPy type of a struct.

    Args:
        name: Its name.
        schemas: Schema by name; WPILib's own are known without.

    Raises:
        UnknownStruct: If it, or one that it is made of, is not known, holds itself, packs members into
            bits, or is larger than a megabyte.
    """
    return _dtype(name, schemas, (), {})


def _dtype(
    name: str, schemas: Mapping[str, str], outer: tuple[str, ...], made: dict[str, np.dtype[np.void]]
) -> np.dtype[np.void]:
    if name in made:
        return made[name]
    text = schemas.get(name, STRUCTS.get(name))
    if text is None:
        raise UnknownStruct(f"the log does not hold the schema of struct {name}")
    if name in outer or len(outer) > 15:
        raise UnknownStruct(f"struct {name} holds itself, or is nested too deeply")
    members: list[tuple[str, np.dtype[np.generic], tuple[int, ...]]] = []
    total = 0
    for declaration in filter(str.strip, text.split(";")):
        found = _MEMBER.fullmatch(declaration.strip())
        if found is None:
            raise UnknownStruct(f"the schema of struct {name} says {declaration.strip()[:80]!r}")
        kind, member, count = found.groups()
        inner: np.dtype[np.generic]
        inner = np.dtype(_NUMBERS[kind]) if kind in _NUMBERS else _dtype(kind, schemas, (*outer, name), made)
        total += inner.itemsize * int(count or 1)
        if total > MOST_BYTES:
            raise UnknownStruct(f"struct {name} takes more than {MOST_BYTES} bytes")
        members.append((member, inner, (int(count),) if count else ()))
    if len({member for member, _, _ in members}) < len(members) or not total:
        raise UnknownStruct(f"the schema of struct {name} holds no members, or two of one name")
    made[name] = np.dtype(members)
    return made[name]
