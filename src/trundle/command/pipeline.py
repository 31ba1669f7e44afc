"""From what is wanted of a robot to what its wheels are told, one control period at a time."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from trundle.command.envelope import Envelope
from trundle.command.frame import discretize
from trundle.command.motor import Motor
from trundle.command.ramp import Ramp, RampState
from trundle.command.reason import Reason
from trundle.command.saturation import Saturation, saturate
from trundle.command.steering import Steering, SteeringState
from trundle.command.watchdog import Demand
from trundle.errors import require_choice, require_positive
from trundle.geometry import Twist2D
from trundle.robot import Kinematics, Robot, WheelCommand

__all__ = ["CommandPipeline", "DriveCommand", "PipelineState"]

_REST = Twist2D()
_STALLED = 0.5  # after a longer pause of the control loop [s] nobody knows what the robot does


class DriveCommand(msgspec.Struct, frozen=True):
    """What goes out, and why.

    Attributes:
        twist: Body twist that the robot is told to do now.
        target: Body twist that it is on its way to: the wanted one, within its limits.
        wheels: Wheel speeds [rad/s] and steering angles [rad].
        efforts: The speeds as shares of the greatest, -1 to 1; empty without `max_wheel_speed`.
        reasons: What stands between the wanted twist and this one; empty where they are the same.
    """

    twist: Twist2D
    target: Twist2D
    wheels: WheelCommand
    efforts: tuple[float, ...] = ()
    reasons: tuple[Reason, ...] = ()


class PipelineState(msgspec.Struct, frozen=True):
    """What the next period needs of the last one.

    Attributes:
        time_ns: Of the last step, monotonic [ns]; None before the first.
        ramp: Twist and acceleration commanded last.
        steering: Angles commanded last.
    """

    time_ns: int | None
    ramp: RampState
    steering: SteeringState


class CommandPipeline:
    """Twist -> limits -> ramp -> inverse -> desaturation -> dead band -> -1 to 1. Immutable.

    The limits keep the curvature that was commanded (by the policy); the ramp goes straight through
    twist space; every step states why the wanted twist is not the commanded one. Nothing here raises
    because of a demand that a `Watchdog` made.

    Args:
        robot: A Robot, whose limits hold; or a drive, which has none.
        period: Nominal control period [s].
        saturation: What gives way first.
        discretize: For holonomic drives: correct each twist so that, held for a period, it lands where
            it was meant to although the robot turns meanwhile.
        steering: How steered wheels turn; by default `Steering` with its own defaults. It must be for
            `envelope.drive` of this robot, whose ranges hold `max_steering`.
        min_wheel_speed: Slowest speed that the motors hold [rad/s].
        dead_band: When no wheel is faster, all stand still [rad/s].

    Attributes:
        envelope: What the robot can do.
        steering: How steered wheels turn.

    Raises:
        ConfigError: If a number is impossible, or `discretize` is asked of a drive that is not holonomic.
    """

    def __init__(
        self,
        robot: Robot | Kinematics,
        *,
        period: float = 0.02,
        saturation: Saturation | str = Saturation.SCALE_ALL,
        discretize: bool = False,
        steering: Steering | None = None,
        min_wheel_speed: float = 0.0,
        dead_band: float = 0.0,
    ) -> None:
        robot = Robot(drive=robot) if isinstance(robot, Kinematics) else robot
        self.period = require_positive("period", period)
        self.saturation = require_choice("saturation", saturation, Saturation)
        self.envelope = Envelope(robot, period=period if discretize else None)
        self.steering = Steering(self.envelope.drive) if steering is None else steering
        self._ramp = Ramp(robot.limits, period, self.envelope.load)
        self._patience_ns = round(min(robot.limits.command_lifetime, _STALLED) * 1e9)
        greatest = robot.limits.max_wheel_speed
        # Without a greatest speed there is nothing to normalise by, but motors still stall.
        self._motor = Motor(max_speed=greatest or 1e12, min_speed=min_wheel_speed, dead_band=dead_band)
        self._normalizes = greatest is not None

    def start(self, twist: Twist2D = _REST, angles: Sequence[float] | None = None) -> PipelineState:
        """The state before the first step.

        Args:
            twist: How the robot moves now.
            angles: Measured steering angles [rad]; all zero if None.
        """
        return PipelineState(None, RampState(twist), self.steering.start(angles))

    def step(
        self,
        state: PipelineState,
        demand: Demand | Twist2D,
        now_ns: int,
        angles: Sequence[float] | None = None,
    ) -> tuple[DriveCommand, PipelineState]:
        """What to send now, and the state.

        Args:
            state: The state before.
            demand: What is wanted: a watchdog's demand, or a twist.
            now_ns: Monotonic clock [ns].
            angles: Measured steering angles [rad], in `steered_names` order, where there are any.

        Raises:
            InputError: If a twist that did not go through a watchdog is not finite.
            ShapeError: If there is not one angle per steered wheel.
        """
        if isinstance(demand, Twist2D):
            demand = Demand(demand)
        waited_ns = 0 if state.time_ns is None else now_ns - state.time_ns
        if demand.at_once or waited_ns > self._patience_ns:
            reason = demand.reason if demand.at_once else Reason.LOOP_STALLED
            return self._send(state, RampState(), _REST, (reason,) if reason else (), now_ns, angles)
        target = saturate(demand.twist, self.envelope, self.saturation)
        ramp = self._advance(state.ramp, target.twist, waited_ns / 1e9)
        reasons = target.reasons if demand.reason is None else (demand.reason, *target.reasons)
        if ramp.twist != target.twist:
            reasons += (Reason.ACCELERATION,)
        return self._send(state, ramp, target.twist, reasons, now_ns, angles)

    def _advance(self, ramp: RampState, target: Twist2D, seconds: float) -> RampState:
        """One step of the ramp, through twists that the wheels can do."""
        after = self._ramp.step(ramp, target, seconds)
        twist = self.envelope.project(after.twist)[0]
        if target != _REST and not self.envelope.steerable(twist):
            # A car changes between forwards and backwards at rest: on the straight line it would have
            # to turn on the spot.
            after = self._ramp.step(ramp, _REST, seconds)
            twist = self.envelope.project(after.twist)[0]
        # Beyond a limit that was lowered the ramp comes down at its own rate.
        allowed = max(1.0, self.envelope.load(ramp.twist))
        if self.envelope.load(twist) > allowed or not self.envelope.steerable(twist):
            twist = saturate(twist, self.envelope).twist
        return RampState(twist, after.acceleration)

    def _send(
        self,
        state: PipelineState,
        ramp: RampState,
        target: Twist2D,
        reasons: tuple[Reason, ...],
        now_ns: int,
        angles: Sequence[float] | None,
    ) -> tuple[DriveCommand, PipelineState]:
        held = ramp.twist
        if self.envelope.period is not None:
            held = discretize(held, self.envelope.period)
        wheels, steering = self.steering.step(state.steering, held, angles)
        settled = self._motor.settle(wheels.speeds)
        if settled != wheels.speeds:
            reasons += (Reason.STALL,)
        command = DriveCommand(
            ramp.twist,
            target,
            WheelCommand(settled, wheels.steering),
            self._motor.normalize(settled) if self._normalizes else (),
            reasons,
        )
        return command, PipelineState(now_ns, ramp, steering)
