"""EuRoC trajectories: `time [ns], x, y, z, qw, qx, qy, qz` and more per line; comments begin with `#`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from trundle.adapters.decimal_text import decimal_lines
from trundle.adapters.numeral import Real, Stamp
from trundle.adapters.quaternion import quaternion_of_yaw, whole_poses, yaw_of_quaternion
from trundle.adapters.table import Wanted, open_table
from trundle.errors import InputError, LogSchema
from trundle.records import Trajectory
from trundle.robot.log_mapping import TableFormat, Unit

__all__ = ["is_euroc", "read_euroc", "write_euroc"]

_HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"


def is_euroc(beginning: bytes) -> bool:
    """Whether a file that begins so is one: with its header, which is a comment."""
    return beginning[:1] == b"#" and beginning[1:].lstrip().startswith(b"timestamp")


def write_euroc(trajectory: Trajectory, path: Path) -> None:
    """Write the poses. Numbers have what it takes to read back the same.

    Raises:
        InputError: If a pose is not finite: a quaternion cannot say "unknown".
    """
    unknown = np.flatnonzero(~np.isfinite(trajectory.poses).all(axis=1))
    if unknown.size:
        pose = trajectory.poses[unknown[0]].tolist()
        raise InputError(f"pose {unknown[0]} is {pose}, must be finite in a .euroc file; .csv can hold it")
    z, w = quaternion_of_yaw(trajectory.poses[:, 2])
    x, y, _ = trajectory.poses.T
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write(_HEADER)
        file.writelines(decimal_lines((trajectory.time_ns, ",", x, ",", y, ",0,", w, ",0,0,", z, "\n")))


def read_euroc(path: Path) -> Trajectory:
    """Read poses; headings are continuous, from (-pi, pi] on.

    Raises:
        LogError: If the file cannot be read.
        LogSchema: If it has fewer than eight columns, or no row holds a pose.
    """
    table = open_table(path, TableFormat(header=False))
    if len(table.names) < 8:
        raise LogSchema(
            path, "column", f"{len(table.names)} columns, must be at least the 8 of a EuRoC trajectory"
        )
    rows = table.read([Wanted(0, Stamp(Unit.NS)), *(Wanted(k, Real()) for k in (1, 2, 5, 6, 7, 4))])
    time_ns, x, y, *quaternion = rows.columns
    poses = np.stack([x, y, yaw_of_quaternion(*quaternion)], axis=-1)
    return whole_poses(path, Trajectory(time_ns=time_ns, poses=poses, rejected=rows.rejected))
