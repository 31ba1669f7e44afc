"""Stamps of sensors against the receiver's own clock: one that leaps is doubted, three are a new clock."""

from __future__ import annotations

import enum

__all__ = ["LEAP_NS", "StampJudge", "Verdict"]

LEAP_NS = 1_000_000_000
"""Stamps that leap by so much are not late or early but another time (FAULTS.md S6)."""
PATIENCE = 3


class Verdict(enum.Enum):
    """What a stamp is."""

    GOOD = "good"
    DOUBTFUL = "clock_jump"
    """Alone it is a fault of its sender, and using it would cost the pose its covariance."""
    NEW_CLOCK = "clock_reset"
    """The third in a row: time really jumped (a simulation that began anew, a bag that was looped)."""


class StampJudge:
    """Watches one sender's stamps.

    Time may go on more slowly than the receiver's clock, as it does where messages waited in a queue; but
    it cannot go on by a second more than passed, nor back by one.
    """

    def __init__(self) -> None:
        self._stamp_ns: int | None = None
        self._now_ns = 0
        self._strikes = 0

    def judge(self, stamp_ns: int, now_ns: int) -> Verdict:
        """Take a stamp.

        Args:
            stamp_ns: The sender's [ns].
            now_ns: The receiver's monotonic clock [ns].
        """
        verdict = Verdict.GOOD
        if self._stamp_ns is not None:
            ahead = stamp_ns - self._stamp_ns
            if ahead <= -LEAP_NS or ahead - (now_ns - self._now_ns) >= LEAP_NS:
                self._strikes += 1
                if self._strikes < PATIENCE:
                    return Verdict.DOUBTFUL
                verdict = Verdict.NEW_CLOCK
            elif ahead < 0:
                return verdict  # a little out of order: odometry knows what to do with it
        self._strikes = 0
        self._stamp_ns, self._now_ns = stamp_ns, now_ns
        return verdict
