"""What a file holds, by its first bytes; its name proves nothing."""

from __future__ import annotations

import codecs
import enum
import os
import re
import stat
from pathlib import Path

from trundle.errors import LogError, require_path

__all__ = ["KINDS_OF_LOG", "Content", "beginning_of", "content_of"]


class Content(enum.Enum):
    """Kinds of files that hold logs."""

    TEXT = "text table"
    PARQUET = "Parquet"
    MCAP = "MCAP"
    ROSBAG1 = "rosbag1"
    ROSBAG2 = "rosbag2"
    WPILOG = "WPILOG"
    JSON = "JSON lines"
    TUB = "donkeycar tub"
    NPZ = "NumPy archive"


KINDS_OF_LOG = ", ".join(content.value for content in Content)
"""All of them, as a sentence has room for them."""

_MAGIC = {
    b"PAR1": Content.PARQUET,
    b"\x89MCAP0\r\n": Content.MCAP,
    b"#ROSBAG V": Content.ROSBAG1,
    b"SQLite format 3\0": Content.ROSBAG2,
    b"WPILOG": Content.WPILOG,
    b"\x28\xb5\x2f\xfd": Content.ROSBAG2,  # zstd: a compressed file of a rosbag2 recording
}
_BINARY_SUFFIXES = {
    ".parquet": Content.PARQUET,
    ".mcap": Content.MCAP,
    ".bag": Content.ROSBAG1,
    ".db3": Content.ROSBAG2,
    ".wpilog": Content.WPILOG,
}
_ROSBAG2_PARTS = {".mcap", ".db3", ".zstd"}
_PICKLES = {".pickle", ".pkl", ".p", ".joblib"}
_TEXT_CONTROLS = b"\t\n\v\f\r\x1a\x1b"


def content_of(path: str | os.PathLike[str]) -> Content:
    """What kind of log a file (or the folder of a rosbag2 recording or a tub) is.

    Raises:
        LogError: With reason `not_a_file`, `unreadable`, `empty`, or, where the content is of no known
            kind or contradicts the file's suffix, `format`.
    """
    path = require_path(path)
    try:
        mode = path.stat().st_mode
        parts = list(path.iterdir()) if stat.S_ISDIR(mode) else []
        head = _head(path) if stat.S_ISREG(mode) else b""
    except FileNotFoundError:
        raise LogError(path, "not_a_file", "no such file") from None
    except OSError as error:
        raise LogError(path, "unreadable", f"cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a name with a NUL in it
        raise LogError(path, "not_a_file", str(error)) from error
    if stat.S_ISDIR(mode):
        return _folder(path, parts)
    if not stat.S_ISREG(mode):
        raise LogError(path, "not_a_file", "is a pipe or a device, must be a file")
    if not head:
        raise LogError(path, "empty", "holds no bytes")
    for magic, content in _MAGIC.items():
        # A file that ends within its first bytes is a truncated one, for its own reader to say so.
        if head.startswith(magic) or magic.startswith(head):
            return content
    return _archive(path, head) or _text(path, head)


def beginning_of(path: Path) -> bytes:
    """The first bytes of a file, without a byte order mark of UTF-8.

    Raises:
        LogError: If there is no such file, or it is empty or cannot be read.
    """
    content_of(path)
    return _head(path).removeprefix(codecs.BOM_UTF8) if path.is_file() else b""


def _archive(path: Path, head: bytes) -> Content | None:
    """NPZ; None for what is no archive and nothing that would have to be unpickled.

    Raises:
        LogError: For all others: `unsafe`, `unsafe_path`, or `format`.
    """
    from trundle.adapters import archive

    if head.startswith(archive.ZIP_MAGICS):
        names = archive.zip_names(path)
        if names and all(name.endswith(".npy") for name in names):
            return Content.NPZ
        raise _packed(path, "zip archive", names)
    if head[archive.TAR_MAGIC_AT :].startswith(archive.TAR_MAGIC):
        raise _packed(path, "tar archive", archive.tar_names(path))
    for magic, kind in archive.PACKED_MAGICS.items():
        if head.startswith(magic):
            raise _packed(path, kind, [])
    if head.startswith(b"\x93NUMPY"):
        from trundle.adapters.npz_table import npy_type

        kind = npy_type(path)
        raise LogError(
            path, "format", f"is one NumPy array of {kind}; numpy.savez(name=column, ...) keeps names"
        )
    pickled = head[:1] == b"\x80" and head[1:2] <= b"\x05" and path.stat().st_size > 2
    if pickled or path.suffix.lower() in _PICKLES:
        problem = "is a Python pickle: loading it runs whatever code it names"
        raise LogError(path, "unsafe", f"{problem}; save plain numbers, as CSV, Parquet or .npz")
    return None


def _packed(path: Path, kind: str, names: list[str]) -> LogError:
    held = f" of {', '.join(names[:5])}{', ...' if len(names) > 5 else ''}" if names else ""
    return LogError(path, "format", f"is a {kind}{held}: unpack it and name what is in it")


def _folder(path: Path, parts: list[Path]) -> Content:
    if any(part.name == "manifest.json" for part in parts):
        return Content.TUB
    if any(part.suffix in _ROSBAG2_PARTS for part in parts):
        return Content.ROSBAG2
    problem = "is a folder without a rosbag2 recording or a donkeycar tub, must be a file"
    raise LogError(path, "not_a_file", problem)


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(4096)


def _text(path: Path, head: bytes) -> Content:
    """TEXT or JSON, if the bytes can be text and the name does not promise something else."""
    promised = _BINARY_SUFFIXES.get(path.suffix.lower())
    if promised is not None:
        raise LogError(path, "format", f"its content is not {promised.value}, as its name says")
    if head.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):
        raise LogError(path, "encoding", "is UTF-32; save it as UTF-8")
    if b"\n" not in head and b"\r" in head[:-1]:
        raise LogError(path, "encoding", "its lines end with CR alone; save it with LF or CR LF")
    wide = head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    controls = sum(byte < 32 and byte not in _TEXT_CONTROLS for byte in head)
    if not wide and controls * (10 if _is_utf8(head) else 50) > len(head):
        if head[1::2].count(0) * 2 > len(head[1::2]) or head[::2].count(0) * 2 > len(head[::2]):
            raise LogError(path, "encoding", "looks like UTF-16 without a byte order mark; save it as UTF-8")
        raise LogError(path, "format", f"its content is not a known kind of log; known: {KINDS_OF_LOG}")
    return _json(path, head, wide=wide) or Content.TEXT


def _json(path: Path, head: bytes, *, wide: bool) -> Content | None:
    """JSON lines; None for what does not begin like JSON.

    Raises:
        LogError: For other JSON: `encoding`, or `format` of an array.
    """
    plain = head.decode("utf-16", "replace").encode() if wide else head.removeprefix(codecs.BOM_UTF8)
    plain = plain.lstrip()
    if re.match(rb"\[\s*\{", plain):
        raise LogError(
            path, "format", "is a JSON array, must be JSON lines: one object per line, as jq -c '.[]' makes"
        )
    if not plain.startswith(b"{"):
        return None
    if wide:
        raise LogError(path, "encoding", "is JSON in UTF-16; save it as UTF-8")
    return Content.JSON


def _is_utf8(head: bytes) -> bool:
    """Whether bytes can begin a UTF-8 text; its last character may be cut."""
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return False
    return True
