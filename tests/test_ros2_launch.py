"""`trundle ros2` where there is no rclpy: an error that says how to get it, and nothing heavy before."""

from __future__ import annotations

import importlib

import pytest

from trundle import MissingExtra
from trundle.apps.cli import main
from trundle.apps.ros2.installation import message_type, require_rclpy


@pytest.fixture
def without_rclpy(monkeypatch):
    """No rclpy, whatever is installed here."""
    real = importlib.import_module

    def load(name, package=None):
        if name.partition(".")[0] == "rclpy":
            raise ModuleNotFoundError(f"No module named {name!r}", name="rclpy")
        return real(name, package)

    monkeypatch.setattr(importlib, "import_module", load)


def test_without_rclpy_the_command_says_how_to_get_it(without_rclpy, checkout, capsys):
    assert main(["ros2", "--robot", str(checkout / "examples" / "differential" / "robot.yaml")]) == 5
    words = capsys.readouterr().err
    assert words.startswith("trundle: rclpy is not installed; get it with: pip install 'trundle[ros2]'")
    assert "source /opt/ros/" in words
    assert "Traceback" not in words


def test_a_robot_that_is_none_is_refused_first(without_rclpy, tmp_path, capsys):
    description = tmp_path / "robot.yaml"
    description.write_text("drive: {type: differential, track_width: -1, wheel_radius: 0.05}")
    assert main(["ros2", "--robot", str(description)]) == 2
    assert "drive.track_width" in capsys.readouterr().err


def test_an_installation_that_fails_says_why(monkeypatch):
    """A sourced ROS whose Python is another one."""

    def load(name, package=None):
        raise ImportError("_rclpy_pybind11.cpython-312-x86_64-linux-gnu.so: not found")

    monkeypatch.setattr(importlib, "import_module", load)
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    with pytest.raises(MissingExtra, match="cpython-312") as caught:
        require_rclpy()
    assert caught.value.extra == "ros2"
    assert "ROS_DISTRO is jazzy" in str(caught.value)


def test_what_only_some_installations_have():
    assert message_type("trundle_no_such_msgs.msg", "TFMessage") is None
    assert message_type("trundle.errors", "MissingExtra") is MissingExtra
