"""One run as a linear problem: how its wheels drifted and which numbers would explain its fixes best.

The path that the wheels predict is off by a frame `E_k` at each fix k, `true = E_k @ predicted`, which
wanders as the wheels' noise lets it: a random walk, of which the fixes see the sum. Eliminating the frames
from the normal equations leaves those of the parameters, and that is the maximum likelihood of both noises
together. The frames' equations are block tridiagonal, so that all of it takes time linear in the fixes.

Source:
    The smoother as least squares: Rauch, Tung, Striebel 1965; as here, Dellaert, Kaess 2006.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.errors import MissingExtra

__all__ = ["REFUSED", "STILL", "Levels", "Linear", "Reduced", "eliminate", "frame_covariances"]

Floats = npt.NDArray[np.float64]

STILL = 1e-5
"""What a wheel may do between two fixes even if it stands still [m, rad]; keeps the equations solvable."""
_STIFF = 1e-8
"""And what it may do beside its noise, in parts of that variance: two wheels move a robot in two ways only,
and seen from far away the third would be lost in the rounding of their noise."""
REFUSED = 1e-6
"""A fix that is believed less than this is not believed at all."""
_START = 1e-2
"""Weight of the frame at the first fix: it may be anywhere within 10 m of where it was taken to be."""
_BREAK = 1e-8
"""Weight between two frames that have nothing to do with each other."""


@dataclass(frozen=True, slots=True)
class Levels:
    """How large the noises are.

    Attributes:
        wheels: Times what the robot's `noise` section says.
        position: Standard deviation of a reference's x and y [m].
        heading: Of its headings [rad].
    """

    wheels: float = 1.0
    position: float = 0.005
    heading: float = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """A run, linear about present numbers and frames.

    Attributes:
        residuals: Predicted minus measured components, shape (N, 3); zero where nothing was measured.
        measured: Which components were, shape (N, 3).
        by_frame: Change of a residual by a small displacement of its frame, shape (N, 3, 3).
        by_parameter: By the parameters, shape (N, 3, parameters).
        drift: Displacement from each frame to the next, shape (N - 1, 3).
        spread: Its covariance by the robot's noise section, shape (N - 1, 3, 3).
        joined: Whether the two belong together, shape (N - 1,); not where the reference jumped.
        given: Standard deviations that the reference states itself, or None.
    """

    residuals: Floats
    measured: npt.NDArray[np.bool_]
    by_frame: Floats
    by_parameter: Floats
    drift: Floats
    spread: Floats
    joined: npt.NDArray[np.bool_]
    given: tuple[float, float] | None

    def sigmas(self, levels: Levels) -> Floats:
        """Standard deviations of x, y and theta."""
        position, heading = self.given or (levels.position, levels.heading)
        return np.array([position, position, heading])


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """The normal equations of the parameters, `information @ change = -slope`.

    Attributes:
        information: Shape (parameters, parameters).
        slope: Shape (parameters,).
        chi2: Weighted squares that the best frames leave, at no change of the parameters.
        log_determinant: Of the covariance of all fixes, less a constant.
        frames: Displacement of each frame at no change, then by each parameter, shape (N, 3, 1 + parameters).
        count: Measured components, less the start that they determine.
    """

    information: Floats
    slope: Floats
    chi2: float
    log_determinant: float
    frames: Floats
    count: int


def eliminate(linear: Linear, levels: Levels, weights: Floats) -> Reduced:
    """The parameters' normal equations, the frames being what suits them best.

    Args:
        linear: The run.
        levels: How large the noises are.
        weights: How far each fix is believed, shape (N,).
    """
    count, size = len(linear.residuals), linear.by_parameter.shape[2]
    trust = linear.measured * weights[:, np.newaxis] / linear.sigmas(levels) ** 2
    bonds, log_spread = _bonds(linear, levels)
    seen = np.swapaxes(linear.by_frame, 1, 2) * trust[:, np.newaxis, :]
    pull = np.einsum("kij,kj->ki", bonds, linear.drift)
    slope = np.einsum("kij,kj->ki", seen, linear.residuals)
    slope[1:] += pull
    slope[:-1] -= pull
    mixed = seen @ linear.by_parameter
    right = np.concatenate([slope[:, :, np.newaxis], mixed], axis=2)

    band = _band(_diagonal(linear, seen, bonds), bonds)
    factor, solved = _solve(band, right.reshape(3 * count, 1 + size))
    frames = solved.reshape(count, 3, 1 + size)
    weighted = linear.by_parameter * trust[:, :, np.newaxis]
    information = np.einsum("kij,kil->jl", weighted, linear.by_parameter)
    information -= np.einsum("kij,kil->jl", mixed, frames[:, :, 1:])
    gradient = np.einsum("kij,ki->j", weighted, linear.residuals)
    gradient -= np.einsum("kij,ki->j", mixed, frames[:, :, 0])
    chi2 = float((trust * linear.residuals**2).sum() + (pull * linear.drift).sum())
    chi2 -= float((slope * frames[:, :, 0]).sum())
    # A fix that is refused says nothing of how large the noise is either.
    seen_trust = trust[(trust > 0.0) & (weights > REFUSED)[:, np.newaxis]]
    log_determinant = 2.0 * float(np.log(factor[-1]).sum()) + log_spread - float(np.log(seen_trust).sum())
    starts = int(linear.measured.any(axis=0).sum()) * (1 + int((~linear.joined).sum()))
    degrees = int(linear.measured.sum()) - starts
    return Reduced(
        0.5 * (information + information.T), gradient, chi2, log_determinant, -frames, max(degrees, 0)
    )


def frame_covariances(runs: Sequence[Linear], levels: Levels, weights: Sequence[Floats]) -> list[Floats]:
    """How sure each frame of each run is by all its fixes together, shape (N, 3, 3).

    Forth and back once, in covariances, which stay positive where information would cancel; all runs go side
    by side.

    Source:
        Rauch, Tung, Striebel 1965.
    """
    longest = max(len(one.residuals) for one in runs)
    seen = np.tile(np.eye(3), (longest, len(runs), 1, 1))
    spread = np.tile(np.eye(3) / _BREAK, (longest - 1, len(runs), 1, 1))
    for number, (one, believed) in enumerate(zip(runs, weights, strict=True)):
        trust = one.measured * believed[:, np.newaxis] / one.sigmas(levels) ** 2
        own = _spread(one, levels)
        seen[: len(own) + 1, number] = (
            np.swapaxes(one.by_frame, 1, 2) * trust[:, np.newaxis, :] @ one.by_frame
        )
        spread[: len(own), number] = own
    seen[0] += _START * np.eye(3)
    sure = np.empty_like(seen)  # by the fixes up to k
    sure[0] = _inverse(seen[0])
    before = np.empty_like(spread)  # information about k + 1 by the fixes up to k
    for k, wandered in enumerate(spread):
        before[k] = _inverse(sure[k] + wandered)
        sure[k + 1] = _inverse(before[k] + seen[k + 1])
    for k in range(longest - 2, -1, -1):
        gain = sure[k] @ before[k]
        sure[k] = gain @ (spread[k] + sure[k + 1] @ np.swapaxes(gain, 1, 2))
    return [sure[: len(one.residuals), number] for number, one in enumerate(runs)]


def _spread(linear: Linear, levels: Levels) -> Floats:
    """Covariances of the displacements between neighbours, shape (N - 1, 3, 3)."""
    noise = linear.spread * levels.wheels**2
    still = STILL**2 + _STIFF * np.trace(noise, axis1=1, axis2=2)
    found: Floats = noise + still[:, np.newaxis, np.newaxis] * np.eye(3)
    found[~linear.joined] = np.eye(3) / _BREAK
    return found


def _bonds(linear: Linear, levels: Levels) -> tuple[Floats, float]:
    """Information between neighbours, shape (N - 1, 3, 3), and the log-determinant of its inverse."""
    spread = _spread(linear, levels)
    pivots, _ = _factored(spread[linear.joined])
    return _inverse(spread), 2.0 * float(np.log(pivots).sum())


def _factored(matrices: Floats) -> tuple[Floats, Floats]:
    """Cholesky factors of symmetric matrices, shape (..., 3, 3): diagonals, and what is below, row by row."""
    a, b, c = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 0, 2]
    d, e, f = matrices[..., 1, 1], matrices[..., 1, 2], matrices[..., 2, 2]
    first = np.sqrt(a)
    below, corner = b / first, c / first
    second = np.sqrt(d - below * below)
    last = (e - below * corner) / second
    third = np.sqrt(f - corner * corner - last * last)
    return np.stack([first, second, third]), np.stack([below, corner, last])


def _inverse(matrices: Floats) -> Floats:
    """Of many small symmetric matrices, shape (..., 3, 3), by their factors: LAPACK takes them one by one.

    Cofactors are as quick, but what they make of a nearly singular matrix need not be positive.
    """
    pivots, (below, corner, last) = _factored(matrices)
    first, second, third = 1.0 / pivots
    under = -below * first * second
    beside = -last * second * third
    far = -(corner * first + last * under) * third
    xx, yy, zz = first**2 + under**2 + far**2, second**2 + beside**2, third**2
    xy, xz, yz = under * second + far * beside, far * third, beside * third
    return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(matrices.shape)


def _diagonal(linear: Linear, seen: Floats, bonds: Floats) -> Floats:
    diagonal: Floats = seen @ linear.by_frame
    diagonal[:-1] += bonds
    diagonal[1:] += bonds
    diagonal[0] += _START * np.eye(3)
    return diagonal


def _band(diagonal: Floats, bonds: Floats) -> Floats:
    """The block tridiagonal matrix in LAPACK's upper banded form, shape (6, 3 N)."""
    band = np.zeros((6, 3 * len(diagonal)))
    for i in range(3):
        for j in range(i, 3):
            band[5 + i - j, j::3] = diagonal[:, i, j]
        for j in range(3):
            band[2 + i - j, 3 + j :: 3] = -bonds[:, i, j]
    return band


def _solve(band: Floats, right: Floats) -> tuple[Floats, Floats]:
    try:
        from scipy.linalg import cho_solve_banded, cholesky_banded
    except ImportError:
        raise MissingExtra("scipy", "calibrate") from None
    factor = cholesky_banded(band, check_finite=False)
    return factor, cho_solve_banded((factor, False), right, check_finite=False)
