"""docs/conventions.md, where it says how our wheels read in two textbooks."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle.robot import Mecanum, Wheel
from trundle.robot.rows import rolling, sideways

lengths = st.floats(0.01, 10.0)
angles = st.floats(-math.pi, math.pi)
roller_angles = st.floats(-1.4, 1.4)


def close(row):
    return pytest.approx(row, rel=1e-12, abs=1e-12 * (1.0 + max(abs(part) for part in row)))


@given(distance=lengths, alpha=angles, beta=angles)
def test_siegwarts_fixed_wheel(distance, alpha, beta):
    """Siegwart, Nourbakhsh, Scaramuzza 2011, section 3.2.3: rolling and sliding constraint."""
    x, y, heading = distance * math.cos(alpha), distance * math.sin(alpha), alpha + beta - math.pi / 2
    wheel = Wheel("w", x, y, 0.1, heading)
    along = (math.sin(alpha + beta), -math.cos(alpha + beta), -distance * math.cos(beta))
    across = (math.cos(alpha + beta), math.sin(alpha + beta), distance * math.sin(beta))
    assert rolling(wheel) == close(along)
    assert sideways(wheel) == close(across)


@given(distance=lengths, alpha=angles, beta=angles, gamma=roller_angles)
def test_siegwarts_swedish_wheel(distance, alpha, beta, gamma):
    """Siegwart, Nourbakhsh, Scaramuzza 2011, section 3.2.3: Swedish wheel, divided by cos(gamma)."""
    x, y, heading = distance * math.cos(alpha), distance * math.sin(alpha), alpha + beta - math.pi / 2
    wheel = Wheel("w", x, y, 0.1, heading, "swedish", heading + gamma + math.pi / 2)
    whole = alpha + beta + gamma
    row = (math.sin(whole), -math.cos(whole), -distance * math.cos(beta + gamma))
    assert rolling(wheel) == close([part / math.cos(gamma) for part in row])


@given(x=lengths, y=lengths, beta=angles, gamma=roller_angles)
def test_lynch_and_parks_wheel(x, y, beta, gamma):
    """Lynch and Park 2017, section 13.2.1, at phi = 0; theirs has the yaw rate first."""
    wheel = Wheel("w", x, y, 0.1, beta, "swedish", beta + gamma + math.pi / 2)
    c, s = math.cos(beta + gamma), math.sin(beta + gamma)
    assert rolling(wheel) == close([part / math.cos(gamma) for part in (c, s, x * s - y * c)])


def test_lynch_and_parks_mecanum():
    """Lynch and Park 2017, section 13.2.1: wheels FL FR RR RL, half length l and width w, yaw rate first."""
    l, w, r = 0.2, 0.15, 0.05  # noqa: E741 - their letters
    drive = Mecanum(track_width=2 * w, wheelbase=2 * l, wheel_radius=r)
    theirs = [(-l - w, 1, -1), (l + w, 1, 1), (l + w, 1, -1), (-l - w, 1, 1)]
    ours = dict(zip(drive.wheel_names, map(rolling, drive.wheels), strict=True))
    for name, (omega, vx, vy) in zip(
        ("front_left", "front_right", "rear_right", "rear_left"), theirs, strict=True
    ):
        assert ours[name] == close((vx, vy, omega))
