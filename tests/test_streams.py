"""Long streams with faults of every kind in them: what each sample gets, and what is left of them after.

A fault that stands between good samples must leave no trace; one that takes a good sample's place costs
no more than that sample.
"""

from __future__ import annotations

import inspect
import math
import re
from array import array
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

import trundle as tr
from trundle import Pose2D, WheelLog, WheelOdometry
from trundle.odometry import wheel_odometry

R, TRACK = 0.05, 0.4
LIMITS = tr.Limits(max_speed=2.0, max_lateral_speed=1.0, max_yaw_rate=2.0)
NOISE = tr.Noise(
    wheel_distance=0.01, lateral_slip=0.003, steering=0.005, gyro=0.002, wheel_radius=0.002, track_width=0.005
)
DRIVES = {
    "differential": tr.Differential(track_width=TRACK, wheel_radius=R),
    "differential+gyro": tr.Differential(
        track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro")
    ),
    "skid": tr.SkidSteer(track_width=TRACK, wheelbase=0.3, wheel_radius=R),
    "bicycle": tr.Bicycle(wheelbase=0.3, wheel_radius=R, max_steering=0.8),
    "ackermann": tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=R),
    "tricycle": tr.Tricycle(wheelbase=0.3, wheel_radius=R),
    "mecanum": tr.Mecanum(track_width=TRACK, wheelbase=0.3, wheel_radius=R),
    "omni": tr.Omni(robot_radius=0.2, wheel_radius=R),
    "swerve": tr.Swerve(modules=[(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)], wheel_radius=R),
    "two trackers+gyro": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (-0.1, 0.0, math.pi / 2)], R, measured=("wheel_1", "wheel_2", "gyro")
    ),
}
HOLONOMIC = {"mecanum", "omni", "swerve", "two trackers+gyro"}
every_drive = pytest.mark.parametrize("name", DRIVES)


class Sample(NamedTuple):
    """Arguments of `update`."""

    time_ns: int
    wheels: list[float]
    steering: list[float]
    yaw_rate: float | None

    def give(self, odometry: WheelOdometry) -> tr.OdometryState:
        return odometry.update(
            time_ns=self.time_ns, positions=self.wheels, steering=self.steering, yaw_rate=self.yaw_rate
        )


def robot_of(name: str) -> tr.Robot:
    return tr.Robot(drive=DRIVES[name], noise=NOISE, limits=LIMITS)


def swaying(rng: np.random.Generator, times: np.ndarray, middle: float, span: float) -> np.ndarray:
    """Something smooth that stays within `middle` +- `span`."""
    return middle + span / 3.0 * sum(
        np.sin(rng.uniform(0.2, 2.0) * times + rng.uniform(0, 6)) for _ in range(3)
    )


def motion(name: str, rng: np.random.Generator, chunk: int = 4000) -> Iterator[Sample]:
    """Endless good samples of a robot that wanders about, its counters far from zero."""
    drive = DRIVES[name]
    order = [drive.wheel_names.index(wheel) for wheel in drive.measured_names]
    time_ns, wheels = 0, np.full(len(order), 1000.0)
    while True:
        steps = rng.integers(5_000_000, 35_000_000, chunk)
        stamps = time_ns + np.cumsum(steps)
        times = stamps * 1e-9
        zero = np.zeros(chunk)
        vx, omega = swaying(rng, times, 1.0, 0.5), swaying(rng, times, 0.0, 0.8)
        vy = swaying(rng, times, 0.0, 0.5) if name in HOLONOMIC else zero
        speeds, steering = drive.inverse_batch(np.stack([vx, vy, omega], axis=-1))
        turned = speeds[:, order] * (steps * 1e-9)[:, None]
        turned += rng.normal(0.0, 0.01, turned.shape) * np.sqrt(np.abs(turned) / R)
        readings = wheels + np.cumsum(turned, axis=0)
        yaw = (omega + rng.normal(0.0, 0.01, chunk)).tolist() if drive.gyro else [None] * chunk
        yield from map(Sample, stamps.tolist(), readings.tolist(), steering.tolist(), yaw)
        time_ns, wheels = int(stamps[-1]), readings[-1]


# --- faults that leave no trace --------------------------------------------------------------------------


def between(before: Sample, after: Sample) -> Sample:
    """A sample that would be good, halfway."""
    wheels = [0.5 * (a + b) for a, b in zip(before.wheels, after.wheels, strict=True)]
    return after._replace(time_ns=(before.time_ns + after.time_ns) // 2, wheels=wheels)


def replaced(values: list[float], index: int, value: float) -> list[float]:
    return [*values[:index], value, *values[index + 1 :]]


Fault = Callable[[np.random.Generator, Sample, Sample], Sample]
NAUGHTS = (math.nan, math.inf, -math.inf)


def bad_wheel(rng, before, after):
    sample = between(before, after)
    return sample._replace(
        wheels=replaced(sample.wheels, rng.integers(len(sample.wheels)), rng.choice(NAUGHTS))
    )


def bad_steering(rng, before, after):
    return between(before, after)._replace(steering=replaced(after.steering, 0, rng.choice(NAUGHTS)))


def bad_gyro(rng, before, after):
    return between(before, after)._replace(yaw_rate=rng.choice(NAUGHTS))


def silent_gyro(rng, before, after):
    return between(before, after)._replace(yaw_rate=None)


def repeated(rng, before, after):
    return before


def repeated_differently(rng, before, after):
    return before._replace(wheels=[value + 0.01 for value in before.wheels])


def late(rng, before, after):
    return between(before, after)._replace(time_ns=before.time_ns - int(rng.integers(1, 999_999_999)))


def too_soon(rng, before, after):
    return between(before, after)._replace(time_ns=before.time_ns + int(rng.integers(1, 1000)))


def too_long(rng, before, after):
    return between(before, after)._replace(wheels=[*after.wheels, 0.0])


def too_short(rng, before, after):
    return between(before, after)._replace(wheels=after.wheels[1:])


def glitch(rng, before, after):
    sample = between(before, after)
    index = rng.integers(len(sample.wheels))
    value = sample.wheels[index] + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(2, 9)
    return sample._replace(wheels=replaced(sample.wheels, index, value))


def oversteered(rng, before, after):
    return between(before, after)._replace(steering=[1.5698] * len(after.steering))


def recoverable(name: str) -> list[tuple[Fault, str]]:
    """Faults that this drive can meet, and the reason that each is refused for."""
    drive = DRIVES[name]
    found: list[tuple[Fault, str]] = [
        (bad_wheel, "nonfinite"),
        (repeated, "duplicate"),
        (repeated_differently, "duplicate_conflict"),
        (late, "out_of_order"),
        (too_soon, "too_soon"),
        (too_long, "shape"),
        (too_short, "shape"),
        (glitch, "implausible"),
    ]
    if drive.steered_names:
        found.append((bad_steering, "nonfinite"))
    if any(bounds.leaning for bounds in drive.steering_bounds):
        found.append((oversteered, "range"))
    if drive.gyro:
        found.append((bad_gyro, "nonfinite"))
        if not drive.observable_without_gyro:
            found.append((silent_gyro, "no_gyro"))
    return found


class Record:
    """States as columns, checked together: one by one that would take longer than the odometry."""

    def __init__(self) -> None:
        self.numbers = array("d")

    def add(self, state: tr.OdometryState) -> None:
        pose, twist = state.pose, state.twist
        self.numbers.extend((pose.x, pose.y, pose.theta, twist.vx, twist.vy, twist.omega, *state.upper))
        if len(self.numbers) >= 12 * 10_000:
            self.check()

    def check(self) -> None:
        """Everything finite, every covariance positive semi-definite."""
        table = np.array(self.numbers).reshape(-1, 12)
        self.numbers = array("d")
        assert np.isfinite(table).all()
        full = table[:, [6, 7, 9, 7, 8, 10, 9, 10, 11]].reshape(-1, 3, 3)
        least = np.linalg.eigvalsh(full)[:, 0]
        assert (least >= -1e-12 * np.trace(full, axis1=1, axis2=2)).all()


def without_a_trace(name: str, count: int, *, covariance: bool = True, seed: int = 1) -> WheelOdometry:
    """One sample in ten is a fault that stands between good ones.

    `covariance`: whether the odometry that it is held against, which meets no faults, carries one too.
    """
    rng, robot, record = np.random.default_rng(seed), robot_of(name), Record()
    clean, hostile = WheelOdometry(robot, covariance=covariance), WheelOdometry(robot)
    faults, samples = recoverable(name), motion(name, rng)
    before = next(samples)
    for odometry in (clean, hostile):
        before.give(odometry)
    offered, refused = 1, 0
    picks: list[int] = []
    for after in samples:
        if offered >= count:
            break
        if not picks:
            picks = np.where(rng.random(1000) < 1 / 9, rng.integers(len(faults), size=1000), -1).tolist()
        pick = picks.pop()
        if pick >= 0:
            fault, reason = faults[pick]
            held = hostile.state
            state = fault(rng, before, after).give(hostile)
            assert (state.accepted, state.reason, state.pose) == (False, reason, held.pose)
            record.add(state)
            offered, refused = offered + 1, refused + 1
        wanted, state = after.give(clean), after.give(hostile)
        record.add(state)
        offered += 1
        assert state.accepted
        assert math.hypot(state.pose.x - wanted.pose.x, state.pose.y - wanted.pose.y) < 1e-9
        before = after
    record.check()
    if covariance:
        np.testing.assert_allclose(hostile.state.upper, clean.state.upper, rtol=1e-9, atol=1e-12)
    assert hostile.offered == hostile.accepted + sum(hostile.rejected.values()) == offered
    assert sum(hostile.rejected.values()) == refused > 0.05 * offered
    assert hostile.rejected.keys() == {reason for _, reason in faults}
    return hostile


@every_drive
def test_faults_between_good_samples_leave_no_trace(name: str) -> None:
    without_a_trace(name, 6_000)


@every_drive
def test_a_replaced_sample_costs_itself(name: str) -> None:
    """Where a fault stands in a good sample's place, the rest is `integrate` of the log without it."""
    rng, robot = np.random.default_rng(2), robot_of(name)
    faults, samples = recoverable(name), motion(name, rng)
    odometry, kept, states = WheelOdometry(robot), [next(samples)], []
    states.append(kept[0].give(odometry))
    for _ in range(3000):
        sample = next(samples)
        if rng.random() < 0.1 and states[-1].accepted:  # three implausible ones in a row are another matter
            state = faults[rng.integers(len(faults))][0](rng, kept[-1], sample).give(odometry)
            assert not state.accepted
            states.append(state)
        else:
            states.append(sample.give(odometry))
            kept.append(sample)
    drive = robot.drive
    log = WheelLog(
        time_ns=np.array([sample.time_ns for sample in kept]),
        wheel_names=drive.measured_names,
        wheels=np.array([sample.wheels for sample in kept]),
        steering_names=drive.steered_names,
        steering=np.array([sample.steering for sample in kept]) if drive.steered_names else None,
        yaw_rate=np.array([sample.yaw_rate for sample in kept]) if drive.gyro else None,
    )
    trajectory = tr.integrate(robot, log)
    poses = [(s.pose.x, s.pose.y, s.pose.theta) for s in states if s.accepted]
    np.testing.assert_allclose(trajectory.poses, poses, rtol=0.0, atol=1e-9)


# --- faults that lose motion -------------------------------------------------------------------------------


class Robot:
    """A robot whose clock and counters can begin anew, and whose motion goes on unseen meanwhile."""

    def __init__(self, name: str, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.name, self.samples = name, motion(name, self.rng)
        self.zero, self.clock = 0.0, 0
        self.offset: list[float] | None = None
        self.last = next(self.samples)

    def next(self) -> Sample:
        self.last = next(self.samples)
        return self.shown(self.last)

    def shown(self, sample: Sample) -> Sample:
        """As the present clock and counters have it."""
        wheels = sample.wheels
        if self.offset is not None:
            wheels = [value - zero for value, zero in zip(wheels, self.offset, strict=True)]
        return sample._replace(time_ns=sample.time_ns + self.clock, wheels=wheels)

    def pause(self) -> None:
        self.clock += 1_500_000_000

    def new_clock(self) -> None:
        self.clock -= 60_000_000_000

    def new_counters(self) -> None:
        self.offset = list(self.last.wheels)

    def lost_counts(self) -> None:
        """Jumped for good: three implausible samples, then the new normal."""
        offset = self.offset or [0.0] * len(self.last.wheels)
        self.offset = [value - 1000.0 for value in offset]


def everything(name: str, count: int, seed: int = 3) -> WheelOdometry:
    """All kinds of faults, in the place of good samples and between them."""
    robot, odometry, record = Robot(name, seed), WheelOdometry(robot_of(name)), Record()
    rng, faults = robot.rng, recoverable(name)
    events = (robot.pause, robot.new_clock, robot.new_counters, robot.lost_counts)
    before = robot.shown(robot.last)
    before.give(odometry)
    offered = 1
    while offered < count:
        if rng.random() < 0.005:
            events[rng.integers(len(events))]()
        sample = robot.next()
        if rng.random() < 0.1 and 0 < sample.time_ns - before.time_ns < 900_000_000:
            fault, _ = faults[rng.integers(len(faults))]
            record.add(fault(rng, before, sample).give(odometry))
            offered += 1
            if rng.random() < 0.5:
                continue  # the good one was lost
        state = sample.give(odometry)
        record.add(state)
        offered += 1
        if state.accepted:
            before = sample
    record.check()
    assert odometry.offered == odometry.accepted + sum(odometry.rejected.values()) == offered
    return odometry


@every_drive
def test_everything_at_once(name: str) -> None:
    odometry = everything(name, 6_000)
    assert {"gap", "clock_reset", "encoder_restart", "rebaseline"} <= odometry.events.keys()
    assert {reason for _, reason in recoverable(name)} <= odometry.rejected.keys()
    assert odometry.events.get("slip", 0) <= 1  # one false alarm in a thousand windows, of which there are 70


@pytest.mark.verify
@every_drive
def test_ten_million(name: str) -> None:
    """Half of them with faults between the good samples, half with everything at once."""
    for odometry in (without_a_trace(name, 5_000_000, covariance=False), everything(name, 5_000_000)):
        print(f"{name}: accepted {odometry.accepted}, rejected {odometry.rejected}, events {odometry.events}")


UNSEEN = {"new_counters": "encoder_restart", "lost_counts": "rebaseline", "new_clock": "clock_reset"}


@pytest.mark.parametrize("event", UNSEEN)
@every_drive
def test_what_was_not_seen_is_covered(name: str, event: str) -> None:
    """After a baseline anew the error is the motion meanwhile, and the covariance knows of it."""
    for seed in range(2):
        robot = Robot(name, seed)
        clean, hostile = WheelOdometry(robot_of(name)), WheelOdometry(robot_of(name))
        for k in range(400):
            if k in (100, 200, 300):
                getattr(robot, event)()
            sample = robot.next()
            robot.last.give(clean)
            sample.give(hostile)
        assert hostile.events[UNSEEN[event]] >= 3
        error = hostile.state.pose.inverse() @ clean.state.pose
        e = np.array([error.x, error.y, error.theta])
        assert np.hypot(*e[:2]) > 0.01
        more = np.array(hostile.state.covariance) - 0.9 * np.array(clean.state.covariance)
        assert np.all(np.abs(e) <= 3.0 * np.sqrt(np.diag(more)))


# --- every reason ------------------------------------------------------------------------------------------


REFUSED = set(
    "nonfinite shape range no_gyro too_soon out_of_order duplicate duplicate_conflict implausible jump "
    "ambiguous_wrap time_range".split()
)
HAPPENED = set("gap clock_reset encoder_restart rebaseline increments_lost gyro_dropout".split())


def test_every_reason_can_be_reached() -> None:
    """And there are no others than these. (Slip and stuck wheels are met in test_slip.py.)"""
    source = inspect.getsource(wheel_odometry)
    assert set(re.findall(r'_reject\("(\w+)"', source)) <= REFUSED
    assert set(re.findall(r'_count_event\("(\w+)"', source)) <= {
        *HAPPENED,
        *("slip", "stuck_wheel", "wheel_recovered"),
    }
    refused: set[str] = set()
    happened: set[str] = set()
    for name in ("differential+gyro", "bicycle", "two trackers+gyro"):
        odometry = everything(name, 4000)
        refused |= odometry.rejected.keys()
        happened |= odometry.events.keys()
    encoder = tr.Encoder(ticks_per_revolution=100, bits=8)
    robot = tr.Robot(drive=DRIVES["differential"], encoders={"left": encoder, "right": encoder})
    counting = WheelOdometry(robot)
    counting.update(0.0, ticks=[0, 0])
    refused.add(counting.update(0.1, ticks=[128, 0]).reason)
    refused.add(counting.update(1e10, ticks=[1, 0]).reason)
    steps = WheelOdometry(robot)
    steps.update(0.0, increments=[0.0, 0.0])
    steps.update(0.1, increments=[math.nan, 0.0])
    happened.add(steps.update(0.2, increments=[0.1, 0.1]).reason)
    assert refused == REFUSED
    assert happened - {"slip", "stuck_wheel", "wheel_recovered"} == HAPPENED


# --- any sequence ------------------------------------------------------------------------------------------


class AnySequence(RuleBasedStateMachine):
    """Updates, resets and faults in any order, against an odometry that only saw what was good."""

    @initialize(name=st.sampled_from(sorted(DRIVES)), seed=st.integers(0, 10**6))
    def begin(self, name: str, seed: int) -> None:
        robot = robot_of(name)
        self.robot, self.faults = Robot(name, seed), recoverable(name)
        self.model, self.odometry = WheelOdometry(robot), WheelOdometry(robot)
        self.before = self.robot.shown(self.robot.last)
        self.offered, self.settled = 1, True
        for odometry in (self.model, self.odometry):
            self.before.give(odometry)

    def both(self, sample: Sample) -> None:
        wanted, state = sample.give(self.model), sample.give(self.odometry)
        self.offered += 1
        assert (state.accepted, state.reason) == (wanted.accepted, wanted.reason)
        self.settled = state.accepted
        if state.accepted:
            self.before = sample

    @rule(count=st.integers(1, 20))
    def drive(self, count: int) -> None:
        for _ in range(count):
            self.both(self.robot.next())

    @rule(data=st.data())
    def fault(self, data: Any) -> None:
        if not self.settled:
            return  # the counters began anew, and one implausible sample more would count
        make, reason = data.draw(st.sampled_from(self.faults))
        sample = self.robot.next()
        if not 0 < sample.time_ns - self.before.time_ns < 900_000_000:
            return
        state = make(self.robot.rng, self.before, sample).give(self.odometry)
        self.offered += 1
        assert (state.accepted, state.reason) == (False, reason)
        self.both(sample)

    @rule(which=st.sampled_from(["pause", "new_clock", "new_counters", "lost_counts"]))
    def event(self, which: str) -> None:
        getattr(self.robot, which)()
        self.settled = False

    @rule(x=st.floats(-1e3, 1e3), theta=st.floats(-10.0, 10.0))
    def reset(self, x: float, theta: float) -> None:
        for odometry in (self.model, self.odometry):
            odometry.reset(Pose2D(x, -x, theta))
            assert odometry.state.pose == Pose2D(x, -x, theta)

    @invariant()
    def sound(self) -> None:
        if not hasattr(self, "odometry"):
            return
        odometry = self.odometry
        assert odometry.offered == odometry.accepted + sum(odometry.rejected.values()) == self.offered
        state, wanted = odometry.state, self.model.state
        assert math.hypot(state.pose.x - wanted.pose.x, state.pose.y - wanted.pose.y) < 1e-9
        covariance = np.array(state.covariance)
        assert np.isfinite(covariance).all()
        assert np.linalg.eigvalsh(covariance)[0] >= -1e-12 * np.trace(covariance)
        np.testing.assert_allclose(state.upper, wanted.upper, rtol=1e-9, atol=1e-12)


AnySequence.TestCase.settings = settings(max_examples=25, stateful_step_count=30)
TestAnySequence = AnySequence.TestCase
