"""Logs, and what is known of where the robot really went, to a description with better numbers."""

from trundle.calibrate.calibration import Calibration, Estimate, RunFit, Unobserved
from trundle.calibrate.procedure import calibrate
from trundle.calibrate.run import Closed, Reference, Rolled, Run, Spun

__all__ = [
    "Calibration",
    "Closed",
    "Estimate",
    "Reference",
    "Rolled",
    "Run",
    "RunFit",
    "Spun",
    "Unobserved",
    "calibrate",
]
