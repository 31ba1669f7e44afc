"""Sticks: the corners of their square, continuity, and the dead band of wpimath."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import ConfigError, InputError, Limits
from trundle.command import arcade_drive, curvature_drive, dead_band, joystick_twist, tank_drive

STICKS = st.floats(-1.0, 1.0)


@given(value=st.floats(-3, 3), band=st.floats(0.0, 0.9), greatest=st.floats(1.0, 5.0))
def test_dead_band_is_wpilibs(value, band, greatest):
    wpimath = pytest.importorskip("wpimath")
    clipped = max(-greatest, min(greatest, value))  # they extrapolate beyond the end of the stick
    expected = wpimath.applyDeadband(clipped, band, greatest)
    assert dead_band(value, band, greatest) == pytest.approx(expected, abs=1e-12)


def test_dead_band_is_continuous_at_its_edge():
    assert dead_band(0.1, 0.1) == 0.0
    assert dead_band(0.1 + 1e-9, 0.1) == pytest.approx(0.0, abs=1e-8)
    assert dead_band(1.0, 0.1) == 1.0
    assert dead_band(-1.0, 0.1) == -1.0


@pytest.mark.parametrize(
    ("forward", "turn", "left", "right"),
    [
        (1.0, 0.0, 1.0, 1.0),
        (0.0, 1.0, -1.0, 1.0),
        (1.0, 1.0, 0.0, 1.0),
        (1.0, -1.0, 1.0, 0.0),
        (-1.0, 1.0, -1.0, 0.0),
        (0.5, 0.0, 0.25, 0.25),
        (0.5, 0.5, 0.0, 0.25),
        (0.0, 0.0, 0.0, 0.0),
        (5.0, 0.0, 1.0, 1.0),
    ],
)
def test_arcade_corners(forward, turn, left, right):
    efforts = arcade_drive(forward, turn)
    assert (efforts.left, efforts.right) == pytest.approx((left, right), abs=1e-15)


@given(forward=STICKS, turn=STICKS)
def test_arcade_keeps_the_ratio_of_the_sticks(forward, turn):
    efforts = arcade_drive(forward, turn, square_inputs=False)
    assert max(abs(efforts.left), abs(efforts.right)) <= 1.0
    assert (efforts.right - efforts.left) * forward == pytest.approx((efforts.right + efforts.left) * turn)
    # The further of the two sticks is how fast the faster side turns.
    assert max(abs(efforts.left), abs(efforts.right)) == pytest.approx(max(abs(forward), abs(turn)))


@given(left=STICKS, right=STICKS)
def test_tank_squares_and_keeps_signs(left, right):
    efforts = tank_drive(left, right)
    assert (efforts.left, efforts.right) == (left * abs(left), right * abs(right))
    plain = tank_drive(left, right, square_inputs=False)
    assert (plain.left, plain.right) == (left, right)


@given(forward=STICKS, turn=STICKS)
def test_curvature_drive_turns_as_tight_at_every_speed(forward, turn):
    efforts = curvature_drive(forward, turn)
    assert max(abs(efforts.left), abs(efforts.right)) <= 1.0
    ahead, yaw = efforts.left + efforts.right, efforts.right - efforts.left
    assert yaw == pytest.approx(
        abs(ahead) * turn, abs=1e-12
    )  # in reverse the robot still turns as the stick says
    spot = curvature_drive(forward, turn, turn_in_place=True)
    assert (spot.right - spot.left) * forward == pytest.approx((spot.right + spot.left) * turn, abs=1e-12)


def test_curvature_drive_does_not_turn_at_rest_unless_asked():
    rest = curvature_drive(0.0, 1.0)
    assert (rest.left, rest.right) == (0.0, 0.0)
    spot = curvature_drive(0.0, 0.5, turn_in_place=True)
    assert (spot.left, spot.right) == (-0.5, 0.5)


def test_joystick_twist_reaches_the_limits():
    limits = Limits(max_speed=1.5, max_lateral_speed=0.5, max_yaw_rate=3.0)
    full = joystick_twist(1.0, -1.0, 1.0, limits)
    assert (full.vx, full.vy, full.omega) == (1.5, -0.5, 3.0)
    rest = joystick_twist(0.04, -0.04, 0.04, limits)
    assert (rest.vx, rest.vy, rest.omega) == (0.0, 0.0, 0.0)
    with pytest.raises(ConfigError, match="max_yaw_rate"):
        joystick_twist(0.0, 0.0, 0.0, Limits(max_speed=1.0))


@pytest.mark.parametrize("drive", [arcade_drive, tank_drive, curvature_drive])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_a_number_is_refused(drive, bad):
    with pytest.raises(InputError, match="must be a number"):
        drive(bad, 0.0)


@pytest.mark.parametrize("band", [-0.1, 1.0, math.nan])
def test_impossible_bands_are_refused(band):
    with pytest.raises(ConfigError, match="band"):
        dead_band(0.5, band)
