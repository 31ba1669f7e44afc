"""rclpy, wherever it comes from: a sourced ROS installation stands first on Python's path, then the extra."""

from __future__ import annotations

import importlib
import os
from typing import Any

from trundle.errors import MissingExtra

__all__ = ["message_type", "require_rclpy"]

_HINT = (
    "in an environment of its own (Linux on x86-64), or source a ROS 2 installation, whose Python must be "
    "this one: source /opt/ros/$ROS_DISTRO/setup.bash"
)


def require_rclpy() -> None:
    """Load rclpy.

    Raises:
        MissingExtra: If there is none, or none that works with this Python; it says how to get it.
    """
    for name in ("rclpy", "geometry_msgs.msg", "nav_msgs.msg", "sensor_msgs.msg", "std_srvs.srv"):
        try:
            importlib.import_module(name)
        except ImportError as error:
            package = name.partition(".")[0]
            found = isinstance(error, ModuleNotFoundError) and error.name == package
            sourced = os.environ.get("ROS_DISTRO")
            hint = _HINT if found else f"{_HINT}; it is here, but fails: {error}"
            if sourced:
                hint += f" (ROS_DISTRO is {sourced})"
            raise MissingExtra(package, "ros2", hint) from None


def message_type(module: str, name: str) -> Any:
    """A message type that an installation may lack, or None."""
    try:
        return getattr(importlib.import_module(module), name)
    except ImportError:
        return None
