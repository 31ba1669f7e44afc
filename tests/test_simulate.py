"""The simulator: truth against closed forms, readings against the truth, chance against its own promises."""

from __future__ import annotations

import csv
import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest

from trundle.adapters.wheel_log_csv import write_log
from trundle.errors import ConfigError, Infeasible, InputError, OutputError, ShapeError
from trundle.geometry import Pose2D, Twist2D, se2
from trundle.odometry import WheelOdometry
from trundle.odometry.integrate import integrate
from trundle.records import Reading
from trundle.robot import (
    Ackermann,
    Bicycle,
    Differential,
    Encoder,
    FourWheelSteering,
    Mecanum,
    Noise,
    Omni,
    Robot,
    SkidSteer,
    Swerve,
    TrackingWheels,
    Tricycle,
    WheelCommand,
)
from trundle.simulate import (
    NOISELESS,
    Course,
    Gyro,
    SimulatedRobot,
    WheelSlip,
    arc,
    figure_eight,
    glide,
    hold,
    simulate,
    slalom,
    slide,
    spin,
    square,
    stop,
    straight,
)

SQUARE = ((0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2))
ROVER = Differential(track_width=0.2, wheel_radius=0.042)
MECANUM = Mecanum(track_width=0.3, wheelbase=0.3, wheel_radius=0.05)
CARS = {
    "differential": ROVER,
    "skid": SkidSteer(track_width=0.4, wheelbase=0.3, wheel_radius=0.1),
    "bicycle": Bicycle(wheelbase=0.3, wheel_radius=0.03),
    "bicycle front": Bicycle(wheelbase=0.3, wheel_radius=0.03, measured="front"),
    "ackermann": Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.03, max_steering=0.9),
    "tricycle": Tricycle(wheelbase=0.3, track_width=0.2, wheel_radius=0.03),
}
HOLONOMIC = {
    "mecanum": MECANUM,
    "omni": Omni(robot_radius=0.2, wheel_radius=0.05, wheel_count=4),
    "swerve": Swerve(modules=SQUARE, wheel_radius=0.05),
    "swerve with stops": Swerve(modules=SQUARE, wheel_radius=0.05, max_steering=1.7),
    "four wheel steering": FourWheelSteering(wheelbase=0.4, track_width=0.3, wheel_radius=0.05),
    "tracking": TrackingWheels(
        [(0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (0.1, 0.0, math.pi / 2)], wheel_radius=0.02
    ),
}
TOUR = Course.of(
    straight(1.0, 0.5),
    arc(0.8, 1.5, 0.5),
    slalom(2.0, 0.5, heading=0.4, wavelength=1.0),
    stop(0.5),
    straight(-0.5, 0.5),
    stop(0.5),
    figure_eight(1.0, 0.5),
)
DANCE = Course.of(
    slide(0.3, -0.8, 0.5), glide(2.0, 0.5, yaw_rate=0.4), arc(0.8, -2.0, 0.5), stop(0.3), spin(2.0, 1.0)
)


def trapezoid(values: np.ndarray, dx: float) -> np.ndarray:
    """Integral along the last axis (NumPy changed the name of its own between 1.26 and 2)."""
    return dx * 0.5 * (values[..., 1:] + values[..., :-1]).sum(axis=-1)


def constant(vx: float, vy: float, omega: float, duration: float) -> Course:
    return Course(hold(duration, vx=vx, vy=vy, omega=omega).twists, duration)


# ------------------------------------------------------------------------------- the truth


@pytest.mark.parametrize("twist", [(1.0, 0.0, 0.0), (0.5, 0.0, 1.5), (0.0, 0.0, -3.0), (0.3, -0.7, 0.9)])
def test_truth_of_constant_twist_is_exp(twist):
    reference = simulate(MECANUM, constant(*twist, 100.0), noise=NOISELESS).reference
    seconds = reference.time_ns[:, np.newaxis] * 1e-9
    np.testing.assert_allclose(reference.poses, se2.exp(np.array([twist]) * seconds), rtol=0, atol=1e-10)


def test_truth_of_straight_way_while_spinning_is_straight():
    way = glide(100.0, 1.0, yaw_rate=2.0, direction=0.5)
    course = Course(way.twists, way.duration)
    reference = simulate(MECANUM, course, noise=NOISELESS, start=Pose2D(1.0, 2.0, 0.3)).reference
    seconds = reference.time_ns * 1e-9
    line = np.stack(
        [1.0 + seconds * math.cos(0.8), 2.0 + seconds * math.sin(0.8), 0.3 + 2.0 * seconds], axis=-1
    )
    np.testing.assert_allclose(reference.poses, line, rtol=0, atol=1e-9)


def test_truth_does_not_depend_on_the_rate():
    """Blended corners are not analytic; finer steps may not change them."""
    course = Course.of(*square(1.0, 0.7, radius=0.3), spin(1.0, 2.0), blend=0.3)
    coarse = simulate(ROVER, course, rate=10.0, noise=NOISELESS).reference
    fine = simulate(ROVER, course, rate=1000.0, noise=NOISELESS).reference
    np.testing.assert_allclose(
        coarse.poses, fine.poses[:: len(fine) // (len(coarse) - 1)][: len(coarse)], atol=1e-10
    )


def test_slalom_heading_is_the_sine_that_it_promises():
    way = slalom(10.0, 2.0, heading=0.6, wavelength=2.5)
    reference = simulate(ROVER, Course(way.twists, way.duration), noise=NOISELESS).reference
    along = 2.0 * reference.time_ns * 1e-9
    np.testing.assert_allclose(reference.poses[:, 2], 0.6 * np.sin(math.tau * along / 2.5), atol=1e-11)
    assert reference.poses[-1, 1] == pytest.approx(0.0, abs=1e-9)


def test_blended_manoeuvres_keep_their_lengths_and_angles():
    course = Course.of(
        straight(2.0, 0.5), spin(-1.0, 0.7), [straight(-0.5, 0.25), arc(0.5, 2.0, 0.4)], blend=0.4
    )
    reference = simulate(ROVER, course, rate=500.0, noise=NOISELESS).reference
    assert course.duration == pytest.approx(4.0 + 1.0 / 0.7 + 2.0 + 2.5 + 0.4)
    assert reference.poses[-1, 2] == pytest.approx(1.0, abs=1e-9)
    assert trapezoid(reference.twists[:, 0], dx=0.002) == pytest.approx(2.0 - 0.5 + 1.0, abs=1e-6)
    assert np.all(reference.twists[0] == 0.0)
    assert np.abs(course.at(np.array([course.duration]))).max() < 1e-12


def test_square_and_figure_eight_close():
    for course in (Course.of(square(1.0, 0.5), blend=1e-3), Course.of(figure_eight(1.0, 0.5), blend=1e-3)):
        end = simulate(ROVER, course, rate=1000.0, noise=NOISELESS).reference.pose(-1)
        assert math.hypot(end.x, end.y) < 2e-3


# ---------------------------------------------------------------------------- the readings


@pytest.mark.parametrize(
    ("name", "course"), [*((name, TOUR) for name in CARS), *((name, DANCE) for name in HOLONOMIC)]
)
def test_noiseless_readings_integrate_back_to_the_truth(name, course):
    drive = {**CARS, **HOLONOMIC}[name]
    log = simulate(drive, course, rate=400.0, noise=NOISELESS)
    assert log.reading is Reading.POSITION
    middle = None if log.steering is None else 0.5 * (log.steering[1:] + log.steering[:-1])
    steps = drive.forward_batch(np.diff(log.wheels, axis=0), middle)
    poses = [log.reference.poses[:1]]
    for step in se2.exp(steps):
        poses.append(se2.compose(poses[-1], step[np.newaxis]))
    error = np.concatenate(poses) - log.reference.poses
    assert np.abs(error).max() < (2e-6 if log.steering is None else 2e-4)


def test_steering_is_continuous_and_held_at_rest():
    drive = HOLONOMIC["swerve"]
    course = Course.of(glide(8.0, 0.5, yaw_rate=1.0), stop(1.0), glide(3.0, 0.5, yaw_rate=-0.5))
    log = simulate(drive, course, rate=200.0, noise=NOISELESS)
    rest = np.abs(log.reference.twists).max(axis=1) == 0.0
    assert np.abs(np.diff(log.steering[rest][10:-10], axis=0)).max() == 0.0
    # One jump is allowed: when the robot begins to move again, the other way.
    assert np.sort(np.abs(np.diff(log.steering, axis=0)).max(axis=1))[-2] < 0.02
    assert log.steering.max() - log.steering.min() > math.tau


@pytest.mark.parametrize("name", [*CARS, *HOLONOMIC])
def test_velocities_are_what_inverse_says(name):
    """Up to the half turn by which a steered wheel may stand the other way round."""
    drive, course = (CARS[name], TOUR) if name in CARS else (HOLONOMIC[name], DANCE)
    log = simulate(drive, course, noise=NOISELESS, reading=Reading.VELOCITY)
    speeds, _ = drive.inverse_batch(log.reference.twists)
    measured = [drive.wheel_names.index(wheel) for wheel in drive.measured_names]
    np.testing.assert_allclose(np.abs(log.wheels), np.abs(speeds[:, measured]), atol=1e-9)


def test_impossible_course_is_refused():
    with pytest.raises(Infeasible, match="sideways"):
        simulate(ROVER, Course.of(slide(1.0, 1.0, 0.5)))


def test_slipping_wheel_turns_further_and_the_truth_does_not_move():
    course = Course.of(straight(5.0, 0.5))
    slip = WheelSlip(wheel="left", start=3.013, stop=4.0, factor=1.2)
    plain, slipping = (simulate(ROVER, course, noise=NOISELESS, slips=slips) for slips in ((), (slip,)))
    more = slipping.wheels - plain.wheels
    np.testing.assert_allclose(slipping.reference.poses, plain.reference.poses, rtol=0, atol=1e-12)
    assert more[-1] == pytest.approx([0.2 * 0.5 / 0.042 * (4.0 - 3.013), 0.0], abs=1e-9)
    assert np.all(np.abs(more[plain.time_ns < 3_013_000_000]) < 1e-9)


def test_increments_add_up_to_positions():
    logs = [simulate(ROVER, TOUR, reading=reading) for reading in (Reading.POSITION, Reading.INCREMENT)]
    np.testing.assert_allclose(np.cumsum(logs[1].wheels, axis=0), logs[0].wheels, atol=1e-9)


# ---------------------------------------------------------------------------- the encoders


def test_ticks_are_positions_within_half_a_tick_and_wrap():
    encoders = {
        "left": Encoder(ticks_per_revolution=100.3, bits=8),
        "right": Encoder(ticks_per_revolution=20000.0, bits=16, inverted=True),
    }
    robot = Robot(drive=ROVER, encoders=encoders)
    ticks = simulate(robot, TOUR, rate=200.0, seed=3).wheels
    positions = simulate(robot, TOUR, rate=200.0, seed=3, reading=Reading.POSITION).wheels
    assert ticks.dtype == np.int64
    for column, position, name in zip(ticks.T, positions.T, ("left", "right"), strict=True):
        encoder = encoders[name]
        span = 1 << encoder.bits
        assert column.min() >= 0
        assert column.max() < span
        assert column.max() - column.min() > 0.95 * span
        counts = np.unwrap(column.astype(float), period=span)
        assert np.abs(counts - counts[0] - position / encoder.radians_per_tick).max() <= 0.5 + 1e-6


@pytest.mark.parametrize("bits", [None, 64])
def test_counters_that_hold_everything_go_below_zero(bits):
    encoder = Encoder(ticks_per_revolution=1000.0, bits=bits)
    robot = Robot(drive=ROVER, encoders={"left": encoder, "right": encoder})
    assert simulate(robot, Course.of(straight(-1.0, 0.5)), noise=NOISELESS).wheels[-1] == pytest.approx(
        -3789, abs=1
    )


def test_one_wheel_without_encoder_makes_positions_and_ticks_an_error():
    robot = Robot(drive=ROVER, encoders={"left": Encoder(ticks_per_revolution=100.0)})
    assert simulate(robot, TOUR).reading is Reading.POSITION
    with pytest.raises(InputError, match="right"):
        simulate(robot, TOUR, reading=Reading.TICKS)


# -------------------------------------------------------------------------------- chance


def test_wheel_noise_is_a_random_walk_with_distance():
    noise = Noise(wheel_distance=0.02)
    course = constant(0.8, 0.0, 0.5, 20.0)
    exact = simulate(ROVER, course, noise=NOISELESS, rate=10.0)
    runs = [simulate(ROVER, course, noise=noise, rate=10.0, seed=seed).wheels for seed in range(400)]
    errors = (np.stack(runs) - exact.wheels) * 0.042
    rolled = exact.wheels * 0.042
    for row in (50, 200):
        np.testing.assert_allclose(errors[:, row].var(axis=0), 0.02**2 * rolled[row], rtol=0.3)
    grown = errors[:, 200] - errors[:, 50]
    assert np.abs(np.corrcoef(np.concatenate([grown, errors[:, 50]], axis=1).T) - np.eye(4)).max() < 0.2


def test_lateral_slip_moves_the_body_and_no_wheel_notices():
    course = constant(1.0, 0.0, 0.0, 9.0)
    runs = [
        simulate(ROVER, course, noise=Noise(wheel_distance=0.0, lateral_slip=0.01), seed=k)
        for k in range(400)
    ]
    assert np.array_equal(runs[0].wheels, simulate(ROVER, course, noise=NOISELESS).wheels)
    ends = np.stack([run.reference.poses[-1] for run in runs])
    assert ends[:, 1].std() == pytest.approx(0.01 * math.sqrt(9.0), rel=0.15)
    assert np.abs(ends[:, [0, 2]] - [9.0, 0.0]).max() < 1e-9


def test_localizer_notices_the_slip_of_the_wheels_that_drive():
    sensors = TrackingWheels([(0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (0.1, 0.0, math.pi / 2)], wheel_radius=0.02)
    robot = Robot(drive=ROVER, localizer=sensors, noise=Noise(wheel_distance=0.0, lateral_slip=0.05))
    log = simulate(robot, Course.of(straight(3.0, 1.0), spin(1.0, 1.0)))
    assert np.abs(log.reference.poses[:, 1]).max() > 0.01
    np.testing.assert_allclose(integrate(robot, log).poses, log.reference.poses, atol=1e-5)


def test_steering_errors_have_their_deviation_and_integrate_as_odometry_assumes():
    noise = Noise(wheel_distance=0.0, steering=0.02)
    course = constant(1.0, 0.0, 0.0, 50.0)
    drive = CARS["bicycle"]
    runs = [simulate(drive, course, noise=noise, rate=10.0, seed=k).steering[:, 0] for k in range(300)]
    errors = np.stack(runs)
    assert errors.std() == pytest.approx(0.02, rel=0.05)
    # Variance of the integral of such a process over 50 m, memory 0.5 m: sigma^2 * (50 - 0.5) m * 1 m.
    assert trapezoid(errors, dx=0.1).var() == pytest.approx(0.02**2 * 49.5, rel=0.35)
    still = simulate(drive, constant(0.0, 0.0, 0.0, 5.0), noise=noise).steering
    assert np.ptp(still) == 0.0


def test_gyro_noise_integrates_with_time():
    drive = Differential(track_width=0.2, wheel_radius=0.04, measured=("left", "right", "gyro"))
    course = constant(0.0, 0.0, 0.5, 10.0)
    runs = [simulate(drive, course, noise=Noise(gyro=0.01), seed=k).yaw_rate for k in range(400)]
    turned = trapezoid(np.stack(runs), dx=0.02)
    assert turned.mean() == pytest.approx(5.0, abs=0.01)
    assert turned.std() == pytest.approx(0.01 * math.sqrt(10.0), rel=0.15)


def test_gyro_bias_and_scale():
    log = simulate(ROVER, constant(0.0, 0.0, 0.5, 4.0), noise=NOISELESS, gyro=Gyro(bias=0.1, scale=1.02))
    np.testing.assert_allclose(log.yaw_rate, 0.61, atol=1e-12)
    assert simulate(ROVER, TOUR).yaw_rate is None
    ends = [
        simulate(
            ROVER, constant(0.1, 0.0, 0.0, 9.0), noise=NOISELESS, gyro=Gyro(bias_walk=0.1), seed=k
        ).yaw_rate[-1]
        for k in range(300)
    ]
    assert np.std(ends) == pytest.approx(0.1 * 3.0, rel=0.15)


@pytest.mark.parametrize("name", ["differential", "ackermann", "mecanum", "swerve"])
def test_chance_is_what_odometry_takes_it_for(name):
    """Normalised error squared over many runs: 3 per run, within what 300 runs can tell."""
    noise = Noise(wheel_distance=0.003, lateral_slip=0.003, steering=0.003)
    robot = Robot(drive={**CARS, **HOLONOMIC}[name], noise=noise)
    course = Course.of(straight(1.0, 1.0), slalom(3.0, 1.0, heading=0.3, wavelength=2.0), arc(1.0, 2.0, 1.0))
    squares = []
    for seed in range(300):
        log = simulate(robot, course, rate=20.0, seed=seed)
        estimate = integrate(robot, log)
        error = se2.log(se2.compose(se2.inverse(estimate.poses[-1]), log.reference.poses[-1]))
        squares.append(error @ np.linalg.solve(estimate.covariances[-1], error))
    assert np.mean(squares) / 3.0 == pytest.approx(1.0, abs=0.2)


def test_same_seed_same_bytes_and_sources_do_not_disturb_each_other():
    robot = Robot(drive=CARS["ackermann"], noise=Noise(lateral_slip=0.01, steering=0.01))
    first, again = (simulate(robot, TOUR, seed=5) for _ in range(2))
    assert first.wheels.tobytes() == again.wheels.tobytes()
    assert first.steering.tobytes() == again.steering.tobytes()
    assert first.reference.poses.tobytes() == again.reference.poses.tobytes()
    gyro = simulate(robot, TOUR, seed=5, gyro=Gyro(), stamp_jitter=1e-3)
    assert gyro.wheels.tobytes() == first.wheels.tobytes()
    for other in (6, (5, 1), (5, 2)):
        assert not np.array_equal(simulate(robot, TOUR, seed=other).wheels, first.wheels)


# ------------------------------------------------------------------------------ the clock


def test_jitter_moves_rows_and_their_stamps_tell():
    log = simulate(ROVER, constant(1.0, 0.0, 0.0, 10.0), noise=NOISELESS, jitter=0.009)
    steps = np.diff(log.time_ns)
    assert steps.min() > 0
    assert steps.std() > 5e6
    np.testing.assert_allclose(log.wheels[:, 0] * 0.042, log.time_ns * 1e-9, atol=1e-12)


def test_stamp_jitter_lies_and_the_truth_does_not():
    log = simulate(ROVER, constant(1.0, 0.0, 0.0, 20.0), noise=NOISELESS, stamp_jitter=0.002, start_ns=10**18)
    wrong = (log.time_ns - log.reference.time_ns) * 1e-9
    assert wrong.std() == pytest.approx(0.002, rel=0.15)
    assert np.array_equal(log.reference.time_ns, 10**18 + np.arange(len(log)) * 20_000_000)


def test_dropped_rows_are_gone_and_the_others_as_they_were():
    whole, holey = (simulate(ROVER, TOUR, seed=1, dropped=share) for share in (0.0, 0.3))
    left = np.isin(whole.time_ns, holey.time_ns)
    assert 0.65 < left.mean() < 0.75
    assert left[0]
    assert np.array_equal(whole.wheels[left], holey.wheels)
    assert np.array_equal(holey.reference.time_ns, holey.time_ns)


# ---------------------------------------------------------------------------- bad requests


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"rate": 0.0}, "rate"),
        ({"rate": 0.001}, "rate"),
        ({"rate": math.nan}, "rate"),
        ({"jitter": 0.011}, "jitter"),
        ({"stamp_jitter": -1.0}, "stamp_jitter"),
        ({"stamp_jitter": math.nan}, "stamp_jitter"),
        ({"dropped": 1.0}, "dropped"),
        ({"seed": -1}, "seed"),
        ({"seed": "x"}, "seed"),
        ({"slips": [WheelSlip(wheel="lefd", start=0.0, stop=1.0, factor=2.0)]}, "did you mean 'left'"),
    ],
    ids=str,
)
def test_impossible_argument_is_named(arguments, named):
    with pytest.raises((InputError, ConfigError), match=named):
        simulate(ROVER, TOUR, **arguments)


@pytest.mark.parametrize(
    "make",
    [
        Course.of,
        lambda: Course.of(stop(1.0), blend=0.0),
        lambda: stop(-1.0),
        lambda: straight(0.0, 1.0),
        lambda: straight(1.0, 0.0),
        lambda: arc(1.0, math.inf, 1.0),
        lambda: spin(1.0, -1.0),
        lambda: slalom(1.0, 1.0, heading=0.1, wavelength=0.0),
        lambda: glide(1.0, 1.0, yaw_rate=math.nan),
        lambda: WheelSlip(wheel="left", start=math.nan, stop=1.0, factor=1.0),
        lambda: Gyro(bias=math.nan),
        lambda: SimulatedRobot(ROVER, lag=-1.0),
        lambda: SimulatedRobot(ROVER, max_wheel_acceleration=0.0),
    ],
)
def test_impossible_manoeuvre_is_refused(make):
    with pytest.raises(ConfigError):
        make()


def test_course_of_wrong_shape_or_not_finite_is_refused():
    with pytest.raises(ShapeError, match="course"):
        simulate(ROVER, Course(lambda time: np.zeros((len(time), 2)), 1.0))
    with pytest.raises(InputError, match="finite"):
        simulate(ROVER, Course(lambda time: np.full((len(time), 3), np.nan), 1.0))


# ------------------------------------------------------------------------------ step by step


@pytest.mark.parametrize("name", [*CARS, *HOLONOMIC])
def test_stepped_robot_obeys_and_its_readings_lead_to_its_pose(name):
    drive = {**CARS, **HOLONOMIC}[name]
    robot = SimulatedRobot(drive, noise=NOISELESS, pose=Pose2D(1.0, 2.0, 0.5))
    odometry = WheelOdometry(drive, integrator="arc", pose=robot.pose)
    first = robot.reading()
    odometry.update(time_ns=first.time_ns, positions=first.positions, steering=first.steering)
    for k in range(200):
        sideways = 0.2 if name in HOLONOMIC else 0.0
        wanted = Twist2D(0.5, sideways, 0.6 * math.sin(0.05 * k))
        seen = robot.step(drive.inverse(wanted, robot.steering), 0.02)
        state = odometry.update(time_ns=seen.time_ns, positions=seen.positions, steering=seen.steering)
        assert state.accepted
    assert robot.time_ns == 4_000_000_000
    assert robot.twist.vx == pytest.approx(0.5, abs=0.03)
    ours, truth = state.pose, robot.pose
    assert (ours.x, ours.y, ours.theta) == pytest.approx((truth.x, truth.y, truth.theta), abs=1e-9)


def test_stepped_wheels_lag_and_accelerate_as_motors_do():
    robot = SimulatedRobot(ROVER, noise=NOISELESS, lag=0.1)
    for _ in range(10):
        reading = robot.step(WheelCommand((10.0, 10.0)), 0.01)
    assert robot.speeds[0] == pytest.approx(10.0 * (1.0 - math.exp(-1.0)))
    assert reading.positions[0] == pytest.approx(10.0 * (0.1 - 0.1 * (1.0 - math.exp(-1.0))))
    limited = SimulatedRobot(ROVER, noise=NOISELESS, max_wheel_acceleration=5.0)
    for _ in range(10):
        limited.step(WheelCommand((10.0, -10.0)), 0.1)
    assert limited.speeds == pytest.approx((5.0, -5.0))


def test_stepped_steering_turns_no_faster_than_it_can():
    robot = SimulatedRobot(CARS["bicycle"], noise=NOISELESS, max_steering_rate=0.5)
    command = CARS["bicycle"].inverse(Twist2D(1.0, 0.0, 2.0))
    angles = [robot.step(command, 0.1).steering[0] for _ in range(20)]
    np.testing.assert_allclose(angles, np.minimum(0.05 * np.arange(1, 21), command.steering[0]), atol=1e-12)


def test_stepped_robot_repeats_itself_and_counts_ticks():
    encoder = Encoder(ticks_per_revolution=1000.0, bits=8)
    robot = Robot(
        drive=Differential(track_width=0.2, wheel_radius=0.04, measured=("left", "right", "gyro")),
        encoders={"left": encoder, "right": encoder},
        noise=Noise(wheel_distance=0.01, lateral_slip=0.01, gyro=0.01),
    )
    command = robot.drive.inverse(Twist2D(0.5, 0.0, 0.5))

    def readings(seed):
        stepped = SimulatedRobot(robot, seed=seed, gyro=Gyro(bias=0.1))
        return [stepped.step(command, 0.02) for _ in range(100)], stepped.pose

    first, again, other = readings(1), readings(1), readings(2)
    assert first == again
    assert first != other
    assert all(0 <= tick < 256 for reading in first[0] for tick in reading.ticks)
    assert np.mean([reading.yaw_rate for reading in first[0]]) == pytest.approx(0.6, abs=0.03)


def test_stepped_localizer_sees_the_slip():
    sensors = TrackingWheels([(0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (0.1, 0.0, math.pi / 2)], wheel_radius=0.02)
    robot = SimulatedRobot(
        Robot(drive=ROVER, localizer=sensors, noise=Noise(wheel_distance=0.0, lateral_slip=0.05))
    )
    odometry = WheelOdometry(robot.robot, integrator="arc")
    for reading in (robot.reading(), *(robot.step(WheelCommand((10.0, 9.0)), 0.05) for _ in range(50))):
        state = odometry.update(time_ns=reading.time_ns, positions=reading.positions)
    assert (state.pose.x, state.pose.y) == pytest.approx((robot.pose.x, robot.pose.y), abs=1e-9)


@pytest.mark.parametrize(
    ("command", "dt", "error"),
    [
        (WheelCommand((1.0,)), 0.1, ShapeError),
        (WheelCommand((1.0, 1.0), (0.1,)), 0.1, ShapeError),
        (WheelCommand((1.0, math.nan)), 0.1, InputError),
        (WheelCommand((1.0, 1.0)), 0.0, InputError),
        (WheelCommand((1.0, 1.0)), math.nan, InputError),
    ],
)
def test_stepped_robot_refuses_what_it_cannot_do(command, dt, error):
    robot = SimulatedRobot(ROVER)
    with pytest.raises(error):
        robot.step(command, dt)
    assert robot.time_ns == 0


# ------------------------------------------------------------------------------- the files


def test_written_log_reads_back_the_same(tmp_path):
    robot = Robot(drive=CARS["ackermann"], noise=Noise(lateral_slip=0.01, steering=0.01))
    log = simulate(robot, TOUR, gyro=Gyro())
    write_log(log, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    columns = dict(zip(names, zip(*rows, strict=True), strict=True))
    assert (
        names
        == (
            "time_ns rear_left.position rear_right.position front_left.steering front_right.steering "
            "gyro.yaw_rate reference.x reference.y reference.theta"
        ).split()
    )
    assert np.array_equal(np.array(columns["time_ns"], dtype=np.int64), log.time_ns)
    for name, column in (
        ("rear_right.position", log.wheels[:, 1]),
        ("front_left.steering", log.steering[:, 0]),
        ("gyro.yaw_rate", log.yaw_rate),
        ("reference.theta", log.reference.poses[:, 2]),
    ):
        assert np.array_equal(np.array(columns[name], dtype=float), column)


def test_what_the_columns_cannot_say_is_not_written(tmp_path):
    log = simulate(ROVER, Course.of(stop(1.0)))
    target = tmp_path / "run.csv"
    with pytest.raises(InputError):
        write_log(replace(log, wheel_names=("left,", "right")), target)
    assert not target.exists()
    write_log(log, target)
    with pytest.raises(OutputError, match="exists"):
        write_log(log, target)


@pytest.fixture(scope="module")
def examples(checkout):
    spec = importlib.util.spec_from_file_location("examples_simulate", checkout / "examples" / "simulate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["differential", "mecanum", "ackermann", "swerve"])
def test_shipped_example_is_what_the_simulator_makes(examples, checkout, tmp_path, name):
    shipped = checkout / "examples" / name / "run.csv"
    write_log(examples.example(name), tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_bytes() == shipped.read_bytes()
    assert shipped.stat().st_size < 300_000


def test_every_example_folder_is_made_by_the_script(examples, checkout):
    folders = {path.parent.name for path in (checkout / "examples").glob("*/run.csv")}
    assert folders == set(examples.COURSES)


@pytest.mark.parametrize("name", ["differential", "mecanum", "ackermann", "swerve"])
def test_shipped_example_drifts_visibly_but_modestly(examples, checkout, name):
    robot = examples.load_robot(checkout / "examples" / name / "robot.yaml")
    log = examples.example(name)
    estimate = integrate(robot, log)
    assert not estimate.rejected
    off = np.hypot(*(estimate.poses - log.reference.poses)[:, :2].T).max() / log.reference.distance
    assert 0.001 < off < 0.02
