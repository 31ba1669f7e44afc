"""Robots: wheels, drives, and the one equation that holds for all of them."""

from trundle.robot.description import Encoder, Limits, Noise, Robot
from trundle.robot.drives import (
    DRIVES,
    Ackermann,
    Bicycle,
    Custom,
    Differential,
    FourWheelSteering,
    Mecanum,
    Omni,
    SkidSteer,
    Swerve,
    TrackingWheels,
    Tricycle,
)
from trundle.robot.kinematics import Kinematics
from trundle.robot.log_mapping import LogMapping
from trundle.robot.wheel import Wheel, WheelKind
from trundle.robot.wheel_command import WheelCommand

__all__ = [
    "DRIVES",
    "Ackermann",
    "Bicycle",
    "Custom",
    "Differential",
    "Encoder",
    "FourWheelSteering",
    "Kinematics",
    "Limits",
    "LogMapping",
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
]
