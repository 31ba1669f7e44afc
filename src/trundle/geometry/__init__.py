"""Angles, poses and twists of the plane."""

from trundle.geometry.angle import wrap
from trundle.geometry.pose import Pose2D, Twist2D

__all__ = ["Pose2D", "Twist2D", "wrap"]
