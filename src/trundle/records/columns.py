"""Checks that every record's columns pass once, at the door."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, ShapeError

__all__ = ["column", "stamps"]


def column(
    name: str, values: npt.ArrayLike, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float64
) -> npt.NDArray[np.generic]:
    """A read-only array of the wanted shape and type, sharing memory where it can.

    Raises:
        ShapeError: If the shape differs; the message names the column and both shapes.
    """
    array = np.asarray(values, dtype=dtype).view()
    if array.shape != shape:
        raise ShapeError(f"{name}: shape {array.shape}, must be {shape}")
    array.flags.writeable = False
    return array


def stamps(name: str, values: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """A read-only int64 column of nanoseconds.

    Raises:
        ShapeError: If it is not one-dimensional.
        InputError: If it holds anything but whole numbers.
    """
    array = np.asarray(values)
    if array.ndim != 1:
        raise ShapeError(f"{name}: shape {array.shape}, must be (samples,)")
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"{name}: {array.dtype}, must be whole nanoseconds (int64)")
    array = array.astype(np.int64, copy=False).view()
    array.flags.writeable = False
    return array
