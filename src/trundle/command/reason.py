"""Why the robot will not do exactly what was asked."""

from __future__ import annotations

import enum

__all__ = ["Reason"]


class Reason(enum.Enum):
    """One thing that stood between the wanted motion and the achieved one, in words for people."""

    SIDEWAYS = "this drive cannot move like that without slipping sideways"
    SPEED = "faster than max_speed or max_lateral_speed"
    YAW_RATE = "turns faster than max_yaw_rate"
    WHEEL_SPEED = "a wheel would be faster than max_wheel_speed"
    STEERING = "tighter than the steering can turn"
    TURN_ON_THE_SPOT = "this drive cannot turn on the spot"
    ACCELERATION = "on its way: acceleration or jerk is limited"
    STALL = "a wheel would be slower than its motor can hold"
    NO_COMMAND = "no command has come yet"
    TIMEOUT = "no command for longer than command_timeout"
    LOOP_STALLED = "the control loop stood still for too long: it begins again from rest"
    EMERGENCY_STOP = "emergency stop: needs a reset, then a zero command"
