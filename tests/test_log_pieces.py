"""Logs read in pieces: the rows, the warnings and the refusals of the whole."""

from __future__ import annotations

import dataclasses
import json
import sqlite3
import struct
from collections import Counter
from functools import cache

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

import trundle as tr
from trundle.adapters.bag_log import bag_log_pieces
from trundle.adapters.log import read_log_pieces
from trundle.adapters.mcap_writer import Channel, McapWriter
from trundle.adapters.trajectory_pieces import write_trajectory_pieces
from trundle.apps.cli import main
from trundle.odometry.integrate import integrate_pieces
from trundle.robot.log_mapping import Clock, LogMapping, TwistMapping, WheelMapping

DRIVE = tr.Differential(track_width=0.2, wheel_radius=0.04)
TABLES = {
    "positions": ("time,left.position,right.position", lambda k: f"{k * 0.02:.2f},{0.1 * k!r},{0.11 * k!r}"),
    "ticks": ("time_ns,left.ticks,right.ticks", lambda k: f"{k * 20_000_000},{k % 256},{3 * k % 256}"),
}


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch):
    """Pieces of some hundred rows instead of a quarter of a million."""
    monkeypatch.setattr("trundle.adapters.text_table.BLOCK", 1500)
    monkeypatch.setattr("trundle.adapters.table_log.PIECE", 200)
    monkeypatch.setattr("trundle.adapters.json_lines.ROWS_AT_ONCE", 70)
    monkeypatch.setattr("trundle.adapters.bag_log.PIECE", 100)
    monkeypatch.setattr("trundle.adapters.rosbag2.ROWS_AT_ONCE", 70)


def written(path, name, count, change=lambda rows: rows):
    header, row = TABLES[name]
    path.write_text("\n".join([header, *change([row(k) for k in range(count)])]) + "\n")
    return path


def robot():
    return tr.Robot(
        drive=DRIVE, encoders=dict.fromkeys(DRIVE.wheel_names, tr.Encoder(ticks_per_revolution=256, bits=8))
    )


def check(path, described=None, *, least=5, **how):
    described = described or robot()
    whole = tr.read_log(path, described, **how)
    pieces = list(read_log_pieces(path, described, **how))
    assert len(pieces) >= least
    for column in ("time_ns", "wheels", "twists"):
        if (expected := getattr(whole, column)) is not None:
            joined = np.concatenate([getattr(piece, column) for piece in pieces])
            assert joined.tobytes() == expected.tobytes()
    assert [loss for piece in pieces for loss in piece.losses] == list(whole.losses)
    assert sum((Counter(piece.rejected) for piece in pieces), Counter()) == Counter(whole.rejected)
    assert sorted(said for piece in pieces for said in piece.warnings) == sorted(whole.warnings)
    return whole


@pytest.mark.parametrize("name", TABLES)
def test_pieces_are_the_whole(tmp_path, name):
    assert len(check(written(tmp_path / "log.csv", name, 3000))) == 3000


def test_late_rows_find_their_place_across_borders(tmp_path):
    def shuffled(rows):
        order = np.argsort(np.arange(len(rows)) + np.random.default_rng(0).uniform(0, 45, len(rows)))
        return [rows[k] for k in order]

    assert "put in order" in "".join(
        check(written(tmp_path / "log.csv", "positions", 3000, shuffled)).warnings
    )


def test_unreadable_rows_are_counted_once(tmp_path):
    def spoilt(rows):
        return ["oops,1,2" if k % 500 == 7 else row for k, row in enumerate(rows)]

    assert check(written(tmp_path / "log.csv", "positions", 3000, spoilt)).rejected == {"parse": 6}


def test_durations_add_up_across_borders(tmp_path):
    mapping = {"time": {"column": "dt", "unit": "s", "kind": "increment"}}
    path = tmp_path / "log.csv"
    path.write_text(
        "dt,left.position,right.position\n" + "".join(f"0.02,{0.1 * k},{0.1 * k}\n" for k in range(3000))
    )
    (tmp_path / "robot.yaml").write_text(
        f"drive: {{type: differential, track_width: 0.2, wheel_radius: 0.04}}\nlog: {mapping}\n"
    )
    described = tr.load_robot(tmp_path / "robot.yaml")
    whole, pieces = tr.read_log(path, described), list(read_log_pieces(path, described))
    assert len(pieces) > 4
    assert np.concatenate([piece.time_ns for piece in pieces]).tolist() == whole.time_ns.tolist()


def test_rows_a_whole_piece_late_are_refused(tmp_path):
    path = written(tmp_path / "log.csv", "positions", 3000, lambda rows: rows[1000:] + rows[:1000])
    with pytest.raises(tr.LogError, match="before a row above it"):
        list(read_log_pieces(path, robot()))


def test_a_file_that_changes_is_refused(tmp_path):
    pieces = read_log_pieces(written(tmp_path / "log.csv", "positions", 3000), robot())
    next(pieces)
    with (tmp_path / "log.csv").open("a") as file:
        file.write("60.0,300.0,330.0\n")
    with pytest.raises(tr.LogError, match="changed from"):
        list(pieces)


# -------------------------------------------------------------------------- other tables


def json_lines(path, rows, spoil=lambda lines: lines):
    lines = [
        json.dumps({"time": t, "left.position": left, "right.position": right}) for t, left, right in rows
    ]
    path.write_text("\n".join(spoil(lines)) + "\n")
    return path


def parquet(path, rows):
    pa, writer = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = zip(*rows, strict=True)
    names = ("time", "left.position", "right.position")
    writer.write_table(
        pa.table({n: pa.array(c, pa.float64()) for n, c in zip(names, columns, strict=True)}),
        path,
        row_group_size=450,
    )
    return path


def rows_of(count=3000):
    return [(0.02 * k, 0.1 * k, 0.11 * k) for k in range(count)]


@pytest.mark.parametrize("write", [json_lines, parquet])
def test_other_tables_in_pieces_are_the_whole(tmp_path, write):
    assert len(check(write(tmp_path / "log", rows_of()), least=10)) == 3000


@pytest.mark.parametrize("write", [json_lines, parquet])
def test_rows_without_a_number_are_counted_once(tmp_path, write):
    rows = [(t, None if k % 500 == 7 else left, right) for k, (t, left, right) in enumerate(rows_of())]
    rows[1234] = (None, 1.0, 2.0)
    log = check(write(tmp_path / "log", rows), least=10)
    assert len(log) == 2993
    assert log.rejected == {"parse": 7}


@pytest.mark.parametrize("write", [json_lines, parquet])
def test_values_are_held_across_borders(tmp_path, write):
    rows = [(t, left if k % 35 == 0 else None, right) for k, (t, left, right) in enumerate(rows_of())]
    held = WheelMapping(column="left.position", hold=True)
    described = tr.Robot(
        drive=DRIVE, log=LogMapping(wheels={"left": held, "right": WheelMapping(column="right.position")})
    )
    log = check(write(tmp_path / "log", rows), described, least=10)
    assert log.wheels[:, 0].tolist() == [0.1 * (k - k % 35) for k in range(3000)]


@pytest.mark.parametrize("write", [json_lines, parquet])
def test_tables_without_a_whole_row_are_refused_as_ever(tmp_path, write):
    path = write(tmp_path / "log", [(t, None, right) for t, _, right in rows_of()] + [(None, 1.0, 1.0)])
    said = []
    for read in (tr.read_log, lambda *words: list(read_log_pieces(*words))):
        with pytest.raises(tr.LogSchema, match="number") as caught:
            read(path, robot())
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_lines_that_are_no_json_are_counted_once(tmp_path):
    def spoilt(lines):
        return ['{"time": 1' if k % 700 == 300 else line for k, line in enumerate(lines)]

    log = check(json_lines(tmp_path / "log", rows_of(), spoilt), least=10)
    assert log.rejected == {"parse": 4}


@pytest.mark.parametrize("suffix", [".tum", ".csv"])
def test_trajectories_are_written_as_they_come(tmp_path, suffix):
    path = written(tmp_path / "log.csv", "positions", 3000)
    whole = tr.integrate(robot(), tr.read_log(path, robot()))
    tr.write_trajectory(whole, tmp_path / f"whole{suffix}")
    cuts = [slice(0, 1000), slice(1000, 1001), slice(1001, None)]
    pieces = [
        dataclasses.replace(
            whole,
            time_ns=whole.time_ns[rows],
            poses=whole.poses[rows],
            twists=whole.twists[rows],
            covariances=whole.covariances[rows],
        )
        for rows in cuts
    ]
    write_trajectory_pieces(iter(pieces), tmp_path / f"pieces{suffix}")
    assert (tmp_path / f"pieces{suffix}").read_bytes() == (tmp_path / f"whole{suffix}").read_bytes()


def test_a_reading_that_fails_leaves_no_file(tmp_path):
    path = written(tmp_path / "log.csv", "positions", 3000, lambda rows: rows[1000:] + rows[:1000])
    pieces = integrate_pieces(robot(), read_log_pieces(path, robot()))
    with pytest.raises(tr.LogError):
        write_trajectory_pieces(pieces, tmp_path / "out.tum")
    assert [file.name for file in tmp_path.iterdir()] == ["log.csv"]


def test_formats_with_an_end_are_refused(tmp_path):
    with pytest.raises(tr.InputError, match="cannot be written in pieces"):
        write_trajectory_pieces([], tmp_path / "out.mcap")


# ----------------------------------------------------------------------------------------- MCAP

JOINTS, ODOMETRY = "sensor_msgs/msg/JointState", "nav_msgs/msg/Odometry"
NAMES = ("left", "right")
START = 10**18


@cache
def store():
    return get_typestore(Stores.ROS2_HUMBLE)


def header(ns):
    kinds = store().types
    stamp = kinds["builtin_interfaces/msg/Time"](ns // 10**9, ns % 10**9)
    return kinds["std_msgs/msg/Header"](stamp, "base_link")


def joints(k, *, names=NAMES, stamped=True):
    turned = {"left": 0.1 * k, "right": 0.11 * k, "other": 7.0}
    values = np.array([turned[name] for name in names])
    ns = START + 20_000_000 * k if stamped else 0
    message = store().types[JOINTS](header(ns), list(names), values, values, np.zeros(0))
    return bytes(store().serialize_cdr(message, JOINTS))


def odometry(k):
    kinds = {name.rpartition("/")[2]: kind for name, kind in store().types.items()}
    twist = kinds["Twist"](kinds["Vector3"](0.1 + 1e-3 * k, 0.0, 0.0), kinds["Vector3"](0.0, 0.0, 0.2))
    pose = kinds["Pose"](kinds["Point"](0.0, 0.0, 0.0), kinds["Quaternion"](0.0, 0.0, 0.0, 1.0))
    message = kinds["Odometry"](
        header(START + 20_000_000 * k),
        "base_link",
        kinds["PoseWithCovariance"](pose, np.zeros(36)),
        kinds["TwistWithCovariance"](twist, np.zeros(36)),
    )
    return bytes(store().serialize_cdr(message, ODOMETRY))


def recorded(path, message=joints, kind=JOINTS, chunks=None, indexed=lambda ns: ns):
    """An MCAP of messages by their numbers, chunk by chunk; each received 5 ms after its stamp."""
    schema = store().generate_msgdef(kind, ros_version=2)[0]
    with path.open("wb") as file, McapWriter(file, [Channel("/wheels", kind, schema)]) as writer:
        for chunk in chunks or np.arange(600).reshape(-1, 20).tolist():
            records, stamps, starts = b"", [], []
            for k in chunk:
                ns, cdr = START + 20_000_000 * k + 5_000_000, message(k)
                stamps.append(ns)
                starts.append(len(records))
                records += struct.pack("<BQHIQQ", 5, 22 + len(cdr), 1, k, ns, ns) + cdr
            writer.add(records, {1: (indexed(np.array(stamps)), np.array(starts))})
    return path


def wheels_robot(**options):
    mapping = {name: WheelMapping(topic="/wheels", name=name) for name in NAMES}
    return tr.Robot(drive=DRIVE, log=LogMapping(wheels=mapping, **options))


def test_recordings_come_by_chunks(tmp_path):
    assert len(check(recorded(tmp_path / "run.mcap"), wheels_robot())) == 600


def test_a_topic_of_twists_comes_by_chunks(tmp_path):
    described = tr.Robot(drive=DRIVE, log=LogMapping(twist=TwistMapping(topic="/wheels")))
    log = check(recorded(tmp_path / "run.mcap", odometry, ODOMETRY), described)
    assert len(log.twists) == 600


# ----------------------------------------------------------------------------- older bags


def sqlite3_bag(folder, order=range(600), **how):
    """A rosbag2 of messages by their numbers, in this order, between those of another topic."""
    (folder / "bag").mkdir()
    with sqlite3.connect(folder / "bag" / "bag_0.db3") as database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.executemany(
            "INSERT INTO topics VALUES (?, ?, ?, 'cdr')", [(1, "/wheels", JOINTS), (2, "/x", JOINTS)]
        )
        database.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            [
                (topic, START + 20_000_000 * k + 5_000_000, joints(k, **how))
                for k in order
                for topic in ((1, 2) if k % 3 else (1,))
            ],
        )
    database.close()
    return folder / "bag"


def rosbag1(folder, order=range(600), **how):
    """A ROS 1 bag of messages by their numbers, in this order, in chunks of 50."""
    from rosbags.rosbag1 import Writer

    noetic = get_typestore(Stores.ROS1_NOETIC)
    with Writer(folder / "run.bag") as writer:
        writer.chunk_threshold = 9000
        connection = writer.add_connection("/wheels", JOINTS, typestore=noetic)
        for k in order:
            message = store().deserialize_cdr(joints(k, **how), JOINTS)
            head = message.header
            kinds = noetic.types
            stamp = kinds["builtin_interfaces/msg/Time"](head.stamp.sec, head.stamp.nanosec)
            one = kinds[JOINTS](
                kinds["std_msgs/msg/Header"](k, stamp, head.frame_id),
                message.name,
                message.position,
                message.velocity,
                message.effort,
            )
            ns = START + 20_000_000 * k + 5_000_000
            writer.write(connection, ns, noetic.serialize_ros1(one, JOINTS))
    return folder / "run.bag"


@pytest.mark.parametrize("write", [sqlite3_bag, rosbag1])
def test_older_bags_come_in_pieces(tmp_path, write):
    assert len(check(write(tmp_path), wheels_robot())) == 600


@pytest.mark.parametrize("write", [sqlite3_bag, rosbag1])
def test_older_bags_of_which_parts_overlap(tmp_path, write):
    """Some messages come long after their time, and what they belong to waits for them."""
    order = [*range(100), *range(140, 420), *range(100, 140), *range(420, 600)]
    assert len(check(write(tmp_path, order), wheels_robot(), least=3)) == 600


@pytest.mark.parametrize("write", [sqlite3_bag, rosbag1])
def test_older_bags_backwards_come_as_one(tmp_path, write):
    assert len(check(write(tmp_path, range(599, -1, -1)), wheels_robot(), least=1)) == 600


def test_a_split_recording_comes_file_by_file(tmp_path):
    chunks = np.arange(600).reshape(-1, 20).tolist()
    for part, taken in enumerate((chunks[:13], chunks[13:])):
        recorded(tmp_path / f"run_{part}.mcap", chunks=taken)
    assert len(check(tmp_path, wheels_robot())) == 600


def test_chunks_that_overlap_come_together(tmp_path):
    """Two threads that record: the chunks of every second one reach into the one behind it."""
    order = np.arange(600).reshape(-1, 40)
    chunks = [part for pair in order for part in (pair[::2].tolist(), pair[1::2].tolist())]
    assert len(check(recorded(tmp_path / "run.mcap", chunks=chunks), wheels_robot())) == 600
    across = [np.arange(600)[::2].tolist(), np.arange(600)[1::2].tolist()]
    check(recorded(tmp_path / "run.mcap", chunks=across), wheels_robot(), least=1)


def test_joints_that_come_late_or_in_another_order(tmp_path):
    def late(k):
        return joints(k, names=("other",) if k < 250 else ("right", "other", "left") if k % 2 else NAMES)

    log = check(recorded(tmp_path / "run.mcap", late), wheels_robot())
    assert log.rejected == {"missing_joint": 250}


def test_a_joint_that_never_comes_is_refused_as_ever(tmp_path):
    path = recorded(tmp_path / "run.mcap", lambda k: joints(k, names=("left", "other")))
    for read in (tr.read_log, lambda *words: list(read_log_pieces(*words))):
        with pytest.raises(tr.LogSchema, match="no message has an element 'right'"):
            read(path, wheels_robot())


@pytest.mark.parametrize("clock", Clock)
def test_clocks_that_disagree_are_told(tmp_path, clock):
    """Messages without stamps at first, or throughout; and a receive clock that drifts away."""
    unstamped = recorded(tmp_path / "none.mcap", lambda k: joints(k, stamped=False))
    check(unstamped, wheels_robot(clock=clock), least=1 if clock is Clock.HEADER else 5)
    late = recorded(tmp_path / "late.mcap", lambda k: joints(k * 11 // 10))
    said = check(late, wheels_robot(clock=clock)).warnings
    assert ("standard deviation" in " ".join(said)) == (clock is Clock.HEADER)


def test_damage_is_lost_once(tmp_path):
    path = recorded(tmp_path / "run.mcap")
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 1
    path.write_bytes(content)
    with pytest.raises(tr.LogCorrupt):
        list(read_log_pieces(path, wheels_robot()))
    assert len(check(path, wheels_robot(), salvage=True).losses) == 1


def test_what_needs_the_whole_is_one_piece(tmp_path):
    held = {name: WheelMapping(topic="/wheels", name=name, hold=True) for name in NAMES}
    path = recorded(tmp_path / "run.mcap")
    described = tr.Robot(drive=DRIVE, log=LogMapping(wheels=held))
    (log,) = bag_log_pieces(path, described, described.log)
    assert log.wheels.tobytes() == tr.read_log(path, described).wheels.tobytes()


def test_an_index_that_lies_is_refused(tmp_path):
    """It says that chunks follow each other, which were received the other way round."""
    chunks = np.arange(600).reshape(-1, 20)[::-1].tolist()
    path = recorded(tmp_path / "run.mcap", chunks=chunks, indexed=lambda ns: 3 * START - ns)
    with pytest.raises(tr.LogCorrupt, match="received earlier than the index says"):
        list(read_log_pieces(path, wheels_robot()))


WHEELS = "log: {wheels: {left: {topic: /wheels, name: left}, right: {topic: /wheels, name: right}}}\n"


def with_a_line_of_words(folder):
    return written(
        folder / "log.csv", "positions", 3000, lambda rows: [*rows[:1000], "oops,1,2", *rows[1000:]]
    )


def with_rows_left_out(write):
    return lambda folder: write(folder / "log", [*rows_of(1000), (None, 1.0, 1.0), *rows_of()[1000:]])


@pytest.mark.parametrize(
    ("write", "mapping"),
    [
        pytest.param(with_a_line_of_words, "", id="L15-command"),
        pytest.param(with_rows_left_out(json_lines), "", id="L15-command-json"),
        pytest.param(with_rows_left_out(parquet), "", id="L15-command-parquet"),
        pytest.param(lambda folder: recorded(folder / "run.mcap"), WHEELS, id="L15-command-mcap"),
        pytest.param(sqlite3_bag, WHEELS, id="L15-command-sqlite3"),
        pytest.param(rosbag1, WHEELS, id="L15-command-rosbag1"),
    ],
)
def test_fault(write, mapping, tmp_path, monkeypatch, capsys):
    """The command writes and says the same of a long log, which it never holds as a whole."""
    path = write(tmp_path)
    (tmp_path / "robot.yaml").write_text(
        f"drive: {{type: differential, track_width: 0.2, wheel_radius: 0.04}}\n{mapping}"
    )
    said = []
    for long in (1 << 30, 1):
        monkeypatch.setattr("trundle.adapters.log.LONG", long)
        words = ["track", str(path), "--robot", str(tmp_path / "robot.yaml"), "-o", str(tmp_path / "out.csv")]
        assert main([*words, "--force"]) == 0
        said.append(((tmp_path / "out.csv").read_bytes(), capsys.readouterr()))
        monkeypatch.setattr("trundle.adapters.log.read_log", None)
    assert said[0] == said[1]


def cut(content):
    return content[: 2 * len(content) // 3]


def flipped(content):
    at = len(content) // 3
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        pytest.param(cut, "what came behind is lost", id="L2"),
        pytest.param(flipped, "s) cannot be decompressed", id="L3"),
    ],
)
@pytest.mark.parametrize("long", [1, 1 << 30], ids=["pieces", "whole"])
def test_damage_by_command(spoil, words, long, tmp_path, monkeypatch, capsys):
    """Refused without `--salvage`; with it the loss is told, and the exit code is 4."""
    monkeypatch.setattr("trundle.adapters.log.LONG", long)
    path = recorded(tmp_path / "run.mcap")
    path.write_bytes(spoil(path.read_bytes()))
    (tmp_path / "robot.yaml").write_text(
        f"drive: {{type: differential, track_width: 0.2, wheel_radius: 0.04}}\n{WHEELS}"
    )
    command = ["track", str(path), "--robot", str(tmp_path / "robot.yaml"), "-o", str(tmp_path / "out.csv")]
    assert main(command) == 3
    assert not (tmp_path / "out.csv").exists()
    capsys.readouterr()
    assert main([*command, "--salvage"]) == 4
    said = "".join(capsys.readouterr())
    assert words in " ".join(said.split())
