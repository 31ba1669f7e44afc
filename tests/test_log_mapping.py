"""Logs as robots write them become wheel logs, by the robot's description."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle.adapters import bag_log, resampling
from trundle.adapters.log import read_log
from trundle.adapters.topic_columns import TopicColumns
from trundle.errors import ConfigError, LogSchema
from trundle.evaluate import compare
from trundle.geometry import se2
from trundle.odometry.integrate import integrate
from trundle.records import Reading
from trundle.robot import (
    Ackermann,
    Bicycle,
    Differential,
    Encoder,
    LogMapping,
    Mecanum,
    Robot,
    Swerve,
    TrackingWheels,
    Tricycle,
)
from trundle.robot.log_mapping import (
    Clock,
    Kind,
    ReferenceMapping,
    ScalarMapping,
    TableFormat,
    TimeMapping,
    TwistMapping,
    Unit,
    WheelMapping,
)

RADIUS, TICKS = 0.05, 1000
DRIVE = Differential(track_width=0.2, wheel_radius=RADIUS)


def robot(drive=DRIVE, *, bits=None, inverted=(), **log) -> Robot:
    encoders = {
        name: Encoder(ticks_per_revolution=TICKS, bits=bits, inverted=name in inverted)
        for name in drive.wheel_names
    }
    return Robot(drive=drive, encoders=encoders, log=LogMapping(**log))


def write(folder: Path, text: str, name: str = "run.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


# ---------------------------------------------------------------------------------- tables


@pytest.mark.parametrize(
    ("column", "reading", "scale"),
    [
        ("position", Reading.POSITION, 1.0),
        ("ticks", Reading.POSITION, math.tau / TICKS),
        ("ticks_delta", Reading.INCREMENT, math.tau / TICKS),
        ("revolutions", Reading.POSITION, math.tau),
        ("distance", Reading.POSITION, 1.0 / RADIUS),
        ("velocity", Reading.VELOCITY, 1.0),
    ],
)
def test_own_columns_need_no_mapping(tmp_path, column, reading, scale):
    text = f"time,left.{column},right.{column},gyro.yaw_rate\n0.0,1,2,0.1\n0.1,3,5,0.2\n"
    log = read_log(write(tmp_path, text), robot())
    assert log.reading is reading
    assert log.wheel_names == ("left", "right")
    assert log.time_ns.tolist() == [0, 100_000_000]
    np.testing.assert_allclose(log.wheels, np.array([[1, 2], [3, 5]]) * scale, rtol=1e-15)
    np.testing.assert_array_equal(log.yaw_rate, [0.1, 0.2])
    assert log.reference is None
    assert log.warnings == ()


def test_a_bare_drive_is_robot_enough(tmp_path):
    log = read_log(write(tmp_path, "time_ns,left.position,right.position\n5,1,2\n"), DRIVE)
    assert log.time_ns.tolist() == [5]


def test_counters_of_known_width_stay_raw(tmp_path):
    big = 2**63 + 7
    text = f"time_ns,left.ticks,right.ticks\n1,{big},5\n2,{2**64 - 1},6\n"
    log = read_log(write(tmp_path, text), robot(bits=64, inverted=["left"]))
    assert log.reading is Reading.TICKS
    assert log.wheels.dtype == np.int64
    assert (log.wheels.astype(np.uint64)).tolist() == [[big, 5], [2**64 - 1, 6]]


def test_inverted_encoders_and_signs_turn_positions(tmp_path):
    wheels = {
        "left": WheelMapping(column="a", unit=Unit.TICKS, sign=-1),
        "right": WheelMapping(column="b", unit=Unit.TICKS),
    }
    text = "time,a,b\n0,10,20\n"
    log = read_log(write(tmp_path, text), robot(inverted=["right"], wheels=wheels))
    np.testing.assert_allclose(log.wheels, np.array([[-10, -20]]) * math.tau / TICKS)


# What each unit is, by the definition of the unit and not by our table of factors.
ONE_TURN = {
    "rad": (math.tau, 1.0),
    "deg": (360.0, 1.0),
    "rev": (1.0, 1.0),
    "ticks": (float(TICKS), 1.0),
    "m": (math.tau * RADIUS, 1.0),
    "mm": (math.tau * RADIUS * 1e3, 1.0),
    "cm": (math.tau * RADIUS * 1e2, 1.0),
    "in": (math.tau * RADIUS / 0.0254, 1.0),
    "ft": (math.tau * RADIUS / 0.3048, 1.0),
    "rad/s": (math.tau, 1.0),
    "deg/s": (360.0, 1.0),
    "rad/min": (math.tau, 60.0),
    "rpm": (1.0, 60.0),
    "rev/s": (1.0, 1.0),
    "ticks/s": (float(TICKS), 1.0),
    "m/s": (math.tau * RADIUS, 1.0),
    "mm/s": (math.tau * RADIUS * 1e3, 1.0),
    "cm/s": (math.tau * RADIUS * 1e2, 1.0),
    "ft/s": (math.tau * RADIUS / 0.3048, 1.0),
    "km/h": (math.tau * RADIUS * 3.6, 1.0),
}


@pytest.mark.parametrize("unit", ONE_TURN)
def test_one_turn_is_one_turn_in_every_unit(tmp_path, unit):
    amount, seconds = ONE_TURN[unit]
    wheels = {
        name: WheelMapping(column=k, unit=Unit(unit)) for k, name in enumerate(["left", "right"], start=1)
    }
    mapped = robot(wheels=wheels, time=TimeMapping(column=0), table=TableFormat(header=False))
    log = read_log(write(tmp_path, f"0.0,{amount * seconds!r},0\n"), mapped)
    np.testing.assert_allclose(log.wheels, [[math.tau, 0.0]], rtol=1e-14)
    assert log.reading is (Reading.VELOCITY if "/" in unit or unit == "rpm" else Reading.POSITION)


def test_every_wheel_unit_is_tested():
    assert set(ONE_TURN) == {unit.value for unit in Unit if unit.dimension != "time"}


def test_radii_are_those_of_the_measuring_wheels(tmp_path):
    tracking = TrackingWheels([(0, 0.1, 0), (0, -0.1, 0), (0.1, 0, math.pi / 2)], wheel_radius=0.02)
    names = tracking.measured_names
    text = "time," + ",".join(f"{name}.distance" for name in names) + "\n0,1,2,3\n"
    log = read_log(write(tmp_path, text), robot().with_localizer(tracking))
    assert log.wheel_names == names
    np.testing.assert_allclose(log.wheels, [[50.0, 100.0, 150.0]])


def test_steering_comes_by_wheel_or_as_one_angle(tmp_path):
    drive = Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=RADIUS)
    rear = ",".join(f"{name}.position" for name in drive.measured_names)
    front = ",".join(f"{name}.steering" for name in drive.steered_names)
    path = write(tmp_path, f"time,{rear},{front},servo\n0,1,2,0.1,0.2,30\n")
    np.testing.assert_array_equal(read_log(path, robot(drive)).steering, [[0.1, 0.2]])
    one = robot(drive, steering={"servo": ScalarMapping(column="servo", unit=Unit.DEG, sign=-1)})
    log = read_log(path, one)
    assert log.steering_names == ("servo",)
    np.testing.assert_allclose(log.steering, [[-math.pi / 6]])


def test_hostile_numbers_come_through_for_odometry_to_judge(tmp_path):
    reference = ReferenceMapping(columns=("x", "y", "a"), unit=Unit.FT, mounting=(0.1, 0.2, 0.3))
    wheels = {name: WheelMapping(column=name, unit=Unit.REV) for name in ("left", "right")}
    path = write(tmp_path, "time,left,right,x,y,a\n0,nan,1e308,inf,-inf,inf\n0,-inf,1,1e308,1,nan\n")
    log = read_log(path, robot(wheels=wheels, reference=reference))
    np.testing.assert_array_equal(log.wheels, [[np.nan, np.inf], [-np.inf, math.tau]])
    assert len(log.reference) == 0


def test_held_columns(tmp_path):
    wheels = {
        "left": WheelMapping(column="a", unit=Unit.M, hold=True),
        "right": WheelMapping(column="b", unit=Unit.M, hold=True),
    }
    text = "time,a,b\n0,1,\n1,2,7\n2,,8\n3,4,\n"
    log = read_log(write(tmp_path, text), robot(wheels=wheels))
    np.testing.assert_allclose(log.wheels * RADIUS, [[2, 7], [2, 8], [4, 8]])
    assert dict(log.rejected) == {"parse": 1}


def test_twist_columns(tmp_path):
    path = write(tmp_path, "time,u,v,w\n0,1,2,3\n1,4,5,6\n")
    log = read_log(path, robot(twist=TwistMapping(columns=("u", "v", "w"))))
    assert log.wheels is None
    np.testing.assert_array_equal(log.twists, [[1, 2, 3], [4, 5, 6]])


def test_another_mapping_replaces_the_robots_own(tmp_path):
    path = write(tmp_path, "t;left.position;right.position\n5;1;2\n")
    mapping = LogMapping(table=TableFormat(delimiter=";"), time=TimeMapping(column="t", unit=Unit.MS))
    log = read_log(path, robot(wheels={}), mapping=mapping)
    assert log.time_ns.tolist() == [5_000_000]


def test_parquet_is_read_like_text(tmp_path):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "run.parquet"
    table = {"time_ns": [1, 2], "left.ticks": [2**60 + 1, 3], "right.ticks": [5, 6]}
    parquet.write_table(pa.table(table), path)
    log = read_log(path, robot(bits=62))
    assert log.wheels.tolist() == [[2**60 + 1, 5], [3, 6]]


# ------------------------------------------------------------------------------ references


def test_reference_of_the_same_rows(tmp_path):
    """Where tracking was lost, the wheels still turned."""
    text = (
        "time,left.position,right.position,reference.x,reference.y,reference.theta\n"
        "0,1,2,5,6,0.5\n1,1,2,,,\n2,1,2,nan,nan,nan\n3,1,2,7,8,0.6\n"
    )
    log = read_log(write(tmp_path, text), robot())
    assert len(log) == 4
    assert log.reference.time_ns.tolist() == [0, 3_000_000_000]
    np.testing.assert_array_equal(log.reference.poses, [[5, 6, 0.5], [7, 8, 0.6]])
    assert not log.rejected
    assert log.warnings[0].startswith("reference: 1 row was left out")


@given(st.tuples(*[st.floats(-3, 3)] * 3))
def test_mounted_reference_becomes_that_of_the_base(tmp_path_factory, mounting):
    folder = tmp_path_factory.mktemp("mounted")
    base = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.7], [-1.0, 0.5, -3.0]])
    tracked = se2.compose(base, np.array(mounting))
    rows = [
        f"{k},0,0,{x!r},{y!r},{math.degrees(a)!r}"
        for k, (x, y, a) in enumerate((tracked * [1e3, 1e3, 1]).tolist())
    ]
    reference = ReferenceMapping(
        columns=("x", "y", "a"), unit=Unit.MM, angle_unit=Unit.DEG, mounting=mounting
    )
    path = write(folder, "\n".join(["time,left.position,right.position,x,y,a", *rows, ""]))
    log = read_log(path, robot(reference=reference))
    np.testing.assert_allclose(log.reference.poses, base, atol=1e-12)
    assert log.reference.child_frame == "base_link"


def test_reference_without_heading_stays_with_the_tracked_point(tmp_path):
    write(tmp_path, "t,x,y\n100,1,2\n200,3,4\n", "camera.csv")
    reference = ReferenceMapping(
        columns=("x", "y"),
        file="camera.csv",
        time=TimeMapping(column="t", unit=Unit.MS),
        mounting=(0.03, 0.0, 0.0),
    )
    path = write(tmp_path, "time,left.position,right.position\n0,1,2\n")
    log = read_log(path, robot(reference=reference))
    assert log.reference.time_ns.tolist() == [100_000_000, 200_000_000]
    np.testing.assert_array_equal(log.reference.poses, [[1, 2, np.nan], [3, 4, np.nan]])
    assert log.reference.child_frame == "tracked_point"


# ---------------------------------------------------------------------------------- topics


class Recording:
    """Topics in memory, behind the interface of an open recording."""

    def __init__(self, **topics) -> None:
        self.path = Path("run.bag")
        self.losses, self.warnings = ["one chunk is lost"], []
        self._topics = {f"/{name}": topic for name, topic in topics.items()}
        self.topics = {
            name: SimpleNamespace(type=kind, count=len(receive))
            for name, (kind, receive, _, _) in self._topics.items()
        }

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def read(self, topic, fields):
        _, receive, header, columns = self._topics[topic]
        missing = set(fields) - set(columns)
        if missing:
            raise LogSchema(self.path, "field", f"{topic}: no field {missing}")
        return TopicColumns(receive, header, {field: columns[field] for field in fields})


def topic(kind, time_ns, columns: Mapping, *, header=None):
    time_ns = np.asarray(time_ns, dtype=np.int64)
    return kind, time_ns, time_ns if header is None else header, dict(columns)


def joints(time_ns, names, positions, **more):
    return topic("sensor_msgs/msg/JointState", time_ns, {"name": names, "position": positions, **more})


@pytest.fixture
def read(monkeypatch, tmp_path):
    path = tmp_path / "run.bag"
    path.write_bytes(b"#ROSBAG V2.0\n")

    def read_recording(described: Robot, **topics):
        monkeypatch.setattr(bag_log, "open_bag", lambda path, salvage: Recording(**topics))
        return read_log(path, described)

    return read_recording


BOTH = {name: WheelMapping(topic="/joints") for name in ("left", "right")}


def test_joints_are_found_by_name(read):
    """In whatever order, and missing from some messages (L17)."""
    names = [("left", "right"), ("arm", "right", "left"), ("arm",), ("right", "left")]
    positions = [np.array(row, float) for row in ([1, 2], [9, 4, 3], [9], [6, 5])]
    log = read(robot(wheels=BOTH), joints=joints([10, 20, 30, 40], names, positions))
    np.testing.assert_array_equal(log.wheels, [[1, 2], [3, 4], [5, 6]])
    assert log.time_ns.tolist() == [10, 20, 40]
    assert dict(log.rejected) == {"missing_joint": 1}
    assert log.warnings[0] == "one chunk is lost"


def test_other_names_fields_and_units(read):
    wheels = {
        name: WheelMapping(topic="/joints", name=f"{name}_joint", field="velocity", unit=Unit.RPM, sign=-1)
        for name in ("left", "right")
    }
    velocity = {"velocity": np.array([[60.0, 120.0], [30.0, 0.0]])}
    names = ("right_joint", "left_joint")
    log = read(robot(wheels=wheels), joints=joints([1, 2], names, np.empty((2, 0)), **velocity))
    assert log.reading is Reading.VELOCITY
    np.testing.assert_allclose(log.wheels, np.array([[-2, -1], [0, -0.5]]) * math.tau)


def test_counts_that_messages_hold_as_floats(read):
    wheels = {name: WheelMapping(topic="/joints", unit=Unit.TICKS) for name in ("left", "right")}
    counts = np.array([[1.0, 2.0], [np.nan, 3.0], [4.0, 5.5], [6.0, 7.0]])
    log = read(robot(wheels=wheels, bits=16), joints=joints([1, 2, 3, 4], ("left", "right"), counts))
    assert log.wheels.tolist() == [[1, 2], [6, 7]]
    assert dict(log.rejected) == {"nonfinite": 1, "parse": 1}


def separate(*, kind=None, hold=False, unit=Unit.RAD) -> dict[str, WheelMapping]:
    return {
        name: WheelMapping(topic=f"/{name}", kind=kind, unit=unit, hold=hold) for name in ("left", "right")
    }


def test_separate_topics_meet_on_the_first_wheels_rows(read):
    left = np.arange(0, 1_000_000_001, 100_000_000)
    right = np.arange(150_000_000, 950_000_000, 130_000_000)
    log = read(
        robot(wheels=separate()),
        left=topic("std_msgs/msg/Float64", 10**18 + left, {"data": 2e-9 * left}),
        right=topic("std_msgs/msg/Float64", 10**18 + right, {"data": 3e-9 * right}),
    )
    rows = left[(left >= right[0]) & (left <= right[-1])]
    assert (log.time_ns - 10**18).tolist() == rows.tolist()
    np.testing.assert_allclose(log.wheels, np.stack([2e-9 * rows, 3e-9 * rows], axis=-1), rtol=1e-12)
    assert dict(log.rejected) == {"unmatched": len(left) - len(rows)}


def test_separate_increments_keep_their_sum(read):
    left, right = np.arange(20) * 100_000_000, np.arange(20) * 100_000_000 - 30_000_000
    log = read(
        robot(wheels=separate(kind=Kind.INCREMENT)),
        left=topic("std_msgs/msg/Float64", left, {"data": np.ones(20)}),
        right=topic("std_msgs/msg/Float64", right, {"data": np.full(20, 0.5)}),
    )
    assert log.reading is Reading.INCREMENT
    np.testing.assert_allclose(log.wheels[1:], [[1.0, 0.5]] * (len(log) - 1))


def test_separate_counters_become_angles_across_their_wraps(read):
    left, right = np.arange(50) * 10_000_000, np.arange(50) * 10_000_000 + 5_000_000
    counts = {"data": (np.arange(50) * 3000 - 32768 + 32768) % 65536 - 32768}
    log = read(
        robot(wheels=separate(unit=Unit.TICKS), bits=16),
        left=topic("std_msgs/msg/Int16", left, {"data": counts["data"].astype(np.int16)}),
        right=topic("std_msgs/msg/Int16", right, {"data": counts["data"].astype(np.int16)}),
    )
    assert log.reading is Reading.POSITION
    np.testing.assert_allclose(np.diff(log.wheels, axis=0), 3000 * math.tau / TICKS)


def test_held_topics_keep_their_last_value(read):
    log = read(
        robot(wheels=separate(hold=True, unit=Unit.TICKS), bits=16),
        left=topic("std_msgs/msg/Int16", [10, 20, 30, 40], {"data": np.array([1, 2, 3, 4])}),
        right=topic("std_msgs/msg/Int16", [15, 40], {"data": np.array([7, 8])}),
    )
    assert log.reading is Reading.TICKS
    assert log.time_ns.tolist() == [15, 20, 30, 40]  # whatever changes makes a row
    assert log.wheels.tolist() == [[1, 7], [2, 7], [3, 7], [4, 8]]


def test_elements_of_plain_arrays(read):
    wheels = {
        name: WheelMapping(topic="/ticks", name=k, unit=Unit.TICKS, kind=Kind.POSITION)
        for k, name in enumerate(["left", "right"])
    }
    data = {"data": np.array([[1, 2], [3, 4]], dtype=np.int32)}
    log = read(robot(wheels=wheels, bits=32), ticks=topic("std_msgs/msg/Int32MultiArray", [1, 2], data))
    assert log.wheels.tolist() == [[1, 2], [3, 4]]


def test_gyro_and_steering_of_other_topics(read):
    drive = Bicycle(wheelbase=0.3, wheel_radius=RADIUS)
    (rear,), (front,) = drive.measured_names, drive.steered_names
    time_ns = np.arange(5) * 100_000_000
    described = robot(
        drive,
        wheels={rear: WheelMapping(topic="/joints")},
        steering={front: ScalarMapping(topic="/servo", unit=Unit.DEG, hold=True)},
        gyro=ScalarMapping(topic="/imu", unit=Unit.DEG_S),
    )
    log = read(
        described,
        joints=joints(time_ns, (rear,), np.ones((5, 1))),
        servo=topic("std_msgs/msg/Float64", [0, 250_000_000], {"data": np.array([0.0, 30.0])}),
        imu=topic("sensor_msgs/msg/Imu", time_ns - 50_000_000, {"angular_velocity.z": np.arange(5) * 10.0}),
    )
    assert log.time_ns.tolist() == time_ns[:4].tolist()
    np.testing.assert_allclose(log.steering[:, 0], [0, 0, 0, math.pi / 6])
    np.testing.assert_allclose(log.yaw_rate, np.radians([5, 15, 25, 35]))


TWIST = {f"twist.twist.{part}": np.array([1.0, 2.0]) for part in ("linear.x", "linear.y", "angular.z")}


def test_a_robot_that_publishes_only_its_twist(read):
    described = robot(twist=TwistMapping(topic="/odom"))
    log = read(described, odom=topic("nav_msgs/msg/Odometry", [1, 2], TWIST))
    assert log.wheels is None
    np.testing.assert_array_equal(log.twists, [[1, 1, 1], [2, 2, 2]])


@pytest.mark.parametrize(
    ("kind", "prefix"), [("geometry_msgs/msg/PoseStamped", "pose."), ("nav_msgs/msg/Odometry", "pose.pose.")]
)
def test_reference_topic(read, kind, prefix):
    yaw = np.array([0.3, -2.0])
    columns = {
        "position.x": [1.0, 2.0],
        "position.y": [3.0, 4.0],
        "orientation.x": [0, 0],
        "orientation.y": [0, 0],
    }
    columns |= {"orientation.z": 2 * np.sin(yaw / 2), "orientation.w": 2 * np.cos(yaw / 2)}
    columns = {prefix + name: np.asarray(values, float) for name, values in columns.items()}
    described = robot(twist=TwistMapping(topic="/odom"), reference=ReferenceMapping(topic="/truth"))
    odom = topic("nav_msgs/msg/Odometry", [1, 2], TWIST)
    log = read(described, odom=odom, truth=topic(kind, [5, 6], columns))
    np.testing.assert_allclose(log.reference.poses, [[1, 3, 0.3], [2, 4, -2.0]], rtol=1e-15)
    assert log.reference.time_ns.tolist() == [5, 6]


STAMPS = 10**18 + np.arange(10) * 100_000_000


def two_clocks(read, clock, header):
    described = robot(wheels=BOTH, clock=clock)
    kind, receive, _, columns = joints(STAMPS, ("left", "right"), np.ones((10, 2)))
    return read(described, joints=(kind, receive, header, columns))


def test_the_mapping_chooses_the_clock(read):
    header = STAMPS - 7
    assert two_clocks(read, Clock.HEADER, header).time_ns.tolist() == header.tolist()
    assert two_clocks(read, Clock.RECEIVE, header).time_ns.tolist() == STAMPS.tolist()


@pytest.mark.parametrize("header", [None, np.zeros(10, dtype=np.int64)], ids=["none", "zeros"])
def test_messages_without_stamps_use_the_time_of_receipt(read, header):
    log = two_clocks(read, Clock.HEADER, header)
    assert log.time_ns.tolist() == STAMPS.tolist()
    assert "/joints: its messages bear no stamp" in log.warnings[-1]


# --------------------------------------------------------------------------------- resampling


@given(
    st.lists(st.integers(-(2**20), 2**20), min_size=1, max_size=30),
    st.sampled_from([8, 16, 32, 63, 64, None]),
)
def test_unwrapping_undoes_wrapping(steps, bits):
    steps = np.array(steps) % 100 - 50 if bits == 8 else np.array(steps) % 30_000 - 15_000
    totals = np.cumsum(steps)
    span = 64 if bits is None else bits
    wrapped = [((int(total) + (1 << (span - 1))) % (1 << span)) - (1 << (span - 1)) for total in totals]
    counts = np.array(wrapped, dtype=np.int64)
    np.testing.assert_array_equal(resampling.unwrapped(counts, bits), totals - totals[0])


def test_nothing_is_interpolated_over_a_hole_or_beyond_the_ends():
    own = np.array([0, 100, 100 + 2 * resampling.LONGEST_BRIDGE_NS])
    wanted = np.array([-1, 0, 50, 100, 200, own[-1], own[-1] + 1])
    values, known = resampling.interpolated(wanted, own, np.array([0.0, 1.0, 2.0]))
    assert known.tolist() == [False, True, True, True, False, True, False]
    np.testing.assert_allclose(values[known], [0.0, 0.5, 1.0, 2.0])


# ----------------------------------------------------------------------------------- faults


def refused(text, error, reason, *words, **log):
    def check(folder, read):
        with pytest.raises(error) as caught:
            read_log(write(folder, text), robot(**log))
        assert reason in (getattr(caught.value, "reason", None), getattr(caught.value, "field", None))
        assert all(word in str(caught.value) for word in words)

    return check


def topics_refused(error, reason, *words, wheels, **topics):
    def check(folder, read):
        with pytest.raises(error) as caught:
            read(robot(wheels=wheels), **topics)
        assert reason in (getattr(caught.value, "reason", None), getattr(caught.value, "field", None))
        assert all(word in str(caught.value) for word in words)

    return check


def order_changes(folder, read):
    test_joints_are_found_by_name(read)


def clocks_disagree(folder, read):
    header = STAMPS + np.arange(10) ** 2 * 10_000_000  # ever later, and never back
    log = two_clocks(read, Clock.HEADER, header)
    assert log.time_ns.tolist() == header.tolist()
    skew = np.std(STAMPS - header) * 1e-9
    assert f"(standard deviation {skew:.3g} s)" in log.warnings[-1]
    assert len(two_clocks(read, Clock.HEADER, STAMPS - 5 * 3600 * 10**9).warnings) == 1


POSITIONS = "time,left.position,right.position\n"
STEERED = Tricycle(wheelbase=0.3, wheel_radius=RADIUS)
A_TWIST = topic("nav_msgs/msg/Odometry", [1, 2], TWIST)
SOME_JOINTS = joints([1, 2], ("left_wheel", "right"), np.ones((2, 2)))

FAULTS = {
    "L8-column": refused(
        "time,left.position,rigth.position\n0,1,2\n",
        LogSchema,
        "column",
        "'right.position'",
        "mean 'rigth.position'",
    ),
    "L8-no-wheel": refused("time,a,b\n0,1,2\n", LogSchema, "column", "'left.position'", "time, a, b"),
    "L8-no-time": refused("t,left.position,right.position\n0,1,2\n", LogSchema, "column", "'time'"),
    "L8-several": refused(
        "time,left.position,right.position,left.ticks,right.ticks\n0,1,2,3,4\n",
        LogSchema,
        "ambiguous",
        "<wheel>.position and <wheel>.ticks",
    ),
    "L8-steering": refused(
        "time,front.position\n0,1\n", LogSchema, "column", "'front.steering'", drive=STEERED
    ),
    "L8-topic": topics_refused(
        LogSchema,
        "topic",
        "mean '/joints'",
        "/odom",
        wheels={n: WheelMapping(topic="/joint") for n in BOTH},
        joints=SOME_JOINTS,
        odom=A_TWIST,
    ),
    "L8-no-topic": topics_refused(
        LogSchema, "topic", "log.wheels", "/odom (nav_msgs/msg/Odometry)", wheels={}, odom=A_TWIST
    ),
    "L8-joint": topics_refused(
        LogSchema, "joint", "'left'", "left_wheel, right", wheels=BOTH, joints=SOME_JOINTS
    ),
    "L8-field": topics_refused(
        LogSchema,
        "field",
        "say which field",
        wheels={n: WheelMapping(topic="/odom") for n in BOTH},
        odom=A_TWIST,
    ),
    "L12-time-s": refused(
        POSITIONS + "".join(f"{k}000,1,2\n" for k in range(9)),
        LogSchema,
        "unit",
        "1e+03 s apart",
        "log.time.unit",
    ),
    "L12-time-since-1970": refused(
        POSITIONS + "".join(f"17000000000{k}0,1,2\n" for k in range(9)), LogSchema, "unit", "unit of the time"
    ),
    "L12-time-cut": refused(
        POSITIONS + "".join(f"17000000000000000{k}0,1,2\n" for k in range(9)) + "1700000000000000090,1",
        LogSchema,
        "unit",
        "9 of 10 rows are stamped beyond 292 years",
        "line 2",
    ),
    "L12-time-ns": refused(
        "time_ns,left.position,right.position\n0,1,2\n20,1,2\n40,1,2\n", LogSchema, "unit"
    ),
    "L12-time-ns-in-s": refused(
        POSITIONS.replace("time,", "time_ns,") + "".join(f"{k / 30:.9f},1,2\n" for k in range(90)),
        LogSchema,
        "unit",
        "90 rows in 3e-09 s",
        "declare log.time.unit: s?",
    ),
    "L12-reference-length": refused(
        POSITIONS.replace("\n", ",x,y\n") + "".join(f"{k / 2},1,2,{150 * k},0\n" for k in range(20)),
        LogSchema,
        "unit",
        "as m the reference moves at 300 m/s",
        "log.reference.unit: mm",
        reference=ReferenceMapping(columns=("x", "y")),
    ),
    "L12-reference-angle": refused(
        POSITIONS.replace("\n", ",x,y,a\n") + "".join(f"{k / 2},1,2,1,2,{30 * k % 360}\n" for k in range(20)),
        LogSchema,
        "unit",
        "as rad the reference turns at 60 rad/s",
        "angle_unit: deg",
        reference=ReferenceMapping(columns=("x", "y", "a")),
    ),
    "L12-steering": refused(
        "time,front.position,front.steering\n0,1,5\n1,1,-15\n",
        LogSchema,
        "unit",
        "15 rad",
        "unit: deg",
        drive=STEERED,
    ),
    "L16-clocks": clocks_disagree,
    "L17-order": order_changes,
    "C5-wheel": refused(
        POSITIONS + "0,1,2\n",
        ConfigError,
        "log.wheels.lefft",
        "mean 'left'",
        wheels={"lefft": WheelMapping(column=1)},
    ),
    "C5-missing-wheel": refused(
        POSITIONS + "0,1,2\n", ConfigError, "log.wheels.right", wheels={"left": WheelMapping(column=1)}
    ),
    "C5-topic-of-a-table": refused(
        POSITIONS + "0,1,2\n", ConfigError, "log.wheels.left.topic", "is a table", wheels=BOTH
    ),
    "C5-column-of-a-bag": topics_refused(
        ConfigError,
        "log.wheels.left.column",
        wheels={n: WheelMapping(column=1) for n in BOTH},
        joints=SOME_JOINTS,
    ),
    "C5-gyro-unit": refused(
        POSITIONS + "0,1,2\n",
        ConfigError,
        "log.gyro.unit",
        "rad/s",
        "a heading is not read, log the rate",
        gyro=ScalarMapping(column=1, unit=Unit.RAD),
    ),
    "C5-two-kinds": refused(
        POSITIONS + "0,1,2\n",
        ConfigError,
        "log.wheels",
        "left: position, right: velocity",
        wheels={"left": WheelMapping(column=1), "right": WheelMapping(column=2, unit=Unit.RPM)},
    ),
}


@pytest.mark.parametrize("check", [pytest.param(check, id=row) for row, check in FAULTS.items()])
def test_fault(tmp_path, read, check):
    check(tmp_path, read)


def test_ticks_need_encoders(tmp_path):
    path = write(tmp_path, "time,left.ticks,right.ticks\n0,1,2\n")
    with pytest.raises(ConfigError, match=r"encoders\.left: missing"):
        read_log(path, DRIVE)


def test_free_wheels_may_turn_round_where_robot_yaml_says_rad(tmp_path):
    drive = Swerve(modules=[(0.2, 0.2), (-0.2, 0.2), (0.0, -0.2)], wheel_radius=RADIUS)
    names = drive.wheel_names
    header = ",".join([f"{n}.position" for n in names] + [f"{n}.steering" for n in names])
    path = write(tmp_path, f"time,{header}\n0,0,0,0,20,0,0\n")
    with pytest.raises(LogSchema, match="unit: deg"):
        read_log(path, robot(drive))
    steering = {name: ScalarMapping(column=f"{name}.steering", unit=Unit.RAD) for name in names}
    assert read_log(path, robot(drive, steering=steering)).steering[0, 0] == 20.0


def test_a_gyro_that_the_log_lacks_is_missed(tmp_path):
    path = write(tmp_path, POSITIONS + "0,1,2\n")
    with_gyro = Differential(track_width=0.2, wheel_radius=RADIUS, measured=("left", "right", "gyro"))
    log = read_log(path, with_gyro)
    assert log.wheel_names == ("left", "right")
    assert "gyro" in log.warnings[0]


# ------------------------------------------------------------------------------- recordings


def check_ate(described: Robot, path: Path, expected: float, tolerance: float) -> None:
    """The nominal figure of ../shared/data/README.md, which others computed."""
    log = read_log(path, described)
    estimate = integrate(described, log)
    assert log.reference.child_frame == "base_link"
    ate = compare(estimate, log.reference).position.rmse
    assert ate == pytest.approx(expected, rel=tolerance)


def test_optiodom_differential(shared_data):
    wheels = {
        name: WheelMapping(column=k, unit=Unit.TICKS, kind=Kind.INCREMENT)
        for k, name in ((4, "right"), (5, "left"))
    }
    described = Robot(
        drive=Differential(track_width=0.2, wheel_radius=0.042),
        encoders={name: Encoder(ticks_per_revolution=2796.8) for name in wheels},
        log=LogMapping(
            table=TableFormat(header=False),
            time=TimeMapping(column=0),
            wheels=wheels,
            reference=ReferenceMapping(columns=(1, 2, 3)),
        ),
    )
    folder = shared_data / "optiodom" / "diff" / "circular" / "250620202104"
    check_ate(described, folder / "250620202104_run-01.csv", 0.0153, 0.02)


def test_polimi_mecanum(shared_data):
    drive = Mecanum(track_width=2 * 0.169, wheelbase=2 * 0.2, wheel_radius=0.07)
    joints_of = dict(
        zip(drive.wheel_names, ["front_left", "front_right", "rear_left", "rear_right"], strict=True)
    )
    described = Robot(
        drive=drive,
        encoders={name: Encoder(ticks_per_revolution=5 * 42) for name in joints_of},
        log=LogMapping(
            wheels={
                name: WheelMapping(topic="/wheel_states", name=joint, unit=Unit.TICKS)
                for name, joint in joints_of.items()
            },
            reference=ReferenceMapping(topic="/robot/pose"),
        ),
    )
    check_ate(described, shared_data / "polimi_mecanum" / "bag1.bag", 0.102, 0.05)
