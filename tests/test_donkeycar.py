"""donkeycar's parts, where donkeycar is not installed: what they compute, and what donkeycar gets wrong.

D1 to D13 are the rows of CLASSICS.md, section 1. tests/donkeycar holds the parts beside the originals.
"""

from __future__ import annotations

import math
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle.donkeycar as parts
from trundle import robot
from trundle.errors import ConfigError, InputError
from trundle.geometry import Pose2D, Twist2D

STEERING = math.radians(22.5)
WHEEL_BASE = 0.5


def test_the_example_says_where_donkeycar_is(tmp_path):
    """In an environment without it, however this one is."""
    example = Path(__file__).resolve().parents[1] / "examples" / "donkeycar" / "follow_path.py"
    program = "import runpy, sys; sys.modules['donkeycar'] = None; runpy.run_path(sys.argv[1])"
    ended = subprocess.run(
        [sys.executable, "-c", program, example], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (1, "")
    assert "make .envs/donkeycar/ready && .envs/donkeycar/bin/python" in ended.stderr
    assert "Traceback" not in ended.stderr


def drive(part, readings, period=0.05, start=100.0):
    """The last result, of readings in equal steps of time."""
    for count, reading in enumerate(readings):
        result = part.run(*reading, start + count * period)
    return result


# --- forward ---------------------------------------------------------------------------------------


def test_unicycle_on_an_arc_of_a_circle():
    """A quarter turn in one step: where the midpoint rule is off by a tenth of the way."""
    left, right = 0.9 * math.pi / 2, 1.1 * math.pi / 2  # radius 1, axle 0.2
    distance, velocity, x, y, angle, vx, vy, omega, timestamp = drive(
        parts.Unicycle(0.2), [(3.0, 5.0), (3.0 + left, 5.0 + right)], period=2.0
    )
    assert (x, y, angle) == pytest.approx((1.0, 1.0, math.pi / 2), abs=1e-12)
    assert (distance, velocity, omega) == pytest.approx((4.0 + math.pi / 2, math.pi / 4, math.pi / 4))
    assert (vx, vy, timestamp) == pytest.approx((0.5, 0.5, 102.0))


def test_d1_pose_is_that_of_a_point_of_the_car():
    """Where the front wheel really is after a quarter turn at 22.5 degrees, in however many steps."""
    turn = WHEEL_BASE / math.sin(STEERING) * math.pi / 2
    for steps in (1, 7, 100):
        readings = [(turn * k / steps, STEERING) for k in range(steps + 1)]
        _, _, x, y, angle, *_ = drive(parts.Bicycle(WHEEL_BASE), readings)
        assert (x, y, angle) == pytest.approx((0.7071067811865, 1.7071067811865, math.pi / 2), abs=1e-9)
        _, _, x, y, *_ = drive(parts.Bicycle(WHEEL_BASE, parity=True), readings)
    assert (x, y) == pytest.approx((1.3066, 1.3066), abs=2e-4)  # no point of any car: 0.72 m beside


def test_d3_reference_is_said_and_both_tell_of_the_same_car():
    front, rear = parts.Bicycle(WHEEL_BASE), parts.Bicycle(WHEEL_BASE, reference="rear")
    rolled = [0.02 * k for k in range(50)]
    *_, x, y, angle, _, _, yaw_rate, _ = drive(front, [(way, STEERING) for way in rolled])
    rears = [(way * math.cos(STEERING), STEERING) for way in rolled]
    *_, rear_x, rear_y, rear_angle, _, _, rear_yaw_rate, _ = drive(rear, rears)
    assert (angle, yaw_rate) == pytest.approx((rear_angle, rear_yaw_rate), rel=1e-12)
    body = Pose2D(-WHEEL_BASE, 0.0, 0.0) @ Pose2D(rear_x, rear_y, rear_angle) @ Pose2D(WHEEL_BASE, 0.0)
    assert (x, y) == pytest.approx((body.x, body.y), abs=1e-12)
    with pytest.raises(ConfigError, match="reference"):
        parts.Bicycle(WHEEL_BASE, reference="middle")


@pytest.mark.parametrize("reference", ["front", "rear"])
@given(speed=st.floats(-3, 3), steering=st.floats(-1.5, 1.5), wheel_base=st.floats(0.05, 5))
def test_d3_yaw_rate_is_that_of_the_drive(reference, speed, steering, wheel_base):
    bicycle = robot.Bicycle(wheelbase=wheel_base, wheel_radius=1.0, measured=reference)
    omega = bicycle.forward((speed,), (steering,)).omega
    ours = parts.bicycle_angular_velocity(wheel_base, speed, steering, reference=reference)
    assert ours == pytest.approx(omega, rel=1e-9, abs=1e-12)
    if abs(speed) > 1e-3:
        back = parts.bicycle_steering_angle(wheel_base, speed, ours, reference=reference)
        assert math.sin(back) == pytest.approx(math.sin(steering), abs=1e-9)


@pytest.mark.parametrize("kind", [parts.Unicycle, parts.Bicycle])
def test_d4_a_clock_may_start_at_zero(kind):
    part = kind(0.3)
    for count in range(5):
        distance, _, x, *_, timestamp = part.run(
            0.1 * count, 0.1 * count if kind is parts.Unicycle else 0.0, count
        )
    assert (distance, x, timestamp) == pytest.approx((0.4, 0.4, 4.0))


@pytest.mark.parametrize(
    ("stamps", "x"),
    [
        pytest.param([1.0, 1.0, 2.0], 0.2, id="same time: bridged"),
        pytest.param([1.0, 0.5, 2.0], 0.2, id="out of order: bridged"),
        pytest.param([1.0, 1.0 + 1e-9, 2.0], 0.2, id="sooner than clocks can tell: bridged"),
        pytest.param([1.0e9, 5.0, 6.0], 0.1, id="new clock: begins anew where it is"),
        pytest.param([1.0, math.nan, 2.0], 0.2, id="no time: bridged"),
    ],
)
def test_d4_time_that_does_not_increase(stamps, x):
    part = parts.Unicycle(0.3)
    results = [part.run(0.1 * k, 0.1 * k, stamp) for k, stamp in enumerate(stamps)]
    assert results[-1][2] == pytest.approx(x)
    assert results[1][1] == 0.0
    assert all(math.isfinite(value) for result in results for value in result)


def test_d5_first_reading_is_where_counting_begins():
    first = parts.Bicycle(WHEEL_BASE).run(100.0, 0.1, 1.0)
    assert first == (100.0, 0, 0, 0, 0, 0, 0, 0, 1.0)
    assert drive(parts.Bicycle(WHEEL_BASE), [(100.0, 0.0), (100.5, 0.0)])[2] == pytest.approx(0.5)


BAD = [math.nan, math.inf, -math.inf, None, "far", True, 10**400]


@pytest.mark.parametrize("bad", BAD, ids=repr)
@pytest.mark.parametrize("parity", [False, True])
@pytest.mark.parametrize("kind", [parts.Unicycle, parts.Bicycle])
def test_what_is_no_reading_changes_nothing(kind, parity, bad):
    """One NaN does not stay for ever, and a channel that is still empty does not stop the car."""
    part, spared = kind(0.3, parity=parity), kind(0.3, parity=parity)
    part.run(bad, 0.0, 99.0)
    for count in range(4):
        good = (0.1 * count, 0.05 * count)
        expected = spared.run(*good, 100.0 + count)
        assert part.run(*good, 100.0 + count) == expected
        for worse in ((bad, good[1]), (good[0], bad)):
            assert part.run(*worse, 100.5 + count) == expected


def test_what_a_float_cannot_hold_changes_nothing():
    for part in (parts.Unicycle(0.3), parts.Unicycle(0.3, parity=True), parts.Bicycle(0.3)):
        part.run(-1e308, 0.0, 1.0)
        assert part.run(1e308, 0.0, 2.0)[2:5] == (0.0, 0.0, 0.0)
    rear = parts.Bicycle(0.3, reference="rear")
    rear.run(0.0, math.pi / 2, 1.0)
    assert rear.run(0.1, math.pi / 2, 2.0)[2:5] == (0.0, 0.0, 0.0)  # square to the rear wheel


def test_d9_numpy_scalars_are_numbers():
    unnormalize = parts.UnnormalizeSteeringAngle(0.5)
    for number in (np.float64(0.5), np.float32(0.5), np.int64(1)):
        assert unnormalize.run(number) == -0.5 * float(number)
    assert parts.differential_steering(np.float32(1.0), np.float64(-0.25)) == (0.75, 1.0)
    part = parts.Unicycle(0.2)
    part.run(np.float32(0.0), np.int32(0), np.float64(1.0))
    assert part.run(np.float32(1.0), np.int32(1), np.float64(2.0))[2] == 1.0


def test_parts_in_a_thread():
    """`run_threaded` hands over, `update` computes; nothing moves twice, and `shutdown` ends it."""
    part = parts.Unicycle(0.2)
    part.poll_delay_secs = 0.0
    thread = threading.Thread(target=part.update)
    thread.start()
    result = ()
    for count in range(4):
        deadline = time.monotonic() + 10.0
        while part.run_threaded(0.1 * count, 0.1 * count, 1.0 + count)[-1] != 1.0 + count:
            assert time.monotonic() < deadline
        result = part.run_threaded(0.1 * count, 0.1 * count, 1.0 + count)
    part.shutdown()
    thread.join(timeout=10.0)
    assert not thread.is_alive()
    assert result[:5] == pytest.approx((0.3, 0.1, 0.3, 0.0, 0.0))
    assert part.run(9.0, 9.0, 9.0) == (0, 0, 0, 0, 0, 0, 0, 0, 4.0)
    assert part.run_threaded(9.0, 9.0, 9.0)[:3] == (0, 0, 0)


def test_time_is_now_where_none_is_given():
    before = time.time()
    assert before <= parts.Unicycle(0.2).run(0.0, 0.0)[-1] <= time.time()
    assert before <= parts.InverseUnicycle(0.2, 0.03, 0.0, 1.0).run(0.0, 0.0)[-1] <= time.time()
    assert before <= parts.InverseBicycle(0.2).run(0.0, 0.0)[-1] <= time.time()


def test_debug_logs_every_result(caplog):
    part = parts.Unicycle(0.2, debug=True)
    with caplog.at_level("INFO"):
        part.run(1.0, 1.0, 5.0)
    assert "5.0" in caplog.text


# --- inverse ---------------------------------------------------------------------------------------


@given(speed=st.floats(-5, 5), omega=st.floats(-30, 30))
def test_d6_limits_keep_the_curvature(speed, omega):
    inverse = parts.InverseUnicycle(0.15, 0.03, 0.1, 3.0)
    left, right, _ = inverse.run(speed, omega, 1.0)
    wanted = (speed - omega * 0.075, speed + omega * 0.075)
    fastest = max(map(abs, wanted))
    factor = 0.0 if fastest <= 0.1 else min(1.0, 3.0 / fastest)
    assert (left, right) == pytest.approx([factor * one for one in wanted], rel=1e-12, abs=1e-12)
    assert inverse.clipped is ((left, right) != pytest.approx(wanted, rel=1e-15, abs=0.0))


def test_d6_small_yaw_rates_are_kept():
    """donkeycar's `steering_zero`, taken at its word, would hide 0.2 rad/s here."""
    left, right, _ = parts.InverseUnicycle(0.15, 0.0315, 0.1, 3.0).run(1.0, 0.05, 1.0)
    assert right - left == pytest.approx(0.05 * 0.15)


@pytest.mark.parametrize(
    ("speed", "omega", "angle", "clipped"),
    [
        (1.0, 0.5, math.asin(0.25), False),
        (-1.0, 0.5, -math.asin(0.25), False),
        (1.0, 2.0, math.pi / 2, False),
        (1.0, 2.1, math.pi / 2, True),
        (-1.0, 1e300, -math.pi / 2, True),
        (0.0, 0.0, 0.1, False),
        (0.0, 1.0, 0.1, True),
        (0.0, -1.0, 0.1, True),
        (math.nan, 1.0, 0.1, True),
        (1.0, None, 0.1, True),
    ],
)
def test_d2_no_turn_is_too_tight(speed, omega, angle, clipped):
    inverse = parts.InverseBicycle(WHEEL_BASE)
    inverse.run(1.0, math.sin(0.1) / WHEEL_BASE, 0.0)
    through, steering, timestamp = inverse.run(speed, omega, 1.0)
    assert steering == pytest.approx(angle)
    assert through == (speed if omega is not None and not math.isnan(speed) else 0.0)
    assert (timestamp, inverse.clipped) == (1.0, clipped)


def test_d2_steering_has_its_greatest_angle():
    inverse = parts.InverseBicycle(WHEEL_BASE, max_steering_angle=0.4, reference="rear")
    assert inverse.run(1.0, 5.0, 1.0)[1] == 0.4
    assert inverse.clipped
    assert inverse.run(1.0, 0.2, 1.0)[1] == pytest.approx(math.atan(0.1))
    assert not inverse.clipped


def test_d2_formula_alone():
    assert parts.bicycle_steering_angle(0.3, 0.0, 0.0) == 0.0
    assert parts.bicycle_steering_angle(0.3, 0.0, -1.0) == -math.pi / 2
    assert parts.bicycle_steering_angle(0.3, 1e-300, 1.0) == math.pi / 2
    assert parts.bicycle_steering_angle(0.3, 1.0, 1.0, reference="rear") == pytest.approx(math.atan(0.3))


def test_yaw_rates_of_two_wheels():
    assert parts.wheel_rotational_velocity(0.0315, 2.0) == 2.0 / 0.0315
    omega = (
        robot.Differential(track_width=0.15, wheel_radius=0.0315).forward((1.0 / 0.0315, 1.2 / 0.0315)).omega
    )
    assert parts.unicycle_angular_velocity(0.0315, 0.15, 1.0, 1.2) == pytest.approx(omega)
    # D13: one wheel still; its comment upstream has the radius in it.
    assert parts.unicycle_max_angular_velocity(0.0315, 0.15, 3.0) == pytest.approx(3.0 / 0.15)


# --- from -1 to 1 and back ---------------------------------------------------------------------------


def test_d7_everything_is_clipped_alike_and_says_so(caplog):
    for part, most in (
        (parts.NormalizeSteeringAngle(math.pi / 4), -1.0),
        (parts.UnnormalizeSteeringAngle(math.pi / 4), -math.pi / 4),
        (parts.BicycleNormalizeAngularVelocity(0.3, 3.0, math.pi / 4), 1.0),
        (parts.BicycleUnnormalizeAngularVelocity(0.3, 3.0, math.pi / 4), 10.0 * math.sin(math.pi / 4)),
        (parts.UnicycleNormalizeAngularVelocity(0.03, 0.15, 3.0), 1.0),
        (parts.UnicycleUnnormalizeAngularVelocity(0.03, 0.15, 3.0), 20.0),
    ):
        caplog.clear()
        for sign in (1.0, -1.0):
            assert part.run(sign * 100.0) == pytest.approx(sign * most)
            assert part.clipped
        assert len(caplog.records) == 1  # where it begins, not at every turn of the loop
        part.run(0.5)
        assert not part.clipped
        for bad in BAD:
            assert part.run(bad) == 0.0
            assert part.clipped
        part.shutdown()


@pytest.mark.parametrize(
    "make",
    [
        lambda: parts.NormalizeSteeringAngle(0.0),
        lambda: parts.UnnormalizeSteeringAngle(0.0),
        lambda: parts.BicycleNormalizeAngularVelocity(0.3, 0.0, 0.5),
        lambda: parts.UnicycleUnnormalizeAngularVelocity(0.03, 0.15, 0.0),
        lambda: parts.UnicycleNormalizeAngularVelocity(0.0, 0.15, 1.0),
        lambda: parts.InverseUnicycle(0.15, 0.03, 0.1, 0.0),
        lambda: parts.Unicycle(0.0),
        lambda: parts.Bicycle(math.nan),
        lambda: parts.InverseBicycle(0.0),
        lambda: parts.TwoWheelSteeringThrottle(1.5),
        lambda: parts.TwoWheelSteeringThrottle("0"),
    ],
)
def test_d7_greatest_of_zero_is_refused_where_it_is_given(make):
    with pytest.raises(ConfigError):
        make()


@given(angle=st.floats(-0.7, 0.7), zero=st.floats(0.0, 0.1))
def test_steering_there_and_back(angle, zero):
    there = parts.NormalizeSteeringAngle(0.7, zero).run(angle)
    back = parts.UnnormalizeSteeringAngle(0.7, zero).run(there)
    assert there * angle <= 0.0  # left is negative there
    if there:
        assert back == pytest.approx(angle, rel=1e-12)
    else:
        assert abs(angle) <= 0.7 * zero
        assert back == 0.0


def test_d8_steering_goes_through_its_own_part():
    """donkeycar's page feeds `user/angle` to `Bicycle`: wrong in unit and sign. The way that is right."""
    to_angle, bicycle = parts.UnnormalizeSteeringAngle(math.pi / 6), parts.Bicycle(0.3)
    for count in range(20):
        angle = bicycle.run(0.02 * count, to_angle.run(0.5), 1.0 + 0.05 * count)[4]
    assert angle == pytest.approx(-0.38 * math.sin(math.pi / 12) / 0.3)  # 0.5 is to the right


def test_d13_dead_band_does_not_jump():
    assert parts.differential_steering(1.0, 0.1, 0.1) == (1.0, 1.0)
    assert parts.differential_steering(1.0, 0.1 + 1e-9, 0.1) == pytest.approx((1.0, 1.0), abs=1e-8)
    assert parts.differential_steering(1.0, 1.0, 0.1) == (1.0, 0.0)
    assert parts.differential_steering(1.0, 0.1 + 1e-9, 0.1, parity=True) == pytest.approx((1.0, 0.9))


def test_two_wheels_from_two_sticks():
    part = parts.TwoWheelSteeringThrottle()
    assert part.run(0.5, 0.0) == (0.5, 0.5)
    assert part.run(-0.5, -1.0) == (0.0, -0.5)
    assert not part.clipped
    assert part.run(7.0, 2.0) == (1.0, 0.0)
    assert part.clipped
    assert part.run(None, 0.0) == (0.0, 0.0)


def test_angles():
    assert parts.limit_angle(3.0 + math.tau) == pytest.approx(3.0)
    assert parts.limit_angle(-5 * math.pi) == pytest.approx(-math.pi)
    with pytest.raises(InputError):
        parts.limit_angle(math.inf)


def test_front_wheel_pose_is_the_arc_of_the_front_wheel():
    start = parts.Pose2D(1.0, 2.0, 0.3)
    way = Twist2D(0.4 * math.cos(0.5), 0.4 * math.sin(0.5), 0.4 * math.sin(0.5) / 0.3)
    expected = Pose2D(1.0, 2.0, 0.3) @ Pose2D.exp(way)
    x, y, angle = parts.update_bicycle_front_wheel_pose(start, 0.3, 0.5, 0.4)
    assert (x, y, angle) == pytest.approx((expected.x, expected.y, expected.theta))
    assert parts.update_bicycle_front_wheel_pose(start, 0.3, 0.5, 0.0) == (1.0, 2.0, 0.3)
