"""docs/robot.md: every example loads, and the tables say what the code does."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import msgspec
import pytest

from trundle.adapters.default_columns import with_default_columns
from trundle.adapters.quantity import Quantity
from trundle.adapters.robot_data import SECTIONS, robot_from_data, robot_to_data
from trundle.adapters.yaml_document import parse_yaml
from trundle.apps.rejection import REASONS
from trundle.robot import DRIVES, Differential, Encoder, Limits, LogMapping, Noise, Robot, Wheel
from trundle.robot.description import CalibrationRecord
from trundle.robot.log_mapping import (
    ReferenceMapping,
    TableFormat,
    TimeMapping,
    TwistMapping,
    Unit,
    WheelMapping,
)

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "robot.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
CHAPTERS = {part.split("\n", 1)[0]: part for part in re.split(r"(?m)^## ", PAGE)[1:]}


def cells(text):
    """The tables of a text, row by row; heads and rules left out."""
    return [
        [cell.strip() for cell in line.strip()[1:-1].split("|")]
        for line in text.splitlines()
        if line.startswith("| ")
    ]


def coded(text):
    """Words that are set as code."""
    return set(re.findall(r"`([^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL)))


@pytest.mark.parametrize("text", EXAMPLES, ids=range(len(EXAMPLES)))
def test_examples_load_and_are_written_back(text):
    robot = robot_from_data(parse_yaml(text.encode(), "docs/robot.md").data)
    again = robot_from_data(robot_to_data(robot))
    assert robot_to_data(again) == robot_to_data(robot)


@pytest.mark.parametrize(
    ("chapter", "keys"),
    [
        ("drive", {key for drive in DRIVES.values() for key in inspect.signature(drive).parameters}),
        ("drive", Wheel.__struct_fields__),
        ("encoders", Encoder.__struct_fields__),
        ("limits", Limits.__struct_fields__),
        ("noise", Noise.__struct_fields__),
        *(
            ("log", shape.__struct_fields__)
            for shape in (LogMapping, TableFormat, TimeMapping, WheelMapping, TwistMapping, ReferenceMapping)
        ),
        ("calibration", CalibrationRecord.__struct_fields__),
    ],
)
def test_every_key_of_the_schema_is_in_its_chapter(chapter, keys):
    assert set(keys) - coded(CHAPTERS[chapter]) == set()


def test_every_section_is_named():
    assert set(SECTIONS) <= coded(PAGE[: PAGE.index("## Numbers")])
    assert set(SECTIONS) - {"name"} <= set(CHAPTERS)


def test_every_drive_has_its_parameters():
    rows = {row[0].strip("`"): row[1] for row in cells(CHAPTERS["drive"]) if len(row) == 6}
    del rows["type"]
    common = {"measured", "reference"}
    wanted = {name: set(inspect.signature(drive).parameters) - common for name, drive in DRIVES.items()}
    assert {name: coded(row) for name, row in rows.items()} == wanted
    for name, row in rows.items():
        optional = coded(row.partition(";")[2])
        given = {
            key
            for key, one in inspect.signature(DRIVES[name]).parameters.items()
            if one.default is not one.empty
        }
        assert optional == given - common


def test_defaults_are_those_of_the_code():
    for chapter, shape in (("noise", Noise), ("limits", Limits)):
        for field in msgspec.structs.fields(shape):
            (row,) = [row for row in cells(CHAPTERS[chapter]) if row[0] == f"`{field.name}`"]
            if chapter == "noise":
                assert float(row[2]) == field.default
    assert f"default {Limits().command_timeout}:" in CHAPTERS["limits"]


def test_every_unit_is_listed():
    listed = coded(CHAPTERS["Numbers and units"])
    for dimension in ("length", "angle", "length/s", "angle/s", "time"):
        assert set(Quantity(dimension).units) <= listed
    assert {unit.value for unit in Unit} - listed == {"ticks", "ticks/s"}


def test_own_columns_are_those_that_are_read(tmp_path):
    names = [
        name for row in cells(CHAPTERS["log"]) for name in coded(row[0]) if "<wheel>" in name or "." in name
    ]
    robot = Robot(drive=Differential(track_width=0.2, wheel_radius=0.05))
    for name in (name for name in names if name.startswith("<wheel>") and "steering" not in name):
        table = ("time", *(name.replace("<wheel>", wheel) for wheel in ("left", "right")))
        mapping = with_default_columns(LogMapping(), robot, tmp_path / "run.csv", table)
        assert mapping.wheels["left"].column == name.replace("<wheel>", "left")
    assert {"gyro.yaw_rate", "reference.x", "reference.y", "reference.theta"} <= set(names)


def test_every_reason_is_explained():
    assert set(REASONS) <= coded(CHAPTERS["Why rows of a log are refused"])
