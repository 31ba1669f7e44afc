"""`trundle inverse` and `trundle forward`: one twist, one set of wheels."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from trundle.apps.wording import aligned, labelled

if TYPE_CHECKING:
    from trundle.robot import Robot

__all__ = ["forward", "inverse"]

Numbers = Annotated[tuple[float, ...], Parameter(consume_multiple=True, negative="", show_default=False)]


def inverse(
    vx: float, vy: float, omega: float, /, *, robot: Path | None = None, drive: str | None = None
) -> None:
    """Wheel speeds and steering angles that move the robot like this.

    Args:
        vx: Forward speed [m/s].
        vy: Speed to the left [m/s].
        omega: Turning rate, counter-clockwise [rad/s].
        robot: The robot's description (robot.yaml).
        drive: In its place, the drive alone, as robot.yaml writes it:
            "{type: differential, track_width: 0.2, wheel_radius: 42 mm}".
    """
    from trundle.geometry import Twist2D

    described = _described(robot, drive)
    wheels = described.drive
    command = wheels.inverse(Twist2D(vx, vy, omega))
    steering = dict(zip(wheels.steered_names, command.steering, strict=True))
    rows = [["wheel", "[rad/s]", "[rpm]", "[m/s]"] + ["steering [rad]", "[deg]"] * bool(steering)]
    for name, speed in zip(wheels.wheel_names, command.speeds, strict=True):
        row = [speed, speed * 60.0 / math.tau, speed * wheels.wheel(name).radius]
        cells = [f"{value + 0.0:.3f}" for value in row]
        if steering:
            angle = steering.get(name)
            cells += ["", ""] if angle is None else [f"{angle:.4f}", f"{math.degrees(angle):.2f}"]
        rows.append([name, *cells])
    print(*aligned(rows, right=range(1, 6)), sep="\n")

    most = described.limits.max_wheel_speed
    if most is not None and (fastest := max(map(abs, command.speeds), default=0.0)) > most:
        print(
            f"trundle: warning: limits.max_wheel_speed is {most:g} rad/s; this needs {fastest:.4g}",
            file=sys.stderr,
        )


def forward(
    *,
    speeds: Numbers,
    steering: Numbers = (),
    yaw_rate: float | None = None,
    robot: Path | None = None,
    drive: str | None = None,
) -> None:
    """How the robot moves when its wheels turn like this.

    Args:
        speeds: Of the wheels that are measured, in the drive's order [rad/s]: --speeds 9.5 14.3
        steering: Angles of the steered wheels, in the drive's order, left positive [rad].
        yaw_rate: Of the gyro [rad/s], where the drive has one.
        robot: The robot's description (robot.yaml).
        drive: In its place, the drive alone, as robot.yaml writes it:
            "{type: differential, track_width: 0.2, wheel_radius: 42 mm}".
    """
    wheels = _described(robot, drive).measuring
    twist = wheels.forward(speeds, steering, yaw_rate=yaw_rate)
    x, y = wheels.icr(twist)
    centre = f"x {x:.3f} m, y {y:.3f} m" if math.isfinite(x + y) else "none: it goes straight"
    if twist.omega == 0.0 == math.hypot(twist.vx, twist.vy):
        centre = "none: it stands still"
    lines = [
        ("vx", f"{twist.vx + 0.0:9.4f} m/s"),
        ("vy", f"{twist.vy + 0.0:9.4f} m/s"),
        ("omega", f"{twist.omega + 0.0:9.4f} rad/s  ({math.degrees(twist.omega) + 0.0:.2f} deg/s)"),
        ("turning centre", centre),
    ]
    print(*labelled(lines), sep="\n")


def _described(robot: Path | None, drive: str | None) -> Robot:
    """The robot of a file, or one that consists of a drive.

    Raises:
        InputError: Unless exactly one of the two is given.
        ConfigError: If it cannot be a robot.
    """
    from trundle.adapters.robot_data import robot_from_data
    from trundle.adapters.robot_yaml import load_robot
    from trundle.adapters.yaml_document import parse_yaml
    from trundle.errors import InputError

    if robot is not None and drive is None:
        return load_robot(robot)
    if drive is not None and robot is None:
        return robot_from_data({"drive": parse_yaml(drive.encode("utf-8", "replace"), "--drive").data})
    raise InputError("say which robot: either --robot FILE or --drive TEXT")
