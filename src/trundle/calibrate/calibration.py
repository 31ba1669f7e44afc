"""What a calibration found, how sure it is, and what it could not tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.records import Trajectory
from trundle.robot import Robot

__all__ = ["Calibration", "Estimate", "RunFit", "Unobserved"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One number.

    Attributes:
        name: `wheel_radius.left`, `track_width`, `reference.x`, `clock`, `steering.front.offset`, ...
        unit: Of the numbers; empty where they have none.
        nominal: What the description said.
        value: What the logs say.
        sigma: Standard deviation of that.
        doubt: Why a person should look at it first; empty where there is no reason.
    """

    name: str
    unit: str
    nominal: float
    value: float
    sigma: float
    doubt: str = ""


@dataclass(frozen=True, slots=True)
class Unobserved:
    """Something that the logs do not tell.

    Attributes:
        names: Of the parameters that cannot be told, or not apart.
        words: One sentence for people.
        manoeuvre: What to drive to know it.
        sigmas: What that would reach, one standard deviation each, in the units of the parameters; none where
            it would not tell them either.
    """

    names: tuple[str, ...]
    words: str
    manoeuvre: str = ""
    sigmas: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class RunFit:
    """One run before and after.

    Attributes:
        name: Of the run.
        before: Path of the tracked point by the description, in the reference's frame.
        after: The same by what was found.
        reference: Where it really was; None where only a tape measure knows.
        residuals: What is left of each sample after the calibration, in standard deviations.
    """

    name: str
    before: Trajectory
    after: Trajectory
    reference: Trajectory | None
    residuals: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A robot with better numbers.

    Attributes:
        robot: The description with what was found in it.
        estimates: The numbers.
        covariance: Of all of them, in their order and units.
        chi2_per_dof: Chi-square per degree of freedom, before sigmas were scaled by it.
        condition: Of the information about them, each in units of its size.
        samples: How many samples of references there were.
        inliers: How many of them agreed.
        unobserved: What the logs could not tell.
        fits: One per run.
        warnings: What a person should know, as sentences.
        iterations: How many steps it took.
    """

    robot: Robot
    estimates: tuple[Estimate, ...]
    covariance: Floats
    chi2_per_dof: float
    condition: float
    samples: int
    inliers: int
    unobserved: tuple[Unobserved, ...] = ()
    fits: tuple[RunFit, ...] = ()
    warnings: tuple[str, ...] = ()
    iterations: int = 0
