"""Make the logs beside this file: drives of a robot whose real numbers its description does not know.

    python examples/calibrate/make_logs.py [FOLDER]

Three drives under a camera that sees a marker on the robot and is 60 ms late; and four that only a tape
measure saw: two metres straight on, twice, and three turns on the spot, once either way.
"""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path

import numpy as np

import trundle as tr
from trundle.adapters.robot_yaml import load_robot
from trundle.geometry import se2
from trundle.simulate import Course, arc, figure_eight, simulate, spin, square, stop, straight

HERE = Path(__file__).parent
TURN = math.tau
RATE = 20.0  # rows per second [Hz]

TRUE_DRIVE = tr.Differential(track_width=0.2061, wheel_radius={"left": 0.04132, "right": 0.04165})
NOISE = tr.Noise(wheel_distance=0.002, lateral_slip=0.002)
MARKER = (0.034, -0.012, math.radians(3.0))  # where the marker sits on the robot
CAMERA_NOISE = (0.002, 0.002, math.radians(0.4))
CAMERA_DELAY = 0.06  # [s]

CAMERA = {
    "drive_1": Course.of(figure_eight(0.6, 0.4), straight(1.5, 0.4), stop(0.5)),
    "drive_2": Course.of(square(1.2, 0.4, yaw_rate=1.2), spin(-TURN / 4, 1.2), straight(1.0, 0.4)),
    "drive_3": Course.of(
        square(1.0, 0.4, yaw_rate=1.2, clockwise=True), arc(0.5, TURN, 0.4), straight(0.8, 0.4)
    ),
}
TAPE = {
    "roll_1": Course.of(straight(2.0, 0.4)),
    "spin_left": Course.of(spin(3 * TURN, 1.5)),
    "roll_2": Course.of(straight(2.0, 0.3)),
    "spin_right": Course.of(spin(-3 * TURN, 1.5)),
}


def drives() -> dict[str, tr.WheelLog]:
    """All logs by name."""
    robot = load_robot(HERE / "robot.yaml").replace(drive=TRUE_DRIVE, noise=NOISE)
    logs = {}
    for seed, (name, course) in enumerate({**CAMERA, **TAPE}.items()):
        log = simulate(robot, course, rate=RATE, seed=seed)
        seen = _seen(log.reference, seed) if name in CAMERA else None
        logs[name] = dataclasses.replace(log, reference=seen)
    return logs


def _seen(truth: tr.Trajectory, seed: int) -> tr.Trajectory:
    """What the camera says at each row: where the marker was a little earlier, about."""
    seconds = 1e-9 * truth.time_ns
    x, y, theta = (np.interp(seconds - CAMERA_DELAY, seconds, column) for column in truth.poses.T)
    poses = se2.compose(np.stack([x, y, theta], axis=-1), np.array(MARKER))
    poses = poses + np.random.default_rng([seed, 7]).normal(0.0, CAMERA_NOISE, poses.shape)
    poses[:, 2] = se2.wrap(poses[:, 2])
    return dataclasses.replace(truth, poses=np.round(poses, 4) + 0.0, twists=None)


def main(folder: Path = HERE) -> None:
    """Write all logs."""
    for name, log in drives().items():
        path = folder / f"{name}.csv"
        tr.write_log(log, path, force=True)
        text = path.read_text(encoding="utf-8").replace("reference.", "camera.", 3)
        path.write_text(text, encoding="utf-8", newline="\n")
        print(f"{path}: {len(log)} rows, {log.duration:.0f} s, {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2]))
