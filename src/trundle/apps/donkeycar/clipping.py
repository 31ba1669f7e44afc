"""What a part does with what is no number, or more than can be done: it goes on, and says so."""

from __future__ import annotations

import logging
import math
import numbers

__all__ = ["Clipping", "as_number", "clip"]


def as_number(value: object) -> float | None:
    """The value as a float, NumPy's scalars included; None unless it is a finite number.

    A channel of a donkeycar `Vehicle` is None until something has been put there.
    """
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def clip(value: float, most: float) -> float:
    """The nearest value from -most to most."""
    return max(-most, min(most, value))


class Clipping:
    """A part that never raises in the loop: it does what can be done.

    Attributes:
        clipped: Whether the last result is not what was asked for.
    """

    clipped = False

    def shutdown(self) -> None:
        """Nothing is held that would have to be given back."""

    def _report(self, clipped: bool) -> None:
        """Remember whether the last result was clipped, and log where that begins."""
        if clipped and not self.clipped:
            logging.getLogger(__name__).warning("%s: what was asked for cannot be done", type(self).__name__)
        self.clipped = clipped
