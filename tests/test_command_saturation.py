"""Saturation: what is achieved is within every limit, keeps what its policy names, and says why."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle import ConfigError, InputError, Limits, Pose2D, Robot, Twist2D
from trundle.command import Envelope, Reason, Saturation, discretize, saturate

TWISTS = st.builds(Twist2D, st.floats(-5, 5), st.floats(-5, 5), st.floats(-10, 10))
LIMITS = Limits(max_speed=1.0, max_lateral_speed=0.6, max_yaw_rate=2.0, max_wheel_speed=15.0)
DIFFERENTIAL = Robot(drive=tr.Differential(track_width=0.4, wheel_radius=0.1), limits=LIMITS)
MECANUM = Robot(drive=tr.Mecanum(track_width=0.4, wheelbase=0.5, wheel_radius=0.05), limits=LIMITS)
SWERVE = Robot(
    drive=tr.Swerve(modules=[(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)], wheel_radius=0.05),
    limits=LIMITS,
)
CAR = Robot(
    drive=tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05, max_steering=0.5), limits=LIMITS
)
FORKLIFT = Robot(
    drive=tr.Tricycle(wheelbase=1.2, wheel_radius=0.1, reference=(0.6, 0.0)),
    limits=Limits(max_speed=1.5, max_steering=1.0, max_wheel_speed=12.0),
)
CRAB = Robot(
    drive=tr.FourWheelSteering(wheelbase=1.0, track_width=0.6, wheel_radius=0.1, max_steering=0.6),
    limits=LIMITS,
)
ROBOTS = {
    "differential": DIFFERENTIAL,
    "mecanum": MECANUM,
    "swerve": SWERVE,
    "ackermann": CAR,
    "tricycle": FORKLIFT,
    "four_wheel_steering": CRAB,
}


def components(twist):
    return twist.vx, twist.vy, twist.omega


@pytest.mark.parametrize("policy", Saturation)
@pytest.mark.parametrize("name", ROBOTS)
@given(twist=TWISTS)
def test_achieved_is_within_every_limit_and_grows_nothing(name, policy, twist):
    robot = ROBOTS[name]
    envelope = Envelope(robot)
    achieved = saturate(twist, envelope, policy)
    got, limits = achieved.twist, robot.limits
    assert abs(got.vx) <= limits.max_speed
    assert abs(got.omega) <= (limits.max_yaw_rate or math.inf)
    assert abs(got.vx) <= abs(twist.vx) + 1e-12
    assert abs(got.omega) <= abs(twist.omega) + 1e-12
    wheels = robot.drive.inverse(got)  # raises if it had to slip or steer too far
    assert max(map(abs, wheels.speeds)) <= limits.max_wheel_speed * (1 + 1e-12)
    reach = limits.max_steering or 10.0
    assert all(abs(math.remainder(angle, math.pi)) <= reach + 1e-9 for angle in wheels.steering)
    wanted = robot.drive.project(twist)
    if not achieved.reasons:
        assert components(got) == pytest.approx(components(wanted), abs=1e-12)


@pytest.mark.parametrize("policy", [Saturation.SCALE_ALL, Saturation.KEEP_CURVATURE])
@pytest.mark.parametrize("robot", [DIFFERENTIAL, MECANUM, SWERVE], ids=["differential", "mecanum", "swerve"])
@given(twist=TWISTS)
def test_scaling_keeps_direction_and_curvature(robot, policy, twist):
    wanted = robot.drive.project(twist)
    got = saturate(twist, Envelope(robot), policy).twist
    size = max(map(abs, components(wanted))) or 1.0
    factor = max(map(abs, components(got))) / size
    assert components(got) == pytest.approx(components(wanted * factor), abs=1e-12)
    speed = math.hypot(got.vx, got.vy)
    if speed > 1e-3:
        curvature = wanted.omega / math.hypot(wanted.vx, wanted.vy)
        assert got.omega / speed == pytest.approx(curvature, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("row", [pytest.param("K5", id="K5")])
@given(speed=st.floats(1.001, 50.0), omega=st.floats(-50.0, 50.0))
def test_fault(row, speed, omega):
    """The whole twist is scaled: curvature error 1e-9 at most, and the robot stays on its circle."""
    got = saturate(Twist2D(speed, 0.0, omega), Envelope(DIFFERENTIAL)).twist
    assert abs(got.omega / got.vx - omega / speed) <= 1e-9 * max(1.0, abs(omega / speed))
    if abs(omega) > 1e-3:
        radius = speed / omega
        for quarter in (0.25, 0.5, 0.75, 1.0):
            pose = Pose2D.exp(got * (quarter * math.tau / abs(got.omega)))
            assert math.hypot(pose.x, pose.y - radius) == pytest.approx(abs(radius), rel=1e-9)


def test_clamping_each_axis_would_leave_the_circle():
    """The alternative that K5 forbids, so that the figure in FAULTS.md stands beside ours."""
    clamped = Twist2D(0.5, 0.0, 1.0)  # of (1, 0, 1) where max_speed is 0.5
    far = max(
        abs(math.hypot(pose.x, pose.y - 1.0) - 1.0)
        for pose in (Pose2D.exp(clamped * (0.01 * k)) for k in range(629))
    )
    assert far == pytest.approx(1.0, abs=0.01)


@given(twist=TWISTS)
def test_yaw_first_gives_up_translation_only(twist):
    got = saturate(twist, Envelope(SWERVE), Saturation.YAW_FIRST).twist
    spot = saturate(Twist2D(0.0, 0.0, twist.omega), Envelope(SWERVE)).twist
    assert got.omega == pytest.approx(spot.omega, abs=1e-12)
    assert got.vx * twist.vy == pytest.approx(got.vy * twist.vx, abs=1e-9)


@given(twist=TWISTS)
def test_translation_first_gives_up_yaw_only(twist):
    got = saturate(twist, Envelope(SWERVE), Saturation.TRANSLATION_FIRST).twist
    straight = saturate(Twist2D(twist.vx, twist.vy, 0.0), Envelope(SWERVE)).twist
    assert (got.vx, got.vy) == pytest.approx((straight.vx, straight.vy), abs=1e-12)


@given(twist=TWISTS)
def test_nothing_more_would_fit(twist):
    """What gives way first gives way no further than it must."""
    for policy in Saturation:
        achieved = saturate(twist, Envelope(MECANUM), policy)
        if achieved.reasons:
            assert Envelope(MECANUM).load(achieved.twist) == pytest.approx(1.0, abs=1e-9)


def test_differential_keeps_what_the_policy_names():
    robot = Robot(drive=DIFFERENTIAL.drive, limits=Limits(max_wheel_speed=10.0))  # 1 m/s per side
    wanted = Twist2D(1.0, 0.0, 2.0)
    scaled = saturate(wanted, Envelope(robot)).twist
    assert components(scaled) == pytest.approx((1 / 1.4, 0.0, 2 / 1.4))
    yaw = saturate(wanted, Envelope(robot), Saturation.YAW_FIRST).twist
    assert components(yaw) == pytest.approx((0.6, 0.0, 2.0))
    translation = saturate(wanted, Envelope(robot), Saturation.TRANSLATION_FIRST).twist
    assert components(translation) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


def test_car_turns_no_tighter_than_its_steering():
    drive = tr.Bicycle(wheelbase=0.3, wheel_radius=0.05)
    envelope = Envelope(Robot(drive=drive, limits=Limits(max_steering=0.4)))
    tightest = math.tan(0.4) / 0.3
    for speed in (1.0, -1.0, 1e-6, -1e-6):
        achieved = saturate(Twist2D(speed, 0.0, 100.0), envelope)
        assert achieved.twist.vx == speed
        assert achieved.twist.omega == pytest.approx(abs(speed) * tightest, rel=1e-9)
        assert achieved.reasons == (Reason.STEERING,)
        kept = saturate(Twist2D(speed, 0.0, 100.0), envelope, Saturation.KEEP_CURVATURE)
        assert kept.twist == Twist2D()
        assert kept.reasons == (Reason.STEERING,)
    spot = saturate(Twist2D(0.0, 0.0, 1.0), envelope)
    assert spot.twist == Twist2D()
    assert spot.reasons == (Reason.TURN_ON_THE_SPOT,)


def test_cars_inner_wheel_decides():
    achieved = saturate(Twist2D(0.3, 0.0, 10.0), Envelope(CAR))
    # The inner front wheel is at its stop: R = half the track + wheelbase * cot(stop).
    assert 0.3 / achieved.twist.omega == pytest.approx(0.1 + 0.3 / math.tan(0.5), rel=1e-9)


def test_car_with_yaw_first_tightens_before_it_slows_further():
    wanted = Twist2D(3.0, 0.0, 1.5)
    achieved = saturate(wanted, Envelope(CAR), Saturation.YAW_FIRST)
    assert achieved.twist.vx < 1.0
    assert achieved.twist.omega / achieved.twist.vx > 0.5 * 1.01
    assert achieved.twist.omega > saturate(wanted, Envelope(CAR)).twist.omega


def test_reasons_name_every_limit():
    fast = saturate(Twist2D(3.0, 0.4, 9.0), Envelope(DIFFERENTIAL))
    assert fast.reasons == (Reason.SIDEWAYS, Reason.SPEED, Reason.YAW_RATE, Reason.WHEEL_SPEED)
    assert saturate(Twist2D(0.3, 0.0, 0.1), Envelope(DIFFERENTIAL)).reasons == ()


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_refused(bad):
    with pytest.raises(InputError, match="finite"):
        saturate(Twist2D(0.0, 0.0, bad), Envelope(DIFFERENTIAL))


@pytest.mark.parametrize("policy", Saturation)
@given(twist=TWISTS, period=st.floats(0.005, 0.2))
def test_composes_with_discretization(policy, twist, period):
    """Desaturated or not, held for the period it lands on the achieved displacement."""
    envelope = Envelope(MECANUM, period=period)
    achieved = saturate(twist, envelope, policy).twist
    held = discretize(achieved, period)
    wheels = MECANUM.drive.inverse(held)
    assert max(map(abs, wheels.speeds)) <= LIMITS.max_wheel_speed * (1 + 1e-12)
    end = Pose2D.exp(MECANUM.drive.forward(wheels) * period)
    meant = (achieved.vx * period, achieved.vy * period, achieved.omega * period)
    assert (end.x, end.y, end.theta) == pytest.approx(meant, abs=1e-12)
    if policy is Saturation.SCALE_ALL:
        assert end.x * twist.vy == pytest.approx(end.y * twist.vx, abs=1e-9)


def test_scaling_a_discretized_twist_would_miss():
    """What wpimath warns of and we do not do: desaturating after discretizing turns the direction."""
    wanted, period = Twist2D(3.0, 0.0, 9.0), 0.1
    held = discretize(wanted, period)
    late = Pose2D.exp(held * (period / 4))  # desaturated to a quarter afterwards
    ours = saturate(wanted, Envelope(MECANUM, period=period)).twist
    end = Pose2D.exp(discretize(ours, period) * period)
    assert abs(math.atan2(late.y, late.x)) > 0.2
    assert abs(math.atan2(end.y, end.x)) < 1e-12


def test_discretization_is_for_holonomic_drives():
    with pytest.raises(ConfigError, match="holonomic"):
        Envelope(DIFFERENTIAL, period=0.02)


@given(twist=TWISTS)
def test_desaturation_is_wpilibs(twist):
    kinematics = pytest.importorskip("wpimath.kinematics")
    wheels = MECANUM.drive.inverse(twist)
    theirs = kinematics.MecanumDriveWheelSpeeds(*(0.05 * speed for speed in wheels.speeds))
    theirs.desaturate(0.05 * LIMITS.max_wheel_speed)
    # wpimath knows no limits on the body's speed
    envelope = Envelope(Robot(drive=MECANUM.drive, limits=Limits(max_wheel_speed=LIMITS.max_wheel_speed)))
    ours = MECANUM.drive.inverse(saturate(twist, envelope).twist).speeds
    expected = (theirs.frontLeft, theirs.frontRight, theirs.rearLeft, theirs.rearRight)
    assert [0.05 * speed for speed in ours] == pytest.approx(expected, abs=1e-12)
