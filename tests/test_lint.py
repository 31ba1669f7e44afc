"""`trundle lint`: each trap is found where it is, and what is sound is left alone."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trundle as tr
from trundle.adapters.ros2_controllers import controllers_text
from trundle.adapters.ros2_parameters import FAMILIES
from trundle.adapters.yaml_document import parse_yaml
from trundle.apps.cli import main
from trundle.apps.exit_code import ExitCode
from trundle.apps.lint import findings, lint

SIZE = {"wheelbase": 0.3, "wheel_radius": 0.05}
DRIVES = {
    "diff_drive_controller": tr.Differential(track_width=0.3, wheel_radius=0.05),
    "mecanum_drive_controller": tr.Mecanum(track_width=0.3, **SIZE),
    "omni_wheel_drive_controller": tr.Omni(robot_radius=0.3, wheel_radius=0.05),
    "ackermann_steering_controller": tr.Ackermann(track_width=0.3, **SIZE),
    "bicycle_steering_controller": tr.Bicycle(**SIZE),
    "tricycle_steering_controller": tr.Tricycle(
        track_width=0.3, measured=("rear_left", "rear_right"), **SIZE
    ),
    "tricycle_controller": tr.Tricycle(**SIZE),
}
CLEAN = {package: controllers_text(tr.Robot(drive=drive)) for package, drive in DRIVES.items()}


def found(text, urdf=None):
    return findings(parse_yaml(text.encode(), "c.yaml"), urdf)


def changed(package, name, value):
    """The clean parameters with one line changed; None takes it out."""
    line = re.compile(rf"^( +){name}: .*\n", re.MULTILINE)
    text, count = line.subn("" if value is None else rf"\g<1>{name}: {value}\n", CLEAN[package])
    return text if count else f"{CLEAN[package]}    {name}: {value}\n"


def test_every_family_has_a_clean_file():
    assert set(CLEAN) == set(FAMILIES)


@pytest.mark.parametrize("package", CLEAN)
def test_what_we_write_is_clean(package):
    assert found(CLEAN[package]) == []


DIFF, MECANUM, OMNI, ACKERMANN, BICYCLE, TRICYCLE_STEERING, TRICYCLE = CLEAN
# What was changed, and what must be said of it: the last part of its place, what, and what to write.
TRAPS = {
    "indices": (
        ACKERMANN,
        "pose_covariance_diagonal",
        "[0.0, 7.0, 14.0, 21.0, 28.0, 35.0]",
        "places of the diagonal",
        r"\[0.001",
    ),
    "indices of five": (
        MECANUM,
        "pose_covariance_diagonal",
        "[0.0, 6.0, 12.0, 18.0, 24.0, 30.0]",
        "places of the diagonal",
        r"\[0.001",
    ),
    "indices by default": (
        BICYCLE,
        "twist_covariance_diagonal",
        None,
        "is not set, and by default .*places",
        r"\[0.001",
    ),
    "zeros": (
        DIFF,
        "twist_covariance_diagonal",
        "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]",
        "no variance of x, y, z, roll, pitch, yaw",
        r"\[0.001",
    ),
    "zeros by default": (OMNI, "pose", None, "by default .*no variance", "diagonal_covariance.pose: "),
    "a zero": (
        DIFF,
        "pose_covariance_diagonal",
        "[0.1, 0.1, 0.0, 0.1, 0.1, 0.1]",
        "no variance of z$",
        r"\[0.001",
    ),
    "five": (DIFF, "pose_covariance_diagonal", "[0.1, 0.1, 0.1, 0.1, 0.1]", "must be six", r"\[0.001"),
    "negative": (
        DIFF,
        "pose_covariance_diagonal",
        "[0.1, 0.1, 0.1, 0.1, 0.1, -0.1]",
        "must be finite and >= 0",
        r"\[0.001",
    ),
    "other nesting": (
        OMNI,
        "twist_covariance_diagonal",
        "[0.1, 0.1, 0.1, 0.1, 0.1, 0.1]",
        "has no parameter",
        "^diagonal_covariance.twist: ",
    ),
    "feedback of diff": (
        DIFF,
        "position_feedback",
        None,
        "here it is true, in the steering controllers false",
        "position_feedback: true",
    ),
    "feedback of steering": (
        ACKERMANN,
        "position_feedback",
        None,
        "here it is false, in diff_drive_controller true",
        "position_feedback: false",
    ),
    "ms for s": (DIFF, "cmd_vel_timeout", "500.0", "500 s: milliseconds", "cmd_vel_timeout: 0.5"),
    "ms for s, of a wrong type": (DIFF, "cmd_vel_timeout", "500", "500 s: milli", "^cmd_vel_timeout: 0.5$"),
    "a wrong type of zero": (DIFF, "cmd_vel_timeout", "0", "is 0$", "^cmd_vel_timeout: 0.5$"),
    "millimetres, of a wrong type": (DIFF, "wheel_radius", "33", "33 m: mm", "^wheel_radius: 0.033$"),
    "s for ms": (TRICYCLE, "cmd_vel_timeout", "2", "2 ms: seconds", "cmd_vel_timeout: 2000"),
    "never": (DIFF, "cmd_vel_timeout", "0.0", "is 0$", "cmd_vel_timeout: 0.5"),
    "one cycle": (MECANUM, "reference_timeout", None, r"is 0 \(it is not set\)", "reference_timeout: 0.5"),
    "far too late": (TRICYCLE, "cmd_vel_timeout", "60000", "60000 ms", "cmd_vel_timeout: 500"),
    "plural": (
        BICYCLE,
        "traction_wheels_radius",
        "0.05",
        "has no parameter",
        "nothing|traction_wheel_radius",
    ),
    "typo": (DIFF, "wheel_seperation_multipler", "1.1", "has no parameter", "nothing"),
    "near": (BICYCLE, "enable_odom_tff", "true", "has no parameter", "^enable_odom_tf: "),
    "old name": (TRICYCLE_STEERING, "wheel_track", "0.3", "is an old name", "traction_track_width"),
    "stamped": (DIFF, "use_stamped_vel", "false", "is an old name", "TwistStamped"),
    "integer": (DIFF, "wheel_radius", "1", "1 is no double$", r"wheel_radius: 1\.0"),
    "integers": (
        DIFF,
        "pose_covariance_diagonal",
        "[1, 1.0, 1.0, 1.0, 1.0, 1.0]",
        "is no double array",
        r": \[1\.0, 1\.0",
    ),
    "quoted": (DIFF, "wheel_radius", "'0.05'", "0.05 is no double$", "wheel_radius: 0.05"),
    "word": (DIFF, "open_loop", "no", "no is no bool", "open_loop: false"),
    "half": (DIFF, "wheel_separation_multiplier", "2.0", "half as large", "wheel_separation_multiplier: 1.0"),
    "diameter": (DIFF, "left_wheel_radius_multiplier", "0.5", "twice as large", "multiplier: 1.0"),
    "half track": (
        ACKERMANN,
        "steering_track_width",
        "0.15",
        "while traction_track_width is 0.3",
        "whole distance",
    ),
    "millimetres": (DIFF, "wheel_radius", "33.0", "33 m: mm", "wheel_radius: 0.033"),
    "sides": (DIFF, "left_wheel_names", '["right_wheel_joint2"]', "this is the left side", "the left joints"),
    "order": (
        ACKERMANN,
        "steering_joints_names",
        "[front_left_joint, front_right_joint]",
        "the order here is right, left",
        r"\[front_right_joint, front_left_joint\]",
    ),
    "corner": (MECANUM, "front_left_wheel_command_joint_name", "front_right_j", "left side", "left joints"),
    "missing": (DIFF, "wheel_separation", None, "is missing", "wheel_separation: "),
    "impossible": (DIFF, "wheel_radius", "0.0", "must be > 0", "allowed"),
}


@pytest.mark.parametrize("row", TRAPS)
def test_trap(row):
    package, name, value, what, write = TRAPS[row]
    hits = found(changed(package, name, value))
    assert [one for one in hits if re.search(what, one.what) and re.search(write, one.write)], hits
    assert sum(one.place.endswith(f".{name}") for one in hits) <= 1, hits  # of one value one finding
    assert all(one.why and one.place.startswith(f"{package}.ros__parameters") for one in hits)
    assert len(hits) == 1, hits


def test_one_mistake_is_one_finding():
    text = changed(BICYCLE, "traction_wheel_radius", None) + "    traction_wheels_radius: 0.05\n"
    (only,) = found(text)
    assert only.write == "traction_wheel_radius: ..."


def test_open_loop_reads_no_feedback():
    assert found(changed(DIFF, "position_feedback", None) + "    open_loop: true\n") == []


@pytest.fixture
def model(tmp_path):
    """Writes the model of a differential robot."""

    def write(half=0.15, radius=0.05, axis="0 1 0"):
        links = "".join(
            f'<link name="{side}"><collision><geometry><sphere radius="{radius}"/></geometry>'
            "</collision></link>"
            f'<joint name="{side}_wheel_joint" type="continuous">'
            f'<parent link="base_link"/><child link="{side}"/>'
            f'<origin xyz="0 {y} 0"/><axis xyz="{axis}"/></joint>'
            for side, y in (("left", half), ("right", -half))
        )
        path = tmp_path / "m.urdf"
        path.write_text(f'<robot name="r"><link name="base_link"/>{links}</robot>')
        return path

    return write


@pytest.mark.parametrize(
    ("words", "places", "what"),
    [
        ({}, [], ""),
        ({"half": 0.075}, ["wheel_separation"], "0.3 m: half of it, or twice"),
        ({"radius": 0.025}, ["wheel_radius"], "0.05 m: a diameter"),
        ({"half": 0.16}, ["wheel_separation"], "0.3 m"),
        ({"axis": "0 -1 0"}, ["ros__parameters"] * 2, "axis points to the right"),
    ],
    ids=["agrees", "half", "diameter", "other", "axis"],
)
def test_against_the_model(model, words, places, what):
    hits = found(CLEAN[DIFF], model(**words))
    assert [one.place.rpartition(".")[2] for one in hits] == places
    assert all(what in one.what for one in hits)


def test_a_joint_that_the_model_does_not_have(model):
    (only,) = found(changed(DIFF, "left_wheel_names", "[left_weel_joint]"), model())
    assert "left_weel_joint: the model has no such wheel" in only.what
    assert "did you mean 'left_wheel_joint'" in only.write


# --- the verb ------------------------------------------------------------------------------------


def test_a_clean_file_exits_with_0(tmp_path, capsys):
    path = tmp_path / "c.yaml"
    path.write_text(CLEAN[DIFF])
    assert lint(path) is ExitCode.FINE
    assert capsys.readouterr().out == f"{path}: 0 findings\n"


def test_a_finding_says_line_what_why_and_what_to_write(tmp_path, capsys):
    path = tmp_path / "c.yaml"
    path.write_text(changed(DIFF, "cmd_vel_timeout", "500.0"))
    assert lint(path) is ExitCode.FOUND
    assert capsys.readouterr().out.splitlines() == [
        f"{path}:16: diff_drive_controller.ros__parameters.cmd_vel_timeout",
        "  what   500 s: milliseconds?",
        "  why    a robot whose commander has died would drive on for 500 s",
        "  write  cmd_vel_timeout: 0.5",
        f"{path}: 1 finding",
    ]


def test_on_the_command_line(tmp_path, capsys, model):
    path = tmp_path / "c.yaml"
    path.write_text(CLEAN[DIFF])
    assert main(["lint", str(path), "--urdf", str(model())]) == 0
    assert main(["lint", str(path), "--urdf", str(model(half=0.3))]) == 6
    assert main(["lint", str(tmp_path / "none.yaml")]) == 2
    assert "cannot be read" in capsys.readouterr().err


def test_a_robot_yaml_is_checked_too():
    drive = "drive: {type: differential, track_width: 0.2, wheel_radius: 0.05}\n"
    assert found(drive) == []
    (only,) = found(f"{drive}limits: {{command_timeout: never}}\n")
    assert only.place == "limits.command_timeout"
    with pytest.raises(tr.ConfigError, match=r"c.yaml: drive.track_width: -1, must be > 0"):
        found(drive.replace("0.2", "-1"))


def test_other_files_are_refused():
    with pytest.raises(tr.ConfigError, match="neither a robot"):
        found("a: 1\n")


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(st.characters(codec="ascii"), max_size=5),
    lambda inner: st.lists(inner, max_size=6),
    max_leaves=8,
)


@settings(max_examples=150, deadline=None)
@given(package=st.sampled_from(list(CLEAN)), data=st.data())
def test_nothing_that_may_stand_there_is_a_traceback(package, data):
    document = parse_yaml(CLEAN[package].encode(), "")
    family = FAMILIES[package]
    name = data.draw(st.sampled_from([*family.parameters, *family.deprecated, "other"]))
    document.data[package]["ros__parameters"] = {
        key: one
        for key, one in document.data[package]["ros__parameters"].items()
        if key != name.split(".")[0]
    } | {name: data.draw(values)}
    for one in findings(document):
        assert all(one)
