"""`trundle plan`: what drives would tell, before they are driven."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from trundle.adapters.quantity import ANGLE, POSITION, read_quantity
from trundle.apps.calibration_words import names_in
from trundle.apps.course_words import COURSES, course_of
from trundle.apps.progress import Progress
from trundle.apps.wording import aligned, length, plural, seconds, wrapped

if TYPE_CHECKING:
    from trundle.calibrate import Calibration, Reference, Run
    from trundle.records import Trajectory, WheelLog

__all__ = ["plan"]

Kind = Literal["poses", "positions", "gyro", "tape"]

RATE = 20.0  # of the drives that are imagined [Hz]
SEED = 1
_WHO_CAN = "slide is for drives that move sideways, spin for those that turn on the spot"
CLOSED = 0.1  # corners are cut a little: how far a closed course may end from its start [m, rad]


def plan(
    *courses: Annotated[
        str, Parameter(help=f"Of {COURSES}; in m, and in turns to the left, with commas between.")
    ],
    robot: Path,
    reference: Kind = "poses",
    position_noise: str = "2 mm",
    heading_noise: str = "0.3 deg",
    speed: float = 0.4,
    yaw_rate: float = 1.0,
    parameters: Annotated[list[str] | None, Parameter(negative="")] = None,
    mounting: bool | None = None,
    clock: Annotated[bool, Parameter(show_default=False)] = True,
) -> None:
    """Predict how well drives would calibrate a robot: they are simulated, and calibrated from.

    Every COURSE is one run, such as "straight 10, spin 5, spin -5".

    Args:
        courses: In the words of `course_of`.
        robot: Its description; its noise section says how well its wheels roll.
        reference: What will know where it went; of `tape`, each course is a `straight`, a `spin` or closed.
        position_noise: Standard deviation of the reference's positions.
        heading_noise: And of its headings.
        speed: [m/s].
        yaw_rate: On the spot [rad/s].
        parameters: What to find (wheel_radius,track_width,...); by default all that the drives would tell.
        mounting: Whether the reference's mounting shall be found too; by default where that can be told.
        clock: Whether its delay shall.
    """
    from trundle.adapters.robot_yaml import load_robot
    from trundle.calibrate import calibrate
    from trundle.errors import Infeasible, InputError
    from trundle.simulate import simulate

    if not courses:
        raise InputError(f"no course is given; one is of {COURSES}")
    described = load_robot(robot)
    noise = (
        read_quantity("--position-noise", _number(position_noise), POSITION),
        read_quantity("--heading-noise", _number(heading_noise), ANGLE),
    )
    with Progress(len(courses) + 1) as progress:
        runs = []
        for number, text in enumerate(courses):
            progress.step(f"imagining {text}")
            course = course_of(text, speed=speed, yaw_rate=yaw_rate)
            try:
                log = simulate(described, course, rate=RATE, seed=[SEED, number])
            except Infeasible:
                kind = described.drive.type_name
                raise InputError(f"course: {text!r}: a {kind} drive cannot move so; {_WHO_CAN}") from None
            runs.append(_seen(text, log, reference, noise, number))
        progress.step("calibrating")
        found = calibrate(
            described,
            runs,
            parameters=names_in(parameters),
            mounting=mounting,
            clock=clock,
            progress=progress.detail,
        )
    distance = sum(run.log.reference.distance for run in runs if run.log.reference is not None)
    duration = sum(run.log.duration for run in runs)
    print(f"{described.name}: {plural(len(runs), 'run')}, {length(distance)}, {seconds(duration)}")
    print(*_told(found), sep="\n")


def _number(word: str) -> float | str:
    """A bare number as one; a text with its unit as it is."""
    try:
        return float(word)
    except ValueError:
        return word


def _seen(text: str, log: WheelLog, kind: Kind, noise: tuple[float, float], number: int) -> Run:
    """A run with what is known of it in the end."""
    from trundle.calibrate import Run

    truth = log.reference
    assert truth is not None  # it is simulated
    if kind == "tape":
        return Run(log, _measured(text, truth), text)
    if kind == "gyro":
        seen = dataclasses.replace(_noisy(truth, noise, number), twists=None)
        headings = seen.poses.copy()
        headings[:, :2] = math.nan
        return Run(log, dataclasses.replace(seen, poses=headings), text)
    seen = _noisy(truth, noise, number)
    if kind == "positions":
        dots = seen.poses.copy()
        dots[:, 2] = math.nan
        seen = dataclasses.replace(seen, poses=dots)
    return Run(log, seen, text)


def _noisy(truth: Trajectory, noise: tuple[float, float], number: int) -> Trajectory:
    import numpy as np

    chance = np.random.default_rng([SEED, number, 1])
    sigmas = (noise[0], noise[0], noise[1])
    return dataclasses.replace(
        truth, poses=truth.poses + chance.normal(0.0, sigmas, truth.poses.shape), twists=None
    )


def _measured(text: str, truth: Trajectory) -> Reference:
    """What a tape measure says in the end."""
    from trundle.calibrate import Closed, Rolled, Spun
    from trundle.errors import InputError

    x, y, turned = (truth.poses[-1] - truth.poses[0]).tolist()
    manoeuvres = [part.split()[0] for part in text.split(",") if part.strip()]
    if manoeuvres == ["straight"]:
        return Rolled(math.hypot(x, y))
    if manoeuvres == ["spin"]:
        return Spun(turned)
    if math.hypot(x, y) < CLOSED and abs(math.remainder(turned, math.tau)) < CLOSED:
        return Closed()
    problem = "a tape measure knows one straight, one spin, or a course that ends where and as it began"
    raise InputError(f"course: {text!r}: {problem}")


def _told(found: Calibration) -> list[str]:
    from trundle.apps.calibration_words import shown_unit, unobserved_lines
    from trundle.apps.wording import digits

    rows = [("parameter", "1 sigma", "of it")]
    for one in found.estimates:
        unit, factor = shown_unit(one.unit)
        share = f"{digits(100.0 * one.sigma / abs(one.nominal), 2)} %" if one.nominal else ""
        rows.append((one.name, f"±{digits(one.sigma / factor, 2)} {unit}".rstrip(), share))
    lines = ["", *aligned(rows, right=(1, 2))]
    if stays := unobserved_lines(found):
        lines += ["", "  what these drives would not tell:", *wrapped(stays, "  - ")]
    return lines
