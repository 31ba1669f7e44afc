"""How a robot's logs say what its sensors measured: the `log:` section of robot.yaml."""

from __future__ import annotations

import enum
import math
from typing import Literal

import msgspec

from trundle.errors import ConfigError, require_finite, require_positive

__all__ = [
    "Clock",
    "Kind",
    "LogMapping",
    "ReferenceMapping",
    "ScalarMapping",
    "TableFormat",
    "TimeMapping",
    "TwistMapping",
    "Unit",
    "WheelMapping",
]


LONGEST_DELAY = 60.0  # [s]; more is another clock


class Clock(enum.Enum):
    """Which stamp of a message is its time."""

    HEADER = "header"
    RECEIVE = "receive"


class Kind(enum.Enum):
    """Whether a wheel column is a running total, what happened since the last row, or a speed."""

    POSITION = "position"
    INCREMENT = "increment"
    VELOCITY = "velocity"


class Unit(enum.Enum):
    """Units that logs are written in."""

    RAD = "rad"
    DEG = "deg"
    REV = "rev"
    TICKS = "ticks"
    M = "m"
    MM = "mm"
    CM = "cm"
    INCH = "in"
    FT = "ft"
    RAD_S = "rad/s"
    DEG_S = "deg/s"
    RAD_MIN = "rad/min"
    RPM = "rpm"
    REV_S = "rev/s"
    TICKS_S = "ticks/s"
    M_S = "m/s"
    MM_S = "mm/s"
    CM_S = "cm/s"
    FT_S = "ft/s"
    KM_H = "km/h"
    S = "s"
    MS = "ms"
    US = "us"
    NS = "ns"

    @property
    def dimension(self) -> str:
        """`angle`, `length`, `ticks`, `time`, or one of the first three followed by `/s`."""
        return _UNITS[self.value][0]

    @property
    def factor(self) -> float:
        """What one of this unit is in rad, m, ticks, s, rad/s, m/s or ticks/s."""
        return _UNITS[self.value][1]


_UNITS: dict[str, tuple[str, float]] = {
    "rad": ("angle", 1.0),
    "deg": ("angle", math.pi / 180.0),
    "rev": ("angle", math.tau),
    "ticks": ("ticks", 1.0),
    "m": ("length", 1.0),
    "mm": ("length", 1e-3),
    "cm": ("length", 1e-2),
    "in": ("length", 0.0254),
    "ft": ("length", 0.3048),
    "rad/s": ("angle/s", 1.0),
    "deg/s": ("angle/s", math.pi / 180.0),
    "rad/min": ("angle/s", 1.0 / 60.0),
    "rpm": ("angle/s", math.tau / 60.0),
    "rev/s": ("angle/s", math.tau),
    "ticks/s": ("ticks/s", 1.0),
    "m/s": ("length/s", 1.0),
    "mm/s": ("length/s", 1e-3),
    "cm/s": ("length/s", 1e-2),
    "ft/s": ("length/s", 0.3048),
    "km/h": ("length/s", 1.0 / 3.6),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "ns": ("time", 1e-9),
}


class _Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of the description: unknown keys are errors."""


class TimeMapping(_Section, frozen=True):
    """Where a table keeps its time.

    Attributes:
        column: Name of its column, or its number.
        unit: What it is written in.
        kind: `increment` where each row says how long it took. Its speeds are then means over the row.
    """

    column: str | int = "time"
    unit: Unit = Unit.S
    kind: Kind = Kind.POSITION

    def __post_init__(self) -> None:
        if self.kind is Kind.VELOCITY:
            raise ConfigError("kind", f"{self.kind.value!r}, must be position or increment")
        if self.unit.dimension != "time":
            raise ConfigError("unit", f"{self.unit.value!r}, must be one of s, ms, us, ns")


class ScalarMapping(_Section, frozen=True):
    """Where one number per row stands: a column of a table, or a field of a topic's messages.

    Attributes:
        column: Name of a table's column, or its number counted from 0 where it has no header.
        topic: Topic of a bag, entry of a data log.
        field: Dotted path inside the message, e.g. `position` or `angular.z`.
        name: Element of a named array (a joint in JointState), or of a plain one by number.
        unit: What the number is written in; None means the SI unit of its quantity.
        sign: -1 where the log counts the other way.
        hold: The value is logged only when it changes: the last one still holds.
        wraps: A steering angle that starts anew after a turn, wherever that is: it is then taken to lie
            within half a turn of straight ahead.
        gain: What the quantity really changes by where the number changes by 1 in its SI unit; of a steering
            angle in ticks, its radians per tick.
        offset: What it really is where the number says 0, in its SI unit: really = gain * said + offset.
    """

    column: str | int | None = None
    topic: str | None = None
    field: str | None = None
    name: str | int | None = None
    unit: Unit | None = None
    sign: Literal[1, -1] = 1
    hold: bool = False
    wraps: bool = False
    gain: float = 1.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        if (self.column is None) == (self.topic is None):
            raise ConfigError("", "needs either column (a table) or topic (a bag)")
        require_positive("gain", self.gain)
        require_finite("offset", self.offset)


class WheelMapping(ScalarMapping, frozen=True):
    """Where one wheel's reading stands, and what it says.

    Attributes:
        kind: Running total, change since the last row, or speed; by default what the unit says.
    """

    kind: Kind | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        speed = self.unit is not None and self.unit.dimension.endswith("/s")
        if self.unit is not None and self.unit.dimension == "time":
            raise ConfigError("unit", f"{self.unit.value!r} is a time, not a wheel reading")
        if (self.gain, self.offset) != (1.0, 0.0):
            field = "gain" if self.gain != 1.0 else "offset"
            raise ConfigError(field, f"{getattr(self, field):g}: a wheel has none, its radius says it")
        if self.wraps:
            raise ConfigError(
                "wraps", "is of steering angles; the bits of a wheel's encoder say where it wraps"
            )
        if self.kind is not None and self.unit is not None and speed != (self.kind is Kind.VELOCITY):
            raise ConfigError("kind", f"{self.kind.value} does not go with unit {self.unit.value}")


class TwistMapping(_Section, frozen=True):
    """Where the robot's own body twist stands: a Twist or Odometry topic, or three columns."""

    topic: str | None = None
    columns: tuple[str | int, str | int, str | int] | None = None

    def __post_init__(self) -> None:
        if (self.columns is None) == (self.topic is None):
            raise ConfigError("", "needs either columns: [vx, vy, omega] or topic")


class ReferenceMapping(_Section, frozen=True):
    """Where the truth stands: a pose topic, or columns of the same table or of another file.

    Attributes:
        topic: Topic with poses (PoseStamped, Odometry, PoseWithCovarianceStamped, ...).
        columns: x, y and, where it was measured, theta.
        file: Another table that holds the columns; relative to the log's folder.
        time: Time column of that other table.
        unit: Unit of x and y.
        angle_unit: Unit of theta.
        mounting: Pose (x, y, yaw) [m, m, rad] of the tracked point in the robot's frame.
        delay: How much later than the wheels' it is stamped [s]: what it says at t was so at t - delay.
        kind: `increment` where each row says how the tracked point moved since the row before, in its own
            frame, as a scan matcher does.
    """

    topic: str | None = None
    columns: tuple[str | int, ...] | None = None
    file: str | None = None
    time: TimeMapping | None = None
    unit: Unit = Unit.M
    angle_unit: Unit = Unit.RAD
    mounting: tuple[float, float, float] = (0.0, 0.0, 0.0)
    delay: float = 0.0
    kind: Kind = Kind.POSITION

    def __post_init__(self) -> None:
        if (self.columns is None) == (self.topic is None):
            raise ConfigError("", "needs either columns: [x, y, theta] or topic")
        if self.columns is not None and len(self.columns) not in (2, 3):
            raise ConfigError("columns", f"{len(self.columns)} given, must be [x, y] or [x, y, theta]")
        if not abs(require_finite("delay", self.delay)) <= LONGEST_DELAY:
            raise ConfigError("delay", f"{self.delay:g} s, must be within {LONGEST_DELAY:g} s")
        if self.unit.dimension != "length":
            raise ConfigError("unit", f"{self.unit.value!r}, must be a length (m, mm, cm, in, ft)")
        if self.angle_unit.dimension != "angle":
            raise ConfigError("angle_unit", f"{self.angle_unit.value!r}, must be rad, deg or rev")
        if self.kind is Kind.VELOCITY:
            raise ConfigError("kind", f"{self.kind.value!r}, must be position or increment")
        if self.kind is Kind.INCREMENT and self.columns is not None and len(self.columns) != 3:
            raise ConfigError("columns", "2 given, must be [x, y, theta] where kind is increment")


class TableFormat(_Section, frozen=True):
    """How a text table is written. Nothing is guessed: what differs from plain CSV is said here.

    Attributes:
        delimiter: One character; a space means any run of blanks.
        header: Whether the first row names the columns. Without one, columns are numbers from 0.
        decimal: Decimal sign.
        comment: Lines that begin with it are skipped.
    """

    delimiter: str = ","
    header: bool = True
    decimal: Literal[".", ","] = "."
    comment: str = "#"

    def __post_init__(self) -> None:
        if len(self.delimiter) != 1:
            raise ConfigError("delimiter", f"{self.delimiter!r}, must be one character")
        if self.delimiter == self.decimal:
            raise ConfigError("decimal", f"{self.decimal!r} is the delimiter too")


class LogMapping(_Section, frozen=True):
    """How this robot's logs say it. Everything has a default: Trundle's own CSV columns."""

    clock: Clock = Clock.HEADER
    table: TableFormat = TableFormat()
    time: TimeMapping | None = None
    wheels: dict[str, WheelMapping] = {}
    steering: dict[str, ScalarMapping] = {}
    gyro: ScalarMapping | None = None
    twist: TwistMapping | None = None
    reference: ReferenceMapping | None = None

    def __post_init__(self) -> None:
        if self.gyro is not None and self.gyro.wraps:
            raise ConfigError("gyro.wraps", "a yaw rate does not wrap")

    def without_reference(self) -> LogMapping:
        """Of logs that do not say where the robot really went."""
        return msgspec.structs.replace(self, reference=None)
