"""What is sent to the wheels."""

from __future__ import annotations

import msgspec

from trundle.errors import require_numbers, require_positive

__all__ = ["WheelCommand"]


class WheelCommand(msgspec.Struct, frozen=True, gc=False):
    """Speeds and steering angles for every wheel of one drive.

    Attributes:
        speeds: Wheel speeds [rad/s], in the order of the drive's `wheel_names`.
        steering: Steering angles [rad], left positive, in the order of its `steered_names`.
    """

    speeds: tuple[float, ...]
    steering: tuple[float, ...] = ()

    def desaturated(self, max_wheel_speed: float) -> WheelCommand:
        """The same motion, slowed until no wheel is faster than it can turn.

        All speeds are scaled together, so the path keeps its shape.

        Args:
            max_wheel_speed: Greatest speed of any wheel, either way [rad/s].

        Raises:
            ConfigError: If it is not a finite number above zero.
        """
        try:
            fastest = max(map(abs, self.speeds), default=0.0)
            faster = 0.0 < max_wheel_speed < fastest
        except (TypeError, ValueError):
            require_positive("max_wheel_speed", max_wheel_speed)
            require_numbers("desaturated", row={"speeds": self.speeds})
            raise
        if not faster:
            require_positive("max_wheel_speed", max_wheel_speed)
            return self
        scale = max_wheel_speed / fastest
        return WheelCommand(tuple([scale * speed for speed in self.speeds]), self.steering)
