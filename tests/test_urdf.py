"""URDF and xacro: wheels found in joints, drives found in wheels, and files that are refused."""

from __future__ import annotations

import math
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import trundle as tr
from trundle.adapters.robot_data import robot_from_data, robot_to_data
from trundle.adapters.urdf import robot_from_urdf, urdf_wheels
from trundle.adapters.xml_document import MOST_BYTES, parse_xml

SIDEWAYS = "1.5707963267948966 0 0"  # lays a cylinder's axis along y


def link(name, radius=None, shape="cylinder", rpy="0 0 0", of="collision"):
    if radius is None:
        return f'<link name="{name}"/>'
    length = ' length="0.02"' if shape == "cylinder" else ""
    return (
        f'<link name="{name}"><{of}><origin rpy="{rpy}"/>'
        f'<geometry><{shape} radius="{radius}"{length}/></geometry></{of}></link>'
    )


def joint(name, parent, child, kind="continuous", xyz="0 0 0", rpy="0 0 0", axis="0 1 0", limit=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def wheel(name, x, y, radius=0.05, axis="0 1 0", parent="base_link"):
    """A wheel whose link stands as its parent does, with its cylinder laid on its side."""
    return link(f"{name}_link", radius, rpy=SIDEWAYS) + joint(
        name, parent, f"{name}_link", xyz=f"{x} {y} 0.05", axis=axis
    )


def steered(name, x, y, radius=0.05, axis="0 0 1", limits=(-0.6, 0.6)):
    """A wheel below a joint that steers it."""
    kind, limit = "continuous", ""
    if limits:
        kind, limit = "revolute", f'<limit lower="{limits[0]}" upper="{limits[1]}"/>'
    knuckle = f"{name}_knuckle"
    swivel = joint(f"{name}_steer", "base_link", knuckle, kind, f"{x} {y} 0", axis=axis, limit=limit)
    return link(knuckle) + swivel + wheel(name, 0, 0, radius, parent=knuckle)


def robot(*parts):
    return f'<robot name="model">{link("base_link")}{"".join(parts)}</robot>'


@pytest.fixture
def read(tmp_path):
    """Reads a robot from a text."""

    def read(text, **words):
        path = tmp_path / "model.urdf"
        path.write_text(text)
        return robot_from_urdf(path, **words)

    return read


def signs(found):
    return {name: mapping.sign for name, mapping in found.log.wheels.items()}


def places(drive):
    return {one.name: pytest.approx((one.x, one.y)) for one in drive.wheels}


# --- wheels --------------------------------------------------------------------------------------


def test_two_wheels_are_a_differential_drive(read):
    found = read(robot(wheel("l", 0, 0.15), wheel("r", 0, -0.15, axis="0 -1 0")))
    assert found.name == "model"
    assert found.drive.type_name == "differential"
    assert found.drive.parameters == {"track_width": pytest.approx(0.3), "wheel_radius": 0.05}
    assert {name: one.name for name, one in found.log.wheels.items()} == {"left": "l", "right": "r"}
    assert signs(found) == {"left": 1, "right": -1}
    assert {one.topic for one in found.log.wheels.values()} == {"/joint_states"}


def test_a_joint_of_which_only_the_frame_is_turned(read):
    """The habit of exporters: the wheel's link lies on its side, the axis is its own z."""
    text = robot(
        *(
            link(f"{name}_link", 0.05)
            + joint(name, "base_link", f"{name}_link", xyz=f"0 {y} 0", rpy=rpy, axis=axis)
            for name, y, rpy, axis in (("l", 0.2, "-1.5708 0 0", "0 0 1"), ("r", -0.2, "1.5708 0 0", "0 0 1"))
        )
    )
    assert signs(read(text)) == {"left": 1, "right": -1}


def test_the_reported_point_is_the_base_link(read):
    ahead = read(robot(wheel("l", 0.1, 0.15), wheel("r", 0.1, -0.15)))
    assert ahead.drive.reference == pytest.approx((-0.1, 0.0))
    assert places(ahead.drive) == {"left": (0.1, 0.15), "right": (0.1, -0.15)}
    twist = ahead.drive.forward([-1.0, 1.0])
    assert twist.vy == pytest.approx(-0.1 * twist.omega)  # behind the axle, it swings out


def test_origins_are_composed_along_fixed_and_moving_joints(read):
    text = robot(
        link("footprint"),
        joint("foot", "footprint", "base_link", "fixed", "1 2 3", "0 0 1.2"),
        link("plate"),
        joint("mount", "base_link", "plate", "fixed", "0.1 0 0", "0 0 1.5707963267948966"),
        link("arm"),
        joint("suspension", "plate", "arm", "prismatic", "0 0.1 0", axis="0 0 1"),
        wheel("l", 0.2, 0, parent="arm", axis="1 0 0"),
        wheel("r", -0.2, 0, parent="arm", axis="-1 0 0"),
    ).replace(SIDEWAYS, "0 1.5707963267948966 0")
    found = read(text)
    assert places(found.drive) == {"left": (0.0, 0.2), "right": (0.0, -0.2)}
    assert signs(found) == {"left": 1, "right": -1}


@pytest.mark.parametrize(
    ("parts", "radius"),
    [
        (link("w", 0.07, rpy=SIDEWAYS), 0.07),
        (link("w", 0.07, rpy=SIDEWAYS, of="visual"), 0.07),
        (link("w", 0.08, shape="sphere"), 0.08),
        # A hub with a tyre fixed to it.
        (
            link("w", 0.02, rpy=SIDEWAYS) + link("t", 0.09, rpy=SIDEWAYS) + joint("tyre", "w", "t", "fixed"),
            0.09,
        ),
        # A motor upright beside it does not roll.
        (link("w", 0.05, rpy=SIDEWAYS) + link("m", 0.3) + joint("motor", "w", "m", "fixed"), 0.05),
    ],
    ids=["collision", "visual", "sphere", "tyre", "motor"],
)
def test_radius(read, parts, radius):
    text = robot(parts, joint("l", "base_link", "w", xyz="0 0.2 0"), wheel("r", 0, -0.2, radius))
    assert read(text).drive.parameters["wheel_radius"] == radius


def test_a_wheel_that_is_only_a_mesh_needs_its_radius(read):
    mesh = '<link name="w"><visual><geometry><mesh filename="w.stl"/></geometry></visual></link>'
    text = robot(mesh, joint("l", "base_link", "w", xyz="0 0.2 0"), wheel("r", 0, -0.2))
    with pytest.raises(tr.ConfigError, match=r"link 'w' \(line 1\): joint 'l' .*give wheel_radius="):
        read(text)
    assert read(text, wheel_radius=0.05).drive.parameters["wheel_radius"] == 0.05


def test_what_has_limits_steers_though_a_stand_in_is_commanded(read):
    """The habit of ros2_control's own car: it commands virtual joints in the middle, which turn no body."""
    stand_ins = link("virtual_rear") + link("virtual_front")
    stand_ins += joint("virtual_rear_joint", "base_link", "virtual_rear")
    stand_ins += joint(
        "virtual_front_joint", "base_link", "virtual_front", "revolute", "0.3 0 0", axis="0 0 1"
    )
    control = "".join(
        f'<joint name="virtual_{end}_joint"><command_interface name="{what}"/></joint>'
        for end, what in (("front", "position"), ("rear", "velocity"))
    )
    text = robot(
        *(wheel(f"rear_{k}", 0, y) for k, y in enumerate((0.1, -0.1))),
        *(steered(f"front_{k}", 0.3, y) for k, y in enumerate((0.1, -0.1))),
        stand_ins,
        f'<ros2_control name="car" type="system">{control}</ros2_control>',
    )
    found = read(text)
    assert found.drive.type_name == "ackermann"
    assert [one.name for one in found.log.steering.values()] == ["front_0_steer", "front_1_steer"]
    assert {one.name for one in found.log.wheels.values()} == {"rear_0", "rear_1", "front_0", "front_1"}


def test_casters_say_nothing(read):
    base = (wheel("l", 0, 0.2), wheel("r", 0, -0.2))
    named = steered("front_caster", 0.3, 0.0, limits=None)
    assert read(robot(*base, named)).drive.type_name == "differential"
    unnamed = steered("ball", 0.3, 0.0, limits=None)
    assert read(robot(*base, unnamed)).drive.type_name == "tricycle"
    control = "".join(f'<joint name="{name}"><command_interface name="velocity"/></joint>' for name in "lr")
    control = f'<ros2_control name="c" type="system">{control}<joint name="ball_steer"/></ros2_control>'
    assert read(robot(*base, unnamed, control)).drive.type_name == "differential"


def test_the_arm_on_top_is_not_taken_for_a_wheel(read):
    arm = link("upper") + joint("elbow", "base_link", "upper", "revolute", "0 0 1")
    assert read(robot(wheel("l", 0, 0.2), wheel("r", 0, -0.2), arm)).drive.type_name == "differential"
    drum = wheel("drum", 0.5, 0)
    text = robot(wheel("l", 0, 0.2), wheel("r", 0, -0.2), drum)
    assert read(text, wheels=["l", "r"]).drive.type_name == "differential"
    with pytest.raises(tr.ConfigError, match=r"joint 'dum': is no wheel joint, did you mean 'drum'"):
        read(text, wheels=["l", "dum"])


# --- drives --------------------------------------------------------------------------------------

FOUR = [("fl", 0.2, 0.15), ("fr", 0.2, -0.15), ("rl", -0.2, 0.15), ("rr", -0.2, -0.15)]


def four():
    return robot(*(wheel(*place) for place in FOUR))


@pytest.mark.parametrize("word", [None, "skid_steer", "mecanum", "custom"])
def test_four_fixed_wheels(read, word):
    drive = read(four(), drive=word).drive
    assert drive.type_name == (word or "skid_steer")
    corners = dict(zip(("front_left", "front_right", "rear_left", "rear_right"), FOUR, strict=True))
    for name, (own, x, y) in corners.items():
        there = drive.wheel(own if word == "custom" else name)
        assert (there.x, there.y) == pytest.approx((x, y))


def test_six_wheels_skid(read):
    text = robot(*(wheel(*place) for place in [*FOUR, ("ml", 0, 0.15), ("mr", 0, -0.15)]))
    drive = read(text).drive
    assert drive.type_name == "custom"
    assert {one.kind.value for one in drive.wheels} == {"skid"}
    assert drive.forward([1.0] * 6).vx == pytest.approx(0.05)


def test_mecanum_rollers_are_no_wheels(read):
    rollers = "".join(
        link(f"{name}_roller", 0.01) + joint(f"{name}_r", f"{name}_link", f"{name}_roller", axis="1 1 0")
        for name, *_ in FOUR
    )
    assert (
        read(four().replace("</robot>", rollers + "</robot>"), drive="mecanum").drive.type_name == "mecanum"
    )


@pytest.mark.parametrize("count", [3, 4, 5])
def test_wheels_on_a_circle(read, count):
    parts = []
    for k in range(count):
        angle = 0.4 + k * math.tau / count
        c, s = math.cos(angle), math.sin(angle)
        parts.append(link(f"w{k}", 0.05, shape="sphere"))
        outward = 1 if k % 2 else -1
        parts.append(
            joint(
                f"j{k}",
                "base_link",
                f"w{k}",
                xyz=f"{0.3 * c} {0.3 * s} 0",
                axis=f"{outward * c} {outward * s} 0",
            )
        )
    found = read(robot(*parts))
    expected = tr.Omni(robot_radius=0.3, wheel_radius=0.05, wheel_count=count, first_wheel_angle=0.4)
    assert found.drive.type_name == "omni"
    twist = tr.Twist2D(0.3, -0.2, 0.7)
    assert found.drive.inverse(twist).speeds == pytest.approx(expected.inverse(twist).speeds)
    assert list(signs(found).values()) == [1 if k % 2 else -1 for k in range(count)]


def test_steered_wheels(read):
    front = [steered("fl", 0.3, 0.1), steered("fr", 0.3, -0.1, axis="0 0 -1", limits=(-0.5, 0.7))]
    rear = [wheel("rl", 0, 0.1), wheel("rr", 0, -0.1)]
    car = read(robot(*front, *rear))
    assert car.drive.type_name == "ackermann"
    assert car.drive.parameters["wheelbase"] == pytest.approx(0.3)
    assert car.drive.parameters["max_steering"] == 0.7
    assert {name: (one.name, one.sign) for name, one in car.log.steering.items()} == {
        "front_left": ("fl_steer", 1),
        "front_right": ("fr_steer", -1),
    }
    bicycle = read(robot(steered("f", 0.3, 0), wheel("r", 0, 0))).drive
    assert (bicycle.type_name, bicycle.parameters["wheelbase"]) == ("bicycle", pytest.approx(0.3))
    fork = read(robot(steered("f", 1.3, 0.1, limits=None), wheel("l", 0.3, 0.4), wheel("r", 0.3, -0.4)))
    assert fork.drive.type_name == "tricycle"
    assert fork.drive.parameters["front_y"] == pytest.approx(0.1)
    assert fork.drive.reference == pytest.approx((-0.3, 0.0))
    swerve = robot(*(steered(*place, limits=None) for place in FOUR))
    assert read(swerve).drive.type_name == "swerve"
    assert read(swerve, drive="four_wheel_steering").drive.type_name == "four_wheel_steering"


def test_what_is_not_placed_like_a_drive_is_taken_as_it_is(read):
    front = [steered("fl", 0.3, 0.08), steered("fr", 0.3, -0.08)]
    text = robot(*front, wheel("rl", 0, 0.1), wheel("rr", 0, -0.1))
    drive = read(text).drive
    assert drive.type_name == "custom"
    assert places(drive)["fl"] == (0.3, 0.08)
    with pytest.raises(tr.ConfigError, match=r"joint 'fl': stands 20.0 mm .* from where a ackermann drive"):
        read(text, drive="ackermann")


def test_a_drive_that_these_wheels_cannot_be(read):
    with pytest.raises(tr.ConfigError, match="4 fixed and 0 steered wheels cannot be a differential drive"):
        read(four(), drive="differential")
    with pytest.raises(tr.ConfigError, match=r"drive: 'mecanun', did you mean 'mecanum'"):
        read(four(), drive="mecanun")


@settings(max_examples=40, deadline=None)
@given(
    width=st.floats(0.05, 2.0),
    length=st.floats(0.05, 2.0),
    radii=st.tuples(*[st.floats(0.01, 0.5)] * 4),
    shift=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    axes=st.tuples(*[st.sampled_from([1, -1])] * 4),
)
def test_what_is_drawn_is_what_is_read(tmp_path_factory, width, length, radii, shift, axes):
    corners = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    parts = [
        wheel(f"w{k}", shift[0] + x * length / 2, shift[1] + y * width / 2, radii[k], axis=f"0 {axes[k]} 0")
        for k, (x, y) in enumerate(corners)
    ]
    path = tmp_path_factory.mktemp("urdf") / "m.urdf"
    path.write_text(robot(*parts[::-1]))
    found = robot_from_urdf(path)
    assert found.drive.type_name == "skid_steer"
    assert found.drive.parameters["track_width"] == pytest.approx(width)
    assert found.drive.parameters["wheelbase"] == pytest.approx(length)
    assert [found.drive.wheel(name).radius for name in found.drive.wheel_names] == list(radii)
    assert [one.sign for one in found.log.wheels.values()] == list(axes)
    assert robot_to_data(robot_from_data(robot_to_data(found))) == robot_to_data(found)


# --- files ---------------------------------------------------------------------------------------

BOMB = (
    '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    '<robot name="&b;"><link name="base_link"/></robot>'
)
HOSTILE = {
    "bomb": (BOMB.encode(), r"document type .* is not allowed: remove it \(line 1\)"),
    "bomb in UTF-16": (BOMB.encode("utf-16"), "document type"),
    "external": (b'<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot/>', "document type"),
    "entity": (b'<robot name="&x;"/>', "not XML: undefined entity"),
    "large": (b"<robot>" + b" " * MOST_BYTES, "must be at most 1048576"),
    "deep": (b"<a>" * 200, "nested deeper than 64 levels"),
    "many": (b"<robot>" + b"<a/>" * 60_000 + b"</robot>", "more than 50000 elements"),
    "cut": (b'<robot><link name="a">', "not XML: no element found"),
    "empty": (b"", "not XML"),
    "no XML": (b"robot: {}", "not XML: syntax error"),
    "encoding": (b'<?xml version="1.0" encoding="klingon"?><robot/>', "not XML"),
    "nul": (b"<robot>\0</robot>", "not XML"),
    "no robot": (b"<sdf/>", "its root is <sdf>, must be <robot>"),
}


@pytest.mark.parametrize("row", HOSTILE)
def test_hostile_files_are_refused(tmp_path, row):
    raw, words = HOSTILE[row]
    path = tmp_path / "m.urdf"
    path.write_bytes(raw)
    with pytest.raises(tr.ConfigError, match=words):
        robot_from_urdf(path)


TWO = wheel("l", 0, 0.2) + wheel("r", 0, -0.2)
BROKEN = {
    "no wheels": (robot(), "no wheels: no continuous joint has a level axis"),
    "axis": (
        robot(TWO).replace("0 1 0", "0 0 0"),
        r"joint 'l': axis 0 0 0, must have a direction \(line 1\)",
    ),
    "numbers": (robot(TWO).replace("0 0.2 0.05", "0 0.2"), r"joint 'l': xyz='0 0.2', must be 3 numbers"),
    "nan": (robot(TWO).replace("0 0.2 0.05", "0 nan 0"), r"xyz='0 nan 0', must be 3 numbers"),
    "infinite": (robot(TWO).replace("0 0.2 0.05", "0 1e999 0"), r"xyz='0 1e999 0', must be 3 numbers"),
    "underscores": (robot(TWO).replace("0 0.2 0.05", "0 2_0 0"), r"must be 3 numbers"),
    "radius": (robot(TWO).replace('"0.05"', '"-1"'), r"link 'l_link': cylinder radius -1, must be > 0"),
    "no link": (robot(TWO).replace('child link="l_link"', 'child link="l_lnk"'), "did you mean 'l_link'"),
    "no child": (robot(TWO).replace('<child link="l_link"/>', ""), r"joint 'l': has no <child link=...>"),
    "no name": (robot("<link/>"), r"link: has no name \(line 1\)"),
    "two roots": (robot(TWO, link("lost")), "links without a parent: base_link, lost"),
    "two parents": (
        robot(TWO, joint("again", "base_link", "l_link", "fixed")),
        "link 'l_link' has a parent already",
    ),
    "ring": (
        robot(TWO, link("a"), link("b"), joint("ab", "a", "b", "fixed"), joint("ba", "b", "a", "fixed")),
        "hang in a ring of joints: a, b",
    ),
    "one wheel": (robot(wheel("l", 0, 0.2)), "cannot|observe|determine"),
}


@pytest.mark.parametrize("row", BROKEN)
def test_what_cannot_be_is_refused_with_its_place(read, row):
    text, words = BROKEN[row]
    with pytest.raises(tr.ConfigError, match=words) as caught:
        read(text)
    assert caught.value.source.endswith("model.urdf")


def test_no_file(tmp_path):
    with pytest.raises(tr.ConfigError, match="cannot be read"):
        robot_from_urdf(tmp_path / "none.urdf")
    with pytest.raises(tr.ConfigError, match="is not a file"):
        robot_from_urdf(tmp_path)


@settings(max_examples=200, deadline=None)
@given(cut=st.integers(0, 3000), flip=st.integers(0, 7))
def test_damage_gives_a_robot_or_says_what_is_wrong(tmp_path_factory, cut, flip):
    raw = bytearray(robot(TWO).encode())
    raw[cut % len(raw)] ^= 1 << flip
    path = tmp_path_factory.getbasetemp() / "damaged.urdf"
    path.write_bytes(raw)
    refusal = None
    try:
        robot_from_urdf(path)
    except (tr.ConfigError, tr.MissingExtra) as error:
        refusal = error
    assert not isinstance(refusal, tr.ConfigError) or str(path) in str(refusal)


XACRO = """<robot xmlns:xacro="http://ros.org/wiki/xacro" name="model">
  <xacro:property name="half" value="${0.3 / 2}"/>
  %s
</robot>"""


def test_xacro_without_its_package(read, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(
        tr.MissingExtra, match=r"xacro is not installed; get it with: pip install 'trundle\[xacro\]'"
    ):
        read(XACRO % "")


def test_xacro(read):
    pytest.importorskip("xacro", reason="the xacro package is not installed")
    text = robot(wheel("l", 0, "${half}"), wheel("r", 0, "${-half}"))
    parts = text.partition(">")[2].removesuffix("</robot>")
    assert read(XACRO % parts).drive.parameters["track_width"] == pytest.approx(0.3)
    with pytest.raises(tr.ConfigError, match=r"xacro cannot expand it: .*nothing"):
        read(XACRO % '<link name="${nothing}"/>')


def test_elements_know_their_lines():
    root = parse_xml(b"<a>\n<b x='1'/>\n\n<c/>text</a>", "")
    assert [(one.tag, one.line) for one in root.walk()] == [("a", 1), ("b", 2), ("c", 4)]


def test_wheels_can_be_had_without_a_drive(tmp_path):
    path = tmp_path / "m.urdf"
    path.write_text(robot(TWO))
    name, found = urdf_wheels(path)
    assert (name, [(one.joint, one.x, one.y, one.radius) for one in found]) == (
        "model",
        [("l", 0.0, 0.2, 0.05), ("r", 0.0, -0.2, 0.05)],
    )
