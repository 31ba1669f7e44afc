"""Readings with stamps of their own, at the stamps of other readings."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["LONGEST_BRIDGE_NS", "held", "interpolated", "summed", "unwrapped"]

Stamps = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

# Between two samples further apart than this, what lies between is not known.
LONGEST_BRIDGE_NS = 500_000_000


def held(wanted: Stamps, time_ns: Stamps, values: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], Mask]:
    """The last value at or before each wanted stamp, and where there is one."""
    order = np.argsort(time_ns, kind="stable")
    last = np.searchsorted(time_ns[order], wanted, side="right") - 1
    if not len(time_ns):
        return np.zeros(len(wanted), values.dtype), np.zeros(len(wanted), dtype=bool)
    return values[order][np.maximum(last, 0)], last >= 0


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
