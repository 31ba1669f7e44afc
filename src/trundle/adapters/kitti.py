"""KITTI trajectories: per line the upper three rows of a pose's matrix, twelve numbers, and no time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trundle.adapters.decimal_text import decimal_lines
from trundle.adapters.numeral import Real
from trundle.adapters.quaternion import continuous
from trundle.adapters.table import Wanted, open_table
from trundle.errors import InputError, LogSchema
from trundle.records import Trajectory
from trundle.robot.log_mapping import TableFormat

__all__ = ["read_kitti", "write_kitti"]

ROW_NS = 1_000_000_000


def write_kitti(trajectory: Trajectory, path: Path) -> None:
    """Write the poses, in their order; the format has no place for their times.

    Raises:
        InputError: If a pose is not finite: other readers of the format refuse it.
    """
    unknown = np.flatnonzero(~np.isfinite(trajectory.poses).all(axis=1))
    if unknown.size:
        pose = trajectory.poses[unknown[0]].tolist()
        raise InputError(f"pose {unknown[0]} is {pose}, must be finite in a .kitti file; .csv can hold it")
    x, y, theta = trajectory.poses.T
    c, s = np.cos(theta), np.sin(theta)
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(decimal_lines((c, " ", -s, " 0 ", x, " ", s, " ", c, " 0 ", y, " 0 0 1 0\n")))


def read_kitti(path: Path) -> Trajectory:
    """Read poses, which are not `timed`: row k is stamped k seconds.

    Raises:
        LogError: If the file cannot be read.
        LogSchema: If it has other than twelve columns, or a row is not whole: rows stand for times.
    """
    table = open_table(path, TableFormat(delimiter=" ", header=False))
    if len(table.names) != 12:
        problem = f"{len(table.names)} columns, must be the 12 of a KITTI trajectory"
        likely = "; 8 are a TUM trajectory's: name it .tum" if len(table.names) == 8 else ""
        raise LogSchema(path, "column", problem + likely)
    rows = table.read([Wanted(k, Real()) for k in (3, 7, 0, 4)])
    if rows.rejected:
        raise LogSchema(path, "parse", f"rows stand for times, so all must be whole: {rows.warnings[0]}")
    x, y, c, s = rows.columns
    heading = continuous(np.where(np.hypot(c, s) > 0.0, np.arctan2(s, c), np.nan))
    poses = np.stack([x, y, heading], axis=-1)
    if len(unknown := np.flatnonzero(~np.isfinite(poses).all(axis=1))):
        problem = f"rows stand for times, so all must be whole: row {unknown[0]} is no pose in the plane"
        raise LogSchema(path, "nonfinite", problem)
    return Trajectory(time_ns=np.arange(len(x)) * ROW_NS, poses=poses, timed=False)
