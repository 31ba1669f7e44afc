"""The walk of `integrate_batch`, compiled by Numba (extra `fast`): two or three times what a copy costs.

One robot after the other, in blocks that fit into the first-level cache, in three loops each of
which has one thing to wait for:

1. wheel angles to body coordinates, counted from the start of the block: running sums of the body
   displacement, so that headings need no sum of their own;
2. what each step adds to x and y: all arithmetic, no step waits for another, so that the compiler
   takes eight steps at a time;
3. running sums, written out.

Angles are carried as eighths of themselves: the mean of two headings is then a quarter when it is
their plain sum, and a quarter is what the series for sine and cosine want.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.odometry.integrator import Integrator, commutator_factor

__all__ = ["FEWEST", "available", "walk"]

Floats = npt.NDArray[np.float64]
Function = Callable[..., Any]

FEWEST = 100_000
"""Samples in one call from which Numba is used.

The first such call in a process loads and compiles for some seconds, once for every number of wheels;
that is for processes that live long, which is why it takes an extra to have it. No result is kept on
disk.
"""

BLOCK = 128  # steps: their columns take 5 KiB, so that memory is asked in small portions, between arithmetic

# Series in z = angle^2 that meet the function at the Chebyshev nodes of their range, where Taylor's would
# need a term or two more; off by less than 1e-16. tests/test_compiled.py finds them again.
_SINE = (  # sin(a) / a, a up to pi/4
    1.0,
    -0.16666666666666616,
    0.008333333333320363,
    -0.000198412698286503,
    2.755731337640013e-06,
    -2.5050716974102745e-08,
    1.5894736651849094e-10,
)
_COSINE = (  # cos(a), a up to pi/4
    1.0,
    -0.4999999999999925,
    0.041666666666472306,
    -0.0013888888869978658,
    2.4801578538562985e-05,
    -2.755523388484742e-07,
    2.0630454379662294e-09,
)
_CHORD = (  # sin(4 t) / (4 t), eighths t of a turn up to half a radian
    1.0,
    -2.66666666666607,
    2.133333332111249,
    -0.8126975366270509,
    0.1803432806236089,
)
_WIDEST = 1.0 / 16.0

# A quarter turn of the circle, pi/2 = _TURN + _TURN_REST: k * _TURN is exact for |k| < 2^20 (Cody and
# Waite 1980). Both are bits of pi: 33 of them, and the next 53.
_TURN = 6746518852 * 2.0**-32
_TURN_REST = 6.077100506506192e-11


@functools.cache
def available() -> bool:
    """Whether Numba is installed, and with a NumPy that it works with."""
    try:
        import numba  # noqa: F401
    except ImportError:
        return False
    return True


def walk(
    columns: Sequence[Sequence[float]],
    positions: Floats,
    time_ns: npt.NDArray[Any] | None,
    integrator: Integrator,
    out: Floats,
) -> None:
    """Poses from readings that make a displacement through one constant matrix.

    Args:
        columns: Per reading, the displacement (x, y, theta) for each unit of it.
        positions: Cumulative readings, shape (robots, steps, readings).
        time_ns: Stamps, shape (steps,); None means equal steps.
        integrator: Any but the symmetric one.
        out: Poses to be written, shape (robots, steps, 3), contiguous.
    """
    weights = np.full(BLOCK, 8.0 / 12.0 if integrator is Integrator.ARC_PLUS else 0.0)
    if time_ns is not None and integrator is Integrator.ARC_PLUS:
        now: Any = np.diff(time_ns).astype(np.float64)
        before: Any = np.concatenate([now[:1], now[:-1]])
        weights = np.concatenate([8.0 * commutator_factor(before, now), weights])
    _walk()(
        tuple((float(x), float(y), 0.125 * float(theta)) for x, y, theta in columns),
        np.ascontiguousarray(positions, dtype=np.float64).reshape(-1),
        positions.shape[1],
        weights,
        integrator in (Integrator.ARC_PLUS, Integrator.ARC),
        integrator is Integrator.EULER,
        out.reshape(-1),
    )


@functools.cache
def _walk() -> Function:
    """The compiled walk; compiled anew for every number of readings."""
    from numba import njit

    # "contract" lets products and sums fuse; nothing may be reordered, or the rounding trick would go.
    compiled = njit(nogil=True, error_model="numpy", fastmath={"contract", "nsz"})
    quick = compiled(_increments(compiled(_direction), compiled(_chord)))
    exact = compiled(_increments(compiled(_exact_direction), compiled(_exact_chord)))
    return compiled(_blocks(compiled(_coordinates), compiled(_is_smooth), quick, exact, compiled(_sums)))


def _blocks(
    coordinates: Function, is_smooth: Function, quick: Function, exact: Function, sums: Function
) -> Function:
    """All robots, block by block."""

    def blocks(
        columns: Any, positions: Floats, steps: int, weights: Floats, curved: bool, euler: bool, out: Floats
    ) -> None:
        bx, by, turn = np.zeros(BLOCK + 2), np.zeros(BLOCK + 2), np.zeros(BLOCK + 2)
        ux, uy = np.empty(BLOCK), np.empty(BLOCK)
        readings = len(columns)
        bend, ahead = 1.0 if curved else 0.0, 1 if euler else 2
        for start in range(0, out.size // 3, steps):
            out[3 * start] = out[3 * start + 1] = out[3 * start + 2] = 0.0
            x = y = heading = base = 0.0  # `base` is an eighth of the heading, less whole circles
            bx[0] = by[0] = turn[0] = 0.0
            for first in range(0, steps - 1, BLOCK):
                count = min(BLOCK, steps - 1 - first)
                row = start + first
                coordinates(columns, positions[row * readings :], count, bx, by, turn)
                weight = weights[first:] if weights.size > BLOCK else weights
                if is_smooth(turn, count):
                    quick(bx, by, turn, turn[ahead:], base, weight, bend, ux, uy, count)
                else:
                    exact(bx, by, turn, turn[ahead:], base, weight, bend, ux, uy, count)
                x, y = sums(ux, uy, turn, x, y, heading, count, out[3 * row + 3 :])
                heading += 8.0 * turn[count + 1]
                base += turn[count + 1]
                circles = np.rint(base / (0.25 * math.pi))
                base = (base - circles * (0.5 * _TURN)) - circles * (0.5 * _TURN_REST)
                for column in (bx, by, turn):
                    column[0] = column[count] - column[count + 1]

    return blocks


def _coordinates(columns: Any, positions: Floats, count: int, bx: Floats, by: Floats, turn: Floats) -> None:
    """Body coordinates of the first row, which are zero, and of the next ones.

    They stand from [1] on; [0] is for the row before, which the commutator wants.
    """
    readings = len(columns)
    for i in range(count + 1):
        x = y = eighth = 0.0
        for k in range(len(columns)):
            value = positions[i * readings + k] - positions[k]
            x += columns[k][0] * value
            y += columns[k][1] * value
            eighth += columns[k][2] * value
        bx[i + 1], by[i + 1], turn[i + 1] = x, y, eighth


def _is_smooth(turn: Floats, count: int) -> bool:
    """Whether every step turns by less than half a radian."""
    smooth = 0
    for i in range(count):
        if abs(turn[i + 2] - turn[i + 1]) < _WIDEST:
            smooth += 1
    return smooth == count


def _increments(direction: Function, chord: Function) -> Function:
    """What each step of a block adds to x and y."""

    def increments(
        bx: Floats,
        by: Floats,
        turn: Floats,
        lead: Floats,
        base: float,
        weight: Floats,
        bend: float,
        ux: Floats,
        uy: Floats,
        count: int,
    ) -> None:
        for i in range(-(-count // 8) * 8):  # whole vectors: what lies beyond is computed in vain
            ax, ay, at = bx[i + 1] - bx[i], by[i + 1] - by[i], turn[i + 1] - turn[i]
            dx, dy, dt = bx[i + 2] - bx[i + 1], by[i + 2] - by[i + 1], turn[i + 2] - turn[i + 1]
            x = dx + weight[i] * (ay * dt - at * dy)
            y = dy + weight[i] * (at * dx - ax * dt)
            s, c = direction(2.0 * base + (turn[i + 1] + lead[i]), chord(bend * dt * dt))
            ux[i], uy[i] = c * x - s * y, s * x + c * y

    return increments


def _direction(quarter: float, length: float) -> tuple[float, float]:
    """Sine and cosine of four times an angle, times a length."""
    k = np.rint(quarter * (2.0 / math.pi))
    a = (quarter - k * _TURN) - k * _TURN_REST
    z = a * a
    s, c = _SINE[6], _COSINE[6]
    for n in range(5, -1, -1):
        s, c = s * z + _SINE[n], c * z + _COSINE[n]
    # Twice: sin 2a = 2 s c, cos 2a = 1 - 2 s^2.
    s *= a
    s, c = 2.0 * s * c, 1.0 - 2.0 * s * s
    twice = 2.0 * s * length
    return twice * c, length - twice * s


def _chord(z: float) -> float:
    """sinc(4 t) from t^2."""
    length = _CHORD[4]
    for n in range(3, -1, -1):
        length = length * z + _CHORD[n]
    return length


def _exact_direction(quarter: float, length: float) -> tuple[float, float]:
    return length * math.sin(4.0 * quarter), length * math.cos(4.0 * quarter)


def _exact_chord(z: float) -> float:
    half = 4.0 * math.sqrt(z)
    return math.sin(half) / half if half > 0.0 else 1.0


def _sums(
    ux: Floats, uy: Floats, turn: Floats, x: float, y: float, heading: float, count: int, poses: Floats
) -> tuple[float, float]:
    """Running sums, written as poses."""
    for i in range(count):
        x += ux[i]
        y += uy[i]
        poses[3 * i], poses[3 * i + 1], poses[3 * i + 2] = x, y, heading + 8.0 * turn[i + 2]
    return x, y
