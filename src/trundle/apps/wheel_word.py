"""Which wheel a name means, in whatever way it is spelled."""

from __future__ import annotations

import re
from collections.abc import Sequence

__all__ = ["matched", "wheel_meant", "words_of"]

_PIECE = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
_CORNERS = {
    "left": "left", "l": "left", "right": "right", "r": "right",
    "front": "front", "rear": "rear", "back": "rear",
    "fl": "front_left", "lf": "front_left", "fr": "front_right", "rf": "front_right",
    "rl": "rear_left", "lr": "rear_left", "bl": "rear_left", "lb": "rear_left",
    "rr": "rear_right", "br": "rear_right", "rb": "rear_right",
}  # fmt: skip
_NUMBERED = {"wheel", "motor", "module", "encoder", "enc", "m", "w"}


def words_of(name: str) -> list[str]:
    """`frontLeft_ticks` is front, left, ticks."""
    return [piece.lower() for piece in _PIECE.findall(name)]


def wheel_meant(name: str) -> str:
    """`front_left`, `left`, `wheel_2`, ...; empty where the name means no wheel."""
    words = words_of(name)
    meant = [_CORNERS[word] for word in words if word in _CORNERS]
    ends = [end for end in ("front", "rear") if any(end in corner for corner in meant)]
    sides = [side for side in ("left", "right") if any(side in corner for corner in meant)]
    if len(ends) <= 1 and len(sides) <= 1 and meant:
        return "_".join((*ends, *sides))
    numbers = [word for word in words if word.isdigit()]
    return f"wheel_{int(numbers[0])}" if numbers and _NUMBERED & set(words) else ""


def matched(wanted: Sequence[str], found: Sequence[str]) -> dict[str, str]:
    """For each wanted wheel the name that means it; by order where names say nothing.

    Args:
        wanted: Names of a robot's wheels; none where any will do.
        found: Names that a log uses.
    """
    meaning = {name: wheel_meant(name) for name in found}
    if not wanted:
        return {meant: name for name, meant in meaning.items() if meant}
    same = {
        wheel: name
        for wheel in wanted
        for name, meant in meaning.items()
        if meant and meant == wheel_meant(wheel)
    }
    if len(same) == len(wanted):
        return same
    return dict(zip(wanted, found, strict=True)) if len(wanted) == len(found) else same
