"""WPILib constants: what is written is what WPILib's own kinematics then compute."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess

import pytest

import trundle as tr
from trundle.adapters.wpilib_constants import wpilib_text
from trundle.errors import InputError

DRIVES = {
    "differential": tr.Differential(track_width=0.5512, wheel_radius={"left": 0.0761, "right": 0.0763}),
    "skid_steer": tr.SkidSteer(track_width=0.6, wheelbase=0.4, wheel_radius=0.1),
    "mecanum": tr.Mecanum(track_width=0.55, wheelbase=0.43, wheel_radius=0.0762, reference=(0.02, -0.01)),
    "swerve": tr.Swerve(modules=[(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)], wheel_radius=0.0508),
    "triangle": tr.Swerve(modules=[(0.3, 0.0), (-0.2, 0.2), (-0.2, -0.2)], wheel_radius=0.0508),
    "four_wheel_steering": tr.FourWheelSteering(wheelbase=0.6, track_width=0.5, wheel_radius=0.05),
}
TWIST = tr.Twist2D(0.7, 0.0, -0.4)


def constants(text, path):
    """The written Python, as a module."""
    path.write_text(text)
    spec = importlib.util.spec_from_file_location("constants", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", DRIVES)
def test_wpilib_computes_the_same_wheel_speeds(name, tmp_path):
    pytest.importorskip("wpimath.kinematics", reason="needs robotpy-wpimath")
    from wpimath.kinematics import ChassisSpeeds

    drive = DRIVES[name]
    said = constants(wpilib_text(tr.Robot(drive=drive), ".py"), tmp_path / "constants.py")
    chassis = ChassisSpeeds(TWIST.vx, TWIST.vy, TWIST.omega)
    if "Swerve" in type(said.KINEMATICS).__name__:
        got = [state.speed for state in said.KINEMATICS.toSwerveModuleStates(chassis)]
    elif "Mecanum" in type(said.KINEMATICS).__name__:
        speeds = said.KINEMATICS.toWheelSpeeds(chassis)
        got = [speeds.frontLeft, speeds.frontRight, speeds.rearLeft, speeds.rearRight]
    else:
        speeds = said.KINEMATICS.toWheelSpeeds(chassis)
        got = [speeds.left, speeds.right]
    command = drive.inverse(TWIST)
    wanted = [speed * wheel.radius for speed, wheel in zip(command.speeds, drive.wheels, strict=True)]
    if name == "skid_steer":
        wanted = wanted[:2]
    assert [abs(speed) for speed in got] == pytest.approx([abs(speed) for speed in wanted], rel=1e-9)


def test_radii_that_differ_are_given_by_wheel():
    text = wpilib_text(tr.Robot(drive=DRIVES["differential"]))
    assert re.search(r"double kLeftWheelRadius = 0\.0761; // m\n", text)
    assert re.search(r"double kRightWheelRadius = 0\.0763; // m\n", text)
    assert "kLeftMetersPerTurn = 0.478" in text


# Signatures of WPILib's, so that a compiler can judge the text without WPILib.
STUBS = {
    "geometry/Translation2d": "public Translation2d(double x, double y) {}",
    "kinematics/DifferentialDriveKinematics": "public DifferentialDriveKinematics(double width) {}",
    "kinematics/MecanumDriveKinematics": (
        "public MecanumDriveKinematics(Translation2d a, Translation2d b, Translation2d c, Translation2d d) {}"
    ),
    "kinematics/SwerveDriveKinematics": "public SwerveDriveKinematics(Translation2d... modules) {}",
}


def test_java_compiles(tmp_path):
    if shutil.which("javac") is None:
        pytest.skip("javac is not on this machine")
    for place, body in STUBS.items():
        path = tmp_path / "edu/wpi/first/math" / f"{place}.java"
        path.parent.mkdir(parents=True, exist_ok=True)
        package = f"package edu.wpi.first.math.{place.split('/')[0]};"
        uses = "import edu.wpi.first.math.geometry.*;"
        path.write_text(f"{package} {uses} public class {path.stem} {{ {body} }}")
    files = []
    for name, drive in DRIVES.items():
        title = f"{name.title().replace('_', '')}Constants"
        text = wpilib_text(tr.Robot(drive=drive, name="Kiwi */ \u00e9 \\u000a"), name=title)
        files.append(tmp_path / f"{title}.java")
        files[-1].write_text(text, encoding="utf-8")
    command = ["javac", "-sourcepath", ".", "-d", "out", *map(str, files)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_wpilib_does_not_know_is_refused():
    with pytest.raises(InputError, match="bicycle: WPILib has kinematics for differential, skid"):
        wpilib_text(tr.Robot(drive=tr.Bicycle(wheelbase=0.3, wheel_radius=0.03)))
    modules = [(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3), (0.0, 0.4)]
    with pytest.raises(InputError, match="5 modules, WPILib knows 2, 3, 4 or 6"):
        wpilib_text(tr.Robot(drive=tr.Swerve(modules=modules, wheel_radius=0.05)))
    ahead = tr.Differential(track_width=0.15, wheel_radius=0.02, reference=(0.03, 0.0))
    with pytest.raises(InputError, match=r"reference \(0.03, 0.0\): WPILib reports the middle"):
        wpilib_text(tr.Robot(drive=ahead))
    with pytest.raises(InputError, match="name '2fast': must be letters"):
        wpilib_text(tr.Robot(drive=DRIVES["mecanum"]), name="2fast")
