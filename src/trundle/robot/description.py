"""A robot, described once: its drive, encoders, limits, noise, and how its logs say it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any, Literal

import msgspec

from trundle.errors import ConfigError, InputError, require_finite, require_positive, row_of, shown
from trundle.robot.kinematics import Kinematics
from trundle.robot.log_mapping import LogMapping

__all__ = ["UNMEASURED", "CalibrationRecord", "Encoder", "Limits", "Noise", "Robot"]


class Encoder(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a wheel's rotation becomes counts.

    Attributes:
        ticks_per_revolution: Counts per turn of the wheel, gears and quadrature included.
        bits: Width of the counter, which wraps; None if it never does.
        inverted: It counts down when the robot drives forward.
    """

    ticks_per_revolution: float
    bits: int | None = None
    inverted: bool = False

    def __post_init__(self) -> None:
        require_positive("ticks_per_revolution", self.ticks_per_revolution)
        if self.bits is not None and not (isinstance(self.bits, Integral) and 2 <= self.bits <= 64):
            raise ConfigError("bits", f"{shown(self.bits)}, must be a whole number from 2 to 64")
        if self.bits is not None and type(self.bits) is not int:  # NumPy's overflow where they are shifted
            msgspec.structs.force_setattr(self, "bits", int(self.bits))

    @property
    def radians_per_tick(self) -> float:
        """Signed angle of the wheel per count [rad]."""
        return (-math.tau if self.inverted else math.tau) / self.ticks_per_revolution


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the robot may do, SI units. None means no limit; only the timeout always has a value.

    Attributes:
        min_speed: Below it the motors stall [m/s]; it is no limit, but what a dead band is made of.
        max_speed: Forward speed [m/s].
        max_lateral_speed: Sideways speed [m/s].
        max_yaw_rate: [rad/s].
        max_acceleration: Speeding up [m/s^2].
        max_deceleration: Slowing down [m/s^2]; the acceleration where it is not given.
        max_yaw_acceleration: [rad/s^2].
        max_jerk: [m/s^3].
        max_wheel_speed: [rad/s].
        max_steering: Greatest steering angle either way [rad].
        command_timeout: A command older than this stops the robot [s]. Only the word "never"
            switches that off, and `warnings` says so.
    """

    min_speed: float | None = None
    max_speed: float | None = None
    max_lateral_speed: float | None = None
    max_yaw_rate: float | None = None
    max_acceleration: float | None = None
    max_deceleration: float | None = None
    max_yaw_acceleration: float | None = None
    max_jerk: float | None = None
    max_wheel_speed: float | None = None
    max_steering: float | None = None
    command_timeout: float | Literal["never"] = 0.5

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            value = getattr(self, field)
            absent = (
                isinstance(value, str) and value == "never" if field == "command_timeout" else value is None
            )
            if not absent:
                require_positive(field, value)
        if self.min_speed is not None and self.max_speed is not None and self.min_speed > self.max_speed:
            raise ConfigError("min_speed", f"{self.min_speed:g}, must be <= max_speed ({self.max_speed:g})")
        if self.max_steering is not None and self.max_steering > math.pi:
            raise ConfigError("max_steering", f"{self.max_steering:g} rad, must be <= pi; degrees?")

    @property
    def command_lifetime(self) -> float:
        """Age at which a command stops the robot [s]; infinite where it never does."""
        return math.inf if self.command_timeout == "never" else float(self.command_timeout)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person must be told on every start."""
        if self.command_timeout != "never":
            return ()
        return ("limits.command_timeout is never: the last command holds even when its source has died",)


class Noise(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far readings and assumptions are off, as standard deviations.

    What is not given has the default below. A robot that says nothing about its noise has that of
    `UNMEASURED`, which is another.

    Attributes:
        wheel_distance: Of the distance a wheel rolled, after one metre; it grows with the square
            root of the distance [m per sqrt(m)].
        lateral_slip: Of the sideways motion of the body that "no slip" denies, likewise
            [m per sqrt(m)].
        steering: Of a measured steering angle [rad].
        gyro: Of a gyro's yaw rate, white [rad/s per sqrt(Hz)].
        wheel_radius: Of each wheel's radius as described, as a fraction; it never averages out.
        track_width: Of the distances between wheels as described, as a fraction of them.
    """

    wheel_distance: float = 0.01
    lateral_slip: float = 0.0
    steering: float = 0.0
    gyro: float = 0.001
    wheel_radius: float = 0.0
    track_width: float = 0.0

    def __post_init__(self) -> None:
        for field in self.__struct_fields__:
            if require_finite(field, getattr(self, field)) < 0.0:
                raise ConfigError(field, f"{getattr(self, field):g}, must be >= 0")


UNMEASURED = Noise(wheel_distance=0.01, lateral_slip=0.01, wheel_radius=0.005, track_width=0.05)
"""The noise of a robot whose wheels were measured with a ruler and whose odometry was never judged.

It fits five robots that others recorded (docs/uncertainty.md); each of them is better or worse by itself.
"""


class CalibrationRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the calibration that gave a description its numbers knew about them.

    Attributes:
        version: Of these fields and of what their names mean.
        robot: Name of the robot that was calibrated.
        sigmas: Standard deviations by the names of the parameters, such as `wheel_radius.left`, in the unit
            of each.
    """

    robot: str
    version: int = 1
    sigmas: Mapping[str, float] = {}

    def __post_init__(self) -> None:
        if self.version != 1:
            problem = f"{self.version}, must be 1: another Trundle wrote it; calibrate again, or remove it"
            raise ConfigError("version", problem)
        for name, sigma in self.sigmas.items():
            require_positive(f"sigmas.{name}", sigma)


class Robot(msgspec.Struct, frozen=True, kw_only=True):
    """A robot: nothing here is state, everything is description.

    Attributes:
        drive: The wheels that drive it, and which of them are measured.
        name: For people.
        encoders: By wheel name; a wheel without one is read in radians only.
        limits: What commands may ask for.
        noise: How far readings are off; `UNMEASURED` where nobody says.
        log: How its logs say what was measured.
        localizer: Other wheels that measure in the drive's place, or None.
        calibration: Where the numbers come from, if they were calibrated.
    """

    drive: Kinematics
    name: str = "robot"
    encoders: Mapping[str, Encoder] = {}
    limits: Limits = Limits()
    noise: Noise = UNMEASURED
    log: LogMapping = LogMapping()
    localizer: Kinematics | None = None
    calibration: CalibrationRecord | None = None

    def __post_init__(self) -> None:
        for field, kind in (("limits", Limits), ("noise", Noise), ("log", LogMapping), ("encoders", Mapping)):
            if not isinstance(getattr(self, field), kind):
                word = "{wheel: Encoder(...)}" if kind is Mapping else f"a {kind.__name__}"
                raise ConfigError(field, f"{shown(getattr(self, field))}, must be {word}")
        for wheel, encoder in self.encoders.items():
            if not isinstance(encoder, Encoder):
                raise ConfigError(f"encoders.{wheel}", f"{shown(encoder)}, must be an Encoder")
        if not isinstance(self.calibration, CalibrationRecord | None):
            raise ConfigError("calibration", f"{shown(self.calibration)}, must be a CalibrationRecord")
        if self.calibration is not None and self.calibration.robot != self.name:
            problem = f"{self.calibration.robot!r}, but this robot is {self.name!r}: no other robot's numbers"
            raise ConfigError("calibration.robot", f"{problem} fit it; calibrate it, or remove the section")
        for field in ("drive", "localizer"):
            value = getattr(self, field)
            if not isinstance(value, Kinematics) and (field == "drive" or value is not None):
                raise ConfigError(field, f"{shown(value)}, must be a drive, such as Differential(...)")

    def __repr__(self) -> str:
        measured = f", measured by {self.localizer!r}" if self.localizer is not None else ""
        said = {
            "encoders": self.encoders,
            "limits": self.limits != Limits(),
            "noise": self.noise != UNMEASURED,
        }
        said["log"] = self.log != LogMapping()
        more = ", ".join(section for section, there in said.items() if there)
        return f"<Robot {self.name!r}: {self.drive!r}{measured}{more and '; ' + more}>"

    @property
    def measuring(self) -> Kinematics:
        """The wheels whose readings say how the robot moved: the localizer, or the drive."""
        return self.drive if self.localizer is None else self.localizer

    def encoders_of(self, names: Sequence[str]) -> tuple[Encoder, ...]:
        """The encoders of these wheels.

        Raises:
            InputError: If a wheel has none.
        """
        if not all(isinstance(name, str) for name in row_of(names) or [None]):
            raise InputError(f"encoders_of: names {shown(names)}, must be a list of wheels")
        missing = [name for name in names if name not in self.encoders]
        if missing:
            raise InputError(f"ticks need encoders: {{ticks_per_revolution: ...}} for {', '.join(missing)}")
        return tuple(self.encoders[name] for name in names)

    def with_localizer(self, localizer: Kinematics | None) -> Robot:
        """The same robot, measured by other wheels; the same wheels drive it."""
        return self.replace(localizer=localizer)

    def replace(self, **changes: Any) -> Robot:
        """The same robot with other fields."""
        return msgspec.structs.replace(self, **changes)
