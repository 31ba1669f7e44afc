"""The ramp: straight through twist space, no limit ever exceeded, a stop never delayed."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import InputError, Limits, Pose2D, Twist2D
from trundle.command import Ramp, RampState

PERIOD = 0.02
TWISTS = st.builds(Twist2D, st.floats(-1, 1), st.floats(-1, 1), st.floats(-3, 3))
RATES = st.one_of(st.none(), st.floats(0.1, 5.0))
REST = Twist2D()


def speed(twist):
    return math.hypot(twist.vx, twist.vy)


def minus(a, b):
    return Twist2D(a.vx - b.vx, a.vy - b.vy, a.omega - b.omega)


def run(ramp, state, wanted, steps=5000, seconds=PERIOD):
    """Twists of every step until the wanted one is reached."""
    twists = [state.twist]
    for _ in range(steps):
        state = ramp.step(state, wanted, seconds)
        twists.append(state.twist)
        if state.twist == wanted:
            return twists
    raise AssertionError(f"{wanted} not reached, at {state}")


@given(
    start=TWISTS,
    wanted=TWISTS,
    limits=st.builds(
        Limits,
        max_acceleration=RATES,
        max_deceleration=RATES,
        max_yaw_acceleration=RATES,
        max_jerk=st.one_of(st.none(), st.floats(1.0, 20.0)),
    ),
)
def test_moves_on_the_straight_line_and_arrives(start, wanted, limits):
    twists = run(Ramp(limits, PERIOD), RampState(start), wanted)
    path = minus(wanted, start)
    slowest = limits.max_acceleration or math.inf
    slowing = limits.max_deceleration or slowest
    for before, after in itertools.pairwise(twists):
        change, done = minus(after, before), minus(after, start)
        if wanted != REST:  # a stop may leave it: translation does not wait for the yaw rate
            crosses = (
                done.vx * path.vy - done.vy * path.vx,
                done.vx * path.omega - done.omega * path.vx,
                done.vy * path.omega - done.omega * path.vy,
            )
            assert crosses == pytest.approx((0.0, 0.0, 0.0), abs=1e-8)
        falls = speed(after) < speed(before)
        assert speed(change) <= (slowing if falls else slowest) * PERIOD + 2e-9
        assert abs(change.omega) <= (limits.max_yaw_acceleration or math.inf) * PERIOD + 2e-9


@given(
    wanted=st.lists(st.tuples(TWISTS, st.integers(1, 60), st.floats(0.2, 2.0)), min_size=1, max_size=8),
    jerk=st.floats(1.0, 30.0),
)
def test_no_limit_is_exceeded_whatever_is_wanted(wanted, jerk):
    """Minds change in the middle of ramps, periods vary: acceleration, jerk and speed stay limited."""
    limits = Limits(max_acceleration=1.0, max_yaw_acceleration=4.0, max_jerk=jerk)

    def load(twist):
        return max(speed(twist), abs(twist.omega) / 3.0)

    ramp, state = Ramp(limits, PERIOD, load), RampState()
    for goal, steps, stretch in wanted:
        goal = goal * min(1.0, 1.0 / (load(goal) or 1.0))
        if goal == REST:
            continue
        for _ in range(steps):
            seconds = stretch * PERIOD
            after = ramp.step(state, goal, seconds)
            change = minus(after.acceleration, state.acceleration)
            assert speed(change) <= jerk * seconds + 1e-12
            assert speed(after.acceleration) <= 1.0 + 1e-12
            assert abs(after.acceleration.omega) <= 4.0 + 1e-12
            assert load(after.twist) <= 1.0 + 1e-9
            moved = minus(minus(after.twist, state.twist), after.acceleration * seconds)
            assert max(map(abs, (moved.vx, moved.vy, moved.omega))) <= 2e-9
            state = after
    assert run(ramp, state, Twist2D(0.3, 0.1, -0.2))[-1] == Twist2D(0.3, 0.1, -0.2)


def test_jerk_limited_ramp_is_as_fast_as_an_s_curve():
    """Within three periods of the closed form: v/a + a/j."""
    ramp = Ramp(Limits(max_acceleration=1.0, max_jerk=4.0), PERIOD)
    twists = run(ramp, RampState(), Twist2D(2.0, 0.0, 0.0))
    near = next(k for k, twist in enumerate(twists) if twist.vx > 2.0 - 1e-3)
    assert near * PERIOD == pytest.approx(2.0 / 1.0 + 1.0 / 4.0, abs=3 * PERIOD)


def test_turning_back_slows_at_one_rate_and_speeds_up_at_the_other():
    ramp = Ramp(Limits(max_acceleration=0.5, max_deceleration=2.0), PERIOD)
    twists = run(ramp, RampState(Twist2D(1.0, 0.0, 0.0)), Twist2D(-1.0, 0.0, 0.0))
    assert (len(twists) - 1) * PERIOD == pytest.approx(1.0 / 2.0 + 1.0 / 0.5, abs=PERIOD)


def fault_k6():
    """From rest the whole twist grows: the curvature is right from the first step."""
    limits = Limits(max_acceleration=0.5, max_yaw_acceleration=3.2)
    for wanted in (Twist2D(1.0, 0.0, 1.0), Twist2D(0.3, 0.0, -2.0), Twist2D(-1.0, 0.0, 0.1)):
        twists = run(Ramp(limits, PERIOD), RampState(), wanted)
        pose = Pose2D()
        for twist in twists[1:]:
            assert abs(twist.omega / twist.vx - wanted.omega / wanted.vx) <= 1e-9
            pose @= Pose2D.exp(twist * PERIOD)
        radius = wanted.vx / wanted.omega  # and so the robot is on the circle that was meant
        assert math.hypot(pose.x, pose.y - radius) == pytest.approx(abs(radius), abs=1e-9)


def fault_k7():
    """A limit lowered while faster: down at the deceleration limit, on the line, not in one step."""
    ramp = Ramp(Limits(max_acceleration=0.5, max_deceleration=1.0), PERIOD, lambda twist: speed(twist) / 0.4)
    twists = run(ramp, RampState(Twist2D(1.0, 0.0, 0.5)), Twist2D(0.4, 0.0, 0.2))
    steps = [before.vx - after.vx for before, after in itertools.pairwise(twists)]
    assert steps[:-1] == pytest.approx([1.0 * PERIOD] * (len(steps) - 1))
    assert len(steps) == pytest.approx(0.6 / PERIOD, abs=1)
    assert all(twist.omega == pytest.approx(0.5 * twist.vx) for twist in twists)


def fault_k8():
    """dt is clamped to [0, 2 periods]; a stop goes on when the clock does not."""
    ramp, going = Ramp(Limits(max_acceleration=1.0), PERIOD), RampState(Twist2D(0.5, 0.0, 0.5))
    wanted = Twist2D(1.0, 0.0, 1.0)
    for none in (0.0, -1.0, -1e9, math.nan):
        assert ramp.step(going, wanted, none) == going
    twice = ramp.step(going, wanted, 2 * PERIOD).twist
    assert ramp.step(going, wanted, 10 * PERIOD).twist == twice
    assert ramp.step(going, wanted, math.inf).twist == twice
    assert twice.vx == pytest.approx(0.5 + 2 * PERIOD)
    for none in (0.0, -5.0):
        stopping = ramp.step(going, REST, none).twist
        assert stopping.vx == pytest.approx(0.5 - PERIOD)
        assert stopping.omega == pytest.approx(stopping.vx)


@pytest.mark.parametrize(
    ("row", "check"),
    [
        pytest.param("K6", fault_k6, id="K6"),
        pytest.param("K7", fault_k7, id="K7"),
        pytest.param("K8", fault_k8, id="K8"),
    ],
)
def test_fault(row, check):
    check()


@given(start=TWISTS, jerk=st.one_of(st.none(), st.floats(0.1, 10.0)), was=TWISTS, yaw=RATES)
def test_a_stop_is_never_delayed(start, jerk, was, yaw):
    """At the full deceleration from the first step, whatever the jerk limit and the acceleration were."""
    limits = Limits(max_acceleration=0.7, max_deceleration=1.5, max_jerk=jerk, max_yaw_acceleration=yaw)
    state = RampState(start, was)
    for k in range(1, 60):
        state = Ramp(limits, PERIOD).step(state, REST, PERIOD)
        assert speed(state.twist) == pytest.approx(max(0.0, speed(start) - k * 1.5 * PERIOD), abs=1e-12)
        assert abs(state.twist.omega) <= abs(start.omega)


def test_a_stop_is_at_once_where_no_limit_is_given():
    state = Ramp(Limits(), PERIOD).step(RampState(Twist2D(1.0, 0.5, 2.0)), REST, PERIOD)
    assert state.twist == REST


def test_a_stop_keeps_the_curvature_where_translation_takes_longer():
    ramp = Ramp(Limits(max_acceleration=1.0, max_yaw_acceleration=10.0), PERIOD)
    for twist in run(ramp, RampState(Twist2D(1.0, 0.0, 2.0)), REST)[:-1]:
        assert twist.omega == pytest.approx(2.0 * twist.vx)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_refused(bad):
    with pytest.raises(InputError, match="finite"):
        Ramp(Limits(), PERIOD).step(RampState(), Twist2D(bad, 0.0, 0.0), PERIOD)
