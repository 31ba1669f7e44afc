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
    from trundle.adapters.log import read_log
    from trundle.adapters.robot_yaml import load_robot, save_robot
    from trundle.adapters.ros2_controllers import controllers_text, robot_from_controllers
    from trundle.adapters.trajectory import read_trajectory, write_trajectory
    from trundle.adapters.urdf import robot_from_urdf
    from trundle.adapters.wheel_log_csv import write_log
    from trundle.command import CommandPipeline, FeedForward, MotorUnits, Saturation, Watchdog, saturate
    from trundle.errors import (
        CalibrationError,
        ConfigError,
        Inconsistent,
        Infeasible,
        InputError,
        LogCorrupt,
        LogError,
        LogLimit,
        LogSchema,
        LogTruncated,
        MissingExtra,
        NotConverged,
        OutputError,
        PathError,
        ShapeError,
        Singular,
        TooFewData,
        TrundleError,
        Unobservable,
    )
    from trundle.evaluate import Comparison, compare
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
        LogMapping,
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

__all__ = [
    "Ackermann",
    "Bicycle",
    "CalibrationError",
    "CommandPipeline",
    "Comparison",
    "ConfigError",
    "Custom",
    "Differential",
    "Encoder",
    "FeedForward",
    "FourWheelSteering",
    "Inconsistent",
    "Infeasible",
    "InputError",
    "Integrator",
    "Kinematics",
    "Limits",
    "LogCorrupt",
    "LogError",
    "LogLimit",
    "LogMapping",
    "LogSchema",
    "LogTruncated",
    "Mecanum",
    "MissingExtra",
    "MotorUnits",
    "Noise",
    "NotConverged",
    "OdometryState",
    "Omni",
    "OutputError",
    "PathError",
    "Pose2D",
    "Reading",
    "Robot",
    "Saturation",
    "ShapeError",
    "Singular",
    "SkidSteer",
    "Swerve",
    "TooFewData",
    "TrackingWheels",
    "Trajectory",
    "Tricycle",
    "TrundleError",
    "Twist2D",
    "Unobservable",
    "Watchdog",
    "Wheel",
    "WheelCommand",
    "WheelKind",
    "WheelLog",
    "WheelOdometry",
    "__version__",
    "compare",
    "controllers_text",
    "integrate",
    "integrate_batch",
    "load_robot",
    "read_log",
    "read_trajectory",
    "robot_from_controllers",
    "robot_from_urdf",
    "saturate",
    "save_robot",
    "wrap",
    "write_log",
    "write_trajectory",
]

# Where each name lives; tests/test_house.py holds this, `__all__` and the imports above together.
_HOMES = {
    "trundle.adapters.log": "read_log",
    "trundle.adapters.robot_yaml": "load_robot save_robot",
    "trundle.adapters.ros2_controllers": "controllers_text robot_from_controllers",
    "trundle.adapters.trajectory": "read_trajectory write_trajectory",
    "trundle.adapters.urdf": "robot_from_urdf",
    "trundle.adapters.wheel_log_csv": "write_log",
    "trundle.command": "CommandPipeline FeedForward MotorUnits Saturation Watchdog saturate",
    "trundle.errors": (
        "CalibrationError ConfigError Inconsistent Infeasible InputError LogCorrupt "
        "LogError LogLimit LogSchema LogTruncated MissingExtra NotConverged OutputError "
        "PathError ShapeError Singular TooFewData TrundleError Unobservable "
    ),
    "trundle.evaluate": "Comparison compare",
    "trundle.geometry": "Pose2D Twist2D wrap",
    "trundle.odometry": "Integrator OdometryState WheelOdometry",
    "trundle.odometry.integrate": "integrate integrate_batch",
    "trundle.records": "Reading Trajectory WheelLog",
    "trundle.robot": (
        "Ackermann Bicycle Custom Differential Encoder FourWheelSteering Kinematics "
        "Limits LogMapping Mecanum Noise Omni Robot SkidSteer Swerve TrackingWheels "
        "Tricycle Wheel WheelCommand WheelKind "
    ),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'trundle' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
