"""`trundle doctor`: which wire, sign, unit or length is wrong, and the line of robot.yaml to change."""

from __future__ import annotations

import difflib
import math
import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from cyclopts import Parameter

from trundle.apps.exit_code import ExitCode
from trundle.apps.wording import digits, plural

if TYPE_CHECKING:
    from trundle.calibrate.diagnosis import Diagnosis, Finding
    from trundle.calibrate.hypotheses import Cause
    from trundle.calibrate.witness import Label
    from trundle.robot import LogMapping, Robot

__all__ = ["Change", "changes", "doctor", "spoken_by"]

Way = Literal["forward", "backward", "left", "right", "counter-clockwise", "clockwise"]

_WIDTH = 96
_MOST_HIDDEN = 4
_SOUND = 0.6  # misfit
_FEWEST = 4  # windows with motion that say anything


class Change(NamedTuple):
    """Lines of a description to change.

    Attributes:
        line: Number of the first of them, or of the one after which lines are put.
        old: Lines that go.
        new: Lines that come.
    """

    line: int
    old: tuple[str, ...]
    new: tuple[str, ...]


def doctor(
    log: Path,
    /,
    *,
    robot: Path,
    drove: Way | None = None,
    distance: str | None = None,
    turns: float | None = None,
    salvage: Annotated[bool, Parameter(alias="--allow-partial", negative="", show_default=False)] = False,
) -> ExitCode:
    """Find what is swapped, reversed, frozen, or in the wrong unit, from a short drive.

    The exit code is 0 where nothing is found, 6 where a fault is, and 7 where the log cannot tell.

    The wheels are compared with each other, and with a gyro, commands (log.twist) or a reference where the
    log has them; or with what you say that the robot did.

    Args:
        log: Any log that `trundle track` reads, of a few seconds: straight on, and turns both ways.
        robot: The robot's description (robot.yaml).
        drove: What the robot did all through the log, seen from above and from its seat.
        distance: About how far that was, such as 2, 2m or "80 cm".
        turns: About how many turns.
        salvage: Of a damaged log, read what can be read (exit code 4).
    """
    from trundle.adapters.log import read_log
    from trundle.adapters.robot_yaml import load_robot
    from trundle.calibrate.diagnosis import diagnose

    label = _label(drove, distance, turns)
    described = load_robot(robot)
    wheels = read_log(log, described, salvage=salvage)
    for warning in wheels.warnings:
        print(f"trundle: warning: {warning}", file=sys.stderr)
    if wheels.wheels is None:
        return _undecided(log, "it holds the robot's own twists and no wheels: there is nothing to look into")
    diagnosis = diagnose(described, wheels, label=label, spoken=spoken_by(log, described))
    if not diagnosis.judged and not diagnosis.findings:
        return _undecided(log, _too_little(diagnosis))

    heard = ", ".join(("the wheels", *diagnosis.witnesses))
    print(f"{described.name}: {log}: heard {heard}; {plural(diagnosis.windows, 'window')} with motion")
    for finding in diagnosis.findings:
        print(*_told(finding, robot), sep="\n")
    if diagnosis.findings:
        return ExitCode.FOUND
    print(*_without_findings(diagnosis), sep="\n")
    if diagnosis.unexplained:
        return ExitCode.UNDECIDED
    return ExitCode.PARTIAL if wheels.losses else ExitCode.FINE


def changes(mended: Robot, path: Path) -> list[Change]:
    """The lines of a description that differ from what a robot's own would say.

    Args:
        mended: The robot.
        path: The description to change as little as possible.

    Raises:
        ConfigError: If the robot cannot be written down.
    """
    from trundle.adapters.robot_yaml import robot_text

    raw = path.read_bytes()
    before = raw.decode("utf-8-sig").splitlines()
    after = robot_text(mended, raw, source=str(path)).splitlines()
    blocks = difflib.SequenceMatcher(None, before, after, autojunk=False).get_opcodes()
    return [
        Change(a + 1 if b > a else a, tuple(before[a:b]), tuple(after[c:d]))
        for word, a, b, c, d in blocks
        if word != "equal"
    ]


# --- what is asked ------------------------------------------------------------------------------


def _label(drove: Way | None, distance: str | None, turns: float | None) -> Label | None:
    from trundle.calibrate.witness import Drove, Label
    from trundle.errors import InputError

    if drove is None:
        if distance is not None or turns is not None:
            raise InputError("--distance and --turns need --drove, which says what the robot did")
        return None
    way = Drove(drove)
    turning = way.direction[0] == 2
    if distance is not None and turning:
        raise InputError(f"--drove {drove} takes --turns, not --distance")
    if turns is not None and not turning:
        raise InputError(f"--drove {drove} takes --distance, not --turns")
    if turns is not None:
        return Label(way, math.tau * turns)
    return Label(way, None if distance is None else _metres(distance))


def _metres(text: str) -> float:
    from trundle.adapters.quantity import LENGTH, read_quantity

    try:
        value: str | float = float(text)
    except ValueError:
        value = text
    return read_quantity("--distance", value, LENGTH)


def spoken_by(log: Path, robot: Robot) -> LogMapping:
    """How a log says it, default columns of tables included.

    Args:
        log: The file.
        robot: Whose log it is.

    Raises:
        LogError: If it cannot be read.
        LogSchema: If columns of wheels are missing.
    """
    from trundle.adapters.content import Content, content_of
    from trundle.adapters.default_columns import with_default_columns
    from trundle.adapters.table import open_table

    if content_of(log) not in (Content.TEXT, Content.PARQUET, Content.JSON, Content.NPZ):
        return robot.log
    return with_default_columns(robot.log, robot, log, open_table(log, robot.log.table).names)


# --- what is answered ---------------------------------------------------------------------------


def _undecided(log: Path, words: str) -> ExitCode:
    print(f"trundle: {log}: cannot tell: {words}", file=sys.stderr)
    return ExitCode.UNDECIDED


def _too_little(diagnosis: Diagnosis) -> str:
    if diagnosis.windows < _FEWEST:
        moved = plural(diagnosis.windows, "window")
        return f"it has {moved} of 0.25 s with motion, must have {_FEWEST} or more: drive a few seconds"
    return (
        "no gyro, commands or reference, and its wheels cannot contradict each other: "
        "name the drive with --drove, e.g. --drove forward"
    )


def _told(finding: Finding, path: Path) -> Iterator[str]:
    first, *others = finding.causes
    if others:
        yield f"fault: one of {len(finding.causes)}, which this log cannot tell apart"
        for letter, cause in zip("abcdefghijklmnopqrstuvwxyz", finding.causes, strict=False):
            yield from _hanging(f"  {letter}. ", cause.words)
            yield from _cure(cause, path)
    else:
        yield from _hanging("fault: ", first.words)
        yield from _cure(first, path)
    for line in finding.evidence:
        yield from _hanging("  evidence  ", line)
    if finding.advice:
        yield from _hanging("  to tell them apart  ", finding.advice)


def _cure(cause: Cause, path: Path) -> Iterator[str]:
    """The lines to change."""
    from trundle.errors import ConfigError

    if cause.mended is None:
        return
    try:
        found = changes(cause.mended, path)
    except ConfigError:
        return
    for change in found:
        after = "" if change.old else "after "
        yield f"  change    {after}{path}:{change.line}"
        yield from (f"            - {line}" for line in change.old)
        yield from (f"            + {line}" for line in change.new)


def _without_findings(diagnosis: Diagnosis) -> Iterator[str]:
    score = digits(diagnosis.score)
    if diagnosis.unexplained:
        words = (
            f"wheels and witnesses contradict each other (misfit {score}, sound robots: below {_SOUND}), and "
            "no single fault explains it: two faults at once, slip, a reference that is late, or one "
            "whose axes or mounting are others (log.reference.mounting)?"
        )
        yield from _hanging("unexplained: ", words)
        return
    if diagnosis.score <= _SOUND:
        yield f"no fault found: misfit {score} (sound robots: below {_SOUND}; most faults make it 5 or more)"
    else:
        words = (
            f"misfit {score} is more than a sound robot's (below {_SOUND}) and less than most faults make it "
            "(5 or more), and none explains it: inexact numbers (trundle calibrate), a rough floor, slip, or "
            "a reference that is late?"
        )
        yield from _hanging("no fault found: ", words)
    hidden = list(dict.fromkeys(cause.words for cause in diagnosis.hidden))
    for words in hidden[:_MOST_HIDDEN]:
        yield from _hanging("  would not show here  ", words)
    if len(hidden) > _MOST_HIDDEN:
        yield f"  would not show here  ... and {len(hidden) - _MOST_HIDDEN} more"


def _hanging(label: str, words: str) -> Sequence[str]:
    return textwrap.wrap(
        words, _WIDTH, initial_indent=label, subsequent_indent=" " * len(label), break_on_hyphens=False
    )
