"""The whole way from a demand to efforts: limits, ramps, stops, and the reason for everything."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trundle as tr
from trundle import ConfigError, InputError, Limits, Pose2D, Robot, Twist2D
from trundle.command import CommandPipeline, Demand, Reason, Saturation, Watchdog, WatchdogState

MS = 1_000_000
PERIOD = 20 * MS
LIMITS = Limits(
    max_speed=1.0,
    max_yaw_rate=2.0,
    max_acceleration=1.0,
    max_deceleration=2.0,
    max_yaw_acceleration=6.0,
    max_wheel_speed=12.0,
)
DIFFERENTIAL = Robot(drive=tr.Differential(track_width=0.4, wheel_radius=0.1), limits=LIMITS)
CAR = Robot(
    drive=tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05),
    limits=Limits(
        max_speed=1.0, max_acceleration=1.0, max_yaw_acceleration=20.0, max_steering=0.5, max_wheel_speed=25.0
    ),
)
MECANUM = Robot(drive=tr.Mecanum(track_width=0.4, wheelbase=0.5, wheel_radius=0.05), limits=LIMITS)
SWERVE = Robot(
    drive=tr.Swerve(modules=[(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)], wheel_radius=0.05),
    limits=LIMITS,
)
SMOOTH = Robot(
    drive=tr.Mecanum(track_width=0.4, wheelbase=0.5, wheel_radius=0.05),
    limits=Limits(
        max_speed=1.0,
        max_yaw_rate=2.0,
        max_acceleration=1.0,
        max_yaw_acceleration=6.0,
        max_jerk=5.0,
        max_wheel_speed=12.0,
    ),
)
ROBOTS = {
    "smooth": SMOOTH,
    "differential": DIFFERENTIAL,
    "ackermann": CAR,
    "mecanum": MECANUM,
    "swerve": SWERVE,
}
TWISTS = st.builds(Twist2D, st.floats(-3, 3), st.floats(-3, 3), st.floats(-6, 6))


def drive_for(pipeline, state, demand, steps, now=0):
    """Commands of so many periods, and the state and time after them."""
    commands = []
    for _ in range(steps):
        now += PERIOD
        command, state = pipeline.step(state, demand, now)
        commands.append(command)
    return commands, state, now


def test_twist_becomes_efforts():
    pipeline = CommandPipeline(Robot(drive=DIFFERENTIAL.drive, limits=Limits(max_wheel_speed=20.0)))
    _, state = pipeline.step(pipeline.start(), Twist2D(), 0)
    command, _ = pipeline.step(state, Twist2D(1.0, 0.0, 1.0), PERIOD)
    assert command.wheels.speeds == pytest.approx((8.0, 12.0))
    assert command.efforts == pytest.approx((0.4, 0.6))
    assert command.reasons == ()
    assert command.twist == Twist2D(1.0, 0.0, 1.0)


def test_a_drive_alone_has_no_limits():
    pipeline = CommandPipeline(DIFFERENTIAL.drive)
    _, state = pipeline.step(pipeline.start(), Twist2D(), 0)
    command, _ = pipeline.step(state, Twist2D(50.0, 0.0, 0.0), PERIOD)
    assert command.wheels.speeds == pytest.approx((500.0, 500.0))
    assert command.efforts == ()


@pytest.mark.parametrize("policy", Saturation)
@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=25)
@given(demands=st.lists(st.tuples(TWISTS, st.integers(1, 40)), min_size=1, max_size=5))
def test_no_limit_is_exceeded_whatever_is_demanded(name, policy, demands):
    robot = ROBOTS[name]
    pipeline, limits = CommandPipeline(robot, saturation=policy), robot.limits
    state, now, before = pipeline.start(), 0, Twist2D()
    for twist, steps in demands:
        commands, state, now = drive_for(pipeline, state, twist, steps, now)
        for command in commands:
            got = command.twist
            assert math.hypot(got.vx, got.vy) <= limits.max_speed * (1 + 1e-9)
            assert abs(got.omega) <= (limits.max_yaw_rate or math.inf) * (1 + 1e-9)
            assert max(map(abs, command.wheels.speeds)) <= limits.max_wheel_speed * (1 + 1e-9)
            assert max(map(abs, command.efforts)) <= 1.0
            reach = limits.max_steering or math.inf
            assert all(abs(angle) <= reach for angle in command.wheels.steering)
            change = math.hypot(got.vx - before.vx, got.vy - before.vy)
            assert change <= max(limits.max_acceleration, limits.max_deceleration or 0.0) * 0.02 + 3e-9
            if name != "ackermann":  # a car's yaw rate follows from its speed and its steering
                assert abs(got.omega - before.omega) <= limits.max_yaw_acceleration * 0.02 + 3e-9
            if not command.reasons:
                assert got == command.target
            before = got


@given(twist=TWISTS)
def test_curvature_is_kept_from_rest_to_the_limit(twist):
    pipeline = CommandPipeline(DIFFERENTIAL)
    if abs(twist.vx) < 0.01:
        return
    commands, *_ = drive_for(pipeline, pipeline.start(), Twist2D(twist.vx, 0.0, twist.omega), 100)
    for command in commands[1:]:
        got, wanted = command.twist.omega / command.twist.vx, twist.omega / twist.vx
        assert abs(got - wanted) <= 1e-9 * max(1.0, abs(wanted))
    assert Reason.ACCELERATION not in commands[-1].reasons


def test_car_goes_backwards_by_way_of_rest():
    pipeline = CommandPipeline(CAR)
    left = Twist2D(0.8, 0.0, 1.0)
    _, state, now = drive_for(pipeline, pipeline.start(), left, 100)
    commands, *_ = drive_for(pipeline, state, Twist2D(-0.8, 0.0, 1.0), 150, now)
    twists = [command.twist for command in commands]
    assert min(abs(twist.vx) for twist in twists) == 0.0
    tightest = 1.0 / (0.1 + 0.3 / math.tan(0.5))
    assert all(abs(twist.omega) <= abs(twist.vx) * tightest * (1 + 1e-9) for twist in twists)
    assert (twists[-1].vx, twists[-1].omega) == pytest.approx((-0.8, 1.0))


def test_infeasible_turn_of_a_car_is_cut_and_said():
    pipeline = CommandPipeline(CAR)
    commands, *_ = drive_for(pipeline, pipeline.start(), Twist2D(0.5, 0.0, 9.0), 100)
    tightest = 1.0 / (0.1 + 0.3 / math.tan(0.5))
    assert commands[-1].twist.omega == pytest.approx(0.5 * tightest)
    assert commands[-1].reasons == (Reason.STEERING,)
    commands, *_ = drive_for(pipeline, pipeline.start(), Twist2D(0.0, 0.0, 1.0), 5)
    assert commands[-1].reasons == (Reason.TURN_ON_THE_SPOT,)
    assert commands[-1].wheels.speeds == (0.0,) * 4


def fault_k2():
    """From the last command to the beginning of the ramp: the timeout and one period at most."""
    dog, pipeline = Watchdog(timeout=LIMITS.command_timeout), CommandPipeline(DIFFERENTIAL)
    watched, state, now = WatchdogState(), pipeline.start(), 0
    speeds = []
    for k in range(150):
        now = k * PERIOD
        if now <= 1_500 * MS:
            watched, last = dog.receive(watched, Twist2D(1.0, 0.0, 0.0), now), now
        command, state = pipeline.step(state, dog.demand(watched, now), now)
        speeds.append((now, command.twist.vx, command.reasons))
    falling = next(time for time, speed, _ in speeds if time > last and speed < 1.0)
    assert falling - last <= 500 * MS + PERIOD
    assert all(
        speed == pytest.approx(max(0.0, 1.0 - 2.0 * ((time - falling) / 1e9 + 0.02)))
        for time, speed, _ in speeds
        if time >= falling
    )
    assert all(Reason.TIMEOUT in reasons for time, _, reasons in speeds if time >= falling)


def fault_k4():
    """The loop stands still for five seconds: zero at first, then the ramp."""
    pipeline = CommandPipeline(DIFFERENTIAL)
    ahead = Twist2D(1.0, 0.0, 0.5)
    commands, state, now = drive_for(pipeline, pipeline.start(), ahead, 100)
    assert commands[-1].twist == ahead
    command, state = pipeline.step(state, ahead, now + 5_000 * MS)
    assert command.twist == Twist2D()
    assert command.wheels.speeds == (0.0, 0.0)
    assert command.efforts == (0.0, 0.0)
    assert command.reasons == (Reason.LOOP_STALLED,)
    commands, *_ = drive_for(pipeline, state, ahead, 100, now + 5_000 * MS)
    assert commands[0].twist.vx == pytest.approx(0.02)
    assert commands[-1].twist == ahead


def fault_k11():
    """An emergency stop while it speeds up, slows down, steers: zero at once, whoever asked."""
    dog = Watchdog()
    for robot in ROBOTS.values():
        pipeline = CommandPipeline(robot)
        for steps, twist in ((3, Twist2D(1.0, 0.0, 1.0)), (80, Twist2D(-1.0, 0.0, 0.5))):
            watched = dog.receive(WatchdogState(), twist, 0)
            _, state, now = drive_for(pipeline, pipeline.start(), twist, steps)
            watched = dog.emergency_stop(watched)
            angles = state.steering.angles
            for k in range(1, 4):
                command, state = pipeline.step(state, dog.demand(watched, now), now + k)
                assert command.twist == Twist2D()
                assert not any(command.wheels.speeds)
                assert command.wheels.steering == angles
                assert command.reasons == (Reason.EMERGENCY_STOP,)
            watched = dog.receive(dog.reset(watched), twist, now)
            assert not any(pipeline.step(state, dog.demand(watched, now), now + PERIOD)[0].wheels.speeds)
            watched = dog.receive(watched, Twist2D(), now)
            watched = dog.receive(watched, twist, now)
            command, _ = pipeline.step(state, dog.demand(watched, now), now + PERIOD)
            assert 0.0 < abs(command.twist.vx) <= 0.05  # again by the ramp


@pytest.mark.parametrize(
    ("row", "check"),
    [
        pytest.param("K2", fault_k2, id="K2"),
        pytest.param("K4", fault_k4, id="K4"),
        pytest.param("K11", fault_k11, id="K11"),
    ],
)
def test_fault(row, check):
    check()


def test_clock_that_goes_back_or_stands_still_changes_nothing_but_a_stop():
    pipeline = CommandPipeline(DIFFERENTIAL)
    ahead = Twist2D(1.0, 0.0, 0.5)
    _, state, now = drive_for(pipeline, pipeline.start(), ahead, 20)
    for time in (now, now - 5_000 * MS):
        command, _ = pipeline.step(state, ahead, time)
        assert command.twist == state.ramp.twist
        command, _ = pipeline.step(state, Twist2D(), time)
        assert command.twist.vx == pytest.approx(state.ramp.twist.vx - 0.04)


def test_limits_lowered_while_faster_ramp_down():
    fast, slow = (
        CommandPipeline(DIFFERENTIAL),
        CommandPipeline(
            DIFFERENTIAL.replace(
                limits=Limits(max_speed=0.4, max_acceleration=1.0, max_deceleration=2.0, max_wheel_speed=4.0)
            )
        ),
    )
    _, state, now = drive_for(fast, fast.start(), Twist2D(1.0, 0.0, 0.0), 100)
    commands, *_ = drive_for(slow, state, Twist2D(1.0, 0.0, 0.0), 30, now)
    speeds = [1.0, *(command.twist.vx for command in commands)]
    assert [a - b for a, b in itertools.pairwise(speeds[:13])] == pytest.approx([0.04] * 12)
    assert speeds[-1] == pytest.approx(0.4)


@given(twist=TWISTS)
def test_discretized_pipeline_lands_where_it_was_meant_to(twist):
    for robot in (MECANUM, SWERVE):
        pipeline = CommandPipeline(
            Robot(drive=robot.drive, limits=Limits(max_wheel_speed=30.0)), discretize=True
        )
        _, state = pipeline.step(pipeline.start(), Twist2D(), 0)
        command, _ = pipeline.step(state, twist, PERIOD)
        if robot is SWERVE and any(pipeline.step(state, twist, PERIOD)[1].steering.held):
            continue
        end = Pose2D.exp(robot.drive.forward(command.wheels) * 0.02)
        meant = command.twist * 0.02
        assert (end.x, end.y, end.theta) == pytest.approx((meant.vx, meant.vy, meant.omega), abs=1e-12)
        assert command.twist.vx * twist.vy == pytest.approx(command.twist.vy * twist.vx, abs=1e-9)


def test_stalling_wheels_are_named():
    pipeline = CommandPipeline(DIFFERENTIAL.drive, min_wheel_speed=2.0)
    _, state = pipeline.step(pipeline.start(), Twist2D(), 0)
    command, state = pipeline.step(state, Twist2D(0.15, 0.0, 0.4), PERIOD)
    assert command.wheels.speeds == pytest.approx((0.0, 2.3))
    assert command.reasons == (Reason.STALL,)


@pytest.mark.parametrize(
    "wrong",
    [{"period": 0.0}, {"min_wheel_speed": -1.0}, {"discretize": True}, {"min_wheel_speed": 12.0}],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ConfigError):
        CommandPipeline(DIFFERENTIAL, **wrong)


def test_a_twist_past_the_watchdog_must_be_finite():
    pipeline = CommandPipeline(DIFFERENTIAL)
    with pytest.raises(InputError, match="finite"):
        pipeline.step(pipeline.start(), Twist2D(math.nan, 0.0, 0.0), 0)
    assert pipeline.step(pipeline.start(), Demand(), 0)[0].twist == Twist2D()
