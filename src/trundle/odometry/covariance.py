"""Uncertainty of a pose that wheels measured, carried on the group.

The covariance is that of the body-frame error e in `true = estimate @ exp(e)`, order (x, y, theta).
Along a step D with noise Q (of D) it goes by `S <- Ad S Ad^T + Jr Q Jr^T` with `Ad` the adjoint of
`exp(-D)` and `Jr` the right Jacobian, and to fourth order by the terms that errors of heading and
position make together: without them 100 m with 20 degrees are 200 times too sure of themselves.

Source:
    Barfoot and Furgale 2014, "Associating uncertainty with three-dimensional poses", eq. 55,
    mirrored to body-frame errors. Theirs has `A b + b A^T`; here `(1 + A) b (1 + A)^T`, which is
    equal to fourth order and never leaves the positive semi-definite matrices.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from trundle.geometry.angle import excess, sinc

__all__ = [
    "ANY_HEADING",
    "ZERO",
    "Matrix",
    "Six",
    "in_odom_frame",
    "is_covariance",
    "mapped",
    "matrix",
    "mean_offset",
    "outer",
    "propagate",
    "rotated",
    "weighted_sum",
    "within_circle",
]

Six = tuple[float, float, float, float, float, float]
"""Upper triangle of a symmetric 3 x 3 matrix: xx, xy, yy, x-theta, y-theta, theta-theta."""

Matrix = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]

ANY_HEADING = math.pi**2 / 3.0
"""Variance of a heading of which nothing is known [rad^2]: more than a circle does not hold."""

ZERO: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def matrix(six: Six) -> Matrix:
    """The full symmetric matrix."""
    xx, xy, yy, xt, yt, tt = six
    return ((xx, xy, xt), (xy, yy, yt), (xt, yt, tt))


def is_covariance(six: Sequence[float]) -> bool:
    """Whether six numbers are the upper triangle of a positive semi-definite matrix."""
    if len(six) != 6:
        return False
    xx, xy, yy, xt, yt, tt = six
    minors = (xx * yy - xy * xy, xx * tt - xt * xt, yy * tt - yt * yt)
    sizes = (xx * yy, xx * tt, yy * tt)
    whole = xx * (yy * tt - yt * yt) - xy * (xy * tt - yt * xt) + xt * (xy * yt - yy * xt)
    rounding = 1e-9
    return (
        min(xx, yy, tt) >= 0.0
        and all(minor >= -rounding * size for minor, size in zip(minors, sizes, strict=True))
        and whole >= -rounding * xx * yy * tt
    )


def outer(column: Sequence[float], factor: float = 1.0) -> Six:
    """`factor * column column^T`."""
    x, y, t = column
    fx, fy = factor * x, factor * y
    return (fx * x, fx * y, fy * y, fx * t, fy * t, factor * t * t)


def weighted_sum(weights: Iterable[float], terms: Iterable[Six]) -> Six:
    """Sum of symmetric matrices, each times its weight."""
    xx = xy = yy = xt = yt = tt = 0.0
    for weight, (a, b, c, d, e, f) in zip(weights, terms, strict=True):
        xx += weight * a
        xy += weight * b
        yy += weight * c
        xt += weight * d
        yt += weight * e
        tt += weight * f
    return (xx, xy, yy, xt, yt, tt)


def within_circle(six: Six, known: float) -> Six:
    """What a covariance adds to one whose heading has the variance `known`: no more than a circle holds.

    Beyond it the terms of fourth order, which are a series in that variance, would feed on each other.
    """
    xx, xy, yy, xt, yt, tt = six
    room = max(ANY_HEADING - known, 0.0)
    if tt <= room:
        return six
    share = math.sqrt(room / tt)
    return (xx, xy, yy, share * xt, share * yt, room)


def propagate(
    before: Six, step: Sequence[float], noise: Six, *, chord: bool = True, lead: float = 0.5
) -> Six:
    """Covariance after a step.

    Args:
        before: Covariance of the pose before the step.
        step: Body displacement (x, y, theta) [m, m, rad].
        noise: Covariance of the displacement.
        chord: Whether the step was walked as an arc; else as a straight line.
        lead: Along which heading: 0 the old one, 0.5 the mean.
    """
    if before[5] + noise[5] > ANY_HEADING:
        noise = within_circle(noise, before[5])
    dx, dy, angle = step
    half = 0.5 * angle
    sine, cosine = math.sin(half), math.cos(half)
    shortened = sinc(half)
    # exp(D) moves by sinc(angle / 2) R(angle / 2) (dx, dy).
    c, s = (cosine, sine) if lead else (1.0, 0.0)
    length = shortened if chord else 1.0
    px, py = length * (c * dx - s * dy), length * (s * dx + c * dy)
    axx, axy, ayy, axt, ayt, att = _moved(before, px, py, angle)
    bxx, bxy, byy, bxt, byt, btt = mapped(noise, step, (sine, cosine), shortened, excess(angle))

    # (1 + A_b / 12) a (1 + A_b / 12)^T, with A = E[ad ad] = [[-tt, 0, xt], [0, -tt, yt], [0, 0, 0]].
    shrink, ux, uy = 1.0 - btt / 12.0, bxt / 12.0, byt / 12.0
    sxx = shrink * shrink * axx + ux * (2.0 * shrink * axt + ux * att)
    sxy = shrink * shrink * axy + shrink * (ux * ayt + uy * axt) + ux * uy * att
    syy = shrink * shrink * ayy + uy * (2.0 * shrink * ayt + uy * att)
    # The same the other way round.
    shrink, ux, uy = 1.0 - att / 12.0, axt / 12.0, ayt / 12.0
    sxx += shrink * shrink * bxx + ux * (2.0 * shrink * bxt + ux * btt)
    sxy += shrink * shrink * bxy + shrink * (ux * byt + uy * bxt) + ux * uy * btt
    syy += shrink * shrink * byy + uy * (2.0 * shrink * byt + uy * btt)
    # B / 4, with B = E[ad_a b b^T ad_a^T].
    sxx += 0.25 * (att * byy - 2.0 * ayt * byt + ayy * btt)
    syy += 0.25 * (att * bxx - 2.0 * axt * bxt + axx * btt)
    sxy += 0.25 * (axt * byt + ayt * bxt - att * bxy - axy * btt)
    # The terms with theta cancel: A_a b + A_b a has none.
    return (sxx, sxy, syy, axt + bxt, ayt + byt, att + btt)


def mean_offset(six: Six, heading: float) -> tuple[float, float]:
    """How far the mean of where the robot may be lies from its pose, in the odom frame [m].

    Headings that err to either side both shorten a straight line, so the mean falls behind the pose:
    `E[exp(e)]` to second order in e.

    Args:
        six: Body-frame covariance.
        heading: Of the pose [rad].
    """
    _, _, _, xt, yt, _ = six
    c, s = math.cos(heading), math.sin(heading)
    x, y = -0.5 * yt, 0.5 * xt
    return c * x - s * y, s * x + c * y


def in_odom_frame(six: Six, heading: float) -> Six:
    """The same covariance with x and y along the axes that the pose is given in.

    For messages that want it so. The point that errs is still the robot: no adjoint.

    Args:
        six: Body-frame covariance.
        heading: Of the pose [rad].
    """
    return rotated(six, math.cos(heading), math.sin(heading))


def _moved(six: Six, px: float, py: float, angle: float) -> Six:
    """Ad S Ad^T with the adjoint of the inverse of the pose (px, py, angle)."""
    xx, xy, yy, xt, yt, tt = six
    # An error of heading before the step is one of position after it: (-py, px) per radian.
    axt, ayt = xt - py * tt, yt + px * tt
    moved = (xx - py * (xt + axt), xy - py * yt + px * axt, yy + px * (yt + ayt), axt, ayt, tt)
    return rotated(moved, math.cos(angle), -math.sin(angle))


def rotated(six: Six, c: float, s: float) -> Six:
    """R S R^T with R the turn by the angle of this cosine and sine."""
    xx, xy, yy, xt, yt, tt = six
    across = 2.0 * c * s * xy
    return (
        c * c * xx - across + s * s * yy,
        c * s * (xx - yy) + (c * c - s * s) * xy,
        s * s * xx + across + c * c * yy,
        c * xt - s * yt,
        s * xt + c * yt,
        tt,
    )


def mapped(six: Six, step: Sequence[Any], half_turn: tuple[Any, Any], chord: Any, excess: Any) -> Six:
    """Jr Q Jr^T: noise of a displacement as an error of the pose after it. Floats or arrays.

    Args:
        six: Covariance of the displacement.
        step: The displacement (x, y, theta).
        half_turn: (sin, cos) of theta / 2.
        chord: sinc(theta / 2).
        excess: (theta - sin theta) / theta^2.
    """
    dx, dy, _ = step
    sine, cosine = half_turn
    a, b = cosine * chord, sine * chord  # sin(theta) / theta and (1 - cos(theta)) / theta
    d = 0.5 * chord * chord  # (1 - cos(theta)) / theta^2
    ux, uy = excess * dx - d * dy, d * dx + excess * dy
    xx, xy, yy, xt, yt, tt = six
    # Rows of Jr are (a, b, ux), (-b, a, uy), (0, 0, 1): a turn that shrinks, then the lever.
    aa, ab, bb = a * a, a * b, b * b
    kxt, kyt = a * xt + b * yt, a * yt - b * xt
    return (
        aa * xx + 2.0 * ab * xy + bb * yy + ux * (2.0 * kxt + ux * tt),
        ab * (yy - xx) + (aa - bb) * xy + ux * kyt + uy * kxt + ux * uy * tt,
        bb * xx - 2.0 * ab * xy + aa * yy + uy * (2.0 * kyt + uy * tt),
        kxt + ux * tt,
        kyt + uy * tt,
        tt,
    )
