"""`trundle convert`: the same trajectory, log or robot in another format."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from trundle.adapters.content import KINDS_OF_LOG
from trundle.adapters.trajectory_format import holdings
from trundle.apps.exit_code import ExitCode
from trundle.apps.output_file import check_output, files_of, write_text
from trundle.apps.rejection import without_times
from trundle.apps.wording import counted, labelled, plural, seconds
from trundle.errors import InputError

if TYPE_CHECKING:
    from trundle.records import Trajectory, WheelLog
    from trundle.robot import Robot

__all__ = ["convert"]

_MODELS = "parameters of a ros2_controllers controller (.yaml), .urdf, .xacro, a donkeycar's myconfig.py"
_DESCRIPTIONS = (".yaml", ".yml")
_ONLY_READ = (".urdf", ".xacro")
_ROBOTS = (
    ".yaml (robot.yaml, or of a robot.yaml the ros2_controllers parameters), .py (lines of a myconfig.py)"
)


def convert(
    source: Annotated[
        Path,
        Parameter(
            help=f"A trajectory, told by its suffix; a log: {KINDS_OF_LOG}; a robot: robot.yaml, {_MODELS}."
        ),
    ],
    output: Annotated[
        Path,
        Parameter(help=f"Its suffix says the format: {holdings()}; .csv for a log; for a robot {_ROBOTS}."),
    ],
    /,
    *,
    robot: Path | None = None,
    body: str | None = None,
    salvage: Annotated[bool, Parameter(alias="--allow-partial", negative="")] = False,
    sort: Annotated[bool, Parameter(negative="")] = False,
    force: Annotated[bool, Parameter(negative="")] = False,
) -> ExitCode:
    """Write a trajectory in another format, a wheel log (--robot) as our own CSV, or a robot.

    Args:
        source: A trajectory, told by its suffix; a log of any format; or what describes a robot elsewhere.
        output: Its suffix says the format.
        robot: The description of the robot whose log it is; its log: section says what is in it.
        body: Of a take of OptiTrack's Motive with several rigid bodies, the one that is meant.
        salvage: Of a damaged wheel log, read what can be read (exit code 4).
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
        raise InputError(
            f"{option}: is of wheel logs, which need --robot; trajectories and robots are read whole or not"
            " at all"
        )
    if output.suffix.lower() in _ONLY_READ:
        raise InputError(
            f"{output}: robots are only read from {', '.join(_ONLY_READ)}; they are written as {_ROBOTS}"
        )
    if output.suffix.lower() in (*_DESCRIPTIONS, ".py"):
        check_output(output, suffixes=(*_DESCRIPTIONS, ".py"), inputs=[source], force=force)
        return _convert_robot(source, output)
    check_output(output, suffixes=TRAJECTORY_SUFFIXES, inputs=[source], force=force)
    trajectory = _trajectory_of(source, body)
    write_trajectory(trajectory, output, force=force)
    invented = "the output's stamps number its rows, a second apart"
    for words in without_times(source, trajectory, invented) if output.suffix.lower() != ".kitti" else ():
        print(f"trundle: warning: {words}", file=sys.stderr)
    facts = [
        ("poses", f"{len(trajectory)}, {seconds(trajectory.duration) if trajectory.timed else 'no times'}"),
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
    from trundle.errors import LogError, LogSchema

    try:
        return read_trajectory(source, body=body)
    except LogError as error:
        if not isinstance(error, LogSchema) and error.reason != "format":
            raise
        way = "a wheel log is converted with --robot robot.yaml, and trundle track makes its trajectory"
        raise type(error)(error.source, error.reason, f"{error.problem}; {way}") from error


def _convert_robot(source: Path, output: Path) -> ExitCode:
    """Robot.yaml from what others write; from robot.yaml, and in a .py file, what others read."""
    from trundle.adapters.myconfig import myconfig_text, unsaid_in_myconfig
    from trundle.adapters.robot_yaml import is_robot_yaml, load_robot, save_robot
    from trundle.adapters.ros2_controllers import controllers_text

    ours = source.suffix.lower() in _DESCRIPTIONS and is_robot_yaml(source)
    robot = load_robot(source) if ours else _robot_of(source)
    kind = "description"
    if output.suffix.lower() == ".py":
        kind = "myconfig"
        write_text(output, myconfig_text(robot))
        for words in unsaid_in_myconfig(robot):
            print(f"trundle: warning: {output}: {words}", file=sys.stderr)
    elif ours:
        kind = "ros2"
        write_text(output, controllers_text(robot))
    else:
        save_robot(robot, output)
    print(*labelled([("robot", robot.name), ("drive", repr(robot.drive)), (kind, str(output))]), sep="\n")
    return ExitCode.FINE


def _robot_of(source: Path) -> Robot:
    from trundle.adapters.myconfig import robot_from_myconfig
    from trundle.adapters.ros2_controllers import robot_from_controllers
    from trundle.adapters.urdf import robot_from_urdf

    suffix = source.suffix.lower()
    if suffix in (".urdf", ".xacro"):
        return robot_from_urdf(source)
    if suffix == ".py":
        return robot_from_myconfig(source)
    if suffix in _DESCRIPTIONS:
        return robot_from_controllers(source)
    raise InputError(f"{source}: a robot is described by robot.yaml, {_MODELS}")


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
