"""What is called with something else than it takes says so: an error of ours, which names what came."""

from __future__ import annotations

import numpy as np
import pytest

import trundle as tr
from trundle import command, follow, simulate

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
        (lambda: tr.integrate_batch(3, TWO), "drive: 3, must be a drive"),
        (lambda: tr.integrate(ROBOT, LOG, pose=(0, 0, 0)), "pose \\(0, 0, 0\\), must be a Pose2D"),
        (lambda: tr.WheelOdometry(ROBOT).reset(3), "reset: pose 3, must be a Pose2D"),
        (lambda: tr.WheelOdometry(ROBOT, pose=[0, 0, 0]), "pose \\[0, 0, 0\\], must be a Pose2D"),
        (lambda: tr.WheelOdometry(3), "drive: 3, must be a drive, such as Differential"),
        (lambda: ROBOT.with_localizer("gyro"), "localizer: 'gyro', must be a drive"),
        (lambda: tr.Encoder(ticks_per_revolution=5, bits=2.5), "bits: 2.5, must be a whole number"),
        (lambda: tr.Encoder(ticks_per_revolution=5, bits="16"), "bits: '16', must be a whole number"),
        (lambda: tr.Custom(wheels=3), "wheels: 3, must be a list of Wheel"),
        (lambda: tr.Custom(wheels=[3]), "wheels: \\[3\\], must be a list of Wheel"),
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


STAMPS = np.arange(20) * 50_000_000
POSES = np.stack([np.cos(STAMPS * 1e-9), np.sin(STAMPS * 1e-9), STAMPS * 1e-9], axis=-1)
PATH = tr.Trajectory(time_ns=STAMPS, poses=POSES)
COLUMNS = {"time_ns": STAMPS[:3], "wheel_names": ("left", "right")}
WRONG = {
    "text": "fast",
    "none": None,
    "list": [1.0, 2.0],
    "dict": {"a": 1},
    "object": object(),
    "complex": 1j,
    "bytes": b"ab",
    "array": np.zeros((3, 3)),
    "objects": np.array([None, "a"]),
    "type": int,
}
FINE = {
    "steering_range": ("none", "list"),
    "calibration": ("none",),
    "max_speed": ("none",),
    "residual": ("list", "bytes"),
    "rejected": ("dict",),
    "wheels": ("none",),
    "reference": ("none",),
    "to_motor": ("list", "bytes"),
    "line": ("list",),
    "saved to": ("text",),
}


def saturated(twist=tr.Twist2D(1.0), robot=ROBOT, policy="scale_all"):  # noqa: B008
    return tr.saturate(twist, command.Envelope(robot), policy)


DOORS = {
    "track_width": lambda x: tr.Differential(track_width=x, wheel_radius=0.05),
    "wheelbase": lambda x: tr.Mecanum(track_width=0.3, wheelbase=x, wheel_radius=0.05),
    "robot_radius": lambda x: tr.Omni(robot_radius=x, wheel_radius=0.05),
    "wheel_count": lambda x: tr.Omni(robot_radius=0.2, wheel_radius=0.05, wheel_count=x),
    "wheel": lambda x: tr.Wheel("a", 0.0, x, 0.05),
    "steering_range": lambda x: tr.Wheel("a", 0.0, 0.0, 0.05, kind="steered", steering_range=x),
    "kind": lambda x: tr.Wheel("a", 0.0, 0.0, 0.05, kind=x),
    "limits": lambda x: tr.Robot(drive=DRIVE, limits=x),
    "encoders": lambda x: tr.Robot(drive=DRIVE, encoders=x),
    "calibration": lambda x: tr.Robot(drive=DRIVE, calibration=x),
    "encoders_of": ROBOT.encoders_of,
    "max_speed": lambda x: tr.Limits(max_speed=x),
    "command_timeout": lambda x: tr.Limits(command_timeout=x),
    "noise": lambda x: tr.Noise(wheel_distance=x),
    "exp": tr.Pose2D.exp,
    "inverse": lambda x: tr.Pose2D(0.0, 0.0, x).inverse(),
    "log": lambda x: tr.Pose2D(0.0, 0.0, x).log(),
    "adjoint": lambda x: tr.Pose2D(0.0, 0.0, x).adjoint(),
    "wrap": tr.wrap,
    "icr": DRIVE.icr,
    "project": DRIVE.project,
    "residual": DRIVE.residual,
    "jacobian": lambda x: tr.Bicycle(wheelbase=0.3, wheel_radius=0.05).jacobian(x),
    "desaturated": lambda x: tr.WheelCommand((1.0, 2.0)).desaturated(x),
    "poses": lambda x: tr.Trajectory(time_ns=STAMPS, poses=x),
    "rejected": lambda x: tr.Trajectory(time_ns=STAMPS, poses=POSES, rejected=x),
    "pose": PATH.pose,
    "wheels": lambda x: tr.WheelLog(**COLUMNS, wheels=x, twists=np.zeros((3, 3))),
    "reading": lambda x: tr.WheelLog(**COLUMNS, wheels=TWO, reading=x),
    "wheel_names": lambda x: tr.WheelLog(time_ns=STAMPS[:3], wheel_names=x, wheels=TWO),
    "reference": lambda x: tr.WheelLog(**COLUMNS, wheels=TWO, reference=x),
    "compare": lambda x: tr.compare(x, PATH),
    "compared with": lambda x: tr.compare(PATH, x),
    "alignment": lambda x: tr.compare(PATH, PATH, alignment=x),
    "stamps": lambda x: tr.compare(PATH, PATH, stamps=x),
    "max_gap": lambda x: tr.compare(PATH, PATH, max_gap=x),
    "rpe_distance": lambda x: tr.compare(PATH, PATH, rpe_distance=x),
    "saturate": lambda x: saturated(twist=x),
    "envelope": lambda x: saturated(robot=x),
    "policy": lambda x: saturated(policy=x),
    "pipeline": lambda x: tr.CommandPipeline(ROBOT, saturation=x),
    "motor units": lambda x: tr.MotorUnits(ROBOT, x),
    "to_motor": tr.MotorUnits(ROBOT, "rpm").to_motor,
    "feed forward": tr.FeedForward(0.1, 0.1, 0.1).effort,
    "watchdog": lambda x: tr.Watchdog(timeout=x),
    "course": simulate.Course.of,
    "simulate": lambda x: simulate.simulate(ROBOT, x, rate=20.0),
    "line": lambda x: follow.Line((0.0, 0.0), x),
    "path": follow.Path,
    "load_robot": tr.load_robot,
    "read_log": lambda x: tr.read_log(x, ROBOT),
    "read_trajectory": tr.read_trajectory,
    "write_trajectory": lambda x: tr.write_trajectory(x, "never.tum"),
    "written to": lambda x: tr.write_trajectory(PATH, x),
    "write_log": lambda x: tr.write_log(x, "never.csv"),
    "save_robot": lambda x: tr.save_robot(x, "never.yaml"),
    "saved to": lambda x: tr.save_robot(ROBOT, x),
    "controllers": tr.controllers_text,
    "robot_from_controllers": tr.robot_from_controllers,
    "robot_from_urdf": tr.robot_from_urdf,
}


@pytest.mark.parametrize("door", DOORS)
def test_nothing_of_another_kind_comes_through_a_door(door, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for wrong in (WRONG[name] for name in WRONG if name not in FINE.get(door, ())):
        try:
            DOORS[door](wrong)
        except tr.TrundleError as error:
            assert str(error)  # noqa: PT017
        else:
            pytest.fail(f"{door} took {wrong!r}")
    assert not list(tmp_path.glob("never*"))


def test_numbers_of_numpy_are_numbers():
    for kind in (np.float32, np.float64, np.int64, np.array):
        assert tr.Differential(track_width=kind(2), wheel_radius=kind(1)).wheels[0].y == 1.0
    places = np.array([[0.2, 0.2], [0.2, -0.2], [-0.2, 0.2], [-0.2, -0.2]])
    assert len(tr.Swerve(modules=places, wheel_radius=0.05).wheel_names) == 4
    assert tr.Encoder(ticks_per_revolution=np.float32(100), bits=np.int64(16)).bits == 16
    for nothing in (np.float32("nan"), np.array(np.inf), 10**400):
        with pytest.raises(tr.ConfigError, match="must be finite"):
            tr.Differential(track_width=nothing, wheel_radius=0.05)


def test_words_choose_what_they_say():
    moved = tr.Trajectory(time_ns=STAMPS, poses=POSES + np.array([1.0, 0.0, 0.0]))
    assert tr.compare(PATH, moved, alignment="none").ate == pytest.approx(1.0)
    assert tr.compare(PATH, moved, alignment="best").ate < 1e-9
    assert tr.WheelLog(**COLUMNS, wheels=TWO, reading="velocity").reading is tr.Reading.VELOCITY
    car = tr.Robot(drive=DRIVE, limits=tr.Limits(max_speed=1.0, max_wheel_speed=21.0))
    wanted = tr.Twist2D(1.0, 0.0, 3.0)
    assert saturated(wanted, car, "yaw_first").twist.omega == pytest.approx(3.0)
    assert saturated(wanted, car, "scale_all").twist.omega < 3.0


def test_counts_are_whole():
    with pytest.raises(tr.InputError, match="must be whole numbers"):
        tr.WheelLog(**COLUMNS, wheels=TWO + 0.5, reading="ticks")
    with pytest.raises(tr.InputError, match="must be whole numbers"):
        tr.WheelLog(**COLUMNS, wheels=TWO * np.nan, reading="ticks")
    assert tr.WheelLog(**COLUMNS, wheels=TWO + 2.0, reading="ticks").wheels.dtype == np.int64


def test_residuals_of_what_is_not_finite_are_refused():
    with pytest.raises(tr.InputError, match="must be finite"):
        DRIVE.residual([np.nan, 1.0])
