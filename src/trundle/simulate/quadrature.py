"""Integrals over time, so exact that what they give can be called the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

__all__ = ["Quadrature"]

Floats = npt.NDArray[np.float64]

# Gauss-Legendre collocation with three nodes, order 6. Source: Hairer, Lubich, Wanner 2006,
# "Geometric Numerical Integration", table II.1.2.
_R = math.sqrt(15.0)
_NODES = np.array([0.5 - _R / 10.0, 0.5, 0.5 + _R / 10.0])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
_INSIDE = np.array(
    [
        [5.0 / 36.0, 2.0 / 9.0 - _R / 15.0, 5.0 / 36.0 - _R / 30.0],
        [5.0 / 36.0 + _R / 24.0, 2.0 / 9.0, 5.0 / 36.0 - _R / 24.0],
        [5.0 / 36.0 + _R / 30.0, 2.0 / 9.0 + _R / 15.0, 5.0 / 36.0],
    ]
)


class Quadrature:
    """Sub-steps from sample to sample, with three nodes in each.

    Args:
        samples: Moments at which integrals are wanted [s], ascending, shape (samples,).
        knots: Moments that no sub-step may cross [s].
        longest: Longest sub-step [s].

    Attributes:
        samples: As given.
        nodes: Moments at which integrands are to be given, shape (sub-steps, 3).
        interval: Which interval between samples each sub-step belongs to, shape (sub-steps,).
    """

    def __init__(self, samples: Floats, knots: Sequence[float] = (), *, longest: float = 0.01) -> None:
        self.samples = samples
        inside = [knot for knot in knots if samples[0] < knot < samples[-1]]
        marks = np.union1d(samples, inside)
        gaps = np.diff(marks)
        parts = np.maximum(np.ceil(gaps / longest), 1.0).astype(np.int64)
        self._length = np.repeat(gaps / parts, parts)
        first = np.cumsum(parts) - parts
        part = np.arange(len(self._length)) - np.repeat(first, parts)
        begin = np.repeat(marks[:-1], parts) + part * self._length
        self.nodes = begin[:, np.newaxis] + self._length[:, np.newaxis] * _NODES
        ends = np.append(first, len(self._length))
        self._at_samples = ends[np.searchsorted(marks, samples)]
        self.interval = np.repeat(np.arange(len(samples) - 1), np.diff(self._at_samples))

    def __call__(self, integrand: Floats) -> Floats:
        """The integral from the first sample to every sample, shape (samples, ...).

        Args:
            integrand: Its values at the nodes, shape (sub-steps, 3, ...).
        """
        integral: Floats = self._running(integrand)[self._at_samples]
        return integral

    def at_nodes(self, integrand: Floats) -> Floats:
        """The integral from the first sample to every node, shape (sub-steps, 3)."""
        a, b, c = integrand.T
        inside = [self._length * (row[0] * a + row[1] * b + row[2] * c) for row in _INSIDE]
        integral: Floats = self._running(integrand)[:-1, np.newaxis] + np.stack(inside, axis=-1)
        return integral

    def poses(self, twists: Floats, start: Sequence[float] = (0.0, 0.0, 0.0)) -> Floats:
        """Where a body twist leads: the pose (x, y, theta) at every sample, shape (samples, 3).

        Once the heading is known, the way is a plain integral: nothing is solved step by step.

        Args:
            twists: Body twists at the nodes, shape (sub-steps, 3, 3).
            start: Pose at the first sample.
        """
        vx, vy, omega = twists[..., 0], twists[..., 1], twists[..., 2]
        heading = start[2] + self.at_nodes(omega)
        c, s = np.cos(heading), np.sin(heading)
        return np.asarray(start) + self(np.stack([c * vx - s * vy, s * vx + c * vy, omega], axis=-1))

    def _running(self, integrand: Floats) -> Floats:
        """The integral up to every edge of a sub-step."""
        a, b, c = integrand[:, 0], integrand[:, 1], integrand[:, 2]
        steps = (_WEIGHTS[0] * a + _WEIGHTS[1] * b + _WEIGHTS[2] * c).T * self._length
        return np.concatenate([np.zeros_like(steps[..., :1]), np.cumsum(steps, axis=-1)], axis=-1).T
