"""The one equation, against the closed forms of the literature, for every drive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import trundle as tr
from trundle import ConfigError, Infeasible, InputError, ShapeError, Singular, Twist2D, Unobservable, Wheel

R, TRACK, BASE = 0.05, 0.4, 0.6
SQUARE = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]

DRIVES = {
    "differential": tr.Differential(track_width=TRACK, wheel_radius={"left": 0.049, "right": 0.051}),
    "differential+gyro": tr.Differential(
        track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro")
    ),
    "skid": tr.SkidSteer(track_width=TRACK, wheelbase=BASE, wheel_radius=R),
    "skid icr": tr.SkidSteer(
        track_width=TRACK, wheelbase=BASE, wheel_radius=R, icr_left=0.3, icr_right=-0.25, icr_x=0.05
    ),
    "bicycle rear": tr.Bicycle(wheelbase=BASE, wheel_radius=R),
    "bicycle front": tr.Bicycle(wheelbase=BASE, wheel_radius=R, measured="front"),
    "bicycle both": tr.Bicycle(wheelbase=BASE, wheel_radius=R, measured=("rear", "front")),
    "bicycle at front": tr.Bicycle(wheelbase=BASE, wheel_radius=R, reference=(BASE, 0.0)),
    "ackermann": tr.Ackermann(wheelbase=BASE, track_width=TRACK, wheel_radius=R),
    "ackermann all": tr.Ackermann(
        wheelbase=BASE,
        track_width=TRACK,
        wheel_radius=R,
        measured=("front_left", "front_right", "rear_left", "rear_right"),
    ),
    "tricycle": tr.Tricycle(wheelbase=BASE, wheel_radius=R),
    "forklift": tr.Tricycle(wheelbase=BASE, track_width=TRACK, wheel_radius=R, front_y=0.1),
    "four wheel steering": tr.FourWheelSteering(wheelbase=BASE, track_width=TRACK, wheel_radius=R),
    "mecanum": tr.Mecanum(track_width=TRACK, wheelbase=BASE, wheel_radius=R),
    "mecanum off centre": tr.Mecanum(
        track_width=TRACK, wheelbase=BASE, wheel_radius=R, reference=(0.1, -0.2)
    ),
    "omni 3": tr.Omni(robot_radius=0.3, wheel_radius=R),
    "omni 5": tr.Omni(robot_radius=0.3, wheel_radius=R, wheel_count=5, first_wheel_angle=0.2),
    "swerve": tr.Swerve(modules=SQUARE, wheel_radius=R),
    "swerve 3": tr.Swerve(modules=[(0.3, 0.0), (-0.2, 0.2), (-0.2, -0.2)], wheel_radius=R),
    "swerve two measured": tr.Swerve(modules=SQUARE, wheel_radius=R, measured=("front_left", "rear_right")),
    "tracking": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (0.1, -0.2, 0.0), (-0.1, 0.0, math.pi / 2)], wheel_radius=R
    ),
    "tracking+gyro": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (-0.1, 0.0, math.pi / 2)], R, measured=("wheel_1", "wheel_2", "gyro")
    ),
    "rover": tr.Custom(
        wheels=[
            Wheel("fl", 0.5, 0.3, R, kind="steered"),
            Wheel("fr", 0.5, -0.3, R, kind="steered"),
            Wheel("ml", 0.0, 0.3, R),
            Wheel("mr", 0.0, -0.3, R),
            Wheel("rl", -0.5, 0.3, R, kind="steered"),
            Wheel("rr", -0.5, -0.3, R, kind="steered"),
            Wheel("tail", -0.7, 0.0, R, kind="caster"),
        ]
    ),
}
every_drive = pytest.mark.parametrize(
    "drive", [pytest.param(drive, id=name) for name, drive in DRIVES.items()]
)

speeds = st.floats(-3.0, 3.0).map(lambda value: round(value, 6))
twists = st.builds(Twist2D, speeds, speeds, speeds)


def parts(twist: Twist2D) -> tuple[float, float, float]:
    return (twist.vx, twist.vy, twist.omega)


def size(twist: Twist2D) -> float:
    return max(map(abs, parts(twist)))


def back_again(drive: tr.Kinematics, command: tr.WheelCommand, omega: float) -> Twist2D:
    return drive.forward(command, yaw_rate=omega if drive.gyro else None)


# --- there and back -----------------------------------------------------------------------------


@every_drive
@given(wanted=twists)
def test_forward_undoes_inverse(drive: tr.Kinematics, wanted: Twist2D) -> None:
    twist = drive.project(wanted)
    command = drive.inverse(twist)
    leaning = [
        angle for angle, bounds in zip(command.steering, drive.steering_bounds, strict=True) if bounds.leaning
    ]
    assume(all(abs(math.cos(angle)) > 1e-3 for angle in leaning))
    back = back_again(drive, command, twist.omega)
    worst = max(abs(a - b) for a, b in zip(parts(back), parts(twist), strict=True))
    assert worst <= 1e-12 * size(twist)


@every_drive
@given(wanted=twists)
def test_projection_is_feasible_and_keeps_what_is(drive: tr.Kinematics, wanted: Twist2D) -> None:
    once = drive.project(wanted)
    drive.inverse(once)
    twice = drive.project(once)
    np.testing.assert_allclose(parts(twice), parts(once), rtol=1e-12, atol=1e-12)


@every_drive
@given(many=st.lists(twists, min_size=1, max_size=6), turned=st.floats(-1.5, 1.5))
def test_batches_do_what_the_scalars_do(drive: tr.Kinematics, many: list[Twist2D], turned: float) -> None:
    many = [drive.project(twist) for twist in many]
    now = [turned] * len(drive.steered_names)
    one_by_one = [drive.inverse(twist, now) for twist in many]
    array = np.array([parts(twist) for twist in many])
    wheel_speeds, steering = drive.inverse_batch(array, np.tile(now, (len(many), 1)))
    np.testing.assert_allclose(wheel_speeds, [c.speeds for c in one_by_one], rtol=1e-13, atol=1e-12)
    np.testing.assert_allclose(
        steering, np.reshape([c.steering for c in one_by_one], steering.shape), rtol=1e-13, atol=1e-12
    )
    measured = np.array([drive.select(c.speeds) for c in one_by_one])
    rates = array[:, 2] if drive.gyro else None
    try:
        singly = [
            parts(back_again(drive, command, twist.omega))
            for command, twist in zip(one_by_one, many, strict=True)
        ]
    except Unobservable:
        with pytest.raises(Unobservable):
            drive.forward_batch(measured, steering if steering.size else None, yaw_rate=rates)
        return
    together = drive.forward_batch(measured, steering if steering.size else None, yaw_rate=rates)
    np.testing.assert_allclose(together, singly, rtol=1e-12, atol=1e-12)


@every_drive
def test_batches_keep_their_leading_axes(drive: tr.Kinematics) -> None:
    ahead = np.array(parts(drive.project(Twist2D(1.0, 0.0, 0.1))))
    wheel_speeds, steering = drive.inverse_batch(np.tile(ahead, (2, 3, 1)))
    assert wheel_speeds.shape == (2, 3, len(drive.wheel_names))
    assert steering.shape == (2, 3, len(drive.steered_names))
    empty, none = drive.inverse_batch(np.zeros((0, 3)))
    assert empty.shape == (0, len(drive.wheel_names))
    assert none.shape == (0, len(drive.steered_names))


@every_drive
@given(wanted=twists)
def test_consistent_readings_leave_no_residual(drive: tr.Kinematics, wanted: Twist2D) -> None:
    twist = drive.project(wanted)
    command = drive.inverse(twist)
    rest = drive.residual(
        drive.select(command.speeds), command.steering, yaw_rate=twist.omega if drive.gyro else None
    )
    assert len(rest) == len(drive.residual_names)
    assert max(map(abs, rest)) <= 1e-9 * (1.0 + size(twist))


@every_drive
@given(wanted=twists)
def test_jacobian_is_the_derivative_of_forward(drive: tr.Kinematics, wanted: Twist2D) -> None:
    command = drive.inverse(drive.project(wanted))
    assume(all(abs(math.cos(angle)) > 0.05 for angle in command.steering))
    rate = wanted.omega if drive.gyro else None
    chosen = drive.select(command.speeds)
    jacobian = np.array(drive.jacobian(command.steering))
    for k in range(len(chosen)):
        up, down = list(chosen), list(chosen)
        up[k], down[k] = chosen[k] + 0.5, chosen[k] - 0.5
        forth = parts(drive.forward(up, command.steering, yaw_rate=rate))
        back = parts(drive.forward(down, command.steering, yaw_rate=rate))
        np.testing.assert_allclose(jacobian[:, k], np.subtract(forth, back), atol=1e-9)


# --- closed forms of the literature -----------------------------------------------------------------


@given(left=speeds, right=speeds)
def test_differential_is_the_unicycle(left: float, right: float) -> None:
    """Siegwart and Nourbakhsh, eq. 3.9; the TurtleBot and K-State models."""
    twist = tr.Differential(track_width=TRACK, wheel_radius=R).forward([left, right])
    assert parts(twist) == pytest.approx((R * (left + right) / 2, 0.0, R * (right - left) / TRACK), abs=1e-15)


@given(wheels=st.tuples(speeds, speeds, speeds, speeds))
def test_skid_steer_averages_its_sides(wheels: tuple[float, ...]) -> None:
    twist = DRIVES["skid"].forward(wheels)
    left, right = (wheels[0] + wheels[2]) / 2, (wheels[1] + wheels[3]) / 2
    assert parts(twist) == pytest.approx((R * (left + right) / 2, 0.0, R * (right - left) / TRACK), abs=1e-14)


@given(left=speeds, right=speeds)
def test_skid_steer_with_icr_offsets(left: float, right: float) -> None:
    """Mandow et al. 2007, eq. 6 to 8, with x forward and y left."""
    twist = DRIVES["skid icr"].forward([left, right, left, right])
    omega = R * (right - left) / (0.3 + 0.25)
    vx = R * (right * 0.3 + left * 0.25) / (0.3 + 0.25)
    assert parts(twist) == pytest.approx((vx, -0.05 * omega, omega), abs=1e-14)


def test_treating_skid_wheels_as_fixed_is_refused() -> None:
    corners = zip(("fl", "fr", "rl", "rr"), SQUARE, strict=True)
    with pytest.raises(ConfigError, match=r"no way to turn.*kind='skid'"):
        tr.Custom(wheels=[Wheel(name, x, y, R) for name, (x, y) in corners])


@given(wheel=speeds, steer=st.floats(-1.5, 1.5))
def test_bicycle_measured_at_the_rear(wheel: float, steer: float) -> None:
    twist = DRIVES["bicycle rear"].forward([wheel], [steer])
    v = R * wheel
    assert parts(twist) == pytest.approx((v, 0.0, v * math.tan(steer) / BASE), rel=1e-12, abs=1e-14)


@given(wheel=speeds, steer=st.floats(-math.pi, math.pi))
def test_bicycle_measured_at_the_front(wheel: float, steer: float) -> None:
    twist = DRIVES["bicycle front"].forward([wheel], [steer])
    v = R * wheel
    wanted = (v * math.cos(steer), 0.0, v * math.sin(steer) / BASE)
    assert parts(twist) == pytest.approx(wanted, rel=1e-12, abs=1e-14)


@given(vx=st.floats(0.1, 3.0), steer=st.floats(-0.9, 0.9))
def test_ackermann_wheels_share_one_turning_centre(vx: float, steer: float) -> None:
    drive = DRIVES["ackermann"]
    omega = vx * math.tan(steer) / BASE
    left, right = drive.inverse(Twist2D(vx, 0.0, omega)).steering
    # cot(right) - cot(left) = track / wheelbase: the Ackermann condition.
    if abs(steer) > 1e-6:
        assert 1 / math.tan(right) - 1 / math.tan(left) == pytest.approx(TRACK / BASE, rel=1e-6)
    assert drive.expand_steering([steer]) == pytest.approx((left, right), abs=1e-12)
    rear = [vx - omega * TRACK / 2, vx + omega * TRACK / 2]
    one_angle = drive.forward([v / R for v in rear], [steer])
    assert parts(one_angle) == pytest.approx((vx, 0.0, omega), rel=1e-12, abs=1e-12)


@given(left=st.floats(0.05, 0.6), right=st.floats(0.05, 0.6))
def test_front_angles_that_agree_give_the_mean_of_their_cotangents(left: float, right: float) -> None:
    cot = 1 / math.tan(left) + TRACK / 2 / BASE
    agreeing = (left, math.atan(1 / (cot + TRACK / 2 / BASE)))
    mean = math.atan(1 / cot)
    drive = DRIVES["ackermann"]
    v, omega = 1.0, math.tan(mean) / BASE
    wheels = [(v - omega * TRACK / 2) / R, (v + omega * TRACK / 2) / R]
    assert drive.forward(wheels, agreeing).omega == pytest.approx(omega, rel=1e-12)
    assert max(map(abs, drive.residual(wheels, agreeing))) < 1e-12
    if abs(right - agreeing[1]) > 1e-3:
        assert max(map(abs, drive.residual(wheels, (left, right)))) > 1e-6


@given(twist=twists)
def test_mecanum_is_the_textbook(twist: Twist2D) -> None:
    """Taheri, Qiao, Ghaeminezhad 2015, eq. 20; Kohanbash's post."""
    reach = TRACK / 2 + BASE / 2
    vx, vy, turn = twist.vx, twist.vy, twist.omega * reach
    wanted = ((vx - vy - turn) / R, (vx + vy + turn) / R, (vx + vy - turn) / R, (vx - vy + turn) / R)
    assert DRIVES["mecanum"].inverse(twist).speeds == pytest.approx(wanted, rel=1e-13, abs=1e-12)


def test_omni_drives_along_the_clockwise_tangent() -> None:
    drive = tr.Omni(robot_radius=0.5, wheel_radius=0.1, wheel_count=4)
    assert drive.inverse(Twist2D(1.0, 1.0, 1.0)).speeds == pytest.approx((-15.0, 5.0, 5.0, -15.0))


@given(twist=twists, first=st.floats(-3.0, 3.0), count=st.integers(3, 6))
def test_omni_is_the_textbook(twist: Twist2D, first: float, count: int) -> None:
    """Lynch and Park, eq. 13.6, with wheels driving clockwise."""
    drive = tr.Omni(robot_radius=0.3, wheel_radius=R, wheel_count=count, first_wheel_angle=first)
    angles = [first + k * math.tau / count for k in range(count)]
    wanted = [(math.sin(a) * twist.vx - math.cos(a) * twist.vy - 0.3 * twist.omega) / R for a in angles]
    assert drive.inverse(twist).speeds == pytest.approx(wanted, rel=1e-12, abs=1e-11)


@given(twist=twists)
def test_swerve_is_the_usual_pseudo_inverse(twist: Twist2D) -> None:
    drive = DRIVES["swerve"]
    matrix = np.array([row for x, y in SQUARE for row in ((1.0, 0.0, -y), (0.0, 1.0, x))])
    generator = np.random.default_rng(0)
    wheel_speeds, steering = generator.normal(size=4), generator.normal(size=4)
    velocities = R * wheel_speeds[:, None] * np.column_stack([np.cos(steering), np.sin(steering)])
    usual = np.linalg.pinv(matrix) @ velocities.ravel()
    assert parts(drive.forward(wheel_speeds.tolist(), steering.tolist())) == pytest.approx(usual, abs=1e-14)


def test_three_tracking_wheels_are_road_runners() -> None:
    """ThreeTrackingWheelLocalizer: rows (cos a, sin a, x sin a - y cos a), solved exactly; inches."""
    places = [(2.6, 7.1, 0.0), (2.6, -7.1, 0.0), (-3.75, -0.15, math.pi / 2)]
    drive = tr.TrackingWheels(places, wheel_radius=1.0)
    rows = np.array([[math.cos(a), math.sin(a), x * math.sin(a) - y * math.cos(a)] for x, y, a in places])
    for readings in np.random.default_rng(1).normal(size=(20, 3)):
        assert parts(drive.forward(readings.tolist())) == pytest.approx(
            np.linalg.solve(rows, readings), abs=1e-14
        )


def test_two_tracking_wheels_need_the_gyro() -> None:
    drive = DRIVES["tracking+gyro"]
    command = drive.inverse(Twist2D(0.4, -0.2, 0.7))
    assert parts(drive.forward(command, yaw_rate=0.7)) == pytest.approx((0.4, -0.2, 0.7), abs=1e-14)
    assert not drive.observable_without_gyro
    with pytest.raises(InputError, match=r"without a yaw rate.*(turning|motion)"):
        drive.forward(command)


def test_a_silent_gyro_leaves_the_wheels() -> None:
    drive = DRIVES["differential+gyro"]
    command = drive.inverse(Twist2D(0.4, 0.0, 0.7))
    assert parts(drive.forward(command)) == pytest.approx((0.4, 0.0, 0.7), abs=1e-14)
    with pytest.raises(InputError, match="no gyro is declared"):
        DRIVES["differential"].forward([1.0, 1.0], yaw_rate=0.1)


def test_a_gyro_row_outweighs_the_wheels() -> None:
    twist = DRIVES["differential+gyro"].forward([1.0, 1.0], yaw_rate=0.5)
    assert 0.45 < twist.omega < 0.5
    assert twist.vx == pytest.approx(R)


@given(vx=speeds, omega=speeds, x=speeds, y=speeds)
def test_the_reference_point_only_moves_what_is_reported(vx: float, omega: float, x: float, y: float) -> None:
    here = tr.Bicycle(wheelbase=BASE, wheel_radius=R)
    there = tr.Bicycle(wheelbase=BASE, wheel_radius=R, reference=(x, y))
    assume(abs(vx) > 1e-3 * (1 + abs(omega)))
    command = here.inverse(Twist2D(vx, 0.0, omega))
    moved = there.inverse(Twist2D(vx, 0.0, omega).at(x, y))
    assert moved.speeds == pytest.approx(command.speeds, rel=1e-9, abs=1e-9)
    assert moved.steering == pytest.approx(command.steering, rel=1e-9, abs=1e-9)


@given(vx=speeds, vy=speeds, omega=st.floats(0.01, 3.0))
def test_the_turning_centre_stands_still(vx: float, vy: float, omega: float) -> None:
    drive = DRIVES["swerve"]
    twist = Twist2D(vx, vy, omega)
    still = twist.at(*drive.icr(twist))
    assert abs(still.vx) + abs(still.vy) < 1e-12 * (1 + size(twist))


def test_the_turning_centre_of_a_straight_line_is_far_to_the_left() -> None:
    drive = DRIVES["differential"]
    assert drive.icr(Twist2D(1.0, 0.0, 0.0)) == (0.0, math.inf)
    assert drive.icr(Twist2D(-1.0, 0.0, 0.0)) == (0.0, -math.inf)
    assert all(map(math.isnan, drive.icr(Twist2D())))


# --- uncertainty -------------------------------------------------------------------------------------


def wheel_row(wheel: Wheel, steering: float) -> list[float]:
    """Coefficients of a wheel's sideways speed."""
    c, s = math.cos(wheel.heading + steering), math.sin(wheel.heading + steering)
    return [-s, c, wheel.x * c + wheel.y * s]


@pytest.mark.parametrize("name", ["differential", "mecanum", "ackermann", "swerve", "bicycle rear"])
def test_twist_covariance_by_monte_carlo(name: str) -> None:
    """Wheels that roll wrong and slip sideways, and the twist that is read from them."""
    drive, generator = DRIVES[name], np.random.default_rng(3)
    twist = drive.project(Twist2D(1.0, 0.3, 0.2))
    command = drive.inverse(twist)
    count, rolling, slip = 20_000, 0.02, 0.05
    radii = np.array([drive.wheel(wheel).radius for wheel in drive.measured_names])
    # The body really slips: its twist leaves the constraints by s, while steered wheels that are
    # not measured still roll the way they point.
    rows = [wheel_row(wheel, 0.0) for wheel in drive.wheels if wheel.kind is tr.WheelKind.FIXED][:1]
    leaning = [name for name in drive.steered_names if name not in drive.measured_names]
    angles = dict(zip(drive.steered_names, command.steering, strict=True))
    rows += [wheel_row(drive.wheel(name), angles[name]) for name in leaning]
    true = np.tile(parts(twist), (count, 1))
    if rows:
        slips = np.zeros((count, len(rows)))
        slips[:, 0] = generator.normal(0.0, slip, count)
        true += slips @ np.linalg.pinv(np.array(rows)).T
    measured = []
    for wheel in (drive.wheel(wheel) for wheel in drive.measured_names):
        x, y = true[:, 0] - true[:, 2] * wheel.y, true[:, 1] + true[:, 2] * wheel.x
        angle = wheel.heading
        if wheel.name in drive.steered_names:
            angle += command.steering[drive.steered_names.index(wheel.name)]
        along = x * math.cos(angle) + y * math.sin(angle)
        if wheel.free_direction is not None:
            along += (y * math.cos(angle) - x * math.sin(angle)) / math.tan(angle - wheel.free_direction)
        measured.append(along)
    readings = (np.array(measured).T + generator.normal(0.0, rolling, (count, len(radii)))) / radii
    steering = np.tile(command.steering, (count, 1)) if command.steering else None
    errors = true - drive.forward_batch(readings, steering)
    predicted = np.array(drive.twist_covariance(rolling, command.steering, lateral_slip=slip))
    scale = np.sqrt(np.outer(np.diag(predicted), np.diag(predicted))) + 1e-12
    np.testing.assert_allclose(np.cov(errors.T) / scale, predicted / scale, atol=0.06)
    if name in ("ackermann", "bicycle rear"):  # where the plain (A^T W A)^-1 would be far off
        without = np.array(drive.twist_covariance(rolling, command.steering))
        assert predicted[2, 2] > 1.5 * without[2, 2]


def test_slip_shows_in_the_residual_where_there_is_redundancy() -> None:
    drive = DRIVES["mecanum"]
    assert drive.redundancy == 1
    command = list(drive.inverse(Twist2D(1.0, 0.0, 0.0)).speeds)
    command[0] *= 1.1
    assert max(map(abs, drive.residual(command))) > 0.02
    assert DRIVES["differential"].redundancy == 0


# --- steering -----------------------------------------------------------------------------------------


@given(twist=twists, now=st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4))
def test_modules_never_turn_by_more_than_a_quarter(twist: Twist2D, now: list[float]) -> None:
    command = DRIVES["swerve"].inverse(twist, now)
    for angle, before in zip(command.steering, now, strict=True):
        assert abs(angle - before) <= math.pi / 2 + 1e-12


def test_standing_wheels_keep_their_angle() -> None:
    drive = DRIVES["swerve"]
    assert drive.inverse(Twist2D(), [0.1, 0.2, 0.3, 0.4]).steering == (0.1, 0.2, 0.3, 0.4)
    # One module stands at the turning centre, and only rounding moves it.
    around = Twist2D(0.2 * 0.1, -0.3 * 0.1, 0.1)
    speeds, steering = drive.inverse_batch(np.array([parts(around)]), np.full((1, 4), 0.7))
    command = drive.inverse(around, [0.7] * 4)
    assert command.speeds[0] == speeds[0, 0] == 0.0
    assert command.steering[0] == steering[0, 0] == 0.7


@given(scale=st.floats(-300.0, -5.0))
def test_nothing_odd_at_a_crawl(scale: float) -> None:
    drive = DRIVES["swerve"]
    fast, slow = drive.inverse(Twist2D(1.0, 0.5, 0.2)), drive.inverse(Twist2D(1.0, 0.5, 0.2) * 10.0**scale)
    assert slow.steering == pytest.approx(fast.steering, abs=1e-12)


def test_reverse_turns_no_wheel_around() -> None:
    command = DRIVES["ackermann"].inverse(Twist2D(-1.0, 0.0, 0.0))
    assert command.steering == pytest.approx((0.0, 0.0), abs=1e-15)
    assert all(speed < 0 for speed in command.speeds)


def test_steering_range_is_respected() -> None:
    car = tr.Ackermann(wheelbase=BASE, track_width=TRACK, wheel_radius=R, max_steering=0.5)
    car.inverse(Twist2D(1.0, 0.0, 0.5))
    with pytest.raises(
        Infeasible, match=r"front_left would have to steer .* its range is -28\.6 to 28\.6 deg"
    ):
        car.inverse(Twist2D(0.2, 0.0, 1.0))
    with pytest.raises(Infeasible, match="its range is"):
        car.inverse_batch(np.array([[0.2, 0.0, 1.0]]))
    crab = tr.Swerve(modules=SQUARE, wheel_radius=R, max_steering=math.radians(120))
    for angle in crab.inverse(Twist2D(-1.0, 0.1, 0.0), [1.9] * 4).steering:
        assert abs(angle) <= math.radians(120)


def test_speeds_are_scaled_together() -> None:
    command = DRIVES["mecanum"].inverse(Twist2D(1.0, 0.5, 0.2))
    slowed = command.desaturated(10.0)
    assert max(map(abs, slowed.speeds)) == pytest.approx(10.0)
    assert np.ptp(np.divide(slowed.speeds, command.speeds)) < 1e-15
    assert slowed.desaturated(10.0 + 1e-9) is slowed


# --- what is refused -------------------------------------------------------------------------------------


def test_an_infeasible_twist_names_the_direction_and_the_way_out() -> None:
    with pytest.raises(Infeasible, match=r"Differential cannot move sideways.*0\.5 m/s.*\(1, 0, 0\.2\)"):
        DRIVES["differential"].inverse(Twist2D(1.0, 0.5, 0.2))
    with pytest.raises(Infeasible, match="twist 1: Differential cannot move sideways"):
        DRIVES["differential"].inverse_batch(np.array([[1.0, 0.0, 0.0], [1.0, 0.5, 0.0]]))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_refused(bad: float) -> None:
    for drive in DRIVES.values():
        with pytest.raises(InputError, match="finite"):
            drive.inverse(Twist2D(bad, 0.0, 0.0))
    with pytest.raises(InputError, match="finite"):
        DRIVES["differential"].forward([bad, 1.0])


@every_drive
def test_wrong_lengths_are_refused(drive: tr.Kinematics) -> None:
    with pytest.raises(ShapeError, match=str(len(drive.measured_names))):
        drive.forward([1.0] * (len(drive.measured_names) + 1))
    with pytest.raises(ShapeError, match="last axis"):
        drive.forward_batch(np.zeros((4, len(drive.measured_names) + 1)))
    with pytest.raises(ShapeError, match="last axis must be 3"):
        drive.inverse_batch(np.zeros((4, 2)))
    if drive.steered_names:
        with pytest.raises(ShapeError, match="steering"):
            drive.inverse(Twist2D(1.0, 0.0, 0.0), [0.0] * 7)


def test_a_bicycle_square_to_its_way_is_unobservable() -> None:
    drive = DRIVES["bicycle rear"]
    with pytest.raises(Unobservable):
        drive.forward([1.0], [math.pi / 2])
    with pytest.raises(Unobservable):
        drive.forward_batch(np.array([[1.0], [1.0]]), np.array([[0.1], [math.pi / 2]]))


def parallel_omni(angle: float) -> list[Wheel]:
    places = [(0.3, 0.0), (-0.15, 0.26), (-0.15, -0.26)]
    return [
        Wheel(str(k), x, y, R, angle, kind="swedish", free_direction=angle + math.pi / 2)
        for k, (x, y) in enumerate(places)
    ]


def cancelling_mecanum() -> list[Wheel]:
    """lx + ly = 0: rollers whose free direction points away from the middle at every wheel."""
    return [
        Wheel(f"{k}", x, y, R, kind="swedish", free_direction=sign * math.pi / 4)
        for k, (x, y, sign) in enumerate([(0.2, 0.2, -1), (0.2, -0.2, 1), (-0.2, 0.2, 1), (-0.2, -0.2, -1)])
    ]


C8 = {
    "coincident modules": lambda: tr.Swerve(modules=[(0.1, 0.1)] * 4, wheel_radius=R),
    "parallel omni axes": lambda: tr.Custom(wheels=parallel_omni(0.3)),
    "lx + ly = 0": lambda: tr.Custom(wheels=cancelling_mecanum()),
    "two wheels for three": lambda: tr.TrackingWheels([(0.0, 0.1, 0.0), (0.0, -0.1, 0.0)], R),
}


@pytest.mark.parametrize(("row", "build"), [pytest.param("C8", build, id="C8") for build in C8.values()])
def test_fault(row: str, build) -> None:
    with pytest.raises(Singular, match=r"condition number .* says nothing about") as caught:
        build()
    assert isinstance(caught.value, ConfigError)
    assert isinstance(caught.value, Unobservable)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: tr.Differential(track_width=-1.0, wheel_radius=R), "track_width: -1, must be > 0"),
        (
            lambda: tr.Differential(track_width=1.0, wheel_radius=math.nan),
            "wheel_radius: nan, must be finite",
        ),
        (lambda: tr.Differential(track_width="1", wheel_radius=R), "track_width: '1', must be a number"),
        (lambda: tr.Differential(track_width=True, wheel_radius=R), "track_width: True, must be a number"),
        (lambda: tr.Differential(track_width=1.0, wheel_radius={"left": R}), "no radius for right"),
        (
            lambda: tr.Differential(track_width=1.0, wheel_radius={"lft": R, "right": R}),
            "did you mean 'left'",
        ),
        (lambda: tr.Differential(track_width=1.0, wheel_radius=R, measured="lefd"), "did you mean 'left'"),
        (lambda: tr.Omni(robot_radius=1.0, wheel_radius=R, wheel_count=2), "wheel_count: 2, must be"),
        (lambda: tr.Custom(wheels=[]), "none given"),
        (lambda: tr.Custom(wheels=[Wheel("a", 0, 0, R), Wheel("a", 1, 0, R)]), "two wheels are called 'a'"),
        (lambda: Wheel("a", 0, 0, R, kind="omni"), "kind: 'omni'"),
        (lambda: Wheel("a", 0, 0, R, kind="swedish"), "free_direction: must be given"),
        (lambda: Wheel("a", 0, 0, R, kind="swedish", free_direction=0.0), "transmit no motion"),
        (lambda: Wheel("a", 0, 0, R, kind="steered", steering_range=(1.0, -1.0)), "min must be < max"),
        (lambda: Wheel("a", 0, 0, R, steering_range=(-1.0, 1.0)), "given for a fixed wheel"),
        (
            lambda: tr.Swerve(modules=[(0.1,), (0.2, 0.1)], wheel_radius=R),
            "modules.module_1: .*must be 2 numbers",
        ),
    ],
)
def test_descriptions_that_cannot_be_are_refused(build, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        build()


def test_casters_say_nothing() -> None:
    rover = DRIVES["rover"]
    assert "tail" not in rover.wheel_names
    assert rover.wheel("tail").kind is tr.WheelKind.CASTER
    with pytest.raises(InputError, match="did you mean 'tail'"):
        rover.wheel("tial")
