"""Our parts and donkeycar's own, in one process, on the same inputs.

With `parity=True` they are equal for every finite input; without it they differ where donkeycar is wrong.
"""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import trundle.donkeycar as ours

with pytest.MonkeyPatch.context() as patch:
    patch.setattr("builtins.print", lambda *_, **__: None)  # donkeycar greets whoever imports it
    theirs = pytest.importorskip("donkeycar.parts.kinematics", reason="donkeycar lives in .envs/donkeycar")
    from donkeycar.parts.path import CTE
    from donkeycar.parts.transform import PIDController

anything = st.floats(allow_nan=False, allow_infinity=False) | st.floats(-10.0, 10.0)
length = st.floats(0.01, 10.0)
stamps = st.lists(st.floats(-1e9, 2e9) | st.just(0.0), min_size=2, max_size=12, unique=True).map(sorted)


def what(call, *arguments):
    """The result of a call, or None where donkeycar cannot give one."""
    try:
        result = call(*arguments)
    except (ValueError, ZeroDivisionError, OverflowError):
        return None
    return result if isinstance(result, tuple) else (result,)


def assert_equal(one, other, tolerance=1e-12):
    assert len(one) == len(other)
    for a, b in zip(one, other, strict=True):
        assert a == b or abs(a - b) <= tolerance * max(1.0, abs(b))


def readings(draw, count):
    return [(draw(anything), draw(anything)) for _ in range(count)]


# --- parity ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Unicycle", "Bicycle"])
@given(data=st.data(), size=length, times=stamps)
def test_odometry_with_parity(name, data, size, times):
    """All nine results of all steps, also with clocks that start below, at or pass through zero."""
    mine, original = getattr(ours, name)(size, parity=True), getattr(theirs, name)(size)
    for timestamp, reading in zip(times, readings(data.draw, len(times)), strict=True):
        expected = what(original.run, *reading, timestamp)
        if expected is None or not all(map(math.isfinite, expected)):
            break  # a float has overflown in donkeycar
        assert_equal(mine.run(*reading, timestamp), expected)
    mine.shutdown()
    original.shutdown()
    assert mine.run(1.0, 1.0, 1.0)[:8] == original.run(1.0, 1.0, 1.0)[:8]


@given(size=length, speed=anything, omega=anything, now=anything)
def test_inverse_unicycle_with_parity(size, speed, omega, now):
    expected = theirs.InverseUnicycle(size, 0.03, 0.1, 3.0).run(speed, omega, now)
    assert_equal(ours.InverseUnicycle(size, 0.03, 0.1, 3.0, parity=True).run(speed, omega, now), expected)


@given(size=length, speed=anything, omega=anything, now=anything)
def test_inverse_bicycle_wherever_donkeycar_answers(size, speed, omega, now):
    expected = what(theirs.InverseBicycle(size).run, speed, omega, now)
    mine = ours.InverseBicycle(size)
    result = mine.run(speed, omega, now)
    if expected is None:  # asin beyond its domain, or a division by zero
        assert mine.clipped or speed == omega == 0.0
        assert abs(result[1]) <= math.pi / 2
    else:
        assert_equal(result, expected)


@given(steps=st.lists(st.tuples(anything, anything, anything, anything, anything), min_size=1), size=length)
def test_front_wheel_pose_with_parity(steps, size):
    for x, y, angle, steering, distance in steps:
        pose, original = ours.Pose2D(x, y, angle), theirs.Pose2D(x, y, angle)
        expected = what(theirs.update_bicycle_front_wheel_pose, original, size, steering, distance)
        if expected is None:
            continue
        result = ours.update_bicycle_front_wheel_pose(pose, size, steering, distance, parity=True)
        if distance == 0.0:
            assert result is pose
        else:
            assert_equal(result, expected)


FORMULAS = {
    "limit_angle": (anything,),
    "wheel_rotational_velocity": (length, anything),
    "unicycle_angular_velocity": (length, length, st.floats(-1e100, 1e100), st.floats(-1e100, 1e100)),
    "unicycle_max_angular_velocity": (length, length, anything),
    "bicycle_angular_velocity": (length, anything, anything),
    "bicycle_steering_angle": (length, anything, anything),
    "differential_steering": (anything, anything),
}


@pytest.mark.parametrize("name", FORMULAS)
@given(data=st.data())
def test_formulas(name, data):
    arguments = [data.draw(one) for one in FORMULAS[name]]
    expected = what(getattr(theirs, name), *arguments)
    assume(expected is not None and all(map(math.isfinite, expected)))
    assert_equal(what(getattr(ours, name), *arguments), expected)


PARTS = {
    "NormalizeSteeringAngle": ((length, st.floats(0.0, 1.0)), {"parity": True}),
    "UnnormalizeSteeringAngle": ((length, st.floats(0.0, 1.0)), {}),
    "TwoWheelSteeringThrottle": ((st.floats(0.0, 1.0),), {"parity": True}),
    "BicycleNormalizeAngularVelocity": ((length, length, st.floats(0.01, 3.0)), {"parity": True}),
    "BicycleUnnormalizeAngularVelocity": ((length, length, st.floats(0.01, 3.0)), {"parity": True}),
    "UnicycleNormalizeAngularVelocity": ((length, length, length), {"parity": True}),
    "UnicycleUnnormalizeAngularVelocity": ((length, length, length), {"parity": True}),
}


@pytest.mark.parametrize("name", PARTS)
@given(data=st.data())
def test_parts_with_parity(name, data):
    given_to, parity = PARTS[name]
    arguments = [data.draw(one) for one in given_to]
    inputs = [data.draw(anything) for _ in range(2 if name.startswith("Two") else 1)]
    expected = what(getattr(theirs, name)(*arguments).run, *inputs)
    assert_equal(what(getattr(ours, name)(*arguments, **parity).run, *inputs), expected)


@pytest.mark.parametrize("name", PARTS)
def test_parts_agree_by_default_within_their_range(name):
    """Nothing that donkeycar's own limits allow comes out otherwise."""
    arguments = {"NormalizeSteeringAngle": (0.7,), "UnnormalizeSteeringAngle": (0.7,)}
    arguments |= {"TwoWheelSteeringThrottle": (0.0,)}
    built = arguments.get(name, (0.3, 0.3, 1.0))
    for step in range(-10, 11):
        inputs = (0.05 * step,) * (2 if name.startswith("Two") else 1)
        assert_equal(
            what(getattr(ours, name)(*built).run, *inputs), what(getattr(theirs, name)(*built).run, *inputs)
        )


def test_every_name_is_there():
    for name in ours.__all__:
        assert hasattr(theirs, name)
    defined = vars(theirs).items()
    there = {name for name, value in defined if getattr(value, "__module__", "") == theirs.__name__}
    assert there == set(ours.__all__)


# --- by default ----------------------------------------------------------------------------------------

steps = st.lists(st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)), min_size=1, max_size=40)


@given(steps=steps, axle_length=st.floats(0.05, 2.0))
def test_unicycle_differs_by_the_midpoint_error_at_most(steps, axle_length):
    """An arc is longer than its chord by d (1 - sinc(turn/2)), at most d turn^2 / 24 per step."""
    mine, original = ours.Unicycle(axle_length), theirs.Unicycle(axle_length)
    left = right = bound = 0.0
    result, expected = mine.run(left, right, 1.0), original.run(left, right, 1.0)
    for count, (dl, dr) in enumerate(steps):
        left, right = left + dl, right + dr
        bound += abs(dl + dr) / 2 * ((dr - dl) / axle_length) ** 2 / 24
        result = mine.run(left, right, 1.1 + 0.1 * count)
        expected = original.run(left, right, 1.1 + 0.1 * count)
        assert math.hypot(result[2] - expected[2], result[3] - expected[3]) <= bound + 1e-12
    others = [0, 1, 7, 8]  # distance, velocity, yaw rate, time
    assert_equal([result[k] for k in others], [expected[k] for k in others])
    assert abs(math.remainder(result[4] - expected[4], math.tau)) < 1e-12


@given(steps=steps, wheel_base=st.floats(0.05, 2.0))
def test_bicycle_differs_only_in_place(steps, wheel_base):
    """Heading, distance and yaw rate of donkeycar's bicycle are right; x, y and their rates are not."""
    mine, original = ours.Bicycle(wheel_base), theirs.Bicycle(wheel_base)
    mine.run(0.0, 0.0, 1.0)
    original.run(0.0, 0.0, 1.0)
    rolled = 0.0
    for count, (distance, steering) in enumerate(steps):
        rolled += distance
        result = mine.run(rolled, 20.0 * steering, 1.1 + 0.1 * count)
        expected = original.run(rolled, 20.0 * steering, 1.1 + 0.1 * count)
        others = [0, 1, 7, 8]
        assert_equal([result[k] for k in others], [expected[k] for k in others])
        assert abs(math.remainder(result[4] - expected[4], math.tau)) < 1e-12


def test_bicycles_agree_on_a_straight_line():
    mine, original = ours.Bicycle(0.3), theirs.Bicycle(0.3)
    for count in range(10):
        reading = (0.1 * count, 0.0, 1.0 + count)
        assert_equal(mine.run(*reading), original.run(*reading))


# --- what is wrong upstream, so that we know when it is not any more -------------------------------------


def test_faults_are_still_there():
    turn = 0.5 / math.sin(math.pi / 8) * math.pi / 2
    bicycle = theirs.Bicycle(0.5)
    for count in range(1001):
        _, _, x, y, *_ = bicycle.run(turn * count / 1000, math.pi / 8, 1.0 + count)
    assert (x, y) == pytest.approx((1.3066, 1.3066), abs=1e-3)  # D1: right are (0.7071, 1.7071)

    with pytest.raises(ValueError, match="math domain"):  # D2
        theirs.InverseBicycle(0.5).run(0.1, 1.0, 1.0)
    with pytest.raises(ZeroDivisionError):
        theirs.InverseBicycle(0.5).run(0.0, 1.0, 1.0)

    unicycle = theirs.Unicycle(0.2)  # D4
    unicycle.run(0.0, 0.0, 0)
    assert unicycle.run(1.0, 1.0, 1.0)[2] == 0.0

    bicycle = theirs.Bicycle(0.5)  # D5
    bicycle.run(100.0, 0.0, 1.0)
    assert bicycle.run(100.0, 0.0, 2.0)[2] == 100.0

    bicycle.run(math.nan, 0.0, 3.0)  # NaN stays for ever
    assert math.isnan(bicycle.run(100.0, 0.0, 4.0)[2])

    assert theirs.InverseUnicycle(0.2, 0.03, 0.1, 3.0).run(9.0, 0.0, 1.0)[0] == 9.0  # D6
    assert theirs.NormalizeSteeringAngle(math.pi / 4).run(2.0) < -2.5  # D7

    error, _ = CTE().run([(0.1 * k, 0.0) for k in range(50)], 2.0, 0.1)
    assert error == pytest.approx(-0.1)  # left of the path, so that the template's gain steers further left
    assert PIDController(p=-0.5).run(error) < 0.0
