"""A body twist to wheel speeds, from plain Python; for swerve with desaturation."""

from __future__ import annotations

import time

import pytest

import trundle as tr

pytestmark = pytest.mark.benchmark(timer=time.process_time)

CALLS = 4_000
TWISTS = [(1.0, 0.3, 0.5 + 1e-4 * k) for k in range(CALLS)]
FLOATS, BARE = "floats in and out", "built before, unread"
CORNERS = ((0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15))
RADIUS = 0.05


def compared(compare, name, protocol, whom, inverse, read, built):
    """Both protocols of one contestant."""

    def floats():
        for vx, vy, omega in TWISTS:
            read(inverse(built(vx, vy, omega)))

    ready = [built(*twist) for twist in TWISTS]

    def bare():
        for twist in ready:
            inverse(twist)

    compare("inverse", f"{name}, {protocol}", whom, bare if protocol == BARE else floats, CALLS)


@pytest.mark.parametrize("protocol", [FLOATS, BARE])
@pytest.mark.parametrize("name", ["differential", "mecanum", "swerve", "bicycle"])
def test_trundle(name, protocol, compare):
    twist = tr.Twist2D
    drives = {
        "differential": tr.Differential(track_width=0.2, wheel_radius=RADIUS),
        "mecanum": tr.Mecanum(track_width=0.3, wheelbase=0.4, wheel_radius=RADIUS),
        "swerve": tr.Swerve(modules=CORNERS, wheel_radius=RADIUS),
        "bicycle": tr.Bicycle(wheelbase=0.3, wheel_radius=RADIUS),
    }
    inverse = drives[name].inverse

    def desaturated(twist):
        return inverse(twist).desaturated(1.0 / RADIUS)

    def two(command):
        _left, _right = command.speeds

    def four(command):
        _fl, _fr, _rl, _rr = command.speeds

    def steered(command):
        _a, _b, _c, _d = command.speeds
        _e, _f, _g, _h = command.steering

    def bicycle(command):
        _rear, _front = command.speeds
        (_angle,) = command.steering

    read = {"differential": two, "mecanum": four, "swerve": steered, "bicycle": bicycle}[name]
    holonomic = name in ("mecanum", "swerve")
    compared(
        compare,
        name,
        protocol,
        "trundle",
        desaturated if name == "swerve" else inverse,
        read,
        twist if holonomic else lambda vx, vy, omega: twist(vx, 0.0, omega),  # noqa: ARG005
    )


@pytest.mark.parametrize("protocol", [FLOATS, BARE])
@pytest.mark.parametrize("name", ["differential", "mecanum", "swerve"])
def test_wpimath(name, protocol, compare):
    kinematics = pytest.importorskip("wpimath.kinematics", reason="robotpy-wpimath is not installed here")
    geometry = pytest.importorskip("wpimath.geometry")
    places = [geometry.Translation2d(x, y) for x, y in CORNERS]
    speeds = kinematics.ChassisSpeeds

    def two(wheels):
        wheels.left, wheels.right  # noqa: B018

    def four(wheels):
        wheels.frontLeft, wheels.frontRight, wheels.rearLeft, wheels.rearRight  # noqa: B018

    def steered(states):
        for state in states:
            state.speed, state.angle.radians()

    if name == "differential":
        inverse, read = kinematics.DifferentialDriveKinematics(0.2).toWheelSpeeds, two
    elif name == "mecanum":
        inverse, read = kinematics.MecanumDriveKinematics(*places).toWheelSpeeds, four
    else:
        drive, read = kinematics.SwerveDrive4Kinematics(*places), steered

        def inverse(twist):
            return drive.desaturateWheelSpeeds(drive.toSwerveModuleStates(twist), 1.0)

    built = speeds if name != "differential" else lambda vx, vy, omega: speeds(vx, 0.0, omega)  # noqa: ARG005
    compared(compare, name, protocol, "wpimath", inverse, read, built)


@pytest.mark.parametrize("protocol", [FLOATS, BARE])
@pytest.mark.parametrize("name", ["differential", "bicycle"])
def test_donkeycar(name, protocol, compare):
    parts = pytest.importorskip("donkeycar.parts.kinematics", reason="donkeycar lives in .envs/donkeycar")
    part = (
        parts.InverseUnicycle(0.2, RADIUS, 0.0, 1.0) if name == "differential" else parts.InverseBicycle(0.3)
    )

    def inverse(twist):
        return part.run(*twist)

    def read(outputs):
        _first, _second, _time = outputs

    compared(compare, name, protocol, "donkeycar", inverse, read, lambda vx, vy, omega: (vx, omega, 1.0))  # noqa: ARG005
