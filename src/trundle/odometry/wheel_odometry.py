"""Wheel odometry, one sample at a time.

What happens to each sample is promised in FAULTS.md, rows S1 to S26. Nothing here raises because of
what a sensor said: a sample that cannot be true is refused and counted, and the next one bridges it.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from math import cos, hypot, isfinite, remainder, sin, tau
from operator import sub
from typing import Any, NamedTuple

import msgspec

from trundle.errors import InputError, ShapeError, Unobservable, require_numbers, require_positive, shown
from trundle.geometry import Pose2D, Twist2D
from trundle.odometry.covariance import (
    ZERO,
    Matrix,
    Six,
    in_odom_frame,
    is_covariance,
    matrix,
    mean_offset,
    outer,
    propagate,
    rotated,
    weighted_sum,
    within_circle,
)
from trundle.odometry.encoder_counts import count_difference, whole_count
from trundle.odometry.error_model import ErrorModel
from trundle.odometry.frozen_wheels import FrozenWheels, Spare
from trundle.odometry.integrator import Integrator, mean_rate
from trundle.odometry.plausibility import Plausibility
from trundle.odometry.slip import slip_monitor
from trundle.odometry.standstill import Standstill
from trundle.odometry.surprise import Surprise
from trundle.records import Reading
from trundle.robot import Encoder, Kinematics, Robot, WheelCommand
from trundle.robot.rows import rolling
from trundle.robot.solver import Gains

__all__ = ["CLOCK_RESOLUTION_NS", "Drift", "Memory", "OdometryState", "WheelOdometry"]

Numbers = Sequence[float]
Drift = tuple[float, float, float]

LAST_NS = 2**63 - 1  # logs hold stamps in as many bits
CLOCK_RESOLUTION_NS = 1_000  # S5: nothing is divided by less
CLOCK_RESET_NS = 1_000_000_000  # S6: time that goes back by more belongs to a new clock
FOLD = 256  # steps that are summed before they are added to the sums of all
LEAST_LEVER = 0.01  # a wheel that rolls less per radian that the robot turns on the spot does not show it [m]
PATIENCE = 3  # S12: this many implausible samples in a row are the new normal


# Members of an Enum are looked up slowly in Python 3.11, and these are needed for every sample.
POSITION, VELOCITY, INCREMENT, TICKS = Reading.POSITION, Reading.VELOCITY, Reading.INCREMENT, Reading.TICKS


class OdometryState(msgspec.Struct, frozen=True, gc=False):
    """What is known after a sample.

    Attributes:
        time_ns: Stamp of the last accepted sample [ns].
        pose: Of the robot in the odom frame.
        twist: Body twist, the mean over the last step (from velocities: at its end).
        accepted: Whether this sample counted.
        reason: Why not; or what happened although it did ("baseline", "gap", ...); "" as a rule.
        upper: Upper triangle of the covariance: xx, xy, yy, x-theta, y-theta, theta-theta.
    """

    time_ns: int
    pose: Pose2D
    twist: Twist2D
    accepted: bool
    reason: str
    upper: Six = ZERO

    @property
    def covariance(self) -> Matrix:
        """Covariance of the body-frame error e in `true = pose @ exp(e)`, order (x, y, theta)."""
        return matrix(self.upper)

    @property
    def odom_covariance(self) -> Matrix:
        """The same with x and y along the axes of the odom frame, for messages that want that."""
        return matrix(in_odom_frame(self.upper, self.pose.theta))

    @property
    def mean_position(self) -> tuple[float, float]:
        """Mean of where the robot may be [m]: behind the pose, since every wrong heading is a detour."""
        x, y = mean_offset(self.upper, self.pose.theta)
        return self.pose.x + x, self.pose.y + y


NO_PAST: Sequence[Numbers] = ((math.nan,) * 4,) * 3


class Memory(NamedTuple):
    """What the next step needs of the last one besides its reading.

    Attributes:
        pose: x, y and heading, not wrapped.
        twist: vx, vy, omega.
        upper: Upper triangle of the covariance.
        before: Displacement of the last step as measured, for the commutator; None after a break.
        before_ns: Its duration.
        earlier: Reading at its beginning; and the gyro's.
        quantum: What being anywhere within a tick makes uncertain.
        drifts: What errors of the description have done so far, seen from the odom frame.
        surprise: What the last step may owe to a glitch that the counters will take back.
        settled: Whether it is part of how an earlier glitch was taken back.
        past: The last three steps (x, y, theta, seconds), latest first; NaN where there was none.
    """

    pose: tuple[float, ...]
    twist: tuple[float, ...]
    upper: Six
    before: Sequence[float] | None
    before_ns: int
    earlier: Numbers = ()
    earlier_yaw_rate: float | None = None
    quantum: Six = ZERO
    drifts: Sequence[Drift] = ()
    surprise: Six = ZERO
    settled: bool = False
    past: Sequence[Numbers] = NO_PAST


class WheelOdometry:
    """Turns wheel readings into poses, live.

    Args:
        robot: A drive, or a Robot, whose limits say what is plausible and whose noise is used.
        integrator: "arc+", "arc", "midpoint" or "euler".
        pose: Where the robot is at the first sample.
        covariance: Whether to carry the covariance; without it an update takes a fraction of the
            time, the covariance stays zero, and nobody watches for slip and stuck wheels.
        max_gap: Longest step that still counts as one motion [s].

    Attributes:
        robot: What it was made for.
        drive: The wheels that measure.
        accepted: Samples that counted.
        rejected: The others, by reason.
        events: What happened on the way (gap, rebaseline, clock_reset, slip, stuck_wheel, ...), by name.
        state: The state after the last sample.
        standstill: Knows the gyro's bias; None without a gyro, or with wheels that do not roll when it turns.
        slip: Watches whether the wheels contradict each other; None where they cannot.
        frozen: Watches for encoders that stand still.
        surprise: Knows which steps no body makes so soon after the one before.

    Raises:
        ConfigError: If the integrator is unknown, or `max_gap` not above zero.
    """

    __slots__ = (
        "_before",
        "_before_ns",
        "_bounded",
        "_chord",
        "_chosen",
        "_commutes",
        "_count",
        "_covariance",
        "_displacement",
        "_drift_count",
        "_drifts",
        "_earlier",
        "_earlier_yaw_rate",
        "_far_x",
        "_far_y",
        "_has_gyro",
        "_kind",
        "_lead",
        "_lost",
        "_low",
        "_more",
        "_needs_gyro",
        "_past",
        "_quantum",
        "_reading",
        "_settled",
        "_spare",
        "_special",
        "_steered",
        "_steering",
        "_step_noise",
        "_step_seconds",
        "_steps",
        "_strikes",
        "_stuck",
        "_surely",
        "_surprise",
        "_suspects",
        "_theta",
        "_time_ns",
        "_toward",
        "_turns",
        "_twist",
        "_unheard_way",
        "_whole",
        "_x",
        "_y",
        "_yaw_rate",
        "accepted",
        "drive",
        "encoders",
        "errors",
        "events",
        "frozen",
        "integrator",
        "max_gap_ns",
        "plausible",
        "rejected",
        "robot",
        "slip",
        "standstill",
        "state",
        "surprise",
    )

    def __init__(
        self,
        robot: Kinematics | Robot,
        *,
        integrator: str | Integrator = Integrator.ARC_PLUS,
        pose: Pose2D | None = None,
        covariance: bool = True,
        max_gap: float = 1.0,
    ) -> None:
        self.robot = robot if isinstance(robot, Robot) else Robot(drive=robot)
        self.drive = self.robot.measuring
        self.integrator = Integrator.named(integrator)
        if self.integrator is Integrator.SYMMETRIC:
            raise InputError("integrator 'symmetric' needs the step after as well: use integrate on a log")
        self._commutes = self.integrator is Integrator.ARC_PLUS
        self._chord = self.integrator in (Integrator.ARC, Integrator.ARC_PLUS)
        self._lead = 0.0 if self.integrator is Integrator.EULER else 0.5
        self.max_gap_ns = round(min(require_positive("max_gap", max_gap) * 1e9, LAST_NS))
        self.errors = ErrorModel(self.drive, self.robot.noise, self.robot.encoders) if covariance else None
        self._whole = self.errors  # of all wheels, where some are stuck
        self._drift_count = 0 if self.errors is None else self.errors.drifts
        angles, lengths = _tick_sizes(self.robot)
        self.slip = slip_monitor(self.drive, self.robot.noise, lengths) if covariance else None
        self.frozen = FrozenWheels(self.drive, self.robot.noise, lengths) if covariance else None
        self.surprise = Surprise(self.robot, lengths) if covariance else None
        still = self.drive.gyro and _shows_turning(self.drive)
        self.standstill = Standstill(angles, self.robot.noise.gyro) if still else None
        self._stuck: tuple[int, ...] = ()
        self._suspects = False
        self._chosen: Sequence[int] = range(len(self.drive.measured_names))
        self._spare: Spare | None = None
        self._unheard_way = 0.0
        self.plausible = Plausibility(self.robot)
        self._surely = min(rate for rate, _ in self.plausible.bounds)
        self._count = len(self.drive.measured_names)
        self._steered = len(self.drive.steered_names)
        self._bounded = [
            (index, bounds)
            for index, bounds in enumerate(self.drive.steering_bounds)
            if bounds.leaning or isfinite(bounds.greatest - bounds.least)
        ]
        self.encoders: tuple[Encoder, ...] = ()
        self._has_gyro = self._special = self.drive.gyro
        self._needs_gyro = self._has_gyro and not self.drive.observable_without_gyro
        self._displacement = self.drive.displacement
        self.accepted = 0
        self.rejected: dict[str, int] = {}
        self.events: dict[str, int] = {}
        self._kind: Reading | None = None
        self._time_ns = self._before_ns = self._strikes = 0
        self._reading: Numbers | None = None
        self._earlier: Numbers = ()
        self._earlier_yaw_rate: float | None = None
        self._steering: Numbers = ()
        self._yaw_rate: float | None = None
        self._twist = Twist2D()
        self._quantum = self._surprise = self._step_noise = ZERO
        self._step_seconds = math.inf
        self._more = self.errors is not None and (self.errors.drifts > 0 or self.errors.ticks)
        self._lost = False
        self.reset(Pose2D() if pose is None else pose)

    @property
    def slipping(self) -> tuple[str, ...]:
        """Wheels of which any one would explain what did not add up lately; () where all did.

        One name where the others still contradict each other without it; more where they cannot.
        """
        return () if self.slip is None else self.slip.slipping

    @property
    def stuck(self) -> tuple[str, ...]:
        """Wheels whose encoder stands still although they must turn; the pose does without them if it can."""
        return tuple(self.drive.measured_names[index] for index in self._stuck)

    @property
    def twist_covariance(self) -> Six:
        """Upper triangle of the covariance of the last step's mean twist; zero without a step.

        What is independent from step to step, and a tick of doubt at either end, over the time squared.
        """
        scale = self._step_seconds**-2
        return weighted_sum((scale, 2.0 * scale), (self._step_noise, self._quantum))

    @property
    def offered(self) -> int:
        """Samples taken so far, accepted or rejected."""
        return self.accepted + sum(self.rejected.values())

    # --- what a person calls ----------------------------------------------------------------

    def reset(self, pose: Pose2D, *, covariance: Six = ZERO) -> None:
        """Say where the robot is now. Encoders stay where they are: no motion is lost.

        Args:
            pose: Of the robot at the last sample.
            covariance: Upper triangle of how well that is known, as `state.upper`.

        Raises:
            InputError: If this is no pose, no covariance, or not finite.
        """
        if not isinstance(pose, Pose2D):
            raise InputError(f"reset: pose {shown(pose)}, must be a Pose2D(x, y, theta)")
        numbers = {"pose.x": pose.x, "pose.y": pose.y, "pose.theta": pose.theta}
        require_numbers("reset", one=numbers, row={"covariance": covariance})
        if not all(map(isfinite, (pose.x, pose.y, pose.theta, *covariance))):
            raise InputError(f"reset({pose}): every number must be finite")
        if not is_covariance(covariance):
            problem = "must be the upper triangle (six numbers, as state.upper) of a covariance"
            raise InputError(f"reset: covariance {shown(covariance)}, {problem}")
        self._begin(pose, covariance)

    def _begin(self, pose: Pose2D, covariance: Six) -> None:
        self._far_x, self._far_y, self._toward = pose.x, pose.y, remainder(pose.theta, tau)
        self._turns = round((pose.theta - self._toward) / tau)
        self._low = (0.0, 0.0, 0.0)
        self._x = self._y = self._theta = 0.0
        self._steps = 0
        self._covariance = within_circle(covariance, 0.0)
        self._drifts = [(0.0, 0.0, 0.0)] * self._drift_count
        self._before: Sequence[float] | None = None
        self._past: Sequence[Numbers] = NO_PAST
        self._settled = False
        self._surprise = ZERO
        self.state = OdometryState(self._time_ns, pose, self._twist, True, "reset", covariance)

    def update(  # noqa: C901 - the live path, as _step
        self,
        time: float | None = None,
        positions: Numbers | None = None,
        steering: Numbers = (),
        yaw_rate: float | None = None,
        *,
        time_ns: int | None = None,
        ticks: Sequence[int] | None = None,
        increments: Numbers | None = None,
        velocities: Numbers | None = None,
        command: Numbers | WheelCommand | None = None,
    ) -> OdometryState:
        """Take one sample.

        Exactly one time and one reading, always the same kind of reading. The first sample is the
        baseline: it never moves the pose.

        Args:
            time: Stamp [s].
            positions: Cumulative wheel angles [rad], in `drive.measured_names` order.
            steering: Steering angles [rad] at the stamp, in `drive.steered_names` order.
            yaw_rate: The gyro's yaw rate [rad/s] at the stamp; None where it is silent.
            time_ns: Stamp [ns], in place of `time`.
            ticks: Raw counters, in place of positions; the robot's encoders say what they mean.
            increments: Angles since the last sample [rad], in place of positions. What a rejected
                sample held cannot be had back; the next state says "increments_lost".
            velocities: Wheel speeds [rad/s] at the stamp, in place of positions.
            command: What the measured wheels were told [rad/s], for drives that cannot know by
                themselves that an encoder froze.

        Returns:
            The state; with `accepted` False and unchanged where the sample was refused.

        Raises:
            InputError: If the call itself is wrong: no time or two, no reading or two, another kind
                than before, ticks without encoders, a yaw rate without a declared gyro.
        """
        if (time is None) is (time_ns is None):
            raise InputError("update: give time [s] or time_ns, one of them")
        if positions is not None and ticks is None and increments is None and velocities is None:
            kind, reading = POSITION, positions
        else:
            kind, reading = _one_reading(positions, ticks, increments, velocities)
        if kind is not self._kind:
            self._take_kind(kind)
        if yaw_rate is not None and not self._has_gyro:
            raise InputError(
                "update: yaw_rate given, but the drive declares no gyro; add 'gyro' to its measured="
            )
        try:
            if time is not None:
                try:
                    time_ns = round(time * 1e9)
                except (ValueError, OverflowError):
                    return self._reject("nonfinite")
            elif type(time_ns) is not int:
                time_ns = _stamp(time_ns)
                if time_ns is None:
                    return self._reject("nonfinite")
            if not -LAST_NS <= time_ns <= LAST_NS:
                return self._reject("time_range")
            if len(reading) != self._count:
                return self._reject("shape")
            # Floats, so that no narrower number of NumPy's is what sums are made of.
            if kind is not TICKS and type(reading[0]) is not float:
                reading = _floats(kind, reading)
            if yaw_rate is not None and type(yaw_rate) is not float:
                yaw_rate = _float(yaw_rate)
            if self._steered or len(steering):
                checked = self._check_steering(steering)
                if isinstance(checked, str):
                    return self._reject(checked)
                steering = checked
            if command is not None:
                command = self._told(command)
            return self._step(time_ns, kind, reading, steering, yaw_rate, command)
        except TypeError:
            numbers = {"time": time, "time_ns": time_ns, "yaw_rate": yaw_rate}
            rows = {kind.value: reading, "steering": steering, "command": () if command is None else command}
            require_numbers("update", one=numbers, row=rows)
            raise

    # --- what `integrate` needs to go through arrays and come back ---------------------------------

    @property
    def memory(self) -> Memory:
        """What the next step needs of the last one."""
        twist = self._twist
        return Memory(
            (self._far_x + self._x, self._far_y + self._y, tau * self._turns + self._toward + self._theta),
            (twist.vx, twist.vy, twist.omega),
            self._covariance,
            self._before,
            self._before_ns,
            self._earlier,
            self._earlier_yaw_rate,
            self._quantum,
            self._drifts,
            self._surprise,
            self._settled,
            self._past,
        )

    def resume(
        self,
        *,
        count: int,
        time_ns: int,
        reading: Numbers,
        steering: Numbers,
        yaw_rate: float | None,
        memory: Memory,
    ) -> None:
        """Go on after `count` samples that were accepted elsewhere, the last of them this one."""
        self._twist = Twist2D(*memory.twist)
        self._begin(Pose2D(*memory.pose), memory.upper)
        self._drifts, self._quantum, self._surprise = list(memory.drifts), memory.quantum, memory.surprise
        self._settled, self._past = memory.settled, memory.past
        self._before, self._before_ns = memory.before, memory.before_ns
        if self._commutes:
            self._earlier, self._earlier_yaw_rate = memory.earlier, memory.earlier_yaw_rate
        self.accepted += count - 1
        self._accept(time_ns, reading, steering, yaw_rate, "")

    # --- one sample -------------------------------------------------------------------------

    def _step(  # noqa: C901, PLR0915 - the live path: one straight line, no calls that it need not make
        self,
        time_ns: int,
        kind: Reading,
        reading: Numbers,
        steering: Numbers,
        yaw_rate: float | None,
        command: Numbers | None,
    ) -> OdometryState:
        before = self._reading
        elapsed = time_ns - self._time_ns
        if yaw_rate is not None and self.plausible.yaw_rate < abs(yaw_rate) < math.inf:
            if self._yaw_rate is not None and elapsed > 0 and self._strikes + 1 < PATIENCE:
                self._strikes += 1
                return self._reject("implausible")
            yaw_rate = None  # a gyro that goes on like that is as good as silent (S20)
        if before is None or elapsed < CLOCK_RESOLUTION_NS:
            return self._without_step(time_ns, reading, steering, yaw_rate)
        seconds = elapsed * 1e-9
        try:
            if kind is POSITION:
                turned = list(map(sub, reading, before))
            else:
                turned = self._turned(kind, reading, before, seconds)
        except TypeError:
            raise InputError(f"update: {kind.value} {reading!r}: every value must be a number") from None
        except OverflowError:
            if not self._is_sound(reading, steering, yaw_rate):
                return self._reject("nonfinite")
            self._take_baseline(time_ns, reading, steering, yaw_rate)
            return self._reject("ambiguous_wrap")

        middle = steering
        if self._steered:
            middle = [
                then + 0.5 * remainder(now - then, tau)
                for now, then in zip(steering, self._steering, strict=True)
            ]
        # One bound for all wheels together settles nearly every sample, NaN and infinity included. Speeds are
        # judged by themselves: the mean with the one before would let twice as much pass.
        judged = turned if kind is not VELOCITY else [seconds * speed for speed in reading]
        if not hypot(*judged) <= self._surely * seconds and not self.plausible.allows(judged, seconds):
            return self._implausible(time_ns, kind, reading, steering, yaw_rate)
        turn = None
        if self._special:
            if self._has_gyro:
                turn = self._gyro_turn(yaw_rate, elapsed)
                if turn is None and self._needs_gyro:
                    return self._reject("no_gyro")
                if turn is not None and not isfinite(turn):
                    return self._reject("nonfinite")
                turn = self._without_bias(turn, turned, seconds)
            if kind is VELOCITY and self._commutes and self._before is not None:
                h0 = self._before_ns * 1e-9
                samples = zip(self._earlier, before, reading, strict=True)
                turned = [seconds * mean_rate(a, b, c, h0, seconds) for a, b, c in samples]
        told = None if self._spare is None else self._spare.displacement(turned, middle, turn)
        try:
            dx, dy, dt = self._displacement(turned, middle, turn) if told is None else told
        except Unobservable:
            return self._reject("range")

        reason = ""
        if elapsed > self.max_gap_ns or self._lost:
            reason = self._break(elapsed)
            if kind is VELOCITY:  # speeds say nothing about the time between them
                return self._rebaseline(time_ns, reading, steering, yaw_rate, reason)

        measured: Sequence[float] = (dx, dy, dt)
        off = None
        if self._before is not None:
            if self.surprise is not None:
                off, strange = self.surprise.of(measured, self._before, seconds, self._before_ns * 1e-9)
                off = off if strange else None
            if self._commutes:
                ax, ay, at = self._before
                h0 = self._before_ns
                factor = elapsed * elapsed / (6.0 * h0 * (h0 + elapsed))  # integrator.commutator_factor
                dx, dy = dx - factor * (at * dy - dt * ay), dy + factor * (at * dx - dt * ax)
        self._before = measured
        self._before_ns = elapsed
        heading = self._toward + self._theta + self._lead * dt
        c, s = cos(heading), sin(heading)
        if self._chord and dt:
            half = 0.5 * dt
            chord = sin(half) / half
            c, s = c * chord, s * chord
        self._x += c * dx - s * dy
        self._y += s * dx + c * dy
        self._theta += dt
        self._steps += 1
        if self._steps >= FOLD:
            self._fold()

        if self.errors is not None:
            every, errors = turned, self.errors
            if told is not None:
                turned = [turned[index] for index in self._chosen]
            elif self._spare is not None:  # the others do not suffice without a gyro that is silent now
                errors = self._whole or errors
            gains = errors.gains(middle, turn is not None)
            noise = errors.noise(gains, turned, measured, seconds, turn is not None)
            if self._stuck and told is None:
                noise = weighted_sum((1.0, 1.0), (noise, self._unheard(gains[0], turned)))
            if reason == "gap":
                noise = _unknown_path(noise, dx, dy, self._unseen_turn(turned, dt, seconds))
            self._step_noise, self._step_seconds = noise, seconds
            if off is not None or self._surprise is not ZERO:
                gyro = None if turn is None else gains[0].gyro[0]
                noise = self._doubted(noise, off, (*measured, seconds), gyro)
            self._past = ((*measured, seconds), *self._past[:2])
            self._covariance = propagate(
                self._covariance, (dx, dy, dt), noise, chord=self._chord, lead=self._lead
            )
            self._quantum = gains[2]
            if self._drifts:
                self._drift_on(errors.drift(gains, turned, measured, turn), (dx, dy, dt))
            # A step that is not like the others has no part in what the wheels agree on.
            if (
                self.slip is not None
                and errors is self.errors
                and not reason
                and self.slip.step(turned, middle, turn, seconds, measured)
            ):
                reason = self._judge_slip(gains[0]) or reason
            if self._stuck:
                self._release(every)
            if 0.0 in every or self._suspects:
                reason = self._watch_frozen(every, middle, turn, seconds, measured, command) or reason
        if kind is VELOCITY:
            self._earlier = before
            rate = self._rate(yaw_rate, turn)
            told = None if self._spare is None else self._spare.displacement(reading, steering, rate)
            measured, seconds = self._displacement(reading, steering, rate) if told is None else told, 1.0
        self._twist = Twist2D(measured[0] / seconds, measured[1] / seconds, measured[2] / seconds)
        return self._accept(time_ns, reading, steering, yaw_rate, reason)

    def _doubted(self, noise: Six, off: Numbers | None, step: Numbers, gyro: Numbers | None) -> Six:
        """Noise of a step of which so much came as a surprise (S13), or the one before.

        Counters take a glitch back, and if they do not it was none: then the doubt stays. What counts anew,
        and a gyro, never take it back.
        """
        surprise = self.surprise
        assert surprise is not None
        before, self._surprise = self._surprise, ZERO
        taken_back = surprise.taken_back(step, self._past)
        if before is not ZERO and not (taken_back or self._settled):
            noise = weighted_sum((1.0, 1.0), (noise, before))
        if off is not None:
            self._step_noise = weighted_sum((1.0, 1.0), (noise, outer(off)))
            if self._kind in (INCREMENT, VELOCITY):
                return self._step_noise
            if gyro is not None:
                lasting, off = surprise.by_gyro(off, gyro)
                noise = weighted_sum((1.0, 1.0), (noise, outer(lasting)))
            self._surprise = surprise.on_pose(off, step[:3])
            self._settled = bool(taken_back | surprise.resumed(step, self._past))
        return surprise.detour(noise, before[5] + self._surprise[5], step[:3])

    def _without_bias(self, turn: float | None, turned: Numbers, seconds: float) -> float | None:
        """What the gyro says about a step [rad]; nothing while the robot stands still."""
        standstill = self.standstill
        self._earlier_yaw_rate = self._yaw_rate
        if standstill is None:
            return turn
        if standstill.step(turned, seconds, None if turn is None else turn / seconds):
            return 0.0 if self._needs_gyro else None
        return None if turn is None else turn - standstill.bias * seconds

    def _judge_slip(self, gains: Gains) -> str:
        """At the end of a window: do its wheels agree? If not, the covariance grows (S16)."""
        assert self.slip is not None
        doubt = 0.0 if self.standstill is None else self.standstill.doubt
        excess = self.slip.close(doubt)
        if not excess:
            return ""
        self._count_event("slip")
        self._grow(self.slip.growth(excess - 1.0, gains))
        return "slip"

    def _rate(self, yaw_rate: float | None, turn: float | None) -> float | None:
        """What the gyro shows [rad/s], where it takes part, without its bias."""
        if yaw_rate is None or turn is None:
            return None
        if self.standstill is None:
            return yaw_rate
        return 0.0 if self._needs_gyro and not turn else yaw_rate - self.standstill.bias

    def _watch_frozen(
        self,
        turned: Numbers,
        middle: Numbers,
        turn: float | None,
        seconds: float,
        step: Numbers,
        command: Numbers | None,
    ) -> str:
        """An encoder that froze: count on the others alone if they suffice (S14)."""
        frozen = self.frozen
        assert frozen is not None
        if command is None and not frozen.redundant:
            return ""
        frozen.release(turned)
        found = frozen.convict(turned, middle, turn, seconds, step, command)
        self._suspects = frozen.suspects
        if not found:
            return ""
        self._count_event("stuck_wheel")
        self._grow(outer(frozen.missed))
        self._count_on_the_rest()
        return "stuck_wheel"

    def _release(self, turned: Numbers) -> None:
        """A stuck encoder that counts again is counted on again, from the next step on.

        This one may hold all that it did not count meanwhile, which the pose has from the others.
        """
        assert self.frozen is not None
        if self.frozen.release(turned):
            self._count_event("wheel_recovered")
            self._count_on_the_rest()

    def _count_on_the_rest(self) -> None:
        assert self.frozen is not None
        self._stuck, self._unheard_way = self.frozen.stuck, 0.0
        self._spare = spare = self.frozen.spare(self._stuck) if self._stuck else None
        self._chosen = range(self._count) if spare is None else spare.chosen
        drive = self.drive if spare is None else spare.drive
        lengths = _tick_sizes(self.robot)[1]
        self.errors = ErrorModel(drive, self.robot.noise, self.robot.encoders)
        self.slip = slip_monitor(drive, self.robot.noise, [lengths[index] for index in self._chosen])
        self._before = None
        self._past = NO_PAST

    def _unheard(self, gains: Gains, turned: Numbers) -> Six:
        """What stuck wheels may have rolled in a step of which nobody else can tell: as far as the furthest.

        The same way all along, so that it is the ways that add up and not their variances.
        """
        far = max(map(abs, turned))
        before, self._unheard_way = self._unheard_way, self._unheard_way + far
        more = self._unheard_way**2 - before**2
        radii = [self.drive.wheel(self.drive.measured_names[index]).radius for index in self._stuck]
        return weighted_sum(
            [more * radius**2 for radius in radii], [outer(gains.rolling[index]) for index in self._stuck]
        )

    def _told(self, command: Numbers | WheelCommand) -> Numbers | None:
        """Commanded speeds of the measured wheels [rad/s]; None where they mean nothing."""
        speeds = self.drive.select(command.speeds) if isinstance(command, WheelCommand) else command
        if len(speeds) != self._count:
            raise ShapeError(
                f"command: {len(speeds)} speeds, must be {self._count} {self.drive.measured_names}"
            )
        return speeds if isfinite(sum(speeds)) else None

    def _grow(self, six: Six) -> None:
        before = self._covariance
        self._covariance = weighted_sum((1.0, 1.0), (before, within_circle(six, before[5])))

    def _drift_on(self, changes: Sequence[Sequence[float]], step: Numbers) -> None:
        """Add what errors of the description did to this step, seen from the odom frame.

        There they are plain sums. Each acts where the step was at its middle.
        """
        if len(changes) < len(self._drifts):
            every: list[Sequence[float]] = [(0.0, 0.0, 0.0)] * len(self._drifts)
            for index, change in zip((*self._chosen, -1), changes, strict=False):
                every[index] = change
            changes = every
        dx, dy, dt = step
        middle = self._toward + self._theta - 0.5 * dt
        c, s = cos(middle), sin(middle)
        x = self._far_x + self._x - 0.5 * (c * dx - s * dy)
        y = self._far_y + self._y - 0.5 * (s * dx + c * dy)
        self._drifts = [
            (gx + c * px - s * py + y * pt, gy + s * px + c * py - x * pt, gt + pt)
            for (gx, gy, gt), (px, py, pt) in zip(self._drifts, changes, strict=True)
        ]

    def _reported(self) -> Six:
        """All that is uncertain about the pose: what was accumulated, ticks, and the description."""
        six = self._covariance
        if self._quantum is not ZERO or self._surprise is not ZERO:
            six = weighted_sum((1.0, 1.0, 1.0), (six, self._quantum, self._surprise))
        if self._drifts:
            x, y = self._far_x + self._x, self._far_y + self._y
            heading = self._toward + self._theta
            xx = xy = yy = xt = yt = tt = 0.0
            for gx, gy, gt in self._drifts:
                ux, uy = gx - y * gt, gy + x * gt
                xx += ux * ux
                xy += ux * uy
                yy += uy * uy
                xt += ux * gt
                yt += uy * gt
                tt += gt * gt
            drifted = rotated((xx, xy, yy, xt, yt, tt), cos(heading), -sin(heading))
            six = weighted_sum((1.0, 1.0), (six, drifted))
        return six

    def _fold(self) -> None:
        """Add the recent steps to the far sums, which are compensated: a day at 1 kHz loses nothing."""
        low_x, low_y, low_theta = self._low
        self._far_x, low_x = _compensated(self._far_x, self._x, low_x)
        self._far_y, low_y = _compensated(self._far_y, self._y, low_y)
        self._toward, low_theta = _compensated(self._toward, self._theta, low_theta)
        wrapped = remainder(self._toward, tau)
        self._turns += round((self._toward - wrapped) / tau)
        self._toward = wrapped
        self._low = (low_x, low_y, low_theta)
        self._x = self._y = self._theta = 0.0
        self._steps = 0

    def _accept(
        self, time_ns: int, reading: Numbers, steering: Numbers, yaw_rate: float | None, reason: str
    ) -> OdometryState:
        self.accepted += 1
        self._strikes = 0
        self._time_ns = time_ns
        self._reading = tuple(reading)
        self._steering = steering
        self._yaw_rate = yaw_rate
        pose = Pose2D(
            self._far_x + self._x, self._far_y + self._y, tau * self._turns + (self._toward + self._theta)
        )
        upper = self._reported() if self._more or self._surprise is not ZERO else self._covariance
        self.state = state = OdometryState(time_ns, pose, self._twist, True, reason, upper)
        return state

    # --- samples that are not one step --------------------------------------------------------

    def _without_step(
        self, time_ns: int, reading: Numbers, steering: Numbers, yaw_rate: float | None
    ) -> OdometryState:
        """First samples, and samples whose time did not move forward (S3 to S6)."""
        if self._reading is None or time_ns - self._time_ns <= -CLOCK_RESET_NS:
            if not self._is_sound(reading, steering, yaw_rate):
                return self._reject("nonfinite")
            if self._reading is None:
                return self._rebaseline(time_ns, reading, steering, yaw_rate, "baseline")
            self._count_event("clock_reset")
            return self._rebaseline(time_ns, reading, steering, yaw_rate, "clock_reset")
        elapsed = time_ns - self._time_ns
        if elapsed < 0:
            return self._reject("out_of_order")
        if elapsed > 0:
            return self._reject("too_soon")
        same = tuple(reading) == self._reading and tuple(steering) == tuple(self._steering)
        return self._reject("duplicate" if same else "duplicate_conflict")

    def _is_sound(self, reading: Numbers, steering: Numbers, yaw_rate: float | None) -> bool:
        """Whether every number of a sample is finite, and every count whole."""
        if self._kind is TICKS and None in map(whole_count, reading):
            return False
        wheels = () if self._kind is TICKS else reading  # a count may be too large for a float
        return all(map(_is_finite, (*wheels, *steering, 0.0 if yaw_rate is None else yaw_rate)))

    def _rebaseline(
        self, time_ns: int, reading: Numbers, steering: Numbers, yaw_rate: float | None, reason: str
    ) -> OdometryState:
        self._take_baseline(time_ns, reading, steering, yaw_rate)
        return self._accept(time_ns, reading, steering, yaw_rate, reason)

    def _take_baseline(
        self, time_ns: int, reading: Numbers, steering: Numbers, yaw_rate: float | None
    ) -> None:
        """Count from here. Motion since the last sample was not seen: the covariance grows by it."""
        if self._reading is not None:
            # By how much a clock went back says nothing about how long it took.
            elapsed = time_ns - self._time_ns
            self._grow_unseen((elapsed if elapsed > 0 else self.max_gap_ns) * 1e-9)
        if self.errors is not None and self.errors.ticks:
            # Half a tick at the start is a heading that stays wrong.
            self._quantum = self.errors.gains(steering, self._has_gyro)[2]
            self._grow(self._quantum)
        if self._surprise is not ZERO:  # counters that begin anew do not take it back
            self._grow(self._surprise)
        self._twist = Twist2D()
        self._surprise = self._step_noise = ZERO
        self._step_seconds = math.inf
        self._break_off()
        self._lost = False
        self._strikes = 0
        self._time_ns = time_ns
        self._reading = tuple(reading)
        self._steering = steering
        self._yaw_rate = yaw_rate

    def _implausible(
        self, time_ns: int, kind: Reading, reading: Numbers, steering: Numbers, yaw_rate: float | None
    ) -> OdometryState:
        """A wheel that turned further than it can (S11, S12); from zero, the encoders began anew."""
        if not self._is_sound(reading, steering, yaw_rate):
            return self._reject("nonfinite")
        scales = [abs(e.radians_per_tick) for e in self.encoders] or [1.0] * self._count
        restarted = kind in (Reading.TICKS, Reading.POSITION) and self.plausible.allows(
            [value * scale for value, scale in zip(reading, scales, strict=True)],
            (time_ns - self._time_ns) * 1e-9,
        )
        self._strikes += 1
        reason = "jump" if restarted else "implausible"
        if restarted or self._strikes >= PATIENCE:
            self._count_event("encoder_restart" if restarted else "rebaseline")
            self._take_baseline(time_ns, reading, steering, yaw_rate)
        return self._reject(reason)

    def _reject(self, reason: str) -> OdometryState:
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        if self._kind is Reading.INCREMENT and not reason.startswith("duplicate"):
            self._lost = True
        self.state = state = OdometryState(
            self._time_ns, self.state.pose, self._twist, False, reason, self._reported()
        )
        return state

    def _break(self, elapsed: int) -> str:
        """A step that is not like the others: after a gap, or after increments that were lost."""
        self._break_off()
        lost, self._lost = self._lost, False
        if elapsed > self.max_gap_ns:
            self._count_event("gap")
        if not lost:
            return "gap"
        self._grow_unseen(elapsed * 1e-9)
        return "increments_lost"

    def _break_off(self) -> None:
        """What was watched before has no connection with what comes."""
        self._before = None
        self._past = NO_PAST
        if self.slip is not None:
            self.slip.restart()
        if self.frozen is not None:
            self.frozen.restart()
        if self.standstill is not None:
            self.standstill.restart()

    def _grow_unseen(self, seconds: float) -> None:
        """Add what the robot may have moved while nobody looked: its speed times the time."""
        speed, yaw_rate = self.plausible.body_speed
        twist = self._twist
        sigma = seconds * max(speed, hypot(twist.vx, twist.vy))
        turn = seconds * max(yaw_rate, abs(twist.omega))
        if self.errors is not None:
            self._grow((sigma**2, 0.0, sigma**2, 0.0, 0.0, turn**2))

    def _unseen_turn(self, turned: Numbers, turn: float, seconds: float) -> float:
        """How far the heading after a gap may be off [rad] where only a rate at its ends is known of it."""
        if not self._needs_gyro or not any(turned):
            return 0.0
        return max(seconds * self.plausible.body_speed[1], abs(turn))

    def _count_event(self, name: str) -> None:
        self.events[name] = self.events.get(name, 0) + 1

    # --- what a reading says ------------------------------------------------------------------

    def _turned(self, kind: Reading, reading: Numbers, before: Numbers, seconds: float) -> list[float]:
        """What each wheel turned since the last accepted sample [rad].

        Raises:
            OverflowError: If a counter may have wrapped more than once.
        """
        if kind is Reading.INCREMENT:
            return list(reading)
        if kind is Reading.VELOCITY:
            half = 0.5 * seconds
            return [half * (then + now) for now, then in zip(reading, before, strict=True)]
        turned = []
        for value, then, encoder, fastest in zip(
            reading, before, self.encoders, self.plausible.declared, strict=True
        ):
            now = whole_count(value)
            if now is None:
                turned.append(math.nan)
                continue
            counts = count_difference(now, int(then), encoder.bits)
            if encoder.bits is not None:
                half_range = 1 << (encoder.bits - 1)
                possible = fastest * seconds / abs(encoder.radians_per_tick)
                # Half the range either way; or an error of one bit, where the wheel cannot have come so far.
                if possible >= half_range or (abs(counts) >= half_range and not fastest):
                    raise OverflowError
            turned.append(counts * encoder.radians_per_tick)
        return turned

    def _gyro_turn(self, yaw_rate: float | None, elapsed: int) -> float | None:
        """What the gyro turned in the step [rad], None where it was silent.

        Over a gap a rate says nothing: only a drive that knows no better takes it, and doubts it.
        """
        then = self._yaw_rate
        if yaw_rate is None:
            if then is not None:
                self._count_event("gyro_dropout")
            return None
        if not isfinite(yaw_rate):
            return math.nan
        if then is None:  # silent when this step began: a drive that needs it takes what it says now
            if not self._needs_gyro:
                return None
            then = yaw_rate
        if elapsed > self.max_gap_ns and not self._needs_gyro:
            return None
        seconds = elapsed * 1e-9
        if self._commutes and self._before is not None and self._earlier_yaw_rate is not None:
            h0, h1 = self._before_ns * 1e-9, seconds
            mean: float = mean_rate(self._earlier_yaw_rate, then, yaw_rate, h0, h1)
            return h1 * mean
        return 0.5 * seconds * (yaw_rate + then)

    def _check_steering(self, steering: Numbers) -> Numbers | str:
        """The angles, one per steered wheel; or the reason to refuse them."""
        if not isfinite(sum(steering)) and not all(map(_is_finite, steering)):
            return "nonfinite"
        if len(steering) != self._steered:
            try:
                steering = self.drive.expand_steering(steering)
            except ShapeError:
                return "shape"
        for index, bounds in self._bounded:
            if not bounds.hold(steering[index]):
                return "range"
        return tuple(steering) if type(steering[0]) is float else tuple(map(_float, steering))

    def _take_kind(self, kind: Reading) -> None:
        if self._kind is not None:
            raise InputError(
                f"update: {kind.value} given, but it was {self._kind.value} before; use one kind of reading"
            )
        if kind is Reading.TICKS:
            self.encoders = self.robot.encoders_of(self.drive.measured_names)
        self._kind = kind
        self._special = self._has_gyro or kind is VELOCITY


def _one_reading(
    positions: Numbers | None,
    ticks: Sequence[int] | None,
    increments: Numbers | None,
    velocities: Numbers | None,
) -> tuple[Reading, Numbers]:
    given = [
        (kind, reading)
        for kind, reading in (
            (Reading.POSITION, positions),
            (Reading.TICKS, ticks),
            (Reading.INCREMENT, increments),
            (Reading.VELOCITY, velocities),
        )
        if reading is not None
    ]
    if len(given) != 1:
        raise InputError("update: give exactly one of positions, ticks=, increments=, velocities=")
    return given[0]


def _shows_turning(drive: Kinematics) -> bool:
    """Whether wheels that stand still say that the robot does not turn on the spot."""
    wheels = [drive.wheel(name) for name in drive.measured_names]
    return drive.observable_without_gyro or any(abs(rolling(wheel)[2]) > LEAST_LEVER for wheel in wheels)


def _tick_sizes(robot: Robot) -> tuple[list[float], list[float]]:
    """What one count of each measured wheel is, as an angle [rad] and as a way [m]; 0 where not described."""
    drive = robot.measuring
    encoders = robot.encoders
    angles = [
        abs(encoders[name].radians_per_tick) if name in encoders else 0.0 for name in drive.measured_names
    ]
    radii = [drive.wheel(name).radius for name in drive.measured_names]
    return angles, [angle * radius for angle, radius in zip(angles, radii, strict=True)]


def _compensated(total: float, part: float, low: float) -> tuple[float, float]:
    """One step of Kahan's summation: the new total, and what it is too large by."""
    part -= low
    result = total + part
    return result, (result - total) - part


def _stamp(time_ns: Any) -> int | None:
    """A stamp as an int, whatever NumPy makes of its own integers; None if it is not finite."""
    try:
        return operator.index(time_ns)
    except TypeError:
        value = _float(time_ns)
        return round(value) if isfinite(value) else None


def _float(value: Any) -> float:
    try:
        number: float = value.__float__()  # float(value) would read a text
    except AttributeError:
        raise TypeError from None
    return number


def _floats(kind: Reading, reading: Numbers) -> list[float]:
    numbers = []
    for value in reading:
        try:
            numbers.append(_float(value))
        except TypeError:
            problem = f"{kind.value} {shown(reading)}: {shown(value)} is not a number"
            raise InputError(f"update: {problem}") from None
    return numbers


def _is_finite(value: float) -> bool:
    try:
        return isfinite(value)
    except TypeError:
        raise InputError(f"update: {value!r} is not a number") from None


def _unknown_path(noise: Six, dx: float, dy: float, turn: float) -> Six:
    """After a gap only the ends of the step are known: the robot is within the disc that its wheels span.

    `turn`: how far the heading at its end may be off [rad].
    """
    xx, xy, yy, xt, yt, tt = noise
    spread = 0.25 * (dx * dx + dy * dy)  # a disc of radius d has a variance of d^2 / 4 along each axis
    return (xx + spread, xy, yy + spread, xt, yt, tt + turn * turn)
