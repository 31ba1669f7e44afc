"""Counters and angles that begin anew where nobody said so, read off the log alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.robot import Encoder

__all__ = ["Wrap", "find_wrap", "unwrapped"]

Floats = npt.NDArray[np.float64]

FEWEST_BITS, MOST_BITS = 6, 40
NEIGHBOURS = 5
"""Steps to either side that say how fast the wheel turned when its counter jumped."""
CLEAR = 3.0
"""A jump is a wrap where what is left of it is less than this many times the steps beside it."""


@dataclass(frozen=True, slots=True)
class Wrap:
    """One column that begins anew.

    Attributes:
        bits: Of its counter; None for an angle that begins anew after a turn.
        span: After how much it does [rad].
        jumps: How often it did.
        usual: How far it moved in the steps beside the jumps [rad].
    """

    bits: int | None
    span: float
    jumps: int
    usual: float


def find_wrap(turned: Floats, encoder: Encoder | None) -> Wrap | None:
    """What a running total begins anew after; None where it does not, or as declared.

    Args:
        turned: Its changes [rad].
        encoder: What it is counted by; None where it is read as an angle.
    """
    if encoder is None:
        return _wrap(turned, None, math.tau)
    for bits in range(min(MOST_BITS, (encoder.bits or 99) - 1), FEWEST_BITS - 1, -1):
        wrap = _wrap(turned, bits, abs(encoder.radians_per_tick) * 2.0**bits)
        if wrap is not None:
            return wrap
    return None


def unwrapped(changes: Floats, span: float) -> Floats:
    """Changes by the shorter way round."""
    wrapped: Floats = np.mod(changes + 0.5 * span, span) - 0.5 * span
    return wrapped


def _wrap(changes: Floats, bits: int | None, span: float) -> Wrap | None:
    """The wrap of this span, if there are jumps by about as much between steps that are small."""
    # A counter that wraps never leaves its span.
    if len(changes) == 0 or np.ptp(np.cumsum(changes)) > 1.01 * span:
        return None
    size = np.abs(changes)
    jumps = np.flatnonzero((size > 0.5 * span) & (size < 1.5 * span))
    if not len(jumps) or len(jumps) > 0.4 * len(changes):
        return None
    calm = np.where(size > 0.5 * span, np.nan, size)
    beside = np.array([_usual(calm[max(0, k - NEIGHBOURS) : k + NEIGHBOURS + 1]) for k in jumps])
    left = np.abs(unwrapped(changes[jumps], span))
    small = (beside > 0.0) & (left <= CLEAR * beside + span / 128.0) & (beside < span / 4.0)
    if small.mean() < 0.9:
        return None
    return Wrap(bits, span, len(jumps), float(np.median(beside)))


def _usual(steps: Floats) -> float:
    known = steps[np.isfinite(steps)]
    return float(known.max()) if len(known) else math.inf
