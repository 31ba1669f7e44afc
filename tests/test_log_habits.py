"""Habits of real logs: each is one word of robot.yaml's `log:` section, and the way comes out the same.

One motion, written the plain way and in the way of each habit.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

import trundle as tr
from trundle.adapters.log import read_log
from trundle.adapters.robot_data import robot_from_data
from trundle.adapters.robot_yaml import load_robot
from trundle.adapters.yaml_document import parse_yaml
from trundle.apps.cli import main
from trundle.apps.log_proposal import Topic, propose_for_topics
from trundle.errors import ConfigError, LogSchema

RECORDINGS = Path(__file__).parent / "recordings"
RADIUS, TICKS = 0.05, 1000
COUNT = 200
STEP_NS = 20_000_000
BEGIN_NS = 1_700_000_000 * 10**9
STAMPS = BEGIN_NS + np.arange(COUNT) * STEP_NS
SPEEDS = np.stack([4.0 + np.sin(np.arange(COUNT) / 9), 5.0 + np.cos(np.arange(COUNT) / 7)], axis=-1)
ANGLES = np.cumsum(SPEEDS, axis=0) * STEP_NS * 1e-9  # of the left and the right wheel
COUNTS = np.floor(ANGLES / math.tau * TICKS).astype(np.int64)
STEERING = 0.8 * np.sin(np.arange(COUNT) / 12)
HEAD = {
    "differential": f"drive: {{type: differential, track_width: 0.3, wheel_radius: {RADIUS}}}\n"
    f"encoders: {{ticks_per_revolution: {TICKS}}}\n",
    "bicycle": f"drive: {{type: bicycle, wheelbase: 0.4, wheel_radius: {RADIUS}}}\n",
}


@pytest.fixture
def folder(tmp_path):
    return tmp_path


def robot(folder, section, kind="differential"):
    path = folder / f"{kind}.yaml"
    path.write_text(f"name: habits\n{HEAD[kind]}{section}")
    return load_robot(path)


def table(folder, **columns):
    path = folder / "log.csv"
    rows = zip(*columns.values(), strict=True)
    texts = (",".join("" if value is None else repr(value) for value in row) for row in rows)
    path.write_text("\n".join([",".join(columns), *texts, ""]))
    return path


def lists(**columns):
    return {name: np.asarray(column).tolist() for name, column in columns.items()}


SECONDS = {"time": ((STAMPS - BEGIN_NS) * 1e-9).tolist()}


def bag(folder, *messages):
    """A recording of (topic, type, receive [ns], stamp [ns] or None, fields)."""
    store = get_typestore(Stores.ROS1_NOETIC)
    path = folder / f"{len(list(folder.iterdir()))}.bag"
    kinds = store.types
    with Writer(path) as writer:
        topics = {}
        for topic, kind, receive, stamp, fields in sorted(messages, key=lambda message: message[2]):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            if stamp is not None:
                time = kinds["builtin_interfaces/msg/Time"](*divmod(int(stamp), 10**9))
                fields = (kinds["std_msgs/msg/Header"](0, time, ""), *fields)
            message = kinds[kind](*fields)
            writer.write(topics[topic], int(receive), bytes(store.serialize_ros1(message, kind)))
    return path


def joints(positions, velocities=None, *, names=("left", "right"), late=0, topic="/joints"):
    velocities = np.zeros((COUNT, 0)) if velocities is None else velocities
    return [
        (topic, "sensor_msgs/msg/JointState", t, t - late, (list(names), np.array(p, float), v, np.zeros(0)))
        for t, p, v in zip(STAMPS, positions, velocities, strict=True)
    ]


def floats(topic, values, stamps=STAMPS):
    return [
        (topic, "std_msgs/msg/Float64", t, None, (float(v),)) for t, v in zip(stamps, values, strict=True)
    ]


def poses(topic, *, late=0):
    kinds = get_typestore(Stores.ROS1_NOETIC).types
    found = []
    for k, t in enumerate(STAMPS):
        point = kinds["geometry_msgs/msg/Point"](0.01 * k, 0.0, 0.0)
        pose = kinds["geometry_msgs/msg/Pose"](
            point, kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        )
        found.append((topic, "geometry_msgs/msg/PoseStamped", t, t - late, (pose,)))
    return found


def path_of(folder, log, section, kind="differential"):
    described = robot(folder, section, kind)
    return tr.integrate(described, read_log(log, described)).poses


@pytest.fixture
def plain(folder):
    """The way, as Trundle's own columns say it."""
    left, right = ANGLES.T
    return path_of(
        folder, table(folder, **SECONDS, **lists(**{"left.position": left, "right.position": right})), ""
    )


@pytest.fixture
def steered(folder):
    columns = lists(**{"rear.position": ANGLES[:, 0], "front.steering": STEERING})
    return path_of(folder, table(folder, **SECONDS, **columns), "", "bicycle")


NEARLY = {"atol": 1e-9, "rtol": 0}
WITHIN_TICKS = {"atol": 5e-3, "rtol": 0}


# ---------------------------------------------------------------------------------- wheels


def test_ticks_in_the_position_of_joint_states(folder, plain):
    """`unit: ticks`."""
    log = bag(folder, *joints(COUNTS))
    section = "log: {wheels: {left: {topic: /joints, unit: ticks}, right: {topic: /joints, unit: ticks}}}\n"
    np.testing.assert_allclose(path_of(folder, log, section), plain, **WITHIN_TICKS)


def test_radians_per_minute(folder):
    """`unit: rad/min`, against the same speeds in rad/s."""
    sections = [
        f"log: {{wheels: {{left: {{column: l, unit: {unit}}}, right: {{column: r, unit: {unit}}}}}}}\n"
        for unit in ("rad/s", "rad/min")
    ]
    found = []
    for factor, section in zip((1.0, 60.0), sections, strict=True):
        left, right = SPEEDS.T * factor
        found.append(path_of(folder, table(folder, **SECONDS, **lists(l=left, r=right)), section))
    np.testing.assert_allclose(found[1], found[0], **NEARLY)


def test_feet_per_second(folder):
    """`unit: ft/s`: what the wheel's rim does."""
    found = []
    for unit, factor in (("rad/s", 1.0), ("ft/s", RADIUS / 0.3048)):
        section = (
            f"log: {{wheels: {{left: {{column: l, unit: {unit}}}, right: {{column: r, unit: {unit}}}}}}}\n"
        )
        left, right = SPEEDS.T * factor
        found.append(path_of(folder, table(folder, **SECONDS, **lists(l=left, r=right)), section))
    np.testing.assert_allclose(found[1], found[0], **NEARLY)


def test_degrees(folder, steered):
    """`unit: deg`, of wheels and of steering."""
    section = "log: {wheels: {rear: {column: w, unit: deg}}, steering: {front: {column: s, unit: deg}}}\n"
    columns = lists(w=np.degrees(ANGLES[:, 0]), s=np.degrees(STEERING))
    log = table(folder, **SECONDS, **columns)
    np.testing.assert_allclose(path_of(folder, log, section, "bicycle"), steered, **NEARLY)


def test_revolutions_per_cycle(folder, plain):
    """`kind: increment`."""
    each = "unit: rev, kind: increment"
    section = f"log: {{wheels: {{left: {{column: l, {each}}}, right: {{column: r, {each}}}}}}}\n"
    left, right = np.diff(ANGLES, axis=0, prepend=ANGLES[:1]).T / math.tau
    np.testing.assert_allclose(
        path_of(folder, table(folder, **SECONDS, **lists(l=left, r=right)), section), plain, **NEARLY
    )


def test_counters_that_are_reset_at_each_read(folder, plain):
    """`kind: increment` of ticks: no count is lost."""
    each = "unit: ticks, kind: increment"
    section = f"log: {{wheels: {{left: {{column: l, {each}}}, right: {{column: r, {each}}}}}}}\n"
    left, right = np.diff(COUNTS, axis=0, prepend=COUNTS[:1]).T
    log = table(folder, **SECONDS, **lists(l=left, r=right))
    np.testing.assert_allclose(path_of(folder, log, section), plain, **WITHIN_TICKS)
    found = read_log(log, robot(folder, section)).wheels.sum(axis=0) / math.tau * TICKS
    np.testing.assert_allclose(found, COUNTS[-1] - COUNTS[0])


def test_wheels_in_another_order_than_their_names(folder, plain):
    """`name:`, or the column of each; never the place."""
    log = bag(folder, *joints(ANGLES[:, ::-1], names=("wheel_r", "wheel_l")))
    section = (
        "log: {wheels: {left: {topic: /joints, name: wheel_l}, right: {topic: /joints, name: wheel_r}}}\n"
    )
    np.testing.assert_allclose(path_of(folder, log, section), plain, **NEARLY)
    section = (
        "log: {wheels: {right: {column: 1}, left: {column: 2}}, table: {header: false}, time: {column: 0}}\n"
    )
    log = table(folder, **SECONDS, **lists(r=ANGLES[:, 1], l=ANGLES[:, 0]))
    log.write_text(log.read_text().partition("\n")[2])
    np.testing.assert_allclose(path_of(folder, log, section), plain, **NEARLY)


# -------------------------------------------------------------------------------- steering


@pytest.mark.parametrize(
    ("written", "word"),
    [
        (np.degrees(STEERING) % 360.0, "unit: deg, wraps: true"),
        (
            np.floor(STEERING % math.tau / math.tau * 4096),
            f"unit: ticks, gain: {math.tau / 4096}, wraps: true",
        ),
        ((STEERING + 6.0) % math.tau, "offset: -6.0, wraps: true"),
    ],
    ids=["0 to 360 deg", "12 bits", "mounted askew"],
)
def test_steering_encoders_that_wrap(folder, steered, written, word):
    """`wraps: true`, though this wheel turns no further than a radian either way."""
    section = f"log: {{steering: {{front: {{column: s, {word}}}}}, wheels: {{rear: {{column: w}}}}}}\n"
    limited = section + "limits: {max_steering: 1.0}\n"
    log = table(folder, **SECONDS, **lists(w=ANGLES[:, 0], s=written))
    found = path_of(folder, log, limited, "bicycle")
    np.testing.assert_allclose(found, steered, atol=3e-3 if "ticks" in word else 1e-9, rtol=0)
    assert np.ptp(written) > 3.0  # it does wrap
    angles = read_log(log, robot(folder, limited, "bicycle")).steering[:, 0]
    np.testing.assert_allclose(angles, STEERING, atol=math.tau / 4096 if "ticks" in word else 1e-9)


def test_steering_that_wraps_between_the_wheels_stamps(folder, steered):
    """Of a topic of its own: interpolated the shorter way round, never through the far side."""
    shifted = STAMPS[:-1] + STEP_NS // 2
    between = 0.5 * (STEERING[1:] + STEERING[:-1])
    log = bag(
        folder,
        *joints(ANGLES[:, :1], names=("rear",)),
        *floats("/steer", np.degrees(between) % 360.0, shifted),
    )
    front = "front: {topic: /steer, unit: deg, wraps: true}"
    section = f"log: {{clock: receive, wheels: {{rear: {{topic: /joints}}}}, steering: {{{front}}}}}\n"
    described = robot(folder, section, "bicycle")
    angles = read_log(log, described).steering[:, 0]
    assert len(angles) == COUNT - 2
    np.testing.assert_allclose(angles, STEERING[1:-1], atol=0.004)


def test_ticks_of_steering_need_their_size(folder):
    section = "log: {steering: {front: {column: s, unit: ticks}}, wheels: {rear: {column: w}}}\n"
    log = table(folder, **SECONDS, **lists(w=ANGLES[:, 0], s=STEERING))
    with pytest.raises(ConfigError, match=r"log\.steering\.front\.gain.*radians per tick"):
        read_log(log, robot(folder, section, "bicycle"))


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (
            "log: {wheels: {left: {column: l, wraps: true}, right: {column: r}}}\n",
            "bits of a wheel's encoder",
        ),
        ("log: {gyro: {column: g, wraps: true}}\n", "a yaw rate does not wrap"),
    ],
)
def test_what_does_not_wrap(folder, section, words):
    with pytest.raises(ConfigError, match=words):
        robot(folder, section)


# ------------------------------------------------------------------------- rates and changes


def test_columns_held_at_a_lower_rate(folder, steered):
    """`hold: true`: the steering is written in every tenth row, and holds until the next."""
    rare = np.repeat(STEERING[::10], 10)
    plain = lists(**{"rear.position": ANGLES[:, 0], "front.steering": rare})
    wanted = path_of(folder, table(folder, **SECONDS, **plain), "", "bicycle")
    sparse = [value if k % 10 == 0 else None for k, value in enumerate(rare.tolist())]
    section = "log: {steering: {front: {column: s, hold: true}}, wheels: {rear: {column: w}}}\n"
    log = table(folder, **SECONDS, **lists(w=ANGLES[:, 0]), s=sparse)
    np.testing.assert_allclose(path_of(folder, log, section, "bicycle"), wanted, **NEARLY)


def test_values_that_are_logged_when_they_change(folder):
    """`hold: true` of topics: speeds that stay the same say nothing, and the robot drives on."""
    speeds = np.repeat([[4.0, 5.0], [4.0, 6.0], [2.0, 6.0], [0.0, 0.0]], COUNT // 4, axis=0)
    every = [
        message for k, side in enumerate(("left", "right")) for message in floats(f"/{side}", speeds[:, k])
    ]
    few = []
    for k, side in enumerate(("left", "right")):
        changed = np.flatnonzero(np.diff(speeds[:, k], prepend=-1.0))
        few += floats(f"/{side}", speeds[changed, k], STAMPS[changed])
    wheels = ", ".join(f"{side}: {{topic: /{side}, unit: rad/s, hold: true}}" for side in ("left", "right"))
    section = f"log: {{clock: receive, wheels: {{{wheels}}}}}\n"
    described = robot(folder, section)
    wanted = tr.integrate(described, read_log(bag(folder, *every), described), integrator="euler")
    found = tr.integrate(described, read_log(bag(folder, *few), described), integrator="euler")
    assert found.events == {}
    np.testing.assert_allclose(found.distance, wanted.distance, rtol=0.03)
    np.testing.assert_allclose(found.poses[-1], wanted.poses[-1], atol=0.06)


# ---------------------------------------------------------------------------------- clocks

HOURS = 5 * 3600 * 10**9


def test_stamps_of_a_clock_that_is_hours_off(folder, plain):
    """`clock: receive`; without it the difference is said, by name and size."""
    log = bag(folder, *joints(ANGLES, late=HOURS), *poses("/truth"))
    wheels = "wheels: {left: {topic: /joints}, right: {topic: /joints}}, reference: {topic: /truth}"
    received = robot(folder, f"log: {{clock: receive, {wheels}}}\n")
    found = read_log(log, received)
    np.testing.assert_array_equal(found.time_ns, found.reference.time_ns)
    np.testing.assert_allclose(tr.integrate(received, found).poses, plain, **NEARLY)
    assert not [warning for warning in found.warnings if "clock" in warning]

    stamped = read_log(log, robot(folder, f"log: {{{wheels}}}\n"))
    assert stamped.time_ns[0] == STAMPS[0] - HOURS
    (warning,) = [warning for warning in stamped.warnings if "clock" in warning]
    assert "/truth and /joints: their clocks are 1.8e+04 s apart" in warning
    assert "log.clock: receive" in warning


@pytest.mark.parametrize(("late", "reported"), [(150_000_000, True), (60_000_000, False)])
def test_clocks_that_disagree_by_more_than_a_tenth_of_a_second_are_reported(folder, late, reported, capsys):
    log = bag(folder, *joints(ANGLES), *poses("/truth", late=late))
    section = "log: {wheels: {left: {topic: /joints}, right: {topic: /joints}}, reference: {topic: /truth}}\n"
    warnings = read_log(log, robot(folder, section)).warnings
    assert any("their clocks are 0.15 s apart" in warning for warning in warnings) == reported
    assert main(["info", str(log)]) == 0
    assert ("/truth: received 0.150 s after stamped" in capsys.readouterr().out) == reported


def test_a_topic_without_stamps_beside_a_clock_that_is_off(folder):
    log = bag(folder, *joints(ANGLES[:, :1], names=("rear",), late=HOURS), *floats("/steer", STEERING))
    section = "log: {wheels: {rear: {topic: /joints}}, steering: {front: {topic: /steer, hold: true}}}\n"
    with pytest.raises(LogSchema, match=r"no time in common; /steer and /joints: .* 1\.8e\+04 s apart"):
        read_log(log, robot(folder, section, "bicycle"))


# ----------------------------------------------------------------------- what info recognises


def said_by_info(capsys, *words):
    assert main(["info", *map(str, words)]) == 0
    out = capsys.readouterr().out
    return parse_yaml(out[out.index("\nlog:") + 1 :].encode(), "").data["log"]


def without_log(folder, name):
    path = folder / "silent.yaml"
    path.write_text((RECORDINGS / f"{name}.yaml").read_text().partition("\nlog:")[0] + "\n")
    return path


def test_info_proposes_the_very_section_of_a_swerve_robot(folder, capsys, shared_data):
    """Feet per second, degrees, and values that hold."""
    log = next((shared_data / "frc_swerve").glob("*.wpilog"))
    described = without_log(folder, "frc_swerve")
    section = said_by_info(capsys, log, "--robot", described)
    drive = parse_yaml(described.read_bytes(), "").data["drive"]
    wanted = load_robot(RECORDINGS / "frc_swerve.yaml")
    assert robot_from_data({"drive": drive, "log": section}).log == wanted.log


def test_info_proposes_the_clock_of_receipt(folder, capsys, shared_data):
    section = said_by_info(capsys, shared_data / "f1tenth" / "skidpad_2_5.bag")
    assert section["clock"] == "receive"


def test_info_recognises_ticks_and_names_in_joint_states(folder, capsys):
    log = bag(folder, *joints(COUNTS[:, ::-1], names=("wheel_r", "wheel_l")))
    assert said_by_info(capsys, log)["wheels"] == {
        "right": {"topic": "/joints", "name": "wheel_r", "unit": "ticks"},
        "left": {"topic": "/joints", "name": "wheel_l", "unit": "ticks"},
    }


def test_info_recognises_columns(folder, capsys):
    """Counters that are reset at each read, and degrees."""
    left, right = np.diff(COUNTS, axis=0, prepend=COUNTS[:1]).T
    log = table(folder, **SECONDS, **lists(left_ticks=left, right_ticks=right))
    assert said_by_info(capsys, log)["wheels"]["left"] == {
        "column": "left_ticks",
        "unit": "ticks",
        "kind": "increment",
    }
    path = folder / "tricycle.yaml"
    path.write_text(HEAD["bicycle"])
    log = table(folder, **SECONDS, **lists(rear_rad=ANGLES[:, 0], steering_deg=np.degrees(STEERING)))
    found = said_by_info(capsys, log, "--robot", path)
    assert found["steering"] == {"front": {"column": "steering_deg", "unit": "deg"}}


def test_info_recognises_steering_that_wraps(folder, capsys, steered):
    """Degrees from 0 to 360, of an encoder that begins anew just beside straight ahead."""
    degrees = (np.degrees(STEERING) + 360.0) % 360.0
    columns = lists(rear_position=ANGLES[:, 0], front_steering=degrees)
    log = table(folder, **SECONDS, **columns)
    robot(folder, "", "bicycle")
    section = said_by_info(capsys, log, "--robot", folder / "bicycle.yaml")
    assert section["steering"] == {"front": {"column": "front_steering", "unit": "deg", "wraps": True}}
    poses = path_of(folder, log, f"log: {json.dumps(section)}\n", "bicycle")
    np.testing.assert_allclose(poses, steered, **NEARLY)


def test_info_recognises_revolutions_per_cycle_without_a_header(folder, capsys, plain):
    """An encoder's steps are whole parts of a turn; where the robot was, in the same rows, is not."""
    steps = np.diff(np.floor(ANGLES / math.tau * 1440), axis=0, prepend=0) / 1440
    x, y = np.cumsum(np.cos(ANGLES), axis=0).T
    columns = [np.arange(COUNT) * 0.02, x, y, *steps.T]
    log = folder / "log.csv"
    log.write_text("".join(",".join(map(repr, row)) + "\n" for row in np.stack(columns, axis=-1).tolist()))
    section = said_by_info(capsys, log)
    assert section["wheels"] == {
        "left": {"column": 3, "unit": "rev", "kind": "increment"},
        "right": {"column": 4, "unit": "rev", "kind": "increment"},
    }
    poses = path_of(folder, log, f"log: {json.dumps(section)}\n")
    np.testing.assert_allclose(poses[-1], plain[-1], **WITHIN_TICKS)


def test_info_takes_no_path_for_wheels(folder, capsys):
    """Where a robot was looks like running totals, and nothing says that it is not."""
    log = folder / "log.csv"
    rows = zip(range(COUNT), ANGLES[:, 0], np.sin(ANGLES[:, 1]), strict=True)
    log.write_text("".join(f"{0.02 * k:.2f},{x!r},{y!r}\n" for k, x, y in rows))
    assert "wheels" not in said_by_info(capsys, log)


def test_info_recognises_columns_of_a_lower_rate(folder, capsys):
    sparse = [value if k % 10 == 0 else None for k, value in enumerate(STEERING.tolist())]
    log = table(folder, **SECONDS, **lists(rear_rad=ANGLES[:, 0]), steering_rad=sparse)
    robot(folder, "", "bicycle")
    section = said_by_info(capsys, log, "--robot", folder / "bicycle.yaml")
    assert section["steering"] == {"front": {"column": "steering_rad", "unit": "rad", "hold": True}}
    assert section["wheels"] == {"rear": {"column": "rear_rad", "unit": "rad", "kind": "position"}}


@pytest.mark.parametrize(
    ("kind", "field", "unit"),
    [
        ("SwerveModulePosition", "distance", "m"),
        ("SwerveModuleState", "speed", "m/s"),
        ("SwerveModuleVelocity", "speed", "m/s"),
    ],
)
def test_modules_of_wpilib_are_proposed(kind, field, unit):
    entries = [Topic("m/Target", f"struct:{kind}[]", 99), Topic("m/Now", f"struct:{kind}[]", 99)]
    section = propose_for_topics(entries, ("fl", "fr", "bl", "br"), ("fl", "fr", "bl", "br")).section
    assert section["wheels"]["bl"] == {
        "topic": "m/Now",
        "field": field,
        "name": 2,
        "unit": unit,
        "hold": True,
    }
    assert section["steering"]["br"] == {"topic": "m/Now", "field": "angle.value", "name": 3, "hold": True}


@pytest.mark.parametrize(
    ("words", "unit"),
    [
        ("Left Velocity MPS", "m/s"),
        ("left wheel speed rpm", "rpm"),
        ("Left Position Meters", "m"),
        ("left/DistanceInches", "in"),
        ("LeftVelocityRadians", "rad/s"),
        ("Left Rotations Position", "rev"),
    ],
)
def test_units_of_entries_are_those_of_their_names(words, unit):
    names = [words, words.replace("Left", "Right").replace("left", "right")]
    entries = [Topic(name, "double", 99) for name in (*names, "Drive/Omega Velocity", "Left Target Velocity")]
    wheels = propose_for_topics(entries).section["wheels"]
    assert wheels == {
        side: {"topic": name, "unit": unit, "hold": True}
        for side, name in zip(("left", "right"), names, strict=True)
    }


def test_a_robot_that_logs_only_its_own_speeds_is_not_taken_for_wheels():
    entries = [Topic("Drive/Velocity X", "double", 99), Topic("field/Robot", "double[]", 99)]
    entries.append(Topic("Drive/Speeds", "struct:ChassisSpeeds", 99))
    assert propose_for_topics(entries).section == {
        "twist": {"topic": "Drive/Speeds"},
        "reference": {"topic": "field/Robot", "angle_unit": "deg"},
    }
