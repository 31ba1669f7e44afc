"""A mobile base without ROS: samples and commands in, poses and wheel commands out. Time is data.

The mathematics is `WheelOdometry` and `CommandPipeline`; here stands what happens when: which samples and
commands count, what a new parameter changes, what an emergency stop, a deactivation or a new clock leave.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec

from trundle.adapters.robot_data import robot_to_data
from trundle.apps.ros2.joints import Joints
from trundle.apps.ros2.lease import Lease, Source
from trundle.apps.ros2.parameters import Settings
from trundle.apps.ros2.stamps import LEAP_NS, StampJudge, Verdict
from trundle.command import CommandPipeline, DriveCommand, Latch, Rejection, Watchdog, WatchdogState
from trundle.geometry import Pose2D, Twist2D
from trundle.odometry import OdometryState, WheelOdometry
from trundle.odometry.covariance import Six, in_odom_frame
from trundle.robot import Robot, WheelCommand

__all__ = ["Base", "Prepared", "Report"]

_READING_LIFETIME_NS = 200_000_000  # an older yaw rate or steering angle says nothing about now
_LEASE_WITHOUT_TIMEOUT = 0.5  # where commands never grow old, whoever drives may still fall silent [s]


class Report(NamedTuple):
    """An odometry message's worth.

    Attributes:
        state: Stamp, pose and twist.
        covariance: Of the pose with x and y along the axes of the odom frame: upper triangle.
        twist_covariance: Of the twist: upper triangle.
    """

    state: OdometryState
    covariance: Six
    twist_covariance: Six


class Prepared(NamedTuple):
    """What is made of settings: all of it, or nothing."""

    settings: Settings
    joints: Joints
    measured: Robot
    pipeline: CommandPipeline
    watchdog: Watchdog
    lease_ns: int

    @property
    def keyword(self) -> str:
        """What `WheelOdometry.update` calls its reading."""
        return "velocities" if self.settings.open_loop else self.joints.keyword


class Base:
    """One robot's odometry and commands.

    Clocks: `now_ns` is monotonic, of this machine; `clock_ns` is that of the node, wall or simulated.
    Nothing here raises because of what a message said.

    Args:
        settings: What parameters say.

    Attributes:
        settings: The present ones.
        joints: Which joints are its wheels.
        odometry: Where it is.
        commands: What the watchdog knows.
        command: What was sent to the wheels last; None before the first.
        lease: Who drives.
        active: Whether it takes anything in.
        counts: Messages that came and went, and those that were refused before anything else saw them.

    Raises:
        ConfigError: If the settings do not fit the robot.
    """

    def __init__(self, settings: Settings) -> None:
        self._parts = _made(settings)
        self.odometry = WheelOdometry(self._parts.measured)
        self._pipeline_state = self._parts.pipeline.start()
        self.commands = WatchdogState()
        self.command: DriveCommand | None = None
        self.lease = Lease()
        self.active = False
        self.counts: Counter[str] = Counter()
        self._judge = StampJudge()
        self._published_ns: int | None = None
        self._yaw: tuple[int, float] | None = None
        self._steering: tuple[int, Sequence[float]] | None = None
        self._last_sample: dict[str, Any] | None = None

    @property
    def settings(self) -> Settings:
        """What the parameters amount to."""
        return self._parts.settings

    @property
    def joints(self) -> Joints:
        """Which joints are its wheels."""
        return self._parts.joints

    # --- what the operator does -----------------------------------------------------------------

    def prepared(self, settings: Settings) -> Prepared:
        """Everything that settings would change, for `adopt`. Nothing has changed yet.

        Raises:
            ConfigError: If they do not fit the robot.
        """
        return _made(settings)

    def adopt(self, parts: Prepared) -> None:
        """Change every setting at once. The pose stays; no motion is lost."""
        before = self._parts
        if _measuring(parts) != _measuring(before):
            alike = parts.keyword == before.keyword and parts.joints.factors == before.joints.factors
            self.odometry = self._renewed(parts.measured, self._last_sample if alike else None)
        self._parts = parts
        if parts.settings.robot != before.settings.robot:
            twist = Twist2D() if self.command is None else self.command.twist
            waiting = self._pipeline_state
            self._pipeline_state = msgspec.structs.replace(
                parts.pipeline.start(twist, waiting.steering.angles), time_ns=waiting.time_ns
            )

    def activate(self) -> None:
        """Begin to take in samples and commands. Nothing moves before a command has come."""
        self._forget()
        self.active = True

    def deactivate(self) -> WheelCommand:
        """Take in nothing any more; the command to stop, at once."""
        self.active = False
        self._forget()
        return self.rest()

    def rest(self) -> WheelCommand:
        """All wheels still, steered ones as they are."""
        drive = self.settings.robot.drive
        angles = self._pipeline_state.steering.angles
        return WheelCommand((0.0,) * len(drive.wheel_names), angles)

    def emergency_stop(self, now_ns: int) -> DriveCommand:
        """Latch; the command to stop, at once."""
        self.commands = self._parts.watchdog.emergency_stop(self.commands)
        return self._drive(now_ns)

    def release(self) -> str:
        """Lift the emergency stop; what must happen before the robot moves."""
        if self.commands.latch is Latch.OPEN:
            return "there is no emergency stop"
        self.commands = self._parts.watchdog.reset(self.commands)
        return "released; the robot moves once a command of zero has come"

    def set_pose(self, pose: Pose2D, covariance: Six) -> None:
        """Say where the robot is.

        Args:
            pose: In the odom frame.
            covariance: Upper triangle, of the body-frame error.

        Raises:
            InputError: If a number is not finite.
        """
        self.odometry.reset(pose, covariance=covariance)

    # --- what sensors say -----------------------------------------------------------------------

    def on_imu(self, shown: float, now_ns: int) -> None:
        """Keep a yaw rate for the next samples of the wheels."""
        if self.active:
            self.counts["imu"] += 1
            self._yaw = (now_ns, self.joints.yaw_rate(shown))

    def on_joint_states(
        self, names: Sequence[str], message: Any, stamp_ns: int, now_ns: int, clock_ns: int
    ) -> Report | None:
        """Take a sample of the wheels; what to publish, if it counts."""
        if not self.active:
            return None
        self.counts["joint_states"] += 1
        reading = self.joints.read(names, message)
        if isinstance(reading, str):
            self.counts[f"refused {reading}"] += 1
            return None
        self._steering = (now_ns, reading.steering)
        if self.settings.open_loop:
            return None
        time_ns = clock_ns if self.joints.receive_clock else stamp_ns
        verdict = self._judge.judge(time_ns, now_ns)
        if verdict is Verdict.DOUBTFUL:
            self.counts[f"refused {verdict.value}"] += 1
            return None
        sample = {
            "time_ns": time_ns,
            self.joints.keyword: reading.wheels,
            "steering": reading.steering,
            "yaw_rate": self._yaw_rate(now_ns),
        }
        return self._measure(sample)

    def _measure(self, sample: dict[str, Any]) -> Report | None:
        command = None if self.command is None or self.settings.open_loop else self.command.wheels
        if self.odometry.drive is not self.settings.robot.drive:
            command = None  # what the wheels are told says nothing about the localizer's
        if self.odometry.state.time_ns - sample["time_ns"] >= LEAP_NS:
            self._begin_anew()
        state = self.odometry.update(**sample, command=command)
        if not state.accepted:
            return None
        self._last_sample = sample
        before = self._published_ns
        if before is not None and before - LEAP_NS < state.time_ns <= before:
            return None  # R3: nobody gets a stamp twice
        self._published_ns = state.time_ns
        self.counts["odom"] += 1
        return Report(state, in_odom_frame(state.upper, state.pose.theta), self.odometry.twist_covariance)

    def _yaw_rate(self, now_ns: int) -> float | None:
        if self._yaw is None or not self.odometry.drive.gyro:
            return None
        came_ns, rate = self._yaw
        return rate if now_ns - came_ns <= _READING_LIFETIME_NS else None

    # --- what controllers want ------------------------------------------------------------------

    def on_command(
        self, twist: Twist2D, source: Source, now_ns: int, clock_ns: int, stamp_ns: int | None = None
    ) -> str:
        """Take a command.

        Args:
            twist: Whatever it says.
            source: Who sent it.
            now_ns: Monotonic clock.
            clock_ns: The node's clock, with which the stamp is compared.
            stamp_ns: When it was sent, where the message says so.

        Returns:
            Why it does not count; "" if it does.
        """
        if not self.active:
            return "inactive"
        self.counts["cmd_vel"] += 1
        if not self.lease.admits(source, now_ns, self._parts.lease_ns):
            self.counts["refused no_lease"] += 1
            return "no_lease"
        self.commands = self._parts.watchdog.receive(
            self.commands, twist, now_ns, stamp_ns=stamp_ns, clock_ns=clock_ns
        )
        rejection: Rejection | None = self.commands.last_rejection
        if rejection is not None:
            return rejection.value
        self.lease = self.lease.taken(source, now_ns)
        return ""

    def on_tick(self, now_ns: int, clock_ns: int) -> tuple[DriveCommand, Report | None]:
        """One period of control: what the wheels are told, and in open loop where that leads."""
        command = self._drive(now_ns)
        if not (self.active and self.settings.open_loop):
            return command, None
        sample = {
            "time_ns": clock_ns,
            "velocities": self.odometry.drive.select(command.wheels.speeds),
            "steering": command.wheels.steering,
            "yaw_rate": self._yaw_rate(now_ns),
        }
        return command, self._measure(sample)

    def _drive(self, now_ns: int) -> DriveCommand:
        parts = self._parts
        demand = parts.watchdog.demand(self.commands, now_ns)
        self.command, self._pipeline_state = parts.pipeline.step(
            self._pipeline_state, demand, now_ns, self._angles(now_ns)
        )
        return self.command

    def _angles(self, now_ns: int) -> Sequence[float] | None:
        """Where the steered wheels really point, if that is known for each of them."""
        steered = self.settings.robot.drive.steered_names
        if self._steering is None or not steered or self.settings.robot.measuring.steered_names != steered:
            return None
        came_ns, angles = self._steering
        fresh = now_ns - came_ns <= _READING_LIFETIME_NS
        return angles if fresh and len(angles) == len(steered) else None

    # --- what is forgotten ----------------------------------------------------------------------

    def _forget(self) -> None:
        """Commands of before are no commands; only an emergency stop outlasts everything."""
        self.commands = msgspec.structs.replace(self.commands, twist=Twist2D(), received_ns=None)
        self.lease = Lease()
        self.command = None
        self._yaw = self._steering = None
        self._judge = StampJudge()
        angles = self._pipeline_state.steering.angles
        self._pipeline_state = self._parts.pipeline.start(angles=angles)

    def _begin_anew(self) -> None:
        """Another clock: the pose stays, and the next sample is a baseline."""
        self.odometry = self._renewed(self._parts.measured)
        self.odometry.events["clock_reset"] = self.odometry.events.get("clock_reset", 0) + 1
        self._published_ns = None

    def _renewed(self, robot: Robot, last: dict[str, Any] | None = None) -> WheelOdometry:
        """Odometry that is where the present one is, and has counted what it has counted.

        Args:
            robot: What measures from now on.
            last: The last sample, from which it counts on; without it the next one is a baseline.
        """
        before = self.odometry
        after = WheelOdometry(robot)
        if last is not None:
            after.update(**last)
        after.reset(before.state.pose, covariance=before.state.upper)
        after.accepted = before.accepted
        after.rejected, after.events = dict(before.rejected), dict(before.events)
        return after


def _made(settings: Settings) -> Prepared:
    """Everything that settings decide.

    Raises:
        ConfigError: If they do not fit the robot.
    """
    robot = settings.robot
    lifetime = robot.limits.command_lifetime
    lease = lifetime if math.isfinite(lifetime) else _LEASE_WITHOUT_TIMEOUT
    measured = robot.with_localizer(None) if settings.open_loop else robot
    return Prepared(
        settings,
        Joints(robot),
        measured,
        CommandPipeline(robot, period=1.0 / settings.update_rate),
        Watchdog(timeout=lifetime),
        round(lease * 1e9),
    )


def _measuring(parts: Prepared) -> tuple[Any, ...]:
    """What odometry is made of, as something to compare."""
    described = robot_to_data(parts.measured)
    wanted = ("drive", "localizer", "encoders", "noise")
    return (parts.keyword, *(described.get(name) for name in wanted))
