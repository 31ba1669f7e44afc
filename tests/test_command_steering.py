"""Steering: the shorter way without chatter, held near standstill, all wheels of one mind if so asked."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle import ConfigError, ShapeError, Twist2D
from trundle.command import Envelope, Flip, Reason, Steering, saturate

PLACES = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]
SWERVE = tr.Swerve(modules=PLACES, wheel_radius=0.05)
ONE = tr.Swerve(modules=[(0.3, 0.2), (-0.3, -0.2)], wheel_radius=0.05)
TWISTS = st.builds(Twist2D, st.floats(-2, 2), st.floats(-2, 2), st.floats(-5, 5))
ANGLES = st.lists(st.floats(-3, 3), min_size=4, max_size=4)


def heading(degrees, speed=1.0):
    angle = math.radians(degrees)
    return Twist2D(speed * math.cos(angle), speed * math.sin(angle), 0.0)


def body(command, drive=SWERVE):
    twist = drive.forward(command)
    return twist.vx, twist.vy, twist.omega


@pytest.mark.parametrize("flip", Flip)
@given(twist=TWISTS, angles=ANGLES)
def test_whatever_way_the_wheels_turn_the_body_moves_as_wanted(flip, twist, angles):
    steering = Steering(SWERVE, flip=flip, hold_below=0.0)
    command, _ = steering.step(steering.start(angles), twist)
    assert body(command) == pytest.approx((twist.vx, twist.vy, twist.omega), abs=1e-9)


@given(twist=TWISTS, angles=ANGLES)
def test_without_hysteresis_it_is_the_drives_inverse(twist, angles):
    steering = Steering(SWERVE, hysteresis=0.0, hold_below=0.0, cosine_scaling=False)
    command, _ = steering.step(steering.start(angles), twist)
    # A wheel that goes on backwards rather than turn by a whole quarter is the one that may differ.
    turned = [abs(a - b) for a, b in zip(command.steering, angles, strict=True)]
    assert max(turned) <= math.pi / 2 + 1e-12
    nearest = SWERVE.inverse(twist, angles)
    for angle, other, turn in zip(command.steering, nearest.steering, turned, strict=True):
        assert angle == pytest.approx(other) or turn == pytest.approx(math.pi / 2)


def flips(steering, degrees):
    state, count = steering.start(), 0
    for angle in degrees:
        before = state
        command, state = steering.step(state, heading(angle), measured=(0.0,) * len(before.angles))
        count += sum(a != b for a, b in zip(before.backwards, state.backwards, strict=True))
    return count, command


def fault_k9():
    """v through zero with omega wanted: no error, the angle held near standstill, what cannot be is said."""
    drive = tr.Bicycle(wheelbase=0.3, wheel_radius=0.05)
    envelope = Envelope(tr.Robot(drive=drive, limits=tr.Limits(max_steering=0.5)))
    steering = Steering(envelope.drive)
    state = steering.start()
    _, state = steering.step(state, saturate(Twist2D(1.0, 0.0, 1.0), envelope).twist)
    driven = state.angles[0]
    assert driven == pytest.approx(math.atan(0.3))
    for speed in (1e-3, -1e-3, 1e-9, 0.0, -1e-9, 1e-3, -1e-3, 4e-3):
        achieved = saturate(Twist2D(speed, 0.0, 1.0), envelope)
        assert achieved.reasons == ((Reason.STEERING,) if speed else (Reason.TURN_ON_THE_SPOT,))
        command, state = steering.step(state, achieved.twist)
        assert state.angles == (driven,)
        assert all(math.isfinite(value) for value in command.speeds)
    # Held until it is twice as fast as where holding began.
    for speed, holds in ((0.015, True), (0.025, False), (0.015, False), (0.008, True), (0.015, True)):
        _, state = steering.step(state, Twist2D(speed, 0.0, 0.0))
        assert state.held == (holds,)
    assert state.angles == (0.0,)


def fault_k10():
    """89 and 91 degrees in turn: no wheel changes its mind; beyond 95 it does, once."""
    chatter = [89.0, 91.0] * 20
    for drive in (SWERVE, ONE):
        for flip in Flip:
            assert flips(Steering(drive, flip=flip), chatter)[0] == 0
            assert flips(Steering(drive, flip=flip), [94.9, *chatter])[0] == 0
            assert flips(Steering(drive, flip=flip), [95.1])[0] == len(drive.wheel_names)
            # Back to forwards only when backwards would be 5 degrees worse: below 85.
            assert flips(Steering(drive, flip=flip), [95.1, *chatter])[0] == len(drive.wheel_names)
            assert flips(Steering(drive, flip=flip), [95.1, 84.9])[0] == 2 * len(drive.wheel_names)
    without = Steering(ONE, hysteresis=0.0)
    assert flips(without, chatter)[0] > 10  # what it is there for

    # Each for itself, a turn tears the robot: some wheels flip, others do not. Together, none does.
    spin_and_shift = Twist2D(0.05, 0.0, 1.5)
    each = Steering(SWERVE, hysteresis=0.0)
    together = Steering(SWERVE, hysteresis=0.0, flip=Flip.TOGETHER)
    assert len(set(each.step(each.start(), spin_and_shift)[1].backwards)) == 2
    assert len(set(together.step(together.start(), spin_and_shift)[1].backwards)) == 1


@pytest.mark.parametrize(
    ("row", "check"), [pytest.param("K9", fault_k9, id="K9"), pytest.param("K10", fault_k10, id="K10")]
)
def test_fault(row, check):
    check()


@given(twists=st.lists(TWISTS, min_size=1, max_size=10))
def test_together_never_mixes_forwards_and_backwards(twists):
    steering = Steering(SWERVE, flip=Flip.TOGETHER, hold_below=0.0)
    state = steering.start()
    for twist in twists:
        command, state = steering.step(state, twist)
        assert len({speed > 0 for speed in command.speeds if abs(speed) > 1e-9}) <= 1
        assert body(command) == pytest.approx((twist.vx, twist.vy, twist.omega), abs=1e-9)


def test_together_within_ranges_falls_back_to_each():
    """Wheels that turn a quarter at most cannot all drive one way while the robot turns on the spot."""
    drive = tr.Swerve(modules=PLACES, wheel_radius=0.05, max_steering=1.7)
    steering = Steering(drive, flip=Flip.TOGETHER)
    command, _ = steering.step(steering.start(), Twist2D(0.0, 0.0, 1.0))
    assert body(command, drive) == pytest.approx((0.0, 0.0, 1.0), abs=1e-12)
    assert all(abs(angle) <= 1.7 for angle in command.steering)


@given(twist=TWISTS, angles=ANGLES)
def test_cosine_scaling_and_shortest_turn_are_wpilibs(twist, angles):
    kinematics = pytest.importorskip("wpimath.kinematics")
    geometry = pytest.importorskip("wpimath.geometry")
    steering = Steering(SWERVE, hysteresis=0.0, hold_below=0.0)
    command, _ = steering.step(steering.start(), twist, measured=angles)
    model = kinematics.SwerveDrive4Kinematics(*(geometry.Translation2d(*place) for place in PLACES))
    states = model.toSwerveModuleStates(kinematics.ChassisSpeeds(twist.vx, twist.vy, twist.omega))
    for k, state in enumerate(states):
        if abs(state.speed) < 1e-6:
            continue
        now = geometry.Rotation2d(angles[k])
        state.optimize(now)
        state.cosineScale(now)
        assert abs(0.05 * command.speeds[k]) == pytest.approx(abs(state.speed), abs=1e-9)
        turn = abs(math.remainder(command.steering[k] - angles[k], math.tau))
        assert turn == pytest.approx(abs((state.angle - now).radians()), abs=1e-7)


def test_a_wheel_that_points_right_creeps_while_it_is_held():
    steering = Steering(SWERVE)
    command, state = steering.step(steering.start(), Twist2D(0.005, 0.0, 0.0))
    assert state.held == (True,) * 4
    assert command.speeds == pytest.approx([0.1] * 4)
    command, _ = steering.step(state, Twist2D(0.0, 0.005, 0.0))
    assert command.speeds == pytest.approx([0.0] * 4)
    assert command.steering == (0.0,) * 4


def test_standing_still_keeps_the_angles():
    steering = Steering(SWERVE, hold_below=0.0)
    _, state = steering.step(steering.start(), heading(100.0))
    command, after = steering.step(state, Twist2D())
    assert command.steering == state.angles
    assert command.speeds == (0.0,) * 4
    assert after.backwards == state.backwards


def test_drives_that_do_not_steer_pass_through():
    drive = tr.Differential(track_width=0.4, wheel_radius=0.1)
    steering = Steering(drive)
    command, _ = steering.step(steering.start(), Twist2D(1.0, 0.0, 0.5))
    assert command == drive.inverse(Twist2D(1.0, 0.0, 0.5))


@pytest.mark.parametrize(
    "wrong", [{"hysteresis": -0.1}, {"hold_below": math.nan}, {"hold_below": 0.1, "release_above": 0.05}]
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ConfigError):
        Steering(SWERVE, **wrong)


def test_a_steering_sensor_that_fails_is_the_last_command():
    steering = Steering(SWERVE)
    _, state = steering.step(steering.start(), heading(30.0))
    blind = steering.step(state, heading(40.0), measured=[math.nan, math.inf, -math.inf, math.nan])
    knowing = steering.step(state, heading(40.0), measured=state.angles)
    assert blind == knowing


def test_wrong_number_of_angles_is_refused():
    steering = Steering(SWERVE)
    with pytest.raises(ShapeError, match="must be 4"):
        steering.start([0.0])
    with pytest.raises(ShapeError, match="must be 4"):
        steering.step(steering.start(), Twist2D(), measured=[0.0] * 3)
