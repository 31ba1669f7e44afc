"""The example: a real donkeycar `Vehicle` records a path with our parts, and follows it."""

from __future__ import annotations

import importlib.util
import logging

import pytest

pytest.importorskip("donkeycar", reason="donkeycar lives in .envs/donkeycar")


@pytest.fixture
def example(checkout, monkeypatch):
    file = checkout / "examples" / "donkeycar" / "follow_path.py"
    spec = importlib.util.spec_from_file_location("follow_path", file)
    module = importlib.util.module_from_spec(spec)
    with monkeypatch.context() as patch:
        patch.setattr("builtins.print", lambda *_, **__: None)  # donkeycar greets whoever imports it
        spec.loader.exec_module(module)
    return module


def test_car_follows_the_path_that_it_recorded(example, tmp_path, capsys):
    logging.disable(logging.INFO)  # donkeycar logs each step
    try:
        off = example.main(tmp_path)
    finally:
        logging.disable(logging.NOTSET)
    (rms, most), (donkeycars_rms, _) = off[False], off[True]
    assert rms < 0.05
    assert most < 0.10
    assert donkeycars_rms > 2.0 * rms  # D1: its pose is of no point of the car
    assert "Trundle's Bicycle" in capsys.readouterr().out
