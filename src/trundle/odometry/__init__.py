"""Wheel readings to poses, live and in whole logs, with honest uncertainty.

`integrate` and `integrate_batch` stand in `trundle.odometry.integrate` and are handed on by `trundle`
itself: this package stays free of NumPy for the live path.
"""

from trundle.odometry.integrator import Integrator
from trundle.odometry.wheel_odometry import OdometryState, WheelOdometry

__all__ = ["Integrator", "OdometryState", "WheelOdometry"]
