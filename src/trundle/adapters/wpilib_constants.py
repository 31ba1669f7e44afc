"""WPILib constants of a robot: Java or Python source text to put into a robot program."""

from __future__ import annotations

import enum
import json
import keyword
import math
import re
from collections.abc import Iterator
from typing import NamedTuple

from trundle.errors import InputError
from trundle.robot import Differential, FourWheelSteering, Kinematics, Mecanum, Robot, SkidSteer, Swerve

__all__ = ["Language", "wpilib_text"]


class Language(enum.Enum):
    """What robot programs are written in; the value is the suffix of its files."""

    JAVA = ".java"
    PYTHON = ".py"


class _Family(NamedTuple):
    """A kinematics class of WPILib's.

    Attributes:
        name: Of the Java class.
        python: Of the Python class.
        places: Whether it takes the places of the wheels, or else the track width.
    """

    name: str
    python: str
    places: bool


def wpilib_text(
    robot: Robot, language: Language | str = Language.JAVA, *, name: str = "DriveConstants"
) -> str:
    """Constants of a robot as WPILib names them: radii, metres per turn, and the kinematics object.

    WPILib's frames are Trundle's: x forward, y left, counter-clockwise positive.

    Args:
        robot: A differential, skid steer, mecanum, swerve or four-wheel steering drive.
        language: Java, or Python for RobotPy; or their suffixes.
        name: Of the Java class.

    Raises:
        InputError: If WPILib has no kinematics for such a drive, or the name is none.
    """
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) or keyword.iskeyword(name):
        raise InputError(f"name {name!r}: must be letters, digits and _, and not begin with a digit")
    family = _family(robot.drive)
    return (_java if Language(language) is Language.JAVA else _python)(robot, family, name)


def _family(drive: Kinematics) -> _Family:
    if isinstance(drive, Differential | SkidSteer):
        if drive.reference != (0.0, 0.0):
            problem = f"reference {drive.reference}: WPILib reports the middle between the wheels"
            raise InputError(f"{drive.type_name}: {problem}")
        return _Family("DifferentialDriveKinematics", "DifferentialDriveKinematics", places=False)
    if isinstance(drive, Mecanum):
        return _Family("MecanumDriveKinematics", "MecanumDriveKinematics", places=True)
    if isinstance(drive, Swerve | FourWheelSteering):
        count = len(drive.wheels)
        if count not in (2, 3, 4, 6):
            raise InputError(f"{drive.type_name}: {count} modules, WPILib knows 2, 3, 4 or 6")
        return _Family("SwerveDriveKinematics", f"SwerveDrive{count}Kinematics", places=True)
    problem = "WPILib has kinematics for differential, skid steer, mecanum and swerve drives"
    raise InputError(f"{drive.type_name}: {problem}")


def _numbers(robot: Robot) -> Iterator[tuple[str, float, str]]:
    """Name, value and unit of each constant."""
    drive = robot.drive
    if not _family(drive).places:
        yield "track_width", _track(drive), "m"
    radii = {wheel.name: wheel.radius for wheel in drive.wheels}
    if len(set(radii.values())) == 1:
        radii = {"": next(iter(radii.values()))}
    for wheel, radius in radii.items():
        yield f"{wheel}_wheel_radius".lstrip("_"), radius, "m"
    for wheel, radius in radii.items():
        yield f"{wheel}_meters_per_turn".lstrip("_"), math.tau * radius, "m per turn of the wheel"


def _track(drive: Kinematics) -> float:
    """Distance between the wheels' lines; of a skid drive, between the points about which its sides turn."""
    left, right = (drive.parameters.get(f"icr_{side}") for side in ("left", "right"))
    if left is not None and right is not None:
        return float(left - right)
    return float(drive.parameters["track_width"])


def _java(robot: Robot, family: _Family, name: str) -> str:
    lines = []
    for word, value, unit in _numbers(robot):
        lines.append(f"  public static final double {_camel(word)} = {value!r}; // {unit}")
    places = [(wheel.x, wheel.y) for wheel in robot.drive.wheels]
    arguments = [_camel("track_width")]
    if family.places:
        arguments = [f"new Translation2d({x!r}, {y!r})" for x, y in places]
    between = ",\n          "
    order = f" // {', '.join(robot.drive.wheel_names)}" if family.places else ""
    imports = ["edu.wpi.first.math.geometry.Translation2d"] if family.places else []
    imports += [f"edu.wpi.first.math.kinematics.{family.name}"]
    return "\n".join(
        [
            f"// {_about(robot)}",
            *(f"import {one};" for one in imports),
            "",
            f"public final class {name} {{",
            *lines,
            f"  public static final {family.name} kKinematics ={order}",
            f"      new {family.name}(",
            f"          {between.join(arguments)});",
            "",
            f"  private {name}() {{}}",
            "}",
            "",
        ]
    )


def _python(robot: Robot, family: _Family, _name: str) -> str:
    places = [(wheel.x, wheel.y) for wheel in robot.drive.wheels]
    arguments = ["TRACK_WIDTH"]
    if family.places:
        arguments = [f"Translation2d({x!r}, {y!r})" for x, y in places]
    order = f"  # {', '.join(robot.drive.wheel_names)}" if family.places else ""
    geometry = ["from wpimath.geometry import Translation2d"] if family.places else []
    return "\n".join(
        [
            f"# {_about(robot)}",
            *geometry,
            f"from wpimath.kinematics import {family.python}",
            "",
            *(f"{word.upper()} = {value!r}  # {unit}" for word, value, unit in _numbers(robot)),
            f"KINEMATICS = {family.python}({order}",
            *(f"    {argument}," for argument in arguments),
            ")",
            "",
        ]
    )


def _about(robot: Robot) -> str:
    return f"Measured properties of {json.dumps(robot.name)}: lengths in m, x forward, y left."


def _camel(word: str) -> str:
    """`kTrackWidth` of `track_width`: how WPILib writes constants."""
    return "k" + "".join(part.capitalize() for part in word.split("_"))
