"""Samples that are wrong in more than one way, and robots that are wrong for long: what a review found."""

from __future__ import annotations

import math

import numpy as np
import pytest

import trundle as tr
from trundle import WheelLog, WheelOdometry

STEP = 20_000_000  # 50 Hz
R, TRACK = 0.05, 0.2
DIFF = tr.Differential(track_width=TRACK, wheel_radius=R)
WITH_GYRO = tr.Differential(track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro"))
NEEDS_GYRO = tr.TrackingWheels(
    [(0.0, 0.1, 0.0), (0.1, 0.0, math.pi / 2)], 0.024, measured=("wheel_1", "wheel_2", "gyro")
)
COUNTER = tr.Encoder(ticks_per_revolution=4096, bits=16)
COUNTING = tr.Robot(drive=DIFF, encoders={"left": COUNTER, "right": COUNTER}, limits=tr.Limits(max_speed=2.0))


def sigma(state: tr.OdometryState, axis: int) -> float:
    return math.sqrt(state.covariance[axis][axis])


# --- one sample ------------------------------------------------------------------------------------


@pytest.mark.parametrize("pause", [0.02, 5.0])
def test_no_baseline_is_taken_of_a_broken_count(pause: float) -> None:
    """Beside a count that may have wrapped, or that jumped, there may be one that is none at all."""
    odometry = WheelOdometry(COUNTING)
    odometry.update(0.0, ticks=[0, 0])
    odometry.update(0.02, ticks=[10, 10])
    assert odometry.update(0.02 + pause, ticks=[10 + 32768, math.nan]).reason == "nonfinite"
    assert math.isfinite(odometry.update(0.04 + pause, ticks=[20, 20]).pose.x)


def test_no_baseline_is_taken_of_a_broken_gyro() -> None:
    odometry = WheelOdometry(WITH_GYRO)
    for k in range(5):
        odometry.update(time_ns=k * STEP, positions=[500.0 + 0.1 * k] * 2, yaw_rate=0.0)
    assert odometry.update(time_ns=5 * STEP, positions=[0.0, 0.0], yaw_rate=math.nan).reason == "nonfinite"
    assert odometry.update(time_ns=6 * STEP, positions=[0.0, 0.0], yaw_rate=0.0).reason == "jump"
    assert odometry.update(time_ns=7 * STEP, positions=[0.1, 0.1], yaw_rate=0.0).accepted


@pytest.mark.parametrize("first", [[1e308, 1e308], [1e308, -1e308]])
def test_a_first_sample_of_garbage_is_got_over(first: list[float]) -> None:
    odometry = WheelOdometry(DIFF)
    odometry.update(0.0, first)
    states = [odometry.update(0.02 * k, [10.0 + 0.1 * k] * 2) for k in range(1, 10)]
    assert all(state.accepted for state in states[3:])


def test_a_single_flipped_bit_is_bridged() -> None:
    """Half the range of the counter in 20 ms: where limits are known, that is no wrap but a glitch."""
    odometry = WheelOdometry(COUNTING)
    for k in range(51):
        odometry.update(time_ns=k * STEP, ticks=[13 * k, 13 * k ^ (32768 if k == 25 else 0)])
    assert odometry.rejected == {"implausible": 1}
    assert odometry.state.pose.x == pytest.approx(50 * 13 * COUNTER.radians_per_tick * R, abs=1e-12)


def test_a_speed_is_judged_by_itself() -> None:
    """The mean with a wheel that stands would let twice as much pass."""
    robot = tr.Robot(drive=DIFF, limits=tr.Limits(max_speed=1.0))
    speeds = np.zeros((20, 2))
    speeds[10] = 50.0  # 2.5 m/s
    odometry = WheelOdometry(robot)
    for k, row in enumerate(speeds.tolist()):
        odometry.update(time_ns=k * STEP, velocities=row)
    log = WheelLog(
        time_ns=np.arange(20) * STEP,
        wheel_names=("left", "right"),
        wheels=speeds,
        reading=tr.records.Reading.VELOCITY,
    )
    assert odometry.rejected == tr.integrate(robot, log).rejected == {"implausible": 1}
    assert odometry.state.pose == tr.Pose2D()


def test_stamps_of_numpy_are_whole_numbers() -> None:
    """Unsigned ones wrap where they are subtracted, short ones where they are multiplied."""
    odometry, plain = WheelOdometry(DIFF), WheelOdometry(DIFF)
    for k in range(50):
        wheels = [0.1 * k, 0.1 * k + 0.001 * k * k]
        state = odometry.update(time_ns=np.int32(k * 15_000_000), positions=wheels)
        assert state == plain.update(time_ns=k * 15_000_000, positions=wheels)
    assert odometry.update(time_ns=np.uint64(0), positions=[0.0, 0.0]).reason == "out_of_order"
    assert odometry.update(time_ns=math.nan, positions=[0.0, 0.0]).reason == "nonfinite"
    assert odometry.update(time_ns=10**400, positions=[0.0, 0.0]).reason == "time_range"
    assert odometry.update(1e200, [0.0, 0.0]).reason == "time_range"


def test_short_floats_are_added_as_long_ones() -> None:
    odometry, step = WheelOdometry(DIFF), np.full(2, 0.1, np.float32)
    for k in range(20_000):
        odometry.update(time_ns=k * STEP, increments=step)
    assert type(odometry.state.pose.x) is float
    assert odometry.state.pose.x == pytest.approx(19_999 * float(step[0]) * R, abs=1e-9)


@pytest.mark.parametrize(
    "covariance", [np.eye(3), (1.0, 2.0), (-1.0, 0, 0, 0, 0, 0), (1.0, 5.0, 1.0, 0, 0, 0)]
)
def test_no_covariance_that_is_none(covariance: object) -> None:
    with pytest.raises(tr.InputError, match="reset: covariance"):
        WheelOdometry(DIFF).reset(tr.Pose2D(), covariance=covariance)


# --- the gyro --------------------------------------------------------------------------------------


def test_a_gyro_that_wakes_up_late_is_waited_for() -> None:
    odometry = WheelOdometry(NEEDS_GYRO)
    odometry.update(0.0, [0.0, 0.0])
    assert odometry.update(0.02, [0.1, 0.0]).reason == "no_gyro"
    for k in range(2, 100):
        state = odometry.update(0.02 * k, [0.1 * k, 0.0], yaw_rate=0.0)
        assert state.accepted
    assert state.pose.x == pytest.approx(99 * 0.1 * 0.024, abs=1e-12)


@pytest.mark.parametrize("rate", [0.05, 0.09])
def test_a_published_turn_is_no_bias(rate: float) -> None:
    """A log of twists has no wheels that stand still, and its yaw rate no bias."""
    log = WheelLog(time_ns=np.arange(501) * STEP, twists=np.tile([0.0, 0.0, rate], (501, 1)))
    assert tr.integrate(DIFF, log).poses[-1, 2] == pytest.approx(10.0 * rate, abs=1e-9)


def test_wheels_in_the_middle_do_not_know_that_the_robot_stands() -> None:
    pods = [(0.0, 0.0, 0.0), (0.0, 0.0, math.pi / 2)]
    drive = tr.TrackingWheels(pods, 0.024, measured=("wheel_1", "wheel_2", "gyro"))
    odometry = WheelOdometry(drive)
    for k in range(501):
        odometry.update(time_ns=k * STEP, positions=[0.0, 0.0], yaw_rate=0.08)
    assert odometry.state.pose.theta == pytest.approx(0.8, abs=1e-9)


@pytest.mark.parametrize(("spike", "refused"), [(1e160, True), (50.0, True), (4.0, False)])
def test_a_spike_of_the_gyro_is_refused_or_doubted(spike: float, refused: bool) -> None:
    robot = tr.Robot(drive=WITH_GYRO, limits=tr.Limits(max_speed=1.0, max_yaw_rate=3.0))
    odometry = WheelOdometry(robot)
    for k in range(51):
        odometry.update(time_ns=k * STEP, positions=[0.1 * k] * 2, yaw_rate=spike if k == 25 else 0.0)
    assert odometry.rejected == ({"implausible": 1} if refused else {})
    assert abs(odometry.state.pose.theta) <= 3.0 * sigma(odometry.state, 2)


def test_a_gyro_that_stays_beyond_belief_is_silent() -> None:
    robot = tr.Robot(drive=WITH_GYRO, limits=tr.Limits(max_speed=1.0, max_yaw_rate=3.0))
    odometry = WheelOdometry(robot)
    for k in range(100):
        odometry.update(time_ns=k * STEP, positions=[0.1 * k] * 2, yaw_rate=0.0 if k < 20 else 90.0)
    assert odometry.rejected == {"implausible": 2}
    assert odometry.events["gyro_dropout"] == 1
    assert odometry.state.pose.x == pytest.approx(99 * 0.1 * R, abs=1e-9)
    assert odometry.state.pose.theta == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("silent", ["still", "dropout", "gap"])
def test_a_stuck_wheel_and_then_no_gyro(silent: str) -> None:
    """Nobody knows then what the stuck wheel did; the covariance says so."""
    odometry = WheelOdometry(WITH_GYRO)
    for k in range(200):
        right = 0.2 * (min(k, 100) if silent == "still" else k)
        time_ns = k * STEP + (1_500_000_000 if silent == "gap" and k > 100 else 0)
        rate = None if silent == "dropout" and k > 100 else 0.0
        state = odometry.update(time_ns=time_ns, positions=[0.0, right], yaw_rate=rate)
        assert state.accepted
    assert odometry.stuck == ("left",)
    error = math.hypot(state.pose.x - 0.2 * (100 if silent == "still" else 199) * R, state.pose.y)
    assert error <= 3.0 * max(sigma(state, 0), sigma(state, 1))
    assert abs(state.pose.theta) <= 3.0 * sigma(state, 2)


def test_what_a_stuck_encoder_catches_up_is_not_driven_twice() -> None:
    drive = tr.Mecanum(track_width=0.3, wheelbase=0.3, wheel_radius=R)
    odometry = WheelOdometry(drive)
    for k in range(200):
        wheels = [0.12 * k] * 4
        if 60 <= k < 120:
            wheels[0] = 0.12 * 60
        state = odometry.update(time_ns=k * STEP, positions=wheels)
    assert odometry.events == {"stuck_wheel": 1, "wheel_recovered": 1}
    assert abs(state.pose.theta) <= 2.0 * sigma(state, 2)
    assert abs(state.pose.x - 199 * 0.12 * R) <= 2.0 * sigma(state, 0)


# --- jumps, losses and long ways -------------------------------------------------------------------


@pytest.mark.parametrize("jumped", [(1.0, 1.0), (1.0, 0.0)], ids=["both", "left"])
@pytest.mark.parametrize("limits", [tr.Limits(max_speed=2.0), tr.Limits(max_speed=2.0, max_acceleration=2.0)])
def test_a_believable_jump_that_stays_stays_in_doubt(jumped: tuple[float, float], limits: tr.Limits) -> None:
    """S13: what the counters do not take back was no glitch of theirs."""
    robot = tr.Robot(drive=DIFF, limits=limits)
    positions = np.tile(0.2 * np.arange(60)[:, None], (1, 2))
    positions[50:] += jumped
    odometry = WheelOdometry(robot)
    states = [odometry.update(time_ns=k * STEP, positions=row) for k, row in enumerate(positions.tolist())]
    for state in states[50:]:
        error = state.pose.x - 0.01 * round(state.time_ns / STEP), state.pose.theta
        assert abs(error[0]) <= 1.5 * sigma(state, 0)
        assert abs(error[1]) <= 1.5 * sigma(state, 2)
    log = WheelLog(time_ns=np.arange(60) * STEP, wheel_names=("left", "right"), wheels=positions)
    folded = np.array([state.covariance for state in states])
    np.testing.assert_allclose(tr.integrate(robot, log).covariances, folded, rtol=1e-9, atol=1e-15)


def test_increments_that_were_lost_over_a_gap_are_lost() -> None:
    odometry = WheelOdometry(DIFF)
    for k in range(200):
        state = odometry.update(time_ns=k * STEP, increments=[0.4 if not 50 <= k < 150 else math.nan] * 2)
        if k == 150:
            assert state.reason == "increments_lost"
    assert odometry.events["gap"] == 1
    assert abs(state.pose.x - 199 * 0.4 * R) <= 3.0 * sigma(state, 0)


@pytest.mark.parametrize(("track", "noise"), [(0.05, 0.03), (0.2, 0.01)])
def test_a_robot_that_lost_its_heading_is_somewhere_on_its_way(track: float, noise: float) -> None:
    """A heading of which nothing is known has a variance of pi^2 / 3, and the rest follows from it."""
    drive = tr.Differential(track_width=track, wheel_radius=0.02)
    robot = tr.Robot(drive=drive, noise=tr.Noise(wheel_distance=noise))
    positions = 5.0 * np.arange(10_001)[:, None].repeat(2, axis=1)
    log = WheelLog(time_ns=np.arange(10_001) * 100_000_000, wheel_names=("left", "right"), wheels=positions)
    trajectory = tr.integrate(robot, log)
    way = trajectory.poses[1:, 0]
    deviations = np.sqrt(np.diagonal(trajectory.covariances[1:], axis1=1, axis2=2))
    assert (deviations[:, :2].max(axis=1) <= 1.0 + 1.9 * way).all()
    assert deviations[-1, 2] == pytest.approx(math.pi / math.sqrt(3.0))
    assert (np.linalg.eigvalsh(trajectory.covariances)[:, 0] >= -1e-12 * deviations[-1, 1] ** 2).all()
    odometry = WheelOdometry(robot)
    for time_ns, row in zip(log.time_ns.tolist(), positions.tolist(), strict=True):
        odometry.update(time_ns=time_ns, positions=row)
    np.testing.assert_allclose(odometry.state.covariance, trajectory.covariances[-1], rtol=1e-9, atol=1e-12)


def test_after_a_clock_that_went_back_the_robot_is_somewhere_near() -> None:
    odometry = WheelOdometry(tr.Robot(drive=DIFF, limits=tr.Limits(max_speed=1.0)))
    for k in range(51):
        state = odometry.update(time_ns=(k if k < 5 else k - 2000) * 100_000_000, positions=[2.0 * k] * 2)
    assert max(sigma(state, 0), sigma(state, 1)) < 2.0 * state.pose.x
    assert math.hypot(*state.mean_position) < 2.0 * state.pose.x


def test_a_car_that_drives_straight_keeps_the_doubt_of_its_ticks() -> None:
    drive = tr.Bicycle(wheelbase=0.3, wheel_radius=R)
    encoder = tr.Encoder(ticks_per_revolution=20)
    robot = tr.Robot(drive=drive, encoders={"rear": encoder}, noise=tr.Noise(wheel_distance=0.001))
    wheels, steering = np.arange(100)[:, None], np.zeros((100, 1))
    odometry = WheelOdometry(robot)
    for k in range(100):
        state = odometry.update(time_ns=k * STEP, ticks=[k], steering=[0.0])
    log = WheelLog(
        time_ns=np.arange(100) * STEP,
        wheel_names=("rear",),
        wheels=wheels,
        reading=tr.records.Reading.TICKS,
        steering_names=("front",),
        steering=steering,
    )
    np.testing.assert_allclose(state.covariance, tr.integrate(robot, log).covariances[-1], atol=1e-15)


# --- batches ---------------------------------------------------------------------------------------


def test_steering_belongs_to_its_rows() -> None:
    drive = tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=R)
    positions = np.cumsum(np.full((3, 100, 2), 0.2), axis=1)
    steering = np.stack([np.linspace(0.0, 0.35, 100), np.linspace(0.0, 0.31, 100)], axis=-1)
    every = np.broadcast_to(steering, (3, 100, 2))
    alike = tr.integrate_batch(drive, positions, steering=steering)
    np.testing.assert_array_equal(alike, tr.integrate_batch(drive, positions, steering=every))
    for wrong in (np.zeros((100, 3, 2)), np.zeros((99, 2)), np.zeros((2, 100, 2))):
        with pytest.raises(tr.ShapeError, match="steering: shape"):
            tr.integrate_batch(drive, positions, steering=wrong)


def test_poses_may_take_the_place_of_their_readings() -> None:
    drive = tr.Omni(robot_radius=0.2, wheel_radius=R)
    positions = np.cumsum(np.random.default_rng(0).uniform(-0.1, 0.2, (50, 3)), axis=0)
    wanted = tr.integrate_batch(drive, positions)
    np.testing.assert_array_equal(tr.integrate_batch(drive, positions, out=positions), wanted)
