"""The TurtleBot's differential model: wheels, the centre of curvature (ICC), and the velocity in the world.

python examples/turtlebot_icc.py
"""

from __future__ import annotations

import math

import trundle as tr
from trundle.command import arc_of_sides, to_field

WHEEL_RADIUS, TRACK_WIDTH = 0.033, 0.160  # r and L of a TurtleBot3 Burger


def main() -> None:
    """Print the model for a few pairs of wheel speeds."""
    drive = tr.Differential(track_width=TRACK_WIDTH, wheel_radius=WHEEL_RADIUS)
    print(" w_l   w_r [rad/s]     R [m]  curvature  v_x [m/s]   omega   ICC in the body [m]")
    for left, right in ((4.0, 6.0), (6.0, 4.0), (5.0, 5.0), (-5.0, 5.0), (0.0, 0.0)):
        motion = arc_of_sides(WHEEL_RADIUS * left, WHEEL_RADIUS * right, TRACK_WIDTH)
        twist = drive.forward((left, right))
        x, y = drive.icr(twist)
        print(
            f"{left:+5.1f} {right:+5.1f}  {motion.radius:+13.3f}  {motion.curvature:+9.3f}  {twist.vx:+9.4f}"
            f"  {twist.omega:+6.3f}   ({x:+.3f}, {y:+.3f})"
        )

    heading = math.radians(30.0)
    field = to_field(drive.forward((4.0, 6.0)), heading)
    print(
        f"\nat a heading of 30 degrees: v_gx {field.vx:.4f}, v_gy {field.vy:.4f} m/s, omega {field.omega:.3f}"
    )

    twist = drive.forward((4.0, 6.0))
    once_around = tr.Pose2D.exp(twist * (math.tau / twist.omega))
    print(
        f"held until it has turned once: {math.hypot(once_around.x, once_around.y):.1e} m from where it began"
    )


if __name__ == "__main__":
    main()
