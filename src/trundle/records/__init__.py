"""Immutable columns with units: what sensors said, and where robots were."""

from trundle.records.trajectory import Trajectory
from trundle.records.wheel_log import Reading, WheelLog

__all__ = ["Reading", "Trajectory", "WheelLog"]
