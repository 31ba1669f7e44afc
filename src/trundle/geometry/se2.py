"""SE(2) on arrays of any array library: shape (..., 3), order (x, y, theta).

Written once against the array-API standard: NumPy, PyTorch, JAX and CuPy in, the same out, with
device, dtype and gradients kept.
"""

from __future__ import annotations

import math
from typing import Any

from array_api_compat import array_namespace, is_numpy_array

from trundle.errors import ShapeError

__all__ = ["adjoint", "compose", "excess", "exp", "inverse", "log", "right_jacobian", "sinc", "wrap"]

Array = Any  # any array of the array-API standard

# Taylor coefficients of sin(a)/a in powers of a^2. With |a| < 1 the first one left out is below
# 1e-17. The quotient is as good in value, but its derivative loses digits as 1/a near zero.
_SINC = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(9))


def sinc(angle: Array) -> Array:
    """sin(angle) / angle, with its limit 1 at zero; accurate in value and in derivative."""
    xp = array_namespace(angle)
    square = angle * angle
    if is_numpy_array(angle) and angle.size:
        # Nothing to trace here, so the largest angle decides how many terms are needed.
        largest = float(square.max())
        if largest < 1.0:
            return _series(square, largest)
    near = square < 1.0
    safe = xp.where(near, xp.ones_like(angle), angle)
    return xp.where(near, _series(square, 1.0), xp.sin(safe) / safe)


def _series(square: Array, largest: float, terms: tuple[float, ...] = _SINC) -> Array:
    """sin(a)/a from a^2, with as many terms as the largest a^2 needs for full precision."""
    count = next((k for k, c in enumerate(terms) if abs(c) * largest**k < 1e-17), len(terms))
    series = terms[count - 1]
    for coefficient in terms[count - 2 :: -1] if count > 1 else ():
        series = series * square + coefficient
    return series if count > 1 else square * 0.0 + series


def wrap(angle: Array) -> Array:
    """The same directions in (-pi, pi]."""
    xp = array_namespace(angle)
    wrapped = angle - math.tau * xp.round(angle / math.tau)
    # Rounding can leave half a turn on the wrong side.
    wrapped = xp.where(wrapped > math.pi, wrapped - math.tau, wrapped)
    return xp.where(wrapped <= -math.pi, wrapped + math.tau, wrapped)


def exp(tangent: Array) -> Array:
    """Pose reached by holding a body twist for one unit of time.

    Args:
        tangent: Body displacement `(x, y, theta)` in [m, m, rad], shape (..., 3).

    Returns:
        Pose `(x, y, theta)` in [m, m, rad], shape (..., 3).

    Raises:
        ShapeError: If the last axis is not 3.

    Source:
        Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 156 and 158.
    """
    xp = array_namespace(tangent)
    dx, dy, theta = _columns(tangent, "tangent")
    half = 0.5 * theta
    chord = sinc(half)
    c, s = chord * xp.cos(half), chord * xp.sin(half)
    return xp.stack([c * dx - s * dy, s * dx + c * dy, theta], axis=-1)


def log(pose: Array) -> Array:
    """The shortest twist that reaches a pose in one unit of time; inverse of `exp`.

    Args:
        pose: `(x, y, theta)` in [m, m, rad], shape (..., 3). The heading is wrapped first.

    Returns:
        Tangent `(x, y, theta)` in [m, m, rad], shape (..., 3).

    Raises:
        ShapeError: If the last axis is not 3.

    Source:
        Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 157.
    """
    xp = array_namespace(pose)
    x, y, theta = _columns(pose, "pose")
    theta = wrap(theta)
    half = 0.5 * theta
    # half / tan(half), without a quotient that is 0/0 at zero or a tangent that is large near pi.
    along = xp.cos(half) / sinc(half)
    return xp.stack([along * x + half * y, along * y - half * x, theta], axis=-1)


def compose(first: Array, second: Array) -> Array:
    """The poses `second`, given in the frames `first`, in the frame that `first` is in.

    Args:
        first: Poses, shape (..., 3).
        second: Poses, shape (..., 3), broadcast against `first`.

    Returns:
        Poses, shape (..., 3); headings add and are not wrapped.

    Raises:
        ShapeError: If a last axis is not 3.
    """
    xp = array_namespace(first, second)
    x, y, theta = _columns(first, "first")
    dx, dy, turn = _columns(second, "second")
    c, s = xp.cos(theta), xp.sin(theta)
    return xp.stack([x + c * dx - s * dy, y + s * dx + c * dy, theta + turn], axis=-1)


def inverse(pose: Array) -> Array:
    """The poses that undo these: `compose(pose, inverse(pose))` is the identity.

    Args:
        pose: Poses, shape (..., 3).

    Raises:
        ShapeError: If the last axis is not 3.
    """
    xp = array_namespace(pose)
    x, y, theta = _columns(pose, "pose")
    c, s = xp.cos(theta), xp.sin(theta)
    return xp.stack([-c * x - s * y, s * x - c * y, -theta], axis=-1)


def adjoint(pose: Array) -> Array:
    """Matrices that take twists in the poses' frames to the frame that the poses are in.

    Args:
        pose: Poses, shape (..., 3).

    Returns:
        Matrices, shape (..., 3, 3).

    Raises:
        ShapeError: If the last axis is not 3.

    Source:
        Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 159.
    """
    xp = array_namespace(pose)
    x, y, theta = _columns(pose, "pose")
    c, s = xp.cos(theta), xp.sin(theta)
    zero, one = xp.zeros_like(theta), xp.ones_like(theta)
    rows = ([c, -s, y], [s, c, -x], [zero, zero, one])
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def right_jacobian(tangent: Array) -> Array:
    """Matrices J with `exp(t + d) = exp(t) exp(J d)` to first order in d.

    Args:
        tangent: Body displacements, shape (..., 3).

    Returns:
        Matrices, shape (..., 3, 3).

    Raises:
        ShapeError: If the last axis is not 3.

    Source:
        Sola, Deray, Atchuthan 2018, "A micro Lie theory", eq. 163.
    """
    xp = array_namespace(tangent)
    dx, dy, theta = _columns(tangent, "tangent")
    half = 0.5 * theta
    a = sinc(theta)
    b = xp.sin(half) * sinc(half)  # (1 - cos theta) / theta
    # (theta - sin theta) / theta^2 and (1 - cos theta) / theta^2
    c = excess(theta)
    d = 0.5 * sinc(half) ** 2
    zero, one = xp.zeros_like(theta), xp.ones_like(theta)
    rows = ([a, b, c * dx - d * dy], [-b, a, d * dx + c * dy], [zero, zero, one])
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


def excess(angle: Array) -> Array:
    """(angle - sin(angle)) / angle^2, which is angle/6 near zero."""
    xp = array_namespace(angle)
    square = angle * angle
    if is_numpy_array(angle) and angle.size:
        largest = float(square.max())  # as in sinc
        if largest < 1.0:
            return -angle * _series(square, largest, _SINC[1:])
    near = square < 1.0
    safe = xp.where(near, xp.ones_like(angle), angle)
    return xp.where(near, -angle * _series(square, 1.0, _SINC[1:]), (safe - xp.sin(safe)) / (safe * safe))


def _columns(array: Array, name: str) -> tuple[Array, Array, Array]:
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ShapeError(f"{name}: shape {tuple(array.shape)}, the last axis must be 3: (x, y, theta)")
    return array[..., 0], array[..., 1], array[..., 2]
