"""Whether commands still come: the receiver's own monotonic clock decides, and an emergency stop latches.

Time is data: whoever calls has read the clocks. `now_ns` is the receiver's monotonic clock, which no
operator can set; `clock_ns` is its wall clock, which is compared with the sender's stamp and with
nothing else.
"""

from __future__ import annotations

import enum
import math
import numbers
from collections.abc import Mapping
from types import MappingProxyType

import msgspec

from trundle.command.reason import Reason
from trundle.errors import ConfigError, require_finite, require_numbers, require_positive, require_type
from trundle.geometry import Twist2D

__all__ = ["Demand", "Latch", "Rejection", "Watchdog", "WatchdogState"]

_NS = 1e9


class Rejection(enum.Enum):
    """Why a command did not count."""

    NONFINITE = "nonfinite"
    IMPLAUSIBLE = "implausible"
    FUTURE = "future"
    STALE = "stale"
    EMERGENCY_STOP = "emergency_stop"


class Latch(enum.Enum):
    """The emergency stop."""

    OPEN = "open"
    """Commands drive the robot."""
    LATCHED = "latched"
    """Stopped; only a reset changes that."""
    AWAITING_ZERO = "awaiting_zero"
    """Reset, but nothing moves until a zero command has come: no joystick was left pushed over."""


class Demand(msgspec.Struct, frozen=True, gc=False):
    """What the robot should do now.

    Attributes:
        twist: Wanted body twist; zero asks for a stop by the ramp.
        reason: Why it is zero although something else may have been asked; None if it is the command.
        at_once: No ramp: zero now.
    """

    twist: Twist2D = Twist2D()
    reason: Reason | None = None
    at_once: bool = False


class WatchdogState(msgspec.Struct, frozen=True):
    """What is known of the commands.

    Attributes:
        twist: Last accepted command.
        received_ns: When it came, by the monotonic clock [ns]; None before the first.
        latch: The emergency stop.
        offered: Commands offered: `offered == accepted + sum(rejected.values())`.
        accepted: Those that counted.
        rejected: The others, by reason.
        last_rejection: The latest of those reasons, None if the last command was accepted.
    """

    twist: Twist2D = Twist2D()
    received_ns: int | None = None
    latch: Latch = Latch.OPEN
    offered: int = 0
    accepted: int = 0
    rejected: Mapping[Rejection, int] = MappingProxyType({})
    last_rejection: Rejection | None = None


class Watchdog(msgspec.Struct, frozen=True, kw_only=True):
    """Accepts commands and stops the robot when they cease.

    Attributes:
        timeout: A command older than this stops the robot [s]: `limits.command_lifetime`, infinite only
            where the description says "never".
        future: A stamp may be ahead of the receiver's wall clock by this much [s].
        implausible: A component beyond this [m/s, rad/s] is a fault, not a wish.
    """

    timeout: float = 0.5
    future: float = 0.1
    implausible: float = 1e3

    def __post_init__(self) -> None:
        if not (isinstance(self.timeout, float) and self.timeout == math.inf):
            require_positive("timeout", self.timeout)
        require_positive("implausible", self.implausible)
        if require_finite("future", self.future) < 0.0:
            raise ConfigError("future", f"{self.future:g}, must be >= 0")

    def receive(
        self,
        state: WatchdogState,
        twist: Twist2D,
        now_ns: int,
        *,
        stamp_ns: int | None = None,
        clock_ns: int | None = None,
    ) -> WatchdogState:
        """The state after a command came.

        A command that is refused leaves the previous one in place, which keeps ageing.

        Args:
            state: The state before.
            twist: The command; whatever the wire held.
            now_ns: The receiver's monotonic clock [ns].
            stamp_ns: When it was sent, by the sender's wall clock [ns]; None if it says nothing.
            clock_ns: The receiver's wall clock [ns]; stamps are judged only where it is given.
        """
        require_type("receive", "state", state, WatchdogState)
        require_type("receive", "twist", twist, Twist2D)
        require_numbers("receive", one={"now_ns": now_ns, "stamp_ns": stamp_ns, "clock_ns": clock_ns})
        rejection = self._judge(state, twist, stamp_ns, clock_ns)
        if rejection is not None:
            rejected = {**state.rejected, rejection: state.rejected.get(rejection, 0) + 1}
            return msgspec.structs.replace(
                state,
                offered=state.offered + 1,
                rejected=MappingProxyType(rejected),
                last_rejection=rejection,
            )
        return msgspec.structs.replace(
            state,
            twist=twist,
            received_ns=now_ns,
            latch=Latch.OPEN,
            offered=state.offered + 1,
            accepted=state.accepted + 1,
            last_rejection=None,
        )

    def _judge(
        self, state: WatchdogState, twist: Twist2D, stamp_ns: int | None, clock_ns: int | None
    ) -> Rejection | None:
        parts = (twist.vx, twist.vy, twist.omega)
        if not all(isinstance(part, numbers.Real) and math.isfinite(part) for part in parts):
            return Rejection.NONFINITE
        if any(abs(part) > self.implausible for part in parts):
            return Rejection.IMPLAUSIBLE
        if stamp_ns is not None and clock_ns is not None:
            age = (clock_ns - stamp_ns) / _NS
            if age < -self.future:
                return Rejection.FUTURE
            if age > self.timeout:
                return Rejection.STALE
        if state.latch is Latch.LATCHED or (state.latch is Latch.AWAITING_ZERO and any(parts)):
            return Rejection.EMERGENCY_STOP
        return None

    def emergency_stop(self, state: WatchdogState) -> WatchdogState:
        """Stopped and latched. Anybody may ask for it, at any time."""
        return msgspec.structs.replace(state, twist=Twist2D(), latch=Latch.LATCHED)

    def reset(self, state: WatchdogState) -> WatchdogState:
        """The emergency stop lifted; nothing moves before a zero command has come."""
        if state.latch is not Latch.LATCHED:
            return state
        return msgspec.structs.replace(state, latch=Latch.AWAITING_ZERO)

    def demand(self, state: WatchdogState, now_ns: int) -> Demand:
        """What the robot should do at a time.

        Args:
            state: What is known of the commands.
            now_ns: The receiver's monotonic clock [ns]. Before the time of the last command it is no
                monotonic clock, and the robot stops.
        """
        if state.latch is not Latch.OPEN:
            return Demand(reason=Reason.EMERGENCY_STOP, at_once=True)
        if state.received_ns is None:
            return Demand(reason=Reason.NO_COMMAND)
        if not 0 <= now_ns - state.received_ns <= self.timeout * _NS:
            return Demand(reason=Reason.TIMEOUT)
        return Demand(state.twist)
