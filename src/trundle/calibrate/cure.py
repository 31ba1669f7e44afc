"""What to drive to know what a log could not tell, as a run that can be imagined beforehand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trundle.calibrate.fixes import Fixes
from trundle.errors import Infeasible, Unobservable
from trundle.geometry import Twist2D
from trundle.records import WheelLog
from trundle.robot import Robot
from trundle.simulate import Course, Manoeuvre, arc, simulate, spin, straight

__all__ = ["Cure", "imagined", "seen_like"]

_RATE, _SPEED, _YAW_RATE = 20.0, 0.4, 1.0  # rows per second, m/s, rad/s
_LEAST = 0.05  # seconds from one fix to the next
_TIGHT = 3.0
"""Radius of turns of what cannot turn on the spot, in parts of its longest distance between wheels."""


@dataclass(frozen=True, slots=True)
class Cure:
    """A manoeuvre.

    Attributes:
        words: For people.
        ahead: Straight on [m].
        left: Whole turns to the left, as tightly as it can.
        right: To the right.
    """

    words: str
    ahead: float = 0.0
    left: int = 0
    right: int = 0


def imagined(robot: Robot, cure: Cure) -> WheelLog:
    """What the robot's sensors would say, and where it would be.

    Raises:
        TrundleError: If the robot cannot be simulated.
    """
    parts: list[Manoeuvre] = [straight(cure.ahead, _SPEED)] if cure.ahead else []
    for turns, way in ((cure.left, 1.0), (cure.right, -1.0)):
        if turns:
            parts.append(_turn(robot, way * turns * math.tau))
    return simulate(robot, Course.of(*parts), rate=_RATE)


def seen_like(fixes: Fixes, log: WheelLog) -> Fixes:
    """An imagined run as the reference of another would see it: as often, and as much of the pose."""
    truth = log.reference
    assert truth is not None  # it is simulated
    moments = 1e-9 * (truth.time_ns - log.time_ns[0])
    if fixes.sigma is not None:  # a tape measure
        ends = [0, len(moments) - 1]
        return Fixes(
            moments=moments[ends], poses=truth.poses[ends], sigma=fixes.sigma, whole_turns=True, mounted=False
        )
    every = max(float(np.median(np.diff(fixes.moments))), _LEAST)
    rows = np.unique(np.searchsorted(moments, np.arange(0.0, moments[-1], every)))
    poses = np.where(np.isfinite(fixes.poses).any(axis=0), truth.poses[rows], np.nan)
    return Fixes(
        moments=moments[rows],
        poses=poses,
        whole_turns=fixes.whole_turns,
        mounted=fixes.mounted,
        offset=fixes.offset,
    )


def _turn(robot: Robot, angle: float) -> Manoeuvre:
    drive = robot.measuring
    try:
        drive.forward(drive.inverse(Twist2D(0.0, 0.0, _YAW_RATE)))
    except (Infeasible, Unobservable):  # cars; or a wheel that would be steered by 90 degrees
        places = np.array([(wheel.x, wheel.y) for wheel in drive.wheels])
        widest = float(np.hypot(*np.ptp(places, axis=0)))
        return arc(_TIGHT * widest, angle, _SPEED)
    return spin(angle, _YAW_RATE)
