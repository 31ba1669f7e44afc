"""Wheel readings to poses, live and in whole logs, with honest uncertainty."""

from trundle.odometry.integrator import Integrator
from trundle.odometry.wheel_odometry import OdometryState, WheelOdometry

__all__ = ["Integrator", "OdometryState", "WheelOdometry"]
