"""`trundle calibrate`: logs and what is known of the drives become a robot with better numbers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from trundle.apps.calibration_files import CalibrationFiles
from trundle.apps.calibration_runs import Drives, require_different
from trundle.apps.calibration_words import names_in
from trundle.apps.exit_code import ExitCode
from trundle.apps.output_file import files_of
from trundle.apps.progress import Progress
from trundle.apps.wording import aligned, labelled, plural, wrapped

if TYPE_CHECKING:
    from trundle.calibrate.calibration import Calibration
    from trundle.calibrate.hold_out import HoldOut
    from trundle.calibrate.run import Run
    from trundle.robot import Robot

__all__ = ["calibrate"]

_MOST_GROUPS = 4  # held out by default, one after the other

Flag = Annotated[bool, Parameter(negative="", show_default=False)]
Output = Path | None
PerLog = Annotated[list[str] | None, Parameter(negative="")]


def calibrate(
    *logs: Path,
    robot: Path,
    output: Annotated[Output, Parameter(alias="-o")] = None,
    reference: PerLog = None,
    rolled: PerLog = None,
    spun: PerLog = None,
    closed: PerLog = None,
    parameters: PerLog = None,
    hold_out: int | None = None,
    mounting: bool | None = None,
    clock: Annotated[bool, Parameter(show_default=False)] = True,
    prior: Flag = False,
    accept: Flag = False,
    plot: Output = None,
    report: Output = None,
    ros2: Output = None,
    myconfig: Output = None,
    wpilib: Output = None,
    salvage: Annotated[bool, Parameter(alias="--allow-partial", negative="", show_default=False)] = False,
    force: Flag = False,
) -> ExitCode:
    """Find the numbers of a robot that explain its logs best, and how sure they are.

    Every run needs to know where the robot went: a reference in its log, another file, the gyro, or a tape
    measure. Options that speak of single logs take VALUE for the only log, LOG=VALUE, or all=VALUE.

    Args:
        logs: Drives of one robot; together they should go straight, and turn both ways.
        robot: The description to begin with (robot.yaml).
        output: The calibrated description (.yaml): the same text with new numbers and their sigmas.
        reference: A trajectory in place of the log's own; or `gyro`: the headings that the log's gyro gives.
        rolled: The robot went straight on by so much, as a tape measure says: 2m.
        spun: It turned on the spot by so many turns, to the left where positive.
        closed: It ended where and as it began: LOG, or all.
        parameters: What to find (wheel_radius,track_width,...); by default all that the logs can tell.
        hold_out: Into how many groups runs are dealt; each is judged by what the others say. By default
            folders, or runs, up to 4; the two halves of a single log. 0 judges nothing.
        mounting: Whether to find where the reference is mounted; by default where it helps.
        clock: Whether to find the delay between wheels and reference.
        prior: Believe the description as far as its noise section says; without it only the logs count.
        accept: Write numbers that are doubtful: held-out runs are not better, or more than 20 % changed.
        plot: A picture: .png, .svg or .pdf.
        report: All of it as one page: .html.
        ros2: Parameters of a ros2_controllers controller (.yaml); differential ones as three multipliers.
        myconfig: Lines for a donkeycar's myconfig.py.
        wpilib: Constants for WPILib: .java, or .py for RobotPy.
        salvage: Of damaged logs, read what can be read (exit code 4).
        force: Replace files that exist.
    """
    from trundle.adapters.robot_yaml import load_robot
    from trundle.errors import InputError

    if not logs:
        raise InputError("no log is given; calibrate needs at least one")
    outputs = CalibrationFiles(
        robot=output, picture=plot, report=report, ros2=ros2, myconfig=myconfig, wpilib=wpilib
    )
    drives = Drives(logs, reference=reference, rolled=rolled, spun=spun, closed=closed)
    described = load_robot(robot)
    inputs = [path for log in logs for path in files_of(log, described)]
    outputs.check([*inputs, robot, *drives.files], force=force)
    if hold_out is not None and (hold_out < 0 or hold_out == 1):
        raise InputError(f"--hold-out {hold_out}: must be 2 or more groups, or 0 to judge nothing")
    from trundle.calibrate import calibrate as estimate

    outputs.try_out(described)
    wanted = names_in(parameters)

    with Progress(len(logs) + _MOST_GROUPS + 2) as progress:

        def calibrated(some: Sequence[Run]) -> Calibration:
            return estimate(
                described,
                some,
                parameters=wanted,
                mounting=mounting,
                clock=clock,
                prior=prior,
                progress=progress.detail,
            )

        runs = [drives.run(k, described, progress.step, salvage=salvage) for k in range(len(logs))]
        require_different(runs, logs)
        progress.step(f"calibrating from {plural(len(runs), 'run')}")
        found = calibrated(runs)
        judged = _judged(described, runs, logs, hold_out, calibrated, progress)
        doubts = _doubts(found, judged)
        trusted = accept or not (doubts or hold_out == 0)
        progress.step("writing")
        outputs.write(robot, found, judged, trusted=trusted)

    print(f"{described.name}: {plural(len(runs), 'run')}")
    print(*_told(found, judged), sep="\n")
    print(*labelled(outputs.written(trusted=trusted)), sep="\n")
    warnings = [*(warning for run in runs for warning in run.log.warnings), *found.warnings, *doubts]
    warnings += outputs.unsaid(found, trusted=trusted)
    if hold_out == 0:
        warnings.append("nothing was held out, so nothing says whether these numbers are better")
    for warning in dict.fromkeys(warnings):
        print(f"trundle: warning: {warning}", file=sys.stderr)
    if refused := outputs.refused(trusted=trusted):
        print(
            f"trundle: {', '.join(refused)}: not written, these numbers are doubtful; --accept does",
            file=sys.stderr,
        )
    if refused or (doubts and not accept):
        return ExitCode.DATA
    return ExitCode.PARTIAL if any(run.log.losses for run in runs) else ExitCode.FINE


def _judged(
    robot: Robot,
    runs: Sequence[Run],
    logs: Sequence[Path],
    count: int | None,
    calibrated: Callable[[Sequence[Run]], Calibration],
    progress: Progress,
) -> HoldOut | None:
    """What runs that are held out say; None where nobody wants to know."""
    from trundle.calibrate.hold_out import HoldOut, groups_of, halves, hold_out, kind_of
    from trundle.records import Trajectory

    if count == 0:
        return None
    if len(runs) == 1 and isinstance(runs[0].reference, Trajectory):
        runs = halves(runs[0])
        groups = [[0], [1]]
    else:
        folders = [str(log.parent) for log in logs]
        labels = folders if len(set(folders)) > 1 and count is None else [str(k) for k in range(len(logs))]
        groups = list(groups_of(labels, count or _MOST_GROUPS, [kind_of(run) for run in runs]))
    if len(groups) == 1:
        return HoldOut((), (f"there is no run beside {runs[0].name} to judge it by: drive it twice",))
    return hold_out(robot, runs, groups, calibrated, progress.step)


def _doubts(found: Calibration, judged: HoldOut | None) -> list[str]:
    """Why a person should look at the numbers before a robot drives by them."""
    doubts = [one.doubt for one in found.estimates if one.doubt]
    if judged is not None and not judged.better:
        doubts += [judged.words, *judged.refused]
    return doubts


def _told(found: Calibration, judged: HoldOut | None) -> list[str]:
    """Tables and sentences for a screen."""
    from trundle.apps.calibration_words import (
        held_out_rows,
        parameter_rows,
        quality_lines,
        unobserved_lines,
    )

    lines = ["", *aligned(parameter_rows(found), right=(1, 2, 3, 4)), ""]
    lines += wrapped(quality_lines(found), "  ")
    if stays := unobserved_lines(found):
        lines += ["", "  these logs could not tell:", *wrapped(stays, "  - ")]
    rows = held_out_rows(judged)
    if judged is not None:
        lines += [
            "",
            *(aligned(rows, right=(1, 2, 3)) if len(rows) > 1 else ()),
            *wrapped([judged.words], "  "),
        ]
    return [*lines, ""]
