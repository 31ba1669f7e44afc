"""A file that describes a robot, as bytes: never more of it than a description can be."""

from __future__ import annotations

from pathlib import Path

from trundle.errors import ConfigError, require_path

__all__ = ["read_description"]

MOST_READ = (1 << 20) + 1  # one byte more than parsers allow, so that they see that it is too much


def read_description(path: str | Path) -> bytes:
    """Its first 1 MiB and a byte.

    Raises:
        ConfigError: If it cannot be read, or is a folder, a pipe or a device.
    """
    file = require_path(path)
    try:
        special = file.exists() and not file.is_file()
        raw = b"" if special else _beginning(file)
    except (OSError, ValueError) as error:
        problem = getattr(error, "strerror", None) or str(error)
        raise ConfigError("", f"cannot be read: {problem}", source=str(path)) from None
    if special:
        raise ConfigError("", "is not a file; a description of a robot is wanted", source=str(path))
    return raw


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MOST_READ)
