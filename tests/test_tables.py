"""Tables of numbers: what is read of them, and what is refused."""

from __future__ import annotations

import codecs
import math
import os
import re
import sys
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle.adapters import text_table
from trundle.adapters.content import Content, content_of
from trundle.adapters.numeral import Count, Real, Stamp
from trundle.adapters.table import Wanted, open_table
from trundle.errors import LogCorrupt, LogError, LogLimit, LogSchema, MissingExtra
from trundle.robot.log_mapping import TableFormat, Unit

BARE = TableFormat(header=False)
AB = [Wanted("a", Real()), Wanted("b", Real())]

# The grammar, said once more and in another way than the reader's.
NUMBER = re.compile(rb"[ \t]*[+-]?((\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|nan|inf|infinity)[ \t]*", re.IGNORECASE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("tables")


def write(folder: Path, content: bytes, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def read(path: Path, wanted=AB, table_format=None):
    return open_table(path, table_format).read(wanted)


# ------------------------------------------------------------------------- what is a number

PLAUSIBLE = st.text("0123456789.,+-eE _xnaifty\t\uff11", max_size=8)
CELLS = st.one_of(
    st.floats().map(repr),
    st.integers(-(2**70), 2**70).map(str),
    PLAUSIBLE,
    st.sampled_from(["", " ", "nan", "-Inf", "1_000", "0x1F", "1e", "true", "abc", "1\0", '"1"', '"1', "٣"]),
).map(str.encode)


@given(CELLS.filter(lambda cell: not set(cell) & set(b',"\0') and cell.strip()))
def test_a_number_is_what_the_grammar_says(folder, cell):
    path = write(folder, b"0\n0\n0\n" + cell + b"\n")
    rows = read(path, [Wanted(0, Real())], BARE)
    if NUMBER.fullmatch(cell):
        np.testing.assert_array_equal(rows.columns[0][3:], [float(cell)])
        assert not rows.rejected
    else:
        assert len(rows.columns[0]) == 3
        assert dict(rows.rejected) == {"parse": 1}
        assert "line 4: column 0 holds" in rows.warnings[0]


@given(st.lists(st.tuples(CELLS, CELLS, CELLS), min_size=1, max_size=12), st.sampled_from([",", ";", "\t"]))
def test_fast_and_strict_ways_agree(folder, cells, delimiter):
    pytest.importorskip("pyarrow")
    content = b"".join(delimiter.encode().join(row) + b"\n" for row in [(b"0", b"0", b"0")] * 3 + cells)
    path = write(folder, content)
    wanted = [Wanted(0, Stamp()), Wanted(1, Count(64)), Wanted(2, Real())]
    answers = []
    for threshold in (0, math.inf):
        for block in (16, 1 << 20):
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(text_table, "WORTH_PYARROW", threshold)
                patch.setattr(text_table, "BLOCK", block)
                try:
                    rows = read(path, wanted, TableFormat(header=False, delimiter=delimiter))
                except LogSchema as error:
                    answers.append(str(error))
                else:
                    columns = [(c.dtype, c.tobytes()) for c in rows.columns]
                    answers.append((columns, rows.rejected, rows.warnings))
    assert all(answer == answers[0] for answer in answers)


@pytest.mark.parametrize("threshold", [0, math.inf])
def test_counters_come_through_exactly(folder, monkeypatch, threshold):
    monkeypatch.setattr(text_table, "WORTH_PYARROW", threshold)
    counts = [2**63 - 1, -(2**63), 2**53 + 1, -7, 0]
    path = write(folder, "\n".join(map(str, ["a", *counts, ""])).encode())
    (column,) = read(path, [Wanted("a", Count())]).columns
    assert column.dtype == np.int64
    assert column.tolist() == counts


def test_unsigned_counters_of_64_bits_come_modulo_their_range(folder):
    path = write(folder, f"a\n{2**64 - 1}\n5\n{2**63}\n".encode())
    (column,) = read(path, [Wanted("a", Count(64))]).columns
    assert column.tolist() == [-1, 5, -(2**63)]
    assert dict(read(path, [Wanted("a", Count(32))]).rejected) == {"parse": 2}


def test_counts_are_whole_and_finite(folder):
    path = write(folder, b"a\n5\n7.0\n2e3\n1.5\n1962756423145470.875\nnan\ninf\n")
    rows = read(path, [Wanted("a", Count())])
    assert rows.columns[0].tolist() == [5, 7, 2000]
    assert dict(rows.rejected) == {"parse": 2, "nonfinite": 2}


@given(
    st.lists(st.integers(-(2**63) + 1, 2**63 - 1), min_size=1, max_size=5),
    st.sampled_from([(Unit.S, 9), (Unit.MS, 6), (Unit.US, 3), (Unit.NS, 0)]),
)
def test_stamps_keep_every_nanosecond(folder, times, unit):
    unit, exponent = unit
    cells = [format(Decimal(time).scaleb(-exponent), "f") for time in times]
    path = write(folder, "\n".join(["a", *cells, ""]).encode())
    (column,) = read(path, [Wanted("a", Stamp(unit))]).columns
    assert column.tolist() == times


def test_literal_nan_and_infinity_come_through(folder):
    rows = read(write(folder, b"a,b\nnan,1\n-inf,2\n3,Infinity\n"))
    np.testing.assert_array_equal(rows.columns[0], [math.nan, -math.inf, 3.0])
    assert not rows.rejected


# -------------------------------------------------------------------------------- dialects


def test_only_wanted_columns_need_be_numbers(folder):
    rows = read(write(folder, b"word,a,b\nx,1,2\n\xff,3,4\n"))
    np.testing.assert_array_equal(rows.columns, [[1, 3], [2, 4]])


@pytest.mark.parametrize(
    ("content", "table_format"),
    [
        (b"a,b\n1.5,2\n3,4\n", TableFormat()),
        (b"a;b\n1,5;2\n3;4\n", TableFormat(delimiter=";", decimal=",")),
        (b"  a   b \n 1.5  2\n3\t 4\n", TableFormat(delimiter=" ")),
        (b"a\tb\n1.5\t2\n3\t4\n", TableFormat(delimiter="\t")),
        (b"% note\n\na,b\n% a,b\n1.5,2\n   \n3,4\n", TableFormat(comment="%")),
        (b'"a","b"\n"1.5",2\n3," 4 "\n', TableFormat()),
        (b" a , b \n 1.5 , 2\n3,4\n", TableFormat()),
    ],
    ids=["csv", "german", "blanks", "tabs", "comments", "quoted", "spaced"],
)
def test_declared_dialects(folder, content, table_format):
    rows = read(write(folder, content), AB, table_format)
    np.testing.assert_array_equal(rows.columns, [[1.5, 3.0], [2.0, 4.0]])
    assert not rows.rejected


def test_held_values_fill_empty_cells(folder):
    path = write(folder, b"a,b\n1,\n2,5\n3,\n4,x\n5, \n6,8\n")
    rows = read(path, [Wanted("a", Real()), Wanted("b", Count(), hold=True)])
    np.testing.assert_array_equal(rows.columns, [[2, 3, 5, 6], [5, 5, 5, 8]])
    assert dict(rows.rejected) == {"parse": 2}  # the first row, which has no value yet, and the x


def test_columns_without_names_are_numbers(folder):
    table = open_table(write(folder, b"1,2,3\n4,5,6\n"), BARE)
    assert table.names == (0, 1, 2)
    np.testing.assert_array_equal(
        table.read([Wanted(2, Real()), Wanted(0, Real())]).columns, [[3, 6], [1, 4]]
    )


def test_lines_are_numbered_across_blocks(folder, monkeypatch):
    monkeypatch.setattr(text_table, "BLOCK", 64)
    lines = ["# note", "a,b", *(f"{k},{k}" for k in range(300))]
    lines[217] = "x,1"
    rows = read(write(folder, "\n".join([*lines, ""]).encode()))
    assert len(rows.columns[0]) == 299
    assert "line 218: column 'a' holds 'x'" in rows.warnings[0]


# --------------------------------------------------------------------------------- Parquet


@pytest.fixture
def parquet(folder):
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    def write_table(**columns) -> Path:
        path = folder / "table.parquet"
        parquet.write_table(pa.table(columns), path)
        return path

    return write_table


def test_parquet_keeps_types_and_loses_missing_rows(parquet):
    path = parquet(t=[0.5, 1.0, 1.5], a=[2**62 + 1, None, -5], b=[1.0, 2.0, math.nan])
    rows = read(path, [Wanted("t", Stamp()), Wanted("a", Count()), Wanted("b", Real())])
    assert [column.tolist() for column in rows.columns[:2]] == [[500_000_000, 1_500_000_000], [2**62 + 1, -5]]
    np.testing.assert_array_equal(rows.columns[2], [1.0, math.nan])
    assert dict(rows.rejected) == {"parse": 1}
    assert "rows 1" in rows.warnings[0]


def test_parquet_holds_values_and_reads_timestamps(parquet):
    stamps = np.array([1, 2, 3], dtype="datetime64[us]")
    path = parquet(t=stamps, a=[7, None, 9])
    rows = read(path, [Wanted("t", Stamp(Unit.S)), Wanted("a", Count(), hold=True)])
    assert [column.tolist() for column in rows.columns] == [[1000, 2000, 3000], [7, 7, 9]]


def test_parquet_asks_for_its_extra(parquet, monkeypatch):
    path = parquet(a=[1.0], b=[2.0])
    for name in ("pyarrow", "pyarrow.parquet"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingExtra, match=r"trundle\[parquet\]"):
        read(path)


def test_big_tables_do_without_pyarrow(folder, monkeypatch):
    monkeypatch.setattr(text_table, "WORTH_PYARROW", 0)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    np.testing.assert_array_equal(read(write(folder, b"a,b\n1,2\n3,4\n")).columns, [[1, 3], [2, 4]])


# ---------------------------------------------------------------------------------- faults

PIPE, FOLDER, NOTHING = object(), object(), object()


def refused(content, reason, *words, name="table.csv", table_format=None, wanted=AB):
    """A check that a file is refused for a reason, in words that help."""

    def check(folder: Path) -> None:
        path = folder / name
        if content is PIPE:
            os.mkfifo(path)
        elif content is FOLDER:
            path.mkdir()
        elif content is not NOTHING:
            path.write_bytes(content)
        with pytest.raises(LogError) as caught:
            read(path, wanted, table_format)
        assert caught.value.reason == reason
        assert all(word in str(caught.value) for word in (name, *words))

    return check


def survived(content, *words, rejected, table_format=None):
    """A check that rows (1, 2) and (5, 6) are read, and so many others counted and named."""

    def check(folder: Path) -> None:
        rows = read(write(folder, content), AB, table_format)
        np.testing.assert_array_equal(rows.columns, [[1.0, 5.0], [2.0, 6.0]])
        assert dict(rows.rejected) == ({"parse": rejected} if rejected else {})
        assert len(rows.warnings) == min(rejected, 1)
        assert all(word in rows.warnings[0] for word in words)

    return check


def ended(content, *, is_cut, table_format=None):
    """A check that row (1, 2) is read, and the one in which the file ends is left out and told of."""

    def check(folder: Path) -> None:
        rows = read(write(folder, content), AB, table_format)
        np.testing.assert_array_equal(rows.columns, [[1.0], [2.0]])
        assert dict(rows.rejected) == {"unfinished": 1}
        assert rows.ending.is_cut is is_cut
        assert f"ends at byte {len(content)}, {'inside' if is_cut else 'behind'} line 3" in rows.ending.loss

    return check


def parquet_with_a_name_of_no_text(folder: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = folder / "run.parquet"
    parquet.write_table(pa.table({"qqqqq": [1.0], "b": [2.0]}), path, store_schema=False)
    path.write_bytes(path.read_bytes().replace(b"qqqqq", b"\x92" * 5))
    with pytest.raises(LogCorrupt, match="is not whole as a Parquet file"):
        read(path, AB, None)


def parquet_flipped(folder: Path) -> None:
    """One bit in 79: none changes a number unnoticed."""
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = folder / "run.parquet"
    a, b = np.arange(100) * 0.02, np.sin(np.arange(100))
    parquet.write_table(pa.table({"a": a.tolist(), "b": b.tolist()}), path, write_page_checksum=True)
    whole, refused = path.read_bytes(), 0
    for bit in range(0, 8 * len(whole), 79):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        try:
            np.testing.assert_array_equal(read(path, AB, None).columns, [a, b])
        except LogError:
            refused += 1
    assert refused > 100


def junk(cell: str):
    content = f"a,b\n1,2\n3,{cell}\n5,6\n".encode()
    return survived(content, "line 3", "'b'", rejected=1)


FAULTS = {
    "L1-empty": refused(b"", "empty"),
    "L1-no-rows": refused(b"# only a note\n\n", "empty"),
    "L1-header-alone": refused(b"a,b\n", "empty"),
    "L1-folder": refused(FOLDER, "not_a_file"),
    "L1-pipe": refused(PIPE, "not_a_file"),
    "L1-missing": refused(NOTHING, "not_a_file", "no such file"),
    "L2-row": ended(b"a,b\n1,2\n3", is_cut=True),
    "L2-sign": ended(b"a,b\n1,2\n3,-", is_cut=True),
    "L2-quote": ended(b'a,b\n1,2\n"3","4', is_cut=True),
    "L2-nul": ended(b"a,b\n1,2\n3,4\0", is_cut=True),
    "L2-utf8": ended("a,b\n1,2\n3,\uff14".encode()[:-1], is_cut=True),
    "L2-utf16": ended("a,b\n1,2\n3,4\n".encode("utf-16")[:-1], is_cut=True),
    "L2-perhaps": ended(b"a,b\n1,2\n3,4", is_cut=False),
    "L2-perhaps-utf16": ended("a,b\n1,2\n3,4".encode("utf-16"), is_cut=False),
    "L2-not": survived(b"a,b\n1,2\n5,6\n# the end", rejected=0),
    "L2-not-dos": survived(b"a,b\r\n1,2\r\n5,6\r\n\x1a", rejected=0),
    "L3-parquet": parquet_flipped,
    "L7-parquet-name": parquet_with_a_name_of_no_text,
    "L7-text-as-parquet": refused(b"a,b\n1,2\n", "format", "Parquet", name="table.parquet"),
    "L7-text-as-mcap": refused(b"a,b\n1,2\n", "format", "MCAP", name="run.mcap"),
    "L7-unknown-bytes": refused(bytes(range(256)), "format", "known: text table, Parquet"),
    "L7-recording-as-table": refused(b"\x89MCAP0\r\n" + bytes(99), "format", "is MCAP"),
    "L8-missing-column": refused(b"time,alpha,b\n1,2,3\n", "column", "'a'", "time, alpha, b"),
    "L8-nearest": refused(
        b"time,lefft,b\n1,2,3\n", "column", "mean 'lefft'", wanted=[Wanted("left", Real())]
    ),
    "L8-twice": refused(b"a,b,a\n1,2,3\n", "column", "[0, 2] are all named 'a'"),
    "L8-number": refused(
        b"1,2\n3,4\n", "column", "no column 7", table_format=BARE, wanted=[Wanted(7, Real())]
    ),
    "L9-word": junk("abc"),
    "L9-blank": junk(" "),
    "L9-nothing": junk(""),
    "L9-full-width": junk("\uff11\uff12"),
    "L9-arabic": junk("\u0663"),
    "L9-underscore": junk("1_000"),
    "L9-hexadecimal": junk("0x1F"),
    "L9-truth": junk("True"),
    "L10-ragged": survived(
        b"a,b\n1,2\n3\n4,4,4\n5,6\n", "line 3", "1 cells instead of 2", "line 4", rejected=2
    ),
    "L10-nul": survived(b"a,b\n1,2\n3,\x004\n5,6\n", "line 3", rejected=1),
    "L10-mark": survived(codecs.BOM_UTF8 + b"a,b\n1,2\n5,6\n", rejected=0),
    "L10-crlf": survived(b"a,b\r\n1,2\r\n\r\n5,6\r\n", rejected=0),
    "L10-utf16-little": survived(codecs.BOM_UTF16_LE + "a,b\n1,2\n5,6\n".encode("utf-16-le"), rejected=0),
    "L10-utf16-big": survived(codecs.BOM_UTF16_BE + "a,b\n1,2\n5,6\n".encode("utf-16-be"), rejected=0),
    "L10-quote": survived(b'a,b\n1,2\n"3,4\n5,6\n', "line 3", "quote", rejected=1),
    "L10-utf16-unmarked": refused("a,b\n1,2\n".encode("utf-16-le"), "encoding", "UTF-8"),
    "L10-utf32": refused("a,b\n1,2\n".encode("utf-32"), "encoding", "UTF-32"),
    "L10-cr-alone": refused(b"a,b\r1,2\r", "encoding", "CR alone"),
    "L10-latin1": refused(b"a\xb0,b\n1,2\n", "encoding", "line 1"),
    "L11-semicolons": refused(b"a;b\n1;2\n3;4\n", "column", "delimited by", "log.table.delimiter"),
    "L11-tabs": refused(b"a\tb\n1\t2\n", "column", "log.table.delimiter"),
    "L11-blanks": refused(b"a b\n1  2\n", "column", "log.table.delimiter"),
    "L11-german": refused(b"a;b\n1,5;2,5\n", "column", "log.table.delimiter"),
    "L11-decimal-comma": refused(
        b"a;b\n1;2\n1,5;2\n", "parse", "log.table.decimal: ','", table_format=TableFormat(delimiter=";")
    ),
    "L11-decimal-point": refused(
        b"a;b\n1.5;2\n",
        "parse",
        "log.table.decimal: '.'",
        table_format=TableFormat(delimiter=";", decimal=","),
    ),
    "L11-no-header": refused(b"1,2\n3,4\n", "column", "log.table.header: false"),
}


@pytest.mark.parametrize("check", [pytest.param(check, id=row) for row, check in FAULTS.items()])
def test_fault(tmp_path, check):
    check(tmp_path)


def test_content_counts_and_not_the_name(parquet):
    path = parquet(a=[1.0], b=[2.0])
    path = path.replace(path.with_name("renamed.csv"))
    assert content_of(path) is Content.PARQUET
    np.testing.assert_array_equal(read(path).columns, [[1.0], [2.0]])


def test_cut_parquet_is_corrupt(parquet):
    path = parquet(a=[1.0], b=[2.0])
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(LogCorrupt):
        read(path)


@pytest.mark.parametrize("values", [["x"], [True], [[1.0]]], ids=["words", "truths", "lists"])
def test_parquet_columns_must_be_numbers(parquet, values):
    with pytest.raises(LogSchema, match="must be numbers"):
        read(parquet(a=values, b=[2.0]))


def test_endless_line_is_refused(folder, monkeypatch):
    monkeypatch.setattr(text_table, "LONGEST_LINE", 1000)
    monkeypatch.setattr(text_table, "BLOCK", 100)
    with pytest.raises(LogLimit):
        read(write(folder, b"a,b\n" + b"1" * 5000))
