"""Headings as rotations, mostly unit quaternions (x, y, z, w), the way messages and files write them."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import LogSchema
from trundle.records import Trajectory

__all__ = ["continuous", "quaternion_of_yaw", "whole_poses", "yaw_of_quaternion"]

Floats = npt.NDArray[np.float64]


def quaternion_of_yaw(yaw: Floats) -> tuple[Floats, Floats]:
    """z and w of the quaternion of a heading [rad]; its x and y are zero."""
    return np.sin(0.5 * yaw), np.cos(0.5 * yaw)


def yaw_of_quaternion(x: Any, y: Any, z: Any, w: Any) -> Floats:
    """Headings [rad] of the rotated x axis, `continuous`; NaN of the zero quaternion, which is no rotation.

    The quaternion's length does not matter.

    Args:
        x: Of the quaternions of a path, in its order, shape (N,); so are the others.
        y: See `x`.
        z: See `x`.
        w: See `x`.
    """
    x, y, z, w = (np.asarray(part, dtype=np.float64) for part in (x, y, z, w))
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.hypot(np.hypot(x, y), np.hypot(z, w))
        safe = np.where(length > 0.0, length, np.nan)
        x, y, z, w = x / safe, y / safe, z / safe, w / safe
    return continuous(np.arctan2(2.0 * (w * z + x * y), (w * w - z * z) + (x * x - y * y)))


def continuous(heading: Floats) -> Floats:
    """Headings [rad] in (-pi, pi] along a path, with the turns that it made: each step is the shorter way.

    What turns there were before the first row a rotation does not say. NaN stays, and does not matter.
    """
    known = np.isfinite(heading)
    turns = np.rint(np.diff(heading[known], prepend=heading[known][:1]) / math.tau)
    followed = heading.copy()
    followed[known] -= math.tau * np.cumsum(turns)
    return followed


def whole_poses(source: object, trajectory: Trajectory) -> Trajectory:
    """The rows of a file that hold a position and a rotation; the others are counted as `nonfinite`.

    Raises:
        LogSchema: If no row does.
    """
    whole: npt.NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(trajectory.poses), axis=1)
    if whole.all():
        return trajectory
    if not whole.any():
        needed = "positions and rotations must be finite, and rotations not zero"
        raise LogSchema(source, "nonfinite", f"no row of {len(whole)} holds a pose: {needed}")
    refused = Counter(trajectory.rejected) + Counter(nonfinite=int((~whole).sum()))
    return dataclasses.replace(trajectory.take(whole), rejected=refused)
