"""Archives: what they hold, told by their lists of members. Nothing is ever unpacked onto a disk."""

from __future__ import annotations

import stat
from collections.abc import Iterable
from pathlib import Path, PurePosixPath, PureWindowsPath

from trundle.errors import LogCorrupt, LogError

__all__ = ["PACKED_MAGICS", "ZIP_MAGICS", "is_inside", "tar_names", "zip_names"]

PACKED_MAGICS = {
    b"\x1f\x8b": "gzip file",
    b"BZh": "bzip2 file",
    b"\xfd7zXZ\0": "xz file",
    b"7z\xbc\xaf\x27\x1c": "7-Zip archive",
    b"Rar!\x1a\x07": "RAR archive",
}
ZIP_MAGICS = (b"PK\x03\x04", b"PK\x05\x06")
TAR_MAGIC, TAR_MAGIC_AT = b"ustar", 257


def is_inside(name: str) -> bool:
    """Whether a path, read by the rules of POSIX or of Windows, stays below where it starts."""
    return all(
        not path.is_absolute() and not path.drive and ".." not in path.parts
        for path in (PurePosixPath(name), PureWindowsPath(name))
    )


def zip_names(path: Path) -> list[str]:
    """Names of the files in a zip archive.

    Raises:
        LogError: `unsafe_path` if one of them would be put elsewhere, or is a link.
        LogCorrupt: If it is no zip archive.
    """
    import zipfile

    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as error:
        raise LogCorrupt(path, "corrupt", f"is not whole as a zip archive: {error}") from error
    links = [member.filename for member in members if stat.S_ISLNK(member.external_attr >> 16)]
    return _safe(path, [name for member in members if not (name := member.filename).endswith("/")], links)


def tar_names(path: Path) -> list[str]:
    """Names of the files in a tar archive that is not compressed.

    Raises:
        LogError: `unsafe_path` if one of them would be put elsewhere, or is a link.
        LogCorrupt: If it is no tar archive.
    """
    import tarfile

    try:
        with tarfile.open(path, "r:") as archive:
            members = archive.getmembers()
    except (tarfile.TarError, ValueError, EOFError) as error:
        raise LogCorrupt(path, "corrupt", f"is not whole as a tar archive: {error}") from error
    links = [member.name for member in members if member.issym() or member.islnk()]
    return _safe(path, [member.name for member in members if not member.isdir()], links)


def _safe(path: Path, names: list[str], links: Iterable[str]) -> list[str]:
    for name in names:
        if not is_inside(name):
            raise LogError(path, "unsafe_path", f"its member {name!r} leaves the archive's own folder")
    for name in links:
        raise LogError(path, "unsafe_path", f"its member {name!r} is a link, must be a file")
    return names
