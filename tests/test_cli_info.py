"""`trundle info`: what it sees, and that the section it proposes works."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle.adapters.robot_data import robot_from_data
from trundle.adapters.yaml_document import parse_yaml
from trundle.apps.cli import main
from trundle.apps.dialect import seeming_format
from trundle.apps.log_proposal import (
    Column,
    Topic,
    propose_for_table,
    propose_for_topics,
    section_text,
    time_unit,
)
from trundle.apps.wheel_word import matched, wheel_meant
from trundle.apps.wording import angle, counted, digits, length, seconds, size
from trundle.robot.log_mapping import TableFormat

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
SIDES = ("left", "right")
CORNERS = ("front_left", "front_right", "rear_left", "rear_right")
DIFFERENTIAL = {"type": "differential", "track_width": 0.2, "wheel_radius": 0.05}
ENCODERS = {"encoders": {"ticks_per_revolution": 210}}
COUNTED = """
drive: {type: differential, track_width: 0.2, wheel_radius: 0.05}
encoders: {ticks_per_revolution: 100}
"""


def described(out: str) -> str:
    """The proposed section."""
    return out[out.index("\nlog:") + 1 :]


def section_of(text: str):
    return parse_yaml(text.encode(), "info").data["log"]


def proposed(capsys, log, *options):
    assert main(["info", str(log), *map(str, options)]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    return described(said.out)


@pytest.mark.parametrize("name", sorted(path.parent.name for path in EXAMPLES.glob("*/run.csv")))
def test_proposal_for_an_example_reads_it_like_no_section_at_all(capsys, tmp_path, name):
    log, robot = EXAMPLES / name / "run.csv", tr.load_robot(EXAMPLES / name / "robot.yaml")
    section = proposed(capsys, log)
    plain = tmp_path / "robot.yaml"
    tr.save_robot(robot.replace(log=tr.LogMapping()), plain)
    wanted = tr.read_log(log, tr.load_robot(plain))
    plain.write_text(plain.read_text() + section)
    got = tr.read_log(log, tr.load_robot(plain))
    np.testing.assert_array_equal(got.time_ns, wanted.time_ns)
    order = [got.wheel_names.index(wheel) for wheel in wanted.wheel_names]
    np.testing.assert_array_equal(got.wheels[:, order], wanted.wheels)
    np.testing.assert_array_equal(got.reference.poses, wanted.reference.poses)
    assert set(got.steering_names) == set(wanted.steering_names)


TABLES = {
    "named": (
        ["t_ms,enc_left,enc_right,x_gt,y_gt", *(f"{20 * k},{7 * k},{9 * k},{k}.5,1" for k in range(50))],
        {
            "time": {"column": "t_ms", "unit": "ms"},
            "wheels": {
                "left": {"column": "enc_left", "unit": "ticks", "kind": "position"},
                "right": {"column": "enc_right", "unit": "ticks", "kind": "position"},
            },
            "reference": {"columns": ["x_gt", "y_gt"]},
        },
    ),
    "increments": (
        [f"{0.05 * k:.2f} {0.3 * k} {k * k % 7} {5 - k * k % 11}" for k in range(60)],
        {
            "table": {"delimiter": " ", "header": False},
            "time": {"column": 0, "unit": "s"},
            "wheels": {
                "left": {"column": 2, "unit": "ticks", "kind": "increment"},
                "right": {"column": 3, "unit": "ticks", "kind": "increment"},
            },
        },
    ),
    "continental": (
        ["Zeit time;rechts right rpm;links left rpm", *(f"{k}0;{k % 5},5;{k % 7},25" for k in range(50))],
        {
            "table": {"delimiter": ";", "decimal": ","},
            "time": {"column": "Zeit time", "unit": "ms"},
            "wheels": {
                "left": {"column": "links left rpm", "unit": "rpm"},
                "right": {"column": "rechts right rpm", "unit": "rpm"},
            },
        },
    ),
    "gyro-of-a-student": (
        ["timestamp_ms,gyroX_dps,gyroZ_dps,leftEnc,rightEnc",
         *(f"{20 * k},0.1,{k % 9 * 10}.5,{7 * k},{9 * k}" for k in range(50))],
        {
            "time": {"column": "timestamp_ms", "unit": "ms"},
            "wheels": {
                "left": {"column": "leftEnc", "unit": "ticks", "kind": "position"},
                "right": {"column": "rightEnc", "unit": "ticks", "kind": "position"},
            },
            "gyro": {"column": "gyroZ_dps", "unit": "deg/s"},
        },
    ),
    "several-readings": (
        ["stamp\tleftVelocity\trightVelocity\tleftTicks\trightTicks\tcmd_left",
         *(f"{1.7e18 + 1e7 * k:.0f}\t{k % 3}.5\t{k % 4}.5\t{5 * k}\t{6 * k}\t1" for k in range(50))],
        {
            "table": {"delimiter": "\t"},
            "time": {"column": "stamp", "unit": "ns"},
            "wheels": {
                "left": {"column": "leftTicks", "unit": "ticks", "kind": "position"},
                "right": {"column": "rightTicks", "unit": "ticks", "kind": "position"},
            },
        },
    ),
}  # fmt: skip


def test_a_section_that_does_not_fit_is_named_and_another_proposed(capsys, tmp_path):
    log, robot = tmp_path / "run.csv", tmp_path / "robot.yaml"
    log.write_text("\n".join(TABLES["named"][0]) + "\n")
    robot.write_text(COUNTED + "log: {wheels: {left: {column: l}, right: {column: r}}}\n")
    assert main(["info", str(log), "--robot", str(robot)]) == 0
    said = capsys.readouterr()
    assert "the robot's own log: section does not fit: " in said.err
    assert parse_yaml(described(said.out).encode(), "").data == {"log": TABLES["named"][1]}


@pytest.mark.parametrize("robot_known", [False, True])
@pytest.mark.parametrize("name", TABLES)
def test_proposals_for_tables(capsys, tmp_path, name, robot_known):
    rows, wanted = TABLES[name]
    log, robot = tmp_path / "run.txt", tmp_path / "robot.yaml"
    log.write_text("\n".join(rows) + "\n")
    robot.write_text(COUNTED)
    if robot_known:
        assert main(["info", str(log), "--robot", str(robot)]) == 0
        said = capsys.readouterr()
        assert "does not fit" not in said.err  # it has no section
        section = described(said.out)
    else:
        section = proposed(capsys, log)
    assert parse_yaml(section.encode(), "").data == {"log": wanted}
    robot.write_text(COUNTED + section)
    log_read = tr.read_log(log, tr.load_robot(robot))
    assert len(log_read) == len(rows) - ("header" not in wanted.get("table", {}))
    assert main(["info", str(log), "--robot", str(robot)]) == 0
    assert "reads it" in capsys.readouterr().out


def test_steering_of_a_table_without_header(capsys, tmp_path):
    rows = [f"{0.1 * k:.1f},{1 + k % 3},{0.3 * np.sin(k):.4f}" for k in range(40)]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n")
    tricycle = (
        "drive: {type: tricycle, wheelbase: 0.3, wheel_radius: 0.05}\nencoders: {ticks_per_revolution: 9}\n"
    )
    (tmp_path / "robot.yaml").write_text(tricycle)
    main(["info", str(tmp_path / "run.csv"), "--robot", str(tmp_path / "robot.yaml")])
    section = described(capsys.readouterr().out)
    (tmp_path / "robot.yaml").write_text(tricycle + section)
    log = tr.read_log(tmp_path / "run.csv", tr.load_robot(tmp_path / "robot.yaml"))
    assert (log.wheel_names, log.steering_names) == (("front",), ("front",))
    np.testing.assert_allclose(log.steering[:, 0], 0.3 * np.sin(np.arange(40)), atol=1e-4)


def test_a_table_without_time(capsys, tmp_path):
    """A counter that only grows is none."""
    log = tmp_path / "run.csv"
    log.write_text("left_ticks,right_ticks\n" + "".join(f"{20 * k},{21 * k}\n" for k in range(30)))
    assert main(["info", str(log)]) == 0
    out = capsys.readouterr().out
    assert set(section_of(described(out))["wheels"]) == {"left", "right"}
    assert "no column looks like time" in out
    assert "# No column looks like time, without which nothing can be tracked" in out


def test_angles_of_a_table_without_header(capsys, tmp_path):
    log = tmp_path / "run.csv"
    log.write_text("".join(f"{0.1 * k:.1f},{0.51 * k:.2f},{0.49 * k:.2f}\n" for k in range(40)))
    section = section_of(proposed(capsys, log))
    assert section["table"] == {"header": False}
    assert section["wheels"] == {
        "left": {"column": 1, "unit": "rad", "kind": "position"},
        "right": {"column": 2, "unit": "rad", "kind": "position"},
    }


def test_rhythm_of_a_log(capsys, tmp_path):
    times = [0.0, 0.1, 0.2, 0.3, 0.3, 0.4, 2.4, 2.5, 2.45, 2.6, 2.7]
    rows = ["time,left.position", *(f"{t},{k}" for k, t in enumerate(times))]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n")
    assert main(["info", str(tmp_path / "run.csv")]) == 0
    out = capsys.readouterr().out
    assert "1 gap, the longest 2.00 s at 0.400 s" in out
    assert "1 x back in time, 1 x the same time again" in out


def test_columns_of_words_and_unreadable_cells(capsys, tmp_path):
    rows = ["time,note,left.position", *(f"{k},fine,{'x' if k == 7 else k}" for k in range(20))]
    (tmp_path / "run.csv").write_text("\n".join(rows) + "\n")
    assert main(["info", str(tmp_path / "run.csv")]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.strip()}
    assert lines["note"].endswith("text")
    assert lines["left.position"].endswith("1 unreadable")


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"all in words\n", "no column of it holds numbers"), (b"\0\1\2" * 99, "not a known kind of log")],
)
def test_what_is_no_log(capsys, tmp_path, content, words):
    (tmp_path / "run").write_bytes(content)
    assert main(["info", str(tmp_path / "run")]) == 3
    said = capsys.readouterr()
    assert words in said.err
    assert said.out == ""


def test_data_logs_and_tubs(capsys, shared_data):
    assert main(["info", str(next((shared_data / "frc_swerve").glob("*.wpilog")))]) == 0
    out = capsys.readouterr().out
    assert "NT:/SmartDashboard/Module 1/Steer Degrees" in out
    section = parse_yaml(described(out).encode(), "").data["log"]
    assert section["wheels"]["wheel_2"] == {
        "topic": "NT:/SmartDashboard/Module 2/Drive Velocity Feet",
        "unit": "ft/s",
        "hold": True,
    }
    assert section["steering"]["wheel_4"]["topic"] == "NT:/SmartDashboard/Module 4/Steer Degrees"
    assert section["steering"]["wheel_4"]["unit"] == "deg"
    assert main(["info", str(shared_data / "donkeycar_tub")]) == 0
    section = parse_yaml(described(capsys.readouterr().out).encode(), "").data["log"]
    assert section == {"time": {"column": "_timestamp_ms", "unit": "ms"}}


# --- guesses ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "wheel"),
    [
        ("left", "left"),
        ("wheel_left_joint", "left"),
        ("rightTicks", "right"),
        ("enc.FL", "front_left"),
        ("BackRight_vel", "rear_right"),
        ("rear left", "rear_left"),
        ("lr", "rear_left"),
        ("motor03_rpm", "wheel_3"),
        ("wheel2", "wheel_2"),
        ("front_steering", "front"),
        ("time", ""),
        ("reference.x", ""),
        ("joint_1", ""),
        ("left_minus_right", ""),
    ],
)
def test_names_of_wheels(name, wheel):
    assert wheel_meant(name) == wheel


def test_names_are_matched_by_meaning_then_by_order():
    assert matched(SIDES, ["R_ticks", "L_ticks"]) == {"left": "L_ticks", "right": "R_ticks"}
    assert matched(CORNERS, ["rr", "rl", "fr", "fl"]) == dict(
        zip(CORNERS, ("fl", "fr", "rl", "rr"), strict=True)
    )
    assert matched(SIDES, ["a", "b"]) == {"left": "a", "right": "b"}
    assert matched(SIDES, ["a", "b", "c"]) == {}
    assert matched((), ["a", "wheel_left"]) == {"left": "wheel_left"}


@pytest.mark.parametrize(
    ("name", "step", "unit"),
    [
        ("t", 0.02, "s"),
        ("t", 20.0, "ms"),
        ("t", 2e4, "us"),
        ("t", 2e7, "ns"),
        ("time_us", 0.5, "us"),
        ("t", 1e4, "us"),
    ],
)
def test_unit_of_time(name, step, unit):
    assert time_unit(Column(name, step * np.arange(20.0))) == unit


def topics(*rows):
    return [Topic(*row) for row in rows]


JOINTS = {f"wheel_{side}_joint": False for side in SIDES}
STATES = "sensor_msgs/msg/JointState"
ODOMETRY = ("/odom", "nav_msgs/msg/Odometry", 900)


@pytest.mark.parametrize(
    ("found", "wheels", "section"),
    [
        (
            [("/joint_states", STATES, 900, JOINTS), ODOMETRY],
            (),
            {
                "wheels": {
                    side: {"topic": "/joint_states", "name": f"wheel_{side}_joint", "unit": "rad"}
                    for side in SIDES
                },
                "reference": {"topic": "/odom"},
            },
        ),
        (
            [("/wheels", STATES, 900, {"l": True, "r": None}), ("/gt", "geometry_msgs/msg/PoseStamped", 9)],
            SIDES,
            {
                "wheels": {
                    "left": {"topic": "/wheels", "name": "l", "unit": "ticks"},
                    "right": {"topic": "/wheels", "name": "r", "unit": "rad/s"},
                },
                "reference": {"topic": "/gt"},
            },
        ),
        (
            [("/arm", STATES, 900, {"elbow": False}), ("/cmd_vel", "geometry_msgs/msg/Twist", 900), ODOMETRY],
            SIDES,
            {"twist": {"topic": "/odom"}},
        ),
        (
            [(*ODOMETRY, {}, 0.01), ("/mocap/pose", "geometry_msgs/msg/PoseStamped", 99, {}, -20.0)],
            (),
            {"clock": "receive", "twist": {"topic": "/odom"}, "reference": {"topic": "/mocap/pose"}},
        ),
        ([("/chatter", "std_msgs/msg/String", 5), ("/odom", "nav_msgs/msg/Odometry", 1)], (), {}),
    ],
)  # fmt: skip
def test_proposals_for_recordings(found, wheels, section):
    assert propose_for_topics(topics(*found), wheels).ordered == section


def test_recordings_of_steered_wheels_and_gyros():
    joints = {f"{end}_{what}": False for end in ("front", "rear") for what in ("steering", "wheel")}
    found = topics(("/joints", "sensor_msgs/msg/JointState", 9, joints), ("/imu", "sensor_msgs/msg/Imu", 9))
    section = propose_for_topics(found, ("rear",), ("front",), gyro=True).ordered
    assert section == {
        "wheels": {"rear": {"topic": "/joints", "name": "rear_wheel", "unit": "rad"}},
        "steering": {"front": {"topic": "/joints", "name": "front_steering"}},
        "gyro": {"topic": "/imu"},
    }


def test_real_recordings(capsys, shared_data):
    """Proposals that need no hand's touch: the same section as the descriptions in tests/recordings."""
    recordings = Path(__file__).parent / "recordings"
    for log, name in (
        ("polimi_mecanum/bag2.bag", "polimi_mecanum"),
        ("turtlebot_nav2/nav2_turtlebot.mcap", "turtlebot_nav2"),
    ):
        assert main(["info", str(shared_data / log)]) == 0
        section = parse_yaml(described(capsys.readouterr().out).encode(), "").data["log"]
        wanted = tr.load_robot(recordings / f"{name}.yaml")
        data = {"drive": DIFFERENTIAL if "twist" in section else MECANUM, "log": section, **ENCODERS}
        got = robot_from_data(data)
        assert len(tr.read_log(shared_data / log, got)) == len(tr.read_log(shared_data / log, wanted))
        assert got.log.reference == wanted.log.reference
        assert got.log.twist == wanted.log.twist
        assert {wheel: one.unit for wheel, one in got.log.wheels.items()} == {
            wheel: one.unit for wheel, one in wanted.log.wheels.items()
        }


MECANUM = {"type": "mecanum", "track_width": 0.338, "wheelbase": 0.4, "wheel_radius": 0.07}


words = st.sampled_from(
    "time t_ms left right enc_left x_gt y_gt steering gyro.yaw_rate a#b {x} on 1e3 null ä: -1 'q".split()
) | st.text(max_size=8)  # fmt: skip


@given(
    names=st.lists(words, min_size=1, max_size=8, unique=True) | st.integers(1, 8).map(range),
    seed=st.integers(0, 2**32 - 1),
    delimiter=st.sampled_from(",;\t| "),
)
def test_every_proposal_can_be_loaded(names, seed, delimiter):
    rng = np.random.default_rng(seed)
    kinds = [np.arange, lambda n: rng.integers(-5, 50, n), lambda n: rng.normal(size=n).cumsum(), np.zeros]
    columns = [Column(name, kinds[rng.integers(4)](30).astype(float)) for name in names]
    header = not isinstance(names, range)
    proposal = propose_for_table(columns, TableFormat(delimiter=delimiter, header=header), SIDES)
    text = "\n".join(section_text(proposal.ordered))
    section = parse_yaml(text.encode(), "").data["log"]
    assert section == proposal.ordered
    robot_from_data({"drive": DIFFERENTIAL, "log": section, **ENCODERS})


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("a,b\n1,2\n3,4\n", {}),
        ("1,2\n3,4\n", {"header": False}),
        ("M 1 2\nM 3 4\n", {"delimiter": " ", "header": False}),
        ("a;b\n1,5;2\n3,5;4\n", {"delimiter": ";", "decimal": ","}),
        ("a|b\n1|2\n", {"delimiter": "|"}),
        ("# made by a robot\na\tb\n1\t2\n", {"delimiter": "\t"}),
        ("just\nwords\n", {}),
    ],
)
def test_dialects(tmp_path, text, wanted):
    (tmp_path / "table").write_text(text)
    assert seeming_format(tmp_path / "table") == TableFormat(**wanted)


# --- wording ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("said", "wanted"),
    [
        (length(0.0), "0 m"),
        (length(0.001234), "1.23 mm"),
        (length(0.0123), "1.23 cm"),
        (length(0.9999), "100 cm"),
        (length(12.345), "12.3 m"),
        (length(-0.5), "-50.0 cm"),
        (length(1234.5), "1230 m"),
        (length(1e-9), "0 mm"),
        (angle(np.pi), "180 deg"),
        (angle(0.001), "0.0573 deg"),
        (seconds(0.0123), "12.3 ms"),
        (seconds(61.9), "61.9 s"),
        (seconds(599.96), "10 min 0 s"),
        (seconds(3725.0), "62 min 5 s"),
        (seconds(0.0), "0 s"),
        (seconds(9000.0), "2.50 h"),
        (seconds(1e6), "11.6 days"),
        (size(1), "1 byte"),
        (size(999), "999 bytes"),
        (size(94_200), "94.2 kB"),
        (size(3_470_000), "3.47 MB"),
        (digits(9.999), "10.0"),
        (digits(float("inf")), "inf"),
        (digits(99999.0), "100000"),
        (counted({"b": 1, "a": 1, "c": 7, "d": 0}), "7 c, 1 a, 1 b"),
    ],
)
def test_numbers_as_people_read_them(said, wanted):
    assert said == wanted
