"""What is given up when a robot cannot do what was asked: a named choice, and an honest answer."""

from __future__ import annotations

import enum
from collections.abc import Callable

import msgspec

from trundle.command.envelope import Envelope
from trundle.command.reason import Reason
from trundle.errors import InputError, require_choice, require_type, shown
from trundle.geometry import Twist2D

__all__ = ["Achieved", "Saturation", "saturate"]

_INSIDE = 1.0 - 2.0**-40  # so that rounding never lifts what was cut to an edge over it again
_HALVINGS = 60


class Saturation(enum.Enum):
    """What gives way first."""

    SCALE_ALL = "scale_all"
    """Everything by one factor, so that the path keeps its shape. A turn tighter than the steering
    allows becomes the tightest that it does allow."""
    KEEP_CURVATURE = "keep_curvature"
    """Everything by one factor; a turn tighter than the steering allows is not begun: the robot leaves
    its path by nothing, and stands still rather."""
    YAW_FIRST = "yaw_first"
    """The yaw rate is kept and translation gives way."""
    TRANSLATION_FIRST = "translation_first"
    """Translation is kept and the yaw rate gives way."""


class Achieved(msgspec.Struct, frozen=True):
    """What will be done.

    Attributes:
        twist: Body twist within every limit.
        reasons: What stood between it and the wanted one; empty where it is the wanted one.
    """

    twist: Twist2D
    reasons: tuple[Reason, ...] = ()


def saturate(twist: Twist2D, envelope: Envelope, policy: Saturation | str = Saturation.SCALE_ALL) -> Achieved:
    """The twist that a robot will make of a wanted one.

    Args:
        twist: Any finite body twist.
        envelope: What the robot can do.
        policy: What gives way first.

    Raises:
        ConfigError: If there is no such policy.
        InputError: If the twist is not finite (a watchdog keeps such twists away).
    """
    require_type("saturate", "envelope", envelope, Envelope)
    policy = require_choice("policy", policy, Saturation)
    try:
        finite = abs(twist.vx) + abs(twist.vy) + abs(twist.omega) < float("inf")
    except (AttributeError, TypeError):
        raise InputError(f"saturate: twist {shown(twist)}, must be a Twist2D of numbers") from None
    if not finite:
        raise InputError(f"{twist}: every component must be finite")
    wanted, slips = envelope.project(twist)
    reasons: tuple[Reason, ...] = (Reason.SIDEWAYS,) if slips else ()
    if not envelope.steerable(wanted):
        still = not (wanted.vx or wanted.vy) and not envelope.steerable(Twist2D(0.0, 0.0, wanted.omega))
        reasons += (Reason.TURN_ON_THE_SPOT if still else Reason.STEERING,)
        if policy is Saturation.KEEP_CURVATURE:
            return Achieved(Twist2D(), reasons)
        wanted = _steered(wanted, envelope)
    if envelope.load(wanted) <= 1.0:
        return Achieved(wanted, reasons)
    reasons += envelope.exceeded(wanted)
    if policy in (Saturation.YAW_FIRST, Saturation.TRANSLATION_FIRST):
        slower = _one_first(wanted, envelope, yaw=policy is Saturation.YAW_FIRST)
    else:
        slower = _scaled(wanted, envelope)
    # A wanted turn exactly at the steering's stop may be beyond it by rounding once it is scaled.
    return Achieved(slower if envelope.steerable(slower) else _steered(slower, envelope), reasons)


def _steered(wanted: Twist2D, envelope: Envelope) -> Twist2D:
    """The wanted translation with as much of the yaw rate as the steering allows."""

    def with_yaw(share: float) -> Twist2D:
        return envelope.project(Twist2D(wanted.vx, wanted.vy, share * wanted.omega))[0]

    turned = with_yaw(_largest(lambda share: envelope.steerable(with_yaw(share))))
    return turned if envelope.steerable(turned) else Twist2D()


def _scaled(wanted: Twist2D, envelope: Envelope) -> Twist2D:
    """The wanted twist by the greatest factor up to 1 that is within the limits."""
    load = envelope.load(wanted)
    if load <= 1.0:
        return wanted
    if envelope.period is None:
        return wanted * (_INSIDE / load)
    # The twist that is held for a period is not proportional to the wanted one: its direction depends
    # on how far the robot turns in that time. Scaling what is wanted lands on the wanted line.
    return wanted * _largest(lambda factor: envelope.load(wanted * factor) <= 1.0)


def _one_first(wanted: Twist2D, envelope: Envelope, *, yaw: bool) -> Twist2D:
    """As much of the yaw rate (or of the translation) as possible, then as much of the other.

    A car has no yaw rate without translation, so what is kept at first is the corner between the two
    that its steering allows.
    """
    kept = Twist2D(0.0, 0.0, wanted.omega) if yaw else Twist2D(wanted.vx, wanted.vy, 0.0)
    share = _largest(lambda t: envelope.steerable(_between(wanted, kept, t, envelope)))
    base = _scaled(_between(wanted, kept, share, envelope), envelope)
    full = Twist2D(wanted.vx, wanted.vy, base.omega) if yaw else Twist2D(base.vx, base.vy, wanted.omega)

    def fits(t: float) -> bool:
        twist = _between(base, full, t, envelope)
        return envelope.load(twist) <= 1.0 and envelope.steerable(twist)

    return _between(base, full, _largest(fits), envelope)


def _between(start: Twist2D, end: Twist2D, share: float, envelope: Envelope) -> Twist2D:
    """The twist part of the way from one to another, without slip."""
    rest = 1.0 - share
    return envelope.project(
        Twist2D(
            rest * start.vx + share * end.vx,
            rest * start.vy + share * end.vy,
            rest * start.omega + share * end.omega,
        )
    )[0]


def _largest(fits: Callable[[float], bool]) -> float:
    """The largest number in [0, 1] that fits, where smaller ones fit too; 0 if none does."""
    if fits(1.0):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if fits(middle):
            low = middle
        else:
            high = middle
    return low * _INSIDE
