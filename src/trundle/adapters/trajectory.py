"""Trajectories to files and back, by suffix."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from trundle.adapters.atomic import atomic_path
from trundle.errors import InputError, LogError
from trundle.records import Trajectory

__all__ = ["TRAJECTORY_SUFFIXES", "read_trajectory", "write_trajectory"]


def write_trajectory(trajectory: Trajectory, path: str | os.PathLike[str], *, force: bool = False) -> None:
    """Write a trajectory: `.tum` (poses), `.csv` or `.parquet` (poses, twists, covariances).

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
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise InputError(
            f"{path}: no trajectory format has the suffix {suffix!r}; known: {', '.join(_WRITERS)}"
        )
    with atomic_path(path, force=force) as temporary:
        _WRITERS[suffix](trajectory, temporary)


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Read what `write_trajectory` writes: the same stamps and the same numbers.

    A `.tum` file holds no more than poses, headings in (-pi, pi]. Rows that cannot be read are counted
    in `rejected`.

    Args:
        path: Its suffix says the format.

    Raises:
        LogError: If the file cannot be read, or the suffix is not known (`format`).
        LogSchema: If it lacks a column.
        MissingExtra: If the format needs a package that is not installed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        known = ", ".join(_READERS)
        raise LogError(path, "format", f"no trajectory format has the suffix {suffix!r}; known: {known}")
    return _READERS[suffix](path)


def _write_tum(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.tum import write_tum

    write_tum(trajectory, path)


def _write_csv(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.trajectory_table import write_trajectory_csv

    write_trajectory_csv(trajectory, path)


def _write_parquet(trajectory: Trajectory, path: Path) -> None:
    from trundle.adapters.trajectory_table import write_trajectory_parquet

    write_trajectory_parquet(trajectory, path)


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


def _read_mcap(path: Path) -> Trajectory:
    from trundle.adapters.mcap_trajectory import read_mcap_trajectory

    return read_mcap_trajectory(path)


def _read_wpilog(path: Path) -> Trajectory:
    from trundle.adapters.wpilog_trajectory import read_wpilog_trajectory

    return read_wpilog_trajectory(path)


# A format to come is a line in each; nothing is loaded until it is used.
_WRITERS: dict[str, Callable[[Trajectory, Path], None]] = {
    ".tum": _write_tum,
    ".csv": _write_csv,
    ".parquet": _write_parquet,
    ".mcap": _write_mcap,
    ".wpilog": _write_wpilog,
}
_READERS: dict[str, Callable[[Path], Trajectory]] = {
    ".tum": _read_tum,
    ".csv": _read_table,
    ".parquet": _read_table,
    ".mcap": _read_mcap,
    ".wpilog": _read_wpilog,
}

TRAJECTORY_SUFFIXES = tuple(_WRITERS)
"""What a file name may end in to be written."""
