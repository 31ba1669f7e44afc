"""What the node says about itself, once a second: as plain statuses, for `/diagnostics`."""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec

from trundle.apps.ros2.base import Base
from trundle.apps.wording import digits
from trundle.command import Latch, Reason

__all__ = ["Diagnostics", "Level", "Status"]

_STOPPED = (Reason.TIMEOUT, Reason.LOOP_STALLED)


class Level(enum.IntEnum):
    """Of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Status(msgspec.Struct, frozen=True):
    """One line of `/diagnostics`.

    Attributes:
        name: What it is about.
        level: How it is.
        message: The same in words.
        values: Numbers, as texts.
    """

    name: str
    level: Level
    message: str
    values: Mapping[str, str] = {}


class _Seen(NamedTuple):
    """Counters at the report before."""

    now_ns: int
    counts: Counter[str]
    rejected: Counter[str]
    commands: int
    rejected_commands: int


class Diagnostics:
    """Compares what a base has counted with what it had at the report before.

    Args:
        base: Whose.
        now_ns: Monotonic clock.
    """

    def __init__(self, base: Base, now_ns: int) -> None:
        self._base = base
        self._before = self._see(now_ns)

    def report(
        self, now_ns: int, mismatches: Sequence[str] = (), missing: Sequence[str] = (), driver: str = ""
    ) -> list[Status]:
        """Statuses of odometry, commands and topics.

        Args:
            now_ns: Monotonic clock.
            mismatches: Sentences on endpoints that do not hear each other.
            missing: Sentences on what this installation cannot do.
            driver: Who has the lease, for people.
        """
        seen, before = self._see(now_ns), self._before
        self._before = seen
        seconds = max(now_ns - before.now_ns, 1) * 1e-9
        return [
            self._odometry(seen, before, seconds),
            self._commands(seen, before, seconds, driver),
            _topics(mismatches, missing),
        ]

    def _see(self, now_ns: int) -> _Seen:
        base = self._base
        rejected = Counter(base.odometry.rejected)
        for key, count in base.counts.items():
            reason = key.removeprefix("refused ")
            if reason not in (key, "no_lease"):
                rejected[reason] += count
        refused = sum(base.commands.rejected.values()) + base.counts["refused no_lease"]
        return _Seen(now_ns, Counter(base.counts), rejected, base.counts["cmd_vel"], refused)

    def _odometry(self, seen: _Seen, before: _Seen, seconds: float) -> Status:
        base, odometry = self._base, self._base.odometry
        came = seen.counts["joint_states"] - before.counts["joint_states"]
        went = seen.counts["odom"] - before.counts["odom"]
        fresh = seen.rejected - before.rejected
        values = {
            "joint_states rate [Hz]": digits(came / seconds),
            "odom rate [Hz]": digits(went / seconds),
            "accepted": str(odometry.accepted),
            **{f"rejected {reason}": str(count) for reason, count in sorted(seen.rejected.items())},
            **{f"event {name}": str(count) for name, count in sorted(odometry.events.items())},
            "slipping": ", ".join(odometry.slipping),
            "stuck": ", ".join(odometry.stuck),
        }
        words = ", ".join(f"{count} {reason}" for reason, count in fresh.items())
        if not base.active:
            return Status("odometry", Level.OK, "inactive", values)
        if odometry.stuck:
            return Status("odometry", Level.ERROR, f"stuck encoder: {values['stuck']}", values)
        if came and not went:
            return Status("odometry", Level.ERROR, f"every sample was rejected: {words}", values)
        if not went:
            return Status("odometry", Level.STALE, f"no samples on {base.joints.topic}", values)
        if fresh:
            return Status("odometry", Level.WARN, f"rejected: {words}", values)
        if odometry.slipping:
            return Status("odometry", Level.WARN, f"slipping: {values['slipping']}", values)
        return Status("odometry", Level.OK, f"{values['odom rate [Hz]']} Hz", values)

    def _commands(self, seen: _Seen, before: _Seen, seconds: float, driver: str) -> Status:
        base, state = self._base, self._base.commands
        reasons = () if base.command is None else base.command.reasons
        values = {
            "cmd_vel rate [Hz]": digits((seen.commands - before.commands) / seconds),
            "lease": driver,
            "emergency stop": state.latch.value,
            "accepted": str(state.accepted),
            **{f"rejected {reason.value}": str(count) for reason, count in state.rejected.items()},
            "rejected no_lease": str(base.counts["refused no_lease"]),
            "reasons": "; ".join(reason.value for reason in reasons),
        }
        if base.settings.robot.limits.warnings:
            values["warning"] = "; ".join(base.settings.robot.limits.warnings)
        if not base.active:
            return Status("commands", Level.OK, "inactive", values)
        if state.latch is not Latch.OPEN:
            return Status("commands", Level.ERROR, Reason.EMERGENCY_STOP.value, values)
        stopped = [reason for reason in reasons if reason in _STOPPED]
        if stopped:
            return Status("commands", Level.WARN, f"stopped: {stopped[0].value}", values)
        if seen.rejected_commands > before.rejected_commands:
            count = seen.rejected_commands - before.rejected_commands
            return Status("commands", Level.WARN, f"{count} rejected", values)
        if Reason.NO_COMMAND in reasons:
            return Status("commands", Level.OK, Reason.NO_COMMAND.value, values)
        return Status("commands", Level.OK, values["reasons"] or "driving", values)


def _topics(mismatches: Sequence[str], missing: Sequence[str]) -> Status:
    if mismatches:
        values = {str(number): sentence for number, sentence in enumerate(mismatches, 1)}
        return Status("topics", Level.ERROR, mismatches[0], values)
    if missing:
        return Status("topics", Level.WARN, "; ".join(missing))
    return Status("topics", Level.OK, "types and qualities of service match")
