"""Between wheel speeds and motors: units, signs, stall, effort, and speeds read back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle import ConfigError, Encoder, InputError, Robot, ShapeError, Twist2D
from trundle.command import (
    FeedForward,
    Motor,
    MotorUnit,
    MotorUnits,
    RollingMean,
    RollingMeanState,
    WindowedSpeed,
    WindowState,
)

SPEEDS = st.lists(st.floats(-50, 50), min_size=4, max_size=4)
NAMES = ("front_left", "front_right", "rear_left", "rear_right")
MECANUM = tr.Mecanum(track_width=0.4, wheelbase=0.5, wheel_radius=0.05)
SKID_STEER = tr.SkidSteer(track_width=0.4, wheelbase=0.5, wheel_radius=0.05)
ENCODER = Encoder(ticks_per_revolution=2048.0)
BACKWARDS = Encoder(ticks_per_revolution=2048.0, inverted=True)
ROBOT = Robot(
    drive=MECANUM,
    encoders=dict(zip(NAMES, (ENCODER, BACKWARDS, ENCODER, BACKWARDS), strict=True)),
)


# --------------------------------------------------------------- from a Twist to wheels: Kohanbash


@given(x=st.floats(-3, 3), z=st.floats(-6, 6))
def test_skid_steer_is_kohanbash(x, z):
    left, right = (x - z * 0.4 / 2.0) / 0.05, (x + z * 0.4 / 2.0) / 0.05
    command = SKID_STEER.inverse(Twist2D(x, 0.0, z))
    assert command.speeds == pytest.approx((left, right, left, right), abs=1e-12)
    back = SKID_STEER.forward(command)
    assert (back.vx, back.vy, back.omega) == pytest.approx((x, 0.0, z), abs=1e-12)


@given(x=st.floats(-3, 3), y=st.floats(-3, 3), z=st.floats(-6, 6))
def test_mecanum_is_kohanbash(x, y, z):
    r, arm = 0.05, 0.2 + 0.25  # his WHEEL_SEPARATION_WIDTH and _LENGTH are half distances
    fl, fr = (x - y - arm * z) / r, (x + y + arm * z) / r
    rl, rr = (x + y - arm * z) / r, (x - y + arm * z) / r
    command = MECANUM.inverse(Twist2D(x, y, z))
    assert command.speeds == pytest.approx((fl, fr, rl, rr), abs=1e-11)
    back = MECANUM.forward(command)
    expected = (
        (fl + fr + rl + rr) * r / 4,
        (-fl + fr + rl - rr) * r / 4,
        (-fl + fr - rl + rr) * r / (4 * arm),
    )
    assert (back.vx, back.vy, back.omega) == pytest.approx(expected, abs=1e-12)


# --------------------------------------------------------------------------------- units and signs


@pytest.mark.parametrize(
    ("unit", "one_turn_per_second"),
    [("rad/s", math.tau), ("rpm", 60.0), ("m/s", math.tau * 0.05), ("counts/s", 2048.0)],
)
def test_one_turn_per_second(unit, one_turn_per_second):
    values = MotorUnits(ROBOT, unit).to_motor([math.tau] * 4)
    assert values == pytest.approx([one_turn_per_second, -one_turn_per_second] * 2)


@pytest.mark.parametrize("unit", MotorUnit)
@given(speeds=SPEEDS)
def test_units_and_back(unit, speeds):
    units = MotorUnits(ROBOT, unit, inverted=NAMES[1::2])
    assert units.to_wheel(units.to_motor(speeds)) == pytest.approx(speeds, rel=1e-14, abs=1e-14)


def test_mirrored_motors_are_named():
    units = MotorUnits(Robot(drive=SKID_STEER), "rad/s", inverted=("front_right", "rear_right"))
    ahead = SKID_STEER.inverse(Twist2D(0.05, 0.0, 0.0))
    assert units.to_motor(ahead.speeds) == pytest.approx((1.0, -1.0, 1.0, -1.0))
    assert MotorUnits(Robot(drive=SKID_STEER), "rad/s").to_motor(ahead.speeds) == pytest.approx([1.0] * 4)


def test_unknown_words_are_refused_with_a_hint():
    with pytest.raises(ConfigError, match="did you mean 'rpm'"):
        MotorUnits(ROBOT, "rpms")
    with pytest.raises(ConfigError, match="did you mean 'rear_left'"):
        MotorUnits(ROBOT, "rpm", inverted=["rear_lef"])
    with pytest.raises(InputError, match="encoders"):
        MotorUnits(Robot(drive=MECANUM), "counts/s")
    with pytest.raises(ShapeError, match="must be 4"):
        MotorUnits(ROBOT, "rpm").to_motor([1.0])


# -------------------------------------------------------------------- dead band, stall, normalised


@given(speeds=SPEEDS)
def test_settled_speeds_are_the_nearest_that_motors_hold(speeds):
    settled = Motor(max_speed=40.0, min_speed=3.0).settle(speeds)
    for speed, held in zip(speeds, settled, strict=True):
        allowed = [0.0, 3.0, -3.0] + [speed] * (abs(speed) >= 3.0)
        assert held in allowed
        assert abs(held - speed) == min(abs(value - speed) for value in allowed)


def test_dead_band_is_for_all_wheels_together():
    motor = Motor(max_speed=40.0, dead_band=0.5)
    assert motor.settle((0.1, -0.5, 0.2, 0.0)) == (0.0,) * 4
    assert motor.settle((0.1, -0.6, 0.2, 0.0)) == (0.1, -0.6, 0.2, 0.0)


@given(speeds=SPEEDS)
def test_normalized_keeps_ratios(speeds):
    motor = Motor(max_speed=20.0)
    efforts = motor.normalize(speeds)
    assert max(map(abs, efforts)) <= 1.0
    scale = max(1.0, max(map(abs, speeds)) / 20.0)
    assert motor.speeds(efforts) == pytest.approx([speed / scale for speed in speeds], abs=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"max_speed": 0.0}, {"max_speed": 1.0, "min_speed": 1.0}, {"max_speed": 1.0, "dead_band": -0.1}]
)
def test_impossible_motors_are_refused(wrong):
    with pytest.raises(ConfigError):
        Motor(**wrong)


def test_normalizing_what_is_not_finite_is_refused():
    with pytest.raises(InputError, match="finite"):
        Motor(max_speed=1.0).normalize((1.0, math.nan))


# ------------------------------------------------------------------------------------ feed-forward


@given(
    speed=st.floats(-50, 50),
    wanted=st.floats(-50, 50),
    kv=st.floats(0.01, 2.0),
    ka=st.floats(0.01, 2.0),
)
def test_effort_reaches_the_wanted_speed(speed, wanted, kv, ka):
    """Against the motor's own equation, integrated in small steps."""
    motor = FeedForward(0.0, kv, ka)
    effort = motor.effort_to_reach(speed, wanted, 0.02)
    reached, steps = speed, 200
    for _ in range(steps):
        middle = reached + 0.5 * (0.02 / steps) * (effort - kv * reached) / ka
        reached += (0.02 / steps) * (effort - kv * middle) / ka
    assert reached == pytest.approx(wanted, abs=1e-3)


@given(speed=st.floats(-50, 50), wanted=st.floats(-50, 50))
def test_feed_forward_is_wpilibs(speed, wanted):
    controller = pytest.importorskip("wpimath.controller")
    if abs(speed) < 1e-9:
        return  # from rest we push against the friction that is about to begin, they do not
    for ka in (0.0, 0.3):
        theirs = controller.SimpleMotorFeedforwardRadians(0.7, 1.9, ka, 0.02)
        ours = FeedForward(0.7, 1.9, ka)
        assert ours.effort(speed) == pytest.approx(theirs.calculate(speed))
        assert ours.effort_to_reach(speed, wanted, 0.02) == pytest.approx(theirs.calculate(speed, wanted))


def test_effort_at_rest():
    motor = FeedForward(0.5, 2.0, 0.1)
    assert motor.effort(0.0) == 0.0
    assert motor.effort(0.0, 3.0) == pytest.approx(0.5 + 0.3)
    assert motor.effort(0.0, -3.0) == pytest.approx(-0.5 - 0.3)
    assert motor.effort(-1.0, 3.0) == pytest.approx(-0.5 - 2.0 + 0.3)
    with pytest.raises(ConfigError, match="kv"):
        FeedForward(0.1, -1.0)


# ---------------------------------------------------------------------------------- smoothed speed


def readings(smoother, state, samples):
    found = []
    for time, position in samples:
        speed, state = smoother.step(state, time, position)
        found.append(speed)
    return found


@pytest.mark.parametrize(
    ("smoother", "state", "delay"),
    [(WindowedSpeed(0.1), WindowState(), 0.05), (RollingMean(), RollingMeanState(), 0.05)],
)
def test_delay_is_what_it_says(smoother, state, delay):
    """Of an even acceleration the smoothed speed is exactly the true one, `delay` ago."""
    samples = [(k * 10_000_000, 0.5 * 3.0 * (0.01 * k) ** 2) for k in range(50)]
    for k, smoothed in list(enumerate(readings(smoother, state, samples)))[1:]:
        assert smoothed.speed == pytest.approx(3.0 * (0.01 * k - smoothed.delay), abs=1e-9)
    assert smoothed.delay == pytest.approx(delay)


def test_quantised_slow_motion_has_no_spikes():
    """One count every seven samples: single differences jump by 100, the window by one count in it."""
    samples = [(k * 10_000_000, float(k // 7)) for k in range(200)]
    smoothed = [s.speed for s in readings(WindowedSpeed(0.2), WindowState(), samples)[25:]]
    assert max(smoothed) - min(smoothed) <= 1.0 / 0.2 + 1e-9
    single = [s.speed for s in readings(RollingMean(1), RollingMeanState(), samples)[25:]]
    assert max(single) - min(single) == pytest.approx(100.0)


def test_rolling_mean_is_over_what_has_come():
    samples = [(k * 1_000_000_000, float(k * k)) for k in range(13)]  # single speeds 1, 3, 5, ...
    smoothed = [s.speed for s in readings(RollingMean(10), RollingMeanState(), samples)]
    assert smoothed[:4] == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert smoothed[12] == pytest.approx(sum(2 * k + 1 for k in range(2, 12)) / 10)


@pytest.mark.parametrize(
    ("smoother", "state"), [(WindowedSpeed(), WindowState()), (RollingMean(), RollingMeanState())]
)
def test_time_must_go_on(smoother, state):
    _, state = smoother.step(state, 10, 0.0)
    with pytest.raises(InputError, match="after the last sample"):
        smoother.step(state, 10, 1.0)


@pytest.mark.parametrize("wrong", [0, 2.5])
def test_impossible_windows_are_refused(wrong):
    with pytest.raises(ConfigError):
        RollingMean(wrong)
    with pytest.raises(ConfigError):
        WindowedSpeed(-1.0)
