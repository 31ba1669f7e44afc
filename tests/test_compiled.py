"""The compiled walk is the NumPy walk: one definition, held together here."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import trundle as tr
from trundle.odometry import compiled

pytest.importorskip("numba", reason="numba is not installed here (.venv has it)")

DRIVES = {
    "two wheels": tr.Differential(track_width=0.2, wheel_radius={"left": 0.042, "right": 0.041}),
    "three wheels": tr.Omni(robot_radius=0.2, wheel_radius=0.05),
    "steered": tr.Bicycle(wheelbase=0.3, wheel_radius=0.05),
}
INTEGRATORS = ("arc+", "arc", "midpoint", "euler")
BLOCK = compiled.BLOCK


def run(drive, shape, fastest=0.1, seed=0):
    """Wheel angles and steering of robots that drive at random, and stamps at random intervals."""
    random = np.random.default_rng(seed)
    turned = random.uniform(-0.2 * fastest, fastest, (*shape, len(drive.measured_names)))
    steering = None
    if drive.steered_names:
        steering = np.broadcast_to(0.4 * np.sin(np.arange(shape[-1]) / 50.0)[:, None], (*shape, 1))
    return np.cumsum(turned, axis=-2), steering, np.cumsum(random.integers(5, 30, shape[-1])) * 1_000_000


@pytest.fixture
def both(monkeypatch):
    """The same call by NumPy and compiled."""

    def call(*arguments, **options):
        results = []
        for fewest in (sys.maxsize, 0):
            monkeypatch.setattr(compiled, "FEWEST", fewest)
            results.append(tr.integrate_batch(*arguments, **options))
        return results

    return call


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("stamped", [False, True], ids=["equal steps", "stamped"])
@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_equals_numpy(drive, stamped, integrator, both):
    positions, steering, time_ns = run(drive, (3, 20_000))
    options = {"steering": steering, "integrator": integrator, "time_ns": time_ns if stamped else None}
    numpys, ours = both(drive, positions, **options)
    np.testing.assert_allclose(ours, numpys, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("steps", [1, 2, 9, BLOCK, BLOCK + 1, BLOCK + 2, 3 * BLOCK + 5])
@pytest.mark.parametrize("stamped", [False, True], ids=["equal steps", "stamped"])
def test_equals_numpy_wherever_a_block_ends(steps, stamped, both):
    drive = DRIVES["two wheels"]
    positions, _, time_ns = run(drive, (2, steps))
    numpys, ours = both(drive, positions, time_ns if stamped else None)
    np.testing.assert_allclose(ours, numpys, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("fastest", [1e-9, 0.2, 3.0, 30.0, 1e4])
def test_any_turn_and_any_heading(fastest, both):
    """Against 80-bit sums and sines. 3 rad of a wheel in a step are more than half a radian of the robot."""
    drive = DRIVES["two wheels"]
    positions, _, _ = run(drive, (2_000,), fastest)
    positions[:, 1] += 1e5 * fastest * np.linspace(0.0, 1.0, 2_000)  # hundreds of turns to one side
    _, ours = both(drive, positions, integrator="arc")
    (a, _, c), (b, _, d) = np.array(drive.jacobian()).T.astype(np.longdouble)
    left, right = np.diff(positions.astype(np.longdouble), axis=0).T
    turn, ahead = c * left + d * right, a * left + b * right
    heading = np.cumsum(turn)
    chord = ahead * np.sin(turn / 2) / (turn / 2)
    true = np.stack(
        [
            np.cumsum(chord * np.cos(heading - turn / 2)),
            np.cumsum(chord * np.sin(heading - turn / 2)),
            heading,
        ]
    )
    # An angle is known to its last digit; what that makes of the path grows with both.
    size = float(np.abs(ahead).sum() * (1.0 + np.abs(heading).max()))
    np.testing.assert_allclose(ours[1:], true.T.astype(float), rtol=1e-14, atol=1e-15 * size)


def test_after_a_hole_in_the_readings_no_place_is_known(both):
    drive = DRIVES["two wheels"]
    positions, _, _ = run(drive, (2, 1_000))
    positions[0, 500] = np.nan
    numpys, ours = both(drive, positions)
    np.testing.assert_array_equal(np.isnan(ours[..., :2]), np.isnan(numpys[..., :2]))
    np.testing.assert_allclose(ours[1], numpys[1], atol=1e-13)


def test_writes_to_any_array_of_floats(both):
    drive = DRIVES["two wheels"]
    positions, _, _ = run(drive, (2, 3, 300))
    wanted = tr.integrate_batch(drive, positions)
    for out in (
        np.full((2, 3, 300, 3), 7.0),
        np.full((2, 6, 300, 3), 7.0)[:, ::2],
        np.full((2, 3, 600, 3), 7.0)[:, :, ::2],
    ):
        for result in both(drive, positions, out=out):
            assert result is out
            np.testing.assert_allclose(out, wanted, atol=1e-12)
        out[...] = 7.0
    with pytest.raises(tr.InputError, match="out="):
        tr.integrate_batch(drive, positions, out=[0.0])


def test_works_without_numba(monkeypatch):
    drive = DRIVES["two wheels"]
    positions, _, _ = run(drive, (1_000,))
    wanted = tr.integrate_batch(drive, positions)
    monkeypatch.setattr(compiled, "FEWEST", 0)
    monkeypatch.setitem(sys.modules, "numba", None)
    compiled.available.cache_clear()
    try:
        assert not compiled.available()
        np.testing.assert_array_equal(tr.integrate_batch(drive, positions), wanted)
    finally:
        compiled.available.cache_clear()


@pytest.mark.parametrize(
    ("series", "function", "greatest"),
    [
        (compiled._SINE, lambda mp, z: mp.sinc(mp.sqrt(z)), "pi / 4"),
        (compiled._COSINE, lambda mp, z: mp.cos(mp.sqrt(z)), "pi / 4"),
        (compiled._CHORD, lambda mp, z: mp.sinc(4 * mp.sqrt(z)), "1 / 16"),
    ],
    ids=["sine", "cosine", "chord"],
)
def test_series_meet_their_functions(series, function, greatest):
    """Interpolation at the Chebyshev nodes gives these coefficients, and an error below 1e-16."""
    mp = pytest.importorskip("mpmath").MPContext()
    mp.prec = 400
    count = len(series)
    range_of_z = (mp.pi / 4 if "pi" in greatest else mp.mpf(1) / 16) ** 2
    nodes = [range_of_z * (1 + mp.cos(mp.pi * (2 * k + 1) / (2 * count))) / 2 for k in range(count)]
    powers = mp.matrix([[z**n for n in range(count)] for z in nodes])
    found = mp.lu_solve(powers, mp.matrix([function(mp, z) for z in nodes]))
    assert [float(value) for value in found] == list(series)
    for z in mp.linspace(range_of_z / 1000, range_of_z, 200):
        assert abs(sum(mp.mpf(c) * z**n for n, c in enumerate(series)) - function(mp, z)) < 1e-16
