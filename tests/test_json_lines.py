"""JSON lines: strict like text tables, whole objects only, and nothing lost without a word."""

from __future__ import annotations

import json
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle.adapters import json_lines
from trundle.adapters.numeral import Count, Real, Stamp
from trundle.adapters.table import Wanted, open_table
from trundle.errors import LogError, LogLimit, LogSchema
from trundle.robot.log_mapping import Kind, LogMapping, TimeMapping, Unit, WheelMapping

DRIVE = tr.Differential(track_width=0.2, wheel_radius=0.04)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("json")


def written(folder, text, name="log.jsonl"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def read(folder, text, *columns, numeral=Real(), hold=False):  # noqa: B008 - frozen
    wanted = [Wanted(column, numeral, hold) for column in columns]
    return open_table(written(folder, text)).read(wanted)


def rows(count, note=""):
    note = f'"note": "{note}", ' if note else ""
    wheels = ((k, f'"left.position": {k}, "right": {{"position": {2 * k}}}') for k in range(count))
    return [f'{{"time": {k * 0.02!r}, {note}{both}}}' for k, both in wheels]


# ---------------------------------------------------------------------------- what is read


def test_a_log_has_the_default_columns_of_csv(folder):
    log = tr.read_log(written(folder, "\n".join(rows(20)) + "\n"), DRIVE)
    np.testing.assert_array_equal(log.wheels, [[k, 2 * k] for k in range(20)])
    np.testing.assert_array_equal(log.time_ns, np.arange(20) * 20_000_000)


@pytest.mark.parametrize("between", ["\n", "", " ", "\r\n", "\n\n", "\t"], ids=repr)
def test_objects_may_follow_each_other_with_anything_blank_between(folder, between):
    found = read(folder, between.join(rows(7)), "right.position")
    assert found.columns[0].tolist() == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]
    assert found.warnings == ()


def test_objects_without_line_breaks_are_read_piece_by_piece(folder, monkeypatch):
    monkeypatch.setattr(json_lines, "AT_ONCE", 64)
    text = "".join(rows(50))
    assert read(folder, text, "left.position").columns[0].tolist() == list(range(50))
    broken = text.replace('"left.position": 20,', '"left.position: 20,')
    found = read(folder, broken, "left.position")
    assert len(found.columns[0]) + found.rejected.total() >= 48
    assert found.rejected["parse"] > 0


def test_nested_values_have_dotted_names(folder):
    table = open_table(written(folder, '{"t": 1, "wheel": {"left": 2}, "pose": [3, 4, {"yaw": 5}]}\n'))
    assert table.names == ("t", "wheel.left", "pose.0", "pose.1", "pose.2.yaw")


@given(st.lists(st.floats(), min_size=1), st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1))
def test_every_number_comes_through(folder, reals, counts):
    text = "\n".join(json.dumps({"x": x}) for x in reals)
    np.testing.assert_array_equal(read(folder, text, "x").columns[0], reals)
    text = "\n".join(json.dumps({"n": n}) for n in counts)
    assert read(folder, text, "n", numeral=Count()).columns[0].tolist() == counts


def test_stamps_keep_every_nanosecond(folder):
    found = read(folder, '{"t": 1700000000.123456789}\n{"t": 1.7e9}\n', "t", numeral=Stamp())
    assert found.columns[0].tolist() == [1_700_000_000_123_456_789, 1_700_000_000_000_000_000]


def test_held_values_fill_what_is_missing(folder):
    text = '{"t": 1}\n{"t": 2, "a": 5}\n{"t": 3}\n{"t": 4, "a": null}\n{"t": 5, "a": 6}\n'
    found = read(folder, text, "a", hold=True)
    assert found.columns[0].tolist() == [5, 5, 5, 6]
    assert found.rejected == {"parse": 1}


# ------------------------------------------------------------------------- what is refused

BAD = {
    "word": ('{"x": "5"}', "'x' is '5', no number"),
    "true": ('{"x": true}', "'x' is 'True', no number"),
    "missing": ('{"y": 1}', "'x' is missing"),
    "null": ('{"x": null}', "'x' is missing"),
    "array": ('{"x": []}', "'x' is"),
    "twice": ('{"x": 1, "x": 2}', "'x' stands there twice"),
    "twice nested": ('{"x.y": 1, "x": {"y": 2}}', "'x.y' stands there twice"),
    "cut": ('{"x": 1', "is no JSON object"),
    "comma": ('{"x": 1,}', "is no JSON object"),
    "hexadecimal": ('{"x": 0x10}', "is no JSON object"),
    "plus": ('{"x": +1}', "is no JSON object"),
    "leading zero": ('{"x": 01}', "is no JSON object"),
    "single quotes": ("{'x': 1}", "is no JSON object"),
    "comment": ('// {"x": 1}', "is no JSON object"),
    "no object": ("17", "'17' is no object"),
    "array of objects": ('[{"x": 1}]', "an array is no object"),
    "infinite count": ('{"x": 1e999}', "'x' is 1e999"),
    "endless number": ('{"x": ' + "1" * 2000 + "}", "no number"),
    "deep": ('{"x": ' + "[" * 3000 + "]" * 3000 + "}", "is no JSON object"),
    "many": (json.dumps({str(k): k for k in range(2000)}), "an object of more than 1000 values"),
    "no UTF-8": (b'{"x\xff": 1}', "'x' is missing"),
    "full-width digits": ('{"x": \uff11}', "is no JSON object"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_row_is_counted_and_named(folder, name):
    bad, words = BAD[name]
    bad = bad if isinstance(bad, bytes) else bad.encode()
    numeral = Stamp() if "count" in name else Real()
    found = read(folder, b'{"x": 1}\n' + bad + b'\n{"x": 3}\n', "x", numeral=numeral)
    assert len(found.columns[0]) == 2
    assert found.rejected.total() == 1
    assert "line 2: " in found.warnings[0]
    assert words in found.warnings[0]


def test_a_file_without_a_row_says_why(folder):
    with pytest.raises(LogSchema, match=r"2 of 2 objects hold no numbers: line 1: 'x' is 'a'"):
        read(folder, '{"x": "a"}\n{"x": "b"}\n', "x")
    with pytest.raises(LogSchema, match=r"no column 'lift.position'; did you mean 'left.position'"):
        read(folder, "\n".join(rows(3)), "lift.position")
    with pytest.raises(LogSchema, match="declare the unit of the time"):
        read(folder, '{"t": 1700000000123456789}\n', "t", numeral=Stamp())


def test_an_endless_object_is_refused(folder, monkeypatch):
    monkeypatch.setattr(json_lines, "AT_ONCE", 1000)
    monkeypatch.setattr(json_lines, "LONGEST_OBJECT", 5000)
    with pytest.raises(LogLimit, match="more than 5000 characters"):
        read(folder, '{"x": 1}\n{"y": "' + "a" * 20_000, "x")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[\n  {"time": 1}]', "is a JSON array, must be JSON lines: .* jq -c"),
        ("{" * 10, "line 1: '{{{{{{{{{{' is no JSON object; must hold objects of one line each"),
        ('{\n  "time": 1\n}\n', "line 1: '{.*jq -c"),
        ("{}\n", "line 1: an empty object"),
        ('{"time": \x001, "left.position": 1, "right.position": 2}\n', "is no JSON object"),
        ('{"time": 1}'.encode("utf-16"), "is JSON in UTF-16"),
    ],
    ids=["array", "braces", "several lines", "nothing inside", "NUL", "UTF-16"],
)
def test_what_is_nearly_json_lines_is_an_error_of_ours(folder, text, words):
    with pytest.raises(LogError, match=words):
        tr.read_log(written(folder, text), DRIVE)


def test_a_byte_order_mark_does_not_matter(folder):
    text = b"\xef\xbb\xbf" + "\n".join(rows(4)).encode()
    assert len(tr.read_log(written(folder, text), DRIVE)) == 4


# -------------------------------------------------------------------------------- damage


def whole_rows(content):
    """How many of the rows that `rows` makes end within the content."""
    return sum(line.count(b"}}") == 1 for line in content.split(b"\n"))


def check_cut(path, content):
    path.write_bytes(content)
    whole = whole_rows(content)
    if not whole:
        with pytest.raises(LogError):
            tr.read_log(path, DRIVE)
        return
    torn = bool(content.rpartition(b"\n")[2]) and not content.endswith(b"}}")
    if torn:
        with pytest.raises(tr.LogTruncated, match=f"ends at byte {len(content)}, inside line {whole + 1}"):
            tr.read_log(path, DRIVE)
    log = tr.read_log(path, DRIVE, salvage=torn)
    assert len(log) == whole
    np.testing.assert_array_equal(log.wheels, [[k, 2 * k] for k in range(whole)])
    assert log.rejected == ({"unfinished": 1} if torn else {})
    assert bool(log.warnings) == bool(log.losses) == torn


def test_a_cut_log_loses_no_object_that_ends(folder):
    content = ("\n".join(rows(200)) + "\n").encode()
    for at in random.Random(3).sample(range(len(content)), 60):
        check_cut(folder / "cut.jsonl", content[:at])


@pytest.mark.verify
def test_cut_at_every_byte(folder):
    content = ("\n".join(rows(100, note="a" * 430)) + "\n").encode()
    assert len(content) > 49_000
    for at in range(len(content)):
        check_cut(folder / "cut.jsonl", content[:at])


def flipped(content, bit):
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def check_flip(path, content, bit):
    """What the grammar can tell is told: no row but the one that was hit changes, and none goes silently."""
    path.write_bytes(flipped(content, bit))
    try:
        log = tr.read_log(path, DRIVE, sort=True)
    except LogError:
        return
    whole = [[k, 2 * k] for k in range(40)]
    assert len(log) + sum(log.rejected.values()) >= 39
    assert (len(log) == 40) or log.rejected
    kept = {tuple(row) for row in log.wheels.tolist()}
    assert sum(tuple(row) not in kept for row in whole) <= 2  # two, where the line between them was hit


def test_flips_cost_the_row_that_they_hit(folder):
    content = ("\n".join(rows(40)) + "\n").encode()
    for bit in random.Random(4).sample(range(8 * len(content)), 150):
        check_flip(folder / "flip.jsonl", content, bit)


@pytest.mark.verify
def test_ten_thousand_flips(folder):
    content = ("\n".join(rows(40)) + "\n").encode()
    for bit in random.Random(5).sample(range(8 * len(content)), 10_000):
        check_flip(folder / "flip.jsonl", content, bit)


# ---------------------------------------------------------------------------- rows that add up


def test_rows_may_say_how_long_they_took(folder):
    """Speeds are then means over the row: the way is their sum, however uneven the rows."""
    text = "".join(
        f'{{"T": {t}, "l": {w}, "r": {w}}}' for t, w in [(0.02, 9.0), (0.03, 1.0), (0.01, 2.0), (0.02, 4.0)]
    )
    wheels = {name: WheelMapping(column=name[0], unit=Unit.RAD_S) for name in ("left", "right")}
    mapping = LogMapping(time=TimeMapping(column="T", kind=Kind.INCREMENT), wheels=wheels)
    log = tr.read_log(written(folder, text), DRIVE, mapping=mapping)
    assert log.time_ns.tolist() == [20_000_000, 50_000_000, 60_000_000, 80_000_000]
    assert tr.integrate(DRIVE, log).distance == pytest.approx(0.04 * (0.03 + 0.02 + 0.08))


# --------------------------------------------------------------------------------- faults


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        pytest.param('{"x": "abc"}', "no number", id="L9-word"),
        pytest.param('{"x": " "}', "no number", id="L9-blank"),
        pytest.param('{"x": 1_000}', "no JSON object", id="L9-underscore"),
        pytest.param('{"x": \uff11}', "no JSON object", id="L9-full-width"),
        pytest.param('{"y": 1}', "missing", id="L10-ragged"),
        pytest.param('{"x": \x001}', "no JSON object", id="L10-nul"),
        pytest.param('{"x: 1}', "no JSON object", id="L10-quote"),
        pytest.param('{"x": 1,5}', "no JSON object", id="L11-decimal-comma"),
    ],
)
def test_fault(folder, bad, words):
    found = read(folder, f'{{"x": 1}}\n{bad}\n{{"x": 3}}\n', "x")
    assert found.columns[0].tolist() == [1.0, 3.0]
    assert dict(found.rejected) == {"parse": 1}
    assert found.warnings[0].startswith("1 object was left out as unreadable: line 2: ")
    assert words in found.warnings[0]
