"""A robot's description with the numbers that a calibration found, as it is written down."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from trundle.adapters.robot_data import robot_from_data, robot_to_data
from trundle.apps.calibration_words import shown_unit
from trundle.apps.wording import digits
from trundle.robot import Noise, Robot
from trundle.robot.description import CalibrationRecord

if TYPE_CHECKING:
    from trundle.calibrate.calibration import Calibration, Estimate

__all__ = ["calibrated_robot", "margin_notes"]

# Where the parameters of sensors stand in robot.yaml; those of the wheels stand under their own names.
_PLACES = {
    "reference.x": "log.reference.mounting[0]",
    "reference.y": "log.reference.mounting[1]",
    "reference.theta": "log.reference.mounting[2]",
    "clock": "log.reference.delay",
    "gyro.bias": "log.gyro.offset",
    "gyro.scale": "log.gyro.gain",
}
GUARD_DIGITS = 2
"""Decimals that are kept beyond the first of a standard deviation."""


def calibrated_robot(calibration: Calibration) -> Robot:
    """The robot as it is written: numbers rounded to a hundredth of their sigma, sigmas noted.

    How far the radii and the distances between wheels may still be off becomes its noise: what they were
    described by before is no longer true of them.
    """
    robot = calibration.robot
    data = robot_to_data(robot)
    for one in calibration.estimates:
        for path in _places(robot, one.name):
            _round(data, _steps(path), one.sigma)
    rounded = robot_from_data(data)
    sigmas = {one.name: float(f"{one.sigma:.3g}") for one in calibration.estimates if one.sigma > 0.0}
    return rounded.replace(
        noise=_noise(robot, calibration.estimates),
        calibration=CalibrationRecord(robot=robot.name, sigmas=sigmas),
    )


def margin_notes(calibration: Calibration) -> dict[str, str]:
    """Comments by the path of the value that they belong to."""
    return {
        path: f"±{digits(one.sigma / factor, 2)} {unit}".rstrip()
        for one in calibration.estimates
        for unit, factor in [shown_unit(one.unit)]
        for path in _places(calibration.robot, one.name)
    }


def _places(robot: Robot, name: str) -> tuple[str, ...]:
    """Paths of a parameter in robot.yaml; none where what stands there is more than one number."""
    if name in _PLACES:
        return (_PLACES[name],)
    if name.startswith("steering."):
        return (f"log.{name}",)
    base = "drive" if robot.localizer is None else "localizer"
    names = {"lx + ly": ("track_width", "wheelbase"), "wheel_distance": ()}.get(name, (name,))
    return tuple(f"{base}.{one}" for one in names)


def _steps(path: str) -> list[str | int]:
    """`a.b[0]` as ["a", "b", 0]."""
    return [int(word) if word.isdecimal() else word for word in re.findall(r"[^.\[\]]+", path)]


def _round(data: Any, steps: list[str | int], sigma: float) -> None:
    """Round the number at a place, if one stands there."""
    for step in steps[:-1]:
        data = _inside(data, step)
    value, last = _inside(data, steps[-1]), steps[-1]
    if isinstance(value, float) and 0.0 < sigma < math.inf:
        data[last] = round(value, GUARD_DIGITS - math.floor(math.log10(sigma)))


def _inside(data: Any, step: str | int) -> Any:
    """What stands in a mapping or list there; None where nothing does."""
    if isinstance(data, dict):
        return data.get(step)
    return data[step] if isinstance(data, list) and isinstance(step, int) and step < len(data) else None


def _noise(robot: Robot, estimates: Iterable[Estimate]) -> Noise:
    """What the wheels' numbers may still be off by, as a fraction of them."""
    known = list(estimates)
    changes = {}
    for field, family in (("wheel_radius", _radii), ("track_width", _distances)):
        if shares := list(family(known)):
            changes[field] = float(f"{max(shares):.2g}")
    old = robot.noise
    return Noise(**{**{field: getattr(old, field) for field in old.__struct_fields__}, **changes})


def _radii(estimates: Iterable[Estimate]) -> Iterator[float]:
    return (one.sigma / abs(one.value) for one in estimates if one.name.startswith("wheel_radius"))


def _distances(estimates: Iterable[Estimate]) -> Iterator[float]:
    names = ("track_width", "wheelbase", "robot_radius", "lx + ly", "wheel_distance")
    return (one.sigma / abs(one.value) for one in estimates if one.name in names)
