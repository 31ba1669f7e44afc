"""Paths: closed forms, finite differences, one metre per metre, and what is refused (FAULTS.md K13, K15)."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from trundle import InputError, PathError, Pose2D
from trundle.follow import (
    CircularArc,
    Knot,
    Line,
    Path,
    cubic_hermite,
    quintic_between,
    quintic_hermite,
    spline_through,
)

PLACE = st.floats(-5.0, 5.0)
ANGLE = st.floats(-3.0, 3.0)


def around(count=200, radius=2.0):
    angles = np.linspace(0.0, 1.5 * math.pi, count)
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


CURVES = {
    "line": Line((1.0, 2.0), (-2.0, 6.0)),
    "arc": CircularArc(Pose2D(1.0, 0.0, 0.5), 0.8, -2.5),
    "cubic": cubic_hermite(Knot(0.0, 0.0, 3.0, 0.0), Knot(2.0, 1.0, 0.0, 4.0)),
    "quintic": quintic_hermite(Knot(0.0, 0.0, 3.0, 1.0, 2.0, 1.0), Knot(4.0, 1.0, 2.0, -2.0, 0.5, 3.0)),
    "through points": spline_through([(0, 0), (1, 0.2), (2, 1.0), (2.2, 2.0), (1.5, 3.0)]),
    "half turned": quintic_between(Pose2D(0.0, 0.0, 3.0), Pose2D(-2.0, 1.0, -3.0)),
}


@pytest.mark.parametrize("name", CURVES)
def test_curves_run_at_one_metre_per_metre(name):
    curve = CURVES[name]
    h = 1e-5
    for share in np.linspace(0.01, 0.99, 60):
        s = float(share) * curve.length
        before, here, after = curve.at(s - h), curve.at(s), curve.at(s + h)
        assert math.dist((before.x, before.y), (after.x, after.y)) == pytest.approx(2 * h, rel=1e-6)
        along = math.atan2(after.y - before.y, after.x - before.x)
        assert math.remainder(along - here.course, math.tau) == pytest.approx(0.0, abs=1e-6)
        assert (after.course - before.course) / (2 * h) == pytest.approx(here.curvature, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("name", ["arc", "cubic", "quintic", "half turned"])
def test_change_of_curvature_is_its_derivative(name):
    curve = CURVES[name]
    h = 1e-5
    for share in np.linspace(0.01, 0.99, 60):
        s = float(share) * curve.length
        difference = (curve.at(s + h).curvature - curve.at(s - h).curvature) / (2 * h)
        assert difference == pytest.approx(curve.at(s).curvature_change, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("name", ["cubic", "quintic", "half turned"])
def test_length_of_splines_is_that_of_fine_chords(name):
    curve = CURVES[name]
    points = [curve.at(s) for s in np.linspace(0.0, curve.length, 20001).tolist()]
    chords = math.fsum(math.dist((a.x, a.y), (b.x, b.y)) for a, b in pairwise(points))
    assert curve.length == pytest.approx(chords, rel=1e-8)


@given(x=PLACE, y=PLACE, start=ANGLE, end=ANGLE)
def test_quintic_meets_its_poses_with_no_curvature(x, y, start, end):
    assume(math.hypot(x, y) > 0.1)
    try:
        curve = quintic_between(Pose2D(0.0, 0.0, start), Pose2D(x, y, end))
    except PathError as error:
        assume("turns on the spot" not in str(error))
        raise
    first, last = curve.at(0.0), curve.at(curve.length)
    assert (first.x, first.y, first.curvature) == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
    assert (last.x, last.y, last.curvature) == pytest.approx((x, y, 0.0), abs=1e-7)
    assert math.remainder(first.course - start, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert math.remainder(last.course - end, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_hermite_ends_are_as_told():
    """Curvature at both ends, from the derivatives by the parameter."""
    start, end = Knot(1.0, 2.0, 3.0, -1.0, 0.5, 4.0), Knot(4.0, 1.0, 2.0, 2.0, -1.0, 3.0)
    curve = quintic_hermite(start, end)
    for knot, at in ((start, 0.0), (end, curve.length)):
        point = curve.at(at)
        speed = math.hypot(knot.dx, knot.dy)
        assert (point.x, point.y) == pytest.approx((knot.x, knot.y))
        assert math.remainder(point.course - math.atan2(knot.dy, knot.dx), math.tau) == pytest.approx(0.0)
        assert point.curvature == pytest.approx((knot.dx * knot.ddy - knot.dy * knot.ddx) / speed**3)


def test_points_of_a_circle_give_its_curvature_and_length():
    curve = spline_through(around())
    assert curve.length == pytest.approx(2.0 * 1.5 * math.pi, rel=1e-6)
    for share in (0.1, 0.37, 0.9):
        assert curve.at(share * curve.length).curvature == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("name", CURVES)
def test_nearest_is_the_best_of_a_fine_search(name):
    curve = CURVES[name]
    samples = [curve.at(s) for s in np.linspace(0.0, curve.length, 2001).tolist()]
    for x, y in ((0.0, 0.0), (1.5, 1.5), (-3.0, 2.0), (4.0, 4.0), (2.0, -1.0)):
        found = curve.at(curve.nearest(x, y))
        best = min(math.dist((x, y), (p.x, p.y)) for p in samples)
        assert math.dist((x, y), (found.x, found.y)) <= best + 1e-9


# ------------------------------------------------------------------------ composites


def s_shape():
    return Path(
        [
            Line((0.0, 0.0), (1.0, 0.0)),
            CircularArc(Pose2D(1.0, 0.0, 0.0), 1.0, math.pi),
            quintic_between(Pose2D(1.0, 2.0, math.pi), Pose2D(-1.0, 3.0, math.pi / 2)),
        ]
    )


def test_headings_are_continuous_though_courses_are_counted_apart():
    path = s_shape() + Path([Line((-1.0, 3.0), (-1.0, 2.0))], backward=True)
    headings = [path.at(s).pose.theta for s in np.linspace(0.0, path.length, 3001).tolist()]
    assert max(abs(b - a) for a, b in pairwise(headings)) < 0.02
    assert headings[-1] == pytest.approx(math.pi / 2)


def test_facing_turns_the_robot_and_not_the_path():
    path = s_shape()
    turned = Path([curve for _, curve in path.curves], facing=(0.0, -1.0))
    h = 1e-4
    for s in (0.3, 1.7, 3.9, 5.0):
        point = turned.at(s)
        assert (point.x, point.y) == (path.at(s).x, path.at(s).y)
        assert (point.forward, point.leftward) == pytest.approx(
            (math.cos(point.course - point.pose.theta), math.sin(point.course - point.pose.theta))
        )
        after, before = turned.at(s + h), turned.at(s - h)
        assert (after.pose.theta - before.pose.theta) / (2 * h) == pytest.approx(point.turn, abs=1e-6)
        assert (after.turn - before.turn) / (2 * h) == pytest.approx(point.turn_change, abs=1e-6)
    assert (turned.at(0.0).pose.theta, turned.at(turned.length).pose.theta) == pytest.approx((0.0, -1.0))


def test_path_beyond_its_ends_is_its_ends():
    path = s_shape()
    assert path.at(-1.0) == path.at(0.0)
    assert path.at(math.inf) == path.at(path.length)
    with pytest.raises(InputError, match="nan, must be a number"):
        path.at(math.nan)
    with pytest.raises(InputError, match="must be finite"):
        path.nearest(math.nan, 0.0)


# ---------------------------------------------------------------------------- faults

BAD_POINTS = {
    "K13-empty": ([], "none given"),
    "K13-one_point": ([(1.0, 2.0)], "1 given"),
    "K13-duplicates_only": ([(1.0, 2.0)] * 5, "1 of them apart"),
    "K13-nan": ([(0.0, 0.0), (1.0, math.nan), (2.0, 0.0)], "point 1 is"),
    "K13-inf": ([(0.0, 0.0), (math.inf, 0.0)], "point 1 is"),
    "K13-text": ([("a", "b"), ("c", "d")], "must be numbers"),
    "K13-shape": ([1.0, 2.0, 3.0], "must be \\(N, 2\\)"),
    "K15-turns_back": ([(0.0, 0.0), (1.0, 0.0), (0.0, 0.1)], "more than 90 degrees at point 1"),
}
BAD_PATHS = {
    "K13-no_curve": (lambda: Path([]), "one curve or more"),
    "K13-gap": (lambda: Path([Line((0, 0), (1, 0)), Line((1, 0.01), (2, 0.01))]), "a gap of 0.01 m"),
    "K13-corner": (lambda: Path([Line((0, 0), (1, 0)), Line((1, 0), (1, 1))]), "corner of 90 degrees"),
    "K13-no_length": (lambda: Line((1, 1), (1, 1)), "no length"),
    "K13-nan_line": (lambda: Line((0, 0), (math.nan, 1)), "no length"),
    "K13-arc_radius": (lambda: CircularArc(Pose2D(), 0.0, 1.0), "radius must be > 0"),
    "K13-arc_nan": (lambda: CircularArc(Pose2D(math.nan), 1.0, 1.0), "must be finite"),
    "K13-still": (lambda: cubic_hermite(Knot(0, 0, 0, 0), Knot(1, 0, 1, 0)), "stands still"),
    "K15-cusp_in_spline": (
        lambda: cubic_hermite(Knot(-0.125, 0.25, 0.75, -1), Knot(0.125, 0.25, 0.75, 1)),
        "corner or cusp",
    ),
    "K15-cusp_unmarked": (
        lambda: Path([Line((0, 0), (1, 0)), Line((1, 0), (0, 0))]),
        "backward=True",
    ),
    "K15-facing_backward": (
        lambda: Path([Line((0, 0), (1, 0))], backward=True, facing=(0, 1)),
        "not `backward`",
    ),
}
ROWS = [
    *(
        pytest.param(lambda p=points: spline_through(p), words, id=row)
        for row, (points, words) in BAD_POINTS.items()
    ),
    *(pytest.param(make, words, id=row) for row, (make, words) in BAD_PATHS.items()),
]


@pytest.mark.parametrize(("make", "words"), ROWS)
def test_fault(make, words):
    with pytest.raises(PathError, match=words):
        make()


def test_duplicates_are_left_out():
    points = around(50)
    doubled = np.repeat(points, 3, axis=0)
    assert spline_through(doubled).length == spline_through(points).length


def test_jitter_of_a_robot_that_stood_still_is_left_out():
    chance = np.random.default_rng(1)
    line = np.stack([np.linspace(0.0, 3.0, 31), np.zeros(31)], axis=1)
    standing = np.array([1.5, 0.0]) + 0.001 * chance.standard_normal((100, 2))
    points = np.concatenate([line[:16], standing, line[16:]])
    with pytest.raises(PathError, match="spacing"):
        spline_through(points)
    assert spline_through(points, spacing=0.02).length == pytest.approx(3.0, rel=1e-3)


def test_million_points():
    """K13: a long spiral that crosses itself; built at once, and finite everywhere."""
    t = np.linspace(0.0, 200.0, 1_000_000)
    path = Path([spline_through(np.stack([np.sin(t), t / 50.0 + np.cos(1.1 * t)], axis=1))])
    chance = np.random.default_rng(0)
    for s in chance.uniform(0.0, path.length, 200).tolist():
        point = path.at(s)
        assert math.isfinite(point.curvature + point.pose.theta + point.turn_change)
    middle = path.at(0.5 * path.length)
    again = path.at(path.nearest(middle.x, middle.y))
    assert math.dist((middle.x, middle.y), (again.x, again.y)) < 1e-6


@given(
    points=st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), max_size=8),
    share=st.floats(0.0, 1.0),
)
def test_points_give_a_path_or_a_path_error(points, share):
    try:
        path = Path([spline_through(points, spacing=0.01)])
    except PathError:
        return
    point = path.at(share * path.length)
    assert all(map(math.isfinite, (point.x, point.y, point.pose.theta, point.curvature, point.turn_change)))
