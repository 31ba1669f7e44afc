"""The examples of the two classics run, and print what the classics compute."""

from __future__ import annotations

import runpy


def printed_by(script, capsys):
    runpy.run_path(str(script), run_name="__main__")
    return capsys.readouterr().out


def test_skid_steer_cmd_vel(checkout, capsys):
    out = printed_by(checkout / "examples" / "skid_steer_cmd_vel.py", capsys)
    assert "left 0.690 m/s, right 0.910 m/s" in out  # w = 0.4 rad/s, B/2 = 0.275 m
    assert "TIMEOUT" in out


def test_turtlebot_icc(checkout, capsys):
    out = printed_by(checkout / "examples" / "turtlebot_icc.py", capsys)
    assert "+0.400" in out  # R = 0.16/2 (6 + 4) / (6 - 4)
    assert "v_gx 0.1429, v_gy 0.0825" in out
