"""`trundle convert`: nothing is lost between formats that can hold it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trundle as tr
from trundle.apps.cli import main

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    time_ns = np.arange(50) * 20_000_001
    poses = np.cumsum(np.random.default_rng(0).normal(0.0, 0.02, (50, 3)), axis=0)
    tr.write_trajectory(tr.Trajectory(time_ns=time_ns, poses=poses), tmp_path / "run.csv")
    return tmp_path / "run.csv"


def test_a_trajectory_goes_round_the_formats(trajectory: Path, tmp_path: Path, capsys) -> None:
    for name in ("run.parquet", "run.tum", "again.csv"):
        assert main(["convert", str(trajectory), str(tmp_path / name)]) == 0
        trajectory_again = tr.read_trajectory(tmp_path / name)
        wanted = tr.read_trajectory(trajectory)
        np.testing.assert_array_equal(trajectory_again.time_ns, wanted.time_ns)
        np.testing.assert_allclose(trajectory_again.poses, wanted.poses, atol=1e-14)
    assert "50" in capsys.readouterr().out


def test_a_log_becomes_our_own_csv(tmp_path: Path, capsys) -> None:
    robot, out = EXAMPLES / "differential" / "robot.yaml", tmp_path / "log.csv"
    source = EXAMPLES / "differential" / "run.csv"
    assert main(["convert", str(source), str(out), "--robot", str(robot)]) == 0
    described = tr.load_robot(robot)
    first, second = tr.read_log(source, described), tr.read_log(out, described)
    np.testing.assert_array_equal(first.wheels, second.wheels)
    np.testing.assert_array_equal(first.time_ns, second.time_ns)
    assert "wheels" in capsys.readouterr().out


ROVER = tr.Robot(drive=tr.Differential(track_width=0.2, wheel_radius=0.05))
STAMPS = np.arange(0, 2_000_000_000, 20_000_000)
ROLLED = np.stack([np.sin(STAMPS * 1e-9), np.cos(STAMPS * 1e-9)], axis=-1)


def again(log: tr.WheelLog, folder: Path) -> tr.WheelLog:
    """The log, written and read by a robot that says nothing about its logs."""
    tr.write_log(log, folder / "again.csv")
    return tr.read_log(folder / "again.csv", ROVER)


@pytest.mark.parametrize("reading", [tr.Reading.POSITION, tr.Reading.INCREMENT, tr.Reading.VELOCITY])
def test_every_reading_comes_back(tmp_path: Path, reading: tr.Reading) -> None:
    log = tr.WheelLog(time_ns=STAMPS, wheel_names=("left", "right"), wheels=ROLLED, reading=reading)
    got = again(log, tmp_path)
    assert got.reading is reading
    np.testing.assert_array_equal(got.wheels, log.wheels)


def test_body_twists_come_back(tmp_path: Path) -> None:
    twists = np.stack([*ROLLED.T, ROLLED[:, 0]], axis=-1)
    got = again(tr.WheelLog(time_ns=STAMPS, twists=twists), tmp_path)
    assert got.wheels is None
    np.testing.assert_array_equal(got.twists, twists)


def test_a_reference_with_stamps_of_its_own_is_put_at_the_rows(tmp_path: Path) -> None:
    """On a line it is exact; before its first and after its last sample there is none."""
    own = np.arange(500_000_000, 1_600_000_000, 33_000_000)
    poses = np.stack([own * 1e-9, -2e-9 * own, 3.0 + own * 1e-9], axis=-1)
    log = tr.WheelLog(
        time_ns=STAMPS,
        wheel_names=("left", "right"),
        wheels=ROLLED,
        reference=tr.Trajectory(time_ns=own, poses=poses),
    )
    got = again(log, tmp_path).reference
    there = STAMPS[(own[0] <= STAMPS) & (own[-1] >= STAMPS)]
    np.testing.assert_array_equal(got.time_ns, there)
    wanted = np.stack([there * 1e-9, -2e-9 * there, 3.0 + there * 1e-9], axis=-1)
    np.testing.assert_allclose(got.poses, wanted, atol=1e-12)


@pytest.mark.parametrize("suffix", [".csv", ".bag", ".db3"])
def test_a_log_that_is_taken_for_a_trajectory_is_told_the_way(tmp_path: Path, suffix, capsys) -> None:
    source = tmp_path / f"run{suffix}"
    source.write_bytes((EXAMPLES / "differential" / "run.csv").read_bytes())
    assert main(["convert", str(source), str(tmp_path / "out.tum")]) == 3
    assert "a wheel log is converted with --robot robot.yaml" in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--salvage", "--sort"])
def test_what_is_of_logs_alone_is_refused_for_trajectories(trajectory: Path, option: str, capsys) -> None:
    assert main(["convert", str(trajectory), str(trajectory.parent / "out.tum"), option]) == 2
    assert f"{option}: is of wheel logs, which need --robot; trajectories and" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "code", "words"),
    [
        ("run.csv", 2, "is the input itself, must be another file"),
        ("run.xyz", 2, "must end in one of .tum"),
        ("nowhere/run.tum", 5, "there is no folder"),
        ("folder.tum", 5, "is a folder, must be a file"),
        ("robot.urdf", 2, "robots are only read from .urdf, .xacro; they are written as .yaml (robot"),
    ],
)
def test_outputs_that_cannot_be_are_refused_first(
    trajectory: Path, name: str, code: int, words: str, capsys
) -> None:
    before = trajectory.read_bytes()
    (trajectory.parent / "folder.tum").mkdir()
    assert main(["convert", str(trajectory), str(trajectory.parent / name)]) == code
    assert words in capsys.readouterr().err
    assert trajectory.read_bytes() == before


CONTROLLERS = """\
diffbot:
  ros__parameters:
    left_wheel_names: [wheel_left_joint]
    right_wheel_names: [wheel_right_joint]
    wheel_separation: 0.287
    wheel_radius: 0.033
controller_manager:
  ros__parameters:
    diffbot: {type: diff_drive_controller/DiffDriveController}
"""
MODEL = """\
<robot name="diffbot"><link name="base_link"/>
<link name="l"><collision><geometry><cylinder radius="0.033" length="0.02"/></geometry></collision></link>
<link name="r"><collision><geometry><cylinder radius="0.033" length="0.02"/></geometry></collision></link>
<joint name="wheel_left_joint" type="continuous"><parent link="base_link"/><child link="l"/>
<origin xyz="0 0.1435 0" rpy="-1.5707963 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="wheel_right_joint" type="continuous"><parent link="base_link"/><child link="r"/>
<origin xyz="0 -0.1435 0" rpy="-1.5707963 0 0"/><axis xyz="0 0 1"/></joint></robot>
"""
MYCONFIG = "HAVE_ODOM = HAVE_ODOM_2 = True\nAXLE_LENGTH = 0.287\nWHEEL_RADIUS = 0.033\nENCODER_PPR = 20\n"


@pytest.mark.parametrize(
    ("name", "text"), [("controllers.yaml", CONTROLLERS), ("bot.urdf", MODEL), ("myconfig.py", MYCONFIG)]
)
def test_a_robot_that_is_described_elsewhere_becomes_robot_yaml(tmp_path: Path, capsys, name, text) -> None:
    source, out = tmp_path / name, tmp_path / "robot.yaml"
    source.write_text(text)
    assert main(["convert", str(source), str(out)]) == 0
    drive = tr.load_robot(out).drive
    assert isinstance(drive, tr.Differential)
    assert drive.inverse(tr.Twist2D(0.3, 0.0, 0.0)).speeds == pytest.approx((0.3 / 0.033,) * 2)
    assert "robot.yaml" in capsys.readouterr().out
    assert main(["convert", str(source), str(out)]) == 2
    assert "--force replaces it" in capsys.readouterr().err


def test_robot_yaml_becomes_what_others_read(tmp_path: Path, capsys) -> None:
    """As `calibrate --ros2` and `--myconfig` write it; robot.yaml itself is never taken for parameters."""
    source = EXAMPLES / "differential" / "robot.yaml"
    assert main(["convert", str(source), str(tmp_path / "controllers.yaml")]) == 0
    again = tr.robot_from_controllers(tmp_path / "controllers.yaml").drive
    wanted = tr.load_robot(source).drive
    assert again.parameters["track_width"] == wanted.parameters["track_width"]
    assert main(["convert", str(source), str(tmp_path / "snippet.py")]) == 0
    assert "WHEEL_RADIUS = 0.042" in (tmp_path / "snippet.py").read_text()
    assert capsys.readouterr().err == ""
    uneven = tmp_path / "uneven.yaml"
    uneven.write_text(
        "drive: {type: differential, track_width: 0.2, wheel_radius: {left: 41.34 mm, right: 41.65 mm}}\n"
    )
    assert main(["convert", str(uneven), str(tmp_path / "uneven.py")]) == 0
    words = "donkeycar knows one wheel radius: the mean of left 41.34 mm, right 41.65 mm"
    assert words in capsys.readouterr().err
    assert f"# {words}\n" in (tmp_path / "uneven.py").read_text()


def test_what_describes_no_robot_is_refused(tmp_path: Path, capsys) -> None:
    out = tmp_path / "robot.yaml"
    for name in ("run.csv", "robot.urdf", "other.yaml"):
        source = tmp_path / name
        source.write_text("time,x,y\n0,0,0\n")
        assert main(["convert", str(source), str(out)]) == 2
        assert name in capsys.readouterr().err
        assert not out.exists()
