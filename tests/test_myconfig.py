"""donkeycar's myconfig.py: what it says, without running it, and back."""

from __future__ import annotations

import math

import pytest

import trundle as tr
from trundle.adapters.myconfig import myconfig_text, read_myconfig, robot_from_myconfig
from trundle.adapters.robot_yaml import load_robot, save_robot
from trundle.errors import ConfigError, InputError

CAR = """
import math
AXLE_LENGTH = 0.15      # Distance between left/right wheels (m)
WHEEL_BASE = 0.3        # Distance between front/back wheels (m)
WHEEL_RADIUS = 0.0315   # Wheel radius (m)
MIN_SPEED = 0.1
MAX_SPEED = 3.0
MAX_STEERING_ANGLE = math.pi / 4
ENCODER_PPR = 20
MM_PER_TICK = WHEEL_RADIUS * 2 * math.pi * 1000 / ENCODER_PPR
"""


@pytest.fixture
def written(tmp_path):
    def write(text, name="myconfig.py"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_car(written):
    robot = robot_from_myconfig(written(CAR))
    assert isinstance(robot.drive, tr.Bicycle)
    assert robot.drive.measured_names == ("front",)
    assert (robot.drive.wheel("front").x, robot.drive.wheel("front").radius) == (0.3, 0.0315)
    limits = robot.limits
    assert (limits.min_speed, limits.max_speed, limits.max_steering) == (0.1, 3.0, math.pi / 4)
    assert robot.encoders["front"].ticks_per_revolution == 20


@pytest.mark.parametrize("says", ["HAVE_ODOM_2 = True", "DRIVE_TRAIN_TYPE = 'DC_TWO_WHEEL_L298N'"])
def test_two_wheels(written, says):
    robot = robot_from_myconfig(written(CAR + says))
    assert isinstance(robot.drive, tr.Differential)
    assert robot.drive.parameters == {"track_width": 0.15, "wheel_radius": 0.0315}
    assert {e.ticks_per_revolution for e in robot.encoders.values()} == {20}


def test_counts_from_the_way_per_tick(written):
    text = CAR.replace("ENCODER_PPR = 20\n", "").replace("/ ENCODER_PPR", "/ 35")
    assert robot_from_myconfig(written(text)).encoders["front"].ticks_per_revolution == pytest.approx(35.0)


def test_myconfig_goes_before_config(written):
    """A config.py computes MM_PER_TICK from its own radius, whatever myconfig.py says about that."""
    config = written(CAR, "config.py")
    robot = robot_from_myconfig(written("WHEEL_RADIUS = 0.05\nMIN_SPEED = 0\n"), config=config)
    assert robot.drive.wheel("front").radius == 0.05
    assert robot.encoders["front"].ticks_per_revolution == 20
    assert robot.limits.min_speed is None


@pytest.mark.parametrize("extra", ["", "HAVE_ODOM_2 = True"])
def test_there_and_back_and_through_robot_yaml(written, tmp_path, extra):
    robot = robot_from_myconfig(written(CAR + extra))
    again = robot_from_myconfig(written(myconfig_text(robot), "again.py"))
    save_robot(again, tmp_path / "robot.yaml")
    final = load_robot(tmp_path / "robot.yaml")
    assert final.drive.parameters == again.drive.parameters == robot.drive.parameters
    assert final.drive.measured_names == robot.drive.measured_names
    assert (final.limits, final.encoders) == (robot.limits, robot.encoders)


def test_snippet_of_other_robots():
    text = myconfig_text(tr.Robot(drive=tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05)))
    assert "AXLE_LENGTH = 0.2 " in text
    assert "WHEEL_BASE = 0.3 " in text
    calibrated = tr.Differential(track_width=0.2, wheel_radius={"left": 0.04, "right": 0.05})
    assert "WHEEL_RADIUS = 0.045 " in myconfig_text(tr.Robot(drive=calibrated))
    with pytest.raises(InputError, match="mecanum: donkeycar knows"):
        myconfig_text(tr.Robot(drive=tr.Mecanum(wheelbase=0.3, track_width=0.2, wheel_radius=0.05)))
    encoders = {"left": tr.Encoder(ticks_per_revolution=20), "right": tr.Encoder(ticks_per_revolution=21)}
    with pytest.raises(InputError, match="must be one"):
        myconfig_text(tr.Robot(drive=calibrated, encoders=encoders))


def test_nothing_is_run(written, tmp_path):
    trace = tmp_path / "trace"
    program = f"open({str(trace)!r}, 'w')\nimport os\nos.system('touch {trace}')\nraise SystemExit\n"
    assert read_myconfig(written(program + CAR))["WHEEL_BASE"] == 0.3
    assert not trace.exists()


def test_what_is_not_asked_for_does_not_matter(written):
    text = (
        "CAR_PATH = PATH = os.path.dirname(__file__)\nX = 1 / 0\nX, Y = 1, 2\nAXLE_LENGTH: float = 2 * 0.1\n"
    )
    assert read_myconfig(written(text)) == {"AXLE_LENGTH": 0.2}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("MAX_SPEED = fastest()", r"MAX_SPEED: line 1: 'fastest\(\)' cannot be known without running it"),
        ("if 1:\n    MAX_SPEED = 3", "MAX_SPEED: line 1: is assigned in a way that only running"),
        ("MAX_SPEED = 3\nfor MAX_SPEED in x: pass", "line 2"),
        ("MAX_SPEED = 3\nfrom car import *", "line 2"),
        ("MAX_SPEED = 3\ndel MAX_SPEED", "line 2"),
        ("MAX_SPEED = 3\nMAX_SPEED += 1", "line 2"),
        ("A = 1\nfrom car import A\nMAX_SPEED = A", "line 3: 'A' cannot be known"),
        ("MAX_SPEED = 1 / 0", "float division by zero|division by zero"),
        ("MAX_SPEED = 10 ** 10 ** 10", "line 1: "),
        ("MAX_SPEED = 2.0 * 'a'", "is no number"),
        ("MAX_SPEED = " + "-" * 5000 + "1", "MAX_SPEED|no Python"),
        ("MAX_SPEED = (", "is no Python"),
        ("MAX_SPEED = 3\0", "is no Python"),
        ("#" * (1 << 20) + "\n", "is larger than"),
    ],
)
def test_what_only_running_could_tell_is_refused(written, text, says):
    path = written(text)
    with pytest.raises(ConfigError, match=says) as caught:
        read_myconfig(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("WHEEL_BASE = 0.3 ", "#", "WHEEL_BASE: missing"),
        ("WHEEL_RADIUS = 0.0315", "WHEEL_RADIUS = 0", "WHEEL_RADIUS: 0, must be a number > 0|MM_PER_TICK"),
        ("MAX_SPEED = 3.0", "MAX_SPEED = 'fast'", "MAX_SPEED: 'fast', must be a number > 0"),
        ("MAX_SPEED = 3.0", "MAX_SPEED = 0.05", "min_speed: 0.1, must be <= max_speed"),
        ("math.pi / 4", "45", "degrees"),
        ("2 * math.pi * 1000 / ENCODER_PPR", "1", "MM_PER_TICK: 0.0315 means"),
    ],
)
def test_what_cannot_be_is_refused(written, old, new, says):
    assert old in CAR
    with pytest.raises(ConfigError, match=says):
        robot_from_myconfig(written(CAR.replace(old, new)))


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        read_myconfig(tmp_path / "none.py")


def test_real_file(shared_data):
    path = shared_data / "donkeycar_tub" / "myconfig.py"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    assert read_myconfig(path) == {"DRIVE_TRAIN_TYPE": "ARDUINO"}
    with pytest.raises(ConfigError, match="WHEEL_RADIUS: missing"):  # its lengths are comments
        robot_from_myconfig(path)
