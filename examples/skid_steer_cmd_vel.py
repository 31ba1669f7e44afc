"""A skid-steer and a mecanum robot follow `cmd_vel`: from Twist messages to motor counts per second.

    python examples/skid_steer_cmd_vel.py

What Kohanbash's "Drive Kinematics: Skid Steer & Mecanum" computes, on a robot with limits, mirrored motors,
and a source of commands that dies.
"""

from __future__ import annotations

from types import SimpleNamespace

import trundle as tr
from trundle.command import CommandPipeline, MotorUnits, Watchdog, WatchdogState, arc

MS = 1_000_000
PERIOD = 50 * MS
NAMES = ("front_left", "front_right", "rear_left", "rear_right")


def cmd_vel(x: float, y: float, z: float) -> SimpleNamespace:
    """A message that looks like geometry_msgs/Twist."""
    return SimpleNamespace(linear=SimpleNamespace(x=x, y=y), angular=SimpleNamespace(z=z))


def counted(numbers) -> str:
    """The numbers, one below the other in every line."""
    return "  ".join(f"{number:+9.1f}" for number in numbers)


def main() -> None:
    """Print arcs, three seconds of commands, and mecanum there and back."""
    encoders = {
        name: tr.Encoder(ticks_per_revolution=2048, inverted=name.endswith("right")) for name in NAMES
    }
    limits = tr.Limits(max_speed=1.0, max_yaw_rate=1.5, max_acceleration=1.0, max_wheel_speed=12.0)
    skid_steer = tr.Robot(
        drive=tr.SkidSteer(track_width=0.55, wheelbase=0.45, wheel_radius=0.11),
        encoders=encoders,
        limits=limits,
    )

    left, right = arc(2.0, speed=0.8).sides(0.55)
    print(f"an arc of 2 m at 0.8 m/s: left {left:.3f} m/s, right {right:.3f} m/s")
    spot = arc(0.0, yaw_rate=1.0).sides(0.55)
    print(f"a turn on the spot at 1 rad/s: left {spot[0]:.3f} m/s, right {spot[1]:.3f} m/s\n")

    print("skid steer, counts/s (FL FR RL RR; the right motors are mirrored)")
    dog = Watchdog(timeout=limits.command_lifetime)
    pipeline, motors = CommandPipeline(skid_steer, period=PERIOD / 1e9), MotorUnits(skid_steer, "counts/s")
    watched, state = WatchdogState(), pipeline.start()
    message = cmd_vel(1.6, 0.0, 0.8)  # faster than it may
    for step in range(60):
        now = step * PERIOD
        if now <= 1_400 * MS:  # then the joystick is unplugged
            twist = tr.Twist2D(message.linear.x, message.linear.y, message.angular.z)
            watched = dog.receive(watched, twist, now)
        command, state = pipeline.step(state, dog.demand(watched, now), now)
        if step % 10 == 0 or step == 38:
            why = ", ".join(reason.name for reason in command.reasons)
            print(f"{now / 1e9:5.2f} s  {counted(motors.to_motor(command.wheels.speeds))}  {why}")

    print("\nmecanum, rad/s (FL FR RL RR)")
    mecanum = tr.Mecanum(track_width=0.55, wheelbase=0.45, wheel_radius=0.11)
    for x, y, z in ((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 1.0)):
        wheels = mecanum.inverse(tr.Twist2D(x, y, z))
        back = mecanum.forward(wheels)
        print(f"linear ({x}, {y}), angular {z}:  {counted(wheels.speeds)}")
        print(f"  and back: ({back.vx:.3f}, {back.vy:.3f}), {back.omega:.3f}")


if __name__ == "__main__":
    main()
