"""What a command line says of single logs: `--rolled 2m`, or `--rolled hall.csv=2m` of several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from trundle.errors import InputError, did_you_mean

__all__ = ["labels"]


def labels(
    option: str, words: Sequence[str], logs: Sequence[Path], *, in_order: bool = False
) -> dict[int, str]:
    """What is said of which log.

    Args:
        option: Its name, for messages.
        words: `VALUE` for the only log, `all=VALUE` for each of them, `LOG=VALUE` for one, which is named by
            its path, its name, or its name without suffix.
        logs: All logs.
        in_order: As many plain values as logs are theirs, in their order.

    Returns:
        Values by the number of the log.

    Raises:
        InputError: If a log is not among them, is meant by several, or is spoken of twice.
    """
    if in_order and len(words) == len(logs) and not any(_named(word, logs) for word in words):
        return dict(enumerate(words))
    said: dict[int, str] = {}
    for word in words:
        name, value = _split(word, logs)
        for number in _meant(option, name, logs):
            if number in said:
                raise InputError(f"{option} {word}: {logs[number].name} is spoken of twice")
            said[number] = value
    return said


def _split(word: str, logs: Sequence[Path]) -> tuple[str, str]:
    """Name and value; the name is empty where there is none. Both may hold `=` themselves."""
    name = _named(word, logs)
    if not name and not Path(word).exists():
        before, found, _ = word.partition("=")
        name = before if found else ""
    return (name, word[len(name) + 1 :]) if name else ("", word)


def _named(word: str, logs: Sequence[Path]) -> str:
    """The part before a `=` that names a log, or all; empty where there is none."""
    parts = [word[:place] for place, sign in enumerate(word) if sign == "="]
    return next((part for part in parts if part == "all" or _numbers(part, logs)), "")


def _meant(option: str, name: str, logs: Sequence[Path]) -> list[int]:
    if not name:
        if len(logs) > 1:
            raise InputError(f"{option}: of which of the {len(logs)} logs? Say {option} LOG=..., or all=...")
        return [0]
    if name == "all":
        return list(range(len(logs)))
    numbers = _numbers(name, logs)
    if not numbers:
        raise InputError(f"{option} {name}: no such log; {did_you_mean(name, [log.name for log in logs])}")
    if len(numbers) > 1:
        raise InputError(f"{option} {name}: {len(numbers)} logs have this name; give the whole path")
    return numbers


def _numbers(name: str, logs: Sequence[Path]) -> list[int]:
    """The logs of that path, else of that name, else of that name without suffix."""
    for names in ([str(log) for log in logs], [log.name for log in logs], [log.stem for log in logs]):
        if found := [k for k, one in enumerate(names) if one == name]:
            return found
    return []
