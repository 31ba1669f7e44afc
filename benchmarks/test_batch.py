"""Whole logs and many robots: ns per sample, beside a wpimath loop and beside a copy of the arrays."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

import trundle as tr
from trundle.odometry import compiled

pytestmark = pytest.mark.benchmark(timer=time.process_time)

RADIUS, TRACK = 0.042, 0.2
DRIVE = tr.Differential(track_width=TRACK, wheel_radius=RADIUS)
SIZES = {"10,000,000 samples": (10_000_000,), "4096 robots x 1000 steps": (4096, 1000)}


def positions(*shape):
    """Wheel angles of robots that wander."""
    turned = np.random.default_rng(0).uniform(0.1, 0.3, (*shape, 2))
    return np.cumsum(turned, axis=-2, out=turned)


@pytest.fixture(params=["Numba", "NumPy"])
def way(request, monkeypatch):
    """Which path the samples take, whatever their number."""
    if request.param == "Numba":
        pytest.importorskip("numba", reason="numba is not installed here")
    monkeypatch.setattr(compiled, "FEWEST", 0 if request.param == "Numba" else sys.maxsize)
    return f"trundle, {request.param}"


# --------------------------------------------------------------------------------- 100,000 samples


@pytest.mark.parametrize("integrator", ["arc+", "arc"])
def test_trundle(integrator, way, compare):
    angles = positions(100_000)
    poses = np.ones((len(angles), 3))
    compare(
        "100,000 samples",
        f"poses, {integrator}",
        way,
        lambda: tr.integrate_batch(DRIVE, angles, integrator=integrator, out=poses),
        len(angles),
    )


@pytest.mark.parametrize("integrator", ["arc+", "arc"])
def test_wpimath(integrator, compare):
    """Its one integrator, an arc; poses into an array, as ours are."""
    kinematics = pytest.importorskip("wpimath.kinematics", reason="robotpy-wpimath is not installed here")
    rotation = pytest.importorskip("wpimath.geometry").Rotation2d
    angles = positions(20_000)
    left, right = (angles * RADIUS).T.tolist()
    heading = ((angles[:, 1] - angles[:, 0]) * RADIUS / TRACK).tolist()
    poses = np.empty((len(angles), 3))

    def loop():
        odometry = kinematics.DifferentialDriveOdometry(rotation(0.0), 0.0, 0.0)
        for k in range(len(left)):
            pose = odometry.update(rotation(heading[k]), left[k], right[k])
            poses[k] = pose.X(), pose.Y(), pose.rotation().radians()

    compare("100,000 samples", f"poses, {integrator}", "wpimath", loop, len(angles), rounds=8)


# ------------------------------------------------------------------------ as fast as memory allows


@pytest.mark.parametrize("size", SIZES)
def test_into_an_array(size, way, compare):
    angles = positions(*SIZES[size])
    poses = np.ones((*SIZES[size], 3))
    samples = angles.size // 2
    compare(
        size, "poses, arc+", way, lambda: tr.integrate_batch(DRIVE, angles, out=poses), samples, rounds=15
    )


@pytest.mark.parametrize("whom", ["compiled copy", "NumPy copy"])
@pytest.mark.parametrize("size", SIZES)
def test_copy(size, whom, compare):
    """Two columns read, three written: as Numba compiles it, and as three assignments of NumPy."""
    angles = positions(*SIZES[size])
    poses = np.ones((*SIZES[size], 3))

    def copy(angles, poses):
        for robot in range(angles.shape[0]):
            for k in range(angles.shape[1]):
                poses[robot, k, 0] = angles[robot, k, 0]
                poses[robot, k, 1] = angles[robot, k, 1]
                poses[robot, k, 2] = angles[robot, k, 0]

    def columns(angles, poses):
        poses[..., 0], poses[..., 1], poses[..., 2] = angles[..., 0], angles[..., 1], angles[..., 0]

    if whom == "compiled copy":
        numba = pytest.importorskip("numba", reason="numba is not installed here")
        run = numba.njit(copy)
    else:
        run = columns
    shape = angles.shape if angles.ndim == 3 else (1, *angles.shape)
    flat, out = angles.reshape(shape), poses.reshape(*shape[:2], 3)
    compare(size, "poses, arc+", whom, lambda: run(flat, out), angles.size // 2, rounds=15)


# ------------------------------------------------------------------------------------ with covariance


@pytest.mark.parametrize("covariance", [False, True], ids=["without", "with"])
@pytest.mark.parametrize("name", ["differential", "mecanum", "ackermann"])
def test_integrate(name, covariance, compare):
    """A log through `integrate`: what `trundle track` does between reading and writing."""
    drive = {
        "differential": DRIVE,
        "mecanum": tr.Mecanum(track_width=0.3, wheelbase=0.4, wheel_radius=RADIUS),
        "ackermann": tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=RADIUS),
    }[name]
    turns = np.arange(100_000)[:, None] / np.array([50.0, 70.0])
    angles = np.cumsum(0.2 + 0.1 * np.sin(turns), axis=0)  # wheels that speed up and slow down as wheels can
    if name == "mecanum":
        angles = np.tile(angles, 2)  # both axles alike: nothing slips
    steering = 0.3 * np.sin(np.arange(len(angles)) / 100.0)[:, None]
    log = tr.WheelLog(
        time_ns=np.arange(len(angles)) * 20_000_000,
        wheel_names=drive.measured_names,
        wheels=angles,
        **({"steering_names": ("front",), "steering": steering} if drive.steered_names else {}),
    )
    compare(
        f"integrate, {'with' if covariance else 'without'} covariance",
        name,
        "trundle",
        lambda: tr.integrate(drive, log, covariance=covariance),
        len(angles),
        rounds=10,
    )
