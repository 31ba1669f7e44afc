"""Road Runner's page on kinematics: three tracking wheels, and a trajectory fed forward to the wheels.

    python examples/road_runner_tracking.py

A tank robot follows ten metres of lines, an arc and a spline, first by its drive encoders and then by
tracking wheels, placed in inches as Road Runner places them.
"""

from __future__ import annotations

import math

import trundle as tr
from trundle.command import Envelope
from trundle.follow import (
    CircularArc,
    Line,
    Path,
    Ramsete,
    SpeedLimits,
    TimedPath,
    TrajectoryFollower,
    quintic_between,
)
from trundle.simulate import SimulatedRobot

PERIOD = 0.01
STANDARD_TRACKING_WHEELS = {
    "left": (2.6, 7.1, 0.0),
    "right": (2.6, -7.1, 0.0),
    "perpendicular": (-3.75, -0.15, math.radians(90.0)),
}


def course() -> Path:
    """A little more than ten metres."""
    return Path(
        [
            Line((0.0, 0.0), (2.0, 0.0)),
            CircularArc(tr.Pose2D(2.0, 0.0, 0.0), radius=1.0, angle=math.pi / 2),
            quintic_between(tr.Pose2D(3.0, 1.0, math.pi / 2), tr.Pose2D(1.0, 4.0, math.pi)),
            Line((1.0, 4.0), (-1.5, 4.0)),
        ]
    )


def follow(robot, trajectory):
    """Follow by odometry: the greatest errors [m, rad] as it sees them, and its own from the truth [m]."""
    follower = TrajectoryFollower(trajectory, Ramsete(b=300.0, zeta=0.95))
    simulated, odometry = SimulatedRobot(robot, seed=1, lag=0.01), tr.WheelOdometry(robot)
    reading, following = simulated.reading(), follower.start(0)
    error = turned = 0.0
    while True:
        state = odometry.update(time_ns=reading.time_ns, positions=reading.positions)
        guidance, following = follower.step(following, simulated.time_ns, state.pose, state.time_ns)
        wanted = trajectory.at(simulated.time_ns * 1e-9).pose
        error = max(error, guidance.deviation)
        turned = max(turned, abs(tr.wrap(wanted.theta - state.pose.theta)))
        if guidance.status.stops:
            away = math.dist((simulated.pose.x, simulated.pose.y), (state.pose.x, state.pose.y))
            return guidance.status, error, turned, away
        reading = simulated.step(robot.drive.inverse(guidance.twist), PERIOD)


def main() -> None:
    """Print the localizer's worked example, the feed-forward, and two runs."""
    localizer = tr.TrackingWheels.in_inches(STANDARD_TRACKING_WHEELS)  # radius 1 in: readings are inches
    moved = tr.Pose2D.exp(localizer.forward((10.0, 12.0, 0.5)))
    print("wheels rolled 10, 12 and 0.5 in: relativeOdometryUpdate gives")
    print(f"  {moved.x:.4f} m, {moved.y:+.4f} m, {math.degrees(moved.theta):.3f} degrees\n")

    robot = tr.Robot(
        drive=tr.Differential(track_width=0.5, wheel_radius=0.075),
        noise=tr.Noise(wheel_distance=0.02),
        limits=tr.Limits(max_wheel_speed=8.0),
    )
    limits = SpeedLimits(max_speed=0.4, max_acceleration=0.5, max_jerk=2.0, load=Envelope(robot).load)
    trajectory = TimedPath.fastest(course(), limits)
    print(f"{trajectory.path.length:.2f} m in {trajectory.duration:.1f} s; fed forward:")
    for time in (1.0, 6.5, 12.0):
        reference = trajectory.at(time)
        field, twist = reference.field_velocity, reference.twist
        left, right = robot.drive.inverse(twist).speeds
        print(
            f"  {time:4.1f} s: field ({field.vx:+.3f}, {field.vy:+.3f}) m/s, robot v {twist.vx:.3f} m/s, "
            f"omega {twist.omega:+.3f} rad/s, wheels {left:.2f}, {right:.2f} rad/s"
        )

    print("\nfollowed by odometry, 2 % of noise on the drive wheels, 0.2 % on the tracking wheels:")
    for name, measured in (
        ("drive encoders", robot),
        # Tracking wheels neither drive nor carry: they slip a tenth as much.
        ("tracking wheels", robot.with_localizer(localizer).replace(noise=tr.Noise(wheel_distance=0.002))),
    ):
        status, error, turned, away = follow(measured, trajectory)
        print(
            f"  {name}: {status.value}; at most {100 * error:.1f} cm and {math.degrees(turned):.1f} degrees "
            f"off by odometry, which is {100 * away:.1f} cm from the truth at the end"
        )


if __name__ == "__main__":
    main()
