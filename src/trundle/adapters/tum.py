"""TUM trajectories: `time x y z qx qy qz qw` per line, in seconds and metres, separated by blanks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trundle.adapters.decimal_text import Seconds, decimal_lines
from trundle.adapters.numeral import Real, Stamp
from trundle.adapters.quaternion import quaternion_of_yaw, whole_poses, yaw_of_quaternion
from trundle.adapters.table import Wanted, open_table
from trundle.errors import InputError, LogSchema
from trundle.records import Trajectory
from trundle.robot.log_mapping import TableFormat

__all__ = ["read_tum", "tum_lines", "write_tum"]


def write_tum(trajectory: Trajectory, path: Path) -> None:
    """Write the poses.

    Raises:
        InputError: If a pose is not finite.
    """
    lines = tum_lines(trajectory)
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(lines)


def tum_lines(trajectory: Trajectory) -> Iterator[str]:
    """The poses, some lines at a time. Stamps have nine decimals, numbers what reads back the same.

    Raises:
        InputError: If a pose is not finite: a quaternion cannot say "unknown".
    """
    unknown = np.flatnonzero(~np.isfinite(trajectory.poses).all(axis=1))
    if unknown.size:
        pose = trajectory.poses[unknown[0]].tolist()
        raise InputError(f"pose {unknown[0]} is {pose}, must be finite in a .tum file; .csv can hold it")
    z, w = quaternion_of_yaw(trajectory.poses[:, 2])
    x, y, _ = trajectory.poses.T
    yield from decimal_lines((Seconds(trajectory.time_ns), " ", x, " ", y, " 0 0 0 ", z, " ", w, "\n"))


def read_tum(path: Path) -> Trajectory:
    """Read poses; headings are continuous, from (-pi, pi] on.

    Raises:
        LogError: If the file cannot be read.
        LogSchema: If it has other than eight columns, or no row holds a pose.
    """
    table = open_table(path, TableFormat(delimiter=" ", header=False))
    if len(table.names) != 8:
        problem = f"rows of {len(table.names)}, must be the 8 columns of a TUM trajectory, divided by blanks"
        likely = "; 12 are a KITTI trajectory's: name it .kitti" if len(table.names) == 12 else ""
        raise LogSchema(path, "column", problem + likely)
    columns = [Wanted(0, Stamp()), *(Wanted(k, Real()) for k in (1, 2, 4, 5, 6, 7))]
    rows = table.read(columns)
    time_ns, x, y, *quaternion = rows.columns
    poses = np.stack([x, y, yaw_of_quaternion(*quaternion)], axis=-1)
    return whole_poses(path, Trajectory(time_ns=time_ns, poses=poses, rejected=rows.rejected))
