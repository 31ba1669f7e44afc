"""Everything Trundle raises, as one tree.

    TrundleError
    ├── ConfigError (ValueError)          a robot description that cannot be
    │   └── Singular                      ... because its wheels cannot observe it
    ├── InputError (ValueError)           a call that was given something it cannot use
    │   └── ShapeError                    ... of the wrong length or shape
    ├── Unobservable (ArithmeticError)    these readings do not determine the answer
    │   └── Singular
    ├── CalibrationError (ValueError)     drives and references that no numbers explain
    │   ├── TooFewData                    ... because there are too few of them
    │   ├── Inconsistent                  ... because they contradict each other
    │   └── NotConverged (ArithmeticError) ... or none were found
    ├── Infeasible (ValueError)           the robot cannot move like that
    ├── PathError (ValueError)            a path that nothing can follow
    ├── LogError (ValueError)             a file that cannot be read as a log
    │   ├── LogTruncated (EOFError)       it ends too early
    │   ├── LogCorrupt                    its bytes contradict themselves
    │   ├── LogLimit                      reading it would take more than it may
    │   └── LogSchema (LookupError)       it does not hold what was asked for
    ├── OutputError (OSError)             a result that could not be written
    └── MissingExtra (ImportError)        an optional package is not installed

Every message says what was wanted, what came, what is allowed, and where.
"""

from __future__ import annotations

import difflib
import enum
import math
from collections.abc import Iterable, Mapping
from numbers import Real
from pathlib import Path
from typing import Any, SupportsFloat, SupportsIndex, TypeVar

__all__ = [
    "CalibrationError",
    "ConfigError",
    "Inconsistent",
    "Infeasible",
    "InputError",
    "LogCorrupt",
    "LogError",
    "LogLimit",
    "LogSchema",
    "LogTruncated",
    "MissingExtra",
    "NotConverged",
    "OutputError",
    "PathError",
    "ShapeError",
    "Singular",
    "TooFewData",
    "TrundleError",
    "Unobservable",
    "did_you_mean",
    "listed",
    "no_such",
    "require_choice",
    "require_finite",
    "require_numbers",
    "require_path",
    "require_positive",
    "require_type",
    "row_of",
    "shown",
]


_Choice = TypeVar("_Choice", bound=enum.Enum)
_LONGEST = 70  # letters of what came that are shown


class TrundleError(Exception):
    """Base of everything that Trundle raises on purpose."""


class ConfigError(TrundleError, ValueError):
    """A description that cannot be true of a robot.

    Attributes:
        field: Dotted path of the value, e.g. `drive.wheel_radius`.
        problem: What came and what is allowed.
        source: File that holds it, empty where there is none.
    """

    def __init__(self, field: str, problem: str, *, source: str = "") -> None:
        self.field = field
        self.problem = problem
        self.source = source
        super().__init__(": ".join(part for part in (source, field, problem) if part))

    def inside(self, path: str, *, source: str = "") -> ConfigError:
        """The same error, seen from the document that holds the field."""
        field = ".".join(part for part in (path, self.field) if part)
        return type(self)(field, self.problem, source=source or self.source)


class InputError(TrundleError, ValueError):
    """A call that was given something it cannot use."""


class ShapeError(InputError):
    """A sequence or array of the wrong length or shape."""


class Unobservable(TrundleError, ArithmeticError):
    """The readings, however exact, do not determine the answer."""


class Singular(ConfigError, Unobservable):
    """A drive whose wheels can never observe how the robot moves."""


class CalibrationError(TrundleError, ValueError):
    """Drives and references that no numbers explain."""


class TooFewData(CalibrationError):
    """There are too few of them."""


class Inconsistent(CalibrationError):
    """They contradict each other."""


class NotConverged(CalibrationError, ArithmeticError):
    """The numbers did not come to rest.

    Attributes:
        iterations: After how many iterations the search was given up.
    """

    def __init__(self, iterations: int, names: Iterable[str]) -> None:
        self.iterations = iterations
        super().__init__(
            f"no numbers were found in {iterations} iterations; {', '.join(names)} did not come to rest: "
            "is the description of the right drive, and the reference of this robot?"
        )


class Infeasible(TrundleError, ValueError):
    """A motion that the robot cannot make."""


class PathError(TrundleError, ValueError):
    """A path that nothing can follow: too short, not finite, or with a corner in it."""


class LogError(TrundleError, ValueError):
    """A file that cannot be read as a log.

    Attributes:
        source: The file.
        reason: One word for programs: `empty`, `not_a_file`, `format`, `unit`, ...
    """

    def __init__(self, source: object, reason: str, problem: str) -> None:
        self.source = str(source)
        self.reason = reason
        self.problem = problem
        super().__init__(f"{self.source}: {problem} [{reason}]")


class LogTruncated(LogError, EOFError):
    """A log that ends before it should."""


class LogCorrupt(LogError):
    """A log whose bytes contradict themselves."""


class LogLimit(LogError):
    """A log that would take more memory or time than it may."""


class LogSchema(LogError, LookupError):
    """A log that does not hold what was asked for."""


class OutputError(TrundleError, OSError):
    """A result that could not be written. The old file is untouched."""


class MissingExtra(TrundleError, ImportError):
    """An optional package is not installed.

    Attributes:
        extra: The extra that brings it.
    """

    def __init__(self, package: str, extra: str, hint: str = "") -> None:
        self.extra = extra
        command = f"pip install 'trundle[{extra}]' {hint}".rstrip()
        super().__init__(f"{package} is not installed; get it with: {command}")


def require_finite(field: str, value: float) -> float:
    """The value as a float, or a ConfigError that names the field.

    Traced values (JAX, PyTorch) pass as they are: they have no number to check yet.
    """
    if not isinstance(value, bool | str):
        if isinstance(value, Real) or type(value).__module__ == "numpy":
            try:
                number = float(value)
            except OverflowError:
                number = math.inf
            except (TypeError, ValueError):
                raise ConfigError(field, f"{shown(value)}, must be a number") from None
            if not math.isfinite(number):
                raise ConfigError(field, f"{number}, must be finite")
            return number
        if getattr(value, "shape", None) == () or hasattr(value, "detach"):
            return value
    raise ConfigError(field, f"{shown(value)}, must be a number")


def require_positive(field: str, value: float) -> float:
    """The value as a float, or a ConfigError unless it is finite and above zero."""
    value = require_finite(field, value)
    if isinstance(value, float) and value <= 0.0:
        raise ConfigError(field, f"{value:g}, must be > 0")
    return value


def require_type(call: str, name: str, value: object, kind: type) -> None:
    """An InputError unless a value is of a kind."""
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InputError(f"{call}: {name} {shown(value)}, must be {article} {kind.__name__}")


def require_choice(field: str, value: object, choices: type[_Choice]) -> _Choice:
    """The choice that a value is, or names, or a ConfigError with the nearest."""
    if isinstance(value, choices):
        return value
    words = [choice.value for choice in choices]
    if not isinstance(value, str) or value not in words:
        raise ConfigError(field, f"{shown(value)}, {did_you_mean(str(value), words)}")
    return choices(value)


def require_path(value: Any) -> Path:
    """A file's path, or an InputError."""
    if not (isinstance(value, str) and value) and not hasattr(type(value), "__fspath__"):
        raise InputError(f"path {shown(value)}, must be the name of a file")
    return Path(value)


def row_of(value: Any) -> tuple[Any, ...] | None:
    """The elements of a row; None where it is none, such as a text or a number."""
    if isinstance(value, str | bytes | Mapping):
        return None
    try:
        return tuple(value)
    except TypeError:
        return None


def shown(value: Any) -> str:
    """What came, on a line of readable length."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}... ({type(value).__name__})"


def require_numbers(call: str, *, one: Mapping[str, object] = {}, row: Mapping[str, object] = {}) -> None:
    """An InputError that names the first of these which is not what it must be.

    For `except` branches: what is called a thousand times a second asks only after something went wrong.

    Args:
        call: What was called.
        one: Arguments that must be a number, or None.
        row: Arguments that must be sequences of numbers.
    """
    for name, value in one.items():
        if value is not None and not _is_number(value):
            raise InputError(f"{call}: {name} {shown(value)}, must be a number")
    for name, value in row.items():
        if (
            isinstance(value, str | bytes)
            or not isinstance(value, Iterable)
            or not all(map(_is_number, value))
        ):
            raise InputError(f"{call}: {name} {shown(value)}, must be a row of numbers")


def _is_number(value: object) -> bool:
    return isinstance(value, SupportsFloat | SupportsIndex) and not isinstance(value, Iterable | type)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint with the nearest known words, and what else there is where none is near."""
    known = list(known)
    near = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if near:
        return f"did you mean {near[0]!r}?"
    return "known: " + listed(known, like=word) if known else "none is known here"


def listed(names: Iterable[str], *, like: str = "", most: int = 24) -> str:
    """`a, b, c`; of too many those that are most like a word, `and 120 more`."""
    names = list(names)
    if len(names) <= most:
        return ", ".join(names) or "none"
    near = sorted(names, key=lambda name: -difflib.SequenceMatcher(None, like, name).ratio())
    return f"{', '.join(near[: most // 2])} and {len(names) - most // 2} more (trundle info lists all)"


def no_such(what: str, word: str | int, known: Iterable[str], has: str = "") -> str:
    """`no topic '/odm'; did you mean '/odom'? It has /cmd_vel, /odom`.

    Args:
        what: Kind of thing that is missing.
        word: What was asked for.
        known: Names that there are.
        has: What to list in their place.
    """
    known = list(known)
    near = difflib.get_close_matches(str(word), known, n=1, cutoff=0.6)
    question = f"did you mean {near[0]!r}? It" if near else "it"
    return f"no {what} {word!r}; {question} has {has or listed(known, like=str(word))}"
