"""Logs read in pieces: the rows, the warnings and the refusals of the whole."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import pytest

import trundle as tr
from trundle.adapters.log import read_log_pieces
from trundle.adapters.text_table import TextTable
from trundle.adapters.trajectory_pieces import write_trajectory_pieces
from trundle.apps.cli import main
from trundle.odometry.integrate import integrate_pieces

DRIVE = tr.Differential(track_width=0.2, wheel_radius=0.04)
TABLES = {
    "positions": ("time,left.position,right.position", lambda k: f"{k * 0.02:.2f},{0.1 * k!r},{0.11 * k!r}"),
    "ticks": ("time_ns,left.ticks,right.ticks", lambda k: f"{k * 20_000_000},{k % 256},{3 * k % 256}"),
}


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch):
    """Pieces of some hundred rows instead of a quarter of a million."""
    whole = TextTable.pieces
    monkeypatch.setattr("trundle.adapters.text_table.BLOCK", 1500)
    monkeypatch.setattr(TextTable, "pieces", lambda self, wanted: whole(self, wanted, 200))


def written(path, name, count, change=lambda rows: rows):
    header, row = TABLES[name]
    path.write_text("\n".join([header, *change([row(k) for k in range(count)])]) + "\n")
    return path


def robot():
    return tr.Robot(
        drive=DRIVE, encoders=dict.fromkeys(DRIVE.wheel_names, tr.Encoder(ticks_per_revolution=256, bits=8))
    )


def check(path):
    whole, pieces = tr.read_log(path, robot()), list(read_log_pieces(path, robot()))
    assert len(pieces) > 4
    for column in ("time_ns", "wheels"):
        joined = np.concatenate([getattr(piece, column) for piece in pieces])
        assert joined.tobytes() == getattr(whole, column).tobytes()
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


@pytest.mark.parametrize("row", [pytest.param("L15", id="L15-command")])
def test_fault(row, tmp_path, monkeypatch, capsys):
    """The command writes and says the same of a long log, which it never holds as a whole."""
    path = written(
        tmp_path / "log.csv", "positions", 3000, lambda rows: [*rows[:1000], "oops,1,2", *rows[1000:]]
    )
    (tmp_path / "robot.yaml").write_text(
        "drive: {type: differential, track_width: 0.2, wheel_radius: 0.04}\n"
    )
    said = []
    for long in (1 << 30, 1):
        monkeypatch.setattr("trundle.adapters.log.LONG", long)
        words = ["track", str(path), "--robot", str(tmp_path / "robot.yaml"), "-o", str(tmp_path / "out.csv")]
        assert main([*words, "--force"]) == 0
        said.append(((tmp_path / "out.csv").read_bytes(), capsys.readouterr()))
        monkeypatch.setattr("trundle.adapters.log.read_log", None)
    assert said[0] == said[1]
