"""A live odometry update, from plain Python. wpimath's checks nothing and keeps no counts."""

from __future__ import annotations

import time

import pytest

import trundle as tr

pytestmark = pytest.mark.benchmark(timer=time.process_time)

CALLS = 4_000
XS = [0.01 * k for k in range(1, CALLS + 1)]
FLOATS, BARE = "floats in and out", "built before, unread"
CORNERS = ((0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15))


@pytest.fixture(scope="module")
def wpimath():
    kinematics = pytest.importorskip("wpimath.kinematics", reason="robotpy-wpimath is not installed here")
    geometry = pytest.importorskip("wpimath.geometry")
    return kinematics, geometry


# ------------------------------------------------------------------------------------------- trundle

DRIVES = {
    "differential": tr.Differential(track_width=0.2, wheel_radius=0.042),
    "mecanum": tr.Mecanum(track_width=0.3, wheelbase=0.4, wheel_radius=0.05),
    "swerve": tr.Swerve(modules=CORNERS, wheel_radius=0.05),
}
WHEELS = {
    "differential": lambda x: (x, 1.1 * x),
    "mecanum": lambda x: (x, 1.1 * x, x, 1.1 * x),
    "swerve": lambda x: (x, x, x, x),
}
STEERING = {"differential": (), "mecanum": (), "swerve": (0.1, 0.1, 0.1, 0.1)}


@pytest.mark.parametrize("protocol", [FLOATS, BARE])
@pytest.mark.parametrize("covariance", [False, True], ids=["pose", "covariance"])
@pytest.mark.parametrize("name", DRIVES)
def test_trundle(name, covariance, protocol, compare):
    drive, wheels, steering = DRIVES[name], WHEELS[name], STEERING[name]

    def fresh():
        return (tr.WheelOdometry(drive, covariance=covariance).update,), {}

    def floats(update):
        for x in XS:
            pose = update(x, wheels(x), steering).pose
            pose.x, pose.y, pose.theta  # noqa: B018

    def with_covariance(update):
        for x in XS:
            state = update(x, wheels(x), steering)
            pose = state.pose
            pose.x, pose.y, pose.theta, state.covariance  # noqa: B018

    built = [(x, wheels(x)) for x in XS]

    def bare(update):
        for x, positions in built:
            update(x, positions, steering)

    run = bare if protocol == BARE else with_covariance if covariance else floats
    what = "update with covariance" if covariance else "update"
    compare(what, f"{name}, {protocol}", "trundle", run, CALLS, setup=fresh)


# ------------------------------------------------------------------------------------------- wpimath


def differential(kinematics, geometry):
    rotation = geometry.Rotation2d
    odometry = kinematics.DifferentialDriveOdometry(rotation(0.0), 0.0, 0.0)
    return odometry.update, lambda x: (rotation(x), x, 1.1 * x)


def mecanum(kinematics, geometry):
    rotation, positions = geometry.Rotation2d, kinematics.MecanumDriveWheelPositions
    places = (geometry.Translation2d(x, y) for x, y in CORNERS)
    drive = kinematics.MecanumDriveKinematics(*places)
    odometry = kinematics.MecanumDriveOdometry(drive, rotation(0.0), positions())

    def reading(x):
        wheels = positions()
        wheels.frontLeft, wheels.frontRight, wheels.rearLeft, wheels.rearRight = x, 1.1 * x, x, 1.1 * x
        return rotation(x), wheels

    return odometry.update, reading


def swerve(kinematics, geometry):
    rotation, module = geometry.Rotation2d, kinematics.SwerveModulePosition
    places = (geometry.Translation2d(x, y) for x, y in CORNERS)
    drive = kinematics.SwerveDrive4Kinematics(*places)
    odometry = kinematics.SwerveDrive4Odometry(drive, rotation(0.0), tuple(module() for _ in range(4)))

    def reading(x):
        return rotation(x), (
            module(x, rotation(0.1)),
            module(x, rotation(0.1)),
            module(x, rotation(0.1)),
            module(x, rotation(0.1)),
        )

    return odometry.update, reading


@pytest.mark.parametrize("protocol", [FLOATS, BARE])
@pytest.mark.parametrize("what", ["update", "update with covariance"])
@pytest.mark.parametrize("make", [differential, mecanum, swerve])
def test_wpimath(make, what, protocol, compare, wpimath):
    """It has no covariance: the second run stands beside ours that has."""
    update, reading = make(*wpimath)

    def floats():
        for x in XS:
            pose = update(*reading(x))
            pose.X(), pose.Y(), pose.rotation().radians()

    built = [reading(x) for x in XS]

    def bare():
        for arguments in built:
            update(*arguments)

    compare(what, f"{make.__name__}, {protocol}", "wpimath", bare if protocol == BARE else floats, CALLS)


# ----------------------------------------------------------------------------------------- donkeycar


@pytest.mark.parametrize("protocol", [FLOATS, BARE])
def test_donkeycar(protocol, compare):
    kinematics = pytest.importorskip(
        "donkeycar.parts.kinematics", reason="donkeycar lives in .envs/donkeycar"
    )

    def fresh():
        return (kinematics.Unicycle(0.2).run,), {}

    def floats(run):
        for x in XS:
            _, _, _x, _y, _theta, *_ = run(x, 1.1 * x, x)

    def bare(run):
        for x in XS:
            run(x, x, x)

    compare(
        "update",
        f"differential, {protocol}",
        "donkeycar",
        bare if protocol == BARE else floats,
        CALLS,
        setup=fresh,
    )
