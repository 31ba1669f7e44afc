"""The step that a column's numbers are multiples of, where an encoder made them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["quantum_of", "unit_of"]

FEWEST_ROWS = 50  # to judge by
MOST_LEVELS = 1e5  # of more one lies near any number
MOST_STEPS = 1e5  # a turn, likewise
WHOLE = 0.02  # how near to whole multiples are
_TURNS = {"rev": 1.0, "rad": math.tau, "deg": 360.0}


def quantum_of(values: npt.NDArray[np.float64]) -> float | None:
    """The step of which all values are whole multiples, and that comes again and again; None without one.

    Numbers that were rounded to so many decimals are multiples too, and tell nothing: they have none.

    Args:
        values: Finite, shape (N,).
    """
    levels = np.unique(values)
    if len(values) < FEWEST_ROWS or not 2 <= len(levels) <= len(values) // 4:
        return None
    steps = np.diff(levels)
    quantum = float(steps[steps > 1e-9 * float(np.ptp(levels))].min(initial=math.inf))
    counts = np.rint(levels / quantum)
    if not np.abs(counts).max() <= MOST_LEVELS:
        return None
    quantum = float(counts @ levels / (counts @ counts))  # of few digits each
    if not float(np.abs(levels / quantum - counts).max()) < WHOLE:
        return None
    digits = quantum * 10.0 ** -math.floor(math.log10(quantum))
    return None if min(abs(digits - one) for one in (1.0, 2.0, 5.0, 10.0)) < 1e-3 else quantum


def unit_of(quantum: float) -> str:
    """The unit in which it divides a turn into whole steps; empty where none does."""
    steps = {unit: turn / quantum for unit, turn in _TURNS.items()}
    return next((unit for unit, n in steps.items() if 1.5 < n < MOST_STEPS and abs(n - round(n)) < WHOLE), "")
