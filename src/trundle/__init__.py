"""Trundle: drive kinematics and wheel odometry for wheeled robots.

Describe a robot once; then velocity commands become wheel commands, wheel readings become poses
with honest uncertainty, and logs become trajectories, calibrations and pictures.

    import trundle as tr

    drive = tr.Differential(track_width=0.20, wheel_radius=0.042)
    command = drive.inverse(tr.Twist2D(1.0, 0.0, 0.5))
    twist = drive.forward(command)

Names load when they are first used, so that importing Trundle costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trundle.errors import (
        ConfigError,
        Infeasible,
        InputError,
        LogCorrupt,
        LogError,
        LogLimit,
        LogSchema,
        LogTruncated,
        MissingExtra,
        OutputError,
        ShapeError,
        Singular,
        TrundleError,
        Unobservable,
    )
    from trundle.geometry import Pose2D, Twist2D, wrap
    from trundle.odometry import Integrator, OdometryState, WheelOdometry
    from trundle.odometry.integrate import integrate, integrate_batch
    from trundle.records import Reading, Trajectory, WheelLog
    from trundle.robot import (
        Ackermann,
        Bicycle,
        Custom,
        Differential,
        Encoder,
        FourWheelSteering,
        Kinematics,
        Limits,
        Mecanum,
        Noise,
        Omni,
        Robot,
        SkidSteer,
        Swerve,
        TrackingWheels,
        Tricycle,
        Wheel,
        WheelCommand,
        WheelKind,
    )

__version__ = "0.1.0"

_HOMES = {
    "trundle.errors": (
        "ConfigError",
        "Infeasible",
        "InputError",
        "LogCorrupt",
        "LogError",
        "LogLimit",
        "LogSchema",
        "LogTruncated",
        "MissingExtra",
        "OutputError",
        "ShapeError",
        "Singular",
        "TrundleError",
        "Unobservable",
    ),
    "trundle.geometry": ("Pose2D", "Twist2D", "wrap"),
    "trundle.odometry": ("Integrator", "OdometryState", "WheelOdometry"),
    "trundle.odometry.integrate": ("integrate", "integrate_batch"),
    "trundle.records": ("Reading", "Trajectory", "WheelLog"),
    "trundle.robot": (
        "Ackermann",
        "Bicycle",
        "Custom",
        "Differential",
        "Encoder",
        "FourWheelSteering",
        "Kinematics",
        "Limits",
        "Mecanum",
        "Noise",
        "Omni",
        "Robot",
        "SkidSteer",
        "Swerve",
        "TrackingWheels",
        "Tricycle",
        "Wheel",
        "WheelCommand",
        "WheelKind",
    ),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [  # noqa: PLE0604 - a test holds it equal to what the block above imports
    *sorted(_HOME),
    "__version__",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'trundle' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
