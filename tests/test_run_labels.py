"""What a command line says of single logs."""

from __future__ import annotations

from pathlib import Path

import pytest

from trundle.apps.run_labels import labels
from trundle.errors import InputError

LOGS = [Path("hall/roll.csv"), Path("hall/spin.csv"), Path("yard/roll.csv")]


@pytest.mark.parametrize(
    ("words", "logs", "said"),
    [
        (["2m"], LOGS[:1], {0: "2m"}),
        (["all=2m"], LOGS, {0: "2m", 1: "2m", 2: "2m"}),
        (["spin=5"], LOGS, {1: "5"}),
        (["spin.csv=5", "hall/roll.csv=2"], LOGS, {0: "2", 1: "5"}),
        (["a.tum", "b.tum", "c=d.tum"], LOGS, {0: "a.tum", 1: "b.tum", 2: "c=d.tum"}),
        ([], LOGS, {}),
    ],
)
def test_who_is_meant(words, logs, said):
    in_order = len(words) == len(logs) > 1
    assert labels("--option", words, logs, in_order=in_order) == said


def test_a_name_may_hold_an_equals_sign():
    logs = [Path("v=1.csv"), Path("v=2.csv")]
    assert labels("--rolled", ["v=2.csv=3 m"], logs) == {1: "3 m"}


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["2m"], r"--rolled: of which of the 3 logs\? Say --rolled LOG=\.\.\., or all="),
        (["spni.csv=2m"], r"--rolled spni\.csv: no such log; did you mean 'spin\.csv'\?"),
        (["roll=2m"], r"--rolled roll: 2 logs have this name; give the whole path"),
        (["spin=2m", "all=3m"], r"--rolled all=3m: spin\.csv is spoken of twice"),
    ],
)
def test_what_cannot_be_meant(words, complaint):
    with pytest.raises(InputError, match=complaint):
        labels("--rolled", words, LOGS)
