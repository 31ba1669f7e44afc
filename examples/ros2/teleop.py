"""Drive a robot from the keyboard of a terminal, without a launch file.

    trundle ros2 --robot examples/differential/robot.yaml --simulate      # in one terminal
    python examples/ros2/teleop.py                                        # in another

The speed is sent twenty times a second; whoever stops sending stops the robot.
"""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty

import rclpy
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import Trigger

HELP = """w, s: faster, slower    a, d: turn left, right    space: stop
e: emergency stop    r: release it (then press space)    q: quit"""
STEP = {"w": (0.1, 0.0), "s": (-0.1, 0.0), "a": (0.0, 0.2), "d": (0.0, -0.2)}  # m/s, rad/s
SERVICES = {"e": "/trundle/emergency_stop", "r": "/trundle/release"}
PERIOD = 0.05


def main() -> None:
    """Read keys until `q`, Ctrl-C or the end of the input."""
    rclpy.init()
    node = rclpy.create_node("teleop")
    publisher = node.create_publisher(TwistStamped, "cmd_vel", 10)
    clients = {key: node.create_client(Trigger, name) for key, name in SERVICES.items()}
    node.create_subscription(Odometry, "odom", show, 1)
    print(HELP, flush=True)
    command, speed, turn = TwistStamped(), 0.0, 0.0
    try:
        while (key := key_within(PERIOD)) not in ("q", "end"):
            if key in clients:
                clients[key].call_async(Trigger.Request())
            if key in (" ", "e", "r"):
                speed = turn = 0.0
            faster, tighter = STEP.get(key, (0.0, 0.0))
            speed, turn = round(speed + faster, 3), round(turn + tighter, 3)
            command.header.stamp = node.get_clock().now().to_msg()
            command.header.frame_id = "base_link"
            command.twist.linear.x, command.twist.angular.z = speed, turn
            publisher.publish(command)
            rclpy.spin_once(node, timeout_sec=0.0)
    except KeyboardInterrupt:
        pass
    finally:
        if rclpy.ok():
            publisher.publish(TwistStamped(header=command.header))  # zero
            time.sleep(0.1)
        rclpy.try_shutdown()
        print()


def show(odometry: Odometry) -> None:
    """Where the robot thinks it is."""
    position, twist = odometry.pose.pose.position, odometry.twist.twist
    where = f"x {position.x:6.2f} m  y {position.y:6.2f} m"
    print(f"\r{where}  {twist.linear.x:5.2f} m/s  {twist.angular.z:5.2f} rad/s ", end="", flush=True)


def key_within(seconds: float) -> str:
    """The key that is pressed within this time, "" if none is, "end" where no more can come."""
    if not select.select([sys.stdin], [], [], seconds)[0]:
        return ""
    return os.read(sys.stdin.fileno(), 1).decode(errors="replace") or "end"


if __name__ == "__main__":
    terminal = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        main()
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, terminal)
