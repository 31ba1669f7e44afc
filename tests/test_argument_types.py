"""What is called with something else than it takes says so: an error of ours, which names what came."""

from __future__ import annotations

import numpy as np
import pytest

import trundle as tr

DRIVE = tr.Differential(track_width=0.2, wheel_radius=0.05)
ROBOT = tr.Robot(drive=DRIVE)
TWO = np.zeros((3, 2))
LOG = tr.WheelLog(time_ns=[0, 1, 2], wheel_names=("left", "right"), wheels=TWO)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: DRIVE.forward(["a", 1.0]), "forward: speeds \\['a', 1.0\\], must be a row of numbers"),
        (lambda: DRIVE.forward(None), "forward: speeds None, must be a row of numbers"),
        (lambda: DRIVE.forward([1.0, None]), "forward: speeds"),
        (lambda: DRIVE.inverse((1.0, 0.0, 0.0)), "inverse: \\(1.0, 0.0, 0.0\\), must be a Twist2D"),
        (lambda: DRIVE.inverse(tr.Twist2D("fast", 0.0, 0.0)), "must be a Twist2D of numbers"),
        (lambda: tr.Pose2D("x", 0.0, 0.0) @ tr.Pose2D(), "both must be poses of numbers"),
        (lambda: tr.Pose2D() @ 3, "both must be poses of numbers"),
        (lambda: tr.wrap("a"), "wrap: angle 'a'"),
        (lambda: DRIVE.forward_batch([[1.0, 2.0]]), "speeds: a list, must be an array"),
        (lambda: DRIVE.inverse_batch([[1.0, 2.0, 3.0]]), "twists: a list, must be an array"),
        (lambda: tr.integrate_batch(DRIVE, TWO.tolist()), "positions: a list, must be an array"),
        (lambda: tr.integrate_batch(DRIVE, TWO, time_ns=[0, 1, 2]), "time_ns: a list, must be an array"),
        (
            lambda: tr.integrate_batch(DRIVE, TWO, np.array([0, 1])),
            "time_ns: shape \\(2,\\), must be \\(3,\\)",
        ),
        (lambda: tr.integrate_batch(DRIVE, np.zeros(2)), "positions: shape \\(2,\\), must be"),
        (lambda: tr.integrate(ROBOT, "run.csv"), "'run.csv', must be a WheelLog; read_log makes one"),
        (lambda: tr.integrate("differential", LOG), "drive: 'differential', must be a drive"),
        (lambda: tr.WheelOdometry(3), "drive: 3, must be a drive, such as Differential"),
        (lambda: ROBOT.with_localizer("gyro"), "localizer: 'gyro', must be a drive"),
        (lambda: tr.Encoder(ticks_per_revolution=5, bits=2.5), "bits: 2.5, must be a whole number"),
        (lambda: tr.Encoder(ticks_per_revolution=5, bits="16"), "bits: '16', must be a whole number"),
        (lambda: tr.Custom(wheels=3), "wheels: \\(3,\\), must be a list of Wheel"),
        (lambda: tr.Custom(wheels=[3]), "wheels: \\(3,\\), must be a list of Wheel"),
        (
            lambda: tr.Differential(track_width=1, wheel_radius=1, reference=3),
            "reference: 3, must be \\(x, y\\)",
        ),
        (lambda: tr.Differential(track_width=1, wheel_radius=1, measured=3), "measured: 3, must be a wheel"),
    ],
)
def test_calls(call, words):
    with pytest.raises(tr.TrundleError, match=words):
        call()


@pytest.mark.parametrize(
    ("positional", "named", "words"),
    [
        (("a", [0.0, 0.0]), {}, "time 'a'"),
        ((1j, [0.0, 0.0]), {}, "time 1j"),
        ((2.0, 3), {}, "position 3, must be a row of numbers"),
        ((2.0, ["a", 1.0]), {}, "position"),
        ((2.0, [0.0, 0.0]), {"steering": 3}, "steering 3"),
        ((2.0, [0.0, 0.0]), {"steering": ["a"]}, "steering \\['a'\\]"),
        ((2.0, [0.0, 0.0]), {"command": ["a", "b"]}, "command"),
        ((), {"time_ns": "a", "positions": [0.0, 0.0]}, "time_ns 'a'"),
    ],
)
def test_updates_of_another_type_change_nothing(positional, named, words):
    odometry = tr.WheelOdometry(DRIVE)
    odometry.update(1.0, [0.0, 0.0])
    before = odometry.state
    with pytest.raises(tr.InputError, match=words):
        odometry.update(*positional, **named)
    assert (odometry.state, odometry.offered) == (before, 1)
    assert odometry.update(1.1, [0.1, 0.1]).pose.x == pytest.approx(0.005)


def test_batches_take_robots_and_nothing():
    rolled = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 3.0]])
    np.testing.assert_array_equal(tr.integrate_batch(ROBOT, rolled), tr.integrate_batch(DRIVE, rolled))
    other = tr.Differential(track_width=0.4, wheel_radius=0.1)
    np.testing.assert_array_equal(
        tr.integrate_batch(ROBOT.with_localizer(other), rolled), tr.integrate_batch(other, rolled)
    )
    assert tr.integrate_batch(DRIVE, np.zeros((0, 2))).shape == (0, 3)
    assert tr.integrate_batch(DRIVE, np.zeros((0, 5, 2))).shape == (0, 5, 3)
