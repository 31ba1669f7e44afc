"""XML as elements that know their lines, read without anything that could expand, reach out or run deep."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat

from trundle.errors import ConfigError

__all__ = ["Element", "parse_xml"]

MOST_BYTES = 1 << 20
MOST_LEVELS = 64
MOST_ELEMENTS = 50_000


@dataclass(frozen=True, slots=True)
class Element:
    """One element; what stands between its tags as text is not kept.

    Attributes:
        tag: As written, prefix included.
        attributes: Likewise.
        line: Counted from 1.
        children: In order.
    """

    tag: str
    attributes: Mapping[str, str]
    line: int
    children: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> Iterator[Element]:
        """The children of that tag."""
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> Element | None:
        """The first child of that tag."""
        return next(self.all(tag), None)

    def walk(self) -> Iterator[Element]:
        """This element and all below it."""
        yield self
        for child in self.children:
            yield from child.walk()


def parse_xml(raw: bytes, source: str) -> Element:
    """The root element.

    Args:
        raw: Contents of the file.
        source: Its name, for messages.

    Raises:
        ConfigError: If it is too large or too deep, is no XML, or has a document type (entities are declared
            there: that is how a kilobyte becomes a gigabyte, and how a file asks for other files).
    """
    if len(raw) > MOST_BYTES:
        raise ConfigError("", f"{len(raw)} bytes, must be at most {MOST_BYTES} (1 MiB)", source=source)
    builder = _Builder(source)
    try:
        builder.parser.Parse(raw, True)
    except expat.ExpatError as error:
        problem = expat.errors.messages[error.code]
        place = f"(line {error.lineno}, column {error.offset + 1})"
        raise ConfigError("", f"not XML: {problem} {place}", source=source) from None
    except (ValueError, LookupError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError("", f"not XML: {error}", source=source) from None
    return builder.roots[0]


class _Builder:
    """Builds elements from expat's events. Without a document type there is nothing to expand."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.roots: list[Element] = []
        self.parser = expat.ParserCreate()
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.StartDoctypeDeclHandler = self._refuse_document_type
        self._open: list[Element] = []
        self._count = 0

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MOST_ELEMENTS:
            raise self._refused(f"more than {MOST_ELEMENTS} elements: this is no robot")
        if len(self._open) >= MOST_LEVELS:
            raise self._refused(f"nested deeper than {MOST_LEVELS} levels")
        element = Element(tag, attributes, self.parser.CurrentLineNumber)
        (self._open[-1].children if self._open else self.roots).append(element)
        self._open.append(element)

    def _end(self, _tag: str) -> None:
        self._open.pop()

    def _refuse_document_type(self, *_declared: object) -> None:
        raise self._refused("a document type (<!DOCTYPE ...>, with its entities) is not allowed: remove it")

    def _refused(self, problem: str) -> ConfigError:
        where = f" (line {self.parser.CurrentLineNumber})"
        return ConfigError("", problem + where, source=self.source)
