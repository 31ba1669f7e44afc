"""donkeycar's tubs: read as wheel logs, by donkeycar's names, and written."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import trundle as tr
from trundle.adapters.log import read_log
from trundle.adapters.numeral import Real
from trundle.adapters.table import Wanted
from trundle.adapters.tub import Tub, write_tub
from trundle.adapters.tub_log import read_tub_trajectory, write_tub_log
from trundle.errors import (
    ConfigError,
    InputError,
    LogCorrupt,
    LogError,
    LogLimit,
    LogSchema,
    LogTruncated,
    OutputError,
    ShapeError,
)
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot.log_mapping import LogMapping, ScalarMapping, Unit, WheelMapping

CAR = tr.Robot(
    drive=tr.Bicycle(wheelbase=0.3, wheel_radius=0.05, measured="front"), limits=tr.Limits(max_steering=0.5)
)
TWO_WHEELS = tr.Robot(drive=tr.Differential(track_width=0.2, wheel_radius=0.05))
COUNT = 2500  # more than two catalogs
STAMPS = 1_763_338_136_807_000_000 + 50_000_000 * np.arange(COUNT)


def car_log():
    turned = np.cumsum(np.linspace(0.0, 0.5, COUNT))
    steering = 0.5 * np.sin(np.arange(COUNT) / 40.0)
    return WheelLog(
        time_ns=STAMPS,
        wheel_names=("front",),
        wheels=turned[:, None],
        steering_names=("front",),
        steering=steering[:, None],
    )


def lines_of(path):
    return path.read_text().splitlines()


def change(path, number, line):
    lines = lines_of(path)
    lines[number] = line if isinstance(line, str) else json.dumps(line)
    path.write_text("\n".join(lines) + "\n")


@pytest.fixture
def tub(tmp_path):
    """A tub of 2500 records in three catalogs."""
    write_tub_log(car_log(), tmp_path / "tub", CAR)
    return tmp_path / "tub"


# --- there and back -----------------------------------------------------------------------------------


def test_car_there_and_back(tub):
    log, again = car_log(), read_log(tub, CAR)
    assert again.reading is Reading.POSITION
    np.testing.assert_array_equal(again.time_ns, log.time_ns)
    np.testing.assert_allclose(again.wheels, log.wheels, rtol=1e-15)
    np.testing.assert_allclose(again.steering, log.steering, rtol=1e-15, atol=1e-17)
    assert (again.warnings, dict(again.rejected)) == ((), {})
    assert len(tr.integrate(CAR, again)) == COUNT


def test_channels_have_donkeycars_names_and_signs(tub):
    opened = Tub(tub)
    assert opened.channels == dict.fromkeys(["enc/distance", "enc/speed", "user/angle"], "float")
    assert len(opened) == COUNT
    record = json.loads(lines_of(tub / "catalog_1.catalog")[20])
    assert record["_index"] == 1020
    assert record["_timestamp_ms"] == STAMPS[1020] // 1_000_000
    log = car_log()
    assert record["enc/distance"] == pytest.approx(0.05 * log.wheels[1020, 0])
    assert record["enc/speed"] == pytest.approx(0.05 * (log.wheels[1020, 0] - log.wheels[1019, 0]) / 0.05)
    assert record["user/angle"] == pytest.approx(-log.steering[1020, 0] / 0.5)  # right is positive there


def test_two_wheels_there_and_back(tmp_path):
    wheels = np.cumsum(np.random.default_rng(1).normal(0.2, 0.1, (50, 2)), axis=0)
    log = WheelLog(time_ns=STAMPS[:50], wheel_names=("left", "right"), wheels=wheels)
    write_tub_log(log, tmp_path / "tub", TWO_WHEELS)
    channels = ["enc/left/distance", "enc/right/distance", "enc/distance", "enc/speed"]
    assert list(Tub(tmp_path / "tub").channels) == channels
    np.testing.assert_allclose(read_log(tmp_path / "tub", TWO_WHEELS).wheels, wheels, rtol=1e-15)


def test_speeds_where_there_is_no_distance(tmp_path):
    """donkeycar's own template records `enc/speed` and `user/angle`."""
    speed, angle = np.linspace(0.0, 1.0, 20), np.linspace(-2.0, 2.0, 20)
    write_tub(tmp_path / "tub", STAMPS[:20], {"user/angle": angle, "enc/speed": speed})
    log = read_log(tmp_path / "tub", CAR)
    assert log.reading is Reading.VELOCITY
    np.testing.assert_allclose(log.wheels[:, 0], speed / 0.05)
    np.testing.assert_allclose(log.steering[:, 0], -0.5 * np.clip(angle, -1.0, 1.0))


def test_poses_there_and_back(tmp_path):
    log = car_log()
    heading = np.linspace(0.0, 20.0, COUNT)  # more than three turns
    poses = np.stack([np.arange(COUNT) * 0.1, np.sin(heading), heading], axis=-1)
    twists = np.stack([np.ones(COUNT), np.zeros(COUNT), np.full(COUNT, 0.3)], axis=-1)
    trajectory = Trajectory(time_ns=log.time_ns, poses=poses, twists=twists)
    write_tub_log(log, tmp_path / "tub", CAR, trajectory=trajectory)
    np.testing.assert_allclose(read_tub_trajectory(tmp_path / "tub").poses, poses, atol=1e-12)
    record = json.loads(lines_of(tmp_path / "tub" / "catalog_0.catalog")[500])
    assert record["pos/angle"] == pytest.approx(math.remainder(heading[500], math.tau))
    assert record["vel/y"] == pytest.approx(math.sin(heading[500]))
    assert record["vel/angle"] == 0.3


def test_own_names_and_what_else_was_measured(tmp_path):
    channels = {"wheel": np.arange(20.0), "servo": np.full(20, 10.0), "imu/gyr_z": np.full(20, 0.5)}
    write_tub(tmp_path / "tub", STAMPS[:20], channels)
    mapping = LogMapping(
        wheels={"front": WheelMapping(column="wheel", unit=Unit.REV)},
        steering={"front": ScalarMapping(column="servo", unit=Unit.DEG)},
        gyro=ScalarMapping(column="imu/gyr_z"),
    )
    log = read_log(tmp_path / "tub", CAR, mapping=mapping)
    np.testing.assert_allclose(log.wheels[:, 0], math.tau * np.arange(20.0))
    np.testing.assert_allclose(log.steering, math.radians(10.0))
    np.testing.assert_allclose(log.yaw_rate, 0.5)


# --- what happens to recordings -------------------------------------------------------------------------


def test_sessions_are_joined(tmp_path):
    """The odometer began anew; the car did not jump back."""
    rolled = np.concatenate([np.arange(10.0), np.arange(10.0)])
    write_tub(tmp_path / "tub", STAMPS[:20], {"enc/distance": rolled, "user/angle": 0.0 * rolled})
    catalog = tmp_path / "tub" / "catalog_0.catalog"
    for number in range(10, 20):
        change(catalog, number, {**json.loads(lines_of(catalog)[number]), "_session_id": "26-01-26_1"})
    log = read_log(tmp_path / "tub", CAR)
    np.testing.assert_allclose(0.05 * log.wheels[:, 0], [*range(10), *range(9, 19)])
    assert log.warnings == ("2 sessions are joined: how the car moved between them is not in the tub",)


def test_deleted_records_do_not_count(tub):
    about = json.loads(lines_of(tub / "manifest.json")[4])
    change(tub / "manifest.json", 4, {**about, "deleted_indexes": [0, 1, 1500]})
    assert len(Tub(tub)) == COUNT - 3
    log = read_log(tub, CAR)
    np.testing.assert_array_equal(log.time_ns, np.delete(STAMPS, [0, 1, 1500]))
    assert log.warnings == ("3 records are marked as deleted",)


def test_what_cannot_be_read_is_counted(tub):
    """A torn line, a channel that was still None, text, too deep nesting, a time beyond 292 years."""
    catalog = tub / "catalog_0.catalog"
    record = json.loads(lines_of(catalog)[0])
    change(catalog, 3, '{"_index": 3, "enc/dist')
    change(catalog, 4, {key: value for key, value in record.items() if key != "enc/distance"})
    change(catalog, 5, {**record, "enc/distance": "far"})
    change(catalog, 6, "[" * 5000)
    change(catalog, 7, {**record, "_timestamp_ms": 10**30})
    change(catalog, 8, '{"_index": 8, "enc/distance": NaN}')
    log = read_log(tub, CAR)
    assert len(log) == COUNT - 6
    assert dict(log.rejected) == {"parse": 5, "time_range": 1}
    assert log.warnings == ("6 records were left out as unreadable, or without a number in each channel",)


def test_a_catalog_is_not_there(tub):
    (tub / "catalog_1.catalog").unlink()
    log = read_log(tub, CAR)
    assert len(log) == COUNT - 1000
    assert log.warnings == ("1 catalog (catalog_1.catalog) of the manifest not there",)
    for number in (0, 2):
        (tub / f"catalog_{number}.catalog").unlink()
    with pytest.raises(LogError, match="none of the catalogs"):
        read_log(tub, CAR)


@pytest.mark.parametrize(
    ("number", "line", "error", "says"),
    [
        (4, "", LogTruncated, "has 4 lines, must be 5"),
        (0, "{", LogCorrupt, "is none of donkeycar's"),
        (0, ["one"], LogCorrupt, "names 1 channels of 3 types"),
        (1, [1, 2, 3], LogCorrupt, "is none of donkeycar's"),
        (4, {"paths": ["../other/catalog_0.catalog"]}, LogCorrupt, "must be a file of the tub"),
        (4, {"paths": [".."]}, LogCorrupt, "must be a file of the tub"),
        (4, {"paths": "catalog_0.catalog"}, LogCorrupt, "is none of donkeycar's"),
        (4, {"paths": []}, LogError, "none of the catalogs"),
        (4, "[" * 5000, LogCorrupt, "is none of donkeycar's"),
    ],
)
def test_damaged_manifests(tub, number, line, error, says):
    change(tub / "manifest.json", number, line)
    with pytest.raises(error, match=says):
        read_log(tub, CAR)


def test_things_without_end(tub):
    (tub / "catalog_0.catalog").write_bytes(b"x" * (2 << 20))
    with pytest.raises(LogLimit, match="a record is longer"):
        read_log(tub, CAR)
    (tub / "manifest.json").write_bytes(b" " * (17 << 20))
    with pytest.raises(LogLimit, match="is longer than"):
        read_log(tub, CAR)


def test_tubs_without_what_is_asked_for(tub, tmp_path):
    with pytest.raises(LogSchema, match="must have enc/left/distance, enc/right/distance or enc/left/speed"):
        read_log(tub, TWO_WHEELS)
    with pytest.raises(LogSchema, match="no column 'pos/x'"):
        read_tub_trajectory(tub)
    write_tub(tmp_path / "straight", STAMPS[:5], {"enc/distance": np.arange(5.0)})
    with pytest.raises(LogSchema, match="no channel steering or user/angle"):
        read_log(tmp_path / "straight", CAR)
    endless = tr.Robot(drive=tr.Bicycle(wheelbase=0.3, wheel_radius=0.05, measured="front"))
    with pytest.raises(ConfigError, match=r"limits.max_steering: missing"):
        read_log(tub, endless)
    with pytest.raises(ConfigError, match=r"limits.max_steering: missing"):
        write_tub_log(car_log(), tmp_path / "other", endless)
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match="without a rosbag2 recording or a donkeycar tub"):
        read_log(tmp_path / "empty", CAR)


@pytest.mark.parametrize(
    ("stamps", "channels", "error"),
    [
        (STAMPS[:0], {}, InputError),
        (STAMPS[0] + np.arange(5) * 1000, {}, InputError),
        (STAMPS[:2], {"a": np.array([1.0, np.nan])}, InputError),
        (STAMPS[:2], {"a": np.array([1.0])}, ShapeError),
    ],
)
def test_what_a_tub_cannot_hold(tmp_path, stamps, channels, error):
    with pytest.raises(error):
        write_tub(tmp_path / "tub", stamps, channels)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_written_over(tub, tmp_path):
    before = lines_of(tub / "manifest.json")
    with pytest.raises(OutputError, match="exists"):
        write_tub_log(car_log(), tub, CAR)
    assert lines_of(tub / "manifest.json") == before
    with pytest.raises(OutputError, match="cannot be written"):
        write_tub_log(car_log(), tmp_path / "no" / "folder", CAR)
    ticks = WheelLog(
        time_ns=STAMPS[:2], wheel_names=("front",), wheels=np.array([[0], [1]]), reading=Reading.TICKS
    )
    with pytest.raises(InputError, match="holds ticks"):
        write_tub_log(ticks, tmp_path / "ticks", CAR)
    elsewhere = Trajectory(time_ns=STAMPS[:2], poses=np.zeros((2, 3)))
    with pytest.raises(InputError, match="stamps of its own"):
        write_tub_log(car_log(), tmp_path / "poses", CAR, trajectory=elsewhere)


# --- a real one -----------------------------------------------------------------------------------------


def test_real_tub(shared_data):
    """It was recorded without encoders: what it holds is said, and its steering can be read."""
    path = shared_data / "donkeycar_tub"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    tub = Tub(path)
    assert tub.channels == {
        "cam/image_array": "image_array",
        "user/angle": "float",
        "user/throttle": "float",
        "user/mode": "str",
    }
    rows = tub.read([Wanted("_timestamp_ms", Real()), Wanted("user/angle", Real())])
    assert len(rows.columns[0]) == 1000
    assert np.abs(rows.columns[1]).max() <= 1.0
    assert any("12 catalogs" in warning for warning in rows.warnings)
    with pytest.raises(LogSchema, match=r"it has cam/image_array, user/angle.*HAVE_ODOM"):
        read_log(path, CAR)
    with pytest.raises(LogSchema, match="'user/mode' holds str, must be numbers"):
        tub.read([Wanted("user/mode", Real())])
