"""Formats of trajectory files: what a name ends in, and what such a file holds."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["TRAJECTORY_FORMATS", "TrajectoryFormat", "holdings"]


class TrajectoryFormat(NamedTuple):
    """One format.

    Attributes:
        suffix: What the name of such a file ends in.
        holds: What of a trajectory it can hold.
    """

    suffix: str
    holds: str


_ALL = "poses, twists, covariances"

TRAJECTORY_FORMATS = (
    TrajectoryFormat(".tum", "poses"),
    TrajectoryFormat(".csv", _ALL),
    TrajectoryFormat(".parquet", _ALL),
    TrajectoryFormat(".jsonl", _ALL),
    TrajectoryFormat(".kitti", "poses without times"),
    TrajectoryFormat(".euroc", "poses"),
    TrajectoryFormat(".mcap", _ALL),
    TrajectoryFormat(".wpilog", _ALL),
)


def holdings() -> str:
    """The suffixes by what they hold, as a sentence has room for them."""
    kinds = dict.fromkeys(form.holds for form in TRAJECTORY_FORMATS)
    suffixes = {kind: [form.suffix for form in TRAJECTORY_FORMATS if form.holds == kind] for kind in kinds}
    return "; ".join(f"{', '.join(found)} ({kind})" for kind, found in suffixes.items())
