"""Counters to angles: what a wheel turned between two readings of its encoder."""

from __future__ import annotations

import operator
from typing import Any

__all__ = ["count_difference", "count_differences", "whole_count"]

Array = Any


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


def count_differences(now: Array, before: Array, bits: int | None) -> Array:
    """`count_difference` for int64 arrays; counters of 64 bits wrap as the integers themselves do."""
    change = now - before
    if bits is None or bits == 64:
        return change
    half = 1 << (bits - 1)
    return ((change + half) & (2 * half - 1)) - half


def whole_count(value: Any) -> int | None:
    """A counter reading as an int; None if it is not a whole number."""
    try:
        return operator.index(value)
    except TypeError:
        return int(value) if isinstance(value, float) and value.is_integer() else None
