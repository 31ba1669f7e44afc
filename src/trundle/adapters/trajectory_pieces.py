"""Trajectories that come in pieces, written as they come."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from trundle.adapters.atomic import atomic_path
from trundle.adapters.trajectory_table import csv_lines
from trundle.adapters.tum import tum_lines
from trundle.errors import InputError
from trundle.records import Trajectory

__all__ = ["SUFFIXES_IN_PIECES", "write_trajectory_pieces"]

SUFFIXES_IN_PIECES = (".tum", ".csv")
"""Formats whose files are written from beginning to end."""


def write_trajectory_pieces(
    pieces: Iterable[Trajectory], path: str | os.PathLike[str], *, force: bool = False
) -> None:
    """Write what `write_trajectory` would write of the pieces put together, in memory for one of them.

    Args:
        pieces: Parts of one trajectory, in order.
        path: Where to; its suffix chooses the format, one of `SUFFIXES_IN_PIECES`.
        force: Replace a file that exists.

    Raises:
        InputError: If the suffix is another one, or the format cannot hold this trajectory.
        OutputError: If the file exists, or cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES_IN_PIECES:
        allowed = ", ".join(SUFFIXES_IN_PIECES)
        raise InputError(f"{path}: cannot be written in pieces; these formats can: {allowed}")
    with (
        atomic_path(path, force=force) as temporary,
        temporary.open("w", encoding="ascii", newline="\n") as file,
    ):
        for number, piece in enumerate(pieces):
            file.writelines(_lines(piece, suffix, is_first=not number))


def _lines(piece: Trajectory, suffix: str, *, is_first: bool) -> Iterator[str]:
    return tum_lines(piece) if suffix == ".tum" else csv_lines(piece, header=is_first)
