"""The watchdog: what is not a command does not count, what ceases stops, what is latched stays."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle import ConfigError, Limits, Twist2D
from trundle.command import Demand, Latch, Reason, Rejection, Watchdog, WatchdogState

MS = 1_000_000
S = 1_000 * MS
DAY = 86_400 * S
AHEAD = Twist2D(1.0, 0.0, 0.5)
DOG = Watchdog(timeout=0.5)
FRESH = DOG.receive(WatchdogState(), AHEAD, 100 * S)


def fault_k1():
    """NaN, infinite, huge, not numbers at all: counted, and the last good command keeps ageing."""
    bad = [math.nan, math.inf, -math.inf, 1e6, -1e308, None, "1.0", True + 0j]
    state = FRESH
    for k, value in enumerate(bad):
        for twist in (Twist2D(value, 0.0, 0.0), Twist2D(0.0, value, 0.0), Twist2D(0.0, 0.0, value)):
            state = DOG.receive(state, twist, 100 * S + (k + 1) * 60 * MS)
            assert state.twist == AHEAD
            assert state.received_ns == 100 * S
    assert sum(state.rejected.values()) == 3 * len(bad)
    assert state.offered == state.accepted + sum(state.rejected.values())
    assert state.rejected == {Rejection.NONFINITE: 18, Rejection.IMPLAUSIBLE: 6}
    assert DOG.demand(state, 100 * S + 500 * MS) == Demand(AHEAD)
    assert DOG.demand(state, 100 * S + 500 * MS + 1).reason is Reason.TIMEOUT


def fault_k2():
    """No command for the timeout: stop by the ramp, and say why until one comes."""
    assert DOG.demand(WatchdogState(), 0) == Demand(reason=Reason.NO_COMMAND)
    assert DOG.demand(FRESH, 100 * S + 499 * MS).twist == AHEAD
    for later in (501 * MS, 5 * S, DAY):
        assert DOG.demand(FRESH, 100 * S + later) == Demand(Twist2D(), Reason.TIMEOUT, at_once=False)
    again = DOG.receive(FRESH, AHEAD, 200 * S)
    assert DOG.demand(again, 200 * S).twist == AHEAD
    never = Watchdog(timeout=Limits(command_timeout="never").command_lifetime)
    assert never.demand(FRESH, 100 * S + DAY).twist == AHEAD


def fault_k3():
    """Stamps and wall clocks only ever refuse; when to stop is the monotonic clock's business."""
    wall = 1_700_000_000 * S
    cases = [
        (wall, None),
        (wall - 400 * MS, None),
        (wall + 90 * MS, None),
        (wall + 110 * MS, Rejection.FUTURE),
        (wall + 3600 * S, Rejection.FUTURE),
        (wall - 3600 * S, Rejection.STALE),
        (0, Rejection.STALE),
    ]
    for stamp, expected in cases:
        state = DOG.receive(FRESH, AHEAD * 0.5, 101 * S, stamp_ns=stamp, clock_ns=wall)
        assert state.last_rejection is expected
        assert state.received_ns == (101 * S if expected is None else 100 * S)
    for step in (DAY, -DAY):
        # The receiver's wall clock is stepped: commands of others are refused, the age of the last is right.
        state = DOG.receive(FRESH, AHEAD, 100 * S + 100 * MS, stamp_ns=wall, clock_ns=wall + step)
        assert state.last_rejection in (Rejection.FUTURE, Rejection.STALE)
        assert DOG.demand(state, 100 * S + 500 * MS).twist == AHEAD
        assert DOG.demand(state, 100 * S + 501 * MS).reason is Reason.TIMEOUT
        # Sender and receiver share the clock: nothing happens.
        state = DOG.receive(FRESH, AHEAD, 101 * S, stamp_ns=wall + step, clock_ns=wall + step)
        assert state.last_rejection is None


@pytest.mark.parametrize(
    ("row", "check"),
    [
        pytest.param("K1", fault_k1, id="K1"),
        pytest.param("K2", fault_k2, id="K2"),
        pytest.param("K3", fault_k3, id="K3"),
    ],
)
def test_fault(row, check):
    check()


def test_emergency_stop_needs_a_reset_and_then_a_zero_command():
    stopped = DOG.emergency_stop(FRESH)
    assert DOG.demand(stopped, 100 * S) == Demand(reason=Reason.EMERGENCY_STOP, at_once=True)
    for command in (AHEAD, Twist2D()):
        assert DOG.receive(stopped, command, 101 * S).latch is Latch.LATCHED
    waiting = DOG.reset(stopped)
    still_waiting = DOG.receive(waiting, AHEAD, 101 * S)
    assert still_waiting.last_rejection is Rejection.EMERGENCY_STOP
    assert DOG.demand(still_waiting, 101 * S).at_once
    ready = DOG.receive(still_waiting, Twist2D(), 102 * S)
    assert DOG.demand(ready, 102 * S) == Demand()
    assert DOG.demand(DOG.receive(ready, AHEAD, 103 * S), 103 * S) == Demand(AHEAD)
    assert DOG.reset(FRESH) == FRESH
    assert DOG.emergency_stop(waiting).latch is Latch.LATCHED


@given(
    events=st.lists(
        st.sampled_from(["ahead", "zero", "nan", "stop", "reset", "wait"]), min_size=1, max_size=30
    )
)
def test_nothing_moves_unless_every_condition_holds(events):
    """Against the rules, written down once more the other way round."""
    state, now = WatchdogState(), 0
    stopped, armed, last = False, True, None  # armed: a zero command came since the reset
    for event in events:
        now += 600 * MS if event == "wait" else 50 * MS
        if event == "stop":
            state, stopped, armed, last = DOG.emergency_stop(state), True, False, None
        elif event == "reset":
            state, stopped = DOG.reset(state), False
        elif event == "ahead":
            state = DOG.receive(state, AHEAD, now)
            last = (AHEAD, now) if armed and not stopped else last
        elif event == "zero":
            state = DOG.receive(state, Twist2D(), now)
            if not stopped:
                armed, last = True, (Twist2D(), now)
        elif event == "nan":
            state = DOG.receive(state, Twist2D(math.nan, 0.0, 0.0), now)
        demand = DOG.demand(state, now)
        alive = armed and not stopped and last is not None and now - last[1] <= 500 * MS
        assert demand.twist == (last[0] if alive else Twist2D())
        assert (demand.reason is None) == alive
        assert demand.at_once == (stopped or not armed)
        assert state.offered == state.accepted + sum(state.rejected.values())


def test_a_clock_that_goes_back_stops():
    assert DOG.demand(FRESH, 99 * S).reason is Reason.TIMEOUT


@pytest.mark.parametrize(
    "wrong", [{"timeout": 0.0}, {"timeout": math.nan}, {"future": -1.0}, {"implausible": 0}]
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ConfigError):
        Watchdog(**wrong)
