"""Motion profiles: closed forms, limits that hold, and trajectories against finite differences."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import ConfigError, Differential, InputError, Limits, Mecanum, PathError, Pose2D, Robot, Twist2D
from trundle.command import Acceleration2D, Envelope, inverse_acceleration, to_robot
from trundle.follow import (
    CircularArc,
    Line,
    Path,
    Profile,
    SpeedLimits,
    TimedPath,
    profile_along,
    quintic_between,
    s_curve,
    trapezoid,
)

LENGTH = st.floats(0.01, 30.0)
RATE = st.floats(0.1, 5.0)


def sampled(profile, count=4001):
    return [profile.at(t) for t in np.linspace(0.0, profile.duration, count).tolist()]


def test_trapezoid_is_the_closed_form():
    profile = trapezoid(10.0, max_speed=2.0, max_acceleration=1.0, max_deceleration=0.5)
    # Two seconds up, four down: 2 m and 4 m; the other 4 m at 2 m/s.
    assert profile.times == pytest.approx((0.0, 2.0, 4.0, 8.0))
    assert profile.at(3.0).distance == pytest.approx(4.0)
    assert profile.at(6.0).speed == pytest.approx(1.0)
    assert profile.at(7.0).acceleration == -0.5


def test_triangle_where_it_is_too_short_to_cruise():
    profile = trapezoid(1.0, max_speed=5.0, max_acceleration=1.0)
    assert profile.duration == pytest.approx(2.0)
    assert profile.at(1.0).speed == pytest.approx(1.0)


@given(distance=LENGTH, speed=RATE, up=RATE, down=RATE, start=st.floats(0, 1), end=st.floats(0, 1))
def test_trapezoids_keep_their_limits(distance, speed, up, down, start, end):
    limits = {"max_speed": speed, "max_acceleration": up, "max_deceleration": down}
    start, end = start * speed, end * speed
    try:
        profile = trapezoid(distance, **limits, start_speed=start, end_speed=end)
    except InputError:
        slope = 2.0 * (up if end > start else down)
        assert abs(end**2 - start**2) > slope * distance * (1 - 1e-9)
        return
    assert profile.length == pytest.approx(distance, rel=1e-9)
    assert profile.at(0.0).speed == pytest.approx(start)
    assert profile.end_speed == pytest.approx(end, abs=1e-9)
    assert max(p.speed for p in sampled(profile, 101)) <= speed * (1 + 1e-12)


@given(distance=LENGTH, speed=RATE, acceleration=RATE, down=RATE, jerk=st.floats(0.5, 20.0))
def test_s_curves_keep_their_limits(distance, speed, acceleration, down, jerk):
    profile = s_curve(
        distance, max_speed=speed, max_acceleration=acceleration, max_deceleration=down, max_jerk=jerk
    )
    points = sampled(profile, 301)
    assert profile.length == pytest.approx(distance, rel=1e-9)
    assert max(p.speed for p in points) <= speed * (1 + 1e-9)
    assert max(p.acceleration for p in points) <= acceleration * (1 + 1e-9)
    assert min(p.acceleration for p in points) >= -down * (1 + 1e-9)
    assert profile.greatest_jerk <= jerk * (1 + 1e-9)
    step = profile.duration / 300
    for before, after in pairwise(points):  # no jump of the acceleration either
        assert abs(after.acceleration - before.acceleration) <= jerk * step * (1 + 1e-6) + 1e-9
    assert abs(profile.end_speed) < 1e-9 * speed + 1e-12


def test_s_curve_is_the_seven_phases_of_the_books():
    """v = 1, a = 1, j = 2 over 4 m: 0.5 s of jerk, 0.5 s level, 0.5 s of jerk, 2.5 s cruise, and back."""
    profile = s_curve(4.0, max_speed=1.0, max_acceleration=1.0, max_jerk=2.0)
    assert profile.jerks == pytest.approx((2.0, 0.0, -2.0, 0.0, -2.0, 0.0, 2.0), abs=1e-12)
    assert profile.times == pytest.approx((0.0, 0.5, 1.0, 1.5, 4.0, 4.5, 5.0, 5.5))


def test_profile_is_at_rest_before_and_after():
    profile = trapezoid(1.0, max_speed=1.0, max_acceleration=1.0)
    assert profile.at(-1.0).speed == profile.at(5.0).speed == 0.0
    assert profile.at(5.0).distance == pytest.approx(1.0)
    assert (profile + profile).at(profile.duration + 1.0).distance == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("make", "error"),
    [
        (lambda: Profile([]), InputError),
        (lambda: Profile([(1.0, math.nan, 0.0, 0.0)]), InputError),
        (lambda: trapezoid(0.0, max_speed=1.0, max_acceleration=1.0), ConfigError),
        (lambda: trapezoid(1.0, max_speed=math.nan, max_acceleration=1.0), ConfigError),
        (lambda: trapezoid(1.0, max_speed=1.0, max_acceleration=1.0, start_speed=2.0), InputError),
        (lambda: s_curve(1.0, max_speed=1.0, max_acceleration=1.0, max_jerk=-1.0), ConfigError),
        (lambda: trapezoid(1.0, max_speed=1.0, max_acceleration=1.0).at(math.nan), InputError),
        (
            lambda: trapezoid(2.0, max_speed=1.0, max_acceleration=1.0, end_speed=1.0).smoothed(0.1),
            InputError,
        ),
        (lambda: SpeedLimits(max_speed=-1.0, max_acceleration=1.0), ConfigError),
        (
            lambda: TimedPath(
                Path([Line((0, 0), (2, 0))]), trapezoid(1.0, max_speed=1.0, max_acceleration=1.0)
            ),
            PathError,
        ),
    ],
)
def test_what_cannot_be_is_refused(make, error):
    with pytest.raises(error):
        make()


# ---------------------------------------------------------------- along a path

CURVES = [
    Line((0.0, 0.0), (2.0, 0.0)),
    CircularArc(Pose2D(2.0, 0.0, 0.0), 0.5, math.pi / 2),
    quintic_between(Pose2D(2.5, 0.5, math.pi / 2), Pose2D(0.0, 3.0, math.pi)),
    Line((0.0, 3.0), (-2.0, 3.0)),
]
DIFFERENTIAL = Differential(track_width=0.5, wheel_radius=0.1)
MECANUM = Mecanum(track_width=0.4, wheelbase=0.5, wheel_radius=0.05)
MAX_WHEEL_SPEED = 15.0


def wheel_load(drive):
    return Envelope(Robot(drive=drive, limits=Limits(max_wheel_speed=MAX_WHEEL_SPEED))).load


@pytest.mark.parametrize("jerk", [None, 4.0])
@pytest.mark.parametrize("facing", [None, (0.0, 2.0)])
def test_every_limit_is_kept_and_reached(facing, jerk):
    drive = DIFFERENTIAL if facing is None else MECANUM
    limits = SpeedLimits(
        max_speed=1.4,
        max_acceleration=1.0,
        max_deceleration=0.8,
        max_jerk=jerk,
        max_lateral_acceleration=0.9,
        max_yaw_rate=1.5,
        load=wheel_load(drive),
    )
    trajectory = TimedPath.fastest(Path(CURVES, facing=facing), limits)
    loads = []
    for time in np.linspace(0.0, trajectory.duration, 3001).tolist():
        reference, motion = trajectory.at(time), trajectory.profile.at(time)
        wheels = max(map(abs, drive.inverse(reference.twist).speeds))
        loads.append(
            [
                motion.speed / 1.4,
                motion.acceleration / 1.0,
                -motion.acceleration / 0.8,
                motion.speed**2 * abs(trajectory.path.at(reference.distance).curvature) / 0.9,
                abs(reference.twist.omega) / 1.5,
                wheels / MAX_WHEEL_SPEED,
            ]
        )
    worst = np.max(loads, axis=0)
    # Between two looks a limit may be exceeded by what changes over 1 cm of path.
    assert (worst < 1.005).all()
    assert (worst[[1, 2]] <= 1.0 + 1e-6).all()
    if jerk is None:
        # It is as fast as it may be: at any time, something stands in the way.
        assert np.min(np.max(loads[1:-1], axis=1)) > 0.97
    else:
        assert trajectory.profile.greatest_jerk <= jerk * (1 + 1e-9)


def test_limits_on_wheels_by_pose_and_curvature():
    def feasible_speed(pose, curvature):
        return MAX_WHEEL_SPEED / max(map(abs, DIFFERENTIAL.inverse(Twist2D(1.0, 0.0, curvature)).speeds))

    path = Path(CURVES)
    limits = {"max_speed": 2.0, "max_acceleration": 1.0}
    by_pose = profile_along(path, SpeedLimits(**limits, feasible_speed=feasible_speed))
    by_twist = profile_along(path, SpeedLimits(**limits, load=wheel_load(DIFFERENTIAL)))
    assert by_pose.duration == pytest.approx(by_twist.duration, rel=1e-12)


def test_straight_profile_is_the_trapezoid():
    limits = SpeedLimits(max_speed=2.0, max_acceleration=1.0, max_deceleration=0.5)
    profile = profile_along(Path([Line((0.0, 0.0), (10.0, 0.0))]), limits)
    plain = trapezoid(10.0, max_speed=2.0, max_acceleration=1.0, max_deceleration=0.5)
    assert profile.duration == pytest.approx(plain.duration, rel=1e-3)


@pytest.mark.parametrize("feasible", [0.0, -1.0, math.nan])
def test_where_wheels_cannot_go_there_is_no_path(feasible):
    limits = SpeedLimits(max_speed=1.0, max_acceleration=1.0, feasible_speed=lambda pose, curvature: feasible)
    with pytest.raises(PathError, match="cannot drive at"):
        profile_along(Path(CURVES), limits)


@pytest.mark.parametrize("row", [pytest.param("K15", id="K15-stops_at_cusp")])
def test_fault(row):
    there = Path([Line((0.0, 0.0), (1.0, 0.0))])
    back = Path([Line((1.0, 0.0), (0.5, 0.0))], backward=True)
    trajectory = TimedPath.fastest(
        there + back, SpeedLimits(max_speed=1.0, max_acceleration=1.0, max_jerk=5.0)
    )
    speeds = {}
    for time in np.linspace(0.0, trajectory.duration, 2001).tolist():
        reference = trajectory.at(time)
        assert reference.pose.theta == pytest.approx(0.0)
        speeds.setdefault(reference.distance <= 1.0, []).append(reference.twist.vx)
    assert min(speeds[True]) >= -1e-12
    assert max(speeds[False]) <= 1e-12
    assert abs(speeds[True][-1]) < 0.01
    assert trajectory.at(trajectory.duration).pose.x == pytest.approx(0.5)


@pytest.mark.parametrize("facing", [None, (0.0, 2.0)])
def test_feed_forward_is_the_derivative_of_the_trajectory(facing):
    trajectory = TimedPath.fastest(
        Path(CURVES, facing=facing), SpeedLimits(max_speed=1.0, max_acceleration=1.0, max_jerk=5.0)
    )
    h = 1e-5
    for time in (0.1, 0.7, 2.4, 4.0, 5.1):
        before, here, after = (trajectory.at(t) for t in (time - h, time, time + h))
        velocity = here.field_velocity
        assert (after.pose.x - before.pose.x) / (2 * h) == pytest.approx(velocity.vx, abs=1e-6)
        assert (after.pose.y - before.pose.y) / (2 * h) == pytest.approx(velocity.vy, abs=1e-6)
        assert (after.pose.theta - before.pose.theta) / (2 * h) == pytest.approx(velocity.omega, abs=1e-6)
        ax, ay, alpha = here.field_acceleration
        assert (after.field_velocity.vx - before.field_velocity.vx) / (2 * h) == pytest.approx(ax, abs=1e-4)
        assert (after.field_velocity.vy - before.field_velocity.vy) / (2 * h) == pytest.approx(ay, abs=1e-4)
        assert (after.twist.omega - before.twist.omega) / (2 * h) == pytest.approx(alpha, abs=1e-4)
        in_robot = to_robot(velocity, here.pose.theta)
        assert (in_robot.vx, in_robot.vy) == pytest.approx((here.twist.vx, here.twist.vy), abs=1e-12)


def test_feed_forward_reaches_the_wheels():
    """Field velocities, robot velocities, wheel speeds and their rates: Road Runner's chain."""
    trajectory = TimedPath.fastest(
        Path(CURVES), SpeedLimits(max_speed=1.0, max_acceleration=1.0, max_jerk=5.0)
    )
    h = 1e-5
    for time in (0.4, 2.9, 5.0):
        here = trajectory.at(time)
        v, omega = here.twist.vx, here.twist.omega
        left, right = DIFFERENTIAL.inverse(here.twist).speeds
        assert (0.1 * left, 0.1 * right) == pytest.approx((v - 0.5 * omega / 2, v + 0.5 * omega / 2))
        rates = inverse_acceleration(DIFFERENTIAL, here.twist, Acceleration2D(*here.acceleration)).speeds
        later, sooner = (DIFFERENTIAL.inverse(trajectory.at(time + d).twist).speeds for d in (h, -h))
        for rate, after, before in zip(rates, later, sooner, strict=True):
            assert rate == pytest.approx((after - before) / (2 * h), abs=1e-3)
