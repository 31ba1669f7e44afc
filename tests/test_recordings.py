"""The recordings of ../shared/data, through the whole spine: description, log, odometry, judgement.

The nominal figures were computed independently, with the stated geometry and exact-arc integration; they
stand in the data's README. Each file of tests/recordings describes one of those robots.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

import trundle as tr
from trundle.adapters.log import read_log
from trundle.adapters.reference import jumps
from trundle.adapters.robot_yaml import load_robot
from trundle.apps.cli import main
from trundle.evaluate import Comparison, compare
from trundle.geometry import se2
from trundle.records.pieces import pieces
from trundle.robot.log_mapping import ReferenceMapping, TwistMapping

DESCRIPTIONS = Path(__file__).parent / "recordings"

# By folder, or by pattern of files: description, then the ATE of each run [m].
OPTIODOM = {
    "diff/circular/250620202104": ("diff", 0.0153, 0.0144, 0.0139, 0.0207, 0.0170, 0.0182),
    "diff/circular/250620202251": (
        *("diff", 0.0108, 0.0121, 0.0121, 0.0092, 0.0119),
        *(0.0196, 0.0192, 0.0158, 0.0155, 0.0186),
    ),
    "diff/square/230620202042": ("diff", 0.0039, 0.0043, 0.0041, 0.0092, 0.0085, 0.0072),
    "tricyc/free/140120211508": ("tricyc", 0.1670),
    "tricyc/free/140120211525": ("tricyc", 0.1531),
    "tricyc/free/140120211611": ("tricyc", 0.2093),
    "omni3/joystick/211220201842": ("omni3", 0.0453),
    "omni3/joystick/221220202228": ("omni3", 0.0512, 0.0491, 0.0520, 0.0703),
    "omni4/circular/080920201911": ("omni4", 0.0567, 0.0818, 0.0565, 0.0377),
    "omni4/square/080920201205": ("omni4", 0.0555, 0.0611, 0.0563, 0.0408),
}
OTHERS = {
    "polimi_mecanum/bag1.bag": ("polimi_mecanum", 0.102),
    "polimi_mecanum/bag2.bag": ("polimi_mecanum", 0.557),
    "lego/robot4_motors.txt": ("lego", 0.550),
}
# Where each recording is and what describes its robot; optiodom has several.
DESCRIBED = {
    "censi/lstraight.tuple": "censi",
    "f1tenth/skidpad_2_5.bag": "f1tenth",
    "frc_swerve/*.wpilog": "frc_swerve",
    "lego/robot4_motors.txt": "lego",
    "optiodom/*/*/*/*_run-*.csv": "optiodom",
    "polimi_mecanum/*.bag": "polimi_mecanum",
    "turtlebot_nav2/*.mcap": "turtlebot_nav2",
}
SHORT = 25  # lines


def tracked(path: Path, description: str) -> tuple[tr.Trajectory, Comparison]:
    """What the wheels of a recording say, and how far off that is."""
    robot = load_robot(DESCRIPTIONS / f"{description}.yaml")
    log = read_log(path, robot)
    trajectory = tr.integrate(robot, log)
    assert len(trajectory) + sum(trajectory.rejected.values()) == len(log) + sum(log.rejected.values())
    assert log.reference is not None
    return trajectory, compare(trajectory, log.reference)


def there(path: Path) -> Path:
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    return path


@pytest.mark.parametrize("name", OPTIODOM)
def test_optiodom(name, shared_data):
    kind, *nominal = OPTIODOM[name]
    folder = there(shared_data / "optiodom" / name)
    runs = sorted(folder.glob("*_run-*.csv"))
    errors = [tracked(run, f"optiodom_{kind}")[1].position.rmse for run in runs]
    # The figures are given to a tenth of a millimetre.
    assert errors == pytest.approx(nominal, rel=0.02, abs=0.5e-4)


@pytest.mark.parametrize("name", OTHERS)
def test_reference_with_stamps_of_its_own(name, shared_data):
    description, nominal = OTHERS[name]
    _, comparison = tracked(there(shared_data / name), description)
    assert comparison.position.rmse == pytest.approx(nominal, rel=0.05)


def test_twists_of_a_turtlebot(shared_data):
    """Its integrated twists are its own poses, but for the one gap, over which nothing is made up."""
    path = there(shared_data / "turtlebot_nav2" / "nav2_turtlebot.mcap")
    trajectory, comparison = tracked(path, "turtlebot_nav2")
    assert trajectory.events == {"gap": 1}
    assert comparison.position.rmse < 0.02 * trajectory.distance  # against AMCL, the lost 0.66 m included

    robot = load_robot(DESCRIPTIONS / "turtlebot_nav2.yaml")
    mapping = msgspec.structs.replace(robot.log, reference=ReferenceMapping(topic="/odom"))
    own = read_log(path, robot, mapping=mapping).reference
    gap = int(np.diff(trajectory.time_ns).argmax()) + 1
    for part in (slice(0, gap), slice(gap, None)):
        assert compare(rows(trajectory, part), rows(own, part)).position.rmse < 0.006


def rows(trajectory: tr.Trajectory, part: slice) -> tr.Trajectory:
    return tr.Trajectory(time_ns=trajectory.time_ns[part], poses=trajectory.poses[part])


# ------------------------------------------------------------------------ all of them, by command


@pytest.mark.parametrize("pattern", DESCRIBED)
def test_every_recording_opens_and_runs(pattern, shared_data, tmp_path, capsys):
    """`info` opens it and knows what is in it; `track` runs it with a description that is short."""
    found = sorted(there(shared_data / pattern.partition("/")[0]).glob(pattern.partition("/")[2]))
    assert found
    for path in found:
        name = DESCRIBED[pattern] if "optiodom" not in pattern else f"optiodom_{path.parts[-4]}"
        robot = DESCRIPTIONS / f"{name}.yaml"
        assert len(robot.read_text().splitlines()) <= SHORT
        assert main(["info", str(path)]) == 0
        assert "\nlog:" in capsys.readouterr().out
        assert (
            main(["track", str(path), "--robot", str(robot), "-o", str(tmp_path / "run.tum"), "--force"]) == 0
        )
        said = capsys.readouterr().out
        assert "error       ATE" in said
        assert tr.read_trajectory(tmp_path / "run.tum").distance > 1.0


def test_the_tub_opens(shared_data, capsys):
    assert main(["info", str(there(shared_data / "donkeycar_tub"))]) == 0
    assert "donkeycar tub" in capsys.readouterr().out


def test_no_recording_is_left_out(shared_data):
    folders = {path.name for path in shared_data.iterdir() if path.is_dir()}
    assert folders <= {pattern.partition("/")[0] for pattern in DESCRIBED} | {"donkeycar_tub"}


def test_car_whose_own_odometry_is_too_fast(shared_data):
    """Counts with the gain that is right, against the twists of its own node, which took a wrong one."""
    path = there(shared_data / "f1tenth" / "skidpad_2_5.bag")
    trajectory, comparison = tracked(path, "f1tenth")
    # 5 % too fast still: vesc.yaml's offset of 250 ERPM is no unit. On a circle of 1 m, over 11.9 m.
    assert comparison.position.rmse == pytest.approx(0.126, rel=0.05)
    robot = load_robot(DESCRIPTIONS / "f1tenth.yaml")
    mapping = msgspec.structs.replace(
        robot.log, wheels={}, steering={}, twist=TwistMapping(topic="/vesc/odom")
    )
    own = tr.integrate(robot, read_log(path, robot, mapping=mapping))
    assert own.distance / trajectory.distance == pytest.approx(7300 / 4614, rel=0.01)


def test_khepera_and_what_its_laser_saw(shared_data):
    """Each step by itself, since scans that were matched wrongly bend the joined path."""
    trajectory, _ = tracked(there(shared_data / "censi" / "lstraight.tuple"), "censi")
    assert len(trajectory) == 4396
    robot = load_robot(DESCRIPTIONS / "censi.yaml")
    truth = read_log(shared_data / "censi" / "lstraight.tuple", robot).reference
    np.testing.assert_array_equal(truth.time_ns, trajectory.time_ns)
    ours, theirs = (se2.compose(se2.inverse(one[:-1]), one[1:]) for one in (trajectory.poses, truth.poses))
    off = np.median(np.abs(ours - theirs), axis=0)
    assert off[0] < 0.6e-3  # of 4 mm and 93 mrad on average
    assert off[1] < 0.4e-3
    assert off[2] < 1.3e-3


# Piece by piece: way of the reference [m], ATE [m].
FRC = {
    "FRC_20241008_044638": [(5.51, 0.030)],
    "FRC_20241012_184342": [(10.39, 0.043), (0.319, 0.005)],
}


@pytest.mark.parametrize("name", FRC)
def test_swerve_that_is_logged_on_change_and_reset(name, shared_data):
    """Held values; the reference jumps where the simulation was reset, and each piece by itself is near."""
    path = there(shared_data / "frc_swerve" / f"{name}.wpilog")
    robot = load_robot(DESCRIPTIONS / "frc_swerve.yaml")
    log = read_log(path, robot)
    cuts = jumps(log.reference)
    assert sum(log.reference.events.values()) == len(cuts) == len(FRC[name]) - 1
    trajectory = tr.integrate(robot, log)
    both = zip(pieces(trajectory, cuts), pieces(log.reference, cuts), strict=True)
    found = [compare(one, other) for one, other in both]
    for comparison, (way, error) in zip(found, FRC[name], strict=True):
        assert comparison.reference_length == pytest.approx(way, rel=0.01)
        assert comparison.ate == pytest.approx(error, abs=0.001)
        assert comparison.ate < 0.1
