"""Numbers as people read them, and lines that fit into 80 columns."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence

__all__ = [
    "aligned",
    "angle",
    "counted",
    "digits",
    "fixed",
    "labelled",
    "length",
    "plural",
    "seconds",
    "size",
    "wrapped",
]


def digits(value: float, significant: int = 3) -> str:
    """A number without exponent, with this many digits that mean something, but at most four decimals."""
    if not math.isfinite(value):
        return f"{value:g}"
    rounded = round(float(f"{value:.{significant}g}"), 4)  # first, so that 9.999 counts as 10.0
    if not rounded:
        return "0"
    decimals = significant - 1 - math.floor(math.log10(abs(rounded)))
    return f"{rounded:.{min(max(decimals, 0), 4)}f}"


def fixed(value: float, decimals: int) -> str:
    """A number with so many decimals, and no minus before a zero."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def length(metres: float) -> str:
    """A length in mm, cm or m."""
    for unit, factor in (("mm", 1e3), ("cm", 1e2)):
        if abs(metres) * factor < (10.0 if unit == "mm" else 100.0) and metres:
            return f"{digits(metres * factor)} {unit}"
    return f"{digits(metres)} m"


def angle(radians: float) -> str:
    """An angle in degrees."""
    return f"{digits(math.degrees(radians))} deg"


def seconds(duration: float) -> str:
    """A duration in ms, s, min and s, h, or days."""
    for unit, factor in (("days", 86400.0), ("h", 3600.0)):
        if abs(duration) >= 2.0 * factor:
            return f"{digits(duration / factor)} {unit}"
    if abs(duration) >= 599.95:
        minutes, rest = divmod(round(duration), 60)
        return f"{minutes} min {rest} s"
    return f"{digits(duration * 1e3)} ms" if 0.0 < abs(duration) < 0.1 else f"{digits(duration)} s"


def size(count: int) -> str:
    """A number of bytes."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if count >= factor:
            return f"{digits(count / factor)} {unit}"
    return plural(count, "byte")


def plural(count: int, word: str) -> str:
    """`1 row`, `2 rows`."""
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def counted(counts: Mapping[str, int]) -> str:
    """`12 nonfinite, 3 out_of_order`: the most frequent first."""
    ranked = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{count} {reason}" for reason, count in ranked if count)


def labelled(lines: Sequence[tuple[str, str]], indent: str = "  ") -> list[str]:
    """`label  text` lines, the texts below each other; empty texts are left out."""
    kept = [(label, text) for label, text in lines if text]
    width = max((len(label) for label, _ in kept), default=0)
    return [f"{indent}{label:<{width}}  {text}" for label, text in kept]


def aligned(rows: Sequence[Sequence[str]], right: Sequence[int] = (), indent: str = "  ") -> list[str]:
    """A table: columns as wide as their widest cell, those named in `right` flush right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        (
            indent
            + "  ".join(
                f"{cell:>{width}}" if place in right else f"{cell:<{width}}"
                for place, (cell, width) in enumerate(zip(row, widths, strict=True))
            )
        ).rstrip()
        for row in rows
    ]


def wrapped(texts: Sequence[str], mark: str, width: int = 100) -> list[str]:
    """Sentences as lines of at most this width, each behind a mark, what follows below its text."""
    return [
        line
        for text in texts
        for line in textwrap.wrap(
            text, width, initial_indent=mark, subsequent_indent=" " * len(mark), break_long_words=False
        )
    ]
