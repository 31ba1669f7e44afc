"""Gains, offsets and delays of robot.yaml's log section, as they reach the readings."""

from __future__ import annotations

import numpy as np
import pytest

import trundle as tr
from trundle.adapters.robot_yaml import load_robot, robot_text
from trundle.errors import ConfigError

CAR = """\
drive: {type: bicycle, wheelbase: 0.3, wheel_radius: 0.03}
log:
  steering: {front: {column: servo, gain: 0.5, offset: 3 deg}}
  gyro: {column: gyr, gain: 0.98, offset: -0.01}
  reference: {columns: [x, y, theta], delay: 0.04}
"""
ROWS = "time,rear.position,servo,gyr,x,y,theta\n0,0,0.2,0.1,0,0,0\n0.1,1,-0.4,0.2,0.03,0,0.1\n"


@pytest.fixture
def car(tmp_path):
    """The robot that a text describes."""

    def load(text=CAR):
        (tmp_path / "robot.yaml").write_text(text)
        return load_robot(tmp_path / "robot.yaml")

    return load


def test_readings_become_what_was_so(car, tmp_path):
    (tmp_path / "run.csv").write_text(ROWS)
    log = tr.read_log(tmp_path / "run.csv", car())
    np.testing.assert_allclose(log.steering[:, 0], [0.1 + np.radians(3), -0.2 + np.radians(3)], rtol=1e-15)
    np.testing.assert_allclose(log.yaw_rate, [0.98 * 0.1 - 0.01, 0.98 * 0.2 - 0.01], rtol=1e-15)
    assert log.reference.time_ns.tolist() == [-40_000_000, 60_000_000]
    assert log.time_ns.tolist() == [0, 100_000_000]


def test_what_is_not_off_is_not_touched(car, tmp_path):
    (tmp_path / "run.csv").write_text(ROWS)
    plain = CAR.replace(", gain: 0.5, offset: 3 deg", "").replace(", gain: 0.98, offset: -0.01", "")
    log = tr.read_log(tmp_path / "run.csv", car(plain.replace(", delay: 0.04", "")))
    assert log.steering[:, 0].tolist() == [0.2, -0.4]
    assert log.yaw_rate.tolist() == [0.1, 0.2]
    assert log.reference.time_ns.tolist() == log.time_ns.tolist()


def test_written_and_read_back(car):
    text = robot_text(car())
    assert robot_text(car(text)) == text
    assert "gain: 0.5" in text
    assert "delay: 0.04" in text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("gain: 0.5", "gain: 0", r"log\.steering\.front\.gain: 0, must be > 0"),
        ("offset: -0.01", "offset: .inf", r"log\.gyro\.offset: inf, must be finite"),
        ("delay: 0.04", "delay: 1700", r"log\.reference\.delay: 1700 s, must be within 60 s"),
        (
            "log:",
            "log:\n  wheels: {rear: {column: a, gain: 2}}",
            r"log\.wheels\.rear\.gain: 2: a wheel has none",
        ),
    ],
)
def test_what_is_refused(car, old, new, words):
    with pytest.raises(ConfigError, match=words):
        car(CAR.replace(old, new, 1))


CART = "name: cart\ndrive: {type: differential, track_width: 0.2, wheel_radius: 0.04}\n"
RECORDS = {
    "{version: 0, robot: cart, other: 1}": "calibration.version: 0, must be 1: another Trundle wrote it",
    "{robot: cart}": "calibration.version: missing, must be 1",
    "{version: 1, robot: rover}": "calibration.robot: 'rover', but this robot is 'cart'",
    "{version: 1, robot: cart, sigmas: {track_width: 0}}": "calibration.sigmas.track_width: 0, must be > 0",
}


@pytest.mark.parametrize("record", [pytest.param(one, id=f"C12-{k}") for k, one in enumerate(RECORDS)])
def test_fault(car, record):
    """C12: results of an older schema, or of another robot."""
    with pytest.raises(ConfigError, match=RECORDS[record]):
        car(f"{CART}calibration: {record}\n")


def test_record_of_a_calibration_is_kept(car):
    robot = car(CART + "calibration: {version: 1, robot: cart, sigmas: {wheel_radius.left: 1.0e-05}}\n")
    assert robot.calibration.sigmas == {"wheel_radius.left": 1e-5}
    assert car(robot_text(robot)).calibration == robot.calibration
