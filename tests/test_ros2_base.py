"""The ROS 2 node without ROS: whatever comes, in whatever order, the robot stops when it must.

What the real node does with real processes is in tests/ros2.
"""

from __future__ import annotations

import math
import random
from itertools import pairwise
from types import SimpleNamespace

import pytest

from trundle import ConfigError, Differential, Limits, LogMapping, Noise, Pose2D, Robot, Twist2D, integrate
from trundle.apps.ros2.base import Base
from trundle.apps.ros2.diagnostics import Diagnostics, Level
from trundle.apps.ros2.endpoints import Endpoint, QoS, chosen_type, mismatches
from trundle.apps.ros2.lease import Source
from trundle.apps.ros2.parameters import Settings, configured, declared
from trundle.command import Reason
from trundle.records import Reading, WheelLog
from trundle.robot import Ackermann, Bicycle, Mecanum, Omni
from trundle.robot.log_mapping import Clock

MS = 1_000_000
S = 1_000 * MS
HOUR = 3600 * S
WALL = 1_790_000_000 * S
PERIOD = 20 * MS

LIMITS = Limits(
    max_speed=1.0, max_yaw_rate=2.0, max_acceleration=1.0, max_deceleration=2.0, command_timeout=0.5
)
DRIVE = Differential(track_width=0.2, wheel_radius=0.05)
ROVER = Robot(drive=DRIVE, limits=LIMITS, noise=Noise(wheel_distance=0.01))
AHEAD = Twist2D(0.6, 0.0, 0.3)
JOY, NAV = Source("/joy", "a", 0), Source("/nav", "b", 1)


class Bench:
    """A base on a fake clock: monotonic time, and a wall clock that may be stepped."""

    def __init__(self, robot=ROVER, **settings):
        self.base = Base(Settings(robot=robot, **settings))
        self.base.activate()
        self.now = 100 * S
        self.wall_ahead = WALL
        self.turned = [0.0, 0.0]
        self.published = []

    @property
    def wall(self):
        return self.now + self.wall_ahead

    def command(self, twist=AHEAD, source=NAV, stamp=None):
        return self.base.on_command(twist, source, self.now, self.wall, stamp)

    def tick(self, after=PERIOD):
        """One period; what the wheels are told."""
        self.now += after
        command, report = self.base.on_tick(self.now, self.wall)
        self._keep(report)
        return command

    def ticks(self, seconds):
        return [self.tick() for _ in range(round(seconds * S / PERIOD))]

    def sample(self, wheels=None, stamp=None, names=("left", "right")):
        if wheels is not None:
            self.turned = list(wheels)
        by_name = dict(zip(("left", "right"), self.turned, strict=True))
        message = SimpleNamespace(position=[by_name.get(name, 7.0) for name in names], velocity=[], effort=[])
        stamp = self.wall if stamp is None else stamp
        report = self.base.on_joint_states(list(names), message, stamp, self.now, self.wall)
        return self._keep(report)

    def drive(self, count, step=0.05, after=5 * MS):
        """Samples of wheels that roll on."""
        for _ in range(count):
            self.now += after
            self.turned = [self.turned[0] + step, self.turned[1] + 1.1 * step]
            self.sample()
        return self.base.odometry.state.pose

    def _keep(self, report):
        if report is not None:
            self.published.append(report)
        return report


def still(command):
    return not any(command.wheels.speeds)


def stops_from(bench, silent_since):
    """From the last command that counted: the ramp begins in time, goes down steadily, and ends."""
    speeds = []
    while bench.now < silent_since + 5 * S:
        command = bench.tick()
        speeds.append((bench.now - silent_since, abs(command.twist.vx), command.target))
    late = [entry for entry in speeds if entry[0] > 500 * MS]
    assert all(target == Twist2D() for _, _, target in late)
    falling = [speed for _, speed, _ in late]
    assert all(a >= b for a, b in pairwise(falling))
    assert all(speed == 0.0 for age, speed, _ in late if age > (0.5 + 0.6 / 2.0 + 0.04) * S)
    assert Reason.TIMEOUT in command.reasons


def fault_k1():
    """NaN, infinite or huge commands count for nothing; the one before keeps ageing."""
    bench = Bench()
    bench.command()
    bench.ticks(1 * 0.4)
    came = bench.now - 400 * MS
    for bad in (math.nan, math.inf, -math.inf, 1e300):
        assert bench.command(Twist2D(bad, 0.0, 0.0)) in ("nonfinite", "implausible")
        assert bench.command(Twist2D(0.0, 0.0, bad)) in ("nonfinite", "implausible")
    stops_from(bench, came)
    assert sum(bench.base.commands.rejected.values()) == 8


def fault_k2():
    """A source that dies."""
    bench = Bench()
    assert still(bench.tick())
    for _ in range(50):
        bench.command()
        bench.tick()
    assert bench.base.command.twist == AHEAD
    stops_from(bench, bench.now - PERIOD)


def fault_k3():
    """Stamps an hour off, and a wall clock that is set: neither drives nor stops the robot."""
    bench = Bench()
    assert bench.command(stamp=bench.wall + HOUR) == "future"
    assert bench.command(stamp=bench.wall - HOUR) == "stale"
    assert bench.command(stamp=0) == "stale"
    assert still(bench.tick())
    bench.command(stamp=bench.wall)
    came = bench.now
    bench.wall_ahead += 86_400 * S
    assert not still(bench.tick())
    bench.wall_ahead -= 2 * 86_400 * S
    assert not still(bench.tick())
    stops_from(bench, came)


def fault_k4():
    """After five seconds without a loop the first word is stop; then it begins anew, slowly."""
    bench = Bench()
    for _ in range(100):
        bench.command()
        bench.tick()
    bench.now += 5 * S
    bench.command()
    command = bench.tick(0)
    assert still(command)
    assert command.reasons == (Reason.LOOP_STALLED,)
    assert 0.0 < bench.tick().twist.vx <= 1.0 * 0.02 + 1e-12


def fault_k11():
    """An emergency stop is zero at once and stays, whatever is sent, until reset and a zero command."""
    bench = Bench()
    for _ in range(10):
        bench.command()
        bench.tick()
    assert still(bench.base.emergency_stop(bench.now))
    for _ in range(10):
        assert bench.command() == "emergency_stop"
        assert still(bench.tick())
    bench.base.deactivate()
    bench.base.activate()
    assert bench.command() == "emergency_stop"
    assert "zero" in bench.base.release()
    assert bench.command() == "emergency_stop"
    assert still(bench.tick())
    assert bench.command(Twist2D()) == ""
    assert bench.command() == ""
    assert not still(bench.tick())
    assert bench.base.release() == "there is no emergency stop"


def fault_k12():
    """One controller drives; a more important one takes over; silence gives the robot back."""
    bench = Bench()
    other = Source("/nav", "c", 1)
    assert bench.command(source=NAV) == ""
    assert bench.command(Twist2D(-0.5, 0.0, 0.0), source=other) == "no_lease"
    bench.tick()
    assert bench.base.command.target == AHEAD
    assert bench.command(Twist2D(0.1, 0.0, 0.0), source=JOY) == ""
    assert bench.command(source=NAV) == "no_lease"
    bench.tick()
    assert bench.base.command.target == Twist2D(0.1, 0.0, 0.0)
    bench.ticks(0.48)
    assert bench.command(source=NAV) == "no_lease"
    bench.ticks(0.04)
    assert bench.command(source=NAV) == ""
    assert bench.base.counts["refused no_lease"] == 3
    # What does not count renews no lease.
    bench.now += 400 * MS
    assert bench.command(Twist2D(math.nan, 0.0, 0.0), source=NAV) == "nonfinite"
    bench.now += 200 * MS
    assert bench.command(source=other) == ""


def fault_r1():
    """What DDS keeps silent about: both types, or both qualities of service, in one sentence."""
    mine = [
        Endpoint("/trundle", "/joint_states", "JointState", publishes=False),
        Endpoint("/trundle", "/odom", "Odometry", publishes=True),
    ]
    theirs = [
        Endpoint("/driver", "/joint_states", "JointState", publishes=True, qos=QoS(reliable=False)),
        Endpoint("/old", "/joint_states", "Float64", publishes=True),
        Endpoint("/late", "/odom", "Odometry", publishes=False, qos=QoS(transient_local=True, deadline=0.1)),
        Endpoint("/fine", "/odom", "Odometry", publishes=False, qos=QoS(reliable=False)),
        Endpoint("/twin", "/odom", "Odometry", publishes=True),
    ]
    found = mismatches(mine, theirs)
    assert len(found) == 3
    assert "reliability" in found[0]
    assert "/driver publishes (best_effort, volatile)" in found[0]
    assert "/trundle subscribes (reliable, volatile)" in found[0]
    assert "Float64" in found[1]
    assert "JointState" in found[1]
    assert "durability, deadline" in found[2]
    bench = Bench()
    *_, topics = Diagnostics(bench.base, bench.now).report(bench.now + S, found)
    assert topics.level is Level.ERROR
    assert topics.message == found[0]


def fault_r2():
    """A clock that jumps back: a new epoch, the pose stays, and so does what is known of it."""
    bench = Bench()
    before = bench.drive(100)
    doubt = bench.base.odometry.state.upper
    bench.wall_ahead -= HOUR
    for _ in range(2):
        bench.now += 5 * MS
        assert bench.sample() is None
    assert bench.base.counts["refused clock_jump"] == 2
    bench.now += 5 * MS
    report = bench.sample()
    assert report.state.pose == before
    assert bench.base.odometry.events["clock_reset"] == 1
    assert bench.base.odometry.state.upper == doubt
    after = bench.drive(10)
    assert 0.0 < (before.inverse() @ after).x < 10 * 0.06 * 0.05
    # One stamp alone, an hour ahead or behind, costs nothing at all.
    for wrong in (HOUR, -HOUR):
        bench.now += 5 * MS
        assert bench.sample(stamp=bench.wall + wrong) is None
        bench.drive(1)
    assert bench.base.odometry.events["clock_reset"] == 1
    # Nor does a clock that is set while nobody looks.
    bench.base.deactivate()
    bench.wall_ahead -= HOUR
    bench.base.activate()
    bench.drive(2)
    assert bench.base.odometry.events["clock_reset"] == 2
    assert max(bench.base.odometry.state.upper) < 1e-2


def fault_r3():
    """No stamp is published twice, nor an earlier one after it."""
    bench = Bench()
    bench.drive(3)
    assert bench.sample() is None
    assert bench.sample([9.0, 9.0]) is None
    assert bench.sample(stamp=bench.wall - 1 * MS) is None
    bench.base.deactivate()
    bench.base.activate()
    assert bench.sample() is None
    bench.drive(3)
    stamps = [report.state.time_ns for report in bench.published]
    assert stamps == sorted(set(stamps))


def fault_r4():
    """Joints by name, whatever their order; a message that lacks one is refused."""
    bench, straight = Bench(), Bench()
    for k in range(1, 20):
        for one in (bench, straight):
            one.now += 5 * MS
        names = [("right", "left"), ("arm", "left", "right"), ("left", "right")][k % 3]
        assert bench.sample([0.02 * k, 0.04 * k], names=names) is not None
        straight.sample([0.02 * k, 0.04 * k])
        assert bench.sample(names=("left", "arm")) is None
    assert bench.base.odometry.state.pose == straight.base.odometry.state.pose
    assert bench.base.counts["refused missing_joint"] == 19


def fault_r5():
    """Deactivated: zero at once, and what was wanted before is forgotten."""
    bench = Bench()
    for _ in range(20):
        bench.command()
        bench.tick()
    pose = bench.drive(5)
    assert not any(bench.base.deactivate().speeds)
    assert bench.command() == "inactive"
    assert bench.sample() is None
    bench.base.activate()
    assert still(bench.tick())
    assert bench.base.command.reasons == (Reason.NO_COMMAND,)
    assert bench.base.odometry.state.pose == pose


def fault_r6():
    """Poses, covariances and twists of an hour of nonsense are finite."""
    bench = Bench()
    chance = random.Random(6)
    for _ in range(300):
        bench.now += 5 * MS
        bench.sample([chance.choice([math.nan, math.inf, 1e300, -1e300, 1.0, 2.0]) for _ in range(2)])
        state = bench.base.odometry.state
        assert all(map(math.isfinite, (state.pose.x, state.pose.y, state.pose.theta, *state.upper)))
    odometry = bench.base.odometry
    assert odometry.offered == odometry.accepted + sum(odometry.rejected.values()) == 300


ROWS = ("K1", "K2", "K3", "K4", "K11", "K12", "R1", "R2", "R3", "R4", "R5", "R6")


@pytest.mark.parametrize("row", [pytest.param(row, id=row) for row in ROWS])
def test_fault(row):
    globals()[f"fault_{row.lower()}"]()


# ------------------------------------------------------------------------- random schedules


class Expected:
    """What must hold at every tick, kept with nothing but times."""

    def __init__(self):
        self.counted_ns = self.holder = self.ticked_ns = None
        self.latch = "open"
        self.speed = 0.0

    def command(self, twist, source, now, problem):
        """A command came; what the base says of it."""
        free = self.holder is None or source == self.holder or source.priority < self.holder.priority
        if not free and now - self.renewed_ns <= 500 * MS:
            return "no_lease"
        if problem:
            return problem
        if self.latch == "latched" or (self.latch == "waiting" and twist != Twist2D()):
            return "emergency_stop"
        self.latch, self.holder = "open", source
        self.counted_ns = self.renewed_ns = now
        return ""

    def forget(self):
        self.counted_ns = self.holder = self.ticked_ns = None
        self.speed = 0.0

    def tick(self, command, now):
        """What was sent is finite, within limits, and nothing where nothing may be."""
        speed = math.hypot(command.twist.vx, command.twist.vy)
        assert all(map(math.isfinite, command.wheels.speeds))
        assert speed <= 1.0 + 1e-9
        stalled = self.ticked_ns is not None and now - self.ticked_ns > 500 * MS
        if self.latch != "open" or stalled:
            assert still(command)
        elif self.counted_ns is None or now - self.counted_ns > 500 * MS:
            waited = 0.0 if self.ticked_ns is None else (now - self.ticked_ns) / S
            assert speed <= max(self.speed - 2.0 * (min(waited, 0.04) or 0.02), 0.0) + 1e-9
            assert command.target == Twist2D()
        self.speed, self.ticked_ns = speed, now


PROBLEMS = {
    "nonfinite": lambda bench: (Twist2D(math.nan, 0.0, 0.0), None),
    "implausible": lambda bench: (Twist2D(0.0, 0.0, 1e9), None),
    "future": lambda bench: (AHEAD, bench.wall + HOUR),
    "stale": lambda bench: (AHEAD, bench.wall - HOUR),
}


def act(bench, expected, chance):
    """One thing that happens."""
    event = chance.choices(
        ("tick", "command", "bad", "sample", "stall", "stop", "release", "off", "clock", "limit"),
        (60, 25, 8, 20, 1, 1, 3, 0.5, 1, 1),
    )[0]
    base = bench.base
    if event == "tick":
        command = bench.tick(chance.choice([PERIOD, PERIOD, 15 * MS, 27 * MS]))
        expected.tick(command, bench.now)
    elif event == "stall":
        bench.now += chance.choice([600 * MS, 5 * S])
    elif event in ("command", "bad"):
        source = chance.choice([JOY, NAV, Source("/nav", "c", 1)])
        if event == "bad":
            problem = chance.choice(sorted(PROBLEMS))
            twist, stamp = PROBLEMS[problem](bench)
        else:
            problem, twist, stamp = "", chance.choice([AHEAD, Twist2D(), Twist2D(-5.0, 0.0, 9.0)]), None
        said = bench.command(twist, source, stamp)
        assert said == expected.command(twist, source, bench.now, problem)
    elif event == "sample":
        wheels = [chance.choice([1.0, 1.0, 1.0, math.nan, 1e9]) * (t + 0.02) for t in bench.turned]
        kept = bench.turned
        bench.sample(wheels, names=chance.choice([("left", "right"), ("right", "left"), ("left",)]))
        bench.turned = wheels if all(abs(wheel) < 1e3 for wheel in wheels) else kept
    elif event == "stop":
        command = base.emergency_stop(bench.now)
        assert still(command)
        expected.latch = "latched"
        expected.tick(command, bench.now)
    elif event == "release":
        base.release()
        expected.latch = "waiting" if expected.latch == "latched" else expected.latch
    elif event == "off":
        assert not any(base.deactivate().speeds)
        base.activate()
        expected.forget()
    elif event == "clock":
        bench.wall_ahead += chance.choice([-86_400 * S, HOUR, -200 * MS])
    else:
        values = {name: one.default for name, one in declared(ROVER).items()}
        values["angular.z.max_velocity"] = chance.choice([1.0, 2.0, 3.0])
        base.adopt(base.prepared(configured(ROVER, values)))


def test_a_thousand_random_schedules():
    """Whatever happens in whatever order: STOP when nobody drives, and nothing that is not finite."""
    for seed in range(1000):
        chance, bench, expected = random.Random(seed), Bench(), Expected()
        for _ in range(80):
            act(bench, expected, chance)
        odometry, commands = bench.base.odometry, bench.base.commands
        assert odometry.offered == odometry.accepted + sum(odometry.rejected.values())
        assert commands.offered == commands.accepted + sum(commands.rejected.values())
        xx, xy, yy, _, _, tt = odometry.state.upper
        assert min(xx, yy, tt, xx * yy - xy * xy + 1e-15) >= 0.0
        for one, other in pairwise(bench.published):
            ahead = other.state.time_ns - one.state.time_ns
            assert ahead > 0 or ahead <= -S, seed


# ------------------------------------------------------------------- odometry and settings


def test_live_is_the_log_integrated():
    """The same samples, one by one through the node's own code and at once through `integrate`."""
    bench, chance = Bench(), random.Random(1)
    rows, stamps = [], []
    left = right = 0.0
    for _ in range(500):
        bench.now += 5 * MS
        left, right = left + chance.uniform(0.0, 0.08), right + chance.uniform(0.0, 0.08)
        bench.sample([left, right])
        rows.append([left, right])
        stamps.append(bench.wall)
    log = WheelLog(time_ns=stamps, wheel_names=("left", "right"), wheels=rows, reading=Reading.POSITION)
    trajectory = integrate(ROVER, log)
    assert len(bench.published) == len(trajectory) == 500
    for report, pose in zip(bench.published, trajectory.poses, strict=True):
        state = report.state.pose
        assert (state.x, state.y, state.theta) == pytest.approx(tuple(pose), abs=1e-12)


def test_twist_covariance_is_that_of_the_step():
    """One wheel's rolling noise over a step, through the textbook's differential drive."""
    bench = Bench()
    bench.sample([0.0, 0.0])
    assert bench.base.odometry.twist_covariance == (0.0,) * 6
    bench.now += 100 * MS
    report = bench.sample([2.0, 2.0])
    rolled = 0.01**2 * (2.0 * 0.05)  # variance of what each wheel rolled
    xx, xy, yy, xt, yt, tt = report.twist_covariance
    assert (xx, tt) == pytest.approx((rolled / 2 / 0.01, 2 * rolled / 0.2**2 / 0.01))
    assert (xy, yy, xt, yt) == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-18)


def test_open_loop_counts_on_commands():
    bench = Bench(open_loop=True)
    for _ in range(100):
        bench.command(Twist2D(0.5, 0.0, 0.0))
        bench.tick()
        bench.sample([99.0, -99.0])
    # Half a second up to speed, then on: v^2 / 2a + v t, less one period from sampling at its end.
    assert bench.base.odometry.state.pose.x == pytest.approx(0.125 + 0.5 * 1.5, abs=0.02)
    assert len(bench.published) == 100


def test_receive_clock_stamps_what_comes():
    robot = ROVER.replace(log=LogMapping(clock=Clock.RECEIVE))
    bench = Bench(robot)
    report = bench.sample([0.0, 0.0], stamp=0)
    assert report.state.time_ns == bench.wall


def test_gyro_is_used_while_it_is_fresh():
    drive = Differential(track_width=0.2, wheel_radius=0.05, measured=("left", "right", "gyro"))
    bench = Bench(Robot(drive=drive))
    for _ in range(100):
        bench.base.on_imu(1.0, bench.now)
        bench.drive(1, after=10 * MS)
    assert bench.base.odometry.events.get("gyro_dropout") is None
    bench.drive(50, after=10 * MS)
    assert bench.base.odometry.events["gyro_dropout"] == 1


def values(**changes):
    return {name: one.default for name, one in declared(ROVER).items()} | changes


def test_parameters_bear_the_names_of_ros2_controllers():
    names = declared(ROVER)
    assert names["wheel_separation"].default == 0.2
    assert names["linear.x.max_deceleration"].default == -2.0
    assert math.isnan(names["linear.x.max_jerk"].default)
    assert configured(ROVER, values()).robot is ROVER
    assert "wheelbase" in declared(Robot(drive=Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05)))


def test_the_documentation_names_every_parameter(checkout):
    words = (checkout / "docs" / "ros2.md").read_text(encoding="utf-8")
    drives = (
        DRIVE,
        Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.05),
        Bicycle(wheelbase=0.3, wheel_radius=0.05),
        Mecanum(track_width=0.3, wheelbase=0.3, wheel_radius=0.05),
        Omni(robot_radius=0.2, wheel_radius=0.05),
    )
    named = {name for drive in drives for name in declared(Robot(drive=drive))}
    assert {name for name in named if f"`{name}`" not in words} == set()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"wheel_separation": -0.1}, "wheel_separation"),
        ({"wheel_radius": math.nan}, "wheel_radius"),
        ({"left_wheel_radius_multiplier": 0.0}, "left_wheel_radius_multiplier"),
        ({"cmd_vel_timeout": 0.0}, "cmd_vel_timeout"),
        ({"linear.x.max_velocity": -1.0}, "linear.x.max_velocity"),
        ({"linear.x.max_deceleration": 1.0}, "linear.x.max_deceleration"),
        ({"odom_frame_id": "/odom"}, "odom_frame_id"),
        ({"odom_frame_id": "base_link"}, "base_frame_id"),
        ({"update_rate": 0.0}, "update_rate"),
        ({"cmd_vel_topics": []}, "cmd_vel_topics"),
        ({"wheel_command_type": "pwm"}, "wheel_command_type"),
    ],
)
def test_impossible_parameters_are_refused_by_name(change, named):
    with pytest.raises(ConfigError) as caught:
        configured(ROVER, values(**change))
    assert caught.value.field == named


def test_parameters_change_the_robot_and_keep_its_pose():
    bench = Bench()
    bench.drive(50)
    pose = bench.base.odometry.state.pose
    changed = values(wheel_separation_multiplier=1.1, left_wheel_radius_multiplier=1.02)
    bench.base.adopt(bench.base.prepared(configured(ROVER, changed)))
    drive = bench.base.odometry.drive
    assert drive.wheel("left").radius == pytest.approx(0.051)
    assert drive.wheel("left").y == pytest.approx(0.11)
    assert bench.base.odometry.state.pose == pose
    accepted = bench.base.odometry.accepted
    bench.now += 5 * MS
    bench.sample([bench.turned[0] + 0.1, bench.turned[1] + 0.1])
    moved = pose.inverse() @ bench.base.odometry.state.pose
    assert moved.x == pytest.approx(0.1 * (0.051 + 0.05) / 2, abs=1e-6)  # no motion was lost
    assert bench.base.odometry.accepted == accepted + 1


def test_a_pose_can_be_set():
    bench = Bench()
    bench.drive(5)
    bench.base.set_pose(Pose2D(3.0, 2.0, 1.0), (0.1, 0.0, 0.1, 0.0, 0.0, 0.2))
    assert bench.base.odometry.state.pose == Pose2D(3.0, 2.0, 1.0)
    bench.drive(1)
    assert math.dist((3.0, 2.0), bench.base.odometry.state.mean_position) < 0.3
    assert bench.base.odometry.state.upper[5] >= 0.2


def test_diagnostics_say_what_is_wrong():
    bench = Bench()
    watch = Diagnostics(bench.base, bench.now)

    def levels():
        bench.now += S
        odometry, commands, _ = watch.report(bench.now)
        return odometry.level, commands.level, odometry.message + "|" + commands.message

    bench.tick()
    assert levels()[:2] == (Level.STALE, Level.OK)
    bench.drive(10)
    assert levels()[0] is Level.OK
    bench.sample([math.nan, 0.0])
    level, _, words = levels()
    assert level is Level.ERROR
    assert "nonfinite" in words
    bench.sample(names=("left",))
    bench.turned = [1.0, 1.0]
    bench.drive(1)
    level, _, words = levels()
    assert level is Level.WARN
    assert "missing_joint" in words
    bench.command()
    bench.tick(S)
    assert levels()[1] is Level.WARN
    bench.base.emergency_stop(bench.now)
    assert levels()[1] is Level.ERROR


def test_the_type_of_commands_is_that_of_their_publishers():
    known = ("Stamped", "Plain")
    assert chosen_type("Stamped", known, []) == "Stamped"
    assert chosen_type("Stamped", known, ["Plain"]) == "Plain"
    assert chosen_type("Plain", known, ["Plain", "Stamped"]) == "Plain"
    assert chosen_type("Plain", known, ["Strange"]) == "Plain"
