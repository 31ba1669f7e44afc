"""Trajectories judged by others: against evo, closed forms, and what must not change."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trundle.errors import InputError, ShapeError, Unobservable
from trundle.evaluate import (
    Alignment,
    Stamps,
    Statistics,
    align,
    align_origin,
    ape,
    associate,
    compare,
    interpolate,
    nees,
    rpe,
    since_start,
    transform,
)
from trundle.geometry import Pose2D, se2
from trundle.records import Trajectory

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND


def trajectory(poses, *, start=EPOCH, step=SECOND // 10, **columns):
    poses = np.asarray(poses, dtype=float)
    return Trajectory(time_ns=start + step * np.arange(len(poses)), poses=poses, **columns)


def wander(seed, samples=200, noise=0.0, step=0.1):
    """A winding path, and the same one with steps that are off."""
    rng = np.random.default_rng(seed)
    motion = np.column_stack(
        [
            rng.uniform(0.0, 2.0 * step, samples),
            rng.normal(0, 0.1 * step, samples),
            rng.normal(0, 0.2, samples),
        ]
    )
    motions = (motion, motion + rng.normal(0.0, [noise, noise, 3.0 * noise], motion.shape))
    return tuple(trajectory(fold(m)) for m in motions)


def fold(motions):
    poses = [np.zeros(3)]
    for motion in motions:
        poses.append(se2.compose(poses[-1], se2.exp(motion)))
    return np.array(poses)


def values(statistics):
    return [getattr(statistics, name) for name in ("rmse", "mean", "median", "std", "min", "max")]


# evo: another library's numbers


def as_evo(t):
    lie = pytest.importorskip("evo.core.lie_algebra", reason="evo is not installed")
    from evo.core.trajectory import PoseTrajectory3D

    def matrix(x, y, theta):
        c, s = math.cos(theta), math.sin(theta)
        return lie.se3(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([x, y, 0.0]))

    return PoseTrajectory3D(poses_se3=[matrix(*p) for p in t.poses], timestamps=t.time_ns * 1e-9)


@pytest.fixture
def evo():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("evo.core.metrics", reason="evo is not installed")


def evo_statistics(metric, pair):
    metric.process_data(pair)
    found = metric.get_all_statistics()
    return [found[name] for name in ("rmse", "mean", "median", "std", "min", "max")]


@pytest.mark.parametrize("seed", range(3))
def test_compare_says_what_evo_says(evo, seed):
    reference, estimate = wander(seed, noise=0.01)
    estimate = transform(estimate, Pose2D(3.0, -2.0, 2.5))
    ours = compare(estimate, reference)

    truth, other = as_evo(reference), as_evo(estimate)
    other.align(truth)
    relation = evo.PoseRelation
    for mine, kind in (
        (ours.position, relation.translation_part),
        (ours.heading, relation.rotation_angle_rad),
    ):
        assert values(mine) == pytest.approx(evo_statistics(evo.APE(kind), (truth, other)), abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_rpe_says_what_evo_says(evo, seed):
    reference, estimate = wander(seed, noise=0.01)
    pair = as_evo(reference), as_evo(estimate)
    frames, metres = evo.Unit.frames, evo.Unit.meters
    cases = [
        (rpe(estimate, reference, time=0.7), {"delta": 7, "delta_unit": frames, "all_pairs": True}),
        (rpe(estimate, reference, time=0.7, all_pairs=False), {"delta": 7, "delta_unit": frames}),
        (
            rpe(estimate, reference, distance=1.234, all_pairs=False),
            {"delta": 1.234, "delta_unit": metres, "pairs_from_reference": True},
        ),
    ]
    relation = evo.PoseRelation
    for errors, options in cases:
        for column, kind in (
            (errors.position, relation.translation_part),
            (errors.heading, relation.rotation_angle_rad),
        ):
            theirs = evo_statistics(evo.RPE(kind, **options), pair)
            assert values(Statistics.of(column)) == pytest.approx(theirs, abs=1e-9)


# what must not change

offsets = st.builds(
    Pose2D, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-10.0, 10.0)
)  # fmt: skip
seeds = st.integers(0, 2**32 - 1)


@settings(max_examples=50, deadline=None)
@given(seeds, offsets)
def test_errors_do_not_depend_on_the_common_frame(seed, offset):
    reference, estimate = wander(seed, samples=30, noise=0.02)
    moved = transform(reference, offset), transform(estimate, offset)
    before, after = ape(estimate, reference), ape(moved[1], moved[0])
    np.testing.assert_allclose(after.position, before.position, atol=1e-9)
    np.testing.assert_allclose(after.heading, before.heading, atol=1e-9)
    relative = rpe(estimate, reference, time=0.5), rpe(moved[1], moved[0], time=0.5)
    np.testing.assert_allclose(relative[1].position, relative[0].position, atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(seeds, offsets)
def test_align_undoes_a_transform_and_cannot_be_improved(seed, offset):
    reference, estimate = wander(seed, samples=30, noise=0.02)
    found = align(transform(reference, offset), reference) @ offset
    np.testing.assert_allclose([found.x, found.y, math.sin(found.theta)], 0.0, atol=1e-9)

    best = align(estimate, reference)
    squares = [
        float(np.sum(ape(transform(estimate, nudge @ best), reference).position ** 2))
        for nudge in (
            Pose2D(),
            *(Pose2D(*(sign * 1e-3 * axis)) for axis in np.eye(3) for sign in (-1.0, 1.0)),
        )
    ]
    assert min(squares) == squares[0]


def test_nothing_is_changed_in_place():
    reference, estimate = wander(1, noise=0.01)
    kept = reference.poses.copy(), estimate.poses.copy()
    compare(estimate, reference, time_offset=0.05)
    assert np.array_equal(reference.poses, kept[0])
    assert np.array_equal(estimate.poses, kept[1])


# association


def circle(time_ns, radius=2.0, speed=0.5):
    angle = speed / radius * (time_ns - EPOCH) * 1e-9
    return np.column_stack([radius * np.sin(angle), radius * (1.0 - np.cos(angle)), angle])


def on_circle(step, samples, start=EPOCH):
    time_ns = start + step * np.arange(samples)
    return Trajectory(time_ns=time_ns, poses=circle(time_ns))


def test_interpolation_is_exact_on_arcs():
    coarse = on_circle(SECOND, 20)
    wanted = EPOCH + np.array([0, 1, SECOND // 3, 7 * SECOND + 123_456_789, 19 * SECOND])
    np.testing.assert_allclose(interpolate(coarse, wanted).poses, circle(wanted), atol=1e-14)


@pytest.mark.parametrize("stamps", Stamps)
def test_trajectories_with_other_stamps_agree_where_they_are_the_same(stamps):
    estimate, reference = on_circle(SECOND // 3, 60), on_circle(SECOND // 10, 150, start=EPOCH + 2 * SECOND)
    found = compare(estimate, reference, stamps=stamps)
    assert found.position.max < 1e-12
    assert found.heading.max < 1e-12
    kept = reference if stamps is Stamps.REFERENCE else estimate
    assert np.isin(found.reference.time_ns, kept.time_ns).all()
    assert found.overlap == pytest.approx(14.9)


def test_samples_at_the_same_time_come_through_untouched():
    reference, estimate = wander(3, noise=0.01)
    reference = trajectory(reference.poses * [1, 1, math.nan])
    e, r = associate(estimate, reference)
    assert np.array_equal(e.poses, estimate.poses)
    assert np.array_equal(r.poses, reference.poses, equal_nan=True)


def test_time_offset_is_added_to_the_estimate():
    reference = on_circle(SECOND // 10, 100)
    late = Trajectory(time_ns=reference.time_ns - 3600 * SECOND, poses=reference.poses)
    assert compare(late, reference, time_offset=3600.0).position.max < 1e-12
    with pytest.raises(InputError, match=r"time_offset=3600\.000 .* starts them together"):
        compare(late, reference)
    with pytest.raises(InputError, match="time_offset: nan"):
        compare(late, reference, time_offset=math.nan)


def test_gaps_are_not_interpolated_over_and_nothing_is_extrapolated():
    estimate = on_circle(SECOND // 10, 101)
    kept = np.r_[0:30, 60:90]
    reference = Trajectory(time_ns=estimate.time_ns[kept] + 1, poses=circle(estimate.time_ns[kept] + 1))
    e, _ = associate(estimate, reference, stamps=Stamps.ESTIMATE, max_gap=0.5)
    assert np.array_equal(e.time_ns, estimate.time_ns[np.r_[1:30, 61:90]])
    e, _ = associate(estimate, reference, stamps=Stamps.ESTIMATE, max_gap=math.inf)
    assert np.array_equal(e.time_ns, estimate.time_ns[1:90])


def test_samples_without_a_position_are_left_out():
    reference, estimate = wander(4, noise=0.01)
    poses = reference.poses.copy()
    poses[50:60] = math.nan
    e, r = associate(estimate, trajectory(poses), max_gap=0.15, stamps=Stamps.ESTIMATE)
    assert len(e) == len(estimate) - 10
    assert np.isfinite(r.poses).all()


def test_a_heading_that_wraps_is_interpolated_the_short_way():
    two = trajectory([[0, 0, math.pi - 0.1], [0, 0, 0.1 - math.pi]])
    assert interpolate(two, two.time_ns[:1] + SECOND // 20).poses[0, 2] == pytest.approx(math.pi)


def test_without_headings_positions_are_interpolated_along_lines():
    two = trajectory([[0, 0, math.nan], [1, 2, math.nan]])
    middle = interpolate(two, two.time_ns[:1] + SECOND // 20).poses[0]
    np.testing.assert_allclose(middle, [0.5, 1.0, math.nan])


# what the reference does not tell


def test_a_reference_without_headings_tells_positions_only():
    reference, estimate = wander(5, noise=0.01)
    dots = trajectory(reference.poses * [1, 1, math.nan])
    full, found = compare(estimate, reference), compare(estimate, dots)
    assert found.ate == full.ate
    assert found.matched == len(reference)
    for missing in (found.heading, found.rpe_position, found.rpe_heading, found.drift, found.anees):
        assert missing is None
    with pytest.raises(InputError, match="heading"):
        compare(estimate, dots, alignment=Alignment.ORIGIN)


def test_a_path_shorter_than_the_step_has_no_relative_error():
    reference, estimate = wander(6, samples=20, noise=0.01)
    found = compare(estimate, reference, rpe_distance=1e3)
    assert found.rpe_position is None
    assert found.drift is None
    with pytest.raises(InputError, match="holds no such motion"):
        rpe(estimate, reference, distance=1e3)


# drift in closed form


def test_drift_of_a_wheel_that_is_one_percent_too_small():
    x = np.linspace(0.0, 10.0, 101)
    line = np.column_stack([x, 0 * x, 0 * x])
    found = compare(trajectory(0.99 * line), trajectory(line), rpe_distance=2.0)
    assert found.drift == pytest.approx(0.01, rel=1e-9)
    assert found.heading_drift == pytest.approx(0.0, abs=1e-12)
    assert found.reference_length == pytest.approx(10.0)
    # Errors 0.01 (x - 5), uniform on 10 m: RMSE is the standard deviation of a uniform distribution.
    assert found.ate == pytest.approx(0.01 * np.std(x))


def test_heading_drift_of_a_straight_line_that_bends():
    x = np.linspace(0.0, 10.0, 101)
    line, arc = np.column_stack([x, 0 * x, 0 * x]), se2.exp(np.column_stack([x, 0 * x, 0.02 * x]))
    found = compare(trajectory(arc), trajectory(line), rpe_distance=1.0)
    assert found.heading_drift == pytest.approx(0.02)
    assert found.rpe_position.max == pytest.approx(
        math.hypot(*(se2.exp(np.array([1, 0, 0.02])) - [1, 0, 0])[:2])
    )


def test_alignment_at_the_origin_and_none():
    reference, estimate = wander(7, noise=0.01)
    moved = transform(estimate, Pose2D(1.0, 2.0, 0.5))
    assert compare(moved, reference, alignment=Alignment.ORIGIN).position.min < 1e-12
    assert compare(moved, reference, alignment=Alignment.NONE).position.rmse > 1.0
    assert compare(moved, reference).ate <= compare(moved, reference, alignment=Alignment.ORIGIN).ate


# normalised errors


def random_covariances(rng, count, scale):
    factor = rng.normal(0.0, scale, (count, 3, 3)) * [[1.0], [0.1], [1e-3]]
    return np.einsum("nij,nkj->nik", factor, factor), factor


def test_nees_is_the_square_of_the_whitened_error():
    rng = np.random.default_rng(8)
    covariances, factor = random_covariances(rng, 50, 0.1)
    white = rng.normal(0.0, 1.0, (50, 3))
    estimate = wander(8, samples=49)[0]
    truth = trajectory(se2.compose(estimate.poses, se2.exp(np.einsum("nij,nj->ni", factor, white))))
    judged = trajectory(estimate.poses, covariances=covariances)
    np.testing.assert_allclose(nees(judged, truth), (white**2).sum(axis=1), rtol=1e-6)


def test_nees_leaves_out_what_has_no_inverse():
    poses, covariances = np.zeros((3, 3)), np.stack([np.eye(3), np.diag([1.0, 0.0, 1.0]), np.ones((3, 3))])
    estimate = trajectory(poses, covariances=covariances)
    np.testing.assert_array_equal(nees(estimate, trajectory(poses)), [0.0, math.nan, math.nan])
    with pytest.raises(InputError, match="covariances"):
        nees(trajectory(poses), trajectory(poses))


def test_since_start_takes_the_first_error_out():
    rng = np.random.default_rng(9)
    poses = wander(9, samples=9)[0].poses
    first, own = (random_covariances(rng, n, 0.1)[0] for n in (1, 10))
    own[0] = 0.0
    carry = se2.adjoint(se2.inverse(se2.compose(se2.inverse(poses[0]), poses)))
    carried = np.einsum("nij,jk,nlk->nil", carry, first[0], carry)
    moved = since_start(trajectory(poses, covariances=own + carried))
    np.testing.assert_allclose(moved.covariances, own, atol=1e-15)
    np.testing.assert_allclose(moved.poses[0], 0.0, atol=1e-15)


def test_anees_of_honest_odometry_is_one():
    rng = np.random.default_rng(10)
    sigma, found = np.array([0.01, 0.002, 0.005]), []
    for _ in range(40):
        estimate = np.tile([0.1, 0.0, 0.05], (60, 1))
        truth = fold(estimate + rng.normal(0.0, 1.0, estimate.shape) * sigma)
        covariances = np.zeros((61, 3, 3))
        carry = se2.adjoint(se2.inverse(se2.exp(estimate[0])))
        for k in range(60):
            covariances[k + 1] = carry @ covariances[k] @ carry.T + np.diag(sigma**2)
        judged = trajectory(fold(estimate), covariances=covariances)
        found.append(compare(judged, trajectory(truth)).anees)
    assert np.mean(found) == pytest.approx(1.0, abs=0.3)  # 40 runs, standard error about 0.1


# bad input


def test_trajectories_that_never_meet_are_told_with_both_spans():
    early, late = on_circle(SECOND, 10), on_circle(SECOND, 10, start=EPOCH + 100 * SECOND)
    with pytest.raises(InputError) as caught:
        compare(early, late)
    for part in ("1700000000.000 to 1700000009.000", "1700000100.000 to 1700000109.000"):
        assert part in str(caught.value)


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_too_few_matches_are_told_with_both_spans(samples):
    short, long = on_circle(SECOND, samples), on_circle(SECOND, 10)
    for pair in ((short, long), (long, short)):
        with pytest.raises(InputError, match=r"estimate .*, reference "):
            compare(*pair)


def test_stamps_that_go_back_are_refused():
    back = Trajectory(time_ns=np.array([0, 2, 1]) * SECOND, poses=np.zeros((3, 3)))
    for pair in ((back, on_circle(SECOND, 3)), (on_circle(SECOND, 3), back)):
        with pytest.raises(InputError, match=r"sample 2 at 1.000 s comes after one at 2.000 s"):
            compare(*pair)


def test_a_robot_that_stood_still_has_no_best_rotation():
    still, moving = trajectory(np.full((5, 3), 0.3)), on_circle(SECOND // 10, 5)
    for pair in ((still, moving), (moving, still)):
        with pytest.raises(Unobservable, match="all 5 positions are the same"):
            compare(*pair)
    assert compare(still, still, alignment=Alignment.ORIGIN).position.max < 1e-15


def test_bad_arguments_say_what_is_allowed():
    a, b = on_circle(SECOND, 5), on_circle(SECOND, 6)
    for function in (align, align_origin, ape, nees):
        with pytest.raises(ShapeError, match="associate"):
            function(a, b)
    for step in ({}, {"distance": 1.0, "time": 1.0}):
        with pytest.raises(InputError, match="either distance"):
            rpe(a, a, **step)
    for step in ({"distance": 0.0}, {"time": -1.0}, {"distance": math.nan}, {"time": math.inf}):
        with pytest.raises(InputError, match="must be > 0"):
            rpe(a, a, **step)
    with pytest.raises(InputError, match="max_gap"):
        associate(a, b, max_gap=math.nan)
    with pytest.raises(InputError, match="must be within"):
        interpolate(a, b.time_ns)
    with pytest.raises(InputError, match="not finite"):
        rpe(a, trajectory(np.full((5, 3), math.nan)), distance=1.0)
