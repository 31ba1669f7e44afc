"""Files that stay as they are while they are read."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import NamedTuple

from trundle.errors import LogError

__all__ = ["SteadyFile"]


class _Look(NamedTuple):
    """What tells one content of a file from another without reading it.

    The time of the last status change cannot be set by anyone, unlike that of the last modification.
    """

    device: int
    inode: int
    size: int
    modified_ns: int
    changed_ns: int


class SteadyFile:
    """A file, or the files of a folder, as they are when this is made.

    Attributes:
        path: The file or folder.

    Raises:
        LogError: `not_a_file` if there is none, `unreadable` if the system cannot say.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._looks = _looks(path)
        except FileNotFoundError:
            raise LogError(path, "not_a_file", "no such file") from None
        except (OSError, ValueError) as error:
            raise LogError(path, "unreadable", f"cannot be read: {error}") from error

    @property
    def difference(self) -> str:
        """What is otherwise by now, as the end of a sentence; empty where nothing is."""
        try:
            now = _looks(self.path)
        except FileNotFoundError:
            return "vanished while it was read"
        except OSError as error:
            return f"became unreadable while it was read: {error.strerror or error}"
        for path, look in self._looks.items():
            name = "" if path == self.path else f"{path.name} "
            if path not in now:
                return f"{name}vanished while it was read"
            if now[path].inode != look.inode or now[path].device != look.device:
                return f"{name}was replaced while it was read"
            if now[path].size != look.size:
                return f"{name}changed from {look.size} to {now[path].size} bytes while it was read"
            if now[path] != look:
                return f"{name}changed while it was read"
        return (
            f"{min(now.keys() - self._looks.keys()).name} came while it was read"
            if len(now) > len(self._looks)
            else ""
        )

    def require_same(self) -> None:
        """Refuse what was read from here, if it may be neither the old content nor the new one.

        Raises:
            LogError: `changed`.
        """
        if difference := self.difference:
            raise LogError(self.path, "changed", difference)


def _looks(path: Path) -> dict[Path, _Look]:
    about = path.stat()
    if not stat.S_ISDIR(about.st_mode):
        return {path: _Look(about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns)}
    return {
        file: look
        for child in sorted(path.iterdir())
        if child.is_file()
        for file, look in _looks(child).items()
    }
