"""Many steps at once: displacements to poses and covariances, as running sums over arrays.

The array twin of `WheelOdometry`'s single step; a property test holds the two together. Works on
any array library; the last axis is time, leading axes are robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from array_api_compat import is_numpy_array

from trundle.geometry import se2
from trundle.odometry.covariance import Six, mapped, outer, rotated, weighted_sum
from trundle.odometry.integrator import Integrator, commutator_factor

__all__ = ["corrected", "covariances", "drifts", "poses", "with_drifts"]

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


def covariances(xp: Any, step: Columns, noise: Six, pose: Columns, before: Six, origin: Columns) -> Six:
    """Upper triangles of the body-frame covariance after each step, each (..., steps).

    Seen from one fixed frame the adjoints vanish, the rows with theta become plain sums, and the
    rest two first-order recurrences: running sums under running products.

    Args:
        xp: Namespace of the arrays.
        step: Displacements as measured, each (..., steps).
        noise: Their covariances, each (..., steps).
        pose: Poses after each step, each (..., steps).
        before: Covariance before the first step.
        origin: Pose before the first step; the fixed frame, so keep spans short against its lever.
    """
    half = 0.5 * step[2]
    noise = mapped(noise, step, (xp.sin(half), xp.cos(half)), se2.sinc(half), se2.excess(step[2]))
    relative = _relative(xp, pose, origin)
    wxx, wxy, wyy, wxt, wyt, wtt = _adjoint(xp, noise, relative)

    ztt, ztt0 = _sums(xp, wtt, before[5])
    zxt, zxt0 = _sums(xp, wxt, before[3])
    zyt, zyt0 = _sums(xp, wyt, before[4])
    # As in `covariance.propagate`: b = w (this step), a = z (all before it).
    old, ux, uy = 1.0 - wtt / 12.0, wxt / 12.0, wyt / 12.0
    new, vx, vy = 1.0 - ztt0 / 12.0, zxt0 / 12.0, zyt0 / 12.0
    fxx = ux * (2.0 * old * zxt0 + ux * ztt0) + new * new * wxx + vx * (2.0 * new * wxt + vx * wtt)
    fyy = uy * (2.0 * old * zyt0 + uy * ztt0) + new * new * wyy + vy * (2.0 * new * wyt + vy * wtt)
    fxy = old * (ux * zyt0 + uy * zxt0) + ux * uy * ztt0
    fxy = fxy + new * new * wxy + new * (vx * wyt + vy * wxt) + vx * vy * wtt
    fxx = fxx + 0.25 * (ztt0 * wyy - 2.0 * zyt0 * wyt)
    fyy = fyy + 0.25 * (ztt0 * wxx - 2.0 * zxt0 * wxt)
    fxy = fxy + 0.25 * (zxt0 * wyt + zyt0 * wxt - ztt0 * wxy)
    grow, shrink = old * old + 0.25 * wtt, old * old - 0.25 * wtt
    total = _recurrence(xp, grow, fxx + fyy, before[0] + before[2])
    contrast = _recurrence(xp, shrink, fxx - fyy, before[0] - before[2])
    zxy = _recurrence(xp, shrink, fxy, before[1])
    fixed = (0.5 * (total + contrast), zxy, 0.5 * (total - contrast), zxt, zyt, ztt)
    return _adjoint_inverse(xp, fixed, relative)


def drifts(
    xp: Any, changes: Sequence[Columns], step: Columns, pose: Columns, before: Sequence[Columns]
) -> list[Columns]:
    """What errors of the description have done after each step, seen from the odom frame.

    Args:
        xp: Namespace of the arrays.
        changes: Per uncertain number, what one sigma of it changes in each step's displacement.
        step: Displacements, corrected, each (..., steps).
        pose: Poses after each step.
        before: The sums before the first step, per uncertain number.
    """
    dx, dy, dt = step
    x, y, heading = pose
    # Each acts where the step was at its middle.
    c, s = _direction(xp, heading - 0.5 * dt, 1.0)
    x, y = x - 0.5 * (c * dx - s * dy), y - 0.5 * (s * dx + c * dy)
    found: list[Columns] = []
    for (px, py, pt), start in zip(changes, before, strict=True):
        parts = (c * px - s * py + y * pt, s * px + c * py - x * pt, pt)
        sums = (xp.cumulative_sum(part, axis=-1) for part in parts)
        found.append([first + total for first, total in zip(start, sums, strict=True)])
    return found


def with_drifts(xp: Any, six: Six, sums: Sequence[Columns], pose: Columns) -> Six:
    """Covariances with the errors of the description, each of one sigma, added."""
    x, y, heading = pose
    c, s = xp.cos(heading), xp.sin(heading)
    terms = [six]
    for gx, gy, gt in sums:
        ux, uy = gx - y * gt, gy + x * gt
        terms.append(outer((c * ux + s * uy, c * uy - s * ux, gt)))
    return weighted_sum([1.0] * len(terms), terms)


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


def _two_sums(xp: Any, x: Array, y: Array) -> tuple[Array, Array]:
    """Running sums. Each waits for the one before it, and NumPy's complex ones wait for two at a time."""
    if not is_numpy_array(x):
        return xp.cumulative_sum(x, axis=-1), xp.cumulative_sum(y, axis=-1)
    both = np.empty(x.shape, dtype=np.result_type(x, np.complex64))
    both.real, both.imag = x, y
    both = np.cumsum(both, axis=-1)
    return both.real, both.imag


def _shifted(xp: Any, part: Array, first: Array | None) -> Array:
    """The values of the step before, beginning with `first`, or with zero."""
    if first is None:
        first = xp.zeros_like(part[..., :1])
    return xp.concat([first, part[..., :-1]], axis=-1)


def _commutator(a: Columns, b: Columns) -> tuple[Array, Array]:
    """x and y of the Lie bracket [a, b] of se(2); its theta is zero."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2]


def _sums(xp: Any, part: Array, start: Array) -> tuple[Array, Array]:
    """Running sums after and before each step."""
    after = start + xp.cumulative_sum(part, axis=-1)
    return after, after - part


def _recurrence(xp: Any, factor: Array, term: Array, start: Array) -> Array:
    """y after each step of `y <- factor y + term`."""
    product = xp.cumulative_prod(factor, axis=-1)
    return product * (start + xp.cumulative_sum(term / product, axis=-1))


def _relative(xp: Any, pose: Columns, origin: Columns) -> Columns:
    x, y = pose[0] - origin[0], pose[1] - origin[1]
    c, s = xp.cos(origin[2]), xp.sin(origin[2])
    return c * x + s * y, c * y - s * x, pose[2] - origin[2]


def _adjoint(xp: Any, six: Six, pose: Columns) -> Six:
    """Ad S Ad^T: body-frame covariances seen from the frame that the poses are in."""
    x, y, heading = pose
    xx, xy, yy, xt, yt, tt = rotated(six, xp.cos(heading), xp.sin(heading))
    zxt, zyt = xt + y * tt, yt - x * tt
    return (xx + y * (xt + zxt), xy - x * xt + y * zyt, yy - x * (yt + zyt), zxt, zyt, tt)


def _adjoint_inverse(xp: Any, six: Six, pose: Columns) -> Six:
    """The way back."""
    x, y, heading = pose
    zxx, zxy, zyy, zxt, zyt, tt = six
    xt, yt = zxt - y * tt, zyt + x * tt
    moved = (zxx - y * (xt + zxt), zxy + x * xt - y * zyt, zyy + x * (yt + zyt), xt, yt, tt)
    return rotated(moved, xp.cos(heading), -xp.sin(heading))
