"""JSON lines: one object per line, or several behind each other; nested values by dotted names.

`{"t": 1, "wheel": {"left": 2}, "pose": [3, 4]}` has the columns `t`, `wheel.left`, `pose.0` and `pose.1`.
Numbers are as strict and as exact as in text tables: what is no number costs its own row, which is counted.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from trundle.adapters.numeral import Beyond, Nonfinite, plain
from trundle.adapters.table import ColumnName, Ending, Rows, Wanted, column_index
from trundle.errors import LogError, LogLimit, LogSchema

__all__ = ["JsonTable"]

AT_ONCE = 1 << 20  # characters
LONGEST_OBJECT = 1 << 20  # characters
LONGEST_NUMBER = 1000  # characters
SAMPLE = 50  # objects whose names the table has
ROWS_AT_ONCE = 4096  # that become columns in one go
NAMED = 5  # lines at fault that a warning names
MOST_VALUES = 1000  # in one object
DEEPEST = 20  # levels of nesting that are looked into

_NEXT_OBJECT = re.compile(r"\}\s*(?=\{)")
_REASONS: dict[type[ValueError], str] = {Nonfinite: "nonfinite", Beyond: "time_range"}


class _Number(str):
    """A number as it is written."""

    __slots__ = ()


class _Unfinished(str):
    """What is wrong with a line inside which the file ends."""

    __slots__ = ()


class _Object(list[tuple[str, Any]]):
    """Names and values, as often as they stand there."""


# Line number, and the object's values by dotted name; or what is wrong with the line.
_Found: TypeAlias = tuple[int, dict[str, Any] | str]

_decoder = json.JSONDecoder(
    parse_float=_Number, parse_int=_Number, parse_constant=_Number, object_pairs_hook=_Object
)


class JsonTable:
    """JSON objects as the rows of a table.

    Names are those of the first fifty objects. An object that lacks a wanted value is left out, unless the
    value is held.

    Raises:
        LogSchema: If none of them holds a value.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        found = list(islice(self._objects(), SAMPLE))
        objects = [values for _, values in found if isinstance(values, dict)]
        self.names: tuple[ColumnName, ...] = tuple(dict.fromkeys(name for one in objects for name in one))
        if not self.names:
            line, fault = found[0] if found else (1, "nothing")
            fault = fault if isinstance(fault, str) else "an empty object"
            wanted = 'must hold objects of one line each: {"time": 0.02, "left.position": 1.5}'
            raise LogSchema(path, "parse", f"line {line}: {fault}; {wanted} (jq -c . makes that of others)")

    def read(self, wanted: Sequence[Wanted]) -> Rows:
        """See `Table`."""
        (rows,) = _Reading(self, wanted).pieces(self._objects(), None)
        return rows

    def pieces(self, wanted: Sequence[Wanted], least: int) -> Iterator[Rows]:
        """See `LongTable`."""
        return _Reading(self, wanted).pieces(self._objects(), least)

    def _objects(self) -> Iterator[_Found]:
        """Every object, with its line; and, of every line that holds something else, what is wrong."""
        try:
            # Bytes that are no UTF-8 become what no number and no name has.
            with self.path.open(encoding="utf-8-sig", errors="surrogateescape", newline="\n") as file:
                number, rest = 1, ""
                while read := file.readline(AT_ONCE):
                    text, ends = rest + read, read.endswith("\n")
                    objects = _Objects(text, ends=ends)
                    yield from ((number, values) for values in objects)
                    rest = text[objects.position :]
                    if len(rest) > LONGEST_OBJECT:
                        problem = f"line {number} holds an object of more than {LONGEST_OBJECT} characters"
                        raise LogLimit(self.path, "line", problem)
                    number += ends
                # What has not become an object by now is none, and no line ends behind it.
                yield from ((number, _Unfinished(values)) for values in _Objects(rest, ends=True))
        except OSError as error:
            raise LogError(self.path, "unreadable", f"cannot be read: {error.strerror or error}") from error


class _Objects:
    """The objects of a line, or of what was read of it so far.

    Attributes:
        position: Up to where they have been read.
    """

    def __init__(self, text: str, *, ends: bool) -> None:
        self.text = text
        self.ends = ends
        self.position = 0

    def __iter__(self) -> Iterator[dict[str, Any] | str]:
        self._skip_blanks()
        while self.position < len(self.text):
            try:
                value, behind = _decoder.raw_decode(self.text, self.position)
            except (ValueError, RecursionError):
                following = _NEXT_OBJECT.search(self.text, self.position)
                if following is None and not self.ends:
                    return  # the rest of it may come yet
                yield f"{self.text[self.position : self.position + 40]!r} is no JSON object"
                self.position = len(self.text) if following is None else following.end()
            else:
                self.position = behind
                yield _values(value)
            self._skip_blanks()

    def _skip_blanks(self) -> None:
        while self.position < len(self.text) and self.text[self.position].isspace():
            self.position += 1


def _values(value: Any) -> dict[str, Any] | str:
    """What an object says by dotted names, each once; or why it cannot be taken."""
    if not isinstance(value, _Object):
        return f"{_shown(value)} is no object"
    pairs = list(islice(_flat(value), MOST_VALUES + 1))
    if len(pairs) > MOST_VALUES:
        return f"an object of more than {MOST_VALUES} values"
    values = dict(pairs)
    if len(values) == len(pairs):
        return values
    twice = next(name for name, count in Counter(name for name, _ in pairs).items() if count > 1)
    return f"{twice!r} stands there twice"


def _flat(value: Any, name: str = "", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Values by dotted name."""
    if depth < DEEPEST and isinstance(value, list):
        members = value if isinstance(value, _Object) else enumerate(value)
        for key, inner in members:
            yield from _flat(inner, f"{name}.{key}" if depth else str(key), depth + 1)
    else:
        yield name, value


def _shown(value: Any) -> str:
    """A value, as a message has room for."""
    if isinstance(value, list):
        return "an object" if isinstance(value, _Object) else "an array"
    return repr(str(value)[:40])


class _Reading:
    """One pass over the objects for the wanted columns."""

    def __init__(self, table: JsonTable, wanted: Sequence[Wanted]) -> None:
        self.path = table.path
        self.wanted = wanted
        self.names = [str(table.names[column_index(table.path, table.names, w.column)]) for w in wanted]
        self.held: dict[str, str] = {}
        self.rejected: Counter[str] = Counter()
        self.faults: list[str] = []
        self.ending: Ending | None = None

    def pieces(self, objects: Iterator[_Found], least: int | None) -> Iterator[Rows]:
        """At least so many rows at a time, but for the last piece; without a number all at once."""
        parts: list[list[npt.NDArray[Any]]] = [self._columns([])]
        count = 0
        whole = ((line, tokens) for line, values in objects if (tokens := self._tokens(line, values)))
        while block := list(islice(whole, ROWS_AT_ONCE)):
            if least is not None and sum(len(columns[0]) for columns in parts) >= least:
                piece = _joined(parts)
                count += len(piece[0])
                yield Rows(piece)
                parts = []
            try:
                parts.append(self._columns([tokens for _, tokens in block]))
            except ValueError:
                parts.append(
                    self._columns([tokens for line, tokens in block if self._is_whole(line, tokens)])
                )
        rest = _joined(parts)
        self._check(count + (len(rest[0]) if rest else 0))
        yield Rows(rest, self.rejected, self._warnings(), self.ending)

    def _tokens(self, line: int, values: Mapping[str, Any] | str) -> list[bytes] | None:
        """The wanted numbers of an object, as they are written; None where it lacks one."""
        if isinstance(values, _Unfinished):
            self.ending = Ending(f"ends at byte {self.path.stat().st_size}, inside line {line}", is_cut=True)
        if isinstance(values, str):
            self._reject(line, "unfinished" if self.ending else "parse", values)
            return None
        tokens = []
        for name, want in zip(self.names, self.wanted, strict=True):
            value = values.get(name)
            if want.hold and isinstance(value, _Number):
                self.held[name] = value
            elif want.hold and value is None:
                value = self.held.get(name)
            if not isinstance(value, _Number) or len(value) > LONGEST_NUMBER:
                what = "is missing" if value is None else f"is {_shown(value)}, no number"
                self._reject(line, "parse", f"{name!r} {what}")
                return None
            tokens.append(value.encode())
        return tokens

    def _columns(self, rows: Sequence[list[bytes]]) -> list[npt.NDArray[Any]]:
        return [
            want.numeral.of_text(plain([row[k] for row in rows]) if rows else [])
            for k, want in enumerate(self.wanted)
        ]

    def _is_whole(self, line: int, row: list[bytes]) -> bool:
        for name, token, want in zip(self.names, row, self.wanted, strict=True):
            try:
                want.numeral.of_text(plain([token]))
            except ValueError as error:
                shown = token[:40].decode()
                self._reject(line, _REASONS.get(type(error), "parse"), f"{name!r} is {shown}")
                return False
        return True

    def _reject(self, line: int, reason: str, what: str) -> None:
        self.rejected[reason] += 1
        if len(self.faults) < NAMED:
            self.faults.append(f"line {line}: {what}")

    def _check(self, count: int) -> None:
        if count:
            return
        refused = self.rejected.total()
        if not refused:
            raise LogError(self.path, "empty", "holds no object")
        if 2 * (beyond := self.rejected["time_range"]) > refused:
            problem = f"{beyond} of {refused} objects are stamped beyond 292 years, as {self.faults[0]}"
            raise LogSchema(self.path, "unit", f"{problem}; declare the unit of the time")
        raise LogSchema(
            self.path, "parse", f"{refused} of {refused} objects hold no numbers: {self.faults[0]}"
        )

    def _warnings(self) -> tuple[str, ...]:
        refused = self.rejected.total()
        if not refused:
            return ()
        dots = "; ..." if refused > len(self.faults) else ""
        objects = "1 object was" if refused == 1 else f"{refused} objects were"
        return (f"{objects} left out as unreadable: {'; '.join(self.faults)}{dots}",)


def _joined(parts: list[list[npt.NDArray[Any]]]) -> tuple[npt.NDArray[Any], ...]:
    return tuple(np.concatenate(pieces) for pieces in zip(*parts, strict=True))
