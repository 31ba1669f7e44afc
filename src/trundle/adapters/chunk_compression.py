"""Decompression that cannot be made to take more memory or time than it may."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

from trundle.adapters.damage import Damage
from trundle.errors import LogCorrupt, LogLimit, LogTruncated

__all__ = [
    "ZSTD_MAGIC",
    "compress",
    "decompress",
    "decompress_file",
    "decompress_frame",
    "require_archive_growth",
    "require_growth",
    "require_total_growth",
]

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

MOST_RATIO = 100  # to which a chunk may be compressed
ALWAYS_ALLOWED = 1 << 20  # bytes of a chunk, however well they were compressed
MOST_IN_CHUNK = 64 << 20  # bytes of a chunk
MOST_IN_TOTAL = 1 << 30  # bytes that are decompressed to read one topic, or
MOST_TOTAL_RATIO = 10  # times the size of a file that is itself large


def require_growth(source: object, what: object, stored: int, size: int) -> None:
    """Refuse a chunk that says of itself that it would grow beyond measure.

    Raises:
        LogLimit: If `size` is more than 100 times `stored` (chunks up to 1 MiB aside), or more than 64 MiB.
    """
    if size > ALWAYS_ALLOWED and (size > MOST_RATIO * stored or size > MOST_IN_CHUNK):
        raise LogLimit(
            source,
            "limit",
            f"{what} would grow from {stored} to {size} bytes; allowed are {MOST_RATIO} times as many, "
            f"and {MOST_IN_CHUNK >> 20} MiB",
        )


def require_total_growth(source: object, sizes: Iterable[int], file_size: int) -> None:
    """Refuse to decompress more for one topic than 1 GiB, or ten times the file where that is more.

    Raises:
        LogLimit: If the sizes add up to more.
    """
    total, most = sum(sizes), max(MOST_IN_TOTAL, MOST_TOTAL_RATIO * file_size)
    if total > most:
        raise LogLimit(source, "limit", f"would grow to {total >> 20} MiB; allowed are {most >> 20} MiB")


def require_archive_growth(source: object, size: int, file_size: int) -> None:
    """Refuse an archive that says that its members grow beyond measure.

    A column of zeros may well be a thousandth of itself when it is compressed; so small archives may grow to
    64 MiB, and larger ones to 100 times their size.

    Raises:
        LogLimit: If `size` is more, or more than `require_total_growth` allows.
    """
    most = max(MOST_IN_CHUNK, MOST_RATIO * file_size)
    if size > most:
        problem = f"would grow from {file_size} to {size} bytes; allowed are {most}"
        raise LogLimit(source, "limit", problem)
    require_total_growth(source, [size], file_size)


def compress(content: bytes, compression: str) -> bytes:
    """The bytes of a chunk.

    Args:
        content: What they grow to.
        compression: `zstd`.
    """
    assert compression == "zstd"  # the only one that we write
    stored: bytes = _zstd().compress(content)
    return stored


def decompress(stored: Any, compression: str, size: int, *, is_cut: bool = False) -> bytes:
    """The content of a chunk, never more of it than it says.

    Args:
        stored: Its bytes.
        compression: `zstd`, `lz4` or `bz2`.
        size: Bytes that it says it grows to.
        is_cut: Whether its end is missing, so that what there is will do.

    Raises:
        Damage: If it cannot be decompressed, or to another size.
    """
    decompressor, problems = _decompressor(compression)
    try:
        content: bytes = decompressor.decompress(stored, max_length=size + 1)
    except problems as problem:
        raise Damage(f"cannot be decompressed: {problem}") from None
    if not is_cut and (len(content) != size or not decompressor.eof):
        raise Damage(f"does not decompress to the {size} bytes that it says")
    return content


def decompress_frame(stored: bytes) -> bytes:
    """The content of a zstd frame that does not say beforehand how long it is.

    Raises:
        Damage: If it is no whole frame, or grows beyond measure.
    """
    decompressor, problems = _decompressor("zstd")
    most = min(max(ALWAYS_ALLOWED, MOST_RATIO * len(stored)), MOST_IN_CHUNK)
    try:
        content: bytes = decompressor.decompress(stored, max_length=most)
    except problems as problem:
        raise Damage(f"cannot be decompressed: {problem}") from None
    if not decompressor.eof:
        raise Damage(f"is no whole zstd frame of at most {most} bytes")
    return content


def decompress_file(path: Path, target: Path) -> None:
    """Decompress a whole zstd file into another, step by step.

    Raises:
        LogCorrupt: If it cannot be decompressed.
        LogTruncated: If it ends too early.
        LogLimit: If it grows to more than 100 times its size, or to more than 1 GiB and ten times its size.
    """
    decompressor, problems = _decompressor("zstd")
    stored = path.stat().st_size
    most = max(ALWAYS_ALLOWED, min(MOST_RATIO * stored, max(MOST_IN_TOTAL, MOST_TOTAL_RATIO * stored)))
    total = 0
    with path.open("rb") as file, target.open("wb") as out:
        while not decompressor.eof:
            step = file.read(1 << 20) if decompressor.needs_input else b""
            if decompressor.needs_input and not step:
                raise LogTruncated(path, "truncated", f"ends at byte {stored}, inside its zstd frame")
            try:
                content = decompressor.decompress(step, max_length=1 << 22)
            except problems as problem:
                raise LogCorrupt(path, "corrupt", f"cannot be decompressed: {problem}") from None
            total += out.write(content)
            if total > most:
                raise LogLimit(path, "limit", f"grows from {stored} to more than {most} bytes")


def _decompressor(compression: str) -> tuple[Any, tuple[type[Exception], ...]]:
    if compression == "zstd":
        zstd = _zstd()
        return zstd.ZstdDecompressor(), (zstd.ZstdError, EOFError)
    if compression == "lz4":
        return import_module("lz4.frame").LZ4FrameDecompressor(), (RuntimeError, EOFError)
    if compression == "bz2":
        return import_module("bz2").BZ2Decompressor(), (OSError, ValueError, EOFError)
    raise Damage(f"is compressed as {compression!r}; known are zstd, lz4 and bz2")


def _zstd() -> Any:
    return import_module("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
