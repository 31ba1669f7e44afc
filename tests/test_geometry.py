"""SE(2): scalars and arrays against each other, 50-digit arithmetic and finite differences."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import Pose2D, ShapeError, Twist2D, wrap
from trundle.geometry import se2
from trundle.geometry.angle import excess, sinc

lengths = st.floats(-1e3, 1e3)
# Every size of angle up to pi, near-identity on purpose.
angles = st.one_of(
    st.floats(-math.pi, math.pi),
    st.builds(lambda sign, power: sign * 10.0**power, st.sampled_from([-1.0, 1.0]), st.floats(-300.0, 0.0)),
    st.sampled_from([0.0, 1e-300, -1e-300, 5e-324, math.pi, math.nextafter(math.pi, 0.0), math.pi / 2]),
)
poses = st.builds(Pose2D, lengths, lengths, angles)


def exact_exp(dx: float, dy: float, theta: float) -> tuple[float, float]:
    """Closed form with 50 digits: V(theta) as the textbooks write it."""
    with mpmath.workdps(50):
        t, x, y = mpmath.mpf(theta), mpmath.mpf(dx), mpmath.mpf(dy)
        if t == 0:
            return dx, dy
        # 1 - cos loses digits even here when theta is 1e-300.
        a, b = mpmath.sin(t) / t, 2 * mpmath.sin(t / 2) ** 2 / t
        return a * x - b * y, b * x + a * y


def exact_log(x: float, y: float, theta: float) -> tuple[float, float]:
    with mpmath.workdps(50):
        t = mpmath.mpf(theta)
        half = t / 2
        a = half * mpmath.cot(half) if t != 0 else mpmath.mpf(1)
        return a * x + half * y, a * y - half * x


def close(value: float, exact: float, size: float) -> bool:
    return abs(mpmath.mpf(value) - exact) <= 5e-16 * (1 + size)


@given(lengths, lengths, angles)
def test_exp_is_exact_to_the_last_digits(dx: float, dy: float, theta: float) -> None:
    wanted = exact_exp(dx, dy, theta)
    scalar = Pose2D.exp(Twist2D(dx, dy, theta))
    array = se2.exp(np.array([dx, dy, theta]))
    for value in ((scalar.x, scalar.y), array[:2].tolist()):
        assert close(value[0], wanted[0], math.hypot(dx, dy))
        assert close(value[1], wanted[1], math.hypot(dx, dy))
    assert scalar.theta == array[2] == theta


@given(lengths, lengths, angles)
def test_log_is_exact_to_the_last_digits(x: float, y: float, theta: float) -> None:
    wanted = exact_log(x, y, wrap(theta))  # half a turn is +pi
    scalar = Pose2D(x, y, theta).log()
    array = se2.log(np.array([x, y, theta]))
    for value in ((scalar.vx, scalar.vy), array[:2].tolist()):
        # log stretches by up to pi/2 near half turns; its size is that of the answer too.
        size = 2.0 * math.hypot(x, y)
        assert close(value[0], wanted[0], size)
        assert close(value[1], wanted[1], size)


@given(poses)
def test_log_undoes_exp(pose: Pose2D) -> None:
    there = Pose2D.exp(pose.log())
    size = 1.0 + math.hypot(pose.x, pose.y)
    assert abs(there.x - pose.x) < 1e-14 * size
    assert abs(there.y - pose.y) < 1e-14 * size
    assert abs(wrap(there.theta - pose.theta)) < 1e-15


@given(poses, poses)
def test_scalars_and_arrays_agree(first: Pose2D, second: Pose2D) -> None:
    a, b = (np.array([p.x, p.y, p.theta]) for p in (first, second))
    composed, inverted = first @ second, first.inverse()
    np.testing.assert_allclose(
        se2.compose(a, b), [composed.x, composed.y, composed.theta], rtol=1e-15, atol=1e-12
    )
    np.testing.assert_allclose(
        se2.inverse(a), [inverted.x, inverted.y, inverted.theta], rtol=1e-15, atol=1e-12
    )
    np.testing.assert_allclose(se2.adjoint(a), first.adjoint(), rtol=1e-15, atol=1e-12)


@given(poses)
def test_a_pose_and_its_inverse_cancel(pose: Pose2D) -> None:
    back = pose @ pose.inverse()
    size = 1.0 + math.hypot(pose.x, pose.y)
    assert abs(back.x) < 1e-15 * size * 4
    assert abs(back.y) < 1e-15 * size * 4
    assert back.theta == 0.0


@given(poses, lengths, lengths, st.floats(-1.0, 1.0))
def test_adjoint_moves_twists_between_frames(pose: Pose2D, vx: float, vy: float, omega: float) -> None:
    """T exp(t) T^-1 = exp(Ad t), to first order in a small t."""
    small = Twist2D(vx, vy, omega) * 1e-9
    direct = pose @ Pose2D.exp(small) @ pose.inverse()
    moved = [
        sum(a * b for a, b in zip(row, (small.vx, small.vy, small.omega), strict=True))
        for row in pose.adjoint()
    ]
    size = (1.0 + math.hypot(pose.x, pose.y)) * 1e-12
    assert abs(direct.x - moved[0]) < size
    assert abs(direct.y - moved[1]) < size


@given(lengths, lengths, st.floats(-3.0, 3.0))
def test_right_jacobian_is_the_derivative_of_exp(dx: float, dy: float, theta: float) -> None:
    tangent = np.array([dx, dy, theta])
    step = 1e-6
    base = se2.inverse(se2.exp(tangent))
    columns = []
    for k in range(3):
        delta = np.zeros(3)
        delta[k] = step
        forth = se2.log(se2.compose(base, se2.exp(tangent + delta)))
        back = se2.log(se2.compose(base, se2.exp(tangent - delta)))
        columns.append((forth - back) / (2.0 * step))
    size = 1.0 + math.hypot(dx, dy)
    np.testing.assert_allclose(se2.right_jacobian(tangent), np.array(columns).T, atol=1e-6 * size)


@given(angles)
def test_sinc_and_excess_match_their_series(angle: float) -> None:
    with mpmath.workdps(700):  # enough that angle - sin(angle) keeps digits at 1e-300
        t = mpmath.mpf(angle)
        exact_sinc = mpmath.sin(t) / t if t else mpmath.mpf(1)
        exact_excess = (t - mpmath.sin(t)) / (t * t) if t else mpmath.mpf(0)
        assert abs(sinc(angle) - exact_sinc) < 2.3e-16
        assert abs(float(se2.sinc(np.array(angle))) - exact_sinc) < 2.3e-16
        assert abs(excess(angle) - exact_excess) < 1e-12 * abs(exact_excess) + 5e-324
        assert abs(float(se2.excess(np.array(angle))) - exact_excess) < 1e-14 * abs(exact_excess) + 5e-324


@given(st.floats(-1e6, 1e6))
def test_wrap_keeps_the_direction(angle: float) -> None:
    for wrapped in (wrap(angle), float(se2.wrap(np.array(angle)))):
        assert -math.pi <= wrapped <= math.pi
        assert math.isclose(math.cos(wrapped), math.cos(angle), abs_tol=1e-9)
        assert math.isclose(math.sin(wrapped), math.sin(angle), abs_tol=1e-9)


def test_wrap_gives_plus_pi_for_half_turns() -> None:
    assert wrap(math.pi) == wrap(-math.pi) == math.pi
    assert se2.wrap(np.array([math.pi, -math.pi])).tolist() == [math.pi, math.pi]


def test_headings_are_not_wrapped_by_composition() -> None:
    pose = Pose2D()
    for _ in range(12):
        pose = pose @ Pose2D(0.0, 0.0, math.pi / 2)
    assert pose.theta == 6 * math.pi


@pytest.mark.parametrize(
    ("twist", "curvature"),
    [
        (Twist2D(2.0, 0.0, 1.0), 0.5),
        (Twist2D(-2.0, 0.0, 1.0), -0.5),
        (Twist2D(2.0, 0.0, 0.0), 0.0),
        (Twist2D(0.0, 0.0, -1.0), -math.inf),
        (Twist2D(0.0, 0.0, 0.0), math.nan),
    ],
)
def test_curvature_needs_no_radius(twist: Twist2D, curvature: float) -> None:
    assert twist.curvature == curvature or (math.isnan(curvature) and math.isnan(twist.curvature))


def test_twist_of_another_point_of_the_body() -> None:
    assert Twist2D(1.0, 0.0, 2.0).at(0.0, 0.5) == Twist2D(0.0, 0.0, 2.0)
    assert Twist2D(1.0, 0.0, 2.0).at(1.0, 0.0) == Twist2D(1.0, 2.0, 2.0)


@pytest.mark.parametrize("function", [se2.exp, se2.log, se2.inverse, se2.adjoint, se2.right_jacobian])
def test_arrays_of_another_shape_are_refused(function) -> None:
    with pytest.raises(ShapeError, match=r"\(4, 2\).*must be 3"):
        function(np.zeros((4, 2)))


@pytest.mark.parametrize("function", [se2.exp, se2.log, se2.inverse, se2.adjoint, se2.right_jacobian])
def test_leading_axes_are_batches(function) -> None:
    many = np.random.default_rng(0).normal(size=(2, 5, 3))
    one_by_one = np.array([[function(row) for row in rows] for rows in many])
    np.testing.assert_allclose(function(many), one_by_one, rtol=1e-15, atol=1e-16)
