"""The acceleration-level inverse against finite differences of the inverse itself."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import trundle as tr
from trundle import Pose2D, Twist2D
from trundle.command import Acceleration2D, inverse_acceleration

SWERVE = tr.Swerve(modules=[(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)], wheel_radius=0.05)
CAR = tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05)
MECANUM = tr.Mecanum(track_width=0.4, wheelbase=0.5, wheel_radius=0.05)
PART = st.floats(-2.0, 2.0)
TWISTS = st.builds(Twist2D, PART, PART, PART)


def later(twist, rate, seconds):
    return Twist2D(
        twist.vx + rate.vx * seconds, twist.vy + rate.vy * seconds, twist.omega + rate.omega * seconds
    )


@pytest.mark.parametrize("drive", [SWERVE, CAR, MECANUM], ids=["swerve", "ackermann", "mecanum"])
@given(twist=TWISTS, rate=TWISTS)
def test_finite_differences_agree(drive, twist, rate):
    twist, rate = drive.project(twist), drive.project(rate)
    command, step = drive.inverse(twist), 1e-6
    speeds = dict(zip(drive.wheel_names, command.speeds, strict=True))
    assume(all(abs(speeds[name]) > 4.0 for name in drive.steered_names))  # 0.2 m/s: it has a direction
    found = inverse_acceleration(drive, twist, Acceleration2D.of(twist, rate))
    after = drive.inverse(later(twist, rate, step), command.steering)
    before = drive.inverse(later(twist, rate, -step), command.steering)
    for a, b, rate_of_speed in zip(after.speeds, before.speeds, found.speeds, strict=True):
        assert (a - b) / (2 * step) == pytest.approx(rate_of_speed, rel=1e-5, abs=1e-4)
    for a, b, turning in zip(after.steering, before.steering, found.steering_rates, strict=True):
        assert (a - b) / (2 * step) == pytest.approx(turning, rel=1e-5, abs=1e-5)


@given(twist=TWISTS, rate=TWISTS)
def test_contacts_accelerate_as_points_of_the_moving_body(twist, rate):
    """Second differences of where the contact is in the world."""
    found = inverse_acceleration(SWERVE, twist, Acceleration2D.of(twist, rate))
    step = 1e-3

    def place(seconds):
        # Exact to third order about the start: the mean twist of each small way.
        pose, n = Pose2D(), 20
        for k in range(n):
            pose @= Pose2D.exp(later(twist, rate, (k + 0.5) * seconds / n) * (seconds / n))
        return pose @ Pose2D(0.3, 0.2, 0.0)

    ahead, here, behind = place(step), place(0.0), place(-step)
    ax = (ahead.x - 2 * here.x + behind.x) / step**2
    ay = (ahead.y - 2 * here.y + behind.y) / step**2
    assert found.contacts[0] == pytest.approx((ax, ay), abs=2e-3)


def test_centripetal_term_is_there_without_acceleration_of_the_chassis():
    found = inverse_acceleration(SWERVE, Twist2D(0.0, 0.0, 3.0), Acceleration2D())
    for contact, wheel in zip(found.contacts, SWERVE.wheels, strict=True):
        assert contact == pytest.approx((-9.0 * wheel.x, -9.0 * wheel.y))
    assert found.speeds == pytest.approx([0.0] * 4, abs=1e-12)
    assert found.steering_rates == pytest.approx([0.0] * 4, abs=1e-12)


def test_straight_while_spinning_turns_every_wheel_back():
    """No acceleration at all: the body's axes turn, so the wheels must turn the other way."""
    spinning = Twist2D(0.0, 100.0, 1.0)  # so fast that the spin's own part is small
    found = inverse_acceleration(SWERVE, spinning, Acceleration2D())
    assert found.steering_rates == pytest.approx([-1.0] * 4, abs=0.02)


@given(twist=TWISTS, rate=TWISTS)
def test_rate_and_acceleration_and_back(twist, rate):
    back = Acceleration2D.of(twist, rate).rate(twist)
    assert (back.vx, back.vy, back.omega) == pytest.approx((rate.vx, rate.vy, rate.omega), abs=1e-12)


def test_a_wheel_that_stands_still_does_not_steer():
    found = inverse_acceleration(SWERVE, Twist2D(), Acceleration2D(1.0, 0.0, 0.0))
    assert found.steering_rates == (0.0,) * 4
    assert found.speeds == pytest.approx([20.0] * 4)
    assert all(math.isfinite(value) for value in found.speeds)
