"""Columns of numbers to Arrow and back, by their memory.

pyarrow's own ways (`pa.array`, `to_numpy`) load pandas where it is there: a second, in which Ctrl-C is lost.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["arrow_column", "numbers_of"]

_FLOATS = {"halffloat": "float16", "float": "float32", "double": "float64"}


def numbers_of(column: Any) -> npt.NDArray[Any]:
    """A column without gaps, of integers or floats, as an array.

    Args:
        column: A ChunkedArray.
    """
    array = column.combine_chunks()
    kind = np.dtype(_FLOATS.get(str(array.type), str(array.type)))
    _, data = array.buffers()
    return np.frombuffer(data or b"", kind)[array.offset : array.offset + len(array)]


def arrow_column(values: npt.NDArray[Any]) -> Any:
    """Integers or floats as an Arrow array.

    Args:
        values: Shape (N,).
    """
    import pyarrow as pa

    kind = pa.type_for_alias(values.dtype.name)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))])
