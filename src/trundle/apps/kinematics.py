"""`trundle inverse` and `trundle forward`: one twist, one set of wheels."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from trundle.apps.wording import aligned, fixed, labelled

if TYPE_CHECKING:
    from trundle.geometry import Twist2D
    from trundle.robot import Limits, Robot, WheelCommand

__all__ = ["forward", "inverse"]

Numbers = Annotated[tuple[float, ...], Parameter(consume_multiple=True, negative="", show_default=False)]


def inverse(
    vx: float, vy: float, omega: float, /, *, robot: Path | None = None, drive: str | None = None
) -> None:
    """Wheel speeds and steering angles that move the robot like this.

    What is beyond the robot's limits is printed all the same, with a warning.

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
    twist = Twist2D(vx, vy, omega)
    command = wheels.inverse(twist)
    steering = dict(zip(wheels.steered_names, command.steering, strict=True))
    rows = [["wheel", "[rad/s]", "[rpm]", "[m/s]"] + ["steering [rad]", "[deg]"] * bool(steering)]
    for name, speed in zip(wheels.wheel_names, command.speeds, strict=True):
        row = [speed, speed * 60.0 / math.tau, speed * wheels.wheel(name).radius]
        cells = [fixed(value, 3) for value in row]
        if steering:
            angle = steering.get(name)
            cells += ["", ""] if angle is None else [fixed(angle, 4), fixed(math.degrees(angle), 2)]
        rows.append([name, *cells])
    print(*aligned(rows, right=range(1, 6)), sep="\n")

    for warning in _beyond(described.limits, twist, command):
        print(f"trundle: warning: {warning}", file=sys.stderr)


def _beyond(limits: Limits, twist: Twist2D, command: WheelCommand) -> Iterator[str]:
    """Which limits of the robot a command does not keep; nothing here keeps them for it."""
    asked = {
        "max_speed": (twist.vx, "m/s"),
        "max_lateral_speed": (twist.vy, "m/s"),
        "max_yaw_rate": (twist.omega, "rad/s"),
        "max_wheel_speed": (max(command.speeds, key=abs, default=0.0), "rad/s"),
    }
    for name, (value, unit) in asked.items():
        most = getattr(limits, name)
        if most is not None and abs(value) > most * (1.0 + 1e-9):
            yield f"limits.{name} is {most:g} {unit}; this needs {abs(value):.4g}"


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
    centre = f"x {fixed(x, 3)} m, y {fixed(y, 3)} m" if math.isfinite(x + y) else "none: it goes straight"
    if twist.omega == 0.0 == math.hypot(twist.vx, twist.vy):
        centre = "none: it stands still"
    lines = [
        ("vx", f"{fixed(twist.vx, 4):>9} m/s"),
        ("vy", f"{fixed(twist.vy, 4):>9} m/s"),
        ("omega", f"{fixed(twist.omega, 4):>9} rad/s  ({fixed(math.degrees(twist.omega), 2)} deg/s)"),
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
