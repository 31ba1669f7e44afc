"""The unicycle model of K-State: its Jacobian, its steering laws, and goals reached from anywhere.

python examples/unicycle_goal.py
"""

from __future__ import annotations

import math

import trundle as tr
from trundle.command import to_field
from trundle.follow import GoToGoal, GoToPose, point_forward, regulate_heading
from trundle.simulate import SimulatedRobot

WHEEL_RADIUS, TRACK_WIDTH = 0.035, 0.20  # R and L
PERIOD = 0.02


def drive_to(robot, guide, start):
    """Drive a simulated robot by its own odometry until the law says that it has arrived."""
    simulated, odometry = SimulatedRobot(robot, pose=start, seed=1), tr.WheelOdometry(robot, pose=start)
    reading = simulated.reading()
    while True:
        state = odometry.update(time_ns=reading.time_ns, positions=reading.positions)
        guidance = guide(state.pose)
        if guidance.status.stops:
            return guidance, simulated
        reading = simulated.step(robot.drive.inverse(guidance.twist), PERIOD)


def main() -> None:
    """Print the model, both steering laws, and two goals."""
    drive = tr.Differential(track_width=TRACK_WIDTH, wheel_radius=WHEEL_RADIUS)
    print("J = d(Vx, Vp, omega) / d(v_left, v_right), m/s and rad/s per rad/s of a wheel:")
    for row in drive.jacobian():
        print("  " + "  ".join(f"{value:+.4f}" for value in row))
    v, omega = 0.3, 1.2
    left, right = drive.inverse(tr.Twist2D(v, 0.0, omega)).speeds
    print(f"V = {v} m/s, omega = {omega} rad/s: v_r = {right:.3f} rad/s, v_l = {left:.3f} rad/s")
    field = to_field(drive.forward((left, right)), math.radians(60.0))
    print(f"at a heading of 60 degrees: x' = {field.vx:.3f}, y' = {field.vy:.3f} m/s\n")

    heading, wanted = math.radians(170.0), math.radians(-170.0)
    turn = regulate_heading(heading, wanted, gain=2.0)
    twist = point_forward(heading, wanted, 0.3, distance=0.15)
    print("from 170 to -170 degrees, at 0.3 m/s:")
    print(
        f"  proportional regulator: omega = {turn:+.3f} rad/s (20 degrees to the left, not 340 to the right)"
    )
    print(f"  point forward steering: v = {twist.vx:.3f} m/s, omega = {twist.omega:+.3f} rad/s\n")

    robot = tr.Robot(drive=drive, noise=tr.Noise(wheel_distance=0.005))
    start = tr.Pose2D(-1.5, 1.0, math.radians(200.0))
    to_goal, to_pose = GoToGoal(max_speed=0.5, max_yaw_rate=2.0), GoToPose(max_speed=0.5, max_yaw_rate=2.0)
    goal = tr.Pose2D(1.0, 0.0, math.radians(90.0))
    for name, guide in (
        ("go to goal", lambda pose: to_goal.guide(pose, (goal.x, goal.y))),
        ("go to pose", lambda pose: to_pose.guide(pose, goal)),
    ):
        guidance, simulated = drive_to(robot, guide, start)
        pose = simulated.pose
        print(
            f"{name}: {guidance.status.value} after {simulated.time_ns / 1e9:.1f} s, "
            f"{1000 * guidance.deviation:.0f} mm away by odometry, "
            f"{1000 * math.dist((pose.x, pose.y), (goal.x, goal.y)):.0f} mm in truth, "
            f"heading {math.degrees(tr.wrap(pose.theta)):.0f} degrees"
        )


if __name__ == "__main__":
    main()
