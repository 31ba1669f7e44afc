"""Checks that every record's columns pass once, at the door."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, ShapeError, row_of, shown

__all__ = ["column", "counts", "names", "stamps"]


def column(
    name: str, values: npt.ArrayLike, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float64
) -> npt.NDArray[np.generic]:
    """A read-only array of the wanted shape and type, sharing memory where it can.

    Raises:
        ShapeError: If the shape differs; the message names the column and both shapes.
        InputError: If it holds anything but numbers; for whole numbers: anything but these.
    """
    array = _array(name, values)
    array = (_whole(name, array) if dtype is np.int64 else array.astype(dtype, copy=False)).view()
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
    array = _array(name, values)
    if array.ndim != 1:
        raise ShapeError(f"{name}: shape {array.shape}, must be (samples,)")
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"{name}: {array.dtype}, must be whole nanoseconds (int64)")
    array = array.astype(np.int64, copy=False).view()
    array.flags.writeable = False
    return array


def names(field: str, values: object) -> tuple[str, ...]:
    """Texts as a tuple.

    Raises:
        InputError: If they are anything else, a single text for example.
    """
    row = row_of(values)
    if row is None or not all(isinstance(value, str) for value in row):
        raise InputError(f"{field}: {shown(values)}, must be a list of texts")
    return row


def counts(field: str, values: object) -> Mapping[str, int]:
    """How often something happened, by its name, read-only.

    Raises:
        InputError: If it is no mapping.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"{field}: {shown(values)}, must be {{reason: count}}")
    return MappingProxyType(dict(values))


def _array(name: str, values: npt.ArrayLike) -> npt.NDArray[np.generic]:
    """The values as an array of numbers."""
    array = None
    try:
        array = np.asarray(values)
        if array.dtype.kind == "O":
            array = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    if array is None or array.dtype.kind not in "biuf":
        raise InputError(f"{name}: {shown(values)}, must be an array of numbers")
    return array


def _whole(name: str, array: npt.NDArray[np.generic]) -> npt.NDArray[np.int64]:
    """Counts as int64; numbers with a part behind the point are none."""
    with np.errstate(invalid="ignore"):
        whole = array.astype(np.int64, copy=False)
    if array.dtype.kind == "f" and not np.array_equal(whole, array):
        raise InputError(f"{name}: {array.dtype} with parts of counts, must be whole numbers (int64)")
    return whole
