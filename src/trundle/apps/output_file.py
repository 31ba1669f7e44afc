"""Where results may be written to, asked before the work is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from trundle.errors import InputError, OutputError

if TYPE_CHECKING:
    from trundle.robot import Robot

__all__ = ["check_output", "files_of", "write_text"]


def check_output(path: Path, *, suffixes: Sequence[str], inputs: Sequence[Path], force: bool) -> None:
    """Refuse what could not be written in the end, or should not be.

    Args:
        path: Where a result shall stand.
        suffixes: What its name may end in.
        inputs: Files and folders that it is made from; nothing replaces them, `force` neither.
        force: Replace a file that exists.

    Raises:
        InputError: If the suffix is another one, the file is an input or lies in one, or exists and `force`
            is not given.
        OutputError: If it is a folder, or its own folder does not exist.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder, must be a file or a new name")
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{path}: an output here must end in one of {', '.join(suffixes)}")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}")
    if path.exists() and any(one.exists() and path.samefile(one) for one in inputs):
        raise InputError(f"{path}: is the input itself, must be another file; --force does not replace it")
    if folder := next((one for one in inputs if one.is_dir() and _lies_in(path, one)), None):
        raise InputError(f"{path}: lies in the input {folder}, must stand elsewhere; --force does not help")
    if path.exists() and not force:
        raise InputError(f"{path}: exists; --force replaces it")


def write_text(path: Path, text: str) -> None:
    """Write what other programs read: the complete new file, or the old one untouched."""
    from trundle.adapters.atomic import atomic_path

    with atomic_path(path, force=True) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def files_of(log: Path, robot: Robot) -> list[Path]:
    """A log, and the file beside it that holds its reference, where the robot's description names one."""
    reference = robot.log.reference
    return [log] if reference is None or reference.file is None else [log, log.parent / reference.file]


def _lies_in(path: Path, folder: Path) -> bool:
    return path.resolve().is_relative_to(folder.resolve())
