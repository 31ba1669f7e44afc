"""`trundle plan`: what drives would tell, before they are driven."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from trundle.apps.cli import main
from trundle.apps.course_words import COURSES, course_of
from trundle.errors import InputError

ROBOT = Path(__file__).resolve().parents[1] / "examples" / "calibrate" / "robot.yaml"


@pytest.fixture
def run(capsys):
    """Run a command; its exit code, and what it said on stdout and stderr."""

    def run(*words):
        code = main([str(word) for word in words])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def sigmas(out):
    """By parameter, the predicted sigma in the unit that is shown."""
    return {name: float(value) for name, value in re.findall(r"^  ([\w.+ ]+?) +±([\d.]+)", out, re.MULTILINE)}


def test_more_turns_tell_more(run):
    words = ("--robot", ROBOT, "--no-clock", "--no-mounting")
    code, few, _ = run("plan", "straight 2, spin 1, spin -1", *words)
    assert code == 0
    _, many, _ = run("plan", "straight 2, spin 1, spin -1", "straight 2, spin 4, spin -4", *words)
    assert sigmas(many)["track_width"] < 0.8 * sigmas(few)["track_width"]
    assert {"wheel_radius.left", "wheel_radius.right"} <= set(sigmas(few))


def test_a_course_that_says_too_little_is_refused(run):
    code, _, err = run("plan", "spin 2", "--robot", ROBOT, "--reference", "tape")
    assert code == 3
    assert "3 are looked for: wheel_radius.left, wheel_radius.right, track_width" in err
    assert "--parameters track_width" in err


def test_jitter_of_wheels_is_no_turn_and_less_may_be_asked_for(run, tmp_path):
    robot = tmp_path / "robot.yaml"
    robot.write_text(ROBOT.read_text() + "\nnoise: {wheel_distance: 0.01}\n")
    words = ("--robot", robot, "--no-mounting", "--no-clock")
    code, _, err = run("plan", "straight 10", *words)
    assert code == 3
    (degrees,) = re.findall(r"hardly turn \((\d+) degrees over 10.0 m\)", err)
    assert int(degrees) < 40
    code, out, _ = run("plan", "straight 10", *words, "--parameters", "wheel_radius")
    assert code == 0
    assert sigmas(out)["wheel_radius"] > 0.0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "no course is given; one is of straight METRES, slide FORWARD LEFT"),
        (["strait 2"], "course: 'strait 2', did you mean 'straight'?"),
        (["arc 2"], "course: 'arc 2', must be arc RADIUS TURNS"),
        (["spin two"], "course: 'spin two': two must be plain numbers"),
        (["slide 1 1"], "course: 'slide 1 1': a differential drive cannot move so; slide is for drives that"),
        (["spin 0"], "course: 'spin 0': angle: 0, must be > 0"),
        (["straight 2, spin 1", "--reference", "tape"], "a tape measure knows one straight, one spin"),
        (["spin 1", "--position-noise", "2 kg"], "--position-noise"),
    ],
)
def test_what_is_no_plan(run, words, complaint):
    code, _, err = run("plan", *words, "--robot", ROBOT)
    assert code == 2
    assert complaint in err


@pytest.mark.parametrize(
    ("text", "end"),
    [
        ("straight 2", (2.0, 0.0, 0.0)),
        ("slide 1 2", (1.0, 2.0, 0.0)),
        ("spin -1.5", (0.0, 0.0, -3 * math.pi)),
        ("arc 2 0.25", (2.0, 2.0, math.pi / 2)),
        ("square -1", (0.0, 0.0, -2 * math.pi)),
        ("eight 0.5", (0.0, 0.0, 0.0)),
        ("straight 1, spin 0.25, straight 1", (1.0, 1.0, math.pi / 2)),
    ],
)
def test_courses_end_where_their_words_say(text, end):
    course = course_of(text, speed=0.5, yaw_rate=1.0)
    time = np.linspace(0.0, course.duration, 20_001)
    twists, dt = course.at(time), time[1]
    heading = np.cumsum(twists[:, 2]) * dt
    x = np.sum(np.cos(heading) * twists[:, 0] - np.sin(heading) * twists[:, 1]) * dt
    y = np.sum(np.sin(heading) * twists[:, 0] + np.cos(heading) * twists[:, 1]) * dt
    assert heading[-1] == pytest.approx(end[2], abs=0.01)
    assert (x, y) == pytest.approx(end[:2], abs=0.15)  # corners are cut a little


def test_a_course_needs_a_word():
    with pytest.raises(InputError, match="a course needs at least one of straight METRES"):
        course_of(" , ", speed=0.5, yaw_rate=1.0)


def test_help_holds_every_word_of_a_course_with_lines_as_long_as_they_can_be(run):
    code, said, _ = run("plan", "--help")
    assert code == 0
    assert f"Of {COURSES};" in " ".join(said.replace("│", " ").split())
    assert "eight RADIUS;" in said  # no line ends in the middle of its own
