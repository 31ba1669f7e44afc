"""Notes of ours in the margin of a YAML text: comments behind values, which the next notes replace."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from trundle.adapters.yaml_document import parse_yaml

__all__ = ["MARK", "with_notes"]

MARK = "calibrated:"
_OLD = re.compile(rf"(?:;|[ \t]+#)[ \t]*{MARK}.*$")


def with_notes(text: str, notes: Mapping[str, str], fits: Callable[[str], bool]) -> str:
    """The text with notes behind values; comments that stand there already stay in front of them.

    Args:
        text: A YAML document.
        notes: What to note, by the path of the value, such as `drive.wheel_radius.left`. Paths that the text
            does not hold are left out.
        fits: Whether a changed text still says what it said. A note that has no room (a line that goes on
            inside a quoted text) is left out.
    """
    lines = text.split("\n")
    for number, remarks in _by_line(text, notes).items():
        ending = "\r" if lines[number].endswith("\r") else ""
        bare = _OLD.sub("", lines[number].removesuffix("\r"))
        commented = re.search(r"[ \t]#", bare) is not None
        noted = f"{bare}{';' if commented else '  #'} {MARK} {', '.join(remarks)}{ending}"
        tried = "\n".join([*lines[:number], noted, *lines[number + 1 :]])
        if fits(tried):
            lines[number] = noted
    return "\n".join(lines)


def _by_line(text: str, notes: Mapping[str, str]) -> dict[int, list[str]]:
    """The notes of each line."""
    spans = parse_yaml(text.encode(), "").spans
    lines = text.split("\n")
    remarks: dict[int, list[str]] = {}
    for path, note in notes.items():
        if (span := spans.get(path)) is not None:
            line = text.count("\n", 0, span.start if span.stop is None else span.stop)
            name = path.rpartition(".")[2]
            alone = lines[line].lstrip().startswith(f"{name}:")
            remarks.setdefault(line, []).append(note if alone else f"{name} {note}")
    return dict(sorted(remarks.items()))
