"""Many steps at once: displacements to poses and covariances, as running sums over arrays.

The array twin of `WheelOdometry`'s single step; a property test holds the two together. Works on
any array library; the last axis is time, leading axes are robots.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from array_api_compat import is_numpy_array

from trundle.geometry import se2
from trundle.odometry.covariance import ANY_HEADING, Six, rotated
from trundle.odometry.integrator import Integrator, commutator_factor

__all__ = ["Uncertainty", "corrected", "covariances", "poses"]

Array = Any
Columns = Sequence[Array]


def corrected(
    xp: Any, step: Columns, elapsed: Array | None, integrator: Integrator, before: Columns | None
) -> Columns:
    """Displacements turned by what their neighbours say about how the twist changes.

    Args:
        xp: Namespace of the arrays.
        step: Displacements (x, y, theta), each (..., steps).
        elapsed: Their durations in any unit, (steps,); None means that all are equal.
        integrator: Only "arc+" and "symmetric" change anything.
        before: Displacement and duration (x, y, theta, elapsed) of the step before the first, each
            (..., 1), or None.
    """
    if integrator not in (Integrator.ARC_PLUS, Integrator.SYMMETRIC):
        return step
    dx, dy, dt = step
    # Missing neighbours are still: zero displacement, and any duration.
    ax, ay, at = (_shifted(xp, part, None if before is None else before[k]) for k, part in enumerate(step))
    past_x, past_y = _commutator((ax, ay, at), step)
    if elapsed is None and integrator is Integrator.ARC_PLUS:
        return dx + past_x * (1.0 / 12.0), dy + past_y * (1.0 / 12.0), dt
    if elapsed is None:
        elapsed = xp.ones_like(dt)
    h0 = _shifted(xp, elapsed, elapsed[..., :1] if before is None else before[3])
    if integrator is Integrator.ARC_PLUS:
        factor = commutator_factor(h0, elapsed)
        return dx + factor * past_x, dy + factor * past_y, dt
    zero = xp.zeros_like(dx[..., :1])
    later = [xp.concat([part[..., 1:], zero], axis=-1) for part in step]
    h2 = xp.concat([elapsed[..., 1:], elapsed[..., -1:]], axis=-1)
    next_x, next_y = _commutator(step, later)
    # At the ends the slope of the twist is that of the one neighbour there is.
    count = dx.shape[-1]
    index = xp.arange(count)
    first = (index == 0) & (before is None)
    last = index == count - 1
    span = xp.where(first, elapsed + h2, xp.where(last, h0 + elapsed, h0 + 2.0 * elapsed + h2))
    past, ahead = elapsed * elapsed / (6.0 * h0 * span), elapsed * elapsed / (6.0 * h2 * span)
    return dx + past * past_x + ahead * next_x, dy + past * past_y + ahead * next_y, dt


def poses(xp: Any, step: Columns, integrator: Integrator, start: Columns) -> tuple[Array, Array, Array]:
    """x, y and heading after each step, each (..., steps).

    Args:
        xp: Namespace of the arrays.
        step: Displacements, corrected, each (..., steps).
        integrator: How a step is walked.
        start: Pose before the first, three floats or arrays (..., 1).
    """
    dx, dy, dt = step
    half = 0.5 * dt
    heading = start[2] + xp.cumulative_sum(dt, axis=-1)
    straight = integrator in (Integrator.EULER, Integrator.MIDPOINT)
    chord = 1.0 if straight else se2.sinc(half)
    c, s = _direction(xp, heading - (dt if integrator is Integrator.EULER else half), chord)
    x, y = _two_sums(xp, c * dx - s * dy, s * dx + c * dy)
    return start[0] + x, start[1] + y, heading


class Uncertainty(NamedTuple):
    """What `covariances` found.

    Attributes:
        upper: Upper triangles of the body-frame covariance after each step, each (..., steps).
        independent: After the last step, of what is independent from step to step alone.
        drifts: After the last step, what each error of the description has done so far.
    """

    upper: Six
    independent: Six
    drifts: list[Columns]


class _Seen(NamedTuple):
    """Symmetric matrices seen from one fixed frame.

    Attributes:
        total: xx + yy.
        contrast: xx - yy and 2 xy, which turn like one complex number.
        lever: x-theta, y-theta.
        turn: theta-theta.
    """

    total: Array
    contrast: Columns
    lever: Columns
    turn: Array


def covariances(
    xp: Any,
    step: Columns,
    noise: Six,
    pose: Columns,
    before: Six,
    origin: Columns,
    changes: Sequence[Columns] = (),
    drifts: Sequence[Columns] = (),
) -> Uncertainty:
    """Covariance after each step.

    Seen from one fixed frame the adjoints vanish, the rows with theta become plain sums, and the
    rest two first-order recurrences: running sums under running products. That frame has the axes
    of the odom frame, and begins where the first step does: keep spans short against its lever.

    Args:
        xp: Namespace of the arrays.
        step: Displacements, corrected, each (..., steps).
        noise: Their covariances, each (..., steps).
        pose: Poses after each step, each (..., steps).
        before: Covariance before the first step.
        origin: Pose before the first step.
        changes: Per error of the description, what one sigma of it changes in each step's displacement.
        drifts: What each of them has done before the first step, seen from the odom frame.
    """
    if before[5] + xp.sum(noise[5]) > ANY_HEADING:
        noise = _within_circle(xp, noise, before[5])
    x0, y0, heading0 = origin
    place = (pose[0] - x0, pose[1] - y0)
    half = 0.5 * step[2]
    middle = _direction(xp, pose[2] - half, 1.0)
    end = _direction(xp, pose[2], 1.0)
    w = _noise_seen(noise, step, se2.sinc(half), middle, end, place)
    start = rotated(before, math.cos(heading0), math.sin(heading0))
    seen = _grown(xp, w, start)
    independent = _body_frame(_last(seen), _last_of(end), _last_of(place))
    after: list[Columns] = []
    if changes:
        begun = [(gx - y0 * gt, gy + x0 * gt, gt) for gx, gy, gt in drifts]
        sums = _drifted(xp, changes, step, middle, place, begun)
        seen = _with_squares(seen, sums)
        after = [(gx + y0 * gt, gy - x0 * gt, gt) for gx, gy, gt in map(_last_of, sums)]
    return Uncertainty(_body_frame(seen, end, place), independent, after)


def _within_circle(xp: Any, noise: Six, known: float) -> Six:
    """`covariance.within_circle` for a run of steps."""
    xx, xy, yy, xt, yt, tt = noise
    left = xp.clip(ANY_HEADING - known - (xp.cumulative_sum(tt, axis=-1) - tt), 0.0, None)
    room = xp.minimum(tt, left)
    share = xp.sqrt(room / xp.where(tt > 0.0, tt, 1.0))
    return (xx, xy, yy, share * xt, share * yt, room)


def _noise_seen(
    six: Six, step: Columns, chord: Array, middle: Columns, end: Columns, place: Columns
) -> _Seen:
    """Ad(pose) Jr Q Jr^T Ad(pose)^T: noise of displacements, as errors seen from the fixed frame.

    Jr shrinks by the chord and turns back by half the step; what is left of the turn is that to the
    heading at the step's middle. Errors of heading act from where the arc is on average.
    """
    dx, dy, angle = step
    c, s = middle[0] * chord, middle[1] * chord
    # How far from there to the end, turned back by a right angle: the last column of Jr.
    cross, along = se2.excess(angle), 0.5 * chord * chord
    ux, uy = cross * dx - along * dy, along * dx + cross * dy
    cosine, sine = end
    lx, ly = place[1] + (cosine * ux - sine * uy), (sine * ux + cosine * uy) - place[0]
    xx, xy, yy, xt, yt, tt = six
    kx, ky = c * xt - s * yt, s * xt + c * yt
    wx, wy = kx + lx * tt, ky + ly * tt
    double, across, difference = 2.0 * c * s, xy + xy, xx - yy
    aligned = c * c - s * s
    px, py = lx * (kx + wx), ly * (ky + wy)
    return _Seen(
        (along + along) * (xx + yy) + (px + py),
        (
            aligned * difference - double * across + (px - py),
            double * difference + aligned * across + 2.0 * (lx * wy + ly * kx),
        ),
        (wx, wy),
        tt,
    )


def _grown(xp: Any, w: _Seen, start: Six) -> _Seen:
    """Sums of the noise to fourth order, as in `covariance.propagate`: b = w (this step), a = z (before)."""
    wx, wy, wt = *w.lever, w.turn
    zx1, zy1, zt1 = _running(xp, (wx, wy, wt), start[3:])
    zx, zy, zt = zx1 - wx, zy1 - wy, zt1 - wt
    # What a step adds to the total and to both parts of the contrast; last what is smallest.
    old, new = 1.0 - wt * (1.0 / 12.0), 1.0 - zt * (1.0 / 12.0)
    mixed, square, quarter = (old + new) * (1.0 / 6.0), new * new, 0.25 * zt
    xx, yy = wx * zx, wy * zy
    wxx, wyy, zxx, zyy = wx * wx, wy * wy, zx * zx, zy * zy
    less, more = mixed - 0.5, mixed + 0.5
    total = less * (xx + yy) + (square + quarter) * w.total
    total = total + (1.0 / 144.0) * ((wxx + wyy) * zt + (zxx + zyy) * wt)
    square = square - quarter
    aligned = more * (xx - yy) + square * w.contrast[0]
    aligned = aligned + (1.0 / 144.0) * ((wxx - wyy) * zt + (zxx - zyy) * wt)
    across = more * (wx * zy + wy * zx) + square * w.contrast[1]
    across = across + (2.0 / 144.0) * (wx * wy * zt + zx * zy * wt)
    quarter = 0.25 * wt
    square = old * old
    grow = xp.cumulative_prod(square + quarter, axis=-1)
    shrink = xp.cumulative_prod(square - quarter, axis=-1)
    begun = (start[0] - start[2], 2.0 * start[1], start[0] + start[2])
    aligned, across, total = _running(xp, (aligned / shrink, across / shrink, total / grow), begun)
    return _Seen(grow * total, (shrink * aligned, shrink * across), (zx1, zy1), zt1)


def _drifted(
    xp: Any,
    changes: Sequence[Columns],
    step: Columns,
    middle: Columns,
    place: Columns,
    begun: Sequence[Columns],
) -> list[Columns]:
    """What errors of the description have done after each step, seen from the fixed frame."""
    dx, dy, _ = step
    c, s = middle
    # Each acts where the step was at its middle.
    x, y = place[0] - 0.5 * (c * dx - s * dy), place[1] - 0.5 * (s * dx + c * dy)
    parts: list[Array] = []
    for px, py, pt in changes:
        parts += (c * px - s * py + y * pt, s * px + c * py - x * pt)
    starts = [first for x0, y0, _ in begun for first in (x0, y0)]
    places = _running(xp, parts, starts)
    turns = _running(xp, [pt for _, _, pt in changes], [t0 for _, _, t0 in begun])
    return list(zip(places[::2], places[1::2], turns, strict=True))


def _with_squares(seen: _Seen, sums: Sequence[Columns]) -> _Seen:
    """With the errors of the description, each of one sigma, added."""
    xx = xy = yy = xt = yt = tt = 0.0
    for gx, gy, gt in sums:
        xx, xy, yy = xx + gx * gx, xy + gx * gy, yy + gy * gy
        xt, yt, tt = xt + gx * gt, yt + gy * gt, tt + gt * gt
    (aligned, across), (zx, zy) = seen.contrast, seen.lever
    contrast = (aligned + (xx - yy), across + (xy + xy))
    return _Seen(seen.total + (xx + yy), contrast, (zx + xt, zy + yt), seen.turn + tt)


def _body_frame(seen: _Seen, heading: Columns, place: Columns) -> Six:
    """Covariances of body-frame errors, from what the fixed frame sees."""
    (c, s), (x, y), (zx, zy) = heading, place, seen.lever
    kx, ky = zx - y * seen.turn, zy + x * seen.turn
    px, py = y * (zx + kx), x * (zy + ky)
    total = seen.total + (py - px)
    aligned = seen.contrast[0] - (px + py)
    across = seen.contrast[1] + 2.0 * (x * zx - y * ky)
    along, double = c * c - s * s, 2.0 * c * s
    aligned, across = along * aligned + double * across, along * across - double * aligned
    return (
        0.5 * (total + aligned),
        0.5 * across,
        0.5 * (total - aligned),
        c * kx + s * ky,
        c * ky - s * kx,
        seen.turn,
    )


def _last(seen: _Seen) -> _Seen:
    return _Seen(seen.total[..., -1], _last_of(seen.contrast), _last_of(seen.lever), seen.turn[..., -1])


def _last_of(columns: Columns) -> Columns:
    return [part[..., -1] for part in columns]


def _direction(xp: Any, angle: Array, length: Array | float) -> tuple[Array, Array]:
    """A length in this direction, along x and y.

    NumPy's tangent is six times as fast as its sine, and exact enough to stand for both.
    """
    if not is_numpy_array(angle):
        return length * xp.cos(angle), length * xp.sin(angle)
    t = np.tan(0.5 * angle)
    square = t * t
    scale = length / (1.0 + square)
    return (1.0 - square) * scale, (t + t) * scale


def _two_sums(xp: Any, x: Array, y: Array, x0: Any = 0.0, y0: Any = 0.0) -> tuple[Array, Array]:
    """Running sums. Each waits for the one before it, and NumPy's complex ones wait for two at a time."""
    if not is_numpy_array(x):
        return x0 + xp.cumulative_sum(x, axis=-1), y0 + xp.cumulative_sum(y, axis=-1)
    both = np.empty(x.shape, dtype=np.result_type(x, np.complex64))
    both.real, both.imag = x, y
    both[..., :1] += x0 + 1j * y0
    both = np.cumsum(both, axis=-1)
    return both.real, both.imag


def _running(xp: Any, parts: Columns, starts: Sequence[float]) -> list[Array]:
    """Running sums of several columns, each from its start."""
    sums: list[Array] = []
    for k in range(0, len(parts) - 1, 2):
        sums += _two_sums(xp, parts[k], parts[k + 1], starts[k], starts[k + 1])
    return [*sums, starts[-1] + xp.cumulative_sum(parts[-1], axis=-1)] if len(parts) % 2 else sums


def _shifted(xp: Any, part: Array, first: Array | None) -> Array:
    """The values of the step before, beginning with `first`, or with zero."""
    if first is None:
        first = xp.zeros_like(part[..., :1])
    return xp.concat([first, part[..., :-1]], axis=-1)


def _commutator(a: Columns, b: Columns) -> tuple[Array, Array]:
    """x and y of the Lie bracket [a, b] of se(2); its theta is zero."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]
