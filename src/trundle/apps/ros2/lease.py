"""One controller at a time drives: who holds the robot, and for how long (FAULTS.md K12)."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

__all__ = ["Lease", "Source"]


class Source(NamedTuple):
    """Where a command comes from.

    Attributes:
        topic: Its topic.
        publisher: Which of the topic's publishers sent it, where the middleware says so.
        priority: The lower the number, the more it has to say; the place of its topic among all.
    """

    topic: str
    publisher: str = ""
    priority: int = 0


class Lease(msgspec.Struct, frozen=True):
    """Whose commands count. They are its heartbeat: silence returns the lease.

    Attributes:
        holder: Who has it; None where nobody does.
        renewed_ns: When its last command came, by the monotonic clock [ns].
    """

    holder: Source | None = None
    renewed_ns: int = 0

    def admits(self, source: Source, now_ns: int, lifetime_ns: int) -> bool:
        """Whether a source may drive: its holder may, anybody when that is silent, and the more important."""
        if self.holder is None or source == self.holder or source.priority < self.holder.priority:
            return True
        return not 0 <= now_ns - self.renewed_ns <= lifetime_ns

    def taken(self, source: Source, now_ns: int) -> Lease:
        """The lease after a command of this source counted."""
        return Lease(source, now_ns)
