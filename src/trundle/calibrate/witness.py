"""Who else knows how the robot moved: a gyro, a reference, commands, or the person who drove it.

What a witness says is cut into windows: short spans of the log over which it is compared with the wheels.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trundle.calibrate.wheel_steps import LIMIT, WheelSteps
from trundle.errors import InputError, require_positive
from trundle.geometry import se2
from trundle.records import Trajectory, WheelLog
from trundle.robot import Kinematics, WheelKind
from trundle.robot.observability import length_scale

__all__ = ["Drove", "Label", "Windows", "Witness", "lever_of", "windows_of", "witnesses_of"]

Floats = npt.NDArray[np.float64]
Places = npt.NDArray[np.int64]

WINDOW = 0.25
"""Shortest window [s]: short against a turn, long against the delay between two sensors."""
LONGEST = 3.0
"""Windows that the log's rows stretch to more than so many times their length are left out."""
MOST = 3000
"""Windows of a longer log are spread evenly over it."""
BIAS = 0.02
"""What a gyro that nobody calibrated may show at rest [rad/s]."""
LAGS = np.arange(0.0, 1.01, 0.02)
"""How long after a command the wheels may follow [s]."""
MOUNTING = 0.3
"""How far a reference may sit beside the point that it stands for, in levers of the wheels."""
POSITION, HEADING = 0.002, 0.005
"""Noise that every reference has [m, rad]."""


class Drove(enum.Enum):
    """What a person says that the robot did, all through the log."""

    FORWARD = "forward"
    BACKWARD = "backward"
    LEFT = "left"
    RIGHT = "right"
    COUNTER_CLOCKWISE = "counter-clockwise"
    CLOCKWISE = "clockwise"

    @property
    def direction(self) -> tuple[int, int]:
        """Which component of the twist, and its sign."""
        return _DIRECTIONS[self]


_DIRECTIONS = {
    Drove.FORWARD: (0, 1),
    Drove.BACKWARD: (0, -1),
    Drove.LEFT: (1, 1),
    Drove.RIGHT: (1, -1),
    Drove.COUNTER_CLOCKWISE: (2, 1),
    Drove.CLOCKWISE: (2, -1),
}


@dataclass(frozen=True, slots=True)
class Label:
    """A drive that a person described.

    A car, which cannot turn on the spot, goes forward while it turns.

    Attributes:
        drove: Which way.
        amount: About how far [m], or by how much [rad]; None where nobody measured it.
    """

    drove: Drove
    amount: float | None = None

    def __post_init__(self) -> None:
        if self.amount is not None:
            require_positive("amount", self.amount)

    def check(self, drive: Kinematics) -> None:
        """Refuse what the drive cannot do.

        Raises:
            InputError: If it cannot move sideways.
        """
        component, _ = self.drove.direction
        if component == 1 and drive.constraints:
            turn = "counter-clockwise" if self.drove is Drove.LEFT else "clockwise"
            word = self.drove.value
            raise InputError(
                f"drove {word}: this drive cannot move sideways; for a turn to the {word} say {turn}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Spans of steps.

    Attributes:
        edges: First step of each span, and the end of the last; shape (spans + 1,).
        moments: Times of the edges [s], shape (spans + 1,).
        chosen: Spans that are looked at.
    """

    edges: Places
    moments: Floats
    chosen: Places

    def sums(self, steps: Floats) -> Floats:
        """Of each chosen window, the sum of its steps; shape (windows, ...)."""
        total: Floats = np.add.reduceat(steps, self.edges[:-1], axis=0)[self.chosen]
        return total

    def means(self, steps: Floats) -> Floats:
        """Of each chosen window, the mean of its steps."""
        count = np.diff(self.edges)[self.chosen]
        return self.sums(steps) / count.reshape(-1, *[1] * (steps.ndim - 1))

    @property
    def seconds(self) -> Floats:
        """How long each chosen window is [s]."""
        return np.diff(self.moments)[self.chosen]

    @property
    def share(self) -> float:
        """Of the time of all windows, what the chosen ones have."""
        return float(self.seconds.sum() / (self.moments[-1] - self.moments[0]))


@dataclass(frozen=True, slots=True, eq=False)
class Witness:
    """What somebody else says of each chosen window.

    Attributes:
        name: For people.
        moved: The displacement (x, y, theta) [m, m, rad], shape (windows, 3); NaN where it says nothing.
        relative: How far each component may be off, as a share of it.
        absolute: And besides [m, m, rad], shape (windows, 3).
    """

    name: str
    moved: Floats
    relative: float
    absolute: Floats


def windows_of(steps: WheelSteps, reference: Trajectory | None) -> Windows:
    """Spans as long as the slower of wheels and reference needs.

    Args:
        steps: Of a log.
        reference: With stamps in the log's time, or None.
    """
    period = WINDOW
    if reference is not None and len(reference) > 1:
        period = max(period, 1e-9 * float(np.median(np.diff(reference.time_ns))))
    wanted = np.arange(0.0, steps.moments[-1] + period, period)
    edges = np.unique(np.minimum(np.searchsorted(steps.moments, wanted - 1e-6), len(steps)))
    moments = steps.moments[edges]
    seconds = np.diff(moments)
    usual = max(period, float(np.median(seconds)))
    chosen = np.flatnonzero(seconds <= LONGEST * usual)
    if len(chosen) > MOST:
        chosen = chosen[np.linspace(0, len(chosen) - 1, MOST).astype(np.int64)]
    return Windows(edges, moments, chosen)


def lever_of(drive: Kinematics) -> float:
    """What turns an angle into a length: how far the wheels stand from their middle [m]."""
    *_, lever = length_scale([(w.x, w.y) for w in drive.wheels if w.kind is not WheelKind.CASTER])
    return lever


def witnesses_of(
    drive: Kinematics, log: WheelLog, steps: WheelSteps, windows: Windows
) -> tuple[Witness, ...]:
    """All who speak in a log."""
    spoken = (_gyro(log, steps, windows), _commands(drive, log, steps, windows))
    return (*(one for one in spoken if one is not None), *_reference(drive, log, steps, windows))


def _sane(values: Floats) -> Floats:
    """The values, NaN where they are no readings."""
    return np.where(np.abs(values) < LIMIT, values, np.nan)


def _integral(values: Floats, steps: WheelSteps, windows: Windows) -> Floats:
    """Rates at the usable rows: trapezoids between them, summed over windows."""
    seconds = np.diff(steps.moments).reshape(-1, *[1] * (values.ndim - 1))
    return windows.sums(0.5 * seconds * (values[1:] + values[:-1]))


def _gyro(log: WheelLog, steps: WheelSteps, windows: Windows) -> Witness | None:
    if log.yaw_rate is None:
        return None
    turn = _integral(_sane(log.yaw_rate)[steps.rows], steps, windows)
    if not np.isfinite(turn).any():
        return None
    moved = np.full((len(turn), 3), np.nan)
    moved[:, 2] = turn
    return Witness("gyro", moved, 0.03, np.outer(windows.seconds, np.full(3, BIAS)))


def _commands(drive: Kinematics, log: WheelLog, steps: WheelSteps, windows: Windows) -> Witness | None:
    """Commands come before the motion; how long before is read off the log."""
    if log.twists is None:
        return None
    twists = _later(_sane(log.twists)[steps.rows], steps, _lag(lever_of(drive), log, steps))
    moved = _integral(twists, steps, windows)
    if not np.isfinite(moved).any():
        return None
    # Where commands change, motors follow as they can.
    change = np.abs(np.diff(twists[windows.edges], axis=0))[windows.chosen]
    off = windows.seconds[:, np.newaxis] * (change + np.array([0.01, 0.01, 0.03]))
    return Witness("commands", moved, 0.08, off)


def _lag(lever: float, log: WheelLog, steps: WheelSteps) -> float:
    """How long the wheels take to do what is commanded [s].

    Amounts of motion are compared, so that signs and factors which are wrong do not matter.
    """
    assert log.twists is not None
    twists = np.nan_to_num(_sane(log.twists)[steps.rows])
    commanded = np.sqrt(twists[:, 0] ** 2 + twists[:, 1] ** 2 + (lever * twists[:, 2]) ** 2)[:, np.newaxis]
    rates = np.abs(steps.turned) / np.diff(steps.moments)[:, np.newaxis]
    rolled = np.mean(rates / np.maximum(rates.mean(axis=0), 1e-12), axis=1)
    alike = [
        _correlation(0.5 * (shifted[1:, 0] + shifted[:-1, 0]), rolled)
        for lag in LAGS
        for shifted in [_later(commanded, steps, float(lag))]
    ]
    best = int(np.argmax(alike))
    return float(LAGS[best]) if alike[best] > alike[0] + 0.005 else 0.0


def _later(values: Floats, steps: WheelSteps, lag: float) -> Floats:
    """Columns as they were this long ago; the first value before the beginning."""
    before = steps.moments - lag
    return np.stack([np.interp(before, steps.moments, column) for column in values.T], axis=-1)


def _correlation(one: Floats, other: Floats) -> float:
    a, b = one - one.mean(), other - other.mean()
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0


def _reference(drive: Kinematics, log: WheelLog, steps: WheelSteps, windows: Windows) -> Iterator[Witness]:
    reference = log.reference
    if reference is None or len(reference) < 2:
        return
    begin = log.time_ns[steps.rows[0]]
    known = np.isfinite(_sane(reference.poses[:, :2])).all(axis=1)
    stamps = 1e-9 * (reference.time_ns[known] - begin).astype(np.float64)
    if len(stamps) < 2 or not (np.diff(stamps) > 0.0).all():
        return
    poses = reference.poses[known]
    if np.isfinite(_sane(poses[:, 2])).all():
        poses = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
        at_edges = _at(windows.moments, stamps, poses)
        moved = se2.log(se2.compose(se2.inverse(at_edges[:-1]), at_edges[1:]))[windows.chosen]
        # Unwrapped headings: more than half a turn within a window is believed.
        moved[:, 2] = np.diff(at_edges[:, 2])[windows.chosen]
    elif drive.constraints:
        moved = _along_course(_at(windows.moments, stamps, poses[:, :2]))[windows.chosen]
    else:
        return
    if not np.isfinite(moved).any():
        return
    aside = POSITION + MOUNTING * lever_of(drive) * np.abs(moved[:, 2])
    yield Witness("reference", moved, 0.04, np.column_stack([aside, aside, np.full(len(moved), HEADING)]))


def _at(moments: Floats, stamps: Floats, values: Floats) -> Floats:
    """Values between their neighbours; NaN outside, and where the neighbours are far apart."""
    found = np.stack([np.interp(moments, stamps, column) for column in values.T], axis=-1)
    after = np.clip(np.searchsorted(stamps, moments), 1, len(stamps) - 1)
    gaps = stamps[after] - stamps[after - 1]
    usual = max(float(np.median(np.diff(stamps))), WINDOW)
    unknown = (moments < stamps[0] - 1e-6) | (moments > stamps[-1] + 1e-6) | (gaps > LONGEST * usual)
    found[unknown] = np.nan
    return found


def _along_course(points: Floats) -> Floats:
    """Displacements of a robot that cannot move sideways, from where a dot on it was seen.

    Its heading changes as its course does; where the course turns back by more than a quarter turn at once,
    it drives backwards. It is taken to begin forward; which way it goes on after a rest, no dot can say.
    """
    steps = np.diff(points, axis=0)
    way = np.hypot(steps[:, 0], steps[:, 1])
    moved = np.full((len(steps), 3), np.nan)
    moving = np.flatnonzero(way > 5.0 * POSITION)
    runs = np.split(moving, np.flatnonzero(np.diff(moving) > 1) + 1)
    for number, run in enumerate(runs):
        if len(run) < 3:
            continue
        course = np.arctan2(steps[run, 1], steps[run, 0])
        heading = np.unwrap(course, period=math.pi)
        inner = run[1:-1]
        moved[inner, 2] = 0.5 * (heading[2:] - heading[:-2])
        if number == 0:
            ahead = np.where(np.cos(heading - course) > 0.0, 1.0, -1.0)
            moved[inner, 0] = (ahead * way[run])[1:-1]
    return moved
