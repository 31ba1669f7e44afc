"""Trajectories as tables, CSV, JSON lines and Parquet: poses, and twists and covariances where there are any.

Columns: `time_ns`, `x`, `y`, `theta`; `vx`, `vy`, `omega`; the upper triangle of the covariance
`covariance.xx`, `.xy`, `.xtheta`, `.yy`, `.ytheta`, `.thetatheta`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.adapters.arrow_column import arrow_column
from trundle.adapters.decimal_text import Part, decimal_lines, separated
from trundle.adapters.default_columns import default_time
from trundle.adapters.numeral import Real, Stamp
from trundle.adapters.table import Wanted, open_table
from trundle.errors import InputError, MissingExtra
from trundle.records import Trajectory

__all__ = [
    "csv_lines",
    "read_trajectory_table",
    "write_trajectory_csv",
    "write_trajectory_json",
    "write_trajectory_parquet",
]

_POSE = ("x", "y", "theta")
_TWIST = ("vx", "vy", "omega")
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_COVARIANCE = tuple(f"covariance.{_POSE[i]}{_POSE[j]}" for i, j in _UPPER)


def write_trajectory_csv(trajectory: Trajectory, path: Path) -> None:
    """Write CSV with a header. Numbers have what it takes to read back the same."""
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(csv_lines(trajectory))


def csv_lines(trajectory: Trajectory, *, header: bool = True) -> Iterator[str]:
    """The lines of a CSV file; those of a later piece have no header."""
    columns = _columns(trajectory)
    if header:
        yield ",".join(columns) + "\n"
    yield from decimal_lines(separated(list(columns.values()), ","))


def write_trajectory_json(trajectory: Trajectory, path: Path) -> None:
    """Write one JSON object per line. Numbers have what it takes to read back the same.

    Raises:
        InputError: If a number is not finite: JSON has no word for it.
    """
    columns = _columns(trajectory)
    for name, column in columns.items():
        unknown = np.flatnonzero(~np.isfinite(column))
        if unknown.size:
            value = column[unknown[0]]
            raise InputError(
                f"{name} {unknown[0]} is {value}, must be finite in a .jsonl file; .csv can hold it"
            )
    members: list[Part] = []
    for name, column in columns.items():
        members += [f"{', ' if members else '{'}{json.dumps(name)}: ", column]
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.writelines(decimal_lines([*members, "}\n"]))


def write_trajectory_parquet(trajectory: Trajectory, path: Path) -> None:
    """Write Parquet.

    Raises:
        MissingExtra: If pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise MissingExtra("pyarrow", "parquet") from None
    with path.open("wb") as file:
        table = pa.table({name: arrow_column(column) for name, column in _columns(trajectory).items()})
        parquet.write_table(table, file, write_page_checksum=True)


def read_trajectory_table(path: Path) -> Trajectory:
    """Read CSV, JSON lines or Parquet with these columns; `time` in seconds may stand in for `time_ns`.

    Raises:
        LogSchema: If a column is missing; twists and covariances may be, each as a whole. Without
            `theta` headings are NaN.
        LogError: If the file cannot be read.
    """
    table = open_table(path)
    time = default_time(table.names)
    pose = _POSE if "theta" in table.names else _POSE[:2]
    twist = _TWIST if set(_TWIST) & set(table.names) else ()
    covariance = _COVARIANCE if set(_COVARIANCE) & set(table.names) else ()
    names = (*pose, *twist, *covariance)
    rows = table.read([Wanted(time.column, Stamp(time.unit)), *(Wanted(name, Real()) for name in names)])
    columns = dict(zip(names, rows.columns[1:], strict=True))
    columns.setdefault("theta", np.full(len(rows.columns[0]), np.nan))
    return Trajectory(
        time_ns=rows.columns[0],
        poses=_block(columns, _POSE),
        twists=_block(columns, _TWIST) if twist else None,
        covariances=_symmetric(_block(columns, _COVARIANCE)) if covariance else None,
        rejected=rows.rejected,
    )


def _columns(trajectory: Trajectory) -> dict[str, npt.NDArray[Any]]:
    columns: dict[str, npt.NDArray[Any]] = {"time_ns": trajectory.time_ns}
    columns |= zip(_POSE, trajectory.poses.T, strict=True)
    if trajectory.twists is not None:
        columns |= zip(_TWIST, trajectory.twists.T, strict=True)
    if trajectory.covariances is not None:
        for name, (i, j) in zip(_COVARIANCE, _UPPER, strict=True):
            columns[name] = trajectory.covariances[:, i, j]
    return columns


def _block(columns: Mapping[str, npt.NDArray[Any]], names: Sequence[str]) -> npt.NDArray[np.float64]:
    return np.stack([columns[name] for name in names], axis=-1)


def _symmetric(upper: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    matrices = np.empty((len(upper), 3, 3))
    for column, (i, j) in zip(upper.T, _UPPER, strict=True):
        matrices[:, i, j] = matrices[:, j, i] = column
    return matrices
