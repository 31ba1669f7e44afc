"""What an interactive session shows of the nouns: one line that says what they are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trundle as tr

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "differential"
FIXED = [tr.Wheel(name, 0.0, y, 0.05) for name, y in (("a", 0.1), ("b", -0.1))]


@pytest.mark.parametrize(
    ("drive", "text"),
    [
        (
            tr.Differential(track_width=0.2, wheel_radius=0.05),
            "Differential(track_width=0.2, wheel_radius=0.05)",
        ),
        (tr.Bicycle(wheelbase=0.3, wheel_radius=0.05), "Bicycle(wheelbase=0.3, wheel_radius=0.05)"),
        (tr.Custom(wheels=FIXED), "<Custom: a, b>"),
        (tr.Kinematics(FIXED), "<Kinematics: a, b>"),
    ],
)
def test_drives(drive, text):
    assert repr(drive) == text


def test_robots():
    drive = tr.Differential(track_width=0.2, wheel_radius=0.05)
    assert repr(tr.Robot(drive=drive)) == f"<Robot 'robot': {drive!r}>"
    robot = tr.load_robot(EXAMPLE / "robot.yaml").with_localizer(tr.Custom(wheels=FIXED))
    assert repr(robot).startswith("<Robot 'rover': Differential(")
    assert repr(robot).endswith(", measured by <Custom: a, b>; encoders, limits, noise>")


def test_records():
    robot = tr.load_robot(EXAMPLE / "robot.yaml")
    log = tr.read_log(EXAMPLE / "run.csv", robot)
    assert repr(log) == f"<WheelLog of {len(log)} rows, 61.9 s: ticks of left, right; reference>"
    trajectory = tr.integrate(robot, log)
    text = f"{len(log)} poses, 61.9 s, {trajectory.distance:.6g} m: base_link in odom, twists, covariances"
    assert repr(trajectory) == f"<Trajectory of {text}>"
    twists = tr.WheelLog(time_ns=[0, 1], twists=np.zeros((2, 3)), rejected={"parse": 3}, warnings=("so",))
    assert repr(twists) == "<WheelLog of 2 rows, 1e-09 s: twists; 3 rejected; 1 warned of>"
    few = tr.Trajectory(time_ns=[0], poses=np.zeros((1, 3)), rejected={"parse": 3})
    assert repr(few) == "<Trajectory of 1 pose, 0 s, 0 m: base_link in odom, 3 rejected>"
