"""The examples of unicycle control and of Road Runner's localizer run, and print what the sources compute."""

from __future__ import annotations

import re
import runpy


def printed_by(script, capsys):
    runpy.run_path(str(script), run_name="__main__")
    return capsys.readouterr().out


def test_unicycle_goal(checkout, capsys):
    out = printed_by(checkout / "examples" / "unicycle_goal.py", capsys)
    assert "v_r = 12.000 rad/s, v_l = 5.143 rad/s" in out  # (2 V +- omega L) / 2R
    assert "omega = +0.698 rad/s" in out  # 2 /s times 20 degrees
    assert "omega = +0.684 rad/s" in out  # 0.3 sin(20 degrees) / 0.15
    assert out.count(": arrived after") == 2


def test_road_runner_tracking(checkout, capsys):
    out = printed_by(checkout / "examples" / "road_runner_tracking.py", capsys)
    assert "8.070 degrees" in out  # (12 - 10) / 14.2 rad
    figures = re.findall(r"arrived; at most ([\d.]+) cm and ([\d.]+) degrees", out)
    assert len(figures) == 2
    for centimetres, degrees in figures:
        assert float(centimetres) < 2.0
        assert float(degrees) < 2.0
