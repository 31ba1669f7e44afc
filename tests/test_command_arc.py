"""Arcs and frames: straight and on the spot exact, round trips, and what the classics wrote down."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import Differential, Infeasible, InputError, Pose2D, SkidSteer, Twist2D
from trundle.command import about, arc, arc_of_sides, discretize, to_field, to_robot

SPEEDS = st.floats(-3.0, 3.0)
ANGLES = st.floats(-10.0, 10.0)


@given(radius=st.floats(-50, 50), yaw_rate=SPEEDS, track=st.floats(0.05, 2.0))
def test_arc_by_yaw_rate_is_kohanbash(radius, yaw_rate, track):
    left, right = arc(radius, yaw_rate=yaw_rate).sides(track)
    assert right == pytest.approx(yaw_rate * (radius + track / 2), rel=1e-12, abs=1e-12)
    assert left == pytest.approx(yaw_rate * (radius - track / 2), rel=1e-12, abs=1e-12)


@given(speed=SPEEDS, track=st.floats(0.05, 2.0))
def test_straight_and_on_the_spot_are_exact(speed, track):
    for radius in (math.inf, -math.inf):
        assert arc(radius, speed=speed).sides(track) == (speed, speed)
    left, right = arc(0.0, yaw_rate=speed).sides(track)
    assert left == -right
    assert right == 0.5 * track * speed


@given(left=SPEEDS, right=SPEEDS, track=st.floats(0.05, 2.0))
def test_sides_to_arc_and_back(left, right, track):
    back = arc_of_sides(left, right, track).sides(track)
    assert back == pytest.approx((left, right), abs=1e-14)


def test_turning_centre_is_turtlebots():
    motion = arc_of_sides(0.2, 0.4, 0.5)
    assert motion.radius == pytest.approx(0.5 / 2 * (0.4 + 0.2) / (0.4 - 0.2))
    assert motion.yaw_rate == pytest.approx((0.4 - 0.2) / 0.5)
    drive = Differential(track_width=0.5, wheel_radius=0.03)
    assert drive.icr(motion.twist) == (0.0, pytest.approx(motion.radius))


@pytest.mark.parametrize(
    ("left", "right", "radius", "curvature"),
    [
        (0.0, 0.0, math.inf, 0.0),
        (1.0, 1.0, math.inf, 0.0),
        (-1.0, 1.0, 0.0, math.inf),
        (1.0, -1.0, 0.0, -math.inf),
        (0.5, 1.5, 1.0, 1.0),
        (1.5, 0.5, -1.0, -1.0),
    ],
)
def test_special_cases_have_no_nan(left, right, radius, curvature):
    motion = arc_of_sides(left, right, 1.0)
    assert (motion.radius, motion.curvature) == (radius, curvature)


@pytest.mark.parametrize(
    ("radius", "given", "error"),
    [
        (1.0, {}, InputError),
        (1.0, {"speed": 1.0, "yaw_rate": 1.0}, InputError),
        (math.nan, {"speed": 1.0}, InputError),
        (1.0, {"speed": math.inf}, InputError),
        (math.inf, {"yaw_rate": 0.5}, Infeasible),
        (0.0, {"speed": 0.5}, Infeasible),
    ],
)
def test_contradictions_are_refused(radius, given, error):
    with pytest.raises(error, match=r"speed|yaw_rate"):
        arc(radius, **given)


def test_arc_drives_a_skid_steer_around_its_centre():
    drive = SkidSteer(track_width=0.5, wheelbase=0.4, wheel_radius=0.1)
    left, right = arc(2.0, speed=1.0).sides(0.5)
    wheels = drive.inverse(arc(2.0, speed=1.0).twist)
    assert wheels.speeds == pytest.approx((left / 0.1, right / 0.1, left / 0.1, right / 0.1))


@given(vx=SPEEDS, vy=SPEEDS, heading=ANGLES)
def test_field_axes(vx, vy, heading):
    twist = Twist2D(vx, vy, 0.7)
    field = to_field(twist, heading)
    moved = Pose2D(0.0, 0.0, heading) @ Pose2D(vx, vy, 0.0)  # a rotation by other code
    assert (field.vx, field.vy) == pytest.approx((moved.x, moved.y), abs=1e-14)
    back = to_robot(field, heading)
    assert (back.vx, back.vy, back.omega) == pytest.approx((vx, vy, 0.7), abs=1e-14)


@given(x=SPEEDS, y=SPEEDS, omega=SPEEDS)
def test_any_centre_of_rotation_stands_still(x, y, omega):
    twist = about(Twist2D(0.0, 0.0, omega), x, y)
    point = twist.at(x, y)
    assert (point.vx, point.vy, point.omega) == pytest.approx((0.0, 0.0, omega), abs=1e-14)


@given(vx=SPEEDS, vy=SPEEDS, omega=st.floats(-60.0, 60.0), period=st.floats(0.001, 0.1))
def test_discretized_twist_lands_where_it_was_meant_to(vx, vy, omega, period):
    if abs(omega * period) > 6.0:
        return
    end = Pose2D.exp(discretize(Twist2D(vx, vy, omega), period) * period)
    assert (end.x, end.y, end.theta) == pytest.approx((vx * period, vy * period, omega * period), abs=1e-13)


def test_discretize_refuses_a_whole_turn():
    with pytest.raises(InputError, match="whole turn"):
        discretize(Twist2D(1.0, 0.0, 7.0), 1.0)


@given(vx=SPEEDS, vy=SPEEDS, omega=SPEEDS)
def test_discretize_and_frames_are_wpilibs(vx, vy, omega):
    kinematics = pytest.importorskip("wpimath.kinematics")
    geometry = pytest.importorskip("wpimath.geometry")
    speeds = kinematics.ChassisSpeeds(vx, vy, omega)
    theirs = kinematics.ChassisSpeeds.discretize(speeds, 0.02)
    ours = discretize(Twist2D(vx, vy, omega), 0.02)
    # Their series for small angles is good to 1e-9 only.
    assert (ours.vx, ours.vy, ours.omega) == pytest.approx((theirs.vx, theirs.vy, theirs.omega), abs=1e-8)
    theirs = kinematics.ChassisSpeeds.fromFieldRelativeSpeeds(speeds, geometry.Rotation2d(omega))
    ours = to_robot(Twist2D(vx, vy, omega), omega)
    assert (ours.vx, ours.vy, ours.omega) == pytest.approx((theirs.vx, theirs.vy, theirs.omega), abs=1e-12)
