"""Live odometry and `integrate`: closed forms, one definition for both, and what hostile samples get."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trundle as tr
from trundle import InputError, Pose2D, Reading, Twist2D, WheelLog, WheelOdometry
from trundle.geometry import se2
from trundle.odometry.covariance import ZERO
from trundle.robot.description import UNMEASURED

R, TRACK = 0.05, 0.4
DIFF = tr.Differential(track_width=TRACK, wheel_radius=R)
DRIVES = {
    "differential": DIFF,
    "differential+gyro": tr.Differential(
        track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro")
    ),
    "skid": tr.SkidSteer(track_width=TRACK, wheelbase=0.3, wheel_radius=R),
    "bicycle rear": tr.Bicycle(wheelbase=0.3, wheel_radius=R),
    "bicycle front": tr.Bicycle(wheelbase=0.3, wheel_radius=R, measured="front"),
    "ackermann": tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=R),
    "mecanum": tr.Mecanum(track_width=TRACK, wheelbase=0.3, wheel_radius=R),
    "swerve": tr.Swerve(modules=[(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)], wheel_radius=R),
    "tracking+gyro": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (-0.1, 0.0, math.pi / 2)], R, measured=("wheel_1", "wheel_2", "gyro")
    ),
}
NOISE = tr.Noise(
    wheel_distance=0.01, lateral_slip=0.005, steering=0.01, gyro=0.002, wheel_radius=0.003, track_width=0.01
)
ROBOTS = {
    name: tr.Robot(
        drive=drive,
        noise=NOISE,
        encoders=dict.fromkeys(drive.measured_names, tr.Encoder(ticks_per_revolution=500)),
    )
    for name, drive in DRIVES.items()
}
every_robot = pytest.mark.parametrize(
    "robot", [pytest.param(robot, id=name) for name, robot in ROBOTS.items()]
)


def random_log(
    drive: tr.Kinematics, seed: int, *, rows: int = 60, reading: Reading = Reading.POSITION
) -> WheelLog:
    """Plausible motion, and about one hostile row in ten."""
    generator = np.random.default_rng(seed)
    time_ns = np.cumsum(generator.integers(5_000_000, 40_000_000, rows))
    rates = np.cumsum(generator.normal(0.0, 1.0, (rows, len(drive.measured_names))), axis=0)
    wheels = rates if reading is Reading.VELOCITY else 0.02 * rates
    if reading is Reading.POSITION:
        wheels = np.cumsum(wheels, axis=0) + 100.0
    steering = np.clip(np.cumsum(generator.normal(0, 0.03, (rows, len(drive.steered_names))), axis=0), -1, 1)
    yaw_rate = generator.normal(0.0, 0.5, rows)
    for row in generator.choice(np.arange(1, rows), rows // 10, replace=False):
        fault = generator.integers(0, 7)
        if fault == 0:
            wheels[row, 0] = generator.choice([np.nan, np.inf, -np.inf])
        elif fault == 1:
            time_ns[row] = time_ns[row - 1]
        elif fault == 2:
            time_ns[row] = time_ns[row - 1] - 10_000_000
        elif fault == 3:
            time_ns[row:] += 2_000_000_000
        elif fault == 4:
            wheels[row, 0] += 1e5
        elif fault == 5:
            time_ns[row:] -= 5_000_000_000
        elif steering.size:
            steering[row, 0] = 1.57
        else:
            time_ns[row] = time_ns[row - 1] + 10
    return WheelLog(
        time_ns=time_ns,
        wheel_names=drive.measured_names,
        wheels=wheels,
        reading=reading,
        steering_names=drive.steered_names,
        steering=steering if steering.size else None,
        yaw_rate=yaw_rate if drive.gyro else None,
    )


def fold(robot: tr.Robot, log: WheelLog, **options) -> tuple[WheelOdometry, list[tr.OdometryState]]:
    odometry = WheelOdometry(robot, **options)
    names = {Reading.POSITION: "positions", Reading.INCREMENT: "increments", Reading.VELOCITY: "velocities"}
    names[Reading.TICKS] = "ticks"
    states = [
        odometry.update(
            time_ns=int(log.time_ns[row]),
            steering=() if log.steering is None else log.steering[row].tolist(),
            yaw_rate=None if log.yaw_rate is None else float(log.yaw_rate[row]),
            **{names[log.reading]: log.wheels[row].tolist()},
        )
        for row in range(len(log))
    ]
    return odometry, states


# --- one definition -------------------------------------------------------------------------------------


@every_robot
@settings(max_examples=8)
@given(
    seed=st.integers(0, 10**6),
    integrator=st.sampled_from(["arc+", "arc", "midpoint", "euler"]),
    reading=st.sampled_from([Reading.POSITION, Reading.INCREMENT, Reading.VELOCITY]),
)
def test_folding_update_is_integrate(robot: tr.Robot, seed: int, integrator: str, reading: Reading) -> None:
    log = random_log(robot.drive, seed, reading=reading)
    odometry, states = fold(robot, log, integrator=integrator)
    trajectory = tr.integrate(robot, log, integrator=integrator)
    accepted = [state for state in states if state.accepted]
    assert odometry.offered == odometry.accepted + sum(odometry.rejected.values()) == len(log)
    assert dict(trajectory.rejected) == odometry.rejected
    assert dict(trajectory.events) == odometry.events
    np.testing.assert_array_equal(trajectory.time_ns, [state.time_ns for state in accepted])
    poses = [(s.pose.x, s.pose.y, s.pose.theta) for s in accepted]
    np.testing.assert_allclose(trajectory.poses, poses, rtol=1e-11, atol=1e-11)
    twists = [(s.twist.vx, s.twist.vy, s.twist.omega) for s in accepted]
    np.testing.assert_allclose(trajectory.twists, twists, rtol=1e-9, atol=1e-9)
    covariances = np.array([s.covariance for s in accepted])
    size = 1e-12 + np.abs(covariances).max(initial=0.0)
    np.testing.assert_allclose(trajectory.covariances / size, covariances / size, atol=1e-10)


@every_robot
@settings(max_examples=5)
@given(
    seed=st.integers(0, 10**6),
    reading=st.sampled_from([Reading.POSITION, Reading.INCREMENT, Reading.VELOCITY]),
)
def test_every_state_is_finite_and_its_covariance_positive(
    robot: tr.Robot, seed: int, reading: Reading
) -> None:
    _, states = fold(robot, random_log(robot.drive, seed, reading=reading))
    for state in states:
        assert all(map(math.isfinite, (state.pose.x, state.pose.y, state.pose.theta, *state.upper)))
        covariance = np.array(state.covariance)
        least = np.linalg.eigvalsh(covariance)[0]
        assert least >= -1e-12 * np.trace(covariance)


@pytest.mark.parametrize("robot", [robot for robot in ROBOTS.values() if not robot.drive.gyro], ids=str)
def test_integrate_batch_is_integrate_without_the_checks(robot: tr.Robot) -> None:
    generator = np.random.default_rng(5)
    drive = robot.drive
    positions = np.cumsum(generator.normal(0.1, 0.05, (3, 50, len(drive.measured_names))), axis=1)
    steering = (
        generator.uniform(-0.6, 0.6, (3, 50, len(drive.steered_names))) if drive.steered_names else None
    )
    time_ns = np.cumsum(generator.integers(10_000_000, 30_000_000, 50))
    for integrator in ("arc+", "arc", "midpoint", "euler", "symmetric"):
        poses = tr.integrate_batch(drive, positions, time_ns, steering, integrator)
        for robot_index in range(3):
            log = WheelLog(
                time_ns=time_ns,
                wheel_names=drive.measured_names,
                wheels=positions[robot_index],
                steering_names=drive.steered_names,
                steering=None if steering is None else steering[robot_index],
            )
            wanted = tr.integrate(drive, log, integrator=integrator).poses
            np.testing.assert_allclose(poses[robot_index], wanted, atol=1e-13)


def test_splitting_a_log_changes_nothing() -> None:
    log = random_log(DIFF, 7, rows=200)
    _, states = fold(ROBOTS["differential"], log)
    whole = tr.integrate(ROBOTS["differential"], log)
    assert states[-1].pose.x == pytest.approx(whole.poses[-1, 0], abs=1e-12)


# --- closed forms ------------------------------------------------------------------------------------------


def drive_profile(drive: tr.Kinematics, twist_at, rate: float, seconds: float):
    """Exact wheel positions of a fixed-geometry drive along a body-twist profile, by Gauss quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(0.0, seconds, round(seconds * rate) + 1)
    h = edges[1] - edges[0]
    times = edges[:-1, None] + 0.5 * h * (nodes + 1.0)
    speeds, _ = drive.inverse_batch(twist_at(times))
    increments = 0.5 * h * np.einsum("k,nkw->nw", weights, speeds)
    return edges, np.vstack([np.zeros(increments.shape[1]), np.cumsum(increments, axis=0)])


def run(drive: tr.Kinematics, edges, positions, integrator: str):
    log = WheelLog(
        time_ns=np.round(edges * 1e9).astype(np.int64), wheel_names=drive.measured_names, wheels=positions
    )
    return tr.integrate(drive, log, integrator=integrator, covariance=False)


def test_a_circle_is_exact() -> None:
    """1 m/s on a circle of 1 m for 100 m."""

    def twist_at(times):
        return np.stack([np.ones_like(times), np.zeros_like(times), np.ones_like(times)], axis=-1)

    edges, positions = drive_profile(DIFF, twist_at, 50.0, 100.0)
    for integrator in ("arc+", "arc"):
        poses = run(DIFF, edges, positions, integrator).poses
        wanted = np.column_stack([np.sin(edges), 1.0 - np.cos(edges), edges])
        assert np.abs(poses - wanted).max() < 1e-9
    euler = run(DIFF, edges, positions, "euler").poses
    assert np.abs(euler - wanted).max() > 1e-3


def test_the_commutator_is_third_order() -> None:
    """A slalom, omega = cos 2t, at falling rates: the error falls at least by 2^2.9 per halving."""

    def twist_at(times):
        return np.stack([np.ones_like(times), np.zeros_like(times), np.cos(2.0 * times)], axis=-1)

    nodes, weights = np.polynomial.legendre.leggauss(8)
    fine = np.linspace(0.0, 20.0, 4001)
    h = fine[1] - fine[0]
    times = fine[:-1, None] + 0.5 * h * (nodes + 1.0)
    heading = 0.5 * np.sin(2.0 * times)
    true = np.array(
        [0.5 * h * np.sum(weights * np.cos(heading)), 0.5 * h * np.sum(weights * np.sin(heading))]
    )
    errors = {}
    for integrator in ("arc+", "arc"):
        for rate in (10.0, 20.0, 40.0):
            edges, positions = drive_profile(DIFF, twist_at, rate, 20.0)
            poses = run(DIFF, edges, positions, integrator).poses
            errors[integrator, rate] = np.hypot(*(poses[-1, :2] - true))
    assert errors["arc+", 40.0] < 0.01 * errors["arc", 40.0]
    # The first step has no step before it; its own second-order share is what limits the short run.
    assert math.log2(errors["arc+", 20.0] / errors["arc+", 40.0]) > 2.7


def test_steering_is_taken_at_mid_step() -> None:
    """ACCURACY.md: -0.5 to 0.5 rad in 1 s at 2 m/s, wheelbase 0.3 m, 50 Hz ends within a millimetre."""
    car = tr.Bicycle(wheelbase=0.3, wheel_radius=R)
    fine = np.linspace(0.0, 1.0, 200_001)
    omega = 2.0 * np.tan(fine - 0.5) / 0.3
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * np.diff(fine))])
    x, y = (
        np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(fine)) for f in (2.0 * np.cos(heading), 2.0 * np.sin(heading))
    )
    edges = np.linspace(0.0, 1.0, 51)
    log = WheelLog(
        time_ns=np.round(edges * 1e9).astype(np.int64),
        wheel_names=("rear",),
        wheels=(2.0 * edges / R)[:, None],
        steering_names=("front",),
        steering=(edges - 0.5)[:, None],
    )
    final = tr.integrate(car, log).pose(-1)
    assert math.hypot(final.x - x, final.y - y) < 1e-3
    assert abs(final.theta - heading[-1]) < 1e-3


def test_swerve_modules_wrap_without_a_jump() -> None:
    """A module that turns through 180 degrees stays between both readings, not at their mean."""
    drive = DRIVES["swerve"]
    angle = math.pi - 0.01
    odometry = WheelOdometry(drive)
    odometry.update(0.0, [0.0] * 4, [angle] * 4)
    state = odometry.update(0.1, [1.0] * 4, [-angle] * 4)
    assert state.pose.x == pytest.approx(-R, rel=1e-3)


def test_velocities_are_integrated_by_the_trapezoid() -> None:
    odometry = WheelOdometry(DIFF)
    for k in range(101):
        state = odometry.update(k * 0.01, velocities=[k * 0.1, k * 0.1])
    # v = 10 t r up to t = 1.
    assert state.pose.x == pytest.approx(5.0 * R, rel=1e-12)
    assert state.twist.vx == pytest.approx(10.0 * R)


def test_jittered_stamps_do_not_stretch_the_noise_of_velocities() -> None:
    """A sample 10 us after the last says nothing of how the speed bends over the next 40 ms."""
    speeds = [(10.0, 12.0), (10.1, 11.9), (9.9, 12.1), (10.05, 11.95), (9.95, 12.05)]
    odometry = WheelOdometry(DIFF)
    for time, pair in zip((0.0, 0.02, 0.04, 0.04001, 0.08), speeds, strict=True):
        state = odometry.update(time, velocities=pair)
    assert state.pose.theta == pytest.approx(0.08 * 2.0 * R / TRACK, rel=0.1)
    assert state.pose.x == pytest.approx(0.08 * 11.0 * R, rel=0.02)


def test_a_published_twist_is_a_reading_too() -> None:
    time_ns = np.arange(101) * 10_000_000
    twists = np.tile([1.0, 0.0, 1.0], (101, 1))
    trajectory = tr.integrate(DIFF, WheelLog(time_ns=time_ns, twists=twists))
    assert trajectory.poses[-1] == pytest.approx((math.sin(1.0), 1 - math.cos(1.0), 1.0), abs=1e-12)


def test_uncertainty_grows_with_distance_not_with_the_rate() -> None:
    ends = []
    for steps in (10, 1000):
        # Little noise: what errors of heading and position make together is another test's matter.
        odometry = WheelOdometry(tr.Robot(drive=DIFF, noise=tr.Noise(wheel_distance=1e-5)), max_gap=100.0)
        for k in range(steps + 1):
            state = odometry.update(k * 20.0 / steps, [k * 200.0 / steps] * 2)
        ends.append(state.covariance)
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.02)
    # 10 m with two wheels of sigma per sqrt(m): sigma_x^2 = sigma^2 * 10 / 2.
    assert ends[1][0][0] == pytest.approx(1e-5**2 * 10.0 / 2.0, rel=1e-6)
    assert ends[1][2][2] == pytest.approx(2.0 * 1e-5**2 * 10.0 / TRACK**2, rel=1e-6)


# --- the face -----------------------------------------------------------------------------------------------


def test_reset_loses_no_motion() -> None:
    """Road Runner drops the sample before a reset; here the encoders go on counting."""
    odometry = WheelOdometry(DIFF)
    odometry.update(0.0, [0.0, 0.0])
    odometry.update(0.1, [1.0, 1.0])
    odometry.reset(Pose2D(10.0, 0.0, math.pi / 2))
    state = odometry.update(0.2, [3.0, 3.0])
    assert (state.pose.x, state.pose.y) == pytest.approx((10.0, 2.0 * R))
    with pytest.raises(InputError, match="finite"):
        odometry.reset(Pose2D(math.nan, 0.0, 0.0))


def test_heading_counts_its_turns() -> None:
    odometry = WheelOdometry(DIFF)
    for k in range(1001):
        state = odometry.update(k * 0.02, [-k * 0.2, k * 0.2])
    assert state.pose.theta == pytest.approx(1000 * 0.2 * 2 * R / TRACK, rel=1e-12)
    assert state.pose.theta > 6 * math.pi


def test_a_localizer_measures_while_the_wheels_drive() -> None:
    robot = tr.Robot(drive=DIFF).with_localizer(
        tr.TrackingWheels([(0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (-0.1, 0.0, math.pi / 2)], wheel_radius=0.024)
    )
    odometry = WheelOdometry(robot)
    odometry.update(0.0, [0.0, 0.0, 0.0])
    state = odometry.update(0.1, [1.0, 1.0, 2.0])
    assert (state.pose.x, state.pose.y) == pytest.approx((0.024, 0.048))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"positions": [0, 0]}, "give time"),
        ({"time": 0.0, "time_ns": 0, "positions": [0, 0]}, "give time"),
        ({"time": 0.0}, "exactly one of positions"),
        ({"time": 0.0, "positions": [0, 0], "velocities": [0, 0]}, "exactly one of positions"),
        ({"time": 0.0, "ticks": [0, 0]}, "ticks need encoders.*left, right"),
        ({"time": 0.0, "positions": [0, 0], "yaw_rate": 0.1}, "declares no gyro"),
        ({"time": 0.0, "positions": ["a", 0]}, "'a' is not a number"),
    ],
)
def test_a_wrong_call_says_what_is_wrong(arguments: dict, message: str) -> None:
    odometry = WheelOdometry(DIFF)
    with pytest.raises(InputError, match=message):
        odometry.update(**arguments)
    assert odometry.offered == sum(odometry.rejected.values())


def test_one_kind_of_reading_per_odometry() -> None:
    odometry = WheelOdometry(DIFF)
    odometry.update(0.0, [0.0, 0.0])
    with pytest.raises(InputError, match="velocity given, but it was position"):
        odometry.update(0.1, velocities=[0.0, 0.0])
    with pytest.raises(tr.ConfigError, match="did you mean 'arc'"):
        WheelOdometry(DIFF, integrator="arx")
    with pytest.raises(InputError, match="needs the step after"):
        WheelOdometry(DIFF, integrator="symmetric")


# --- hostile samples --------------------------------------------------------------------------------------


def robot_with(bits: int | None = None, noise: tr.Noise = UNMEASURED, **limits: float) -> tr.Robot:
    encoders = dict.fromkeys(("left", "right"), tr.Encoder(ticks_per_revolution=4096, bits=bits))
    return tr.Robot(drive=DIFF, encoders=encoders, limits=tr.Limits(**limits), noise=noise)


def good(k: int) -> list[float]:
    return [0.3 * k, 0.35 * k]


def rejected_then_bridged(bad_update, reason: str, *, robot=DIFF, make=good, name: str = "positions") -> None:
    """A bad sample in the middle changes nothing, is counted once, and the next one bridges it."""
    clean, faulty = WheelOdometry(robot), WheelOdometry(robot)
    for k in range(10):
        if k == 5:
            before = faulty.state
            state = bad_update(faulty, k)
            assert not state.accepted
            assert state.reason == reason
            assert state.pose == before.pose
            assert state.upper == before.upper
            assert faulty.rejected == {reason: 1}
        else:
            clean.update(k * 0.02, **{name: make(k)})
            faulty.update(k * 0.02, **{name: make(k)})
    assert faulty.offered == faulty.accepted + sum(faulty.rejected.values()) == 10
    difference = faulty.state.pose.inverse() @ clean.state.pose
    assert math.hypot(difference.x, difference.y) < 1e-9


def nonfinite(value: float):
    def check() -> None:
        rejected_then_bridged(lambda o, k: o.update(k * 0.02, [value, 0.1]), "nonfinite")
        gyro = DRIVES["differential+gyro"]
        odometry = WheelOdometry(gyro)
        odometry.update(0.0, [0.0, 0.0], yaw_rate=0.0)
        assert odometry.update(0.1, [0.1, 0.1], yaw_rate=value).reason == "nonfinite"
        car = WheelOdometry(DRIVES["bicycle rear"])
        assert car.update(0.0, [0.0], [value]).reason == "nonfinite"
        car.update(0.0, [0.0], [0.1])
        assert car.update(0.1, [0.1], [value]).reason == "nonfinite"
        first = WheelOdometry(DIFF)
        assert first.update(0.0, [value, 0.0]).reason == "nonfinite"
        assert first.update(value, [0.0, 0.0]).reason == "nonfinite"
        assert first.update(0.0, [5.0, 5.0]).reason == "baseline"

    return check


def s3() -> None:
    odometry = WheelOdometry(DIFF, pose=Pose2D(1.0, 2.0, 3.0))
    state = odometry.update(0.0, [1e6, -1e6])
    assert (state.pose, state.twist, state.reason) == (Pose2D(1.0, 2.0, 3.0), Twist2D(), "baseline")


def s4() -> None:
    rejected_then_bridged(lambda o, k: o.update((k - 1) * 0.02, good(k - 1)), "duplicate")
    rejected_then_bridged(lambda o, k: o.update((k - 1) * 0.02, good(k)), "duplicate_conflict")


def s5() -> None:
    rejected_then_bridged(
        lambda o, k: o.update(time_ns=(k - 1) * 20_000_000 + 999, positions=good(k)), "too_soon"
    )


def s6() -> None:
    rejected_then_bridged(lambda o, k: o.update((k - 1) * 0.02 - 0.9, good(k)), "out_of_order")
    odometry = WheelOdometry(DIFF)
    odometry.update(100.0, [0.0, 0.0])
    before = odometry.update(100.1, [1.0, 1.0])
    state = odometry.update(5.0, [77.0, 77.0])
    assert (state.accepted, state.reason, state.pose) == (True, "clock_reset", before.pose)
    assert odometry.events == {"clock_reset": 1}
    assert odometry.update(5.1, [78.0, 78.0]).pose.x == pytest.approx(before.pose.x + R)
    grown = []
    for back in (1.0, 3600.0):  # how far says nothing of how long: what may have been driven is that of a gap
        odometry = WheelOdometry(robot_with(max_speed=2.0, max_yaw_rate=3.0), max_gap=0.5)
        for time in (5000.0, 5000.1, 5000.1 - back):
            state = odometry.update(time, [50.0, 50.0])
        assert state.reason == "clock_reset"
        grown.append(state.upper)
    assert grown[0] == grown[1]
    assert [grown[0][k] for k in (0, 2, 5)] == pytest.approx([1.0, 1.0, 2.25], rel=1e-3)


def wrap(bits: int):
    """S9, S10: the counter wraps in both directions, signed or unsigned."""

    def check() -> None:
        for sign in (1, -1):
            for signed in (False, True):
                free, wrapping = WheelOdometry(robot_with()), WheelOdometry(robot_with(bits))
                modulus, step = 1 << bits, max(1, (1 << (bits - 1)) // 7)
                for k in range(40):
                    count = sign * min(step, 3000) * k + (modulus - 5)
                    held = count % modulus
                    if signed and held >= modulus // 2:
                        held -= modulus
                    free.update(k * 0.02, ticks=[count, count])
                    wrapping.update(k * 0.02, ticks=[held, held])
                assert wrapping.accepted == 40
                assert wrapping.state.pose == free.state.pose
                assert wrapping.state.pose.x * sign > 0.0

    return check


def ambiguous() -> None:
    """S9, S10: int16, 4096 per turn, 5 cm, 2 m/s: a gap of 1.26 s could hide a wrap."""
    for gap, accepted in ((1.24, True), (1.28, False)):
        odometry = WheelOdometry(robot_with(16, max_speed=2.0), max_gap=10.0)
        odometry.update(0.0, ticks=[0, 0])
        odometry.update(0.1, ticks=[100, 100])
        before = odometry.state
        state = odometry.update(0.1 + gap, ticks=[120, 120])
        assert state.accepted is accepted
        if not accepted:
            assert (state.reason, state.pose) == ("ambiguous_wrap", before.pose)
            assert state.covariance[0][0] > before.covariance[0][0] + 1.0
            assert odometry.update(1.5, ticks=[130, 130]).accepted
    half = WheelOdometry(robot_with(16))
    half.update(0.0, ticks=[0, 0])
    assert half.update(0.1, ticks=[1 << 15, 0]).reason == "ambiguous_wrap"


def s17() -> None:
    rejected_then_bridged(lambda o, k: o.update(k * 0.02, [1.0]), "shape")
    rejected_then_bridged(lambda o, k: o.update(k * 0.02, good(k), [0.1]), "shape")
    car = WheelOdometry(DRIVES["bicycle rear"])
    assert car.update(0.0, [0.0]).reason == "shape"
    with pytest.raises(tr.ShapeError):
        DIFF.forward([1.0])


def s18() -> None:
    car = WheelOdometry(tr.Bicycle(wheelbase=0.3, wheel_radius=R, max_steering=0.6))
    car.update(0.0, [0.0], [0.0])
    assert car.update(0.1, [0.1], [0.7]).reason == "range"
    assert car.update(0.1, [0.1], [0.6]).accepted
    free = WheelOdometry(DRIVES["bicycle rear"])
    free.update(0.0, [0.0], [0.0])
    for degrees in (89.5, 90.0, -90.0, 270.0):
        assert free.update(0.1, [0.1], [math.radians(degrees)]).reason == "range"
    assert free.update(0.1, [0.1], [math.radians(88.5)]).accepted
    assert WheelOdometry(DRIVES["swerve"]).update(0.0, [0.0] * 4, [math.pi / 2] * 4).accepted


def s7() -> None:
    """A gap: positions integrate if they can be true, doubting the path; velocities do not."""
    jumped, steady = WheelOdometry(ROBOTS["differential"]), WheelOdometry(ROBOTS["differential"])
    for odometry in (jumped, steady):
        odometry.update(0.0, [0.0, 0.0])
        odometry.update(0.1, [1.0, 1.0])
    state = jumped.update(3.1, [31.0, 31.0])
    for k in range(1, 31):
        steady.update(0.1 + 0.1 * k, [1.0 + k, 1.0 + k])
    assert (state.accepted, state.reason, jumped.events) == (True, "gap", {"gap": 1})
    assert state.pose.x == pytest.approx(steady.state.pose.x)
    assert math.sqrt(state.covariance[1][1]) == pytest.approx(30 * R / 2, rel=0.1)
    assert steady.state.covariance[1][1] < 0.1 * state.covariance[1][1]

    still = WheelOdometry(ROBOTS["differential"])
    still.update(0.0, [5.0, 5.0])
    before = still.state
    assert still.update(60.0, [5.0, 5.0]).upper == before.upper
    impossible = WheelOdometry(robot_with(max_speed=1.0))
    impossible.update(0.0, [0.0, 0.0])
    assert impossible.update(2.0, [1000.0, 1000.0]).reason == "implausible"

    speeds = WheelOdometry(ROBOTS["differential"])
    speeds.update(0.0, velocities=[10.0, 10.0])
    before = speeds.update(0.1, velocities=[10.0, 10.0])
    after = speeds.update(3.1, velocities=[10.0, 10.0])
    assert (after.accepted, after.reason, after.pose) == (True, "gap", before.pose)
    assert after.covariance[0][0] > (10.0 * R * 3.0) ** 2


def s8() -> None:
    """Jitter from microseconds to a day, and stamps of the epoch: integer nanoseconds keep the speed."""
    odometry = WheelOdometry(ROBOTS["differential"])
    start, position, previous = 1_770_000_000_000_000_000, 0.0, 1_770_000_000_000_000_000
    odometry.update(time_ns=start, positions=[0.0, 0.0])
    for step in (1_000, 1_000_000, 1_000_001, 20_000_000, 999_999_999, 100_000_000_000_000):
        previous += step
        position += 2.0 * step * 1e-9
        state = odometry.update(time_ns=previous, positions=[position, position])
        assert state.accepted
        assert state.twist.vx == pytest.approx(2.0 * R, rel=1e-6)
    assert odometry.update(time_ns=previous + 1, positions=[position, position]).reason == "too_soon"


def s11() -> None:
    """The encoders' computer restarts: one event, no motion, and the doubt covers what was not seen."""
    robot = tr.Robot(drive=DIFF, limits=tr.Limits(max_speed=1.0, max_yaw_rate=2.0))
    for index, start in enumerate((1000.0, -1000.0)):
        odometry = WheelOdometry(robot)
        for k in range(5):
            before = odometry.update(k * 0.02, [start + 0.3 * k] * 2)
        state = odometry.update(0.1, [0.0, 0.0])
        assert (state.accepted, state.reason, state.pose) == (False, "jump", before.pose)
        assert odometry.events == {"encoder_restart": 1}, index
        unseen = 0.3 * R
        assert state.covariance[0][0] > before.covariance[0][0] + unseen**2
        assert odometry.update(0.12, [0.3, 0.3]).pose.x == pytest.approx(before.pose.x + unseen)
        assert odometry.rejected == {"jump": 1}


def s12() -> None:
    """A glitch beyond v_max dt 1.5 + 2 ticks is refused; three in a row are the new normal."""
    robot = robot_with(max_speed=1.0)
    bound = 1.5 * 1.0 * 0.02 + 2.0 * math.tau / 4096 * R
    for factor, reason in ((0.99, ""), (1.01, "implausible")):
        odometry = WheelOdometry(robot)
        odometry.update(0.0, [50.0, 50.0])
        assert odometry.update(0.02, [50.0 + factor * bound / R, 50.0]).reason == reason
    rejected_then_bridged(
        lambda o, k: o.update(k * 0.02, [900.0, 0.0]),
        "implausible",
        robot=robot,
        make=lambda k: [50 + 0.3 * k, 50 + 0.3 * k],
    )
    odometry = WheelOdometry(robot)
    before = odometry.update(0.0, [50.0, 50.0])
    for k in range(1, 4):
        state = odometry.update(k * 0.02, [900.0 + 0.1 * k, 900.0 + 0.1 * k])
        assert (state.reason, state.pose) == ("implausible", before.pose)
    assert odometry.events == {"rebaseline": 1}
    assert odometry.rejected == {"implausible": 3}
    assert odometry.update(0.08, [900.4, 900.4]).pose.x == pytest.approx(0.1 * R)


BOUND = 0.999 * 1.5 * 2.0 * 0.02 / R
"""The furthest that a wheel of `robot_with(max_speed=2.0)` can be believed to turn in 20 ms [rad]."""


def s13() -> None:
    """A glitch below the bound is believed: off by at most 2.5 v_max dt, and the covariance knows of it.

    The next sample takes it back, but for the detour; or, if the way back is implausible, the third one
    after it finds a new normal.
    """
    exact = tr.Noise(wheel_distance=1e-6)  # nothing else covers anything
    robot = robot_with(noise=exact, max_speed=2.0, max_acceleration=2.0)
    glitches = [(a, b) for a in (-BOUND, 0.0, 0.7 * BOUND, BOUND) for b in (-BOUND, -0.2 * BOUND, BOUND)]
    for speed, turn, read in product((0.0, 1.0, 2.0), (0.0, 0.5), glitches):
        hostile, clean = WheelOdometry(robot), WheelOdometry(robot)
        step = [0.02 * (speed - 0.5 * TRACK * turn) / R, 0.02 * (speed + 0.5 * TRACK * turn) / R]
        for k in range(100):
            wheels = [50.0 + k * way for way in step]
            wanted = clean.update(0.02 * k, wheels)
            if k == 50:
                wheels = [value - way + glitch for value, way, glitch in zip(wheels, step, read, strict=True)]
            state = hostile.update(0.02 * k, wheels)
            if not state.accepted:
                assert 50 < k <= 53
                continue
            error = state.pose.inverse() @ wanted.pose
            e = se2.log(np.array([error.x, error.y, error.theta]))
            assert math.hypot(error.x, error.y) <= 2.5 * 2.0 * 0.02 or k > 50
            assert e @ np.linalg.solve(np.array(state.covariance) + 1e-3**2 * np.eye(3), e) < 3.0
        if "rebaseline" in hostile.events:  # neither the glitch nor three samples of motion were taken back
            glitch = 0.5 * R * sum(read) - 0.02 * speed
            assert state.covariance[0][0] > 0.98 * ((2.0 * 0.06) ** 2 + glitch**2)
        else:
            assert math.hypot(error.x, error.y) < 0.03
        if not hostile.rejected:  # the doubt went with the glitch
            np.testing.assert_allclose(state.upper, wanted.upper, atol=0.02**2)


@pytest.mark.parametrize("limits", [tr.Limits(max_speed=2.0), tr.Limits(max_speed=2.0, max_acceleration=2.0)])
@pytest.mark.parametrize("per_turn", [20, 4096])
def test_neither_ticks_nor_acceleration_are_taken_for_a_glitch(limits: tr.Limits, per_turn: int) -> None:
    """Stop and go at 2 m/s^2, read in ticks, at uneven times."""
    encoder = tr.Encoder(ticks_per_revolution=per_turn)
    robot = tr.Robot(drive=DIFF, encoders={"left": encoder, "right": encoder}, limits=limits)
    odometry, time_ns = WheelOdometry(robot), 0
    generator = np.random.default_rng(4)
    for _ in range(3000):
        time_ns += int(generator.integers(5_000_000, 35_000_000))
        time = time_ns * 1e-9
        way = time - 0.5 * math.sin(2.0 * time)
        turned = [way / R, (way + 0.1 * math.sin(time)) / R]
        odometry.update(
            time_ns=time_ns, ticks=[math.floor(value / encoder.radians_per_tick) for value in turned]
        )
        assert odometry.memory.surprise == ZERO


@pytest.mark.parametrize("reading", [Reading.POSITION, Reading.INCREMENT, Reading.VELOCITY])
@pytest.mark.parametrize("integrator", ["arc+", "midpoint"])
def test_a_believable_glitch_is_doubted_in_logs_as_well(reading: Reading, integrator: str) -> None:
    """Where counts do not add up nothing takes it back: the doubt stays as well."""
    turned = np.full((300, 2), 0.4)
    turned[[100, 140, 141, 250]] = [[1.0, 0.4], [-0.4, 0.4], [0.4, -0.4], [1.1, 1.1]]
    wheels = turned
    if reading is Reading.POSITION:
        wheels = np.cumsum(np.full((300, 2), 0.4), axis=0) + (turned - 0.4)
    elif reading is Reading.VELOCITY:
        wheels = turned / 0.02
    log = WheelLog(
        time_ns=np.arange(300) * 20_000_000, wheel_names=("left", "right"), wheels=wheels, reading=reading
    )
    robot = tr.Robot(drive=DIFF, limits=tr.Limits(max_speed=2.0))
    _, states = fold(robot, log, integrator=integrator)
    trajectory = tr.integrate(robot, log, integrator=integrator)
    covariances = np.array([state.covariance for state in states])
    np.testing.assert_allclose(trajectory.covariances, covariances, rtol=1e-9, atol=1e-15)
    doubt = covariances[[100, 110], 2, 2] - covariances[99, 2, 2]
    owed = (0.6 * R / TRACK) ** 2  # by one wheel that turned 1.0 in place of 0.4; of speeds half at a time
    assert doubt[0] > (0.15 if reading is Reading.VELOCITY else 1.0) * owed
    assert bool(doubt[1] > 0.15 * owed) is (reading is not Reading.POSITION)


def each(*checks):
    """One row of several numbers."""
    return lambda: [check() for check in checks]


FAULTS = [
    ("S1", nonfinite(math.nan)),
    ("S2", each(nonfinite(math.inf), nonfinite(-math.inf))),
    ("S3", s3),
    ("S4", s4),
    ("S5", s5),
    ("S6", s6),
    ("S7", s7),
    ("S8", s8),
    ("S9", each(*(wrap(bits) for bits in (8, 16, 24, 32, 64)))),
    ("S10", ambiguous),
    ("S11", s11),
    ("S12", s12),
    ("S13", s13),
    ("S17", s17),
    ("S18", s18),
]


@pytest.mark.parametrize("check", [pytest.param(check, id=row) for row, check in FAULTS])
def test_fault(check) -> None:
    check()
