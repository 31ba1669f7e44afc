"""The command line: what it prints, what it writes, and how it ends."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

import trundle as tr
from trundle.adapters.log import read_log_pieces
from trundle.apps import cli, plot, progress, rejection, track
from trundle.apps.cli import main
from trundle.apps.exit_code import ExitCode, exit_code_of
from trundle.errors import LogCorrupt, LogError, LogTruncated
from trundle.odometry import wheel_odometry

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
LOG, ROBOT = EXAMPLES / "differential" / "run.csv", EXAMPLES / "differential" / "robot.yaml"
DIFFERENTIAL = "drive: {type: differential, track_width: 0.2, wheel_radius: 0.05}\n"


STAMPS = [f"{k}.0,{k},{k}" for k in range(1, 31)]
SHUFFLED = "\n".join(("time,left.position,right.position", *STAMPS[15:], *STAMPS[:15])) + "\n"


@pytest.fixture
def run(capsys):
    """Run a command; its exit code, and what it said on stdout and stderr."""

    def run(*words):
        code = main([str(word) for word in words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("name: cart\n" + DIFFERENTIAL)
    return path


def written(path, *rows, columns="time,left.position,right.position"):
    path.write_text("\n".join((columns, *rows)) + "\n")
    return path


def straight(path, count=20, **changes):
    """A log of 0.05 m per step, with some rows replaced."""
    rows = [f"{0.1 * k:.1f},{k},{k}" for k in range(count)]
    for number, row in changes.items():
        rows[int(number[1:])] = row
    return written(path, *rows)


def subprocess_of(*words, **options):
    command = [sys.executable, "-m", "trundle", *map(os.fspath, words)]
    return subprocess.run(command, capture_output=True, check=False, **options)


# --- track --------------------------------------------------------------------------------------


def test_track_writes_what_the_library_computes(run, tmp_path):
    output = tmp_path / "run.csv"
    code, out, err = run("track", LOG, "--robot", ROBOT, "-o", output)
    assert (code, err) == (0, "")
    described = tr.load_robot(ROBOT)
    log = tr.read_log(LOG, described)
    wanted = tr.integrate(described, log)
    got = tr.read_trajectory(output)
    np.testing.assert_array_equal(got.poses, wanted.poses)
    np.testing.assert_array_equal(got.covariances, wanted.covariances)
    comparison = tr.compare(wanted, log.reference)
    lines = dict(line.strip().split("  ", 1) for line in out.splitlines()[1:])
    assert lines["samples"].strip() == f"{len(wanted)} accepted, 61.9 s, 30.0 Hz"
    assert lines["distance"].strip() == f"{wanted.distance:.1f} m"
    assert f"ATE {comparison.ate * 100:.2f} cm" in lines["error"]
    assert lines["drift"].strip().startswith(f"{comparison.drift * 100:.3f} %")
    assert max(map(len, out.splitlines())) <= 80 + len(str(output))


def test_track_says_how_sure_the_end_is(run, tmp_path, robot):
    """After driving along x, the error along the body's x is that along the frame's x."""
    log = straight(tmp_path / "run.csv")
    code, out, _ = run("track", log, "--robot", robot, "-o", tmp_path / "run.tum")
    final = tr.integrate(tr.load_robot(robot), tr.read_log(log, tr.load_robot(robot)))
    sigma = np.sqrt(np.diag(final.covariances[-1]))
    assert code == 0
    assert "end         x 0.950 m, y 0.000 m, heading 0 deg" in out
    assert f"x ±{sigma[0] * 1e3:.2f} mm" in out
    assert f"heading ±{np.degrees(sigma[2]):.2f} deg" in out


def test_track_turns_the_uncertainty_into_the_frame(run, tmp_path, robot):
    """A quarter turn on the spot, then a metre ahead: what errs along the body's x errs along y."""
    turn = 0.1 * np.pi / 2 / 0.05  # of each wheel [rad]
    rows = [f"{0.1 * k:.1f},{-turn * k / 20},{turn * k / 20}" for k in range(21)]
    rows += [f"{2.0 + 0.1 * k:.1f},{-turn + k},{turn + k}" for k in range(1, 21)]
    log = written(tmp_path / "run.csv", *rows)
    _, out, _ = run("track", log, "--robot", robot, "-o", tmp_path / "run.csv.tum")
    final = tr.integrate(tr.load_robot(robot), tr.read_log(log, tr.load_robot(robot)))
    along, across, _ = np.sqrt(np.diag(final.covariances[-1]))
    assert across > 2 * along
    assert f"x ±{across * 1e2:.3g} cm, y ±{along * 1e3:.2f} mm" in out


@pytest.mark.parametrize(("measured", "told"), [("", True), (", measured: [left, right, gyro]", False)])
def test_track_says_that_a_gyro_is_idle(run, tmp_path, measured, told):
    (tmp_path / "robot.yaml").write_text(f"name: cart\n{DIFFERENTIAL.rstrip().rstrip('}')}{measured}}}\n")
    (tmp_path / "run.csv").write_text(
        "time,left.position,right.position,gyro.yaw_rate\n0,0,0,0\n0.1,0.1,0.1,0\n"
    )
    code, out, _ = run(
        "track", tmp_path / "run.csv", "--robot", tmp_path / "robot.yaml", "-o", tmp_path / "run.tum"
    )
    assert code == 0
    assert ("drive.measured: [left, right, gyro] counts it in" in out) is told


def test_track_counts_what_it_refuses(run, tmp_path, robot):
    log = straight(tmp_path / "run.csv", _3="0.3,nan,3", _5="0.4,4,4", _7="0.7,x,7")
    code, out, err = run("track", log, "--robot", robot, "-o", tmp_path / "run.tum")
    assert code == 0
    assert "17 of 20 accepted" in out
    assert "rejected    1 duplicate, 1 nonfinite, 1 parse" in out
    assert "warning: 1 row was left out as unreadable: line 9: column 'left.position' holds 'x'" in err


@pytest.mark.parametrize(
    ("rows", "limits", "code", "words"),
    [
        (
            [f"{0.1 * k:.1f},{1e6 * k},{1e6 * k}" for k in range(20)],
            "",
            4,
            "15 m/s, since no limits are given",
        ),
        ([f"{0.1 * k:.1f},{30 * k},{30 * k}" for k in range(20)], "max_speed: 1", 4, "limits.max_speed: 1"),
        ([f"{0.1 * k:.1f},{k},{k}" for k in range(20)] + ["nan,1,1"] * 5, "", 0, "5 nonfinite"),
        ([f"{k // 4}.0,{k},{k}" for k in range(40)], "", 4, "is the time too coarse (log.time.column)"),
        ([f"{0.1 * k:.1f},{k},{k}" for k in range(20)] + ["2.0,1,nan"] * 25, "", 4, "say hold: true"),
    ],
)
def test_track_says_why_it_refused_much(run, tmp_path, robot, rows, limits, code, words):
    robot.write_text(DIFFERENTIAL + f"limits: {{{limits}}}\n")
    log = written(tmp_path / "run.csv", *rows)
    got, _, err = run("track", log, "--robot", robot, "-o", tmp_path / "run.tum")
    assert got == code
    assert "rows were refused: " in err
    assert words in err


def test_track_tells_every_reason_that_odometry_has():
    """Words for all that `WheelOdometry` rejects a sample for, or that a reader leaves out."""
    source = Path(wheel_odometry.__file__).read_text(encoding="utf-8")
    reasons = set(re.findall(r'_reject\("(\w+)"\)', source)) | {"implausible", "jump"}
    assert reasons - {"shape"} == reasons & set(rejection.REASONS)  # a log's rows have one shape


def test_track_compares_with_another_file(run, tmp_path, robot):
    log = straight(tmp_path / "run.csv")
    time_ns = np.arange(20) * 100_000_000
    truth = np.stack([0.05 * np.arange(20), 0.01 * (np.arange(20) % 2), np.zeros(20)], axis=-1)
    tr.write_trajectory(tr.Trajectory(time_ns=time_ns, poses=truth), tmp_path / "truth.tum")
    options = ("--robot", robot, "-o", tmp_path / "run.tum", "--reference", tmp_path / "truth.tum")
    code, out, _ = run("track", log, *options)
    assert code == 0
    assert "ATE 4.9" in out  # half of a centimetre, less what the alignment takes
    assert "mm" in out


def test_track_goes_on_where_the_reference_cannot_be_compared(run, tmp_path, robot):
    rows = [f"{0.1 * k:.1f},{k},{k},1,1" for k in range(9)]
    columns = "time,left.position,right.position,reference.x,reference.y"
    log = written(tmp_path / "run.csv", *rows, columns=columns)
    code, out, err = run("track", log, "--robot", robot, "-o", tmp_path / "run.tum")
    assert code == 0
    assert "error" not in out
    assert "warning: the reference cannot be compared" in err


def test_track_moves_the_estimate_to_a_point_that_is_seen_without_heading(run, tmp_path):
    """A camera sees a point 0.3 m ahead of the axle while the robot turns on the spot and drives off."""
    robot = tmp_path / "robot.yaml"
    robot.write_text(
        DIFFERENTIAL + "log: {reference: {columns: [reference.x, reference.y], mounting: [0.3, 0, 0]}}\n"
    )
    angle = np.minimum(np.arange(40) * 0.05, 1.0)
    ahead = np.maximum(np.arange(40) - 20, 0) * 0.05
    x, y = ahead * np.cos(1.0) + 0.3 * np.cos(angle), ahead * np.sin(1.0) + 0.3 * np.sin(angle)
    turned = 0.1 * angle / 0.05
    data = zip(0.1 * np.arange(40), ahead / 0.05 - turned, ahead / 0.05 + turned, x, y, strict=True)
    rows = [",".join(f"{float(value)!r}" for value in row) for row in data]
    columns = "time,left.position,right.position,reference.x,reference.y"
    log = written(tmp_path / "run.csv", *rows, columns=columns)
    options = ("--robot", robot, "-o", tmp_path / "run.tum", "--integrator", "arc")
    code, out, err = run("track", log, *options)
    assert (code, err) == (0, "")
    assert "ATE 0 m" in out


def test_track_draws(run, tmp_path, robot):
    picture = tmp_path / "run.png"
    code, out, _ = run(
        "track",
        straight(tmp_path / "run.csv"),
        "--robot",
        robot,
        "-o",
        tmp_path / "run.tum",
        "--plot",
        picture,
    )
    assert code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"picture     {picture}" in out


def test_integrators_and_pictures_are_those_of_the_library():
    assert set(get_args(track.Way)) == {way.value for way in tr.Integrator}
    assert track._PICTURES == plot._FORMATS


def test_integrator_is_handed_on(run, tmp_path, robot):
    rows = [f"{0.1 * k:.1f},{k},{1.3 * k:.6g}" for k in range(20)]
    log = written(tmp_path / "run.csv", *rows)
    options = ("--robot", robot, "-o", tmp_path / "run.csv.csv", "--integrator", "euler")
    assert run("track", log, *options)[0] == 0
    described = tr.load_robot(robot)
    wanted = tr.integrate(described, tr.read_log(log, described), integrator="euler")
    np.testing.assert_array_equal(tr.read_trajectory(tmp_path / "run.csv.csv").poses, wanted.poses)


def test_salvaged_recordings_are_partial_results(run, tmp_path, broken_bag):
    bag, robot = broken_bag
    output = tmp_path / "run.tum"
    code, _, err = run("track", bag, "--robot", robot, "-o", output)
    assert code == ExitCode.DATA
    assert not output.exists()
    assert "Traceback" not in err
    assert "salvage=True (--salvage) reads what is whole [truncated]" in err
    for name in ("--salvage", "--allow-partial"):
        code, out, err = run("track", bag, "--robot", robot, "-o", output, name, "--force")
        assert code == ExitCode.PARTIAL
        assert "accepted" in out
        assert "warning" in err
        assert len(tr.read_trajectory(output)) > 10
    assert run("info", bag)[0] == ExitCode.PARTIAL


@pytest.mark.parametrize(("suffix", "helps"), [(".csv", True), (".parquet", False), (".npz", False)])
def test_salvage_is_named_where_it_helps(tmp_path, suffix, helps):
    """Not of Parquet and archives, which are read whole or not at all."""
    count = np.arange(60.0)
    columns = {"time": 0.1 * count, "left.position": count, "right.position": count}
    log = straight(tmp_path / f"cut{suffix}", count=60)
    if suffix == ".parquet":
        pytest.importorskip("pyarrow.parquet").write_table(pytest.importorskip("pyarrow").table(columns), log)
    elif suffix == ".npz":
        np.savez(log, **columns)
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3 + 1])
    drive = tr.Differential(track_width=0.2, wheel_radius=0.05)
    for read in (tr.read_log, lambda *words, **how: list(read_log_pieces(*words, **how))):
        with pytest.raises((LogTruncated, LogCorrupt)) as error:
            read(log, drive)
        assert ("(--salvage) reads what is whole" in str(error.value)) is helps
        if helps:
            read(log, drive, salvage=True)


@pytest.fixture
def broken_bag(tmp_path):
    """A ROS 1 bag of two wheels whose last third is missing, and its robot."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    path = tmp_path / "run.bag"
    writer = Writer(path)
    writer.chunk_threshold = 2000
    with writer:
        kind = "sensor_msgs/msg/JointState"
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for k in range(300):
            stamp = kinds["builtin_interfaces/msg/Time"](sec=100 + k // 10, nanosec=k % 10 * 100_000_000)
            header = kinds["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="")
            message = kinds[kind](
                header=header,
                name=["wheel_left_joint", "wheel_right_joint"],
                position=np.array([0.1 * k, 0.11 * k]),
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            raw = bytes(store.serialize_ros1(message, kind))
            writer.write(connection, stamp.sec * 10**9 + stamp.nanosec, raw)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    robot = tmp_path / "bag.yaml"
    wheels = ", ".join(
        f"{side}: {{topic: /joint_states, name: wheel_{side}_joint, unit: rad}}" for side in ("left", "right")
    )
    robot.write_text(DIFFERENTIAL + f"log: {{wheels: {{{wheels}}}}}\n")
    return path, robot


# --- compare ------------------------------------------------------------------------------------


@pytest.fixture
def pair(tmp_path):
    """A path, and the same one elsewhere, 3 % longer and with 3 % more turning."""
    time_ns = np.arange(200) * 50_000_000
    angle = 0.02 * np.arange(200)
    path = np.stack([np.sin(angle), 1 - np.cos(angle), angle], axis=-1)
    reference = tr.Trajectory(time_ns=time_ns, poses=path)
    estimate = tr.Trajectory(time_ns=time_ns, poses=1.03 * path + [2.0, 0.0, 0.0])
    for name, trajectory in (("estimate", estimate), ("reference", reference)):
        tr.write_trajectory(trajectory, tmp_path / f"{name}.csv")
    return tmp_path / "estimate.csv", tmp_path / "reference.csv"


def test_compare_prints_what_the_library_computes(run, pair):
    code, out, err = run("compare", *pair)
    wanted = tr.compare(*map(tr.read_trajectory, pair))
    assert (code, err) == (0, "")
    rows = {line[2:19].strip(): line[19:].split() for line in out.splitlines()}
    assert "200 samples, 3.98 m in 9.95 s" in out
    assert f"{wanted.drift * 100:.2f} % of the path" in out
    assert rows["APE position"][:2] == [f"{wanted.position.rmse * 100:.2f}", "cm"]
    assert rows["RPE 1 m position"][:2] == [f"{wanted.rpe_position.rmse * 100:.2f}", "cm"]
    assert rows["APE heading"][-2:] == [f"{np.degrees(wanted.heading.max):.2f}", "deg"]


def test_compare_aligns_as_told(run, pair):
    assert "moved by  x 0.000 m, y 0.000 m, 0 deg" in run("compare", *pair, "--align", "none")[1]
    assert "moved by  x -2.000 m, y 0.000 m, 0 deg" in run("compare", *pair, "--align", "origin")[1]
    assert "RPE 0.5 m position" in run("compare", *pair, "--distance", "0.5")[1]


def test_what_is_left_out_of_a_trajectory_is_said(run, pair, tmp_path, robot):
    words = "truth.csv: rows were left out: 1 unfinished"
    estimate, truth = pair[0], tmp_path / "truth.csv"
    truth.write_bytes(Path(estimate).read_bytes()[:-5])
    assert words in run("compare", estimate, truth)[2]
    assert words in run("compare", truth, estimate)[2]
    log = straight(tmp_path / "run.csv")
    output = tmp_path / "out.tum"
    assert words in run("track", log, "--robot", robot, "-o", output, "--reference", truth)[2]


def test_a_file_without_times_is_compared_row_by_row(run, pair, tmp_path):
    """Never by stamps that nobody wrote: a path of 20 Hz against its own KITTI file has no error."""
    for path in pair:
        tr.write_trajectory(tr.read_trajectory(path), path.with_suffix(".kitti"))
    estimate, truth = (path.with_suffix(".kitti") for path in pair)
    wanted = run("compare", *pair)[1].splitlines()[1:]
    for files in ((estimate, pair[1]), (pair[0], truth)):
        code, out, err = run("compare", *files)
        assert (code, out.splitlines()[1:]) == (0, wanted)
        assert "kitti: has no times; compared row by row" in err
    code, out, err = run("compare", estimate, truth)
    assert code == 0
    assert "200 samples, 3.98 m\n" in out
    assert err.count("has no times") == 2
    whole = tr.read_trajectory(pair[1])
    tr.write_trajectory(whole.take(np.arange(150)), tmp_path / "short.csv")
    code, out, err = run("compare", estimate, tmp_path / "short.csv")
    assert (code, out) == (ExitCode.DATA, "")
    assert "the estimate has no times" in err
    assert "the estimate has 200, the reference 150" in err
    assert "no times to add it to" in run("compare", *pair[:1], truth, "--time-offset", "1")[2]


def test_track_knows_that_a_reference_has_no_times(run, tmp_path, robot):
    log = straight(tmp_path / "run.csv")
    output = tmp_path / "run.tum"
    assert run("track", log, "--robot", robot, "-o", output)[0] == 0
    found = tr.read_trajectory(output)
    tr.write_trajectory(found, tmp_path / "same.kitti")
    tr.write_trajectory(found.take(np.arange(5)), tmp_path / "short.kitti")
    options = ("--robot", robot, "-o", output, "--force", "--reference")
    code, out, err = run("track", log, *options, tmp_path / "same.kitti")
    assert (code, "ATE 0 m" in out) == (0, True)
    assert "same.kitti: has no times; compared row by row" in err
    code, out, err = run("track", log, *options, tmp_path / "short.kitti")
    assert (code, "error" in out) == (0, False)
    assert "the reference cannot be compared: the reference has no times" in err


def test_compare_says_what_has_no_common_time(run, pair):
    code, out, err = run("compare", *pair, "--time-offset", "1e6")
    assert (code, out) == (ExitCode.DATA, "")
    assert "no time in common" in err
    assert re.search(r"\(--time-offset -1\d{6}\.\d{3}\) starts them together", err)


# --- inverse and forward ------------------------------------------------------------------------

INLINE = "{type: differential, track_width: 0.2, wheel_radius: 50 mm}"


def numbers(line):
    return [float(word) for word in line.split() if word.lstrip("-").replace(".", "", 1).isdigit()]


def test_inverse_prints_wheels(run):
    code, out, err = run("inverse", "--drive", INLINE, "1.0", "0", "-0.5")
    assert (code, err) == (0, "")
    head, left, right = out.splitlines()
    assert head.split() == ["wheel", "[rad/s]", "[rpm]", "[m/s]"]
    assert numbers(left) == pytest.approx([21.0, 21.0 * 60 / 2 / np.pi, 1.05], abs=6e-4)
    assert numbers(right) == pytest.approx([19.0, 19.0 * 60 / 2 / np.pi, 0.95], abs=6e-4)


def test_inverse_prints_steering(run, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("drive: {type: swerve, modules: [[0.2, 0], [-0.2, 0]], wheel_radius: 0.05}\n")
    _, out, _ = run("inverse", "--robot", robot, "1", "0", "1")
    _, front, rear = out.splitlines()
    assert numbers(front)[-2:] == pytest.approx([np.arctan(0.2), np.degrees(np.arctan(0.2))], abs=6e-3)
    assert numbers(rear)[-2:] == pytest.approx([-np.arctan(0.2), -np.degrees(np.arctan(0.2))], abs=6e-3)


@pytest.mark.parametrize(
    ("limits", "wanted"),
    [
        ("max_speed: 0.8", "limits.max_speed is 0.8 m/s; this needs 1"),
        ("max_lateral_speed: 0.1", "limits.max_lateral_speed is 0.1 m/s; this needs 0.5"),
        ("max_yaw_rate: 1.5", "limits.max_yaw_rate is 1.5 rad/s; this needs 2"),
        ("max_speed: 1, max_lateral_speed: 0.5, max_yaw_rate: 2, max_wheel_speed: 1000", ""),
    ],
)
def test_inverse_says_which_limits_a_twist_does_not_keep(run, tmp_path, limits, wanted):
    robot = tmp_path / "robot.yaml"
    robot.write_text(f"drive: {{type: omni, robot_radius: 0.2, wheel_radius: 0.05}}\nlimits: {{{limits}}}\n")
    code, out, err = run("inverse", "--robot", robot, "-1", "0.5", "-2")
    assert (code, len(out.splitlines())) == (0, 4)
    assert err == (f"trundle: warning: {wanted}\n" if wanted else "")


def test_nothing_is_minus_zero(run):
    for words in (("forward", "--speeds", "-1e-9", "-1e-9"), ("inverse", "-1e-9", "0", "-1e-9")):
        assert re.search(r"-0\.0+\b", run(words[0], "--drive", INLINE, *words[1:])[1]) is None


def test_inverse_warns_of_wheels_that_cannot_turn_so_fast(run, robot):
    robot.write_text(DIFFERENTIAL + "limits: {max_wheel_speed: 15}\n")
    code, out, err = run("inverse", "--robot", robot, "1", "0", "0")
    assert code == 0
    assert "20.000" in out
    assert "max_wheel_speed is 15 rad/s; this needs 20" in err


@pytest.mark.parametrize(
    ("speeds", "twist", "centre"),
    [
        ((21.0, 19.0), (1.0, 0.0, -0.5), "x 0.000 m, y -2.000 m"),
        ((-20.0, -20.0), (-1.0, 0.0, 0.0), "none: it goes straight"),
        ((0.0, 0.0), (0.0, 0.0, 0.0), "none: it stands still"),
    ],
)
def test_forward_prints_a_twist(run, robot, speeds, twist, centre):
    code, out, err = run("forward", "--robot", robot, "--speeds", *speeds)
    assert (code, err) == (0, "")
    lines = dict(line.strip().split("  ", 1) for line in out.splitlines())
    assert [float(lines[name].split()[0]) for name in ("vx", "vy", "omega")] == pytest.approx(twist)
    assert lines["turning centre"].strip() == centre


# --- how it ends --------------------------------------------------------------------------------

USAGE = {
    "no-verb-of-that-name": (["trak"], 'did you mean "track"'),
    "missing-option": (["track", LOG], "trundle track: needs --robot"),
    "missing-number": (["inverse", "1", "2"], "trundle inverse: needs OMEGA"),
    "no-number": (["inverse", "1", "2", "x"], 'unable to convert "x"'),
    "too-much": (["info", LOG, "more"], "takes no further more"),
    "unknown-option": (["info", LOG, "--fast"], "--fast"),
    "no-robot": (["inverse", "1", "0", "0"], "either --robot FILE or --drive TEXT"),
    "two-robots": (["inverse", "1", "0", "0", "--robot", ROBOT, "--drive", INLINE], "either --robot"),
    "typo": (["inverse", "1", "0", "0", "--drive", INLINE.replace("radius", "raduis")], "wheel_radius"),
    "infeasible": (["inverse", "1", "1", "0", "--drive", INLINE], "cannot move sideways"),
    "not-finite": (["inverse", "nan", "0", "0", "--drive", INLINE], "finite"),
    "no-description": (["track", LOG, "--robot", "no.yaml", "-o", "x.tum"], "no.yaml: cannot be read"),
    "bad-suffix": (["track", LOG, "--robot", ROBOT, "-o", "x.txt"], ".tum, .csv"),
    "bad-picture": (["track", LOG, "--robot", ROBOT, "-o", "x.tum", "--plot", "x.gif"], ".png, .svg, .pdf"),
    "bad-distance": (["compare", LOG, LOG, "--distance", "0"], "--distance 0 m, must be > 0"),
    "bad-gap": (["compare", LOG, LOG, "--max-gap=-1"], "--max-gap -1 s, must be > 0"),
    "bad-offset": (["compare", LOG, LOG, "--time-offset", "nan"], "--time-offset nan s, must be finite"),
    "bad-choice": (["compare", LOG, LOG, "--align", "worst"], "worst"),
}  # fmt: skip


@pytest.mark.parametrize("case", USAGE)
def test_usage_and_configuration_errors(run, monkeypatch, tmp_path, case):
    monkeypatch.chdir(tmp_path)
    words, wanted = USAGE[case]
    code, out, err = run(*words)
    assert (code, out) == (ExitCode.USAGE, "")
    assert wanted.lower() in err.lower()
    assert err.startswith("trundle")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("content", "wanted"),
    [
        (None, "no such file"),
        ("", "holds no bytes"),
        ("time,left.position\n1,2\n", "right.position"),
        ("time,left.position,right.position\n1,nan,2\n2,nan,4\n", "no sample was accepted: 2 nonfinite"),
        ("time;left.position;right.position\n1;1;1\n2;2;2\n", "it has 1 column: time;left"),
        ("time;left.position;right.position\n1;1;1\n2;2;2\n", 'declare log.table.delimiter: ";"'),
        ("0,1,1\n1,2,2\n", "declare log.table.header: false; trundle info proposes the whole section"),
        ("time,a,b\n1,1,1\n2,2,2\n", "log.wheels can say which it is; trundle info proposes"),
        (SHUFFLED, "(--sort) puts all rows in order: right where rows were shuffled"),
        (SHUFFLED.replace(".0,", "000000,"), "declare log.time.unit: us?"),
    ],
)
def test_data_errors(run, tmp_path, robot, content, wanted):
    log, output = tmp_path / "run.csv", tmp_path / "run.tum"
    if content is not None:
        log.write_text(content)
    code, out, err = run("track", log, "--robot", robot, "-o", output)
    assert (code, out) == (ExitCode.DATA, "")
    assert wanted in err
    assert str(log) in err
    assert not output.exists()


def test_logs_of_which_nothing_is_accepted(run, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("drive: {type: bicycle, wheelbase: 1.0, wheel_radius: 0.1, max_steering: 30 deg}\n")
    rows = [f"{k},{k},1.0" for k in range(5)]
    log = written(tmp_path / "run.csv", *rows, columns="time,rear.position,front.steering")
    code, _, err = run("track", log, "--robot", robot, "-o", tmp_path / "run.tum")
    assert code == ExitCode.DATA
    assert "no sample was accepted: 5 range" in err


def test_environment_errors(run, tmp_path, monkeypatch, robot):
    log = straight(tmp_path / "run.csv")
    code, _, err = run("track", log, "--robot", robot, "-o", tmp_path / "nowhere" / "run.tum")
    assert code == ExitCode.ENVIRONMENT
    assert "there is no folder" in err
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    code, _, err = run(
        "track", log, "--robot", robot, "-o", tmp_path / "run.tum", "--plot", tmp_path / "run.png"
    )
    assert code == ExitCode.ENVIRONMENT
    assert "pip install 'trundle[plot]'" in err
    assert not (tmp_path / "run.tum").exists()


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (tr.Singular("drive", "no"), 2),
        (tr.ShapeError("no"), 2),
        (tr.Unobservable("no"), 3),
        (tr.LogTruncated("run.mcap", "truncated", "no"), 3),
        (tr.OutputError("no"), 5),
        (tr.MissingExtra("pyarrow", "parquet"), 5),
        (LogError("run.csv", "unreadable", "Permission denied"), 5),
        (PermissionError(13, "no"), 5),
        (MemoryError(), 5),
        (KeyboardInterrupt(), 130),
        (ZeroDivisionError(), 1),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else str(value),
)
def test_every_error_has_its_exit_code(error, code):
    assert exit_code_of(error) == code


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (ZeroDivisionError("oh"), 1, "internal error: ZeroDivisionError: oh"),
        (PermissionError(13, "Permission denied", "a.csv"), 5, "trundle: a.csv: Permission denied"),
        (MemoryError(), 5, "trundle: not enough memory"),
        (KeyboardInterrupt(), 130, "trundle: interrupted"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, BaseException) else "",
)
def test_no_traceback_unless_wanted(run, monkeypatch, error, code, words):
    def fail(*_):
        raise error

    monkeypatch.setattr("trundle.adapters.content.content_of", fail)
    got, _, err = run("info", LOG)
    assert got == code
    assert words in err
    assert "Traceback" not in err
    got, _, err = run("info", LOG, "--debug")
    assert got == code
    assert "Traceback" in err


def test_a_word_that_is_no_command_is_answered_in_one_line(run):
    code, _, err = run("trak")
    assert code == ExitCode.USAGE
    assert err == 'trundle: Unknown command "trak". Did you mean "track"?; see trundle --help\n'


def test_help_and_version(run):
    code, out, _ = run("--version")
    assert (code, out.strip()) == (0, tr.__version__)
    code, out, _ = run("--help")
    assert code == 0
    assert all(verb in out for verb in cli._VERBS)
    for verb in cli._VERBS:
        code, out, err = run(verb, "--help")
        assert (code, err) == (0, "")
        assert cli._VERBS[verb][1] in out
        assert max(map(len, out.splitlines())) <= 80


# --- progress -----------------------------------------------------------------------------------


def test_long_work_shows_progress_on_a_terminal_only(monkeypatch, capsys):
    shown = []
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    monkeypatch.setattr(progress.Progress, "_show", lambda self: shown.append(self._doing))
    for is_terminal in (False, True):
        monkeypatch.setattr(sys.stderr, "isatty", lambda is_terminal=is_terminal: is_terminal)
        with progress.Progress(1) as bar:
            bar.step("reading")
            bar._timer.join(5.0) if is_terminal else None
        assert len(shown) == int(is_terminal)


def test_progress_bar_is_gone_in_the_end(monkeypatch, capsys):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with progress.Progress(2) as bar:
        bar.step("reading [x]")
        bar._show()
        bar.step("writing")
    assert bar._bar.finished is False
    assert not bar._bar.live.is_started


LOADING = """
import sys

class Interrupted:
    def find_spec(self, name, *_):
        if name == "cyclopts":
            raise KeyboardInterrupt

sys.meta_path.insert(0, Interrupted())
from trundle.__main__ import main
sys.exit(main())
"""


def test_an_interrupt_while_loading_gives_no_traceback():
    ended = subprocess.run([sys.executable, "-c", LOADING], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, "trundle: interrupted\n")


def test_help_that_nobody_reads_is_fine():
    reader, writer = os.pipe()
    os.close(reader)
    words = [sys.executable, "-m", "trundle", "calibrate", "--help"]
    ended = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (0, "")


# --- faults -------------------------------------------------------------------------------------

# Stops the program by a signal when half of the new file is written.
STOPPED = """
import signal, sys
from trundle.adapters import tum

# Shells start what runs in the background with this signal ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

def half(trajectory, path):
    path.write_text("0 0 0")
    # To this very thread: another one might take it at leisure, when the file is complete.
    signal.raise_signal(int(sys.argv[1]))

tum.write_tum = half
from trundle.apps.cli import main
sys.exit(main(sys.argv[2:]))
"""


def stopped(number, code):
    def check(folder):
        log, output = straight(folder / "run.csv"), folder / "run.tum"
        output.write_text("old")
        (folder / "robot.yaml").write_text(DIFFERENTIAL)
        words = ["track", log, "--robot", folder / "robot.yaml", "-o", output, "--force"]
        command = [sys.executable, "-c", STOPPED, str(int(number)), *map(str, words)]
        ended = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ended.returncode == code
        assert "Traceback" not in ended.stderr
        assert output.read_text() == "old"
        left = {path.name for path in folder.iterdir()} - {"run.csv", "run.tum", "robot.yaml"}
        assert not left or number == signal.SIGKILL

    return check


def not_stopped(folder):
    """Under nohup a terminal that is gone stops nothing."""
    log, output = straight(folder / "run.csv"), folder / "run.tum"
    (folder / "robot.yaml").write_text(DIFFERENTIAL)
    words = ["track", log, "--robot", folder / "robot.yaml", "-o", output]
    program = STOPPED.replace(
        "import signal, sys", "import signal, sys; signal.signal(signal.SIGHUP, signal.SIG_IGN)"
    )
    command = [sys.executable, "-c", program, str(int(signal.SIGHUP)), *map(str, words)]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0
    assert output.read_text() == "0 0 0"


# Reads and writes through pyarrow, and sees whether that loads pandas, whose import swallows Ctrl-C.
THROUGH_PYARROW = """
import importlib.util, sys
import pyarrow
from trundle.adapters import text_table
from trundle.apps.cli import main

assert importlib.util.find_spec("pandas")
handlers = []
pyarrow.enable_signal_handlers = handlers.append
text_table.WORTH_PYARROW = 0
log, robot, folder = sys.argv[1:]
assert main(["track", log, "--robot", robot, "-o", folder + "/one.parquet"]) == 0
assert main(["convert", folder + "/one.parquet", folder + "/two.parquet"]) == 0
assert "pandas" not in sys.modules
assert set(handlers) == {False}  # its own come too late for short calls
"""


def no_pandas(folder):
    """Ctrl-C works while columns go through pyarrow."""
    (folder / "robot.yaml").write_text(DIFFERENTIAL)
    words = [straight(folder / "run.csv"), folder / "robot.yaml", folder]
    command = [sys.executable, "-c", THROUGH_PYARROW, *map(str, words)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr


def broken_pipe(folder):
    read, write = os.pipe()
    os.close(read)
    ended = subprocess.run(
        [sys.executable, "-m", "trundle", "info", str(LOG)],
        stdout=write,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(write)
    assert (ended.returncode, ended.stderr) == (0, b"")


def no_stdout(folder):
    """The result is written even where nobody can be told."""
    (folder / "robot.yaml").write_text(DIFFERENTIAL)
    log = straight(folder / "run.csv")
    words = f"track {log} --robot {folder / 'robot.yaml'} -o {folder / 'run.tum'}".split()
    command = [sys.executable, "-m", "trundle", *words]
    program = "import os, sys; os.close(1); os.execv(sys.argv[1], sys.argv[1:])"
    ended = subprocess.run([sys.executable, "-c", program, *command], stderr=subprocess.PIPE, check=False)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert len(tr.read_trajectory(folder / "run.tum")) == 20


def full_stdout(folder):
    with Path("/dev/full").open("wb") as full:
        command = [sys.executable, "-m", "trundle", "info", str(LOG)]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert ended.returncode == 5
    assert ended.stderr == b"trundle: No space left on device\n"


def locale(**variables):
    def check(folder):
        (folder / "robot.yaml").write_text("name: Gürteltier\n" + DIFFERENTIAL, encoding="utf-8")
        environment = {key: value for key, value in os.environ.items() if key not in ("LANG", "LC_ALL")}
        ended = subprocess_of(
            "track", straight(folder / "run.csv"), "--robot", folder / "robot.yaml", "-o", folder / "run.tum",
            env=environment | variables,
        )  # fmt: skip
        assert (ended.returncode, ended.stderr) == (0, b"")
        assert b"20 accepted" in ended.stdout
        if "PYTHONIOENCODING" in variables:
            assert b"G\\xfcrteltier" in ended.stdout
            assert b"x +-" in ended.stdout

    return check


def name_without_encoding(folder):
    folder = Path(os.fsdecode(os.fsencode(folder) + b"/\xff\xfe"))
    folder.mkdir()
    (folder / "robot.yaml").write_text(DIFFERENTIAL)
    log, output = straight(folder / "run.csv"), folder / "r\udcffn.tum"
    ended = subprocess_of("track", log, "--robot", folder / "robot.yaml", "-o", output)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert len(tr.read_trajectory(output)) == 20
    ended = subprocess_of("track", log, "--robot", folder / "robot.yaml", "-o", output)
    assert ended.returncode == 2
    assert b"exists; --force replaces it" in ended.stderr


def long_path(folder):
    deep = folder.joinpath(*["d" * 120] * 3)
    deep.mkdir(parents=True)
    (deep / "robot.yaml").write_text(DIFFERENTIAL)
    log, output = straight(deep / "run.csv"), deep / ("o" * 251 + ".tum")
    assert len(str(output)) > 600
    assert main(["track", str(log), "--robot", str(deep / "robot.yaml"), "-o", str(output)]) == 0
    assert len(tr.read_trajectory(output)) == 20


def output_is_there(folder):
    (folder / "robot.yaml").write_text(DIFFERENTIAL)
    log = straight(folder / "run.csv")
    (folder / "old.tum").write_text("old")
    (folder / "old.png").write_text("old")
    (folder / "link.csv").symlink_to("run.csv")
    (folder / "hard.csv").hardlink_to(log)
    (folder / "input.png").write_text("a reference")
    before = log.read_bytes()
    for outputs in (
        ["-o", "old.tum"],
        ["-o", "run.csv"],
        ["-o", "link.csv"],
        ["-o", "new.tum", "--plot", "old.png"],
    ):
        words = [f"{folder / word}" if "." in word else word for word in outputs]
        assert main(["track", str(log), "--robot", str(folder / "robot.yaml"), *words]) == 2
    for outputs in (
        ["-o", "run.csv"],
        ["-o", "link.csv"],
        ["-o", "hard.csv"],
        ["-o", "new.tum", "--plot", "input.png"],
    ):
        words = [f"{folder / word}" if "." in word else word for word in outputs]
        words += ["--force", "--reference", str(folder / "input.png")] if "--plot" in words else ["--force"]
        assert main(["track", str(log), "--robot", str(folder / "robot.yaml"), *words]) == 2
    assert log.read_bytes() == before
    assert (folder / "old.tum").read_text() == (folder / "old.png").read_text() == "old"
    assert not (folder / "new.tum").exists()
    words = ["-o", str(folder / "old.tum"), "--plot", str(folder / "old.png"), "--force"]
    assert main(["track", str(log), "--robot", str(folder / "robot.yaml"), *words]) == 0
    assert len(tr.read_trajectory(folder / "old.tum")) == 20
    assert (folder / "old.png").read_bytes().startswith(b"\x89PNG")


def output_is_an_input(folder):
    """Neither the reference that the description names is replaced nor a part of a recording."""
    log, truth, robot = straight(folder / "run.csv"), folder / "truth.csv", folder / "robot.yaml"
    robot.write_text(DIFFERENTIAL + "log: {reference: {file: truth.csv, columns: [x, y, theta]}}\n")
    (folder / "plain.yaml").write_text(DIFFERENTIAL)
    about = robot.read_bytes()
    words = ["track", str(log), "--robot", str(folder / "plain.yaml"), "-o", str(truth)]
    assert main(words) == 0
    before = truth.read_bytes()
    for words in (
        ["track", log, "--robot", robot, "-o", truth],
        ["convert", log, truth, "--robot", robot],
        ["calibrate", log, "--robot", robot, "-o", robot],
    ):
        assert main([*map(str, words), "--force"]) == 2
    assert (truth.read_bytes(), robot.read_bytes()) == (before, about)
    assert main(["track", str(log), "--robot", str(robot), "-o", str(folder / "new.csv")]) == 0

    bag = folder / "bag"
    bag.mkdir()
    (bag / "run.mcap").write_bytes(b"a recording")
    (folder / "link").symlink_to(bag)
    for source in (bag, folder / "link"):
        for name in ("run.mcap", "new.mcap"):
            words = ["track", str(source), "--robot", str(robot), "-o", str(bag / name), "--force"]
            assert main(words) == 2
    assert [(path.name, path.read_bytes()) for path in bag.iterdir()] == [("run.mcap", b"a recording")]


def one_file_twice(folder):
    (folder / "robot.yaml").write_text(DIFFERENTIAL)
    log, both = straight(folder / "run.csv"), folder / "run.svg"
    words = ["track", str(log), "--robot", str(folder / "robot.yaml")]
    assert (
        main([*words, "-o", str(both.with_suffix(".tum")), "--plot", str(both), "--reference", str(log)]) == 3
    )
    assert not both.exists()


FAULTS = {
    "X2-command-interrupt": stopped(signal.SIGINT, 130),
    "X2-command-terminate": stopped(signal.SIGTERM, 143),
    "X2-command-hang-up": stopped(signal.SIGHUP, 129),
    "X2-command-nohup": not_stopped,
    "X2-command-pyarrow": no_pandas,
    "X2-command-kill": stopped(signal.SIGKILL, -9),
    "X3-command-pipe": broken_pipe,
    "X3-command-closed": no_stdout,
    "X3-command-full": full_stdout,
    "X3-command-c": locale(LANG="C", LC_ALL="C"),
    "X3-command-ascii": locale(PYTHONIOENCODING="ascii", PYTHONUTF8="0"),
    "X3-command-name": name_without_encoding,
    "X3-command-long": long_path,
    "X4-command-output": output_is_there,
    "X4-command-input": output_is_an_input,
    "X4-command-failure": one_file_twice,
}


@pytest.mark.parametrize("check", [pytest.param(check, id=row) for row, check in FAULTS.items()])
def test_fault(tmp_path, check):
    check(tmp_path)
