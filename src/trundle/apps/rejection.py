"""Why rows of a log were refused, and what a person can do about it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from trundle.apps.wording import counted, plural

if TYPE_CHECKING:
    from pathlib import Path

    from trundle.records import Trajectory
    from trundle.robot import Robot

__all__ = ["MOST", "REASONS", "advice", "left_out", "without_times"]

WORTH_WORDS = 0.1  # of all rows; a few bad ones are what odometry is there for
MOST = 0.5  # of all rows: a result without them is a partial one

REASONS = {
    "implausible": "a wheel would have turned faster than it can",
    "jump": "a counter began anew, again and again; was the log of several runs put together?",
    "ambiguous_wrap": (
        "a counter may wrap twice between two rows; is encoders.bits right, is limits.max_speed too high?"
    ),
    "nonfinite": (
        "cells hold nan, inf or broken ticks; where a column is written when it changes, say hold: true"
    ),
    "range": "a steering angle is beyond limits.max_steering; is its unit right (unit: deg)?",
    "out_of_order": "their stamps go back in time; --sort puts rows in order",
    "too_soon": "rows are less than 1 us apart; is log.time.unit right?",
    "duplicate": "rows repeat the stamp and reading above; is the time too coarse (log.time.column)?",
    "duplicate_conflict": (
        "different rows have one stamp; is the time too coarse (log.time.column), is it clock: receive?"
    ),
    "no_gyro": "this drive cannot do without its gyro, which is silent; see log.gyro",
    "parse": "cells are no numbers; `trundle info LOG` shows what the columns hold",
    "time_range": "stamps lie beyond 292 years; is log.time.unit right?",
    "unmatched": "topics have no time in common there; is it clock: receive?",
    "missing_joint": "messages lack a joint that log.wheels names",
}


def advice(rejected: Mapping[str, int], accepted: int, robot: Robot) -> list[str]:
    """Sentences about the reason that cost most of a log; none where little was refused.

    Args:
        rejected: Rows by reason.
        accepted: Rows that counted.
        robot: Whose limits say what is plausible.
    """
    refused = sum(rejected.values())
    rows = refused + accepted
    if refused <= WORTH_WORDS * rows:
        return []
    share = f"{refused} of {plural(rows, 'row')} were refused" if accepted else "no sample was accepted"
    words = f"{share}: {counted(rejected)}"
    cause = _cause(max(rejected, key=lambda one: (rejected[one], one)), robot)
    return [f"{words}; {cause}" if cause else words]


def left_out(source: Path | str, trajectory: Trajectory) -> tuple[str, ...]:
    """Sentences about the rows of a trajectory's file that were left out, or stood late; none as a rule."""
    rejected, late = counted(trajectory.rejected), trajectory.events.get("reordered")
    gaps = (f"{source}: rows were left out: {rejected}",) if rejected else ()
    return (
        (*gaps, f"{source}: {plural(late, 'row')} out of the order of time, put in order") if late else gaps
    )


def without_times(source: Path, trajectory: Trajectory, what: str) -> tuple[str, ...]:
    """A sentence about a file that holds no times, and what follows from it; none where it does."""
    return () if trajectory.timed else (f"{source}: has no times; {what}",)


def _cause(reason: str, robot: Robot) -> str:
    cause = REASONS.get(reason, "")
    if reason == "implausible":
        cause += (
            f" ({_bound(robot)}). Usual causes: a wrong unit (log.wheels, log.time), a counter that wraps"
            " (encoders.bits), wrong ticks_per_revolution"
        )
    return cause


def _bound(robot: Robot) -> str:
    """What the description says of how fast wheels turn."""
    if robot.localizer is None and robot.limits.max_wheel_speed is not None:
        return f"limits.max_wheel_speed: {robot.limits.max_wheel_speed:g}"
    if robot.limits.max_speed is not None:
        return f"limits.max_speed: {robot.limits.max_speed:g}"
    return "15 m/s, since no limits are given"
