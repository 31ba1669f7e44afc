"""`trundle calibrate`: what it says, what it writes, and when it refuses to.

The first tests put known numbers in the place of the estimator: they are about the edges alone.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

import trundle as tr
import trundle.calibrate
from trundle.adapters.robot_yaml import load_robot
from trundle.adapters.ros2_controllers import robot_from_controllers
from trundle.apps.calibration_runs import Drives
from trundle.apps.cli import main
from trundle.calibrate import Calibration, Estimate, RunFit, Unobserved
from trundle.errors import InputError
from trundle.evaluate import compare, transform
from trundle.geometry import se2

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "calibrate"
ROBOT = EXAMPLE / "robot.yaml"
CAMERA = [EXAMPLE / f"drive_{k}.csv" for k in (1, 2, 3)]


def example():
    """The script that made the example's logs, and knows the truth."""
    spec = importlib.util.spec_from_file_location("make_logs", EXAMPLE / "make_logs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TRUTH = example()


@pytest.fixture
def run(capsys):
    """Run a command; its exit code, and what it said on stdout and stderr."""

    def run(*words):
        code = main([str(word) for word in words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


# --------------------------------------------------------------- edges, with known numbers


def path_of(drive, described, one, mounting):
    path = tr.integrate(described.replace(drive=drive), one.log, covariance=False)
    path = dataclasses.replace(path, poses=se2.compose(path.poses, np.array(mounting)), twists=None)
    return transform(path, compare(path, one.reference).alignment)


def known(drive=TRUTH.TRUE_DRIVE, **changes):
    """What stands in for the estimator: it knows the drive."""

    def calibrate(described, runs, **_options):
        before, after = described.drive, drive
        numbers = [
            ("track_width", before.parameters["track_width"], after.parameters["track_width"], 2e-4),
            *(
                (f"wheel_radius.{name}", before.wheel(name).radius, after.wheel(name).radius, 2e-5)
                for name in ("left", "right")
            ),
        ]
        estimates = [Estimate(name, "m", old, new, sigma) for name, old, new, sigma in numbers]
        places = zip("x y theta".split(), ("m", "m", "rad"), TRUTH.MARKER, strict=True)
        estimates += [Estimate(f"reference.{part}", unit, 0.0, value, 1e-3) for part, unit, value in places]
        estimates += [Estimate("clock", "s", 0.0, TRUTH.CAMERA_DELAY, 1e-3)]
        poses = [one for one in runs if isinstance(one.reference, tr.Trajectory)]
        fits = [
            RunFit(
                one.name,
                path_of(before, described, one, (0, 0, 0)),
                path_of(after, described, one, TRUTH.MARKER),
                one.reference,
                np.random.default_rng(1).standard_t(4, (300, 3)),
            )
            for one in poses
        ]
        found = Calibration(
            robot=described.replace(drive=after),
            estimates=tuple(estimates),
            covariance=np.diag([one.sigma**2 for one in estimates]),
            chi2_per_dof=1.02,
            condition=2300.0,
            samples=1000,
            inliers=990,
            unobserved=(Unobserved(("gyro.bias",), "the logs hold no gyro", "log it while standing"),),
            fits=tuple(fits),
            warnings=("drive_2: the reference jumped <once>",),
        )
        return dataclasses.replace(found, **changes)

    return calibrate


@pytest.fixture
def estimator(monkeypatch):
    """Put known numbers in the place of the estimator."""

    def put(*args, **changes):
        monkeypatch.setattr(trundle.calibrate, "calibrate", known(*args, **changes), raising=False)

    put()
    return put


def test_it_says_what_was_found_and_how_sure_that_is(run, estimator):
    code, out, err = run("calibrate", *CAMERA, "--robot", ROBOT)
    assert code == 0
    assert re.search(r"track_width \[mm\] +200\.00 +206\.10 +±0\.20 +\+3\.05 %", out)
    assert re.search(r"wheel_radius\.left \[mm\] +42\.000 +41\.320 +±0\.020 +-1\.62 %", out)
    assert re.search(r"reference\.theta \[deg\] +0\.000 +3\.000 +±0\.057\n", out)
    assert re.search(r"clock \[ms\] +0\.0 +60\.0 +±1\.0\n", out)
    assert "chi-square per degree of freedom 1.02" in out
    assert "1000 samples, 10 of them outliers (1.0 %)" in out
    assert "- the logs hold no gyro; log it while standing" in out
    assert re.search(r"drive_1 +\d+ mm +\d+\.\d mm +\d+\.\d+  ATE", out)
    assert "Better: 3 runs that were held out are explained" in out
    assert err == "trundle: warning: drive_2: the reference jumped <once>\n"
    assert max(map(len, out.splitlines())) <= 100


def test_the_description_is_written_with_its_comments(run, estimator, tmp_path):
    output = tmp_path / "robot.calibrated.yaml"
    code, out, _ = run("calibrate", *CAMERA, "--robot", ROBOT, "-o", output)
    assert code == 0
    assert f"robot  {output}" in out
    text = output.read_text(encoding="utf-8")
    assert re.search(
        r"track_width: 0\.2061 +# between the wheels' contacts, by ruler; calibrated: ±0\.20 mm\n", text
    )
    assert "nobody measured where the marker sits" in text
    robot = load_robot(output)
    assert robot.drive.wheel("left").radius == 0.04132
    assert robot.calibration.sigmas["wheel_radius.left"] == 2e-5
    assert robot.noise.wheel_radius == pytest.approx(2e-5 / 0.04132, rel=0.01)
    assert robot.noise.track_width == pytest.approx(2e-4 / 0.2061, rel=0.05)
    assert robot.noise.lateral_slip == load_robot(ROBOT).noise.lateral_slip


def test_numbers_are_rounded_to_what_is_known_of_them(run, estimator, tmp_path):
    radii = {"left": 0.041321234567890123, "right": 0.0416543210987654321}
    estimator(tr.Differential(track_width=0.20614159265358979, wheel_radius=radii))
    output = tmp_path / "robot.yaml"
    assert run("calibrate", *CAMERA, "--robot", ROBOT, "-o", output)[0] == 0
    drive = load_robot(output).drive
    assert drive.parameters["track_width"] == 0.206142
    assert [wheel.radius for wheel in drive.wheels] == [0.0413212, 0.0416543]


def test_numbers_that_are_not_better_are_not_written(run, estimator, tmp_path):
    estimator(tr.Differential(track_width=0.19, wheel_radius=0.043))
    output, report = tmp_path / "robot.yaml", tmp_path / "report.html"
    words = ("calibrate", *CAMERA, "--robot", ROBOT, "-o", output, "--report", report)
    code, _, err = run(*words)
    assert code == 3
    assert "Not better: 3 runs that were held out" in err
    assert f"{output}: not written, these numbers are doubtful; --accept does" in err
    assert not output.exists()
    assert "Not better" in report.read_text(encoding="utf-8")
    assert run(*words, "--accept", "--force")[0] == 0
    assert load_robot(output).drive.parameters["track_width"] == 0.19


def test_doubtful_numbers_are_only_written_when_accepted(run, estimator, tmp_path):
    """B7, at this edge."""
    odd = Estimate("track_width", "m", 0.2, 0.26, 1e-3, doubt="track_width: 30 % from what was described")
    estimator(estimates=(odd,))
    output = tmp_path / "robot.yaml"
    code, _, err = run("calibrate", *CAMERA, "--robot", ROBOT, "-o", output)
    assert (code, output.exists()) == (3, False)
    assert "warning: track_width: 30 % from what was described" in err
    assert run("calibrate", *CAMERA, "--robot", ROBOT, "-o", output, "--accept")[0] == 0


def test_nothing_held_out_is_nothing_known(run, estimator, tmp_path):
    output = tmp_path / "robot.yaml"
    code, _, err = run("calibrate", *CAMERA, "--robot", ROBOT, "-o", output, "--hold-out", "0")
    assert code == 3
    assert "nothing was held out" in err
    code, _, err = run("calibrate", *CAMERA, "--robot", ROBOT, "--hold-out", "1")
    assert code == 2
    assert "--hold-out 1: must be 2 or more groups, or 0" in err


def test_doubtful_numbers_are_said_by_the_exit_code(run, estimator):
    """Also where nobody asked for a file."""
    estimator(tr.Differential(track_width=0.19, wheel_radius=0.043))
    words = ("calibrate", *CAMERA, "--robot", ROBOT)
    assert run(*words)[0] == 3
    assert run(*words, "--accept")[0] == 0


def test_a_drive_is_not_given_twice(run, estimator, tmp_path):
    copy = tmp_path / "copy.csv"
    copy.write_bytes(CAMERA[0].read_bytes())
    for again, words in ((CAMERA[0], "is given twice"), (copy, "is the same drive as")):
        code, _, err = run("calibrate", *CAMERA, again, "--robot", ROBOT)
        assert code == 2
        assert f"{again}: {words}" in err


def test_the_tape_measure_of_the_docs_can_be_held_out(run):
    words = [
        "--rolled",
        "roll_1=2m",
        "--rolled",
        "roll_2=2m",
        "--spun",
        "spin_left=3",
        "--spun",
        "spin_right=-3",
    ]
    logs = [EXAMPLE / f"{name}.csv" for name in ("roll_1", "roll_2", "spin_left", "spin_right")]
    options = ["--robot", ROBOT, "--parameters", "wheel_radius,track_width", "--hold-out", "2"]
    code, out, _ = run("calibrate", *logs, *options, *words)
    assert code == 0
    assert "Better: 4 runs that were held out" in out


def test_a_single_run_of_a_tape_measure_is_judged_by_nothing(run):
    code, _, err = run("calibrate", EXAMPLE / "roll_1.csv", "--robot", ROBOT, "--rolled", "2m")
    assert code == 3
    assert "look for less (--parameters wheel_radius)" in err
    words = ("--rolled", "2m", "--parameters", "wheel_radius")
    code, _, err = run("calibrate", EXAMPLE / "roll_1.csv", "--robot", ROBOT, *words)
    assert code == 3
    assert "there is no run beside roll_1 to judge it by: drive it twice" in err


def test_the_page_s_python_runs_on_the_example(tmp_path):
    page = (Path(__file__).resolve().parents[1] / "docs" / "calibrate.md").read_text(encoding="utf-8")
    code = textwrap.dedent(page.split("## From Python")[1])
    for source, name in (
        ("robot.yaml", "robot.yaml"),
        ("drive_1.csv", "drive.csv"),
        ("roll_1.csv", "roll.csv"),
    ):
        (tmp_path / name).write_bytes((EXAMPLE / source).read_bytes())
    told = "print(*(one.value for one in found.estimates if one.name == 'track_width'))"
    command = [sys.executable, "-c", code + told]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert float(ended.stdout) == pytest.approx(TRUTH.TRUE_DRIVE.parameters["track_width"], abs=2e-3)


def test_a_plain_gyro_is_each_log_s_own():
    drives = Drives([Path("a.csv"), Path("b.csv")], reference=["gyro"])
    assert drives.files == []
    with pytest.raises(InputError, match="of which of the 2 logs"):
        Drives([Path("a.csv"), Path("b.csv")], reference=["truth.tum"])


def test_a_single_log_is_judged_by_its_halves(run, estimator):
    code, out, _ = run("calibrate", CAMERA[0], "--robot", ROBOT)
    assert code == 0
    assert "first half of drive_1" in out
    assert "second half of drive_1" in out


def test_runs_are_held_out_by_folder(run, estimator, tmp_path):
    logs = []
    for k, log in enumerate(CAMERA):
        folder = tmp_path / ("hall" if k < 2 else "yard")
        folder.mkdir(exist_ok=True)
        logs.append(folder / log.name)
        logs[-1].write_bytes(log.read_bytes())
    without = []
    calibrate = trundle.calibrate.calibrate

    def noting(described, runs, **options):
        without.append([one.name for one in runs])
        return calibrate(described, runs, **options)

    trundle.calibrate.calibrate = noting  # undone by the fixture
    assert run("calibrate", *logs, "--robot", ROBOT)[0] == 0
    assert without == [["drive_1", "drive_2", "drive_3"], ["drive_3"], ["drive_1", "drive_2"]]


def test_other_tools_get_the_same_numbers(run, estimator, tmp_path):
    ros2, mine, java = tmp_path / "c.yaml", tmp_path / "myconfig.py", tmp_path / "DriveNumbers.java"
    outputs = ("--ros2", ros2, "--myconfig", mine, "--wpilib", java)
    code, _, err = run("calibrate", *CAMERA, "--robot", ROBOT, *outputs)
    assert code == 0
    mean = "donkeycar knows one wheel radius: the mean of left 41.32 mm, right 41.65 mm"
    assert f"warning: {mine}: {mean}" in err
    assert f"# {mean}\n" in mine.read_text()
    text = ros2.read_text()
    assert "wheel_separation: 0.2\n" in text
    assert f"wheel_separation_multiplier: {0.2061 / 0.2!r}\n" in text
    assert "wheel_radius: 0.042\n" in text
    assert f"left_wheel_radius_multiplier: {0.04132 / 0.042!r}\n" in text
    drive = robot_from_controllers(ros2).drive
    assert drive.parameters["track_width"] == pytest.approx(0.2061, rel=1e-12)
    assert "AXLE_LENGTH = 0.2061  # m" in mine.read_text()
    assert "public final class DriveNumbers {" in java.read_text()
    assert "kTrackWidth = 0.2061; // m" in java.read_text()


def test_what_another_program_cannot_say_is_refused_before_the_work(run, estimator, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text("drive: {type: tricycle, wheelbase: 0.3, wheel_radius: 0.03}\n")
    output = tmp_path / "out.yaml"
    words = ("calibrate", tmp_path / "no.csv", "--robot", robot, "-o", output)
    code, _, err = run(*words, "--wpilib", tmp_path / "A.java")
    assert code == 2
    assert "tricycle: WPILib has kinematics for differential" in err
    code, _, err = run(*words, "--myconfig", tmp_path / "m.py")
    assert code == 2
    assert "tricycle: donkeycar knows differential drives and cars" in err


def test_report_holds_everything_and_needs_nothing(run, estimator, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text(ROBOT.read_text().replace("name: rover", "name: <script>x</script> & $a_b$"))
    report, picture = tmp_path / "report.html", tmp_path / "paths.svg"
    words = ("calibrate", *CAMERA, "--robot", robot, "--report", report, "--plot", picture)
    assert run(*words)[0] == 0
    page = report.read_text(encoding="utf-8")
    assert "<script" not in page
    assert "Calibration of &lt;script&gt;x&lt;/script&gt; &amp; $a_b$" in page
    assert "the reference jumped &lt;once&gt;" in page
    assert page.count("<svg") == 4
    assert not re.search(r"(src|href|url)\s*[=(]\s*[\"']?(?!#)[a-z]*:?//", page)
    assert "track_width [mm]" in page
    assert page.count("drive_3") >= 3
    assert "<svg" in picture.read_text(encoding="utf-8")
    again = report.read_bytes()
    assert run(*words, "--force")[0] == 0
    assert len(report.read_bytes()) == len(again) + len(" --force") or report.read_bytes() == again


def test_files_that_exist_are_kept(run, estimator, tmp_path):
    output = tmp_path / "robot.yaml"
    output.write_text("mine")
    code, _, err = run("calibrate", *CAMERA, "--robot", ROBOT, "-o", output)
    assert code == 2
    assert "exists; --force replaces it" in err
    assert output.read_text() == "mine"


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "no log is given"),
        ([CAMERA[0], "--rolled", "two"], "--rolled: 'two'"),
        ([CAMERA[0], "--spun", "1e400"], "--spun: inf, must be finite"),
        ([CAMERA[0], "--rolled", "2m", "--spun", "5"], "exclude each other"),
        ([EXAMPLE / "roll_1.csv"], "camera.x"),
        ([CAMERA[0], "-o", "robot.txt"], "must end in one of .yaml, .yml"),
        (
            [CAMERA[0], "--report", "a.html", "--plot", "a.png", "-o", "a.yaml", "--ros2", "a.yaml"],
            "two outputs",
        ),
        ([CAMERA[0], "--reference", "gyro"], "the log holds no gyro"),
    ],
)
def test_what_cannot_be_meant(run, estimator, words, complaint, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, _, err = run("calibrate", *words, "--robot", ROBOT)
    assert code in (2, 3)
    assert complaint in err


def test_without_scipy_it_says_what_to_install(run, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "scipy" else find(name))
    code, _, err = run("calibrate", *CAMERA, "--robot", ROBOT)
    assert code == 5
    assert "pip install 'trundle[calibrate]'" in err


# ------------------------------------------------------------------ the whole way, with the estimator


def test_the_examples_logs_are_what_their_script_makes(tmp_path):
    TRUTH.main(tmp_path)
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert made == {path.name: path.read_bytes() for path in EXAMPLE.glob("*.csv")}


def test_the_example_gets_its_true_numbers(run, tmp_path):
    output = tmp_path / "robot.yaml"
    words = ("calibrate", *CAMERA, "--robot", ROBOT, "-o", output, "--hold-out", "0", "--accept")
    assert run(*words)[0] == 0
    robot = load_robot(output)
    mounting = robot.log.reference.mounting
    found = {
        "track_width": robot.drive.parameters["track_width"],
        "clock": robot.log.reference.delay,
        **{f"wheel_radius.{wheel.name}": wheel.radius for wheel in robot.drive.wheels},
        **{f"reference.{axis}": value for axis, value in zip(("x", "y", "theta"), mounting, strict=True)},
    }
    truth = {
        "track_width": TRUTH.TRUE_DRIVE.parameters["track_width"],
        "clock": TRUTH.CAMERA_DELAY,
        **{f"wheel_radius.{wheel.name}": wheel.radius for wheel in TRUTH.TRUE_DRIVE.wheels},
        **{f"reference.{axis}": value for axis, value in zip(("x", "y", "theta"), TRUTH.MARKER, strict=True)},
    }
    sigmas = robot.calibration.sigmas
    assert set(sigmas) == set(truth)
    scores = {name: (found[name] - truth[name]) / sigmas[name] for name in truth}
    assert max(map(abs, scores.values())) < 3.5, scores
    # Its logs are read with what was found: what was off is no longer.
    log = tr.read_log(CAMERA[0], robot)
    assert compare(tr.integrate(robot, log), log.reference).ate < 0.015


def test_a_tape_measure_is_enough_for_two_numbers(run, tmp_path):
    logs = [EXAMPLE / f"{name}.csv" for name in TRUTH.TAPE]
    rolled = ("--rolled", "roll_1=2m", "--rolled", "roll_2=2m")
    spun = ("--spun", "spin_left=3", "--spun", "spin_right=-3")
    names = ("--parameters", "wheel_radius,track_width", "--hold-out", "2")
    output = tmp_path / "robot.yaml"
    code, out, _ = run("calibrate", *logs, "--robot", ROBOT, *rolled, *spun, *names, "-o", output)
    assert code == 0
    assert "Better: 4 runs" in out
    drive = load_robot(output).drive
    assert drive.wheel("left").radius == pytest.approx((0.04132 + 0.04165) / 2, rel=2e-3)
    assert drive.parameters["track_width"] == pytest.approx(0.2061, rel=5e-3)


def test_a_reference_without_times_is_refused(run, tmp_path):
    """One second per row, as its reader counts them, would be a robot of another speed."""
    log = tr.read_log(CAMERA[1], load_robot(ROBOT))
    tr.write_trajectory(log.reference, tmp_path / "truth.kitti")
    code, out, err = run("calibrate", CAMERA[1], "--robot", ROBOT, "--reference", tmp_path / "truth.kitti")
    assert (code, out) == (2, "")
    assert "the reference has no times (KITTI files do not)" in err


def test_a_trajectory_in_a_file_is_a_reference(run, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text(ROBOT.read_text().partition("log:")[0])
    log = tr.read_log(CAMERA[1], load_robot(ROBOT))
    tr.write_trajectory(log.reference, tmp_path / "truth.tum")
    words = (
        "--reference",
        tmp_path / "truth.tum",
        "--hold-out",
        "0",
        "--parameters",
        "wheel_radius,track_width",
    )
    code, out, err = run("calibrate", CAMERA[1], "--robot", robot, *words)
    assert code == 0, err
    assert re.search(r"reference\.x \[mm\] +0\.0+ +3\d\.\d", out)
