"""OptiTrack Motive: exported takes (CSV), whose y axis points up.

Seven rows of header: what the take is, then per column the kind of thing, its name, its identifier, rotation
or position, and the axis. Where a body was not seen, its cells are empty.
"""

from __future__ import annotations

import codecs
import csv
import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.content import Content, content_of
from trundle.adapters.numeral import Numeral, Real, Stamp, plain
from trundle.adapters.quaternion import continuous
from trundle.errors import LogError, LogLimit, LogSchema, did_you_mean
from trundle.records import Trajectory

__all__ = ["is_motive", "read_motive"]

LONGEST_LINE = 1 << 20
LONGEST_HEADER = 20  # rows

_METRES = {"meters": 1.0, "centimeters": 1e-2, "millimeters": 1e-3}
_AXES = {"quaternion": ("X", "Y", "Z", "W"), "xyz": ("X", "Y", "Z")}

Floats = npt.NDArray[np.float64]
Cells = list[bytes]


class _Take(NamedTuple):
    """What the header says."""

    scale: float
    width: int
    time: int
    rotation: tuple[int, ...]
    position: tuple[int, int]  # of x and z, which span the floor


def is_motive(beginning: bytes) -> bool:
    """Whether a file that begins so is a take."""
    return beginning.startswith(b"Format Version")


def read_motive(path: Path, body: str | None = None) -> Trajectory:
    """The poses of a rigid body on the floor: x as in the take, y its -z, heading about its y axis.

    Args:
        path: The take.
        body: Name of the rigid body; may be left out where there is one only.

    Returns:
        Poses in `map`, stamped from the beginning of the take; rows in which the body was not seen are
        counted as `untracked`.

    Raises:
        LogSchema: If there is no such body, or its rotation or length is in another form than known.
        LogError: If the file cannot be read.
    """
    if content_of(path) is not Content.TEXT:
        raise LogError(path, "format", "is no text, must be a take that Motive exported as CSV")
    with path.open("rb") as file:
        texts = (file.readline(LONGEST_LINE + 1) for _ in itertools.count())
        lines = _lines(path, _without_mark(texts))
        take = _header(path, lines, body)
        rejected: Counter[str] = Counter()
        rows = list(_tracked(take, lines, rejected))
    wanted = (take.time, *take.position, *take.rotation)
    numerals: list[Numeral] = [Stamp(), *([Real()] * (len(wanted) - 1))]
    try:
        columns = _columns(wanted, numerals, rows)
    except ValueError:
        whole = [row for row in rows if _is_whole(wanted, numerals, row)]
        rejected["parse"] += len(rows) - len(whole)
        columns = _columns(wanted, numerals, whole)
    time_ns, x, z, *rotation = columns
    if not len(time_ns):
        raise LogError(path, "empty", f"holds no row in which the body was seen ({dict(rejected)})")
    y, heading = -z.astype(np.float64), _heading(*rotation)
    return Trajectory(
        time_ns=time_ns.astype(np.int64),
        poses=np.stack([x * take.scale, y * take.scale, heading], axis=-1),
        frame="map",
        rejected=rejected,
    )


# ------------------------------------------------------------------------------------ header


def _header(path: Path, lines: Iterator[Cells], body: str | None) -> _Take:
    head = [[_word(cell) for cell in row] for row in itertools.islice(_until_frame(lines), LONGEST_HEADER)]
    if not head or head[-1][:1] != ["Frame"] or len(head) < 4:
        raise LogSchema(path, "header", "no row begins with 'Frame' after that of the names: no Motive take")
    said = dict(zip(head[0][::2], head[0][1::2], strict=False))
    unit = said.get("Length Units", "Meters").lower()
    form = said.get("Rotation Type", "Quaternion").lower()
    for what, word, known in (("Length Units", unit, _METRES), ("Rotation Type", form, _AXES)):
        if word not in known:
            raise LogSchema(path, "unit", f"{what} is {said[what]!r}, must be one of {', '.join(known)}")
    axes, quantities = head[-1], head[-2]
    width = len(axes)
    types, names = (_row(path, head, word, width) for word in ("Type", "Name"))
    bodies = {name: None for kind, name in zip(types, names, strict=True) if kind == "Rigid Body"}
    if body is None and len(bodies) == 1:
        body = next(iter(bodies))
    if body not in bodies:
        which = (
            "choose one: --body, or log.reference.topic"
            if body is None
            else f"no {body!r}, {did_you_mean(body, bodies)}"
        )
        raise LogSchema(path, "body", f"its rigid bodies are {', '.join(bodies) or 'none'}; {which}")
    quantities = [*quantities, *[""] * (width - len(quantities))]

    def place(quantity: str, axis: str) -> int:
        wanted = ("Rigid Body", body, quantity, axis)
        for column, found in enumerate(zip(types, names, quantities, axes, strict=False)):
            if found == wanted:
                return column
        raise LogSchema(path, "column", f"no column is the {quantity} {axis} of {body!r}")

    time = next((k for k, word in enumerate(axes) if word.startswith("Time")), None)
    if time is None:
        raise LogSchema(path, "column", f"no column is the time; there are {', '.join(axes[:10])}")
    rotation = tuple(place("Rotation", axis) for axis in _AXES[form])
    return _Take(_METRES[unit], width, time, rotation, (place("Position", "X"), place("Position", "Z")))


def _until_frame(lines: Iterator[Cells]) -> Iterator[Cells]:
    for row in lines:
        yield row
        if row[:1] == [b"Frame"]:
            return


def _row(path: Path, head: Sequence[list[str]], word: str, width: int) -> list[str]:
    """The header's row that is about this, as wide as the table."""
    for row in head:
        if word in row[:2]:
            return [*row, *[""] * (width - len(row))][:width]
    raise LogSchema(path, "header", f"no row of its header says the {word} of each column")


def _word(cell: bytes) -> str:
    return cell.decode(errors="backslashreplace").strip()


# -------------------------------------------------------------------------------------- rows


def _lines(path: Path, texts: Iterator[bytes]) -> Iterator[Cells]:
    """The cells of each line that holds any."""
    for number, text in enumerate(texts, 1):
        if not text:
            return
        if len(text) > LONGEST_LINE:
            raise LogLimit(path, "line", f"line {number} is longer than {LONGEST_LINE} bytes: no Motive take")
        if text.isspace():
            continue
        if b'"' not in text:
            yield text.rstrip(b"\r\n").split(b",")
            continue
        try:
            (cells,) = csv.reader([text.decode("latin-1").rstrip("\r\n")], strict=True)
        except (csv.Error, ValueError):
            cells = []
        yield [cell.encode("latin-1") for cell in cells]


def _without_mark(texts: Iterator[bytes]) -> Iterator[bytes]:
    """The lines, without a byte order mark of UTF-8 before the first."""
    yield next(texts, b"").removeprefix(codecs.BOM_UTF8)
    yield from texts


def _tracked(take: _Take, lines: Iterator[Cells], rejected: Counter[str]) -> Iterator[Cells]:
    """The rows in which the body was seen."""
    needed = (*take.rotation, *take.position)
    for cells in lines:
        if not take.width - 1 <= len(cells) <= take.width + 1 or max(needed) >= len(cells):
            rejected["parse"] += 1  # a comma at the end may be there or not
        elif not all(cells[k].strip() for k in needed):
            rejected["untracked"] += 1
        else:
            yield cells


def _columns(
    wanted: Sequence[int], numerals: Sequence[Numeral], rows: Sequence[Cells]
) -> list[npt.NDArray[np.float64] | npt.NDArray[np.int64]]:
    return [
        numeral.of_text(plain([row[k] for row in rows])) for k, numeral in zip(wanted, numerals, strict=True)
    ]


def _is_whole(wanted: Sequence[int], numerals: Sequence[Numeral], row: Cells) -> bool:
    try:
        _columns(wanted, numerals, [row])
    except ValueError:
        return False
    return True


def _heading(*rotation: npt.NDArray[np.generic]) -> Floats:
    """Direction of the rotated x axis on the floor, seen from above and `continuous`; the floor's y is -z.

    Args:
        rotation: A quaternion x, y, z, w, or angles [deg] about x, then the turned y, then the turned z.
    """
    if len(rotation) == 3:
        a, b, c = (np.radians(angle.astype(np.float64)) for angle in rotation)
        x, z = np.cos(b) * np.cos(c), np.sin(a) * np.sin(c) - np.cos(a) * np.sin(b) * np.cos(c)
    else:
        qx, qy, qz, qw = (part.astype(np.float64) for part in rotation)
        length = np.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        qx, qy, qz, qw = (part / np.where(length > 0.0, length, np.nan) for part in (qx, qy, qz, qw))
        x, z = 1.0 - 2.0 * (qy * qy + qz * qz), 2.0 * (qx * qz - qy * qw)
    return continuous(np.arctan2(-z, x))
