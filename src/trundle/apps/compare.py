"""`trundle compare`: how far a trajectory is from a reference."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from trundle.adapters.trajectory_format import holdings
from trundle.apps.rejection import left_out, without_times
from trundle.apps.wording import aligned, angle, digits, fixed, labelled, length, plural, seconds

if TYPE_CHECKING:
    from trundle.evaluate import Comparison, Statistics

__all__ = ["compare"]


def compare(
    estimate: Annotated[Path, Parameter(help=f"What is judged: {holdings()}.")],
    reference: Path,
    /,
    *,
    align: Literal["best", "origin", "none"] = "best",
    distance: float = 1.0,
    time_offset: float = 0.0,
    max_gap: float = 1.0,
) -> None:
    """Associate two trajectories in time, align them, and print the errors.

    A file without times is compared row by row, with one that has as many rows.

    Args:
        estimate: What is judged.
        reference: What it is judged by, likewise. It needs no headings.
        align: Best rotation and translation, first pose upon first pose, or none.
        distance: Path length over which relative errors are taken [m].
        time_offset: Added to the stamps of the estimate [s].
        max_gap: Longest time between two samples that is interpolated over [s].
    """
    from trundle import evaluate
    from trundle.adapters.trajectory import read_trajectory
    from trundle.errors import InputError, LogError, Unobservable

    if not 0.0 < distance < math.inf:
        raise InputError(f"--distance {distance:g} m, must be > 0")
    if not max_gap > 0.0:
        raise InputError(f"--max-gap {max_gap:g} s, must be > 0")
    if not math.isfinite(time_offset):
        raise InputError(f"--time-offset {time_offset:g} s, must be finite")
    pair = read_trajectory(estimate), read_trajectory(reference)
    files = tuple(zip((estimate, reference), pair, strict=True))
    for words in (words for file in files for words in left_out(*file)):
        print(f"trundle: warning: {words}", file=sys.stderr)
    try:
        comparison = evaluate.compare(
            *pair,
            max_gap=max_gap,
            time_offset=time_offset,
            alignment=evaluate.Alignment(align),
            rpe_distance=distance,
        )
    except (InputError, Unobservable) as error:  # the two files, not the call
        raise LogError(f"{estimate}, {reference}", "compare", str(error)) from error
    for words in (words for file in files for words in without_times(*file, "compared row by row")):
        print(f"trundle: warning: {words}", file=sys.stderr)
    print(f"{estimate} against {reference}")
    print(*labelled(_facts(comparison)), sep="\n")
    print(*_table(comparison), sep="\n")


def _facts(comparison: Comparison) -> list[tuple[str, str]]:
    path = length(comparison.reference_length)
    if comparison.overlap is not None:
        path += f" in {seconds(comparison.overlap)}"
    x, y, theta = comparison.alignment.x, comparison.alignment.y, comparison.alignment.theta
    drift = []
    if comparison.drift is not None:
        drift.append(f"{digits(100 * comparison.drift)} % of the path")
    if comparison.heading_drift is not None:
        drift.append(f"{digits(math.degrees(comparison.heading_drift))} deg/m")
    anees = comparison.anees
    return [
        ("matched", f"{plural(comparison.matched, 'sample')}, {path}"),
        ("moved by", f"x {fixed(x, 3)} m, y {fixed(y, 3)} m, {angle(theta)}"),
        ("drift", ", ".join(drift)),
        ("ANEES", "" if anees is None else f"{digits(anees)} (1 is honest, more is overconfident)"),
    ]


def _table(comparison: Comparison) -> list[str]:
    over = f"RPE {comparison.rpe_distance:g} m"
    rows = [("error", "rms", "mean", "median", "max")]
    rows += _row("APE position", comparison.position, length)
    rows += _row("APE heading", comparison.heading, angle)
    rows += _row(f"{over} position", comparison.rpe_position, length)
    rows += _row(f"{over} heading", comparison.rpe_heading, angle)
    return ["", *aligned(rows, right=(1, 2, 3, 4))]


def _row(
    name: str, errors: Statistics | None, unit: Callable[[float], str]
) -> list[tuple[str, str, str, str, str]]:
    """One line of the table; none where the reference does not tell."""
    if errors is None:
        return []
    return [(name, unit(errors.rmse), unit(errors.mean), unit(errors.median), unit(errors.max))]
