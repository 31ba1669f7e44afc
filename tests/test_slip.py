"""Wheels that slip, encoders that freeze, gyros that drift: found, named, and covered by the covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

import trundle as tr
from trundle import Reading, WheelLog, WheelOdometry
from trundle.odometry.frozen_wheels import FrozenWheels
from trundle.odometry.slip import SlipMonitor, threshold
from trundle.odometry.standstill import Standstill

R, TRACK = 0.05, 0.4
DT = 0.02
MODULES = [(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)]
DRIVES = {
    "mecanum": tr.Mecanum(track_width=TRACK, wheelbase=0.3, wheel_radius=R),
    "swerve": tr.Swerve(modules=MODULES, wheel_radius=R),
    "differential+gyro": tr.Differential(
        track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro")
    ),
    "skid": tr.SkidSteer(track_width=TRACK, wheelbase=0.3, wheel_radius=R),
    "omni": tr.Omni(robot_radius=0.2, wheel_radius=R, wheel_count=4),
    "four-wheel steering": tr.FourWheelSteering(wheelbase=0.3, track_width=TRACK, wheel_radius=R),
    "three trackers+gyro": tr.TrackingWheels(
        [(0.0, 0.1, 0.0), (0.0, -0.1, 0.0), (-0.1, 0.0, math.pi / 2)],
        R,
        measured=("wheel_1", "wheel_2", "wheel_3", "gyro"),
    ),
}
NOISE = tr.Noise(wheel_distance=0.01, gyro=0.001)
every_drive = pytest.mark.parametrize("name", DRIVES)


def twists(name: str, rows: int, rng: np.random.Generator, still: int = 0) -> np.ndarray:
    """About 1 m/s, gently turning; the first rows at rest."""
    t = np.arange(rows) * DT
    phase = rng.uniform(0.0, 6.28, 3)
    vx = 1.0 + 0.2 * np.sin(0.7 * t + phase[0])
    omega = 0.5 * np.sin(0.5 * t + phase[1])
    holonomic = name in ("mecanum", "swerve", "omni", "four-wheel steering", "three trackers+gyro")
    vy = 0.3 * np.sin(0.9 * t + phase[2]) if holonomic else np.zeros(rows)
    found = np.stack([vx, vy, omega], axis=-1)
    found[:still] = 0.0
    return found


def record(
    name: str,
    rows: int,
    seed: int,
    *,
    slip: dict[str, float] | None = None,
    start: int = 0,
    noise: float = 0.01,
    gyro: float = 0.001,
    bias: float = 0.0,
    still: int = 0,
    ticks: int | None = None,
    speed: float = 1.0,
) -> WheelLog:
    """Readings along a drive: noise per distance, and wheels that slip by a share from `start` on."""
    drive = DRIVES[name]
    rng = np.random.default_rng(seed)
    body = twists(name, rows, rng, still) * speed
    speeds, steering = drive.inverse_batch(body)
    names = list(drive.wheel_names)
    turned = np.empty((rows, len(drive.measured_names)))
    for k, wheel in enumerate(drive.measured_names):
        turned[:, k] = speeds[:, names.index(wheel)] * DT
        if slip and wheel in slip:
            turned[start:, k] *= 1.0 + slip[wheel]
    turned += rng.normal(size=turned.shape) * noise * np.sqrt(np.abs(turned) / R)
    turned[0] = 0.0
    wheels = np.cumsum(turned, axis=0) + rng.uniform(0.0, 1.0, turned.shape[1])
    reading = Reading.POSITION
    if ticks is not None:
        wheels, reading = np.floor(wheels * ticks / math.tau).astype(np.int64), Reading.TICKS
    # Constant over each step; the angles are those of the middle of the step, from both ends.
    if drive.steered_names:
        steering = np.unwrap(steering, axis=0, period=math.pi)
    yaw = body[:, 2] + bias + rng.normal(0.0, gyro / math.sqrt(DT), rows)
    # The trapezoid of yaw rates sees half of each end.
    wheels_name = drive.measured_names
    return WheelLog(
        time_ns=np.arange(rows) * round(DT * 1e9),
        wheel_names=wheels_name,
        wheels=wheels,
        reading=reading,
        steering_names=drive.steered_names,
        steering=steering if drive.steered_names else None,
        yaw_rate=yaw if drive.gyro else None,
    )


def robot_of(name: str, **changes) -> tr.Robot:
    return tr.Robot(drive=DRIVES[name], noise=NOISE).replace(**changes)


def rows_of(log: WheelLog):
    """Arguments of `update`, row by row."""
    word = {Reading.POSITION: "positions", Reading.TICKS: "ticks"}[log.reading]
    for k in range(len(log)):
        yield {
            "time_ns": int(log.time_ns[k]),
            word: log.wheels[k].tolist(),
            "steering": () if log.steering is None else log.steering[k].tolist(),
            "yaw_rate": None if log.yaw_rate is None else float(log.yaw_rate[k]),
        }


def fold(robot: tr.Robot, log: WheelLog) -> tuple[WheelOdometry, list[tr.OdometryState]]:
    odometry = WheelOdometry(robot)
    return odometry, [odometry.update(**row) for row in rows_of(log)]


def with_columns(log: WheelLog, *, wheels=None, yaw_rate=None) -> WheelLog:
    return WheelLog(
        time_ns=log.time_ns,
        wheel_names=log.wheel_names,
        wheels=log.wheels if wheels is None else wheels,
        reading=log.reading,
        steering_names=log.steering_names,
        steering=log.steering,
        yaw_rate=log.yaw_rate if yaw_rate is None else yaw_rate,
    )


def frozen(log: WheelLog, wheel: int, first: int, last: int) -> WheelLog:
    """The same, but one counter stands still for a while and then counts on from there."""
    wheels = np.array(log.wheels)
    wheels[last:, wheel] -= wheels[last, wheel] - wheels[first, wheel]
    wheels[first:last, wheel] = wheels[first, wheel]
    return with_columns(log, wheels=wheels)


# --- the test itself --------------------------------------------------------------------------------------


@every_drive
def test_chi_square_is_chi_square(name: str) -> None:
    """Of windows of pure noise: its mean is the number of rows that could be spared."""
    monitor = SlipMonitor(DRIVES[name], NOISE, [0.0] * len(DRIVES[name].measured_names))
    gyro = DRIVES[name].gyro
    rng = np.random.default_rng(3)
    windows, wheels = 4000, len(DRIVES[name].measured_names)
    moved = [np.full(windows, 1.6)] * (1 + wheels)
    count = len(monitor.sums) - len(moved) - 5
    variance = NOISE.wheel_distance**2 * 1.6 + 1e-8
    moved += [rng.normal(size=windows) * math.sqrt(variance) for _ in range(count)]
    doubt, seconds = 1e-3, 2.0
    spread = math.sqrt(NOISE.gyro**2 * seconds + (doubt * seconds) ** 2 + 1e-8)
    moved += [rng.normal(size=windows) * spread, np.full(windows, seconds), *np.zeros((3, windows))]
    # A wrong radius is noise of the net way; here there is none.
    found = monitor.chi_square(moved, doubt, np)
    freedom = monitor.freedom(gyro)
    assert found.mean() == pytest.approx(freedom, abs=5.0 * math.sqrt(2.0 * freedom / windows))
    assert (found > threshold(freedom)).mean() < 0.003


@pytest.mark.parametrize(
    ("freedom", "exact"), [(1, 10.828), (2, 13.816), (3, 16.266), (5, 20.515), (8, 26.124)]
)
def test_threshold(freedom: int, exact: float) -> None:
    assert exact <= threshold(freedom) < 1.04 * exact


def test_no_monitor_where_nothing_can_contradict() -> None:
    for drive in (
        tr.Differential(track_width=TRACK, wheel_radius=R),
        tr.Bicycle(wheelbase=0.3, wheel_radius=R),
        tr.Omni(robot_radius=0.2, wheel_radius=R),
    ):
        assert WheelOdometry(drive).slip is None
    assert WheelOdometry(DRIVES["mecanum"], covariance=False).slip is None
    assert WheelOdometry(robot_of("mecanum", noise=tr.Noise(wheel_distance=0.0))).slip is None


def found_and_named(name: str, runs: int, metres: float) -> tuple[float, float]:
    """How often a slip of 10 % of one wheel is found, and how often that wheel is among the named."""
    drive, found, named = DRIVES[name], 0, 0
    for seed in range(runs):
        index = seed % len(drive.measured_names)
        wheel = drive.measured_names[index]
        start = 50 + seed % 80
        log = record(name, start + round(metres / DT), seed, slip={wheel: 0.1}, start=start)
        odometry, states = fold(robot_of(name), log) if runs < 20 else (None, None)
        trajectory = tr.integrate(robot_of(name), log)
        found += trajectory.events.get("slip", 0) > 0
        if odometry is not None:
            hits = [state for state in states if state.reason == "slip"]
            assert odometry.events == dict(trajectory.events)
            named += bool(hits) and wheel in odometry.slipping
    return found / runs, named / runs


@pytest.mark.parametrize("name", ["mecanum", "swerve", "differential+gyro"])
def test_a_slip_of_ten_percent_is_found(name: str) -> None:
    """Wheels of 1 %, one false alarm in a thousand windows, 4 m of slip."""
    assert found_and_named(name, 60, 4.0)[0] >= 0.95


@pytest.mark.verify
@pytest.mark.parametrize("name", ["mecanum", "swerve", "differential+gyro", "skid"])
def test_a_slip_of_ten_percent_is_found_in_full(name: str) -> None:
    for metres in (2.5, 3.0, 4.0):
        found = found_and_named(name, 1000, metres)[0]
        print(f"{name}: 10 % slip of one wheel over {metres} m found with probability {found:.3f}")
        assert found >= (0.95 if name != "mecanum" or metres >= 3.0 else 0.88)
    windows = alarms = 0
    for seed in range(4):
        odometry, _ = fold(robot_of(name), record(name, 50_000, seed))
        windows, alarms = windows + odometry.slip.window, alarms + odometry.events.get("slip", 0)
    print(f"{name}: {alarms} false alarms in {windows} windows")
    assert alarms <= 2.5e-3 * windows


@pytest.mark.parametrize("name", ["swerve", "four-wheel steering"])
def test_the_wheel_that_slips_is_named(name: str) -> None:
    """Where enough others agree without it, it alone."""
    for index, wheel in enumerate(DRIVES[name].measured_names):
        odometry, states = fold(robot_of(name), record(name, 250, 5 + index, slip={wheel: 0.2}))
        assert odometry.slipping == (wheel,)
        assert any(state.reason == "slip" and state.accepted for state in states)


def test_what_redundancy_does_not_tell_is_not_told() -> None:
    """One spare row of a mecanum drive says that somebody slips, and not who; a skid drive knows the side."""
    odometry, _ = fold(robot_of("mecanum"), record("mecanum", 250, 5, slip={"front_left": 0.2}))
    assert odometry.slipping == DRIVES["mecanum"].measured_names
    odometry, _ = fold(robot_of("skid"), record("skid", 250, 5, slip={"front_left": 0.2}))
    assert odometry.slipping == ("front_left", "rear_left")


@pytest.mark.parametrize("name", ["mecanum", "differential+gyro", "skid"])
def test_slip_is_covered_by_the_covariance(name: str) -> None:
    """Over many runs with slip the errors at the end are as large as the covariance says, within a factor."""
    drive = DRIVES[name]
    ratios = []
    for seed in range(40):
        wheel = drive.measured_names[seed % len(drive.measured_names)]
        slipping = tr.integrate(robot_of(name), record(name, 300, seed, slip={wheel: 0.15}))
        exact = tr.integrate(robot_of(name), record(name, 300, seed, noise=0.0, gyro=0.0))
        error = slipping.pose(-1).inverse() @ exact.pose(-1)
        e = np.array([error.x, error.y, error.theta])
        covariance = slipping.covariances[-1] + 1e-12 * np.eye(3)
        ratios.append(
            e @ np.linalg.solve(covariance, e) / 3.0 if name == "mecanum" else _planar(e, covariance)
        )
    assert 0.1 < np.median(ratios) < 3.0


def _planar(e: np.ndarray, covariance: np.ndarray) -> float:
    """The same without the sideways axis, along which such a drive is sure of itself by design."""
    keep = [0, 2]
    e, covariance = e[keep], covariance[np.ix_(keep, keep)]
    return float(e @ np.linalg.solve(covariance, e)) / 2.0


@pytest.mark.parametrize("ticks", [200, 4096])
@pytest.mark.parametrize("speed", [0.02, 1.0])
@pytest.mark.parametrize("name", ["mecanum", "swerve", "differential+gyro"])
def test_quantisation_alone_is_no_slip(name: str, speed: float, ticks: int) -> None:
    """At most one alarm an hour; here ten minutes at 50 Hz without one."""
    quantised(name, speed, ticks, 30_000, allowed=0)


@pytest.mark.verify
@pytest.mark.parametrize("name", DRIVES)
def test_quantisation_alone_is_no_slip_for_an_hour(name: str) -> None:
    for ticks in (20, 200, 4096):
        for speed in (0.02, 0.2, 1.0):
            quantised(name, speed, ticks, 180_000, allowed=1)


def quantised(name: str, speed: float, ticks: int, rows: int, allowed: int) -> None:
    drive = DRIVES[name]
    encoders = dict.fromkeys(drive.measured_names, tr.Encoder(ticks_per_revolution=ticks))
    log = record(name, rows, ticks, noise=0.0, gyro=0.0, ticks=ticks, speed=speed)
    events = tr.integrate(robot_of(name, encoders=encoders), log).events
    print(f"{name}, {ticks} ticks, {speed} m/s, {rows / 180_000:.2f} h: {dict(events)}")
    assert events.get("slip", 0) <= allowed
    assert events.get("stuck_wheel", 0) <= allowed


def test_ticks_alone_convict_no_wheel() -> None:
    """Of four omni wheels three may each have ticked just now, the fourth be about to: four ticks."""
    tick = math.tau / 20
    frozen = FrozenWheels(DRIVES["omni"], NOISE, [tick * R] * 4)
    once = [tick, -tick, tick, 0.0]  # what the fourth is owed: w_4 = w_1 - w_2 + w_3
    quiet = [0.0, 0.0, 0.0, 0.0]
    found = [
        frozen.convict(turned, (), None, 0.3, DRIVES["omni"].displacement(turned), None)
        for turned in (once, *[quiet] * 20, once)
    ]
    assert found == [False] * 21 + [True]
    assert frozen.stuck == (3,)


# --- one definition ---------------------------------------------------------------------------------------


@every_drive
@pytest.mark.parametrize("seed", range(3))
def test_folding_update_is_integrate(name: str, seed: int) -> None:
    """With slip, with a frozen encoder, with stops and a gyro's bias: the same states, the same events."""
    drive = DRIVES[name]
    slip = {drive.measured_names[seed % 2]: 0.3}
    log = record(name, 900, seed, slip=slip, start=300, bias=0.02, still=80)
    log = frozen(log, (seed + 1) % 2, 500, 600)
    for wheel in range(len(drive.measured_names)):  # a stop, as the wheels see it
        log = frozen(log, wheel, 700, 780)
    wheels = np.array(log.wheels)
    wheels[350] = np.nan
    log = with_columns(log, wheels=wheels)
    robot = robot_of(name)
    odometry, states = fold(robot, log)
    trajectory = tr.integrate(robot, log)
    accepted = [state for state in states if state.accepted]
    assert dict(trajectory.events) == odometry.events
    assert odometry.events.get("slip", 0) > 0
    assert odometry.events.get("stuck_wheel", 0) > 0
    poses = [(s.pose.x, s.pose.y, s.pose.theta) for s in accepted]
    np.testing.assert_allclose(trajectory.poses, poses, atol=1e-11)
    twists_ = [(s.twist.vx, s.twist.vy, s.twist.omega) for s in accepted]
    np.testing.assert_allclose(trajectory.twists, twists_, atol=1e-9)
    covariances = np.array([s.covariance for s in accepted])
    np.testing.assert_allclose(trajectory.covariances, covariances, atol=1e-10 * np.abs(covariances).max())


# --- the fault table ----------------------------------------------------------------------------------------


def s14(name: str):
    """An encoder freezes while the others say that its wheel must turn."""

    def check() -> None:
        drive = DRIVES[name]
        for index, wheel in enumerate(drive.measured_names):
            steady = record(name, 400, 11, noise=0.0, gyro=0.0)
            moving = np.abs(np.diff(np.asarray(steady.wheels)[195:260, index])).min() * R / DT
            if moving < 0.3:  # this wheel has little to say on this way
                continue
            log = frozen(steady, index, 200, 320)
            odometry = WheelOdometry(robot_of(name))
            found = None
            for k, row in enumerate(rows_of(log)):
                state = odometry.update(**row)
                assert state.accepted
                if state.reason == "stuck_wheel":
                    found = k
                    assert odometry.stuck == (wheel,)
                if k == 318:
                    assert odometry.stuck == (wheel,)
            assert found is not None
            assert (found - 200) * DT <= 0.5
            assert odometry.events["stuck_wheel"] == odometry.events["wheel_recovered"] == 1
            assert odometry.stuck == ()
            # Without it the pose is right but for what was missed before the verdict.
            exact = tr.integrate(drive, steady, covariance=False)
            missed = odometry.state.pose.inverse() @ exact.pose(-1)
            e = np.array([missed.x, missed.y, missed.theta])
            assert _planar(e, np.array(odometry.state.covariance)) < 3.0
            blind = tr.integrate(drive, log, covariance=False).pose(-1).inverse() @ exact.pose(-1)
            assert math.hypot(missed.x, missed.y) < 0.5 * math.hypot(blind.x, blind.y)

    return check


def s14_commanded() -> None:
    """Without redundancy only the command can tell."""
    drive = tr.Differential(track_width=TRACK, wheel_radius=R)
    for command in ([20.0, 20.0], drive.inverse(tr.Twist2D(1.0, 0.0, 0.0))):
        odometry = WheelOdometry(drive)
        for k in range(60):
            turned = 0.4 * k
            state = odometry.update(k * DT, [turned, min(turned, 8.0)], command=command)
            if state.reason == "stuck_wheel":
                break
        assert (k - 20) * DT <= 0.5
        assert odometry.stuck == ("right",)
        assert odometry.update((k + 1) * DT, [turned + 0.4, 8.4]).accepted
        assert odometry.stuck == ()
    quiet = WheelOdometry(drive)
    for k in range(100):  # turning about one wheel, as it was told
        quiet.update(k * DT, [0.0, 0.4 * k], command=[0.0, 20.0])
    assert quiet.events == {}
    with pytest.raises(tr.ShapeError, match="command: 1 speeds, must be 2"):
        quiet.update(3.0, [0.0, 41.0], command=[1.0])


def pivots_are_no_fault() -> None:
    """S14: a wheel may stand while others turn: about itself, or along a mecanum's rollers."""
    drive = DRIVES["differential+gyro"]
    odometry = WheelOdometry(drive)
    for k in range(200):
        odometry.update(k * DT, [0.0, 0.4 * k], yaw_rate=20.0 * R / TRACK)
    diagonal = WheelOdometry(DRIVES["mecanum"])
    for k in range(200):
        diagonal.update(k * DT, [0.0, 0.4 * k, 0.4 * k, 0.0])
    assert odometry.events == diagonal.events == {}


def s16() -> None:
    """Slip is flagged and the covariance grows by it; the sample still counts."""
    for name in ("mecanum", "swerve", "differential+gyro"):
        wheel = DRIVES[name].measured_names[0]
        plain, _ = fold(robot_of(name), record(name, 300, 2))
        odometry, states = fold(robot_of(name), record(name, 300, 2, slip={wheel: 0.3}))
        assert odometry.events["slip"] >= 1
        assert plain.events == {}
        assert wheel in odometry.slipping
        assert all(state.accepted for state in states)
        assert np.trace(states[-1].covariance) > 3.0 * np.trace(plain.state.covariance)


def s19() -> None:
    """A gyro drifts by a degree per second; once the robot stood for two seconds, its heading stays."""
    for name in ("differential+gyro", "three trackers+gyro"):
        rng = np.random.default_rng(6)
        odometry = WheelOdometry(robot_of(name))
        wheels = [3.0] * len(DRIVES[name].measured_names)
        bias = math.radians(1.0)
        headings = []
        for k in range(62 * 50):
            rate = bias + rng.normal(0.0, 0.007)
            headings.append(odometry.update(k * DT, wheels, yaw_rate=rate).pose.theta)
        drift = abs(math.degrees(headings[-1] - headings[100]))
        assert drift <= 0.01
        assert odometry.standstill.bias == pytest.approx(bias, abs=4 * 0.007 / math.sqrt(3000))
        # And driving on, the bias is out of it.
        start = headings[-1]
        for k in range(62 * 50, 72 * 50):
            moved = [3.0 + 0.2 * (k - 62 * 50 + 1)] * 2 + wheels[2:]
            state = odometry.update(k * DT, moved, yaw_rate=bias)
        assert abs(math.degrees(state.pose.theta - start)) < 0.2


def s19_turned_by_hand() -> None:
    """A gyro that really turns is believed although the wheels stand, and teaches no bias."""
    odometry = WheelOdometry(DRIVES["differential+gyro"])
    for k in range(101):
        state = odometry.update(k * DT, [0.0, 0.0], yaw_rate=0.5)
    assert state.pose.theta == pytest.approx(1.0, rel=0.01)
    assert odometry.standstill.bias == 0.0


def s20() -> None:
    """The gyro falls silent: wheel heading, its covariance, one event; and back."""
    odometry = WheelOdometry(robot_of("differential+gyro"))
    growth = {}
    for k in range(300):
        silent = 100 <= k < 200
        before = odometry.state
        # The wheels say 0.5 rad/s, the gyro 0.6.
        wheels = [k * DT * (1.0 - 0.1) / R, k * DT * (1.0 + 0.1) / R]
        state = odometry.update(k * DT, wheels, yaw_rate=None if silent else 0.6)
        assert state.accepted
        if k in (90, 150, 250):
            growth[k] = (
                (state.pose.theta - before.pose.theta) / DT,
                state.covariance[2][2] - before.covariance[2][2],
            )
    assert odometry.events["gyro_dropout"] == 1
    assert growth[150][0] == pytest.approx(0.5)
    assert growth[90][0] == growth[250][0] == pytest.approx(0.6, rel=0.01)
    assert growth[150][1] > 100.0 * growth[90][1] > 0.0
    needed = WheelOdometry(
        tr.TrackingWheels(
            [(0.1, 0.2, 0.0), (-0.1, 0.0, math.pi / 2)], R, measured=("wheel_1", "wheel_2", "gyro")
        )
    )
    needed.update(0.0, [0.0, 0.0], yaw_rate=0.0)
    assert needed.update(0.1, [1.0, 0.0]).reason == "no_gyro"
    assert needed.update(0.2, [2.0, 0.0], yaw_rate=0.0).pose.x == pytest.approx(2.0 * R)


def s21() -> None:
    """One tick in many samples: never faster than one tick per sample, and nothing is lost."""
    for name in ("mecanum", "differential+gyro"):
        drive = DRIVES[name]
        ticks = 200
        encoders = dict.fromkeys(drive.measured_names, tr.Encoder(ticks_per_revolution=ticks))
        tick = math.tau / ticks * R
        odometry = WheelOdometry(robot_of(name, encoders=encoders))
        speed = tick / 0.61  # one tick in 30 samples
        for k in range(5000):
            count = math.floor(k * DT * speed / tick)
            state = odometry.update(
                k * DT, ticks=[count] * len(drive.measured_names), yaw_rate=0.0 if drive.gyro else None
            )
            assert abs(state.twist.vx) * DT <= tick * (1.0 + 1e-9)
        assert state.pose.x == pytest.approx(count * tick, rel=1e-12)
        assert odometry.events == {}


def creeping_turn() -> None:
    """S21: turning by a tick every few seconds, the gyro is asleep but the wheels tell it."""
    drive = DRIVES["differential+gyro"]
    encoders = dict.fromkeys(("left", "right"), tr.Encoder(ticks_per_revolution=4096))
    odometry = WheelOdometry(robot_of("differential+gyro", encoders=encoders))
    rate = 2.0 * math.tau / 4096 * R / TRACK / 3.0  # each wheel a tick in three seconds
    for k in range(6000):
        count = math.floor(k * DT / 3.0)
        state = odometry.update(k * DT, ticks=[-count, count], yaw_rate=rate)
    turned = 2.0 * count * math.tau / 4096 * R / TRACK
    assert drive.gyro
    assert state.pose.theta == pytest.approx(turned, rel=0.05)


FAULTS = [
    *(pytest.param(s14(name), id=f"S14-{name}") for name in DRIVES if name != "omni"),
    pytest.param(s14_commanded, id="S14-commanded"),
    pytest.param(pivots_are_no_fault, id="S14-pivot"),
    pytest.param(s16, id="S16"),
    pytest.param(s19, id="S19"),
    pytest.param(s19_turned_by_hand, id="S19-turned by hand"),
    pytest.param(s20, id="S20"),
    pytest.param(s21, id="S21"),
    pytest.param(creeping_turn, id="S21-creeping turn"),
]


@pytest.mark.parametrize("check", FAULTS)
def test_fault(check) -> None:
    check()


def test_bias_is_a_running_mean() -> None:
    standstill = Standstill([0.0, 0.0], 0.001)
    shown = np.random.default_rng(1).normal(0.01, 0.005, 500)
    for rate in shown:
        standstill.step([0.0, 0.0], DT, rate)
    assert standstill.bias == pytest.approx(shown.mean(), rel=1e-9)
    assert standstill.doubt == pytest.approx(5e-4)


# --- what no reading says ----------------------------------------------------------------------------------


@pytest.mark.parametrize("pause", [1.5, 20.0])
def test_a_gyro_says_nothing_of_a_gap(pause: float) -> None:
    """A robot that circles, is paused, and circles on: the heading by its wheels, and nothing slipped."""
    odometry = WheelOdometry(tr.Robot(drive=DRIVES["differential+gyro"], noise=NOISE))
    omega, clock, way = 0.8, 0.0, 0.0
    for k in range(400):
        clock += pause if k == 200 else DT
        way += DT if k else 0.0
        wheels = [(0.5 * way - side * omega * way) / R for side in (0.5 * TRACK, -0.5 * TRACK)]
        state = odometry.update(clock, wheels, yaw_rate=omega)
    assert odometry.events == {"gap": 1}
    assert state.pose.theta == pytest.approx(omega * way, abs=1e-6)


def test_a_heading_that_only_the_gyro_knows_is_doubted_after_a_gap() -> None:
    drive = tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (-0.1, 0.0, math.pi / 2)], R, measured=("wheel_1", "wheel_2", "gyro")
    )
    robot = tr.Robot(drive=drive, noise=NOISE, limits=tr.Limits(max_speed=1.0, max_yaw_rate=0.5))
    odometry = WheelOdometry(robot)
    odometry.update(0.0, [0.0, 0.0], yaw_rate=0.1)
    odometry.update(0.02, [0.1, 0.0], yaw_rate=0.1)
    sigmas = []
    for pause, way in ((1.2, 0.2), (1.2, 0.2), (100.0, 0.3)):
        before = odometry.state.covariance[2][2]
        state = odometry.update(odometry.state.time_ns * 1e-9 + pause, [way, 0.0], yaw_rate=0.1)
        assert state.reason == "gap"
        sigmas.append(math.sqrt(state.covariance[2][2] - before))
    assert sigmas[0] == pytest.approx(0.5 * 1.2, rel=0.01)
    assert sigmas[1] < 0.01  # it stood
    assert math.sqrt(state.covariance[2][2]) == pytest.approx(
        math.pi / math.sqrt(3.0), rel=0.01
    )  # any heading


def test_lost_increments_are_no_slip() -> None:
    """The gyro saw more of that step than the wheels could say."""
    odometry = WheelOdometry(tr.Robot(drive=DRIVES["differential+gyro"], noise=NOISE))
    steps = [[(0.5 - side * 0.8) * DT / R for side in (0.5 * TRACK, -0.5 * TRACK)]] * 400
    for k, step in enumerate(steps):
        lost = 200 <= k < 240
        state = odometry.update(k * DT, increments=[math.nan, 0.0] if lost else step, yaw_rate=0.8)
        assert (state.reason == "increments_lost") is (k == 240)
    assert not odometry.events
