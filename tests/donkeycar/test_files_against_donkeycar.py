"""Tubs and configurations that donkeycar writes and reads itself."""

from __future__ import annotations

import contextlib
import gc
import importlib.util
from pathlib import Path

import numpy as np
import pytest

import trundle as tr
from trundle.adapters.log import read_log
from trundle.adapters.myconfig import myconfig_text, read_myconfig, robot_from_myconfig
from trundle.adapters.tub_log import read_tub_trajectory, write_tub_log
from trundle.records import Trajectory, WheelLog

with pytest.MonkeyPatch.context() as patch:
    patch.setattr("builtins.print", lambda *_, **__: None)  # donkeycar greets whoever imports it
    config = pytest.importorskip("donkeycar.config", reason="donkeycar lives in .envs/donkeycar")
    from donkeycar.parts.tub_v2 import Tub

CAR = tr.Robot(
    drive=tr.Bicycle(wheelbase=0.3, wheel_radius=0.05, measured="front"), limits=tr.Limits(max_steering=0.5)
)
TEMPLATE = Path(importlib.util.find_spec("donkeycar").origin).parent / "templates" / "cfg_path_follow.py"


def test_we_read_what_donkeycar_writes(tmp_path):
    inputs = ["user/mode", "enc/distance", "user/angle", "pos/x", "pos/y", "pos/angle"]
    tub = Tub(str(tmp_path / "tub"), inputs, ["str", *["float"] * 5], max_catalog_len=30)
    for count in range(100):
        values = ("user", 0.1 * count, 0.01 * count, 1.0 * count, 2.0 * count, 0.1 * count)
        tub.write_record(dict(zip(inputs, values, strict=True)))
    tub.delete_records([3, 4])
    tub.close()
    kept = np.delete(np.arange(100), [3, 4])
    log = read_log(tmp_path / "tub", CAR)
    np.testing.assert_allclose(log.wheels[:, 0], 2.0 * kept)
    np.testing.assert_allclose(log.steering[:, 0], -0.005 * kept)
    poses = read_tub_trajectory(tmp_path / "tub").poses
    np.testing.assert_allclose(poses, np.stack([1.0 * kept, 2.0 * kept, 0.1 * kept], axis=-1))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # donkeycar leaves files open
def test_donkeycar_reads_what_we_write(tmp_path):
    count = 2500
    time_ns = 1_763_338_136_807_000_000 + 50_000_000 * np.arange(count)
    turned = np.cumsum(np.linspace(0.0, 0.5, count))
    log = WheelLog(
        time_ns=time_ns,
        wheel_names=("front",),
        wheels=turned[:, None],
        steering_names=("front",),
        steering=np.full((count, 1), 0.1),
    )
    poses = np.random.default_rng(1).normal(size=(count, 3))
    write_tub_log(log, tmp_path / "tub", CAR, trajectory=Trajectory(time_ns=time_ns, poses=poses))
    tub = Tub(str(tmp_path / "tub"), read_only=True)
    records = list(all_of(tub))
    tub.close()
    gc.collect()
    assert len(records) == count
    assert [record["_index"] for record in records] == list(range(count))
    np.testing.assert_array_equal([record["_timestamp_ms"] for record in records], time_ns // 1_000_000)
    np.testing.assert_array_equal([record["enc/distance"] for record in records], 0.05 * turned)
    np.testing.assert_array_equal([record["user/angle"] for record in records], -0.1 / 0.5)
    np.testing.assert_array_equal([record["pos/y"] for record in records], poses[:, 1])


def all_of(tub):
    """The records of a tub, whose iterators are none to a `for`."""
    records = tub.__iter__()
    with contextlib.suppress(StopIteration):
        while True:
            yield records.__next__()


def test_configuration_is_read_as_donkeycar_runs_it():
    theirs = config.Config()
    theirs.from_pyfile(str(TEMPLATE))
    ours = read_myconfig(TEMPLATE)
    assert len(ours) == 10
    assert ours == {name: getattr(theirs, name) for name in ours}


def test_donkeycar_reads_our_lines(tmp_path):
    robot = robot_from_myconfig(TEMPLATE)
    (tmp_path / "myconfig.py").write_text(myconfig_text(robot))
    theirs = config.Config()
    theirs.from_pyfile(str(tmp_path / "myconfig.py"))
    assert (theirs.WHEEL_BASE, theirs.WHEEL_RADIUS, theirs.ENCODER_PPR) == (0.1, 0.0315, 20)
    assert pytest.approx(9.896, abs=1e-3) == theirs.MM_PER_TICK
