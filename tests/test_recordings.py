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
from trundle.adapters.robot_yaml import load_robot
from trundle.evaluate import Comparison, compare
from trundle.robot.log_mapping import ReferenceMapping

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


def tracked(path: Path, description: str) -> tuple[tr.Trajectory, Comparison]:
    """What the wheels of a recording say, and how far off that is."""
    robot = load_robot(DESCRIPTIONS / f"{description}.yaml")
    log = read_log(path, robot)
    trajectory = tr.integrate(robot, log)
    assert len(trajectory) + sum(trajectory.rejected.values()) == len(log)
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
