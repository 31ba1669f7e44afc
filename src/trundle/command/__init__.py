"""Commands: from a wanted twist to what the motors are told, within limits, with the reason why."""

from trundle.command.arc import Arc, arc, arc_of_sides
from trundle.command.envelope import Envelope
from trundle.command.feedforward import FeedForward
from trundle.command.frame import about, discretize, to_field, to_robot
from trundle.command.joystick import (
    SideEfforts,
    arcade_drive,
    curvature_drive,
    dead_band,
    joystick_twist,
    tank_drive,
)
from trundle.command.motor import Motor
from trundle.command.motor_units import MotorUnit, MotorUnits
from trundle.command.pipeline import CommandPipeline, DriveCommand, PipelineState
from trundle.command.ramp import Ramp, RampState
from trundle.command.reason import Reason
from trundle.command.saturation import Achieved, Saturation, saturate
from trundle.command.smoothing import RollingMean, RollingMeanState, SmoothedSpeed, WindowedSpeed, WindowState
from trundle.command.steering import Flip, Steering, SteeringState
from trundle.command.watchdog import Demand, Latch, Rejection, Watchdog, WatchdogState
from trundle.command.wheel_acceleration import Acceleration2D, WheelAcceleration, inverse_acceleration

__all__ = [
    "Acceleration2D",
    "Achieved",
    "Arc",
    "CommandPipeline",
    "Demand",
    "DriveCommand",
    "Envelope",
    "FeedForward",
    "Flip",
    "Latch",
    "Motor",
    "MotorUnit",
    "MotorUnits",
    "PipelineState",
    "Ramp",
    "RampState",
    "Reason",
    "Rejection",
    "RollingMean",
    "RollingMeanState",
    "Saturation",
    "SideEfforts",
    "SmoothedSpeed",
    "Steering",
    "SteeringState",
    "Watchdog",
    "WatchdogState",
    "WheelAcceleration",
    "WindowState",
    "WindowedSpeed",
    "about",
    "arc",
    "arc_of_sides",
    "arcade_drive",
    "curvature_drive",
    "dead_band",
    "discretize",
    "inverse_acceleration",
    "joystick_twist",
    "saturate",
    "tank_drive",
    "to_field",
    "to_robot",
]
