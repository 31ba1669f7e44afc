"""Whether a calibration is better: it is asked about runs that it has not seen.

The runs are dealt into groups. Each group is judged by what all others say, before and after; a calibration
that only fits what it was made from is found out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.calibrate.calibration import Calibration
from trundle.calibrate.run import Closed, Rolled, Run, Spun
from trundle.errors import InputError, TrundleError
from trundle.evaluate import compare
from trundle.evaluate.association import shift
from trundle.geometry import se2
from trundle.odometry.integrate import integrate
from trundle.records import Trajectory, WheelLog
from trundle.robot import Robot

__all__ = ["HoldOut", "Trial", "groups_of", "halves", "hold_out", "kind_of"]

Floats = npt.NDArray[np.float64]

WORTH = 1.02
"""Times better, below which numbers are no better but only others."""
LEAST = 1e-6
"""Errors below this are none [m, rad]."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run that was held out.

    Attributes:
        name: Of the run.
        error: What was judged: `ATE`, `heading`, `distance`, `closure`.
        unit: Of the errors.
        before: Error by the description.
        after: Error by what the other runs say.
    """

    name: str
    error: str
    unit: str
    before: float
    after: float

    @property
    def improvement(self) -> float:
        """How many times smaller the error became."""
        return max(self.before, LEAST) / max(self.after, LEAST)


@dataclass(frozen=True, slots=True)
class HoldOut:
    """What the runs that were held out say.

    Attributes:
        trials: One per run that could be judged.
        refused: Why others could not be, as sentences.
    """

    trials: tuple[Trial, ...]
    refused: tuple[str, ...] = ()

    @property
    def improvement(self) -> float:
        """How many times smaller the errors became: the geometric mean over runs, 0 where there is none."""
        if not self.trials:
            return 0.0
        return math.exp(sum(math.log(trial.improvement) for trial in self.trials) / len(self.trials))

    @property
    def better(self) -> bool:
        """Whether runs were judged, and are explained better."""
        return self.improvement > WORTH

    @property
    def words(self) -> str:
        """The verdict in one sentence."""
        if not self.trials:
            return "No run could be held out, so nothing says whether these numbers are better."
        count = len(self.trials)
        runs = "1 run that was held out is" if count == 1 else f"{count} runs that were held out are"
        times = f"{self.improvement:.2f} times"
        worse = sum(trial.improvement < 1.0 for trial in self.trials)
        but = f"; {worse} of them got worse" if worse and count > 1 else ""
        if self.better:
            return f"Better: {runs} explained {times} more accurately{but}."
        return f"Not better: {runs} explained only {times} as accurately as before{but}."


def hold_out(
    robot: Robot,
    runs: Sequence[Run],
    groups: Sequence[Sequence[int]],
    calibrated: Callable[[Sequence[Run]], Calibration],
    progress: Callable[[str], None] = lambda _: None,
) -> HoldOut:
    """Judge each group of runs by a calibration from all others.

    Args:
        robot: The description to compare with.
        runs: All runs.
        groups: Numbers of the runs that are held out together.
        calibrated: A calibration from some runs.
        progress: Told what is done next.
    """
    trials: list[Trial] = []
    refused: dict[str, list[str]] = {}  # reasons, and what was held out
    for group in groups:
        names = ", ".join(runs[k].name for k in group)
        progress(f"holding out {names}")
        try:
            found = calibrated([run for k, run in enumerate(runs) if k not in group])
            trials += [_trial(robot, found, runs[k]) for k in group]
        except TrundleError as error:
            refused.setdefault(str(error), []).append(names)
    words = (
        f"without {' or without '.join(names)} the others cannot be calibrated: {reason}"
        for reason, names in refused.items()
    )
    return HoldOut(tuple(trials), tuple(words))


def _trial(robot: Robot, found: Calibration, run: Run) -> Trial:
    changes = {one.name: (one.nominal, one.value) for one in found.estimates}
    nominal, value = (
        np.array([changes.get(f"reference.{axis}", (0.0, 0.0))[k] for axis in ("x", "y", "theta")])
        for k in (0, 1)
    )
    mounting = se2.compose(se2.inverse(nominal), value)
    before, after = changes.get("clock", (0.0, 0.0))
    old = _miss(robot, run, np.zeros(3), 0.0)
    new = _miss(
        found.robot, dataclasses.replace(run, log=_corrected(run.log, changes)), mounting, after - before
    )
    return Trial(run.name, old.error, old.unit, old.size, new.size)


def _corrected(log: WheelLog, changes: Mapping[str, tuple[float, float]]) -> WheelLog:
    """The log as it would have been read with the gains and offsets that were found."""

    def better(readings: Floats, gain: str, offset: str) -> Floats:
        (gain_before, gain_after), (before, after) = (
            changes.get(gain, (1.0, 1.0)),
            changes.get(offset, (0.0, 0.0)),
        )
        return gain_after / gain_before * (readings - before) + after

    steering, yaw_rate = log.steering, log.yaw_rate
    if steering is not None:
        columns = zip(log.steering_names, steering.T, strict=True)
        names = [(column, f"steering.{name}.gain", f"steering.{name}.offset") for name, column in columns]
        steering = np.stack([better(*words) for words in names], axis=-1)
    if yaw_rate is not None:
        yaw_rate = better(yaw_rate, "gyro.scale", "gyro.bias")
    return dataclasses.replace(log, steering=steering, yaw_rate=yaw_rate)


class _Miss(NamedTuple):
    """How far odometry is off.

    Attributes:
        error: What was judged.
        unit: Of its size.
        size: Above or equal to zero.
    """

    error: str
    unit: str
    size: float


def _miss(robot: Robot, run: Run, mounting: Floats, delay: float) -> _Miss:
    """What is judged of a run, and how far its odometry is off."""
    path = integrate(robot, run.log, covariance=False)
    if len(path) < 2:
        raise InputError(f"{run.name}: no two samples were accepted")
    x, y, turned = (path.poses[-1] - path.poses[0]).tolist()
    match run.reference or run.log.reference or _headings_of(run.log):
        case Trajectory() as reference if np.isfinite(reference.poses[:, :2]).any():
            tracked = dataclasses.replace(path, poses=se2.compose(path.poses, mounting), twists=None)
            return _Miss("ATE", "m", compare(tracked, reference, time_offset=delay).ate)
        case Trajectory() as reference:
            return _Miss("heading", "rad", _heading_miss(path, shift(reference, -delay)))
        case Rolled(distance=distance):
            return _Miss("distance", "m", abs(math.hypot(x, y) - distance))
        case Spun(angle=angle):
            return _Miss("heading", "rad", abs(turned - angle))
        case Closed():
            return _Miss("closure", "m", math.hypot(x, y))
    raise InputError(f"{run.name}: nothing is known of where it went")


def _headings_of(log: WheelLog) -> Trajectory | None:
    """The headings that the gyro's rates add up to."""
    if log.yaw_rate is None:
        return None
    turned = 0.5 * (log.yaw_rate[1:] + log.yaw_rate[:-1]) * np.diff(log.time_ns) * 1e-9
    poses = np.full((len(log), 3), np.nan)
    poses[:, 2] = np.concatenate([[0.0], np.cumsum(turned)])
    return Trajectory(time_ns=log.time_ns, poses=poses)


def _heading_miss(path: Trajectory, reference: Trajectory) -> float:
    """RMS of the heading error, whatever the headings begin with [rad]."""
    inside = (reference.time_ns >= path.time_ns[0]) & (reference.time_ns <= path.time_ns[-1])
    heading = np.interp(reference.time_ns[inside], path.time_ns, path.poses[:, 2])
    error = np.unwrap(heading - reference.poses[inside, 2])
    return float(np.std(error))


def halves(run: Run) -> tuple[Run, Run]:
    """The first and the second half of a run, by time.

    Raises:
        InputError: If its reference is no trajectory: a tape measure knows only whole runs.
    """
    if not isinstance(run.reference, Trajectory):
        raise InputError(f"{run.name}: only a run with a trajectory as reference can be cut in two")
    middle = int(run.log.time_ns[0] + (run.log.time_ns[-1] - run.log.time_ns[0]) // 2)
    first, second = (_part(run, before, middle) for before in (True, False))
    return first, second


def _part(run: Run, before: bool, middle: int) -> Run:
    log, reference = run.log, run.reference
    assert isinstance(reference, Trajectory)
    rows = (log.time_ns <= middle) == before
    seen = (reference.time_ns <= middle) == before

    def taken(column: npt.NDArray[np.float64] | None) -> npt.NDArray[np.float64] | None:
        return None if column is None else column[rows]

    half = dataclasses.replace(
        log,
        time_ns=log.time_ns[rows],
        wheels=taken(log.wheels),
        steering=taken(log.steering),
        yaw_rate=taken(log.yaw_rate),
        twists=taken(log.twists),
        reference=None,
    )
    truth = dataclasses.replace(
        reference, time_ns=reference.time_ns[seen], poses=reference.poses[seen], twists=None, covariances=None
    )
    word = "first" if before else "second"
    return dataclasses.replace(run, log=half, reference=truth, name=f"{word} half of {run.name}")


def groups_of(labels: Sequence[str], most: int, kinds: Sequence[str] = ()) -> Iterator[list[int]]:
    """Numbers of the runs with one label each, joined to at most so many groups.

    Args:
        labels: Of the runs; those of one label stay together.
        most: Groups.
        kinds: What sort of run each is: every group gets of every sort, so that the others can do without it.
    """
    sorts = dict(zip(labels, kinds or [""] * len(labels), strict=True))
    count = min(most, len(sorts))
    groups: list[list[str]] = [[] for _ in range(count)]
    for sort in dict.fromkeys(sorts.values()):
        alike = [label for label in sorts if sorts[label] == sort]
        if len(alike) >= count:
            for group, members in enumerate(groups):
                members.extend(alike[group * len(alike) // count : (group + 1) * len(alike) // count])
        else:
            for label in alike:
                min(groups, key=len).append(label)
    for members in groups:
        yield [k for k, label in enumerate(labels) if label in members]


def kind_of(run: Run) -> str:
    """What sort of run it is: its reference, and of a turn on the spot its direction."""
    word = type(run.reference).__name__
    return f"{word} {run.reference.angle > 0.0}" if isinstance(run.reference, Spun) else word
