"""Writing files so that a reader finds the old one or the complete new one, never a part."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
from collections.abc import Iterator
from pathlib import Path

from trundle.errors import OutputError, TrundleError

__all__ = ["atomic_path"]


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str], *, force: bool = False) -> Iterator[Path]:
    """A temporary path beside `path`, which takes its place when the block ends well.

    The new file is on the disk before it gets its name, so a crash, a signal or a full disk at any
    moment leaves the old file or the complete new one. On failure the temporary file is removed; only
    `kill -9` can leave it behind (`.trundle-*` in the same folder).

    Args:
        path: Where the result shall stand. A symbolic link is followed.
        force: Replace a file that exists. Without it an existing file is refused: a recording that is
            input and output at once, too.

    Yields:
        An empty file to write into, with the suffix of `path`.

    Raises:
        OutputError: If the file exists, or cannot be written (no space, no permission, no folder).
    """
    try:
        target = Path(os.path.realpath(path))
        _refuse_what_is_there(target, path, force)
        temporary = _create_beside(target)
        try:
            yield temporary
            _flush(temporary)
            _refuse_what_is_there(target, path, force)
            if target.exists():
                shutil.copymode(target, temporary)
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)
        _flush(target.parent)
    except TrundleError:
        raise
    except OSError as error:
        raise OutputError(f"{os.fspath(path)}: cannot be written: {error.strerror or error}") from error


def _refuse_what_is_there(target: Path, path: str | os.PathLike[str], force: bool) -> None:
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISREG(mode):
        raise OutputError(f"{os.fspath(path)}: is not a regular file, must be a file or a new name")
    if not force:
        raise OutputError(f"{os.fspath(path)}: exists; it is replaced with force=True (--force) only")


def _create_beside(target: Path) -> Path:
    """A new empty file in the same folder; its short name fits where a longer one would not."""
    temporary = target.with_name(f".trundle-{secrets.token_hex(8)}{target.suffix[:16]}")
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    return temporary


def _flush(path: Path) -> None:
    """Have a file's bytes, or a folder's names, on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:
        if not path.is_dir():  # some file systems cannot do this for folders
            raise
    finally:
        os.close(handle)
