"""Trajectories to files and back, by suffix."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from trundle.adapters.atomic import atomic_path
from trundle.adapters.content import beginning_of
from trundle.adapters.stamp_order import poses_in_order
from trundle.adapters.trajectory_format import TRAJECTORY_FORMATS
from trundle.errors import InputError, LogError, require_path, require_type
from trundle.records import Trajectory

__all__ = ["TRAJECTORY_SUFFIXES", "read_trajectory", "write_trajectory"]


def write_trajectory(trajectory: Trajectory, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a trajectory, in one of `TRAJECTORY_FORMATS`.

    At any moment there is the old file or the complete new one.

    Args:
        trajectory: What is written.
        path: Where to; its suffix chooses the format.
        force: Replace a file that exists.

    Raises:
        InputError: If the suffix is not known, or the format cannot hold this trajectory.
        OutputError: If the file exists, or cannot be written.
        MissingExtra: If the format needs a package that is not installed.
    """
    require_type("write_trajectory", "trajectory", trajectory, Trajectory)
    path = require_path(path)
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise InputError(
            f"{path}: no trajectory format has the suffix {suffix!r}; known: {', '.join(TRAJECTORY_SUFFIXES)}"
        )
    with atomic_path(path, force=force) as temporary:
        _WRITERS[suffix](trajectory, temporary)


def read_trajectory(path: str | os.PathLike[str], *, body: str | None = None) -> Trajectory:
    """Read what `write_trajectory` writes: the same stamps and the same numbers.

    Where a file holds rotations (`.tum`, `.kitti`, `.euroc`, `.mcap`, Motive's), headings begin in (-pi, pi]
    and follow the path; turns before its first row are not known. What a `.kitti` file holds is not `timed`.
    A `.csv` may also be EuRoC's, or a take of OptiTrack's Motive with one rigid body. Rows that cannot be
    read, that hold no pose or that repeat a stamp are counted in `rejected`; rows up to a second late are put
    in order.

    Args:
        path: Its suffix says the format.
        body: Of a take with several rigid bodies, the one that is meant.

    Raises:
        LogError: If the file cannot be read, the suffix is not known (`format`), or its stamps go back by
            more than a second (`unsorted`).
        LogSchema: If it lacks a column.
        MissingExtra: If the format needs a package that is not installed.
    """
    path = require_path(path)
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        known = ", ".join(TRAJECTORY_SUFFIXES)
        raise LogError(path, "format", f"no trajectory format has the suffix {suffix!r}; known: {known}")
    if body is not None:
        from trundle.adapters.motive import read_motive

        found = read_motive(path, body)
    else:
        found = _READERS[suffix](path)
    return poses_in_order(path, found)


def _write_tum(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.tum import write_tum

    write_tum(trajectory, path)


def _write_csv(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.trajectory_table import write_trajectory_csv

    write_trajectory_csv(trajectory, path)


def _write_json(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.trajectory_table import write_trajectory_json

    write_trajectory_json(trajectory, path)


def _write_parquet(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.trajectory_table import write_trajectory_parquet

    write_trajectory_parquet(trajectory, path)


def _write_kitti(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.kitti import write_kitti

    write_kitti(trajectory, path)


def _write_euroc(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.euroc import write_euroc

    write_euroc(trajectory, path)


def _write_mcap(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.mcap_trajectory import write_mcap

    write_mcap(trajectory, path)


def _write_wpilog(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.wpilog_trajectory import write_wpilog

    write_wpilog(trajectory, path)


def _read_tum(path: Path) -> Trajectory:
    from trundle.adapters.tum import read_tum

    return read_tum(path)


def _read_table(path: Path) -> Trajectory:
    from trundle.adapters.trajectory_table import read_trajectory_table

    return read_trajectory_table(path)


def _read_csv(path: Path) -> Trajectory:
    """Trundle's own columns, or what begins as EuRoC's or Motive's files do."""
    from trundle.adapters import euroc, motive

    beginning = beginning_of(path)
    if euroc.is_euroc(beginning):
        return euroc.read_euroc(path)
    return motive.read_motive(path) if motive.is_motive(beginning) else _read_table(path)


def _read_kitti(path: Path) -> Trajectory:
    from trundle.adapters.kitti import read_kitti

    return read_kitti(path)


def _read_euroc(path: Path) -> Trajectory:
    from trundle.adapters.euroc import read_euroc

    return read_euroc(path)


def _read_mcap(path: Path) -> Trajectory:
    from trundle.adapters.mcap_trajectory import read_mcap_trajectory

    return read_mcap_trajectory(path)


def _read_wpilog(path: Path) -> Trajectory:
    from trundle.adapters.wpilog_trajectory import read_wpilog_trajectory

    return read_wpilog_trajectory(path)


# Nothing is loaded until it is used.
_WRITERS: dict[str, Callable[[Trajectory, Path], None]] = {
    ".tum": _write_tum,
    ".kitti": _write_kitti,
    ".euroc": _write_euroc,
    ".csv": _write_csv,
    ".jsonl": _write_json,
    ".parquet": _write_parquet,
    ".mcap": _write_mcap,
    ".wpilog": _write_wpilog,
}
_READERS: dict[str, Callable[[Path], Trajectory]] = {
    ".tum": _read_tum,
    ".kitti": _read_kitti,
    ".euroc": _read_euroc,
    ".csv": _read_csv,
    ".jsonl": _read_table,
    ".parquet": _read_table,
    ".mcap": _read_mcap,
    ".wpilog": _read_wpilog,
}

TRAJECTORY_SUFFIXES = tuple(form.suffix for form in TRAJECTORY_FORMATS)
"""What a file name may end in to be written, and to be read."""
