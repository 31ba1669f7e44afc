"""Which numbers the logs can tell: chosen by what they say, not by courage."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.calibrate.cure import Cure
from trundle.calibrate.parameter import DRIVE, Parameter

__all__ = [
    "MOST_CONDITION",
    "Excitation",
    "condition_of",
    "grown",
    "open_directions",
    "select",
    "why_open",
    "without_scale",
]

Floats = npt.NDArray[np.float64]

MOST_CONDITION = 1e5
"""Condition of the information about the drive, every number measured against its size (FAULTS.md B1)."""
_BLURRED = 0.2
"""A number of the drive that is known no better than this part of its size is not known."""
_USEFUL = {
    "reference.x": 0.03,
    "reference.y": 0.03,
    "reference.theta": 0.05,
    "clock": 0.05,
    "gyro.bias": 0.005,
}
_USEFUL_RATIO = 0.05
_ABOVE_NOISE = 3.0
"""Times what the noise of the wheels alone would seem to tell: jittering readings look like small turns."""
_SHARE = 0.3  # of a direction, below which a number hardly takes part in it


@dataclass(frozen=True, slots=True)
class Excitation:
    """What was driven.

    Attributes:
        distance: [m].
        left: Heading gone through to the left [rad].
        right: To the right [rad].
        measured: Whether any reference says how far it went; loops that close do not.
    """

    distance: float
    left: float
    right: float
    measured: bool = True

    @property
    def turned(self) -> float:
        """Either way [rad]."""
        return self.left + self.right


def condition_of(parameters: Sequence[Parameter], information: Floats) -> float:
    """Condition of what is known about the drive, whatever the sensors' numbers are."""
    scaled = _about_drive(parameters, information)
    if not len(scaled):
        return 1.0
    sizes = np.linalg.eigvalsh(scaled)
    return float("inf") if sizes[0] <= 0.0 else float(sizes[-1] / sizes[0])


def open_directions(
    parameters: Sequence[Parameter], information: Floats, spurious: Floats
) -> list[tuple[str, ...]]:
    """Names of the drive's numbers that cannot be told, or not apart; none where all is well.

    Args:
        parameters: What the information is about.
        information: Shape (parameters, parameters).
        spurious: What of it the noise of the wheels would give where nothing is driven for it.
    """
    scaled = _about_drive(parameters, information)
    drive = [one for one in parameters if one.part == DRIVE]
    if not drive:
        return []
    rows = [k for k, one in enumerate(parameters) if one.part == DRIVE]
    lengths = np.array([one.size for one in drive])
    noise = spurious[np.ix_(rows, rows)] * np.outer(lengths, lengths)
    sizes, directions = np.linalg.eigh(scaled)
    found = []
    for size, direction in zip(sizes, directions.T, strict=True):
        weak = size * MOST_CONDITION < sizes[-1] or size * _BLURRED**2 < 1.0
        if weak or size < _ABOVE_NOISE * (direction @ noise @ direction):
            strong = np.abs(direction) > _SHARE * np.abs(direction).max()
            found.append(tuple(one.name for one, takes in zip(drive, strong, strict=True) if takes))
    return found


def without_scale(parameters: Sequence[Parameter], information: Floats) -> Floats:
    """The information less that about the size of all lengths together.

    How far off a loop closes seems to tell the robot's size: a smaller one closes it better, one of no size
    best of all.
    """
    scale = np.array([one.nominal if one.part == DRIVE else 0.0 for one in parameters])
    about = information @ scale
    less: Floats = information - np.outer(about, about) / max(float(about @ scale), 1e-300)
    return less


def select(
    asked: Sequence[Parameter],
    groups: Sequence[tuple[Parameter, ...]],
    information: Callable[[Sequence[Parameter]], Floats],
    spurious: Callable[[Sequence[Parameter]], Floats],
) -> tuple[tuple[Parameter, ...], list[tuple[str, ...]]]:
    """What to find, and the groups that cannot be.

    Args:
        asked: What must be found.
        groups: What joins it, group by group, as long as all can be told.
        information: What the logs say about some parameters.
        spurious: What of it is noise, see `open_directions`.
    """
    chosen, refused = tuple(asked), []
    for group in groups:
        if all(one in chosen for one in group):
            continue
        trial = grown(chosen, group)
        drives = any(one.part == DRIVE for one in group)
        noise = spurious(trial) if drives else np.zeros((len(trial), len(trial)))
        if _told(trial, information(trial), noise, group):
            chosen = trial
        else:
            refused.append(tuple(one.name for one in group))
    return chosen, refused


def grown(chosen: tuple[Parameter, ...], group: tuple[Parameter, ...]) -> tuple[Parameter, ...]:
    """What was chosen, and a group.

    Each wheel's radius takes the place of the common one, and a side's turning centre of the track's.
    """
    instead = {"wheel_radius.": "wheel_radius", "icr_": "track_width"}
    gone = {old for new, old in instead.items() if any(one.name.startswith(new) for one in group)}
    return (*(one for one in chosen if one.name not in gone), *group)


def _told(
    parameters: Sequence[Parameter], information: Floats, noise: Floats, group: Sequence[Parameter]
) -> bool:
    if open_directions(parameters, information, noise):
        return False
    size = np.array([one.size for one in parameters])
    scaled = information * np.outer(size, size)
    if np.linalg.eigvalsh(scaled)[0] <= 1e-6:
        return False
    sigma = size * np.sqrt(np.diag(np.linalg.inv(scaled)))
    return all(
        sigma[k] < _USEFUL.get(one.name, _USEFUL_RATIO * one.size)
        for k, one in enumerate(parameters)
        if one in group
    )


def _about_drive(parameters: Sequence[Parameter], information: Floats) -> Floats:
    """Information about the drive's numbers in parts of their sizes, the sensors' being anything."""
    size = np.array([one.size for one in parameters])
    scaled = information * np.outer(size, size)
    drive = np.array([one.part == DRIVE for one in parameters], dtype=bool)
    if drive.all():
        return scaled
    rest = scaled[np.ix_(~drive, ~drive)] + 1e-9 * np.eye(int((~drive).sum()))
    mixed = scaled[np.ix_(drive, ~drive)]
    reduced: Floats = scaled[np.ix_(drive, drive)] - mixed @ np.linalg.solve(rest, mixed.T)
    return 0.5 * (reduced + reduced.T)


def why_open(names: Sequence[str], driven: Excitation) -> tuple[str, Cure]:
    """In words, why these cannot be told, and what to drive."""
    which = " and ".join(names) if len(names) < 3 else f"{', '.join(names[:-1])} and {names[-1]}"
    cannot = f"{which} cannot be told" + (" apart" if len(names) > 1 else "")
    if not driven.measured:
        way = "nothing says how far these logs went, and a robot of any size could have driven so"
        return f"{way}: {cannot}", Cure("drive 10 m straight on as well, and measure them", ahead=10.0)
    if driven.turned < 0.5 * max(driven.distance, 0.1):
        way = f"these logs hardly turn ({np.degrees(driven.turned):.0f} degrees over {driven.distance:.1f} m)"
        cure = Cure("turn as well, to the left and to the right by three whole turns each", left=3, right=3)
        return f"{way}: {cannot}", cure
    if driven.distance < 0.05 * driven.turned:
        way = f"these logs only turn on the spot ({driven.distance:.1f} m driven)"
        return f"{way}: {cannot}", Cure("drive 5 m straight on as well", ahead=5.0)
    if min(driven.left, driven.right) < 0.1 * driven.turned:
        way, left, right = ("left", 0, 3) if driven.left > driven.right else ("right", 3, 0)
        words = "drive three turns the other way round as well, and 3 m straight on"
        return f"these logs turn only one way, to the {way}: {cannot}", Cure(words, 3.0, left, right)
    return (
        f"in these logs {cannot}: what they change goes together",
        Cure(
            "drive 3 m straight on, three turns on the spot or as tightly as it can both ways, "
            "and curves of another radius",
            ahead=3.0,
            left=3,
            right=3,
        ),
    )
