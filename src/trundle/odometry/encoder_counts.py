"""Counters to angles: what a wheel turned between two readings of its encoder."""

from __future__ import annotations

import operator
from typing import Any

__all__ = ["count_difference", "whole_count"]


def count_difference(now: int, before: int, bits: int | None) -> int:
    """Counts between two readings, across the counter's wrap in either direction.

    Signed and unsigned counters alike: only the difference modulo the range counts. It is exact
    while the wheel moved less than half the range; at exactly half its sign is a guess.

    Args:
        now: Reading.
        before: Earlier reading.
        bits: Width of the counter, or None if it never wraps.
    """
    if bits is None:
        return now - before
    half = 1 << (bits - 1)
    return ((now - before + half) & (2 * half - 1)) - half


def whole_count(value: Any) -> int | None:
    """A counter reading as an int; None if it is not a whole number."""
    try:
        return operator.index(value)
    except TypeError:
        return int(value) if isinstance(value, float) and value.is_integer() else None
