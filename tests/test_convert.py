"""`trundle convert`: nothing is lost between formats that can hold it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import trundle as tr
from trundle.apps.cli import main

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture
def trajectory(tmp_path: Path) -> Path:
    time_ns = np.arange(50) * 20_000_001
    poses = np.cumsum(np.random.default_rng(0).normal(0.0, 0.02, (50, 3)), axis=0)
    tr.write_trajectory(tr.Trajectory(time_ns=time_ns, poses=poses), tmp_path / "run.csv")
    return tmp_path / "run.csv"


def test_a_trajectory_goes_round_the_formats(trajectory: Path, tmp_path: Path, capsys) -> None:
    for name in ("run.parquet", "run.tum", "again.csv"):
        assert main(["convert", str(trajectory), str(tmp_path / name)]) == 0
        trajectory_again = tr.read_trajectory(tmp_path / name)
        wanted = tr.read_trajectory(trajectory)
        np.testing.assert_array_equal(trajectory_again.time_ns, wanted.time_ns)
        np.testing.assert_allclose(trajectory_again.poses, wanted.poses, atol=1e-14)
    assert "50" in capsys.readouterr().out


def test_a_log_becomes_our_own_csv(tmp_path: Path, capsys) -> None:
    robot, out = EXAMPLES / "differential" / "robot.yaml", tmp_path / "log.csv"
    source = EXAMPLES / "differential" / "run.csv"
    assert main(["convert", str(source), str(out), "--robot", str(robot)]) == 0
    described = tr.load_robot(robot)
    first, second = tr.read_log(source, described), tr.read_log(out, described)
    np.testing.assert_array_equal(first.wheels, second.wheels)
    np.testing.assert_array_equal(first.time_ns, second.time_ns)
    assert "wheels" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "code", "words"),
    [
        ("run.csv", 2, "is the input itself, must be another file"),
        ("run.xyz", 2, "must end in one of .tum"),
        ("nowhere/run.tum", 5, "there is no folder"),
    ],
)
def test_outputs_that_cannot_be_are_refused_first(
    trajectory: Path, name: str, code: int, words: str, capsys
) -> None:
    before = trajectory.read_bytes()
    assert main(["convert", str(trajectory), str(trajectory.parent / name)]) == code
    assert words in capsys.readouterr().err
    assert trajectory.read_bytes() == before
