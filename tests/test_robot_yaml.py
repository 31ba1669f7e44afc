"""robot.yaml: what it accepts, what it refuses and in which words, and what writing leaves alone."""

from __future__ import annotations

import contextlib
import difflib
import inspect
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle.adapters.quantity import LENGTH, read_quantity
from trundle.adapters.robot_data import _walk, robot_from_data, robot_to_data
from trundle.adapters.robot_yaml import load_robot, robot_text, save_robot
from trundle.adapters.yaml_document import MOST_BYTES, parse_yaml, resolve_plain
from trundle.robot import DRIVES, LogMapping
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

LEAST = "drive: {type: differential, track_width: 0.2, wheel_radius: 0.042}\n"
ROVER = """\
# our rover
name: rover      # for people
drive: {type: differential, track_width: 0.20,   wheel_radius: 42 mm}   # by ruler
encoders: {ticks_per_revolution: 2796.8, bits: 16, inverted: [right]}

limits:
    max_speed: 1.0   # more is dangerous
    max_steering: 30 deg
    command_timeout: 0.5
noise: {wheel_distance: 0.01, lateral_slip: 0.0, steering: 0.5 deg, gyro: 0.001}
log:
  clock: receive
  time: {column: t, unit: s}
  wheels:   # as the firmware says it
  - {no: yes}
"""
ROVER = ROVER.replace(
    "  - {no: yes}\n",
    "    left: {column: l, unit: ticks}\n    right: {column: r, unit: ticks, sign: -1}\n"
    "  twist: {topic: /odom}\n  reference: {columns: [x, y, theta], unit: m, mounting: [4 cm, 0, 90 deg]}\n",
)

# The face of DESIGN.md section 5, as robot.yaml says it.
FACE = {
    "differential": (
        "track_width: 0.20, wheel_radius: 0.042",
        tr.Differential(track_width=0.20, wheel_radius=0.042),
    ),
    "differential, radii": (
        "track_width: 0.20, wheel_radius: {left: 0.0419, right: 0.0420}",
        tr.Differential(track_width=0.20, wheel_radius={"left": 0.0419, "right": 0.0420}),
    ),
    "skid_steer": (
        "track_width: 0.6, wheelbase: 0.4, wheel_radius: 0.1, icr_x: -2 cm",
        tr.SkidSteer(track_width=0.6, wheelbase=0.4, wheel_radius=0.1, icr_x=-0.02),
    ),
    "bicycle": (
        "wheelbase: 1.2, wheel_radius: 0.3, measured: front",
        tr.Bicycle(wheelbase=1.2, wheel_radius=0.3, measured="front"),
    ),
    "ackermann": (
        "wheelbase: 33 cm, track_width: 0.25, wheel_radius: 2 in, max_steering: 30 deg",
        tr.Ackermann(wheelbase=0.33, track_width=0.25, wheel_radius=0.0508, max_steering=math.radians(30)),
    ),
    "tricycle": (
        "wheelbase: 1.5 ft, wheel_radius: 0.1, track_width: 0.5",
        tr.Tricycle(wheelbase=0.4572, wheel_radius=0.1, track_width=0.5),
    ),
    "four_wheel_steering": (
        "wheelbase: 1, track_width: 0.8, wheel_radius: 0.2",
        tr.FourWheelSteering(wheelbase=1.0, track_width=0.8, wheel_radius=0.2),
    ),
    "mecanum": (
        "track_width: 0.3, wheelbase: 0.4, wheel_radius: 0.05, reference: [0.1, 0]",
        tr.Mecanum(track_width=0.3, wheelbase=0.4, wheel_radius=0.05, reference=(0.1, 0.0)),
    ),
    "omni": (
        "robot_radius: 0.2, wheel_radius: 0.05, wheel_count: 4, first_wheel_angle: -60 deg",
        tr.Omni(robot_radius=0.2, wheel_radius=0.05, wheel_count=4, first_wheel_angle=math.radians(-60)),
    ),
    "swerve": (
        "modules: [[0.3, 0.3], [0.3, -0.3], [-0.3, 0.3], [-0.3, -0.3]], wheel_radius: 0.05",
        tr.Swerve(modules=[(0.3, 0.3), (0.3, -0.3), (-0.3, 0.3), (-0.3, -0.3)], wheel_radius=0.05),
    ),
    "swerve, named": (
        "modules: {nose: [0.3, 0], tail: [-30 cm, 0]}, wheel_radius: 0.05",
        tr.Swerve(modules={"nose": (0.3, 0.0), "tail": (-0.3, 0.0)}, wheel_radius=0.05),
    ),
    "tracking_wheels": (
        "wheels: [[0, 0.1, 0], [0, -0.1, 0], [-0.1, 0, 90 deg]], wheel_radius: 0.024",
        tr.TrackingWheels([(0, 0.1, 0), (0, -0.1, 0), (-0.1, 0, math.pi / 2)], wheel_radius=0.024),
    ),
    "tracking_wheels, gyro": (
        "wheels: {x: [0, 0.1, 0], y: [0, 0, 90 deg]}, wheel_radius: 0.024, measured: [x, y, gyro]",
        tr.TrackingWheels(
            {"x": (0, 0.1, 0), "y": (0, 0, math.pi / 2)}, wheel_radius=0.024, measured=["x", "y", "gyro"]
        ),
    ),
    "custom": (
        "wheels: [{name: a, x: 0, y: 0.1, radius: 5 cm}, {name: c, x: 0.3, y: 0, radius: 0.02, kind: caster},"
        " {name: b, x: 0, y: -10 cm, radius: 0.05, driven: false}]",
        tr.Custom(
            wheels=[
                tr.Wheel("a", 0, 0.1, 0.05),
                tr.Wheel("c", 0.3, 0, 0.02, kind="caster"),
                tr.Wheel("b", 0, -0.1, 0.05, driven=False),
            ]
        ),
    ),
}


def read(text: str) -> tr.Robot:
    """The robot of a text, through the door that files take."""
    document = parse_yaml(text.encode(), "robot.yaml")
    try:
        return robot_from_data(document.data)
    except tr.ConfigError as error:
        raise document.located(error) from None


def refused(text: str | bytes) -> str:
    """What a file with this text is told; never anything but a ConfigError that names the file."""
    raw = text if isinstance(text, bytes) else text.encode()
    with pytest.raises(tr.ConfigError) as caught:
        read(raw.decode()) if isinstance(text, str) else parse_yaml(raw, "robot.yaml")
    assert str(caught.value).startswith("robot.yaml: ")
    return str(caught.value)


def drive_refused(parameters: str, kind: str = "differential") -> str:
    return refused(f"drive: {{type: {kind}, {parameters}}}")


# -------------------------------------------------------------------------------- reading


@pytest.mark.parametrize("kind", FACE)
def test_every_drive_of_the_face_loads(kind):
    parameters, wanted = FACE[kind]
    drive = read(f"drive: {{type: {kind.split(',')[0]}, {parameters}}}").drive
    assert type(drive) is type(wanted)
    assert drive.measured_names == wanted.measured_names
    for wheel, other in zip(drive.wheels, wanted.wheels, strict=True):
        assert (wheel.name, wheel.kind, wheel.driven) == (other.name, other.kind, other.driven)
        assert numbers(wheel) == pytest.approx(numbers(other), rel=1e-15, abs=1e-15)


def numbers(wheel: tr.Wheel) -> list[float]:
    return [
        wheel.x,
        wheel.y,
        wheel.radius,
        wheel.heading,
        wheel.free_direction or 0.0,
        *(wheel.steering_range or ()),
    ]


def test_every_drive_is_on_the_face_and_every_parameter_can_be_written():
    assert {kind.split(",")[0] for kind in FACE} == set(DRIVES)
    for drive in DRIVES.values():
        for key in inspect.signature(drive).parameters:
            assert callable(_walk(drive, key))


def test_description_of_the_face(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text(ROVER, encoding="utf-8")
    robot = load_robot(path)
    assert robot.name == "rover"
    assert robot.encoders == {
        "left": tr.Encoder(ticks_per_revolution=2796.8, bits=16),
        "right": tr.Encoder(ticks_per_revolution=2796.8, bits=16, inverted=True),
    }
    assert robot.limits == tr.Limits(max_speed=1.0, max_steering=math.radians(30))
    assert robot.noise == tr.Noise(steering=math.radians(0.5))
    assert robot.log == LogMapping(
        clock=Clock.RECEIVE,
        time=TimeMapping(column="t"),
        wheels={
            "left": WheelMapping(column="l", unit=Unit.TICKS),
            "right": WheelMapping(column="r", unit=Unit.TICKS, sign=-1),
        },
        twist=TwistMapping(topic="/odom"),
        reference=ReferenceMapping(columns=("x", "y", "theta"), mounting=(0.04, 0.0, math.pi / 2)),
    )


def test_defaults_are_filled_in():
    robot = read(LEAST)
    assert (robot.name, robot.encoders, robot.localizer) == ("robot", {}, None)
    assert (robot.limits, robot.noise, robot.log) == (
        tr.Limits(),
        tr.Robot(drive=robot.drive).noise,
        LogMapping(),
    )
    assert robot.limits.command_timeout == 0.5


def test_localizer_measures_and_has_encoders():
    wheels = "wheels: [[0, 0.1, 0], [0, -0.1, 0], [-0.1, 0, 90 deg]], wheel_radius: 24 mm"
    text = f"{LEAST}localizer: {{type: tracking_wheels, {wheels}}}\n"
    robot = read(text + "encoders: {ticks_per_revolution: 8192, left: {ticks_per_revolution: 100}}")
    assert robot.measuring.measured_names == ("wheel_1", "wheel_2", "wheel_3")
    assert [encoder.ticks_per_revolution for encoder in robot.encoders_of(("left", "right", "wheel_3"))] == [
        100,
        8192,
        8192,
    ]


def test_encoders_by_wheel_name_override_the_defaults():
    robot = read(
        LEAST + "encoders: {ticks_per_revolution: 100, inverted: true, left: {bits: 8, inverted: false}}"
    )
    assert robot.encoders == {
        "left": tr.Encoder(ticks_per_revolution=100, bits=8),
        "right": tr.Encoder(ticks_per_revolution=100, inverted=True),
    }
    assert set(read(LEAST + "encoders: {left: {ticks_per_revolution: 100}}").encoders) == {"left"}


@pytest.mark.parametrize(
    ("section", "said", "value"),
    [
        ("limits", "max_speed: 9 km/h", 2.5),
        ("limits", "max_lateral_speed: 40 cm/s", 0.4),
        ("limits", "max_yaw_rate: 90 deg/s", math.pi / 2),
        ("limits", "max_acceleration: 150 cm/s^2", 1.5),
        ("limits", "max_deceleration: 1 ft/s^2", 0.3048),
        ("limits", "max_yaw_acceleration: 180 deg/s^2", math.pi),
        ("limits", "max_jerk: 2500 mm/s^3", 2.5),
        ("limits", "max_wheel_speed: 300 rpm", 10 * math.pi),
        ("limits", "max_steering: 30 deg", math.pi / 6),
        ("limits", "command_timeout: 250 ms", 0.25),
        ("noise", "wheel_distance: 1 cm", 0.01),
        ("noise", "lateral_slip: 5 mm", 0.005),
        ("noise", "gyro: 0.18 deg/s", math.pi / 1000),
    ],
)
def test_limits_and_noise_have_units(section, said, value):
    robot = read(LEAST + f"{section}: {{{said}}}")
    assert getattr(getattr(robot, section), said.split(":")[0]) == pytest.approx(value, rel=1e-15)
    again = robot_from_data(robot_to_data(robot))
    assert (again.limits, again.noise) == (robot.limits, robot.noise)


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        ("max_yaw_rate: 180", "180 rad/s is implausible (0 to 100 rad/s): deg/s? Then write 180 deg/s"),
        ("max_speed: 800", "800 m/s is implausible (0 to 100 m/s): mm/s? Then write 800 mm/s"),
        ("command_timeout: 500", "500 s is implausible (0.001 to 60 s): ms? Then write 500 ms"),
        ("max_speed: 3 kmh", "3 kmh: not a unit of length/s; did you mean 'km/h'?"),
        ("max_acceleration: 3 m/s", "3 m/s: not a unit of length/s^2; did you mean 'm/s^2'?"),
        ("command_timeout: soon", "'soon', must be seconds > 0, or the word never"),
    ],
)
def test_limits_whose_unit_must_be_said(said, problem):
    with pytest.raises(tr.ConfigError) as caught:
        read(LEAST + f"limits: {{{said}}}")
    assert caught.value.field == f"limits.{said.split(':')[0]}"
    assert problem in caught.value.problem


def test_greatest_steering_angle_reaches_the_drive():
    car = "drive: {type: bicycle, wheelbase: 1, wheel_radius: 0.3%s}\nlimits: {max_steering: 0.5}"
    assert read(car % "").drive.wheel("front").steering_range == (-0.5, 0.5)
    assert read(car % ", max_steering: 0.4").drive.wheel("front").steering_range == (-0.4, 0.4)
    assert read(car % ", max_steering: null").drive.wheel("front").steering_range is None


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("65 mm", 0.065),
        ("8.4 cm", 0.084),
        ("2in", 0.0508),
        ("1.5 ft", 0.4572),
        ("1e3 mm", 1.0),
        ("900 m", 900.0),
        (".5 m", 0.5),
    ],
)
def test_units_are_exact(text, metres):
    assert read_quantity("x", text, LENGTH) == metres


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("1e3", 1000.0),
        ("0x1F", 31),
        ("0o17", 15),
        ("012", 12),
        ("-.5", -0.5),
        ("1.", 1.0),
        ("~", None),
        ("True", True),
    ]
    + [
        (word, word)
        for word in ("on", "no", "1_000", "1:30", "2026-01-01", "e3", "+", ".", "0b1", "1e", "\uff11")
    ],
)
def test_plain_words_mean_what_yaml_1_2_says(word, value):
    assert resolve_plain(word) == value
    assert type(resolve_plain(word)) is type(value)


# ------------------------------------------------------------------------------ refusing


def test_message_says_file_field_value_and_what_is_allowed():
    text = LEAST.replace("0.042", "-0.1")
    assert refused(text) == "robot.yaml: drive.wheel_radius: -0.1, must be > 0 (line 1)"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("bits: 16", "bits: 99", ["encoders.bits: 99", "2 to 64", "line 4"]),
        ("bits: 16", "bits: 1.5", ["encoders.bits: 1.5", "whole number"]),
        ("[right]", "[rigt]", ["encoders.inverted[0]: 'rigt'", "'right'"]),
        ("[right]", "right", ["encoders.inverted: 'right'", "a list of wheels"]),
        ("ticks_per_revolution: 2796.8, ", "", ["encoders.left.ticks_per_revolution: missing"]),
        ("max_speed: 1.0", 'max_speed: "1"', ["limits.max_speed: '1' is text", "without quotes", "line 7"]),
        ("gyro: 0.001", "gyro: -1", ["noise.gyro: -1, must be >= 0"]),
        ("gyro: 0.001", "gyro: ", ["noise.gyro: empty, must be a number"]),
        ("clock: receive", "clock: recieve", ["log.clock: 'recieve'", "'receive'", "line 12"]),
        ("unit: s}", "unit: m}", ["log.time.unit: 'm'", "s, ms, us, ns"]),
        ("column: l,", "column: true,", ["log.wheels.left.column: true, must be a whole number or text"]),
        (
            "column: l,",
            "colum: l,",
            ["log.wheels.left.colum: unknown key, did you mean 'column'?", "line 15"],
        ),
        ("column: l, unit: ticks", "column: l, unit: tick", ["log.wheels.left.unit: 'tick'", "'ticks'"]),
        ("column: l,", "unit: rad, column: l,", ["log.wheels.left.unit: is given twice"]),
        ("sign: -1", "sign: 2", ["log.wheels.right.sign: 2, known: 1, -1"]),
        ("{column: l, unit: ticks}", "l", ["log.wheels.left: 'l', must be a mapping"]),
        ("topic: /odom", "", ["log.twist: needs either"]),
        ("[x, y, theta]", "[x]", ["log.reference.columns: 1 given"]),
        ("[x, y, theta]", "x", ["log.reference.columns: 'x', must be a list"]),
        ("[4 cm, 0, 90 deg]", "[4 cm, 0]", ["log.reference.mounting", "3 numbers"]),
        ("[4 cm, 0, 90 deg]", "[4 deg, 0, 0]", ["log.reference.mounting[0]: 4 deg: not a unit of length"]),
        ("name: rover", "name: 5", ["name: 5, must be text"]),
        ("name: rover", "7: rover", ["key 7 must be text"]),
        ("name: rover", "[a]: rover", ["a key must be text"]),
        ("type: differential, ", "", ["drive.type: missing", "mecanum"]),
        ("noise: {", "noise: [{", ["not YAML", "line"]),
    ],
)
def test_what_is_refused_and_how(old, new, words):
    assert ROVER.count(old) == 1
    message = refused(ROVER.replace(old, new))
    assert all(word in message for word in words), message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"", "empty"),
        (b"# nothing\n", "empty"),
        (b"- drive\n", "must be a mapping"),
        (b"drive\n", "must be a mapping"),
        (b"name: x\n", "drive: missing"),
        (b"drive: \xff\n", "byte 7 is not UTF-8"),
        (LEAST.encode("utf-16"), "not UTF-8"),
        (b"drive: \x00\n", "not YAML"),
        (b"a: 1\n---\nb: 2\n", "second document"),
        (b"%YAML 1.1\n---\na: on\n", "YAML 1.2"),
        (b'name: "\\ud800"\n', "surrogate"),
        (b'name: "\\UFFFFFFFF"\n', "not YAML"),
        (b"[" * 5000, "nested"),
    ],
)
def test_files_that_are_no_description(tmp_path, text, words):
    path = tmp_path / "robot.yaml"
    path.write_bytes(text)
    with pytest.raises(tr.ConfigError, match=words) as caught:
        load_robot(path)
    assert str(path) in str(caught.value)


def test_what_is_not_a_file(tmp_path):
    with pytest.raises(tr.ConfigError, match="No such file"):
        load_robot(tmp_path / "robot.yaml")
    with pytest.raises(tr.ConfigError, match="not a file"):
        load_robot(tmp_path)
    with pytest.raises(tr.ConfigError, match="cannot be read"):
        load_robot("robot\0.yaml")


@given(st.data())
def test_any_damage_is_refused_or_harmless(data):
    """Characters lost, changed or doubled: a robot, or a ConfigError; never anything else."""
    text = list(ROVER)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(text) - 1))
        stop = start + data.draw(st.integers(0, 12))
        text[start:stop] = data.draw(
            st.sampled_from(
                [*"{}[]:,-&*!|>'\"%@`\\\t\n #?.~\u2028\ufeff", "\\u", "- ", ": ", "1e999", "<<: "]
            )
        )
    with contextlib.suppress(tr.ConfigError):
        assert read("".join(text)).drive.wheel_names


BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{after}: &{after} [{','.join([f'*{name}'] * 9)}]\n"
    for name, after in zip("abcdefg", "bcdefgh", strict=True)
)
WHEEL = "{name: %s, x: %s, y: %s, radius: 0.05, kind: swedish, heading: %s, free_direction: %s}"


def custom(*wheels: tuple[object, ...]) -> str:
    return "drive: {type: custom, wheels: [" + ", ".join(WHEEL % wheel for wheel in wheels) + "]}"


SAID = {"wheel_radius": "wheel_radius: 0.042", "track_width": "track_width: 0.2"}
FAULTS = {
    "C1-wheelbase": (
        "drive: {type: bicycle, wheelbase: 0, wheel_radius: 0.3}",
        "drive.wheelbase: 0, must be > 0",
    ),
    "C4": ("drive: {type: differential, track_width: 0.2}", "drive.wheel_radius: missing"),
    "C4-radii": (
        "drive: {type: differential, track_width: 0.2, wheel_radius: {left: 0.1}}",
        "drive.wheel_radius: no radius for right",
    ),
    "C4-custom": (
        "drive: {type: custom, wheels: [{name: a, x: 0, y: 0}]}",
        "drive.wheels[0].radius: missing",
    ),
    "C4-modules": (
        "drive: {type: swerve, modules: [[0, 1], [0]], wheel_radius: 0.1}",
        "drive.modules[1]: [0], must be a list of 2 numbers",
    ),
    "C4-type": ("drive: {}", "drive.type: missing"),
    "C5": (
        LEAST.replace("wheel_radius", "wheel_raduis"),
        "drive.wheel_raduis: unknown key, did you mean 'wheel_radius'?",
    ),
    "C5-type": (
        LEAST.replace("differential", "diferential"),
        "drive.type: 'diferential', did you mean 'differential'?",
    ),
    **{
        f"C5-{name}": (
            f"drive: {{type: {kind}, {name}: 0.2}}",
            f"drive.{name}: unknown key, here it is {ours}",
        )
        for kind, name, ours in (
            ("differential", "wheel_separation", "'track_width'"),
            ("differential", "wheel_base", "'track_width'"),
            ("bicycle", "wheel_base", "'wheelbase'"),
            ("differential", "axle_length", "'track_width'"),
            ("differential", "wheel_diameter", "'wheel_radius', half of the diameter"),
            ("mecanum", "lx", "'wheelbase', twice lx where"),
            ("mecanum", "LY", "'track_width', twice ly where"),
            ("omni", "wheel_offset", "'first_wheel_angle'"),
            ("ackermann", "max_steering_angle", "'max_steering'"),
        )
    },
    "L11-flow": (
        "drive: {type: differential, track_width: 0,2, wheel_radius: 0.05}",
        "key 2 must be text; write it in quotes; a decimal comma? Numbers have a point: 0.2 (line 1)",
    ),
    "L11-block": (
        "drive:\n  type: differential\n  track_width: 1\n  wheel_radius: 0,05",
        "drive.wheel_radius: '0,05' is text, must be a number with a decimal point: 0.05 (line 4)",
    ),
    "L11-unit": (
        "drive:\n  type: differential\n  track_width: 1\n  wheel_radius: 5,25 cm",
        "'5,25 cm' is text, must be a number with a decimal point: 5.25 cm",
    ),
    "C5-section": (LEAST + "limts: {}", "limts: unknown key, did you mean 'limits'?", "line 2"),
    "C5-limits": (LEAST + "limits: {max_sped: 1}", "limits.max_sped: unknown key, did you mean 'max_speed'?"),
    "C5-encoders": (
        LEAST + "encoders: {lft: {ticks_per_revolution: 9}}",
        "encoders.lft: unknown key, did you mean 'left'?",
    ),
    "C5-log": (
        LEAST + "log: {wheels: {rigth: {column: 1}}}",
        "log.wheels.rigth: unknown key, did you mean 'right'?",
    ),
    "C5-radii": (
        LEAST.replace("wheel_radius: 0.042", "wheel_radius: {lef: 0.1, right: 0.1}"),
        "drive.wheel_radius.lef",
        "'left'",
    ),
    "C5-custom": (
        "drive: {type: custom, wheels: [{name: a, x: 0, y: 0, radius: 0.1, knid: skid}]}",
        "drive.wheels[0].knid",
        "'kind'",
    ),
    "C5-kind": (
        "drive: {type: custom, wheels: [{name: a, x: 0, y: 0, radius: 0.1, kind: skidd}]}",
        "drive.wheels[0].kind: 'skidd'",
        "'skid'",
    ),
    "C6": (LEAST + "name: a\nname: b", "name: is given twice (lines 2 and 3)"),
    "C6-nested": (LEAST.replace("0.042", "0.042, wheel_radius: 0.043"), "drive.wheel_radius: is given twice"),
    "C7-radius": (LEAST.replace("0.042", "65"), "drive.wheel_radius: 65 m is implausible", "write 65 mm"),
    "C7-track": (LEAST.replace("0.2,", "200,"), "drive.track_width: 200 m is implausible", "write 200 mm"),
    "C7-dimension": (LEAST.replace("0.042", "65 deg"), "not a unit of length"),
    "C7-unit": (LEAST.replace("0.042", "65 mn"), "65 mn: not a unit of length", "'m'"),
    "C7-angle": (
        LEAST + "limits: {max_steering: 30}",
        "limits.max_steering: 30 rad is implausible",
        "write 30 deg",
    ),
    "C7-position": (
        "drive: {type: tracking_wheels, wheels: [[0, 150, 0], [0, 0, 90]], wheel_radius: 0.02}",
        "wheels[0][1]: 150 m is implausible",
        "150 mm",
    ),
    "C8-coincident": (
        "drive: {type: swerve, modules: [[0.2, 0.2], [0.2, 0.2]], wheel_radius: 0.05}",
        "drive.wheels: condition number",
        "turning (omega)",
    ),
    "C8-parallel": (
        custom(("a", 0.1, 0, 0, 1.57), ("b", 0, 0.1, 0, 1.57), ("c", -0.1, -0.1, 0, 1.57)),
        "condition number",
        "moving sideways (vy)",
    ),
    "C8-lx+ly=0": (
        custom(*((k, 0, 0, 0, sign * math.pi / 4) for k, sign in zip("abcd", (1, -1, -1, 1), strict=True))),
        "condition number",
        "turning (omega)",
    ),
    "C8-two-wheels": (
        "drive: {type: tracking_wheels, wheels: [[0, 0.1, 0], [0, 0, 90 deg]], wheel_radius: 0.02}",
        "condition number",
        "add a wheel, a gyro",
    ),
    "C9-acceleration": (LEAST + "limits: {max_acceleration: 0}", "limits.max_acceleration: 0, must be > 0"),
    "C9-jerk": (LEAST + "limits: {max_jerk: -1}", "limits.max_jerk: -1, must be > 0"),
    "C9-timeout=0": (LEAST + "limits: {command_timeout: 0}", "limits.command_timeout: 0, must be > 0"),
    "C9-timeout=-1": (LEAST + "limits: {command_timeout: -1}", "limits.command_timeout: -1, must be > 0"),
    "C9-timeout=inf": (
        LEAST + "limits: {command_timeout: .inf}",
        "limits.command_timeout: inf, must be finite",
    ),
    "C9-timeout=empty": (
        LEAST + "limits: {command_timeout: }",
        "limits.command_timeout: empty",
        "the word never",
    ),
    "C9-timeout=off": (
        LEAST + "limits: {command_timeout: off}",
        "limits.command_timeout: 'off'",
        "the word never",
    ),
    "C9-range": (
        "drive: {type: custom, wheels: [{name: a, x: 0, y: 0, radius: 0.1, kind: steered,"
        " steering_range: [1, -1]}]}",
        "drive.wheels[0].steering_range: (1, -1), min must be < max",
    ),
    "C9-icr": (
        "drive: {type: skid_steer, track_width: 1, wheelbase: 1, wheel_radius: 0.1,"
        " icr_left: -1, icr_right: 1}",
        "drive.icr_left: -1, must be > icr_right",
    ),
    "C10-tag": ("name: !!python/object/apply:os.system [ls]", "tags (", "not allowed"),
    "C10-custom-tag": ("name: !custom x", "tags (!custom) are not allowed", "line 1"),
    "C10-bomb": (BOMB, "aliases and anchors"),
    "C10-anchor": ("name: &a x", "aliases and anchors"),
    "C10-size": (LEAST + "#" * MOST_BYTES, "must be at most 1048576 (1 MiB)"),
    "C10-depth": ("name: " + "[" * 33 + "]" * 33, "nested deeper than 32 levels"),
    "C10-values": ("name: [" + "1," * 25_000 + "1]", "more than 20000 values"),
}
# Values that no length can have, in two places.
for field in ("wheel_radius", "track_width"):
    for row, value, answer in [
        ("C1", "0", "0, must be > 0"),
        ("C1", "-0.1", "-0.1, must be > 0"),
        ("C2", ".nan", "nan, must be finite"),
        ("C2", "-.inf", "-inf, must be finite"),
        ("C2", "1e999", "inf, must be finite"),
        ("C3", "on", "'on' is text, must be a number"),
        ("C3", "true", "true, must be a number"),
        ("C3", '"1e3"', "'1e3' is text, must be a number; write it without quotes"),
        ("C3", "[1]", "[1], must be a number"),
        ("C4", "", "empty, must be a number"),
    ]:
        FAULTS[f"{row}-{field}={value}"] = (
            LEAST.replace(SAID[field], f"{field}: {value}"),
            f"drive.{field}: {answer}",
        )


@pytest.mark.parametrize("row", FAULTS)
def test_fault(row):
    text, *words = FAULTS[row]
    message = refused(text)
    assert all(word in message for word in words), message


def test_singular_geometry_is_its_own_class():
    with pytest.raises(tr.Singular):
        read("drive: {type: swerve, modules: [[0.2, 0.2], [0.2, 0.2]], wheel_radius: 0.05}")


def test_units_that_are_said_are_believed():
    robot = read("drive: {type: differential, track_width: 80 m, wheel_radius: 6 m}")
    assert robot.drive.parameters == {"track_width": 80.0, "wheel_radius": 6.0}


def test_timeout_is_switched_off_by_the_word_only_and_warned_about():
    limits = read(LEAST + "limits: {command_timeout: never}").limits
    assert limits.command_lifetime == math.inf
    assert "never" in limits.warnings[0]
    assert read(LEAST).limits.warnings == ()
    assert tr.Limits().command_lifetime == 0.5
    for value in (None, math.inf, "off"):
        with pytest.raises(tr.ConfigError, match="command_timeout"):
            tr.Limits(command_timeout=value)


# -------------------------------------------------------------------------------- writing

lengths = st.floats(0.005, 4.0) | st.sampled_from([0.1, 1.0, 77.0, 1e-4])  # the last two need their unit
angles = st.floats(-6.0, 6.0) | st.sampled_from([0.0, 12.5])
positive = st.floats(1e-6, 1e6)
names = st.text(min_size=1, max_size=12).filter(
    lambda name: all(not "\ud800" <= sign <= "\udfff" for sign in name)
)
radii = st.fixed_dictionaries({"left": lengths, "right": lengths})
steering = st.none() | st.floats(0.1, 3.0)
two_wheels = st.builds(
    tr.Differential, track_width=lengths, wheel_radius=lengths | radii, reference=st.tuples(angles, angles)
)
drives = (
    two_wheels
    | st.builds(
        tr.Bicycle,
        wheelbase=lengths,
        wheel_radius=lengths,
        measured=st.sampled_from(["rear", "front"]),
        max_steering=steering,
    )
    | st.builds(
        tr.Tricycle, wheelbase=lengths, wheel_radius=lengths, track_width=st.none() | lengths, front_y=angles
    )
    | st.builds(
        tr.Omni,
        robot_radius=lengths,
        wheel_radius=lengths,
        wheel_count=st.integers(3, 5),
        first_wheel_angle=angles,
    )
    | st.lists(names, min_size=2, max_size=4, unique=True).map(
        lambda words: tr.Swerve(
            modules={word: (0.1 * k, 0.2) for k, word in enumerate(words)}, wheel_radius=0.05
        )
    )
    | st.just(FACE["custom"][1])
    | st.just(FACE["tracking_wheels, gyro"][1])
)
encoders = st.builds(
    tr.Encoder,
    ticks_per_revolution=st.sampled_from([100.0, 2796.8]),
    bits=st.none() | st.integers(2, 64),
    inverted=st.booleans(),
)
columns = st.integers(0, 9) | names
mappings = st.builds(
    LogMapping,
    clock=st.sampled_from(Clock),
    table=st.builds(TableFormat, header=st.booleans(), delimiter=st.sampled_from([",", ";", " ", "\t"])),
    time=st.none() | st.builds(TimeMapping, column=columns, unit=st.sampled_from([Unit.S, Unit.MS])),
    gyro=st.none()
    | st.builds(ScalarMapping, topic=names, field=st.none() | names, sign=st.sampled_from([1, -1])),
    reference=st.none()
    | st.builds(
        ReferenceMapping, columns=st.tuples(columns, columns), mounting=st.tuples(angles, angles, angles)
    ),
)


@st.composite
def robots(draw: st.DrawFn) -> tr.Robot:
    drive = draw(drives)
    known = [name for name in drive.wheel_names if name not in tr.Encoder.__struct_fields__]
    with_encoder = draw(st.lists(st.sampled_from(known), unique=True)) if known else []
    wheel = st.builds(
        WheelMapping,
        column=columns,
        unit=st.none() | st.just(Unit.TICKS),
        kind=st.none() | st.just(Kind.INCREMENT),
    )
    log = draw(mappings)
    return tr.Robot(
        drive=drive,
        name=draw(names),
        encoders={name: draw(encoders) for name in draw(st.sampled_from([with_encoder, known]))},
        limits=tr.Limits(
            max_speed=draw(st.none() | positive),
            max_steering=draw(steering),
            command_timeout=draw(positive | st.just("never")),
        ),
        noise=tr.Noise(wheel_distance=draw(positive), steering=draw(st.just(0.0) | positive)),
        log=msgspec.structs.replace(log, wheels={name: draw(wheel) for name in drive.wheel_names}),
        localizer=draw(st.none() | st.just(FACE["tracking_wheels"][1])),
    )


def same(one: tr.Robot, other: tr.Robot) -> bool:
    """Every number of two robots, their wheels placed."""
    fields = ("name", "encoders", "limits", "noise", "log")
    drives = [(one.drive, other.drive), (one.localizer, other.localizer)]
    return all(getattr(one, field) == getattr(other, field) for field in fields) and all(
        a is b
        or (
            type(a) is type(b)
            and (a.wheels, a.measured_names, a.gyro, a.reference)
            == (b.wheels, b.measured_names, b.gyro, b.reference)
        )
        for a, b in drives
    )


@given(robots())
def test_what_is_written_reads_back(robot):
    assert same(read(robot_text(robot)), robot)


@given(robots(), robots())
def test_any_description_becomes_any_other(before, after):
    text = robot_text(after, robot_text(before).encode())
    assert same(read(text), after)


@pytest.mark.parametrize(
    "written", ["123456789.123456789", "0.30000000000000004", "8.8e-253", "0.10", "1.50e3"]
)
def test_numbers_beside_a_change_stay_as_they_are_written(written):
    """ruamel.yaml alone would write 123456789.123456791."""
    old = "drive: {type: differential, track_width: 0.2, wheel_radius: 0.042}\n"
    old += f"limits: {{max_jerk: {written}}}\n"
    robot = read(old)
    robot = robot.replace(limits=msgspec.structs.replace(robot.limits, max_acceleration=2.0))
    text = robot_text(robot, old.encode())
    assert f"max_jerk: {written}" in text
    assert same(read(text), robot)


@given(robots())
def test_what_is_said_already_is_not_touched(robot):
    text = robot_text(robot)
    assert robot_text(robot, text.encode()) == text
    assert robot_text(read(ROVER), ROVER.encode()) == ROVER


def changed_lines(old: str, new: str) -> list[str]:
    return [line for line in difflib.ndiff(old.splitlines(), new.splitlines()) if line[0] in "+-"]


@given(st.floats(0.1, 1.0), st.floats(0.01, 0.1), st.floats(0.1, 3.0))
def test_only_numbers_that_changed_change(track_width, wheel_radius, max_speed):
    robot = read(ROVER)
    robot = robot.replace(
        drive=tr.Differential(track_width=np.float64(track_width), wheel_radius=np.float64(wheel_radius)),
        limits=msgspec.structs.replace(robot.limits, max_speed=max_speed),
    )
    wanted = (
        ROVER.replace("track_width: 0.20", f"track_width: {track_width!r}")
        .replace("wheel_radius: 42 mm", f"wheel_radius: {wheel_radius!r}")
        .replace("max_speed: 1.0", f"max_speed: {max_speed!r}")
    )
    text = robot_text(robot, ROVER.encode())
    assert same(read(text), robot)
    assert text == wanted or {track_width, wheel_radius, max_speed} & {0.2, 0.042, 1.0}


def test_one_radius_can_become_one_per_wheel():
    robot = read(ROVER).replace(
        drive=tr.Differential(track_width=0.2, wheel_radius={"left": 0.0421, "right": 0.0419})
    )
    text = robot_text(robot, ROVER.encode())
    assert text == ROVER.replace("42 mm", "{left: 0.0421, right: 0.0419}")


def test_comments_stay_where_keys_come_and_go():
    robot = read(ROVER)
    text = robot_text(robot.replace(limits=tr.Limits(max_speed=1.0, max_jerk=3.0)), ROVER.encode())
    comments = [line.split("#")[1] for line in ROVER.splitlines() if "#" in line]
    assert [line.split("#")[1] for line in text.splitlines() if "#" in line] == comments
    assert read(text).limits == tr.Limits(max_speed=1.0, max_jerk=3.0)


def test_line_ends_stay_where_keys_come_and_go():
    robot = read(ROVER)
    changed = robot.replace(limits=tr.Limits(max_speed=1.0, max_jerk=3.0))
    text = robot_text(changed, ROVER.replace("\n", "\r\n").encode())
    assert text.replace("\r\n", "\n") == robot_text(changed, ROVER.encode())
    assert text.count("\r\n") == text.count("\n")


def test_what_grows_stays_on_its_line(tmp_path):
    """Ten sigmas are longer than any line, and a mapping that breaks inside is hard to read."""
    path = tmp_path / "robot.yaml"
    path.write_text(
        f"{LEAST}calibration:\n  robot: robot\n  version: 1\n  sigmas: {{a: 0.1}}  # by hand\n",
        encoding="utf-8",
    )
    sigmas = {f"a.rather.long.name.{k}": 0.123456789 + k for k in range(10)}
    before = load_robot(path)
    record = msgspec.structs.replace(before.calibration, sigmas=sigmas)
    save_robot(msgspec.structs.replace(before, calibration=record), path)
    (line,) = [line for line in path.read_text(encoding="utf-8").splitlines() if "sigmas:" in line]
    assert line.count("a.rather.long.name") == 10
    assert load_robot(path).calibration.sigmas == sigmas


def test_save_makes_updates_and_replaces(tmp_path):
    path, other = tmp_path / "robot.yaml", tmp_path / "other.yaml"
    robot = read(LEAST)
    save_robot(robot, path)
    assert same(load_robot(path), robot)
    path.write_bytes(b"\xef\xbb\xbf# mine\r\n" + LEAST.replace("\n", "\r\n").encode())
    wider = robot.replace(drive=tr.Differential(track_width=0.21, wheel_radius=0.042))
    save_robot(wider, path)
    assert path.read_bytes() == b"# mine\r\n" + LEAST.replace("0.2,", "0.21,").replace("\n", "\r\n").encode()
    save_robot(robot, other, like=path)
    assert other.read_bytes() == path.read_bytes().replace(b"0.21", b"0.2")
    other.write_text("no robot", encoding="utf-8")
    with pytest.raises(tr.ConfigError, match=r"other\.yaml"):
        save_robot(robot, other)
    assert other.read_text(encoding="utf-8") == "no robot"
    with pytest.raises(tr.TrundleError):
        save_robot(robot, tmp_path / "missing" / "robot.yaml")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["other.yaml", "robot.yaml"]


def test_notes_stand_behind_their_values_and_replace_older_ones():
    robot = robot_from_data(parse_yaml(ROVER.encode(), "").data)
    new = robot.replace(drive=tr.Differential(track_width=0.2013, wheel_radius=0.042))
    notes = {"drive.track_width": "±0.2 mm", "limits.max_speed": "hm", "log.reference.mounting[1]": "±1 mm"}
    once = robot_text(new, ROVER.encode(), notes=notes | {"drive.no_such_thing": "x"})
    assert "wheel_radius: 42 mm}   # by ruler; calibrated: track_width ±0.2 mm\n" in once
    assert "max_speed: 1.0   # more is dangerous; calibrated: hm\n" in once
    assert "# calibrated: mounting[1] ±1 mm\n" in once
    again = robot_text(new, once.encode(), notes={"drive.track_width": "±0.1 mm"})
    assert again == once.replace("±0.2 mm", "±0.1 mm")
    assert robot_to_data(robot_from_data(parse_yaml(once.encode(), "").data)) == robot_to_data(new)
    radii = tr.Differential(track_width=0.2013, wheel_radius={"left": 0.042, "right": 0.043})
    text = robot_text(new.replace(drive=radii), notes=notes)
    assert "\n  track_width: 0.2013  # calibrated: ±0.2 mm\n" in text


def test_a_note_without_room_is_left_out():
    """The line goes on inside a quoted text: what stands at its end is no comment."""
    text = "{drive: {type: differential, track_width: 0.2, wheel_radius: 0.04}, name: 'a\n  b'}\n"
    robot = robot_from_data(parse_yaml(text.encode(), "").data)
    assert robot_text(robot, text.encode(), notes={"drive.track_width": "±1"}) == text


def test_robot_that_cannot_be_written_says_so():
    robot = read(LEAST)
    with pytest.raises(tr.ConfigError, match="reads back"):
        robot_text(robot.replace(encoders={"third": tr.Encoder(ticks_per_revolution=1)}))
    with pytest.raises(tr.ConfigError, match="reads back"):
        robot_text(robot.replace(noise=tr.Noise(gyro=1)), b"name: 2026-13-01\n" + LEAST.encode())
    with pytest.raises(tr.ConfigError, match="Custom"):
        robot_text(robot.replace(drive=tr.Kinematics(robot.drive.wheels)))


def test_plain_data_are_plain():
    def check(value):
        assert type(value) in (dict, list, str, int, float, bool, type(None)), value
        for one in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            check(one)

    check(robot_to_data(read(ROVER)))


RECORDINGS = sorted((Path(__file__).parent / "recordings").glob("*.yaml"))


@pytest.mark.parametrize("path", RECORDINGS, ids=lambda path: path.stem)
def test_descriptions_of_the_recordings_load(path):
    robot = load_robot(path)
    assert same(read(robot_text(robot)), robot)
    assert robot.log.reference is not None
