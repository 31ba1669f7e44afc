"""Make the logs beside this file: one drive of each robot, with the truth in its reference columns.

    python examples/simulate.py [FOLDER]

The same seeds make the same bytes on every machine: what is written is rounded to what sensors resolve.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np

from trundle.adapters.robot_yaml import load_robot
from trundle.adapters.wheel_log_csv import write_log
from trundle.records import WheelLog
from trundle.simulate import Course, arc, figure_eight, glide, simulate, slalom, slide, spin, stop, straight

HERE = Path(__file__).parent
TURN = math.tau

COURSES = {
    # A figure eight, then a ring about it and home: 29 m.
    "differential": Course.of(
        figure_eight(0.8, 0.45),
        straight(1.0, 0.45),
        arc(0.8, TURN / 4, 0.45),
        straight(0.6, 0.45),
        arc(0.8, TURN / 4, 0.45),
        straight(2.0, 0.45),
        arc(0.8, TURN / 4, 0.45),
        straight(2.8, 0.45),
        arc(0.8, TURN / 4, 0.45),
        straight(2.0, 0.45),
        arc(0.8, TURN / 4, 0.45),
        straight(0.6, 0.45),
        arc(0.8, TURN / 4, 0.45),
        straight(1.0, 0.45),
        blend=0.6,
    ),
    # A square without turning, across it while turning once, a figure eight, and home.
    "mecanum": Course.of(
        slide(2.4, 0.0, 0.5),
        slide(0.0, 2.4, 0.5),
        slide(-2.4, 0.0, 0.5),
        slide(0.0, -2.4, 0.5),
        stop(0.5),
        glide(3.394, 0.4, yaw_rate=TURN * 0.4 / 3.394, direction=TURN / 8),
        stop(0.5),
        figure_eight(1.2, 0.5),
        slide(-2.4, -2.4, 0.5),
        spin(-TURN / 2, 1.0),
        blend=0.8,
    ),
    # Three laps of a small race track, with a slalom on its long side, and back into the box.
    "ackermann": Course.of(
        *[
            straight(2.0, 1.2),
            slalom(4.0, 1.2, heading=0.45, wavelength=2.0),
            arc(0.9, TURN / 2, 1.0),
            straight(1.0, 1.2),
            arc(0.8, -TURN / 4, 1.0),
            arc(0.8, TURN / 2, 1.0),
            arc(0.8, -TURN / 4, 1.0),
            straight(1.7, 1.2),
            arc(0.9, TURN / 2, 1.0),
        ]
        * 3,
        stop(1.0),
        arc(0.9, -TURN / 8, -0.6),
        blend=0.5,
    ),
    # A figure eight, a square that turns a quarter along every side, a slalom and sideways home.
    "swerve": Course.of(
        figure_eight(1.5, 1.0),
        stop(0.5),
        [glide(4.0, 1.0, yaw_rate=TURN / 16)] * 4,
        stop(0.5),
        slalom(6.0, 1.0, heading=0.6, wavelength=3.0),
        spin(TURN / 4, 1.0),
        slide(2.0, 2.0, 1.0),
        slide(0.0, 4.0, 1.0),
        blend=0.8,
    ),
}
RATES = {"differential": 30.0, "mecanum": 30.0, "ackermann": 40.0, "swerve": 30.0}
SEEDS = {"differential": 4, "mecanum": 1, "ackermann": 1, "swerve": 1}


def example(name: str) -> WheelLog:
    """The log of one robot, rounded: truth to a micrometre, angles and rates to 0.0001."""
    robot = load_robot(HERE / name / "robot.yaml")
    log = simulate(robot, COURSES[name], rate=RATES[name], seed=SEEDS[name])
    assert log.reference is not None
    return dataclasses.replace(
        log,
        steering=None if log.steering is None else np.round(log.steering, 4),
        yaw_rate=None if log.yaw_rate is None else np.round(log.yaw_rate, 4),
        # Adding zero turns -0.0 into 0.0.
        reference=dataclasses.replace(log.reference, poses=np.round(log.reference.poses, 6) + 0.0),
    )


def main(folder: Path = HERE) -> None:
    """Write all logs."""
    for name in COURSES:
        log, path = example(name), folder / name / "run.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_log(log, path, force=True)
        print(f"{path}: {len(log)} rows, {log.duration:.0f} s, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
