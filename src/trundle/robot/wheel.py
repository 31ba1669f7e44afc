"""One wheel: where it stands, how it is mounted, what it can do."""

from __future__ import annotations

import enum
import math

import msgspec

from trundle.errors import ConfigError, require_choice, require_finite, require_positive, row_of, shown

__all__ = ["Wheel", "WheelKind"]


class WheelKind(enum.Enum):
    """What a wheel says about the motion of the body (DESIGN.md section 1)."""

    FIXED = "fixed"
    """Rolls along its heading and does not slip sideways."""
    STEERED = "steered"
    """A fixed wheel whose heading turns with a measured steering angle."""
    SWEDISH = "swedish"
    """Mecanum or omni wheel: its contact rolls freely along `free_direction`."""
    TRACKING = "tracking"
    """Unpowered omni wheel with an encoder ("dead wheel"): measures along its heading only."""
    SKID = "skid"
    """A fixed wheel that must slip sideways when the robot turns."""
    CASTER = "caster"
    """Carries weight and says nothing."""


class Wheel(msgspec.Struct, frozen=True):
    """A wheel in the body frame (x forward, y left, counter-clockwise positive).

    Attributes:
        name: Unique within its drive.
        x: Contact point [m].
        y: Contact point [m].
        radius: [m].
        heading: Direction in which it drives at steering angle zero [rad].
        kind: What it says about the motion; a word or a WheelKind.
        free_direction: Swedish wheels: direction in which the contact rolls freely [rad].
        steering_range: Steered wheels: (least, greatest) angle [rad]; None means no limit.
        driven: Whether a motor turns it.
    """

    name: str
    x: float
    y: float
    radius: float
    heading: float = 0.0
    kind: WheelKind | str = WheelKind.FIXED
    free_direction: float | None = None
    steering_range: tuple[float, float] | None = None
    driven: bool = True

    def __post_init__(self) -> None:
        put = msgspec.structs.force_setattr
        put(self, "kind", require_choice("kind", self.kind, WheelKind))
        put(self, "radius", require_positive("radius", self.radius))
        for field in ("x", "y", "heading"):
            put(self, field, require_finite(field, getattr(self, field)))
        self._check_free_direction()
        if self.steering_range is not None:
            if self.kind is not WheelKind.STEERED:
                raise ConfigError("steering_range", f"given for a {WheelKind(self.kind).value} wheel")
            ends = row_of(self.steering_range)
            if ends is None or len(ends) != 2:
                raise ConfigError(
                    "steering_range", f"{shown(self.steering_range)}, must be (least, greatest)"
                )
            least, greatest = (require_finite("steering_range", end) for end in ends)
            if not least < greatest:
                raise ConfigError("steering_range", f"({least:g}, {greatest:g}), min must be < max")
            put(self, "steering_range", (least, greatest))

    def _check_free_direction(self) -> None:
        if (self.kind is WheelKind.SWEDISH) != (self.free_direction is not None):
            raise ConfigError(
                "free_direction",
                "must be given for a swedish wheel"
                if self.free_direction is None
                else f"given for a {WheelKind(self.kind).value} wheel, only swedish wheels have one",
            )
        if self.free_direction is not None:
            free = require_finite("free_direction", self.free_direction)
            if isinstance(free, float) and abs(math.sin(free - self.heading)) < 1e-6:
                raise ConfigError(
                    "free_direction",
                    f"{free:g} is the driving direction: this wheel would transmit no motion",
                )
