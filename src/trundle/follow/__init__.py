"""Following: paths, profiles and controllers, from a pose to a wanted body twist. Knows no drive.

Paths are curves measured by distance, trajectories are paths with times. Controllers are immutable and
their states explicit: the same state, pose and time give the same twist.
"""

from trundle.follow.circular_arc import CircularArc
from trundle.follow.curve import Curve, CurvePoint, project
from trundle.follow.goal import GoToAngle, GoToGoal, GoToPose
from trundle.follow.guidance import Guidance, Status, Supervision
from trundle.follow.hermite import Knot, cubic_hermite, quintic_between, quintic_hermite
from trundle.follow.holonomic import HolonomicPid, HolonomicState
from trundle.follow.line import Line
from trundle.follow.path import Path, PathPoint
from trundle.follow.path_speed import SpeedLimits, profile_along
from trundle.follow.pid import Pid
from trundle.follow.profile import Profile, ProfilePoint, s_curve, trapezoid
from trundle.follow.pure_pursuit import PurePursuit, PursuitState
from trundle.follow.ramsete import Ramsete
from trundle.follow.spline import Spline
from trundle.follow.timed_path import Reference, TimedPath
from trundle.follow.trajectory_follower import Controller, FollowerState, TrajectoryFollower
from trundle.follow.unicycle import point_forward, regulate_heading, within_limits
from trundle.follow.waypoints import spline_through

__all__ = [
    "CircularArc",
    "Controller",
    "Curve",
    "CurvePoint",
    "FollowerState",
    "GoToAngle",
    "GoToGoal",
    "GoToPose",
    "Guidance",
    "HolonomicPid",
    "HolonomicState",
    "Knot",
    "Line",
    "Path",
    "PathPoint",
    "Pid",
    "Profile",
    "ProfilePoint",
    "PurePursuit",
    "PursuitState",
    "Ramsete",
    "Reference",
    "SpeedLimits",
    "Spline",
    "Status",
    "Supervision",
    "TimedPath",
    "TrajectoryFollower",
    "cubic_hermite",
    "point_forward",
    "profile_along",
    "project",
    "quintic_between",
    "quintic_hermite",
    "regulate_heading",
    "s_curve",
    "spline_through",
    "trapezoid",
    "within_limits",
]
