"""A YAML 1.2 document as plain data that knows where each value stands.

The text is read event by event, so that what must not be there (aliases, tags, bombs, a key twice) is
refused before anything is built from it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from trundle.errors import ConfigError

__all__ = ["Span", "YamlDocument", "parse_yaml", "resolve_plain"]

MOST_BYTES = 1 << 20
MOST_LEVELS = 32
MOST_VALUES = 20_000


class Span(NamedTuple):
    """Where a value stands in its text.

    Attributes:
        start: Index of its first character.
        stop: Index after its last one; None where a block has no clear end.
        line: Line of its first character, counted from 1.
    """

    start: int
    stop: int | None
    line: int


@dataclass(frozen=True, slots=True)
class YamlDocument:
    """Plain data, and the places of its values.

    Attributes:
        text: What was read.
        source: File that it came from, for messages.
        data: Mappings with text keys, lists, texts, numbers, booleans and None.
        spans: Place of each value by its path, such as `drive.wheels[2].radius`.
    """

    text: str
    source: str
    data: Any
    spans: dict[str, Span]

    def located(self, error: ConfigError) -> ConfigError:
        """The same error with the file, and the line of its field or of what holds it."""
        path, span = error.field, None
        while path and span is None:
            span = self.spans.get(path)
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        where = f" (line {span.line})" if span else ""
        return type(error)(error.field, error.problem + where, source=self.source)


def parse_yaml(raw: bytes, source: str) -> YamlDocument:
    """Read one document of plain data.

    Args:
        raw: Contents of the file, UTF-8.
        source: Its name, for messages.

    Raises:
        ConfigError: If it is too large or too deep, not UTF-8, not YAML 1.2, more than one document, or
            holds aliases, anchors, tags, a key twice or a key that is not text.
    """
    if len(raw) > MOST_BYTES:
        raise ConfigError("", f"{len(raw)} bytes, must be at most {MOST_BYTES} (1 MiB)", source=source)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"byte {error.start} is not UTF-8 text; save it as UTF-8"
        raise ConfigError("", problem, source=source) from None
    builder = _Builder(text, source)
    for event in _events(text, source):
        builder.take(event)
    return YamlDocument(text, source, builder.root, builder.spans)


def _events(text: str, source: str) -> Iterator[Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        yield from YAML(typ="safe", pure=True).parse(text)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        problem = error.problem or error.context or "no more is known"
        raise ConfigError("", f"not YAML: {problem}{where}", source=source) from None
    except (YAMLError, ValueError, OverflowError) as error:
        raise ConfigError("", f"not YAML: {' '.join(str(error).split())}", source=source) from None


class _Open(NamedTuple):
    """A mapping or list whose end has not come yet."""

    value: Any
    path: str
    span: Span
    flow: bool


class _Builder:
    """Builds the data from events, and refuses what does not belong into a description."""

    def __init__(self, text: str, source: str) -> None:
        self.text = text
        self.source = source
        self.root: Any = None
        self.spans: dict[str, Span] = {}
        self._open: list[_Open] = []
        self._key: list[str | None] = []  # per open collection: the key whose value comes next
        self._documents = 0

    def take(self, event: Any) -> None:
        """One event of ruamel.yaml's parser."""
        kind = type(event).__name__
        line = event.start_mark.line + 1
        if kind == "DocumentStartEvent":
            self._begin(event, line)
        elif kind == "AliasEvent" or getattr(event, "anchor", None) is not None:
            raise self._refused("aliases and anchors (&, *) are not allowed: write the value out", line)
        elif getattr(event, "tag", None) is not None:
            raise self._refused(f"tags ({event.tag}) are not allowed: plain data only", line)
        elif kind == "ScalarEvent":
            self._scalar(event, line)
        elif kind in ("MappingStartEvent", "SequenceStartEvent"):
            self._collection({} if kind == "MappingStartEvent" else [], event, line)
        elif kind in ("MappingEndEvent", "SequenceEndEvent"):
            done = self._open.pop()
            self._key.pop()
            if done.flow:
                self.spans[done.path] = done.span._replace(stop=event.end_mark.index)

    def _begin(self, event: Any, line: int) -> None:
        self._documents += 1
        if self._documents > 1:
            raise self._refused("a second document begins; one is wanted", line)
        if event.version not in (None, (1, 2)):
            raise self._refused("YAML 1.2 is wanted; remove the %YAML line", line)

    def _scalar(self, event: Any, line: int) -> None:
        word = event.value
        if not word.isascii() and any("\ud800" <= sign <= "\udfff" for sign in word):
            raise self._refused("half a character (a lone surrogate) stands in a text", line)
        value = resolve_plain(word) if event.style is None else word
        if self._open and isinstance(self._open[-1].value, dict) and self._key[-1] is None:
            self._take_key(value, event.start_mark.index, line)
        else:
            self._add(value, Span(event.start_mark.index, event.end_mark.index, line))

    def _follows_digit(self, start: int) -> bool:
        """Whether what begins there stands behind a number and a comma, as `0,2` does."""
        return bool(re.search(r"[0-9],$", self.text[max(start - 2, 0) : start]))

    def _take_key(self, key: Any, start: int, line: int) -> None:
        if not isinstance(key, str):
            comma = "; a decimal comma? Numbers have a point: 0.2" if self._follows_digit(start) else ""
            raise self._refused(f"key {key!r} must be text; write it in quotes{comma}", line)
        holder = self._open[-1]
        if key in holder.value:
            path = f"{holder.path}.{key}" if holder.path else key
            problem = f"is given twice (lines {self.spans[path].line} and {line})"
            raise ConfigError(path, problem, source=self.source)
        self._key[-1] = key

    def _collection(self, value: Any, event: Any, line: int) -> None:
        if self._open and isinstance(self._open[-1].value, dict) and self._key[-1] is None:
            raise self._refused("a key must be text, not a list or mapping", line)
        if len(self._open) >= MOST_LEVELS:
            raise self._refused(f"nested deeper than {MOST_LEVELS} levels", line)
        span = Span(event.start_mark.index, None, line)
        path = self._add(value, span)
        self._open.append(_Open(value, path, span, bool(event.flow_style)))
        self._key.append(None)

    def _add(self, value: Any, span: Span) -> str:
        path = self._place(value)
        self.spans[path] = span
        if len(self.spans) > MOST_VALUES:
            raise self._refused(f"more than {MOST_VALUES} values: this is no description", span.line)
        return path

    def _place(self, value: Any) -> str:
        if not self._open:
            self.root = value
            return ""
        holder = self._open[-1]
        if isinstance(holder.value, list):
            holder.value.append(value)
            return f"{holder.path}[{len(holder.value) - 1}]"
        key, self._key[-1] = self._key[-1], None
        assert key is not None  # _take_key saw it
        holder.value[key] = value
        return f"{holder.path}.{key}" if holder.path else key

    def _refused(self, problem: str, line: int) -> ConfigError:
        return ConfigError("", f"{problem} (line {line})", source=self.source)


# YAML 1.2.2, section 10.3.2, the core schema: what plain text means. `on`, `1_000` and dates are texts.
_WORDS = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
    **{sign + word: float(sign + "inf") for sign in ("", "+", "-") for word in (".inf", ".Inf", ".INF")},
}
_INTEGER = re.compile(r"[-+]?[0-9]{1,18}")
_OTHER_BASE = re.compile(r"0(o[0-7]{1,20}|x[0-9a-fA-F]{1,15})")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


def resolve_plain(word: str) -> str | float | bool | None:
    """What a text without quotes means."""
    if word in _WORDS:
        return _WORDS[word]
    if _INTEGER.fullmatch(word):
        return int(word)
    if _OTHER_BASE.fullmatch(word):
        return int(word, 0)
    return float(word) if _FLOAT.fullmatch(word) else word
