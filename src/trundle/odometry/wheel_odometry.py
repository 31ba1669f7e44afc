"""Wheel odometry, one sample at a time.

What happens to each sample is promised in FAULTS.md, rows S1 to S26. Nothing here raises because of
what a sensor said: a sample that cannot be true is refused and counted, and the next one bridges it.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec

from trundle.errors import InputError, ShapeError, Unobservable, require_positive
from trundle.geometry import Pose2D, Twist2D
from trundle.odometry.covariance import ZERO, Matrix, Six, in_odom_frame, matrix, propagate
from trundle.odometry.encoder_counts import count_difference, whole_count
from trundle.odometry.integrator import Integrator, commutator_factor
from trundle.odometry.plausibility import Plausibility
from trundle.odometry.step_noise import StepNoise
from trundle.records import Reading
from trundle.robot import Encoder, Kinematics, Robot

__all__ = ["Memory", "OdometryState", "WheelOdometry"]

Numbers = Sequence[float]

CLOCK_RESOLUTION_NS = 1_000  # S5: nothing is divided by less
CLOCK_RESET_NS = 1_000_000_000  # S6: time that goes back by more belongs to a new clock
PATIENCE = 3  # S12: this many implausible samples in a row are the new normal


class Gyro(enum.Enum):
    """What a drive's odometry has of a gyro."""

    NONE = "none"
    SPARE = "spare"
    NEEDED = "needed"

    @classmethod
    def of(cls, drive: Kinematics) -> Gyro:
        if not drive.gyro:
            return cls.NONE
        return cls.SPARE if drive.observable_without_gyro else cls.NEEDED


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


class Memory(NamedTuple):
    """What the next step needs of the last one besides its reading.

    Attributes:
        pose: x, y and heading, not wrapped.
        twist: vx, vy, omega.
        upper: Upper triangle of the covariance.
        before: Displacement of the last step as measured, for the commutator; None after a break.
        before_ns: Its duration.
    """

    pose: tuple[float, ...]
    twist: tuple[float, ...]
    upper: Six
    before: tuple[float, ...] | None
    before_ns: int


class WheelOdometry:
    """Turns wheel readings into poses, live.

    Args:
        robot: A drive, or a Robot, whose limits say what is plausible and whose noise is used.
        integrator: "arc+", "arc", "midpoint" or "euler".
        pose: Where the robot is at the first sample.
        covariance: Whether to carry the covariance; without it an update takes a fraction of the
            time and the covariance stays zero.
        max_gap: Longest step that still counts as one motion [s].

    Attributes:
        robot: What it was made for.
        drive: The wheels that measure.
        offered: Samples given so far: `offered == accepted + sum(rejected.values())`.
        accepted: Those that counted.
        rejected: The others, by reason.
        events: What happened on the way (gap, rebaseline, clock_reset, ...), by name.
        state: The state after the last sample.

    Raises:
        ConfigError: If the integrator is unknown, or `max_gap` not above zero.
    """

    __slots__ = (
        "_before",
        "_before_ns",
        "_chord",
        "_commutes",
        "_count",
        "_covariance",
        "_gyro",
        "_kind",
        "_lead",
        "_lost",
        "max_gap_ns",
        "noise",
        "plausible",
        "_reading",
        "_steered",
        "_steering",
        "_strikes",
        "_theta",
        "_theta_low",
        "encoders",
        "_time_ns",
        "_turns",
        "_twist",
        "_x",
        "_x_low",
        "_y",
        "_y_low",
        "_yaw_rate",
        "accepted",
        "drive",
        "events",
        "integrator",
        "offered",
        "rejected",
        "robot",
        "state",
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
        self.max_gap_ns = round(require_positive("max_gap", max_gap) * 1e9)
        self.noise = StepNoise(self.drive, self.robot.noise) if covariance else None
        self.plausible = Plausibility(self.robot)
        self._count = len(self.drive.measured_names)
        self._steered = len(self.drive.steered_names)
        self.encoders: tuple[Encoder, ...] = ()
        self._gyro = Gyro.of(self.drive)
        self.offered = self.accepted = 0
        self.rejected: dict[str, int] = {}
        self.events: dict[str, int] = {}
        self._kind: Reading | None = None
        self._time_ns = self._before_ns = self._strikes = 0
        self._reading: Numbers | None = None
        self._steering: Numbers = ()
        self._yaw_rate: float | None = None
        self._twist = Twist2D()
        self._lost = False
        self.reset(pose or Pose2D())

    # --- what a person calls ----------------------------------------------------------------

    def reset(self, pose: Pose2D, *, covariance: Six = ZERO) -> None:
        """Say where the robot is now. Encoders stay where they are: no motion is lost.

        Args:
            pose: Of the robot at the last sample.
            covariance: Upper triangle of how well that is known.

        Raises:
            InputError: If a number is not finite.
        """
        if not all(map(math.isfinite, (pose.x, pose.y, pose.theta, *covariance))):
            raise InputError(f"reset({pose}): every number must be finite")
        self._x, self._y = pose.x, pose.y
        self._theta = math.remainder(pose.theta, math.tau)
        self._turns = round((pose.theta - self._theta) / math.tau)
        self._x_low = self._y_low = self._theta_low = 0.0
        self._covariance = covariance
        self._before: tuple[float, ...] | None = None
        self.state = OdometryState(self._time_ns, pose, self._twist, True, "reset", covariance)

    def update(
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

        Returns:
            The state; with `accepted` False and unchanged where the sample was refused.

        Raises:
            InputError: If the call itself is wrong: no time or two, no reading or two, another kind
                than before, ticks without encoders, a yaw rate without a declared gyro.
        """
        if (time is None) is (time_ns is None):
            raise InputError("update: give time [s] or time_ns, one of them")
        if positions is not None and ticks is None and increments is None and velocities is None:
            kind, reading = Reading.POSITION, positions
        else:
            kind, reading = _one_reading(positions, ticks, increments, velocities)
        if kind is not self._kind:
            self._take_kind(kind)
        if yaw_rate is not None and not self.drive.gyro:
            raise InputError("update: yaw_rate given, but the drive declares no gyro; add 'gyro' to its measured=")
        if time is not None:
            try:
                time_ns = round(time * 1e9)
            except (ValueError, OverflowError):
                return self._reject("nonfinite")
        if len(reading) != self._count:
            return self._reject("shape")
        if self._steered or steering:
            checked = self._check_steering(steering)
            if isinstance(checked, str):
                return self._reject(checked)
            steering = checked
        assert time_ns is not None
        return self._step(time_ns, kind, reading, steering, yaw_rate)

    # --- what `integrate` needs to go through arrays and come back ---------------------------------

    @property
    def memory(self) -> Memory:
        """What the next step needs of the last one."""
        twist = self._twist
        return Memory(
            (self._x - self._x_low, self._y - self._y_low, self._theta + math.tau * self._turns),
            (twist.vx, twist.vy, twist.omega),
            self._covariance,
            self._before,
            self._before_ns,
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
        self.reset(Pose2D(*memory.pose), covariance=memory.upper)
        if self._commutes:
            self._before, self._before_ns = memory.before, memory.before_ns
        self.offered += count - 1
        self.accepted += count - 1
        self._accept(time_ns, reading, steering, yaw_rate, "")

    # --- one sample -------------------------------------------------------------------------

    def _step(
        self, time_ns: int, kind: Reading, reading: Numbers, steering: Numbers, yaw_rate: float | None
    ) -> OdometryState:
        before = self._reading
        elapsed = time_ns - self._time_ns
        if before is None or elapsed < CLOCK_RESOLUTION_NS:
            return self._without_step(time_ns, kind, reading, steering, yaw_rate)
        seconds = elapsed * 1e-9
        try:
            turned = self._turned(kind, reading, before, seconds)
        except TypeError:
            raise InputError(f"update: {kind.value} {reading!r}: every value must be a number") from None
        except OverflowError:
            self._take_baseline(time_ns, reading, steering, yaw_rate)
            return self._reject("ambiguous_wrap")

        middle = steering
        if self._steered:
            middle = [
                then + 0.5 * math.remainder(now - then, math.tau)
                for now, then in zip(steering, self._steering, strict=True)
            ]
        turn = None
        if self._gyro is not Gyro.NONE:
            turn = self._gyro_turn(yaw_rate, seconds)
            if turn is None and self._gyro is Gyro.NEEDED:
                return self._reject("no_gyro")
        try:
            dx, dy, dt = self.drive.displacement(turned, middle, turn)
        except Unobservable:
            return self._reject("range")
        if not math.isfinite(dx + dy + dt):
            return self._reject("nonfinite")
        if not self.plausible.allows(turned, seconds):
            return self._implausible(time_ns, kind, reading, steering, yaw_rate)

        reason = ""
        if elapsed > self.max_gap_ns or self._lost:
            reason = self._break(elapsed)
            if kind is Reading.VELOCITY:  # speeds say nothing about the time between them
                return self._rebaseline(time_ns, reading, steering, yaw_rate, reason)
        step = self._integrate(dx, dy, dt, elapsed)
        if self.noise is not None:
            noise = self.noise(turned, middle, (dx, dy, dt), seconds, turn is not None)
            if reason == "gap":
                noise = _unknown_path(noise, dx, dy)
            self._covariance = propagate(self._covariance, step, noise, chord=self._chord, lead=self._lead)
        if kind is Reading.VELOCITY:
            twist = Twist2D(*self.drive.displacement(reading, steering, yaw_rate))
        else:
            twist = Twist2D(dx / seconds, dy / seconds, dt / seconds)
        self._twist = twist
        return self._accept(time_ns, reading, steering, yaw_rate, reason)

    def _integrate(self, dx: float, dy: float, dt: float, elapsed: int) -> tuple[float, float, float]:
        """Move the pose by one step, and return the step with its commutator.

        Sums are compensated (Kahan): a day at 1 kHz loses nothing.
        """
        if self._commutes:
            before = self._before
            self._before = (dx, dy, dt)
            if before is not None:
                ax, ay, at = before
                factor = commutator_factor(self._before_ns, elapsed)
                dx, dy = dx - factor * (at * dy - dt * ay), dy + factor * (at * dx - dt * ax)
            self._before_ns = elapsed
        heading = self._theta + self._lead * dt
        c, s = math.cos(heading), math.sin(heading)
        if self._chord and dt:
            half = 0.5 * dt
            chord = math.sin(half) / half
            c, s = c * chord, s * chord

        part = c * dx - s * dy - self._x_low
        total = self._x + part
        self._x_low = (total - self._x) - part
        self._x = total
        part = s * dx + c * dy - self._y_low
        total = self._y + part
        self._y_low = (total - self._y) - part
        self._y = total
        part = dt - self._theta_low
        total = self._theta + part
        self._theta_low = (total - self._theta) - part
        if not -math.pi < total <= math.pi:
            turns = round(total / math.tau)
            total -= turns * math.tau
            self._turns += turns
        self._theta = total
        return dx, dy, dt

    def _accept(
        self, time_ns: int, reading: Numbers, steering: Numbers, yaw_rate: float | None, reason: str
    ) -> OdometryState:
        self.offered += 1
        self.accepted += 1
        self._strikes = 0
        self._time_ns = time_ns
        self._reading = tuple(reading)
        self._steering = steering
        self._yaw_rate = yaw_rate
        pose = Pose2D(self._x, self._y, self._theta + math.tau * self._turns)
        self.state = state = OdometryState(time_ns, pose, self._twist, True, reason, self._covariance)
        return state

    # --- samples that are not one step --------------------------------------------------------

    def _without_step(
        self, time_ns: int, kind: Reading, reading: Numbers, steering: Numbers, yaw_rate: float | None
    ) -> OdometryState:
        """First samples, and samples whose time did not move forward (S3 to S6)."""
        if self._reading is None or time_ns - self._time_ns <= -CLOCK_RESET_NS:
            values = [*reading, *steering, 0.0 if yaw_rate is None else yaw_rate]
            if not all(map(_is_finite, values)):
                return self._reject("nonfinite")
            if kind is Reading.TICKS and None in map(whole_count, reading):
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
            self._grow_unseen((time_ns - self._time_ns) * 1e-9)
        self._twist = Twist2D()
        self._before = None
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
        self.offered += 1
        self.rejected[reason] = self.rejected.get(reason, 0) + 1
        self._before = None
        if self._kind is Reading.INCREMENT and not reason.startswith("duplicate"):
            self._lost = True
        pose = Pose2D(self._x, self._y, self._theta + math.tau * self._turns)
        self.state = state = OdometryState(self._time_ns, pose, self._twist, False, reason, self._covariance)
        return state

    def _break(self, elapsed: int) -> str:
        """A step that is not like the others: after a gap, or after increments that were lost."""
        self._before = None
        if elapsed > self.max_gap_ns:
            self._count_event("gap")
            self._lost = False
            return "gap"
        self._lost = False
        self._grow_unseen(elapsed * 1e-9)
        return "increments_lost"

    def _grow_unseen(self, seconds: float) -> None:
        """Add what the robot may have moved while nobody looked: its speed times the time."""
        speed, yaw_rate = self.plausible.body_speed
        twist = self._twist
        sigma = seconds * max(speed, math.hypot(twist.vx, twist.vy))
        turn = seconds * max(yaw_rate, abs(twist.omega))
        xx, xy, yy, xt, yt, tt = self._covariance
        if self.noise is not None:
            self._covariance = (xx + sigma**2, xy, yy + sigma**2, xt, yt, tt + turn**2)

    def _count_event(self, name: str) -> None:
        self.events[name] = self.events.get(name, 0) + 1

    # --- what a reading says ------------------------------------------------------------------

    def _turned(self, kind: Reading, reading: Numbers, before: Numbers, seconds: float) -> list[float]:
        """What each wheel turned since the last accepted sample [rad].

        Raises:
            OverflowError: If a counter may have wrapped more than once.
        """
        if kind is Reading.POSITION:
            return [now - then for now, then in zip(reading, before, strict=True)]
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
                if abs(counts) >= half_range or possible >= half_range:
                    raise OverflowError
            turned.append(counts * encoder.radians_per_tick)
        return turned

    def _gyro_turn(self, yaw_rate: float | None, seconds: float) -> float | None:
        """What the gyro turned in the step [rad], by the trapezoid; None where it was silent."""
        if yaw_rate is None or self._yaw_rate is None:
            if yaw_rate is None and self._yaw_rate is not None:
                self._count_event("gyro_dropout")
            return None
        return 0.5 * seconds * (yaw_rate + self._yaw_rate)

    def _check_steering(self, steering: Numbers) -> Numbers | str:
        """The angles, one per steered wheel; or the reason to refuse them."""
        if not all(map(_is_finite, steering)):
            return "nonfinite"
        if len(steering) != self._steered:
            try:
                steering = self.drive.expand_steering(steering)
            except ShapeError:
                return "shape"
        for bounds, angle in zip(self.drive.steering_bounds, steering, strict=True):
            if not bounds.hold(angle):
                return "range"
        return tuple(steering)

    def _take_kind(self, kind: Reading) -> None:
        if self._kind is not None:
            raise InputError(f"update: {kind.value} given, but it was {self._kind.value} before; use one kind of reading")
        if kind is Reading.TICKS:
            self.encoders = self.robot.encoders_of(self.drive.measured_names)
        self._kind = kind


def _one_reading(
    positions: Numbers | None, ticks: Sequence[int] | None, increments: Numbers | None, velocities: Numbers | None
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


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except TypeError:
        raise InputError(f"update: {value!r} is not a number") from None


def _unknown_path(noise: Six, dx: float, dy: float) -> Six:
    """After a gap only the ends of the step are known: the robot is within the disc that its wheels span."""
    xx, xy, yy, xt, yt, tt = noise
    spread = 0.25 * (dx * dx + dy * dy)  # a disc of radius d has a variance of d^2 / 4 along each axis
    return (xx + spread, xy, yy + spread, xt, yt, tt)
