"""`trundle convert`: the same trajectory, or the same log, in another format."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from trundle.adapters.content import KINDS_OF_LOG
from trundle.adapters.trajectory_format import holdings
from trundle.apps.exit_code import ExitCode
from trundle.apps.output_file import check_output, files_of
from trundle.apps.wording import counted, labelled, plural, seconds
from trundle.errors import InputError

if TYPE_CHECKING:
    from trundle.records import Trajectory, WheelLog
    from trundle.robot import Robot

__all__ = ["convert"]


def convert(
    source: Annotated[Path, Parameter(help=f"A trajectory, told by its suffix; or a log: {KINDS_OF_LOG}.")],
    output: Annotated[Path, Parameter(help=f"Its suffix says the format: {holdings()}; .csv for a log.")],
    /,
    *,
    robot: Path | None = None,
    body: str | None = None,
    salvage: Annotated[bool, Parameter(alias="--allow-partial", negative="")] = False,
    sort: Annotated[bool, Parameter(negative="")] = False,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> ExitCode:
    """Write a trajectory in another format; or, with --robot, a wheel log as Trundle's own CSV.

    Args:
        source: A trajectory, told by its suffix; or a log of any format.
        output: Its suffix says the format.
        robot: The description of the robot whose log it is; its log: section says what is in it.
        body: Of a take of OptiTrack's Motive with several rigid bodies, the one that is meant.
        salvage: Of a damaged recording, read what can be read (exit code 4).
        sort: Put rows of a log in the order of time, however late they come; without it, up to one second.
        force: Replace a file that exists.
    """
    from trundle.adapters.robot_yaml import load_robot
    from trundle.adapters.trajectory import TRAJECTORY_SUFFIXES, write_trajectory

    if robot is not None:
        described = load_robot(robot)
        inputs = [*files_of(source, described), robot]
        check_output(output, suffixes=(".csv",), inputs=inputs, force=force)
        return _convert_log(source, described, output, salvage=salvage, sort=sort, force=force)
    if salvage or sort:
        option = "--salvage" if salvage else "--sort"
        raise InputError(f"{option}: is of wheel logs, which need --robot; a trajectory is read whole")
    check_output(output, suffixes=TRAJECTORY_SUFFIXES, inputs=[source], force=force)
    trajectory = _trajectory_of(source, body)
    write_trajectory(trajectory, output, force=force)
    facts = [
        ("poses", f"{len(trajectory)}, {seconds(trajectory.duration)}"),
        ("rejected", counted(trajectory.rejected)),
        ("events", counted(trajectory.events)),
        ("trajectory", str(output)),
    ]
    print(*labelled(facts), sep="\n")
    return ExitCode.FINE


def _kind(log: WheelLog) -> str:
    return "body twist" if log.wheels is None else log.reading.value


def _trajectory_of(source: Path, body: str | None) -> Trajectory:
    """What the file holds; what it lacks may be because it is a log."""
    from trundle.adapters.trajectory import read_trajectory
    from trundle.errors import LogSchema

    try:
        return read_trajectory(source, body=body)
    except LogSchema as error:
        way = "a wheel log is converted with --robot robot.yaml, and trundle track makes its trajectory"
        raise LogSchema(error.source, error.reason, f"{error.problem}; {way}") from error


def _convert_log(
    source: Path, robot: Robot, output: Path, *, salvage: bool, sort: bool, force: bool
) -> ExitCode:
    from trundle.adapters.log import read_log
    from trundle.adapters.wheel_log_csv import write_log

    log = read_log(source, robot, salvage=salvage, sort=sort)
    write_log(log, output, force=force)
    moved = log.reference is not None and log.reference.time_ns.tolist() != log.time_ns.tolist()
    there = ("the reference has stamps of its own; it was put at those of the rows",) if moved else ()
    for warning in (*log.warnings, *there):
        print(f"trundle: warning: {warning}", file=sys.stderr)
    facts = [
        ("rows", f"{plural(len(log), 'sample')}, {seconds(log.duration)}, {_kind(log)}"),
        ("wheels", ", ".join(log.wheel_names)),
        ("rejected", counted(log.rejected)),
        ("log", str(output)),
    ]
    print(*labelled(facts), sep="\n")
    return ExitCode.PARTIAL if log.losses else ExitCode.FINE
