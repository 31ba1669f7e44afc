"""Robots that do not exist: courses driven by wheels with slip, noise and encoders, with known truth.

`simulate` makes a whole log of a course; `SimulatedRobot` takes one wheel command after the other.
The same seed gives the same numbers; time is data.
"""

from trundle.simulate.course import (
    Course,
    Manoeuvre,
    arc,
    figure_eight,
    glide,
    hold,
    slalom,
    slide,
    spin,
    square,
    stop,
    straight,
)
from trundle.simulate.sensor_noise import NOISELESS, Gyro
from trundle.simulate.simulated_log import WheelSlip, simulate
from trundle.simulate.simulated_robot import SimulatedReading, SimulatedRobot

__all__ = [
    "NOISELESS",
    "Course",
    "Gyro",
    "Manoeuvre",
    "SimulatedReading",
    "SimulatedRobot",
    "WheelSlip",
    "arc",
    "figure_eight",
    "glide",
    "hold",
    "simulate",
    "slalom",
    "slide",
    "spin",
    "square",
    "stop",
    "straight",
]
