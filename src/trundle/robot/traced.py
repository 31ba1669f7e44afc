"""Numbers that may be traced: parameters of a drive through which somebody differentiates.

Arithmetic needs nothing from here. Decisions do (which wheels depend on each other, what to divide
by), and so do sines, which are the library's for its numbers and `math`'s for floats.
"""

from __future__ import annotations

import math
from typing import Any

from trundle.errors import ConfigError, InputError

__all__ = ["array_library", "nominal", "surely", "trigonometry"]

_FINEST = 2.0**-40  # far below any length that decides anything


def nominal(value: Any) -> float:
    """The number behind a value, to decide by.

    Raises:
        ConfigError: If it has none yet, as inside `jax.jit`.
    """
    if isinstance(value, float | int):
        return float(value)
    if hasattr(value, "detach"):
        return float(value.detach())
    # What has no derivative is not traced: JAX lets a rounded number be looked at.
    try:
        return float(trigonometry(value).round(value / _FINEST)) * _FINEST
    except TypeError:
        raise ConfigError(
            "drive",
            "made with a number that is not known yet; jax.grad, jvp and jacfwd know theirs, "
            "but inside jax.jit a drive can only be used, not made",
        ) from None


def surely(condition: Any) -> bool:
    """Whether an array's truth is known, and true. Inside `jax.jit` nothing is."""
    try:
        return bool(condition)
    except TypeError:
        return False


def trigonometry(value: Any) -> Any:
    """`math`, or the namespace of the array library that the value belongs to."""
    if isinstance(value, float | int):
        return math
    from array_api_compat import array_namespace

    return array_namespace(value)


def array_library(name: str, array: Any) -> Any:
    """The namespace of an array's library, as the array-API standard has it.

    Raises:
        InputError: If it is no array, a list for example.
    """
    from array_api_compat import array_namespace

    try:
        return array_namespace(array)
    except TypeError:
        kind = type(array).__name__
        problem = f"{name}: a {kind}, must be an array (NumPy, PyTorch, JAX, ...)"
        raise InputError(f"{problem}; numpy.asarray({name}) makes one of a list") from None
