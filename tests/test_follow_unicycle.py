"""Unicycle control: K-State's Jacobian, the steering laws, and goals reached from anywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import ConfigError, Differential, Pose2D, Twist2D
from trundle.command import to_field
from trundle.follow import (
    GoToAngle,
    GoToGoal,
    GoToPose,
    Status,
    point_forward,
    regulate_heading,
    within_limits,
)

R, L = 0.05, 0.3
DRIVE = Differential(track_width=L, wheel_radius=R)
SPEED = st.floats(-20.0, 20.0)
ANGLE = st.floats(-10.0, 10.0)


def test_jacobian_is_k_states():
    """J = R/2L [L L; 2 -2] on (v_r, v_l); ours is on (left, right), and has the row of zeros."""
    forward, sideways, turn = DRIVE.jacobian()
    assert forward == pytest.approx((R / 2, R / 2))
    assert sideways == pytest.approx((0.0, 0.0))
    assert turn == pytest.approx((-R / L, R / L))
    theirs = R / (2 * L) * np.array([[L, L], [2, -2]])
    assert np.array([forward[::-1], turn[::-1]]) == pytest.approx(theirs)


@given(v=st.floats(-2, 2), omega=st.floats(-5, 5))
def test_inverse_is_k_states(v, omega):
    left, right = DRIVE.inverse(Twist2D(v, 0.0, omega)).speeds
    assert right == pytest.approx((2 * v + omega * L) / (2 * R), abs=1e-12)
    assert left == pytest.approx((2 * v - omega * L) / (2 * R), abs=1e-12)
    jacobian = np.array(DRIVE.jacobian())
    assert jacobian @ (left, right) == pytest.approx([v, 0.0, omega], abs=1e-12)


@given(left=SPEED, right=SPEED, heading=ANGLE)
def test_global_velocities_are_k_states(left, right, heading):
    """[x' y' theta'] = [cos 0; sin 0; 0 1] [V omega]."""
    v, omega = R / 2 * (right + left), R / L * (right - left)
    field = to_field(DRIVE.forward((left, right)), heading)
    assert (field.vx, field.vy, field.omega) == pytest.approx(
        (v * math.cos(heading), v * math.sin(heading), omega), abs=1e-12
    )


@given(heading=ANGLE, wanted=ANGLE, turns=st.integers(-3, 3))
def test_heading_regulator_turns_the_shorter_way(heading, wanted, turns):
    omega = regulate_heading(heading, wanted + math.tau * turns, gain=2.0)
    assert abs(omega) <= 2.0 * math.pi * (1 + 1e-12)
    assert math.remainder(heading + omega / 2.0 - wanted, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert abs(regulate_heading(heading, wanted, gain=2.0, max_yaw_rate=0.5)) <= 0.5


def test_heading_regulator_across_the_half_turn():
    omega = regulate_heading(math.radians(170), math.radians(-170), gain=1.0)
    assert omega == pytest.approx(math.radians(20))


@given(heading=ANGLE, wanted=ANGLE, speed=st.floats(-2, 2), distance=st.floats(0.05, 1.0))
def test_point_ahead_moves_exactly_as_wanted(heading, wanted, speed, distance):
    twist = point_forward(heading, wanted, speed, distance=distance)
    assert twist.vx == pytest.approx(math.cos(wanted - heading) * speed)
    assert twist.omega == pytest.approx(math.sin(wanted - heading) * speed / distance)
    point = to_field(twist.at(distance, 0.0), heading)
    assert (point.vx, point.vy) == pytest.approx(
        (speed * math.cos(wanted), speed * math.sin(wanted)), abs=1e-12
    )


def test_point_forward_brings_the_heading_round():
    pose = Pose2D(0.0, 0.0, 3.0)
    for _ in range(300):
        pose = pose @ Pose2D.exp(point_forward(pose.theta, 0.5, 0.4, distance=0.2) * 0.02)
    assert math.remainder(pose.theta - 0.5, math.tau) == pytest.approx(0.0, abs=1e-3)


def test_limits_keep_the_curvature():
    twist = within_limits(Twist2D(2.0, 0.0, 3.0), 1.0, 1.0)
    assert (twist.vx, twist.omega) == pytest.approx((2.0 / 3.0, 1.0))
    assert within_limits(Twist2D(0.5, 0.0, 0.5), 1.0, 1.0) == Twist2D(0.5, 0.0, 0.5)


# ------------------------------------------------------------------------ goals

PERIOD = 0.05
STEPS = 2000


def starts(count=1000, seed=4):
    chance = np.random.default_rng(seed)
    places = chance.uniform(-5.0, 5.0, (count, 2))
    headings = chance.uniform(-math.pi, math.pi, (count, 2))
    return [(Pose2D(x, y, a), b) for (x, y), (a, b) in zip(places.tolist(), headings.tolist(), strict=True)]


def drive_to(guide, pose):
    """The simulated robot: wheels turn at what `inverse` says; the last guidance and the fastest twist."""
    fastest, turned = 0.0, 0.0
    for _ in range(STEPS):
        guidance = guide(pose)
        if guidance.status.stops:
            return guidance, pose, fastest, turned
        twist = DRIVE.forward(DRIVE.inverse(guidance.twist))
        fastest, turned = max(fastest, abs(twist.vx)), max(turned, abs(twist.omega))
        pose = pose @ Pose2D.exp(twist * PERIOD)
    return guidance, pose, fastest, turned


@pytest.mark.parametrize("backward", [False, True])
def test_goal_is_reached_from_a_thousand_starts(backward):
    law = GoToGoal(max_speed=1.0, max_yaw_rate=2.0, backward=backward)
    for start, _ in starts():
        guidance, pose, fastest, turned = drive_to(lambda pose: law.guide(pose, (0.5, -0.2)), start)
        assert guidance.status is Status.ARRIVED, start
        assert math.dist((pose.x, pose.y), (0.5, -0.2)) <= law.tolerance
        assert fastest <= 1.0 + 1e-9
        assert turned <= 2.0 + 1e-9


@pytest.mark.parametrize("backward", [False, True])
def test_pose_is_reached_from_a_thousand_starts(backward):
    law = GoToPose(max_speed=1.0, max_yaw_rate=2.0, backward=backward)
    for start, heading in starts():
        goal = Pose2D(0.5, -0.2, heading)
        guidance, pose, fastest, turned = drive_to(lambda pose, goal=goal: law.guide(pose, goal), start)
        assert guidance.status is Status.ARRIVED, (start, goal)
        assert math.dist((pose.x, pose.y), (0.5, -0.2)) <= law.tolerance
        assert abs(math.remainder(pose.theta - heading, math.tau)) <= law.angle_tolerance
        assert fastest <= 1.0 + 1e-9
        assert turned <= 2.0 + 1e-9


def test_angle_is_reached_from_a_thousand_starts():
    law = GoToAngle(max_yaw_rate=2.0)
    for start, wanted in starts():
        guidance, pose, *_ = drive_to(lambda pose, wanted=wanted: law.guide(pose.theta, wanted), start)
        assert guidance.status is Status.ARRIVED
        assert (pose.x, pose.y) == (start.x, start.y)
        assert abs(pose.theta - start.theta) <= math.pi + law.tolerance
        assert abs(math.remainder(pose.theta - wanted, math.tau)) <= law.tolerance


def test_robot_that_may_not_back_never_does():
    pose = Pose2D(0.0, 0.0, 0.0)
    for law in (GoToGoal(), GoToPose()):
        goal = (-2.0, 0.1) if isinstance(law, GoToGoal) else Pose2D(-2.0, 0.1, 0.0)
        assert law.guide(pose, goal).twist.vx == 0.0
        assert type(law)(backward=True).guide(pose, goal).twist.vx < 0.0


@pytest.mark.parametrize("row", [pytest.param("K15", id="K15-goal_behind")])
def test_fault(row):
    """Exactly behind, where a cosine alone would drive away or stand still."""
    start = Pose2D(0.0, 0.0, 0.0)
    for law, goal in (
        (GoToGoal(), (-2.0, 0.0)),
        (GoToGoal(backward=True), (-2.0, 0.0)),
        (GoToPose(), Pose2D(-2.0, 0.0, 0.0)),
        (GoToPose(backward=True), Pose2D(-2.0, 0.0, 0.0)),
        (GoToPose(backward=True), Pose2D(-2.0, 0.0, math.pi)),
    ):
        guidance, *_ = drive_to(lambda pose, law=law, goal=goal: law.guide(pose, goal), start)
        assert guidance.status is Status.ARRIVED, (law, goal)


@pytest.mark.parametrize("law", [GoToAngle(), GoToGoal(), GoToPose()])
def test_pose_that_is_not_a_number_stops_and_a_goal_that_is_none_raises(law):
    nan = math.nan
    goals = {GoToAngle: (1.0, nan), GoToGoal: ((1.0, 1.0), (1.0, nan)), GoToPose: (Pose2D(1.0), Pose2D(nan))}
    goal, no_goal = goals[type(law)]
    here = (lambda theta: theta) if isinstance(law, GoToAngle) else (lambda theta: Pose2D(0.0, 0.0, theta))
    guidance = law.guide(here(nan), goal)
    assert guidance.status is Status.NO_POSE
    assert guidance.twist == Twist2D()
    with pytest.raises(ConfigError):
        law.guide(here(0.0), no_goal)


@pytest.mark.parametrize("make", [lambda: GoToAngle(gain=-1.0), lambda: GoToGoal(tolerance=0.0)])
def test_gains_are_positive(make):
    with pytest.raises(ConfigError, match="must be > 0"):
        make()
