"""Whether the covariances of a trajectory are as large as its errors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError
from trundle.evaluate.alignment import require_matched
from trundle.geometry import se2
from trundle.records import Trajectory

__all__ = ["nees"]

Floats = npt.NDArray[np.float64]

# Below this ratio of a correlation matrix's extreme eigenvalues, the covariance has no inverse.
_SINGULAR = 1e-12


def nees(estimate: Trajectory, reference: Trajectory) -> Floats:
    """Normalised estimation error squared, `e^T P^-1 e` with `e = log(estimate^-1 @ reference)`.

    Its mean over independent runs is 3 where the covariances are honest; above, they are too small.
    The samples of one run are not independent: their mean scatters far more than its count suggests.
    Odometry knows its way only since its start: compare `since_start` of both.

    Args:
        estimate: N poses with covariances of the body-frame error.
        reference: N poses, in the same frame.

    Returns:
        Shape (N,); NaN where a heading is missing or the covariance is singular.

    Raises:
        ShapeError: If the two differ in length.
        InputError: If the estimate has no covariances.

    Source:
        Bar-Shalom, Li, Kirubarajan 2001, section 5.4.2; on the group, Barfoot and Furgale 2014.
    """
    require_matched(estimate, reference, at_least=0)
    if estimate.covariances is None:
        raise InputError("the estimate has no covariances, which nees needs")
    error = se2.log(se2.compose(se2.inverse(estimate.poses), reference.poses))
    # Metres and radians, metres and kilometres: scaled by the standard deviations, they are alike.
    variance = np.diagonal(estimate.covariances, axis1=1, axis2=2)
    known = np.isfinite(estimate.covariances).all(axis=(1, 2)) & (variance > 0.0).all(axis=1)
    result = np.full(len(estimate), np.nan)
    sigma = np.sqrt(variance[known])
    correlation = estimate.covariances[known] / (sigma[:, :, None] * sigma[:, None, :])
    eigenvalues, vectors = np.linalg.eigh(correlation)
    along = np.einsum("nji,nj->ni", vectors, error[known] / sigma)
    regular = eigenvalues[:, 0] > _SINGULAR * eigenvalues[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        result[known] = np.where(regular, (along**2 / eigenvalues).sum(axis=1), np.nan)
    return result
