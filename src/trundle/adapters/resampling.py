"""Readings with stamps of their own, at the stamps of other readings."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.errors import LogLimit

__all__ = ["LONGEST_BRIDGE_NS", "changes", "held", "interpolated", "summed", "turned", "unwrapped"]

Stamps = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

# Between two samples further apart than this, what lies between is not known.
LONGEST_BRIDGE_NS = 500_000_000

LONGEST_CYCLE_NS = 100_000_000  # of a robot's loop: what changes less often is constant most of the time

MOST_HELD_ROWS = 1_000_000  # put where nothing changed: days of silence, one every half second


def held(wanted: Stamps, time_ns: Stamps, values: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], Mask]:
    """The last value at or before each wanted stamp, and where there is one."""
    order = np.argsort(time_ns, kind="stable")
    last = np.searchsorted(time_ns[order], wanted, side="right") - 1
    if not len(time_ns):
        return np.zeros(len(wanted), values.dtype), np.zeros(len(wanted), dtype=bool)
    return values[order][np.maximum(last, 0)], last >= 0


def changes(source: object, series: Sequence[Stamps]) -> Stamps:
    """Rows for values that are logged when they change, in a loop with a steady cycle.

    What changed in one cycle was logged within a moment and makes one row, at its last stamp. Where nothing
    changed for longer, rows stand a cycle after the last change and a cycle before the next, since all that
    while the values held, and others every half second, so that silence is no gap.

    Args:
        source: The log, for errors.
        series: Stamps of each value's changes, each in order.

    Raises:
        LogLimit: If the silence would take more than a million rows.
    """
    stamps = np.unique(np.concatenate([np.empty(0, np.int64), *series]))
    steps = np.concatenate([np.empty(0, np.int64), *map(np.diff, series)])
    # Most values change in most cycles; what is shorter yet is jitter.
    cycle = min(int(np.quantile(steps, 0.1)), LONGEST_CYCLE_NS) if len(steps) else 0
    ticks = stamps.tolist()
    rows, at = [], 0
    while at < len(ticks):
        at = bisect_right(ticks, ticks[at] + cycle // 4, at)
        rows.append(ticks[at - 1])
    if not cycle:
        return np.array(rows, np.int64)
    silent = [(a, b - cycle) for a, b in pairwise(rows) if 2 * (b - a) > 3 * cycle]
    wanted = sum(3 + (until - since) // LONGEST_BRIDGE_NS for since, until in silent)
    if wanted > MOST_HELD_ROWS:
        hours = sum(until - since for since, until in silent) / 3.6e12
        raise LogLimit(source, "limit", f"its values would have to be held for {hours:.4g} hours of silence")
    filled = [np.array(rows, np.int64)]
    for since, until in silent:
        filled.append(
            np.append(np.arange(since, until, LONGEST_BRIDGE_NS), [min(since + cycle, until), until])
        )
    return np.unique(np.concatenate(filled))


def interpolated(wanted: Stamps, time_ns: Stamps, values: Floats) -> tuple[Floats, Mask]:
    """Values between their neighbours at each wanted stamp, and where there are two near enough.

    Nothing is extrapolated. Of several samples with one stamp the last counts.
    """
    own, values = _in_order(time_ns, values)
    if not len(own):
        return np.full(len(wanted), np.nan), np.zeros(len(wanted), dtype=bool)
    after = np.clip(np.searchsorted(own, wanted), 0, len(own) - 1)
    before = np.maximum(after - 1, 0)
    near = (own[after] - own[before] <= LONGEST_BRIDGE_NS) & (own[before] <= wanted)
    # Offsets from the first stamp keep their nanoseconds as floats; times since 1970 would not.
    at = np.interp(wanted - own[0], own - own[0], values)
    return at, (near | (own[after] == wanted)) & (wanted <= own[-1])


def summed(wanted: Stamps, time_ns: Stamps, increments: Floats) -> tuple[Floats, Mask]:
    """Increments between the wanted stamps; the first row's is zero."""
    order = np.argsort(time_ns, kind="stable")
    totals, known = interpolated(wanted, time_ns[order], np.cumsum(increments[order]))
    return np.diff(totals, prepend=totals[:1]), known


def turned(wanted: Stamps, time_ns: Stamps, angles: Floats) -> tuple[Floats, Mask]:
    """Angles [rad] between their neighbours, the shorter way round; else as `interpolated`."""
    angles = angles.astype(np.float64)
    order = np.argsort(time_ns, kind="stable")
    known = order[np.isfinite(angles[order])]
    angles[known] = np.unwrap(angles[known])
    return interpolated(wanted, time_ns, angles)


def unwrapped(counts: npt.NDArray[np.int64], bits: int | None) -> Floats:
    """Counts of a counter that wraps, as if it did not, from zero at the first."""
    if bits is None or bits > 62:
        steps = np.diff(counts)
    else:
        half = 1 << (bits - 1)
        steps = ((np.diff(counts) + half) & (2 * half - 1)) - half
    return np.concatenate(([0], np.cumsum(steps))).astype(np.float64)[: len(counts)]


def _in_order(time_ns: Stamps, values: Floats) -> tuple[Stamps, Floats]:
    order = np.argsort(time_ns, kind="stable")
    own, values = time_ns[order], values[order]
    last = np.append(own[1:] != own[:-1], True)[: len(own)]
    return own[last], values[last]
