"""Whole logs to trajectories.

`integrate` is `WheelOdometry` folded over a log: rows that are plainly one step after the row before
go through arrays, every other row through `update` itself, and the state is passed on between them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from array_api_compat import is_numpy_array
from array_api_compat import numpy as standard  # the array API, on NumPy 1.26 too

from trundle.errors import InputError, LogSchema, ShapeError, Unobservable, did_you_mean
from trundle.geometry import Pose2D
from trundle.odometry import compiled, path
from trundle.odometry.covariance import ZERO, Six, outer, weighted_sum
from trundle.odometry.encoder_counts import count_differences
from trundle.odometry.error_model import ErrorModel
from trundle.odometry.frozen_wheels import FROZEN_AFTER
from trundle.odometry.integrator import Integrator, mean_rate
from trundle.odometry.slip import SlipMonitor
from trundle.odometry.slip_scan import Scan, scan_for_slip
from trundle.odometry.wheel_odometry import CLOCK_RESOLUTION_NS, Drift, Memory, WheelOdometry
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Kinematics, Robot, TrackingWheels
from trundle.robot.traced import array_library

__all__ = ["integrate", "integrate_batch", "integrate_pieces"]

Array = Any
Floats = npt.NDArray[Any]
Stamps = npt.NDArray[np.int64]

BLOCK = 12288  # rows at a time: what their arrays take fits into the second- and third-level cache
SPAN = 16384  # the same for poses alone, which take fewer arrays
NEIGHBOURS = 1 << 15  # rows before and behind that say whether a row is plain: far more than FROZEN_AFTER


def integrate(
    robot: Robot | Kinematics,
    log: WheelLog,
    *,
    covariance: bool = True,
    integrator: str | Integrator = Integrator.ARC_PLUS,
    pose: Pose2D | None = None,
    max_gap: float = 1.0,
) -> Trajectory:
    """Poses of a robot along a log; the same as `WheelOdometry.update` for every row.

    Args:
        robot: A Robot, or a drive.
        log: Wheel readings of the robot's measured wheels; or, where it has none, body twists.
        covariance: Whether to carry the covariance.
        integrator: As for `WheelOdometry`; "symmetric" as well.
        pose: Where the robot is at the first row.
        max_gap: Longest step that still counts as one motion [s].

    Returns:
        One pose per accepted row, with `rejected` and `events` counted.

    Raises:
        LogSchema: If the log lacks a wheel or steering angle that the robot measures.
        InputError: If ticks come without encoders.
    """
    if not isinstance(log, WheelLog):
        raise InputError(f"integrate: {log!r}, must be a WheelLog; read_log makes one of a file")
    way = Integrator.named(integrator)
    odometry = _odometry(robot, log, way, covariance=covariance, pose=pose, max_gap=max_gap)
    fold = _Fold(odometry, _Rows.of(odometry.drive, log), way)
    fold.run()
    return fold.trajectory(log.rejected)


def integrate_pieces(
    robot: Robot | Kinematics,
    pieces: Iterable[WheelLog],
    *,
    covariance: bool = True,
    integrator: str | Integrator = Integrator.ARC_PLUS,
    pose: Pose2D | None = None,
    max_gap: float = 1.0,
) -> Iterator[Trajectory]:
    """A log that comes in pieces, to a trajectory in pieces, in memory that does not depend on its length.

    Put together they are, to the last bit, what `integrate` makes of the pieces put together.

    Args:
        robot: A Robot, or a drive.
        pieces: Parts of one log in the order of time, alike in what they hold.
        covariance: As for `integrate`.
        integrator: As for `WheelOdometry`.
        pose: As for `integrate`.
        max_gap: As for `integrate`.

    Yields:
        Poses; `rejected` and `events` are those since the piece before.

    Raises:
        LogSchema: As for `integrate`.
        InputError: As for `integrate`; or the integrator is "symmetric", which looks at all rows at once.
    """
    way = Integrator.named(integrator)
    if way is Integrator.SYMMETRIC:
        raise InputError("integrate_pieces: symmetric looks at the whole log at once; use arc+")
    fold: _Fold | None = None
    lost: Counter[str] = Counter()
    for log in pieces:
        lost.update(log.rejected)
        if fold is None:
            odometry = _odometry(robot, log, way, covariance=covariance, pose=pose, max_gap=max_gap)
            fold = _Fold(odometry, _Rows.of(odometry.drive, log), way)
        else:
            fold.extend(_Rows.of(fold.odometry.drive, log))
        if len(fold.rows) - fold.row > 2 * NEIGHBOURS:
            fold.run(len(fold.rows) - NEIGHBOURS)
            yield fold.trajectory(lost)
            lost.clear()
    if fold is not None:
        fold.run()
        yield fold.trajectory(lost)


def _odometry(
    robot: Robot | Kinematics, log: WheelLog, way: Integrator, *, covariance: bool, **options: Any
) -> WheelOdometry:
    """What folds a log, made for what the log says."""
    described = robot if isinstance(robot, Robot) else Robot(drive=robot)
    if log.wheels is None:
        described = described.with_localizer(_twist_sensor())
    single = Integrator.ARC if way is Integrator.SYMMETRIC else way
    odometry = WheelOdometry(described, integrator=single, covariance=covariance, **options)
    if log.wheels is None:
        odometry.standstill = None  # what turns in a published twist is no gyro, and has no bias
    if log.reading is Reading.TICKS and log.wheels is not None:
        odometry.encoders = described.encoders_of(odometry.drive.measured_names)
    return odometry


def _twist_sensor() -> Kinematics:
    """What a robot that publishes its own twist amounts to: two tracking wheels and a gyro at one point."""
    places = {"vx": (0.0, 0.0, 0.0), "vy": (0.0, 0.0, math.pi / 2)}
    return TrackingWheels(places, wheel_radius=1.0, measured=("vx", "vy", "gyro"))


@dataclass(frozen=True, slots=True)
class _Rows:
    """The columns that a drive reads, in its order."""

    time_ns: npt.NDArray[np.int64]
    reading: Reading
    wheels: Sequence[npt.NDArray[Any]]
    steering: Sequence[Floats] = ()
    yaw_rate: Floats | None = None

    @classmethod
    def of(cls, drive: Kinematics, log: WheelLog) -> _Rows:
        if log.wheels is None:
            assert log.twists is not None  # WheelLog has one or the other
            vx, vy, omega = log.twists.T
            return cls(log.time_ns, Reading.VELOCITY, (vx, vy), (), omega)
        wheels = _pick("wheel", drive.measured_names, log.wheel_names, log.wheels, log.source)
        steering: Sequence[Floats] = ()
        if drive.steered_names:
            names, angles = log.steering_names, log.steering
            if angles is not None and len(names) == 1 < len(drive.steered_names):
                steering = drive.expand_steering([angles[:, 0]], standard)
            elif angles is not None and len(names) == 1:
                steering = [angles[:, 0]]
            else:
                steering = _pick("steering angle", drive.steered_names, names, angles, log.source)
        return cls(log.time_ns, log.reading, wheels, steering, log.yaw_rate if drive.gyro else None)

    def __len__(self) -> int:
        return len(self.time_ns)

    def followed_by(self, later: _Rows, *, since: int) -> _Rows:
        """These rows from one of them on, and later ones."""

        def joined(one: Floats, other: Floats) -> Floats:
            return np.concatenate([one[since:], other])

        both = None if self.yaw_rate is None or later.yaw_rate is None else (self.yaw_rate, later.yaw_rate)
        return _Rows(
            joined(self.time_ns, later.time_ns),
            self.reading,
            [joined(*columns) for columns in zip(self.wheels, later.wheels, strict=True)],
            [joined(*columns) for columns in zip(self.steering, later.steering, strict=True)],
            None if both is None else joined(*both),
        )

    def turned(self, k: int, rows: slice, odometry: WheelOdometry) -> Array:
        """What wheel k turned [rad] in each of the rows since the row before it."""
        column = self.wheels[k]
        now, then = column[rows], column[rows.start - 1 : rows.stop - 1]
        if self.reading is Reading.INCREMENT:
            return now
        if self.reading is Reading.TICKS:
            encoder = odometry.encoders[k]
            return count_differences(now, then, encoder.bits) * encoder.radians_per_tick
        if self.reading is Reading.VELOCITY:
            return 0.5 * self.seconds(rows) * (now + then)
        return now - then

    def seconds(self, rows: slice) -> Floats:
        """How long each step took."""
        return (self.time_ns[rows] - self.time_ns[rows.start - 1 : rows.stop - 1]) * 1e-9

    def plain(self, odometry: WheelOdometry) -> npt.NDArray[np.bool_]:
        """Whether each row is beyond doubt one step after the row before it."""
        count = len(self)
        good = np.zeros(count, dtype=bool)
        if count < 2:
            return good
        elapsed = np.diff(self.time_ns)
        sound = self._sound(odometry)
        good[1:] = (
            (elapsed >= CLOCK_RESOLUTION_NS) & (elapsed <= odometry.max_gap_ns) & sound[1:] & sound[:-1]
        )
        rows, seconds = slice(1, count), elapsed * 1e-9
        with np.errstate(invalid="ignore", over="ignore"):
            turned = [self.turned(k, rows, odometry) for k in range(len(self.wheels))]
            judged: Sequence[Floats] = turned
            if self.reading is Reading.VELOCITY:
                judged = [column[1:] * seconds for column in self.wheels]
            for way, (rate, slack) in zip(judged, odometry.plausible.bounds, strict=True):
                good[1:] &= np.abs(way) <= rate * seconds + slack
            if self.reading is Reading.TICKS:
                for k, encoder in enumerate(odometry.encoders):
                    if encoder.bits is not None:
                        half_range = abs(encoder.radians_per_tick) * 2.0 ** (encoder.bits - 1)
                        good[1:] &= np.abs(turned[k]) < half_range
                        good[1:] &= odometry.plausible.declared[k] * seconds < half_range
        self._leave_standing(odometry, turned, elapsed, good)
        return good

    def _leave_standing(
        self, odometry: WheelOdometry, turned: Sequence[Floats], elapsed: Stamps, good: npt.NDArray[np.bool_]
    ) -> None:
        """Rows of a robot or of a wheel that stands are for `update`, which learns from them."""
        sound, standing = good[1:].copy(), np.zeros(len(elapsed), dtype=bool)
        standstill = odometry.standstill
        if standstill is not None and self.yaw_rate is not None:
            standing |= np.all(
                [np.abs(way) <= tick for way, tick in zip(turned, standstill.ticks, strict=True)], axis=0
            )
            standing[1:] |= standing[:-1].copy()  # the step that ends it as well
        if odometry.frozen is not None and odometry.frozen.redundant:
            moving = np.any([way != 0.0 for way in turned], axis=0) | ~sound
            for way in turned:
                standing |= _long_runs((way == 0.0) | ~sound, elapsed) & moving
        good[1:] &= ~standing

    def _sound(self, odometry: WheelOdometry) -> npt.NDArray[np.bool_]:
        """Whether every number of a row is finite, and every steering angle possible."""
        sound = np.ones(len(self), dtype=bool)
        for column in (*self.wheels, *(() if self.yaw_rate is None else (self.yaw_rate,))):
            if column.dtype.kind == "f":
                sound &= np.isfinite(column)
        if self.yaw_rate is not None:
            with np.errstate(invalid="ignore"):
                sound &= np.abs(self.yaw_rate) <= odometry.plausible.yaw_rate
        for bounds, column in zip(odometry.drive.steering_bounds, self.steering, strict=True):
            with np.errstate(invalid="ignore"):
                sound &= bounds.hold(column, np)
        return sound


class _Fold:
    """One pass over the rows of a log."""

    def __init__(self, odometry: WheelOdometry, rows: _Rows, integrator: Integrator) -> None:
        self.odometry = odometry
        self.integrator = integrator
        self.row = 0  # the first that is not folded yet
        self._in_step = False
        self._counted: dict[str, Counter[str]] = {}
        self.rows = rows

    def extend(self, later: _Rows) -> None:
        """More rows of the same log; of those that are folded only the neighbours stay."""
        since = max(self.row - NEIGHBOURS, 0)
        self.row -= since
        self.rows = self.rows.followed_by(later, since=since)

    def run(self, limit: int | None = None) -> None:
        """Fold everything; or up to a row that has as many behind it as it takes to judge it."""
        odometry, count = self.odometry, len(self.rows)
        limit = count if limit is None else limit
        left = count - self.row
        self.time_ns = np.empty(left, dtype=np.int64)
        self.poses, self.twists = np.empty((left, 3)), np.empty((left, 3))
        self.covariances = None if odometry.errors is None else np.empty((left, 3, 3))
        self.filled = 0
        plain = self.rows.plain(odometry)
        # For each row, where the run of plain rows that it belongs to ends.
        ends = np.append(np.flatnonzero(~plain), count)
        while self.row < limit:
            row = self.row
            if self._in_step and plain[row] and not odometry.stuck:
                stop = int(ends[np.searchsorted(ends, row)])
                if self.integrator is not Integrator.SYMMETRIC:
                    stop = min(stop, row + BLOCK)
                if done := self._block(slice(row, stop)):
                    self.row += done
                    continue
            self._in_step = self._single(row)
            self.row += 1

    def _single(self, row: int) -> bool:
        rows = self.rows
        reading: dict[str, Any] = {_ARGUMENT[rows.reading]: [column[row].item() for column in rows.wheels]}
        state = self.odometry.update(
            time_ns=int(rows.time_ns[row]),
            steering=[float(column[row]) for column in rows.steering],
            yaw_rate=None if rows.yaw_rate is None else float(rows.yaw_rate[row]),
            **reading,
        )
        if state.accepted:
            at, self.filled = self.filled, self.filled + 1
            self.time_ns[at] = state.time_ns
            self.poses[at] = state.pose.x, state.pose.y, state.pose.theta
            self.twists[at] = state.twist.vx, state.twist.vy, state.twist.omega
            if self.covariances is not None:
                self.covariances[at] = state.covariance
        return state.accepted

    def _block(self, rows: slice) -> int:
        """Fold a run of plain rows as arrays, up to what only `update` can judge; returns how many."""
        odometry, data = self.odometry, self.rows
        drive, memory = odometry.drive, odometry.memory
        seconds = data.seconds(rows)
        bias = 0.0 if odometry.standstill is None else odometry.standstill.bias
        turned = self._turned(rows, seconds)
        before = slice(rows.start - 1, rows.stop - 1)
        middle = [_midway(column[before], column[rows]) for column in data.steering]
        turn = None
        if data.yaw_rate is not None:
            turn = self._swept(data.yaw_rate, rows, seconds, memory.earlier_yaw_rate) - bias * seconds
        try:
            step = drive.displacement(turned, middle, turn, np)
        except (Unobservable, InputError):  # the latter where it takes a gyro
            return 0
        step = [np.broadcast_to(part, seconds.shape) for part in step]
        if odometry.slip is not None:
            scan = self._scan(odometry.slip, turned, middle, turn, seconds, step)
            if scan.alarm is not None:
                return self._block(slice(rows.start, rows.start + scan.alarm)) if scan.alarm else 0
            scan.hand_over(odometry.slip)

        raw = step
        previous = None
        if memory.before is not None and self.integrator is Integrator.ARC_PLUS:
            previous = [np.array([part]) for part in (*memory.before, memory.before_ns * 1e-9)]
        step = path.corrected(standard, step, seconds, self.integrator, previous)
        pose = path.poses(standard, step, self.integrator, memory.pose)
        out = slice(self.filled, self.filled + len(seconds))
        self.filled = out.stop
        self.time_ns[out] = data.time_ns[rows]
        for k, column in enumerate(pose):
            self.poses[out, k] = column
        if data.reading is Reading.VELOCITY:
            speeds = [column[rows] for column in data.wheels]
            rate = None if data.yaw_rate is None else data.yaw_rate[rows] - bias
            twist = drive.displacement(speeds, [column[rows] for column in data.steering], rate, np)
        else:
            twist = [part / seconds for part in raw]
        for k, column in enumerate(twist):
            self.twists[out, k] = column
        upper, quantum, drifts, surprise, settled = ZERO, ZERO, memory.drifts, ZERO, False
        if odometry.errors is not None:
            readings = (turned, middle, raw, seconds, turn)
            upper, quantum, drifts, surprise, settled = self._uncertainty(
                out, odometry.errors, memory, readings, step, pose
            )
        last = rows.stop - 1
        odometry.resume(
            count=len(seconds),
            time_ns=int(data.time_ns[last]),
            reading=[column[last].item() for column in data.wheels],
            steering=[float(column[last]) for column in data.steering],
            yaw_rate=None if data.yaw_rate is None else float(data.yaw_rate[last]),
            memory=Memory(
                pose=tuple(float(column[-1]) for column in pose),
                twist=tuple(self.twists[out.stop - 1].tolist()),
                upper=upper,
                before=tuple(float(part[-1]) for part in raw),
                before_ns=int(data.time_ns[last] - data.time_ns[last - 1]),
                earlier=[column[last - 1].item() for column in data.wheels],
                earlier_yaw_rate=None if data.yaw_rate is None else float(data.yaw_rate[last - 1]),
                quantum=quantum,
                drifts=drifts,
                surprise=surprise,
                settled=settled,
                past=_latest(memory, (*raw, seconds)),
            ),
        )
        return len(seconds)

    def _scan(
        self,
        monitor: SlipMonitor,
        turned: Sequence[Floats],
        middle: Sequence[Floats],
        turn: Floats | None,
        seconds: Floats,
        step: Sequence[Floats],
    ) -> Scan:
        if (turn is not None) is not monitor.gyro:
            monitor.gyro = turn is not None
            monitor.restart()
        standstill = self.odometry.standstill
        doubt = 0.0 if standstill is None else standstill.doubt
        parts = monitor.parts(turned, middle, turn, seconds, step, np)
        return scan_for_slip(monitor, parts, len(seconds), doubt)

    def _turned(self, rows: slice, seconds: Floats) -> list[Floats]:
        """What each wheel turned [rad] in each of the rows, as `update` sees it."""
        data, memory = self.rows, self.odometry.memory
        if data.reading is not Reading.VELOCITY:
            return [data.turned(k, rows, self.odometry) for k in range(len(data.wheels))]
        earlier: Sequence[float | None] = memory.earlier or [None] * len(data.wheels)
        return [
            self._swept(column, rows, seconds, first)
            for column, first in zip(data.wheels, earlier, strict=True)
        ]

    def _swept(self, rates: Floats, rows: slice, seconds: Floats, first: float | None) -> Floats:
        """Integral of a rate over each of the rows; `first` is its sample before the first of them."""
        now, then = rates[rows], rates[rows.start - 1 : rows.stop - 1]
        trapezoid: Floats = 0.5 * seconds * (then + now)
        memory = self.odometry.memory
        if self.integrator is not Integrator.ARC_PLUS:
            return trapezoid
        known = memory.before is not None and first is not None
        h0 = np.concatenate([[memory.before_ns * 1e-9 if known else seconds[0]], seconds[:-1]])
        earlier = np.concatenate([[first if known else then[0]], then[:-1]])
        swept: Floats = seconds * mean_rate(earlier, then, now, h0, seconds)
        if not known:
            swept[0] = trapezoid[0]
        return swept

    def _uncertainty(
        self,
        out: slice,
        errors: ErrorModel,
        memory: Memory,
        readings: Sequence[Any],
        step: Sequence[Floats],
        pose: Sequence[Floats],
    ) -> tuple[Six, Six, Sequence[Drift], Six, bool]:
        """Covariances of a block; returned is what the next step needs of them."""
        turned, middle, raw, seconds, turn = readings
        gains = errors.gains(middle, turn is not None, np)
        noise = errors.noise(gains, turned, raw, seconds, turn is not None, np)
        gyro = None if turn is None else gains[0].gyro[0]
        noise, owed, settled = self._surprises(noise, memory, (*raw, seconds), gyro)
        changes = errors.drift(gains, turned, raw, turn) if memory.drifts else ()
        found = path.covariances(
            standard, step, noise, pose, memory.upper, memory.pose, changes, memory.drifts
        )
        assert self.covariances is not None
        for (i, j), column, tick, glitch in zip(_UPPER, found.upper, gains[2], owed, strict=True):
            self.covariances[out, i, j] = self.covariances[out, j, i] = column + (tick + glitch)
        drifts = [(float(x), float(y), float(t)) for x, y, t in found.drifts]
        last = _last(owed)
        return _last(found.independent), _last(gains[2]), drifts, last if any(last) else ZERO, settled

    def _surprises(
        self, noise: Six, memory: Memory, step: Sequence[Floats], gyro: Sequence[Any] | None
    ) -> tuple[Six, Six, bool]:
        """The noise with what glitches add to it; what the pose owes them, if there are any (S13).

        And whether the last of them is settled. `WheelOdometry._doubted` for a run of steps.
        """
        surprise = self.odometry.surprise
        assert surprise is not None
        before = [_shifted(one, part) for one, part in zip(memory.past[0], step, strict=True)]
        off, strange = surprise.of(step[:3], before[:3], step[3], before[3])
        if memory.surprise is ZERO and not strange.any():
            return noise, ZERO, False
        off = [np.where(strange, part, 0.0) for part in off]
        if self.rows.reading in (Reading.INCREMENT, Reading.VELOCITY):
            return weighted_sum((1.0, 1.0), (noise, outer(off))), ZERO, False
        if gyro is not None:
            lasting, off = surprise.by_gyro(off, gyro)
            noise = weighted_sum((1.0, 1.0), (noise, outer(lasting)))
        owed = surprise.on_pose(off, step[:3])
        past = _earlier(memory, step)
        taken_back = surprise.taken_back(step, past)
        settled = taken_back | surprise.resumed(step, past)
        then: Any = [_shifted(one, part) for one, part in zip(memory.surprise, owed, strict=True)]
        stays: Any = ~(taken_back | _shifted(memory.settled, settled))
        noise = weighted_sum((1.0, stays), (noise, then))
        turned: Any = owed[5]
        return surprise.detour(noise, turned + then[5], step[:3]), owed, bool(settled[-1])

    def trajectory(self, lost: Mapping[str, int]) -> Trajectory:
        """What came of the last run; `lost` are rows that never reached us."""
        rejected = self._since("rejected", self.odometry.rejected)
        rejected.update(lost)
        return Trajectory(
            time_ns=self.time_ns[: self.filled],
            poses=self.poses[: self.filled],
            twists=self.twists[: self.filled],
            covariances=None if self.covariances is None else self.covariances[: self.filled],
            rejected=rejected,
            events=self._since("events", self.odometry.events),
        )

    def _since(self, what: str, counts: Mapping[str, int]) -> Counter[str]:
        """What has been counted since the last time."""
        new = Counter(counts) - self._counted.get(what, Counter())
        self._counted[what] = Counter(counts)
        return new


def integrate_batch(
    robot: Robot | Kinematics,
    positions: Array,
    time_ns: Array | None = None,
    steering: Array | None = None,
    integrator: str | Integrator = Integrator.ARC_PLUS,
    out: Array | None = None,
) -> Array:
    """Poses from wheel positions, for many robots at once, on any array library; nothing is checked.

    Differentiable where the library is, in the positions and in the numbers that the drive was made
    with. Much NumPy input goes through Numba where that is installed (extra `fast`): see `compiled`.

    Args:
        robot: A Robot, or a drive: that of all of them.
        positions: Cumulative wheel angles [rad], shape (..., steps, measured).
        time_ns: Stamps [ns], shape (steps,); without them all steps take equally long.
        steering: Angles at the stamps [rad], shape (..., steps, steered); or (steps, steered), alike for all.
        integrator: As for `WheelOdometry`; "symmetric" as well.
        out: NumPy only: array of shape (..., steps, 3) to write to.

    Returns:
        Poses (x, y, theta), shape (..., steps, 3), beginning with the origin.

    Raises:
        ShapeError: If shapes do not fit.
        InputError: If something is no array; or `out` is given and not of floats, or not beside NumPy's.
        Unobservable: If at some steering angles the motion cannot be observed.
    """
    described = robot if isinstance(robot, Robot) else Robot(drive=robot)
    drive = described.measuring
    given = {"positions": positions, "time_ns": time_ns, "steering": steering}
    xp, *_ = [array_library(name, array) for name, array in given.items() if array is not None]
    way = Integrator.named(integrator)
    drive.check_batch(positions, steering)
    if positions.ndim < 2:
        raise ShapeError(f"positions: shape {tuple(positions.shape)}, must be (..., steps, measured)")
    if time_ns is not None and time_ns.shape != positions.shape[-2:-1]:
        raise ShapeError(f"time_ns: shape {tuple(time_ns.shape)}, must be ({positions.shape[-2]},)")
    if steering is not None and not _leads(steering.shape[:-1], positions.shape[:-1]):
        leading = ", ".join(map(str, positions.shape[:-1]))
        problem = f"must be ({leading}, angles), or ({positions.shape[-2]}, angles) for all alike"
        raise ShapeError(f"steering: shape {tuple(steering.shape)}, {problem}")
    if is_numpy_array(positions):
        return _on_numpy(drive, positions, time_ns, steering, way, out)
    if out is not None:
        raise InputError("integrate_batch: out= is for NumPy arrays")
    x, y, theta, _ = _walk(xp, drive, positions, time_ns, steering, way)
    start = xp.zeros_like(x[..., :1])
    columns = [xp.concat([start, part], axis=-1) for part in (x, y, theta)]
    return xp.stack(columns, axis=-1)


def _leads(shape: Sequence[int], wanted: Sequence[int]) -> bool:
    """Whether angles (shape without the last axis) belong to these rows: to all, or to the steps alone."""
    return tuple(shape) in (tuple(wanted), tuple(wanted[-1:]))


def _walk(
    xp: Any,
    drive: Kinematics,
    positions: Array,
    time_ns: Array | None,
    steering: Array | None,
    way: Integrator,
    start: Sequence[Any] = (0.0, 0.0, 0.0),
    before: Sequence[Any] | None = None,
) -> tuple[Array, Array, Array, Sequence[Array] | None]:
    """Poses after each step, and of the last step what the next one needs."""
    step = _steps(xp, drive, positions, steering)
    elapsed = None
    if time_ns is not None:
        elapsed = xp.astype(time_ns[1:] - time_ns[:-1], step[0].dtype)
    last = None
    if way is Integrator.ARC_PLUS:
        last = [part[..., -1:] for part in (*step, step[2] if elapsed is None else elapsed)]
    step = path.corrected(xp, step, elapsed, way, before)
    return (*path.poses(xp, step, way, start), last)


def _steps(xp: Any, drive: Kinematics, positions: Array, steering: Array | None) -> Sequence[Array]:
    """Body displacements (x, y, theta) between the rows."""
    turned = [positions[..., 1:, k] - positions[..., :-1, k] for k in range(positions.shape[-1])]
    angles = [] if steering is None else [steering[..., k] for k in range(steering.shape[-1])]
    if len(angles) != len(drive.steered_names):
        angles = list(drive.expand_steering(angles, xp))
    middle = [_midway(angle[..., :-1], angle[..., 1:], xp) for angle in angles]
    return drive.displacement(turned, middle, None, xp)


def _on_numpy(
    drive: Kinematics,
    positions: Floats,
    time_ns: Array | None,
    steering: Floats | None,
    way: Integrator,
    out: Floats | None,
) -> Floats:
    shape = (*positions.shape[:-1], 3)
    if out is None:
        out = np.empty(shape)
    elif not is_numpy_array(out) or out.dtype.kind != "f":
        raise InputError("integrate_batch: out= must be a NumPy array of floats")
    elif out.shape != shape:
        raise ShapeError(f"out: shape {out.shape}, must be {shape}")
    if np.may_share_memory(out, positions):  # which are read after poses are written
        positions = positions.copy()
    steps, robots = shape[-2], math.prod(shape[:-2])
    if not out.size:
        return out
    if steering is not None:
        steering = np.broadcast_to(steering, (*positions.shape[:-1], steering.shape[-1]))
    flat, poses = positions.reshape(robots, steps, -1), out.reshape(robots, steps, 3)
    angles = None if steering is None else steering.reshape(robots, steps, -1)
    if _may_be_compiled(flat, poses, way):
        _compiled(drive, flat, time_ns, angles, way, poses)
    else:
        _in_blocks(drive, flat, time_ns, angles, way, poses)
    if not np.may_share_memory(out, poses):  # it could not be reshaped in place
        out[...] = poses.reshape(shape)
    return out


def _blocks(robots: int, steps: int, span: int) -> Iterator[tuple[slice, list[slice]]]:
    """Groups of robots, and the rows to take at a time: what their arrays take fits into the cache.

    Blocks of rows share their end points.
    """
    size = max(1, SPAN // max(min(steps, span), 1))
    rows = [slice(row, min(row + span, steps - 1) + 1) for row in range(0, steps - 1, span)]
    for first in range(0, robots, size):
        yield slice(first, first + size), rows


def _in_blocks(
    drive: Kinematics,
    positions: Floats,
    time_ns: Array | None,
    steering: Floats | None,
    way: Integrator,
    poses: Floats,
) -> None:
    """The walk by arrays; the state is passed on from block to block."""
    robots, steps, _ = positions.shape
    # The symmetric correction looks ahead, so its steps stay together.
    span = max(steps, 1) if way is Integrator.SYMMETRIC else SPAN
    poses[:, :1] = 0.0
    for group, blocks in _blocks(robots, steps, span):
        start: Sequence[Any] = (0.0, 0.0, 0.0)
        before = None
        for rows in blocks:
            times = None if time_ns is None else time_ns[rows]
            angles = None if steering is None else steering[group, rows]
            *columns, before = _walk(
                standard, drive, positions[group, rows], times, angles, way, start, before
            )
            for k, part in enumerate(columns):
                poses[group, rows.start + 1 : rows.stop, k] = part
            start = tuple(part[:, -1:] for part in columns)


def _may_be_compiled(positions: Floats, poses: Floats, way: Integrator) -> bool:
    return (
        math.prod(positions.shape[:2]) >= compiled.FEWEST
        and way is not Integrator.SYMMETRIC
        and positions.dtype == poses.dtype == np.float64
        and poses.flags.c_contiguous
        and compiled.available()
    )


def _compiled(
    drive: Kinematics,
    positions: Floats,
    time_ns: Array | None,
    steering: Floats | None,
    way: Integrator,
    poses: Floats,
) -> None:
    """The walk by Numba: from the wheels where one matrix serves for all steps, else from the body."""
    if not drive.steered_names and not drive.gyro:
        units = np.eye(positions.shape[-1]).tolist()
        compiled.walk([drive.displacement(unit) for unit in units], positions, time_ns, way, poses)
        return
    robots, steps, _ = positions.shape
    body = np.zeros((robots, steps, 3))
    for group, blocks in _blocks(robots, steps, SPAN):
        for rows in blocks:
            angles = None if steering is None else steering[group, rows]
            for k, part in enumerate(_steps(standard, drive, positions[group, rows], angles)):
                column = body[group, rows, k]
                column[:, 1:] = column[:, :1] + np.cumsum(part, axis=-1)
    compiled.walk(np.eye(3).tolist(), body, time_ns, way, poses)


def _earlier(memory: Memory, step: Sequence[Floats]) -> list[Sequence[Floats]]:
    """For each step the one before it, the one before that, and before that; NaN where there was none."""
    found = [step]
    for first in memory.past:
        found.append([_shifted(one, part) for one, part in zip(first, found[-1], strict=True)])
    return found[1:]


def _latest(memory: Memory, step: Sequence[Floats]) -> Sequence[Sequence[float]]:
    """The last three steps of all."""
    count = min(len(step[0]), len(memory.past))
    return [*([float(part[-k]) for part in step] for k in range(1, count + 1)), *memory.past][
        : len(memory.past)
    ]


def _shifted(first: Any, column: Any) -> Floats:
    return np.concatenate([[first], column[:-1]])


def _last(six: Six) -> Six:
    if six is ZERO:
        return ZERO
    xx, xy, yy, xt, yt, tt = (float(np.atleast_1d(part)[-1]) for part in six)
    return (xx, xy, yy, xt, yt, tt)


def _pick(
    what: str, wanted: Sequence[str], names: Sequence[str], columns: Floats | None, source: str
) -> list[Floats]:
    """The wanted columns in the wanted order."""
    chosen = []
    for name in wanted:
        if columns is None or name not in names:
            raise LogSchema(source or "log", what, f"no {what} {name!r}; {did_you_mean(name, names)}")
        chosen.append(columns[:, list(names).index(name)])
    return chosen


def _long_runs(flags: npt.NDArray[np.bool_], elapsed: Stamps) -> npt.NDArray[np.bool_]:
    """The flags of runs that may last long enough to make a wheel suspect, and the step after each."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0))
    starts, ends = edges[::2], edges[1::2]
    clock = np.concatenate([[0], np.cumsum(np.abs(elapsed))])  # whole numbers: the same wherever it begins
    lasting = clock[ends] - clock[starts] > round(0.9e9 * FROZEN_AFTER)
    marks = np.zeros(len(flags) + 2, dtype=np.int64)
    np.add.at(marks, starts[lasting], 1)
    np.add.at(marks, ends[lasting] + 1, -1)
    return np.cumsum(marks)[: len(flags)] > 0


def _midway(then: Array, now: Array, xp: Any = np) -> Array:
    """Steering angles at the middle of the step, by the shorter way round."""
    change = now - then
    return then + 0.5 * (change - math.tau * xp.round(change / math.tau))


_UPPER = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
_ARGUMENT = {
    Reading.POSITION: "positions",
    Reading.INCREMENT: "increments",
    Reading.VELOCITY: "velocities",
    Reading.TICKS: "ticks",
}
