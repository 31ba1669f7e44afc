"""`trundle track`: a wheel log becomes a trajectory."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from trundle.adapters.content import KINDS_OF_LOG
from trundle.adapters.trajectory_format import holdings
from trundle.apps.exit_code import ExitCode
from trundle.apps.output_file import check_output, files_of
from trundle.apps.progress import Progress
from trundle.apps.travelled import Travelled
from trundle.apps.wording import angle, counted, digits, labelled, length, seconds

if TYPE_CHECKING:
    from trundle.evaluate import Comparison
    from trundle.records import Trajectory, WheelLog
    from trundle.robot import Robot

__all__ = ["track"]

BYTES_A_STEP = 10_000_000  # about what a quarter of a million rows take
_PICTURES = (".png", ".svg", ".pdf")

Way = Literal["arc+", "arc", "midpoint", "euler", "symmetric"]


def track(
    log: Annotated[Path, Parameter(help=f"Its wheel log: {KINDS_OF_LOG}.")],
    /,
    *,
    robot: Path,
    output: Annotated[Path, Parameter(alias="-o", help=f"The trajectory: {holdings()}.")],
    plot: Path | None = None,
    reference: Path | None = None,
    integrator: Way = "arc+",
    salvage: Annotated[bool, Parameter(alias="--allow-partial", negative="", show_default=False)] = False,
    sort: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    force: Annotated[bool, Parameter(negative="", show_default=False)] = False,
) -> ExitCode:
    """Integrate a wheel log into a trajectory, and say how it went.

    Args:
        log: Of any format that `read_log` knows.
        robot: The robot's description (robot.yaml); its log: section says what the log's columns or topics
            mean.
        output: The trajectory; its suffix says the format.
        plot: A picture as well: .png, .svg or .pdf.
        reference: A trajectory to compare with, in place of the log's own reference.
        integrator: How steps become a path.
        salvage: Of a damaged log, read what can be read (exit code 4).
        sort: Put rows in the order of their stamps, however late they come; without it, up to one second.
        force: Replace files that exist.
    """
    from trundle.adapters.log import is_long, read_log
    from trundle.adapters.robot_yaml import load_robot
    from trundle.adapters.trajectory import TRAJECTORY_SUFFIXES, read_trajectory, write_trajectory
    from trundle.adapters.trajectory_pieces import SUFFIXES_IN_PIECES
    from trundle.apps.rejection import advice, left_out, without_times
    from trundle.errors import InputError, LogError, MissingExtra
    from trundle.odometry.integrate import integrate

    described = load_robot(robot)
    inputs = [*files_of(log, described), robot, *([] if reference is None else [reference])]
    check_output(output, suffixes=TRAJECTORY_SUFFIXES, inputs=inputs, force=force)
    if plot is not None:
        check_output(plot, suffixes=_PICTURES, inputs=inputs, force=force)
        if plot.absolute() == output.absolute():
            raise InputError(f"{plot}: cannot be the trajectory and the picture at once")
        if importlib.util.find_spec("matplotlib") is None:
            raise MissingExtra("matplotlib", "plot")

    plain = plot is None and reference is None and not sort and integrator != "symmetric"
    if plain and output.suffix.lower() in SUFFIXES_IN_PIECES and is_long(log, described):
        return _track_pieces(log, described, output, integrator, salvage=salvage, force=force)
    with Progress(4) as progress:
        progress.step(f"reading {log.name}")
        wheels = read_log(log, described, salvage=salvage, sort=sort)
        truth = wheels.reference if reference is None else read_trajectory(reference)
        progress.step(f"integrating {len(wheels)} samples")
        trajectory = integrate(described, wheels, integrator=integrator)
        why = advice(trajectory.rejected, len(trajectory), described)
        if not len(trajectory):
            raise LogError(log, "nothing", "; ".join((*why, *wheels.warnings)))
        comparison, remarks = _compare(trajectory, truth, described)
        if reference is not None and truth is not None:
            remarks += left_out(reference, truth)
            remarks += without_times(reference, truth, "compared row by row") if comparison else ()
        progress.step(f"writing {output.name}")
        write_trajectory(trajectory, output, force=force)
        if plot is not None:
            progress.step(f"drawing {plot.name}")
            _draw(trajectory, wheels, truth, described, plot)

    travelled = Travelled()
    for _ in (*travelled.read([wheels]), *travelled.travel([trajectory])):
        pass
    travelled.warnings += (*why, *remarks)
    return _tell(log, described, travelled, comparison, output, plot)


def _track_pieces(
    log: Path, robot: Robot, output: Path, integrator: Way, *, salvage: bool, force: bool
) -> ExitCode:
    """Read, integrate and write piece by piece, in memory that does not depend on the log's length."""
    from trundle.adapters.log import read_log_pieces
    from trundle.adapters.trajectory_pieces import write_trajectory_pieces
    from trundle.apps.rejection import advice
    from trundle.errors import LogError
    from trundle.odometry.integrate import integrate_pieces

    travelled = Travelled()

    def told() -> Iterator[Trajectory]:
        read = travelled.read(read_log_pieces(log, robot, salvage=salvage))
        for piece in travelled.travel(integrate_pieces(robot, read, integrator=integrator)):
            progress.step(f"{travelled.accepted} samples of {log.name} to {output.name}")
            yield piece
        travelled.warnings += tuple(advice(travelled.rejected, travelled.accepted, robot))
        if not travelled.accepted:
            raise LogError(log, "nothing", "; ".join(travelled.warnings))

    with Progress(2 + log.stat().st_size // BYTES_A_STEP) as progress:
        write_trajectory_pieces(told(), output, force=force)
    return _tell(log, robot, travelled, None, output, None)


def _tell(
    log: Path,
    robot: Robot,
    travelled: Travelled,
    comparison: Comparison | None,
    output: Path,
    plot: Path | None,
) -> ExitCode:
    from trundle.apps.rejection import MOST

    for warning in travelled.warnings:
        print(f"trundle: warning: {warning}", file=sys.stderr)
    print(f"{robot.name}: {log}")
    print(*labelled(_summary(travelled, robot, comparison, output, plot)), sep="\n")
    refused = travelled.rejected.total()
    partial = travelled.losses or refused > MOST * (refused + travelled.accepted)
    return ExitCode.PARTIAL if partial else ExitCode.FINE


def _compare(
    trajectory: Trajectory, truth: Trajectory | None, robot: Robot
) -> tuple[Comparison | None, list[str]]:
    """Errors against the reference, if any; and why they cannot be told."""
    from trundle.errors import TrundleError
    from trundle.evaluate import compare

    if truth is None:
        return None, []
    try:
        return compare(_at_tracked_point(trajectory, truth, robot), truth), []
    except TrundleError as error:
        return None, [f"the reference cannot be compared: {error}"]


def _at_tracked_point(trajectory: Trajectory, truth: Trajectory, robot: Robot) -> Trajectory:
    """The path of the point that the reference followed: without a heading it could not be moved itself."""
    import numpy as np

    from trundle.adapters.reference import TRACKED_POINT
    from trundle.geometry import se2

    if truth.child_frame != TRACKED_POINT or robot.log.reference is None:
        return trajectory
    poses = se2.compose(trajectory.poses, np.array(robot.log.reference.mounting))
    return dataclasses.replace(trajectory, poses=poses, twists=None, covariances=None)


def _draw(
    trajectory: Trajectory, log: WheelLog, truth: Trajectory | None, robot: Robot, picture: Path
) -> None:
    from trundle.apps.plot import plot_trajectory, save_plot

    figure = plot_trajectory(trajectory, log=log, robot=robot, reference=truth, title=robot.name)
    save_plot(figure, picture)


# --- the summary --------------------------------------------------------------------------------


def _summary(
    travelled: Travelled, robot: Robot, comparison: Comparison | None, output: Path, plot: Path | None
) -> list[tuple[str, str]]:
    accepted, refused = travelled.accepted, travelled.rejected.total()
    duration, trajectory = travelled.duration, travelled.end
    assert trajectory is not None  # a log that gives no pose has been refused
    rate = f", {digits((accepted - 1) / duration)} Hz" if duration else ""
    of = f" of {accepted + refused}" if refused else ""
    end = trajectory.pose(-1)
    x, y = (round(value, 3) + 0.0 for value in (end.x, end.y))  # no -0.000
    heading = digits(math.degrees(math.remainder(end.theta, math.tau)))
    return [
        ("samples", f"{accepted}{of} accepted, {seconds(duration)}{rate}"),
        ("rejected", counted(travelled.rejected)),
        ("events", counted(travelled.events)),
        ("gyro", _idle_gyro(robot) if travelled.gyro else ""),
        ("distance", length(travelled.distance)),
        ("end", f"x {x:.3f} m, y {y:.3f} m, heading {heading} deg"),
        ("1 sigma", _uncertainty(trajectory)),
        *(_errors(comparison) if comparison else ()),
        ("trajectory", str(output)),
        ("picture", str(plot) if plot else ""),
    ]


def _idle_gyro(robot: Robot) -> str:
    """What it takes for a log's yaw rates to count; empty where they do."""
    drive = robot.measuring
    if drive.gyro:
        return ""
    section = "drive" if robot.localizer is None else "localizer"
    measured = ", ".join((*drive.measured_names, "gyro"))
    return f"in the log, not in the pose: {section}.measured: [{measured}] counts it in"


def _uncertainty(trajectory: Trajectory) -> str:
    """One standard deviation of the last pose, along the axes that it is given in."""
    from trundle.odometry.covariance import in_odom_frame

    if trajectory.covariances is None:
        return ""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = trajectory.covariances[-1].tolist()
    variances = in_odom_frame((xx, xy, yy, xt, yt, tt), trajectory.pose(-1).theta)
    x, y, theta = (math.sqrt(max(variances[k], 0.0)) for k in (0, 2, 5))
    return f"x ±{length(x)}, y ±{length(y)}, heading ±{angle(theta)}"


def _errors(comparison: Comparison) -> list[tuple[str, str]]:
    overall = f"ATE {length(comparison.ate)}"
    if comparison.heading is not None:
        overall += f", heading {angle(comparison.heading.rmse)}"
    time = "" if comparison.overlap is None else f" in {seconds(comparison.overlap)}"
    span = f"over {length(comparison.reference_length)}{time}, aligned"
    drift = []
    if comparison.drift is not None:
        drift.append(f"{digits(100 * comparison.drift)} % of the path")
    if comparison.heading_drift is not None:
        drift.append(f"{digits(math.degrees(comparison.heading_drift))} deg/m")
    return [("error", f"{overall} (rms {span})"), ("drift", ", ".join(drift))]
