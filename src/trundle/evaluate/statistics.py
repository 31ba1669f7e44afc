"""What many errors come down to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

__all__ = ["Statistics"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistics:
    """A column of errors in a few numbers, in the unit of the errors.

    Attributes:
        rmse: Root of the mean square.
        mean: Arithmetic mean.
        median: Half of the errors are smaller.
        std: Standard deviation about the mean, dividing by the count.
        min: Smallest.
        max: Largest.
        count: How many errors there are.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    count: int

    @classmethod
    def of(cls, errors: npt.ArrayLike) -> Self | None:
        """Statistics of the errors that are not NaN (not measured); None where none is left."""
        values = np.asarray(errors, dtype=np.float64)
        values = values[~np.isnan(values)]
        if not values.size:
            return None
        return cls(
            rmse=float(np.sqrt(np.mean(values * values))),
            mean=float(np.mean(values)),
            median=float(np.median(values)),
            std=float(np.std(values)),
            min=float(np.min(values)),
            max=float(np.max(values)),
            count=int(values.size),
        )
