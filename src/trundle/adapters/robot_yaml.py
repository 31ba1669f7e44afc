"""robot.yaml: read with errors that say where, written back with the user's comments kept.

Writing changes as little of the text as it can. Values that changed are replaced where they stand, and
nothing else moves by one character. Where keys come or go, ruamel.yaml's round trip makes room. Where that
does not say the same robot (an encoder that differs from the user's defaults, say), the section is written
anew. Each try is read back and compared before it counts.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from io import StringIO
from pathlib import Path
from types import MappingProxyType
from typing import Any

from trundle.adapters.atomic import atomic_path
from trundle.adapters.margin_note import with_notes
from trundle.adapters.robot_data import robot_from_data, robot_to_data
from trundle.adapters.yaml_document import YamlDocument, parse_yaml, resolve_plain
from trundle.errors import ConfigError, require_path, require_type
from trundle.robot import Robot

__all__ = ["is_robot_yaml", "load_robot", "robot_text", "save_robot"]

MOST_READ = (1 << 20) + 1  # one byte more than is allowed, so that too much is seen
NO_NOTES: Mapping[str, str] = MappingProxyType({})


def load_robot(path: str | Path) -> Robot:
    """The robot that a file describes. What it does not say has its default.

    Lengths and angles are numbers in m and rad, or texts with their unit: `65 mm`, `2.5 in`, `30 deg`.

    Args:
        path: A YAML 1.2 file.

    Raises:
        ConfigError: If it cannot be read or describes no robot; the message says file, field, value, what is
            allowed, and the line.
    """
    return _described(parse_yaml(_read(require_path(path)), str(path)))


def is_robot_yaml(path: str | Path) -> bool:
    """Whether a YAML file is meant as a robot's description: it has a `drive`.

    Raises:
        ConfigError: If it cannot be read, or is no plain YAML 1.2.
    """
    data = parse_yaml(_read(require_path(path)), str(path)).data
    return isinstance(data, Mapping) and "drive" in data


def save_robot(
    robot: Robot,
    path: str | Path,
    *,
    like: str | Path | None = None,
    notes: Mapping[str, str] = NO_NOTES,
) -> None:
    """Write a robot's description: the old file or the complete new one, never a part.

    Args:
        robot: What to write.
        path: Where to. A description that is there already is brought up to date: its comments, order and
            spelling stay, and only what differs is changed.
        like: Another description whose text is the one to start from; `path` is replaced then.
        notes: Comments to put behind values, by path: `{"drive.track_width": "±0.0002 m"}`. They replace
            those of an earlier call.

    Raises:
        ConfigError: If the file to start from is no robot description. Nothing is written then.
        OutputError: If the file cannot be written.
    """
    require_type("save_robot", "robot", robot, Robot)
    require_type("save_robot", "notes", notes, Mapping)
    target = require_path(path)
    start = require_path(like) if like is not None else target if target.exists() else None
    old = None if start is None else _read(start)
    text = robot_text(robot, old, source="" if start is None else str(start), notes=notes)
    with atomic_path(target, force=True) as temporary:
        temporary.write_bytes(text.encode())


def robot_text(
    robot: Robot, old: bytes | None = None, *, source: str = "", notes: Mapping[str, str] = NO_NOTES
) -> str:
    """The text of a description.

    Args:
        robot: What it shall say.
        old: A description to change as little as possible; None for a fresh one.
        source: Name of the old one, for messages.
        notes: Comments to put behind values, as for `save_robot`.

    Raises:
        ConfigError: If the old one is no robot description, or the robot cannot be written down.
    """
    wanted = robot_to_data(robot)
    texts = iter([_dumped(_emittable(wanted))]) if old is None else _edited(parse_yaml(old, source), wanted)
    for text in texts:
        if _says(text, wanted):
            return with_notes(text, notes, lambda noted: _says(noted, wanted)) if notes else text
    problem = "this robot cannot be written as a description that reads back the same"
    raise ConfigError("", problem, source=source)


_FLOAT = "tag:yaml.org,2002:float"


class _AsWritten(str):
    """A number in the words of whoever wrote it."""

    __slots__ = ()


Place = tuple[str | int, ...]
Change = tuple[Place, Any]
_GONE = object()  # what a change leaves where nothing shall stand


def _edited(document: YamlDocument, wanted: dict[str, Any]) -> Iterator[str]:
    """Texts that may say what is wanted, the least changed first."""
    present = robot_to_data(_described(document))
    if (text := _replaced(document, list(_changes(present, wanted, into_lists=True)))) is not None:
        yield text
    changes = list(_changes(present, wanted))
    yield _rebuilt(document, changes)
    sections = dict.fromkeys(path[0] for path, _ in changes)
    yield _rebuilt(document, [((key,), wanted.get(str(key), _GONE)) for key in sections])


def _says(text: str, wanted: dict[str, Any]) -> bool:
    try:
        return robot_to_data(robot_from_data(parse_yaml(text.encode(), "").data)) == wanted
    except ConfigError:
        return False


def _changes(old: Any, new: Any, path: Place = (), *, into_lists: bool = False) -> Iterator[Change]:
    """The smallest values that differ, and where."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys((*old, *new)):
            yield from _changes(old.get(key, _GONE), new.get(key, _GONE), (*path, key), into_lists=into_lists)
    elif into_lists and isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _changes(one, other, (*path, index), into_lists=True)
    elif old != new:
        yield path, new


def _replaced(document: YamlDocument, changes: list[Change]) -> str | None:
    """The text with values replaced where they stand; None where one has no place of its own."""
    text = document.text
    pieces = []
    for path, value in changes:
        span = document.spans.get(_dotted(path))
        if value is _GONE or span is None or span.stop is None:
            return None
        pieces.append((span.start, span.stop, _flow(value)))
    for start, stop, piece in sorted(pieces, reverse=True):
        text = text[:start] + (" " if start == stop else "") + piece + text[stop:]
    return text


def _dotted(path: Place) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).removeprefix(".")


def _rebuilt(document: YamlDocument, changes: list[Change]) -> str:
    """The text with keys added and taken away, its comments kept; lines may be laid out anew."""
    newline = "\r\n" if "\r\n" in document.text else "\n"
    try:
        tree = _round_trip().load(document.text.replace("\r\n", "\n"))
    except ValueError:  # a word that to ruamel.yaml is a date, in month 13
        return ""
    for path, value in changes:
        holder = tree
        for part in path[:-1]:
            if not isinstance(holder.get(part), dict):
                holder[part] = {}
            holder = holder[part]
        if value is _GONE:
            holder.pop(path[-1], None)
        else:
            holder[path[-1]] = _emittable(value)
    return _dumped(tree).replace("\n", newline)


def _round_trip() -> Any:
    """ruamel.yaml, which keeps comments; numbers stay as they are written, where it would round some."""
    from ruamel.yaml import YAML
    from ruamel.yaml.constructor import RoundTripConstructor
    from ruamel.yaml.representer import RoundTripRepresenter

    yaml: Any = YAML(typ="rt", pure=True)
    # Classes of our own, since theirs would keep what they are taught for everybody.
    yaml.Constructor = type("Constructor", (RoundTripConstructor,), {})
    yaml.Constructor.add_constructor(_FLOAT, lambda _, node: _AsWritten(node.value))
    yaml.Representer = type("Representer", (RoundTripRepresenter,), {})
    yaml.Representer.add_representer(_AsWritten, lambda self, text: self.represent_scalar(_FLOAT, text))
    yaml.preserve_quotes = True
    yaml.width = 1 << 20  # what stands on one line stays there, however long it grows
    yaml.default_flow_style = None
    return yaml


def _dumped(tree: Any) -> str:
    stream = StringIO()
    _round_trip().dump(tree, stream)
    return stream.getvalue()


def _flow(value: Any) -> str:
    """A value on one line, fit for any place."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_flow(key)}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value if _PLAIN.fullmatch(value) and resolve_plain(value) == value else json.dumps(value)
    return "null" if value is None else repr(value)


def _emittable(value: Any) -> Any:
    """The value with quotes around every text that would not read back as itself without them."""
    from ruamel.yaml.scalarstring import DoubleQuotedScalarString

    if isinstance(value, dict):
        return {_emittable(key): _emittable(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_emittable(one) for one in value]
    if isinstance(value, str) and not (_PLAIN.fullmatch(value) and resolve_plain(value) == value):
        return DoubleQuotedScalarString(value)
    return value


_PLAIN = re.compile(r"[A-Za-z_/.][A-Za-z0-9_/. +-]*(?<! )")


def _described(document: YamlDocument) -> Robot:
    try:
        return robot_from_data(document.data)
    except ConfigError as error:
        raise document.located(error) from None


def _read(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise ConfigError("", "is not a file; a robot description is wanted", source=str(path))
        with path.open("rb") as file:
            return file.read(MOST_READ)
    except (OSError, ValueError) as error:
        problem = getattr(error, "strerror", None) or str(error)
        raise ConfigError("", f"cannot be read: {problem}", source=str(path)) from None
