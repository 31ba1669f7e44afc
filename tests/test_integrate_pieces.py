"""A log in pieces becomes the very trajectory that it becomes as a whole."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import pytest

import trundle as tr
from trundle.odometry.integrate import NEIGHBOURS, integrate_pieces
from trundle.records import Reading, WheelLog
from trundle.robot import Robot

ROWS = 4 * NEIGHBOURS + 777


def cut(log: WheelLog, borders: list[int]) -> list[WheelLog]:
    """The log between these rows; what was rejected goes with the first piece."""

    def part(column, rows):
        return None if column is None else column[rows]

    pieces = []
    for start, stop in zip([0, *borders], [*borders, len(log)], strict=True):
        rows = slice(start, stop)
        names = ("time_ns", "wheels", "steering", "yaw_rate", "twists")
        columns = {name: part(getattr(log, name), rows) for name in names}
        pieces.append(dataclasses.replace(log, **columns, rejected={} if start else log.rejected))
    return pieces


def eventful(reading: Reading, *, gyro: bool, wheels: int) -> WheelLog:
    """Driving, standing, one wheel still, gaps, jumps, duplicates and rows without numbers."""
    random = np.random.default_rng(3)
    steps = np.full(ROWS, 10_000_000)
    steps[random.integers(1, ROWS, 20)] = 3_000_000_000
    steps[random.integers(1, ROWS, 20)] = 0
    speeds = 5.0 + np.cumsum(random.normal(0.0, 0.02, (ROWS, wheels)), axis=0)
    for begin in random.integers(0, ROWS - 500, 40):
        speeds[begin : begin + random.integers(5, 400)] = 0.0
    for begin in random.integers(0, ROWS - 500, 40):
        speeds[begin : begin + random.integers(5, 40), random.integers(wheels)] = 0.0
    positions = np.cumsum(speeds * 0.01, axis=0)
    values = {
        Reading.POSITION: positions,
        Reading.VELOCITY: speeds,
        Reading.INCREMENT: speeds * 0.01,
        Reading.TICKS: np.floor(positions * 500.0).astype(np.int64) % 2**16,
    }[reading].copy()
    strange = random.integers(1, ROWS, 30)
    if reading is Reading.TICKS:
        values[strange] += 5000
    else:
        values[strange[:15]] = np.nan
        values[strange[15:]] += 300.0
    return WheelLog(
        time_ns=10**18 + np.cumsum(steps),
        wheel_names=("left", "right"),
        wheels=values,
        reading=reading,
        yaw_rate=(speeds[:, 1] - speeds[:, 0]) * 0.2 if gyro else None,
        rejected={"parse": 3},
    )


def robot(*, gyro: bool) -> Robot:
    measured = ("left", "right", "gyro") if gyro else None
    drive = tr.Differential(track_width=0.2, wheel_radius=0.042, measured=measured)
    encoder = tr.Encoder(ticks_per_revolution=3141.6, bits=16)
    return tr.Robot(drive=drive, encoders=dict.fromkeys(("left", "right"), encoder))


BORDERS = [
    [ROWS // 2],
    [1, 2, NEIGHBOURS, NEIGHBOURS + 1, 3 * NEIGHBOURS + 5, ROWS - 1],
    list(range(10_000, ROWS, 10_007)),
]


@pytest.mark.parametrize("gyro", [False, True], ids=["wheels", "gyro"])
@pytest.mark.parametrize("reading", Reading)
def test_pieces_are_bit_equal_to_the_whole(reading, gyro):
    log, described = eventful(reading, gyro=gyro, wheels=2), robot(gyro=gyro)
    whole = tr.integrate(described, log)
    assert sum(whole.rejected.values()) > 20
    for borders in BORDERS:
        parts = list(integrate_pieces(described, cut(log, borders)))
        for name in ("time_ns", "poses", "twists", "covariances"):
            joined = np.concatenate([getattr(part, name) for part in parts])
            assert joined.tobytes() == getattr(whole, name).tobytes(), name
        for name in ("rejected", "events"):
            total = sum((Counter(getattr(part, name)) for part in parts), Counter())
            assert total == Counter(getattr(whole, name)), name
    assert len(parts) > 1


def test_what_looks_at_all_rows_is_refused():
    log = eventful(Reading.POSITION, gyro=False, wheels=2)
    with pytest.raises(tr.InputError, match="symmetric looks at the whole log at once"):
        next(integrate_pieces(robot(gyro=False), [log], integrator="symmetric"))
