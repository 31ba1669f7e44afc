"""Parts of a description as typed values: what stands where it must not is an error that says so."""

from __future__ import annotations

import enum
import re
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeVar, get_args, get_type_hints

import msgspec

from trundle.adapters.quantity import Quantity, read_number, read_quantity
from trundle.errors import ConfigError, did_you_mean

__all__ = ["check_keys", "read_list", "read_mapping", "read_struct", "shown"]

NOTHING: Mapping[str, Any] = MappingProxyType({})
S = TypeVar("S", bound=msgspec.Struct)


def read_mapping(path: str, value: Any) -> Mapping[str, Any]:
    """The value, if it is a mapping; else a ConfigError."""
    if not isinstance(value, Mapping):
        raise ConfigError(path, f"{shown(value)}, must be a mapping (key: value)")
    return value


def read_list(path: str, value: Any, wanted: str = "a list") -> Sequence[Any]:
    """The value, if it is a list; else a ConfigError."""
    if not isinstance(value, list | tuple):
        raise ConfigError(path, f"{shown(value)}, must be {wanted}")
    return value


def check_keys(
    path: str,
    given: Mapping[str, Any],
    known: Collection[str],
    elsewhere: Mapping[str, Sequence[tuple[str, str]]] = NOTHING,
) -> None:
    """Refuse what is not known: a typo must not become a default.

    Args:
        path: Where the keys stand, for messages.
        given: Keys that came.
        known: Keys that may come.
        elsewhere: By keys of other programs, ours, the likeliest first, and what becomes of the number.
    """
    for key in given:
        if key not in known:
            for ours, change in elsewhere.get(key.lower(), ()):
                if ours in known:
                    raise ConfigError(_join(path, key), f"unknown key, here it is {ours!r}{change}")
            raise ConfigError(_join(path, key), f"unknown key, {did_you_mean(key, known)}")


def shown(value: Any) -> str:
    """A value as a message shows it: YAML's words, and not too much of it."""
    if value is None:
        return "empty"
    if isinstance(value, bool):
        return str(value).lower()
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def read_struct(path: str, value: Any, shape: type[S], quantities: Mapping[str, Quantity] | None = None) -> S:
    """Plain data as a struct.

    Args:
        path: Where it stands, for messages.
        value: A mapping.
        shape: The struct.
        quantities: Fields that may have a unit (`30 deg`).

    Raises:
        ConfigError: If a key is unknown or missing, or a value is of the wrong type or impossible.
    """
    given = dict(read_mapping(path, value))
    for key, quantity in (quantities or {}).items():
        if given.get(key) is not None:
            given[key] = read_quantity(f"{path}.{key}", given[key], quantity)
    try:
        return msgspec.convert(given, shape, strict=True)
    except msgspec.ValidationError as error:
        raise _translated(error, given, shape).inside(path) from None


_PLACE = re.compile(r" - at `\$\.?(.*)`$")
_UNKNOWN = re.compile(r"contains unknown field `(.*?)`")
_MISSING = re.compile(r"missing required field `(.*?)`")
_WANTED = re.compile(r"Expected `(.*?)`")
_IN_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "str": "text",
    "object": "a mapping (key: value)",
    "array": "a list",
}


def _translated(error: msgspec.ValidationError, given: Any, shape: type[msgspec.Struct]) -> ConfigError:
    """What msgspec found, as our error: with its path, the value that came, and what is allowed."""
    text = str(error)
    place = _PLACE.search(text)
    path, text = (place[1], text[: place.start()]) if place else ("", text)
    if isinstance(error.__cause__, ConfigError):
        return error.__cause__.inside(path)
    value, allowed = _at(path, given, shape)
    if unknown := _UNKNOWN.search(text):
        return ConfigError(_join(path, unknown[1]), f"unknown key, {did_you_mean(unknown[1], allowed)}")
    if missing := _MISSING.search(text):
        return ConfigError(_join(path, missing[1]), "missing, must be given")
    if "enum value" in text:
        return ConfigError(path, f"{shown(value)}, {did_you_mean(str(value), allowed)}")
    wanted = _WANTED.search(text)
    if wanted is None or " of length " in text:
        return ConfigError(path, f"{shown(value)}: {text}")
    types = [word for word in wanted[1].split(" | ") if word != "null"]
    if types == ["float"]:
        try:
            read_number(path, value)
        except ConfigError as better:
            return better
    words = " or ".join(_IN_WORDS.get(word, word) for word in types)
    return ConfigError(path, f"{shown(value)}, must be {words}")


def _join(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key


def _at(path: str, given: Any, shape: Any) -> tuple[Any, list[str]]:
    """The value at a path of msgspec's, and the words that may stand there: keys or choices."""
    value = given
    for part in re.findall(r"[^.\[\]]+", path):
        value = value[int(part)] if isinstance(value, list) else value[part]
        hints = [get_type_hints(one).get(part) for one in _members(shape) if _is_struct(one)]
        shape = hints[0] if hints else None
    words: list[str] = []
    for one in _members(shape):
        if _is_struct(one):
            words += one.__struct_fields__
        elif isinstance(one, type) and issubclass(one, enum.Enum):
            words += [member.value for member in one]
        else:
            words += [str(word) for word in get_args(one)]
    return value, words


def _members(shape: Any) -> tuple[Any, ...]:
    """The types of a union, or the one type."""
    return get_args(shape) if type(None) in get_args(shape) else (shape,)


def _is_struct(shape: Any) -> bool:
    return isinstance(shape, type) and issubclass(shape, msgspec.Struct)
