"""One drive of a robot, and what is known of where it went."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from trundle.errors import InputError, require_finite, require_positive
from trundle.records import Trajectory, WheelLog

__all__ = ["Closed", "Reference", "Rolled", "Run", "Spun"]


@dataclass(frozen=True, slots=True)
class Rolled:
    """It went straight on; a tape measure says how far.

    Attributes:
        distance: From where it stood to where it stood in the end [m].
        sigma: Of the tape measure [m].
    """

    distance: float
    sigma: float = 0.002

    def __post_init__(self) -> None:
        require_positive("distance", self.distance)
        require_positive("sigma", self.sigma)


@dataclass(frozen=True, slots=True)
class Spun:
    """It turned on the spot.

    Attributes:
        angle: By which its heading changed, whole turns included [rad], left positive.
        sigma: Of the mark that it was turned back to [rad].
    """

    angle: float
    sigma: float = 0.01

    def __post_init__(self) -> None:
        require_positive("angle", abs(require_finite("angle", self.angle)))
        require_positive("sigma", self.sigma)


@dataclass(frozen=True, slots=True)
class Closed:
    """It ended where it began, and as it began.

    Attributes:
        sigma: How well it was put back [m].
        heading_sigma: And turned back [rad].
    """

    sigma: float = 0.002
    heading_sigma: float = 0.01

    def __post_init__(self) -> None:
        require_positive("sigma", self.sigma)
        require_positive("heading_sigma", self.heading_sigma)


Reference: TypeAlias = Trajectory | Rolled | Spun | Closed
"""A trajectory may lack headings (a camera that sees a dot) or positions (a gyro): NaN."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """One drive.

    Attributes:
        log: What its sensors said.
        reference: What is known of where it went; None for what the log itself holds: its reference, or else
            its gyro.
        name: For people.

    Raises:
        InputError: If the reference is a trajectory without times.
    """

    log: WheelLog
    reference: Reference | None = None
    name: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.reference, Trajectory) and not self.reference.timed:
            raise InputError(
                f"{self.name or self.log.source}: the reference has no times (KITTI files do not): "
                "nothing says which of its poses belongs to which row of the log"
            )
