"""Batch code is written once: every array library gets its own arrays back, with NumPy's numbers in them.

Each environment runs these with the libraries that it has; `make test` goes through them all.
"""

from __future__ import annotations

import array_api_compat
import numpy as np
import pytest

import trundle as tr
from trundle.geometry import se2

LIBRARIES = {
    "numpy": "it is everywhere",
    "array_api_strict": ".venv and .envs/jax have it",
    "jax": ".envs/jax has it",
    "torch": "no environment has it",
}


@pytest.fixture(scope="module", params=LIBRARIES)
def library(request):
    """The array-API namespace of one library."""
    why = f"{request.param} is not installed here ({LIBRARIES[request.param]})"
    module = pytest.importorskip(request.param, reason=why)
    if request.param == "jax":
        module.config.update("jax_enable_x64", True)
        module = module.numpy
    return array_api_compat.array_namespace(module.asarray([0.0]))


@pytest.fixture(scope="module")
def tangents():
    """Twists of all sizes, both signs, and none at all."""
    sizes = np.concatenate([[0.0, 1e-300, 1e-160], np.logspace(-20, 0.5, 40)])
    corners = np.array([[0.3, -0.7, 1.0], [2.0, 0.1, -1.0], [0.0, 0.0, 0.9]])
    return sizes[:, None, None] * corners


def agree(ours, numpys, library, *, rtol=1e-14):
    """The same library's array, the same dtype, the same numbers."""
    assert array_api_compat.array_namespace(ours) is library
    assert ours.dtype == library.float64

    np.testing.assert_allclose(np.from_dlpack(ours), numpys, rtol=rtol, atol=1e-15)


@pytest.mark.parametrize("name", ["exp", "log", "inverse", "adjoint", "right_jacobian", "wrap", "sinc"])
def test_geometry_of_one_argument(name, library, tangents):
    function = getattr(se2, name)
    agree(function(library.asarray(tangents)), function(tangents), library)


def test_compose_broadcasts(library, tangents):
    first, second = tangents[:, :1, :], tangents[:1, :, :]
    agree(
        se2.compose(library.asarray(first), library.asarray(second)),
        se2.compose(first, second),
        library,
        rtol=1e-13,
    )


def test_single_precision_is_kept(library):
    narrow = library.asarray([[0.3, -0.7, 1.0]], dtype=library.float32)
    assert se2.exp(narrow).dtype == library.float32
    assert (
        tr.Differential(track_width=0.2, wheel_radius=0.04).forward_batch(narrow[:, :2]).dtype
        == library.float32
    )


DRIVES = {
    "differential": tr.Differential(track_width=0.2, wheel_radius=0.04),
    "mecanum": tr.Mecanum(track_width=0.3, wheelbase=0.4, wheel_radius=0.05),
    "omni": tr.Omni(robot_radius=0.2, wheel_radius=0.05, wheel_count=4),
    "swerve": tr.Swerve(modules=[(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)], wheel_radius=0.05),
    "ackermann": tr.Ackermann(wheelbase=0.3, track_width=0.2, wheel_radius=0.04),
}


@pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)
def test_drives_go_there_and_back(drive, library):
    random = np.random.default_rng(7)
    # What each wheel turns and steers for a feasible motion: forward first, then inverse, then forward again.
    wanted = random.uniform(-1.0, 1.0, size=(5, 40, 3))
    if drive in (DRIVES["differential"], DRIVES["ackermann"]):
        wanted[..., 0] = np.abs(wanted[..., 0]) + 1.0
        wanted[..., 1] = 0.0
    speeds, steering = drive.inverse_batch(library.asarray(wanted))
    numpy_speeds, numpy_steering = drive.inverse_batch(wanted)
    agree(speeds, numpy_speeds, library, rtol=1e-12)
    agree(steering, numpy_steering, library, rtol=1e-12)
    measured = [drive.wheel_names.index(name) for name in drive.measured_names]
    chosen = library.stack([speeds[..., k] for k in measured], axis=-1)
    twists = drive.forward_batch(chosen, steering if drive.steered_names else None)
    agree(twists, wanted, library, rtol=1e-10)


def test_jax_derivatives_are_right_jacobians():
    """JAX differentiates straight through: d log(exp(t)^-1 exp(t + d)) / dd at d = 0, the definition of J."""
    jax = pytest.importorskip("jax", reason="jax is not installed here (.envs/jax has it)")
    jax.config.update("jax_enable_x64", True)
    for tangent in ([0.3, -0.7, 1.0], [0.3, -0.7, 0.0], [1e-3, 2.0, 1e-9], [0.5, 0.5, -2.5]):
        t = jax.numpy.asarray(tangent)

        def error(d, t=t):
            return se2.log(se2.compose(se2.inverse(se2.exp(t)), se2.exp(t + d)))

        np.testing.assert_allclose(jax.jacfwd(error)(jax.numpy.zeros(3)), se2.right_jacobian(t), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "integrator", "stamped"),
    [
        *((name, "arc+", False) for name in DRIVES),
        *(("differential", way.value, stamped) for way in tr.Integrator for stamped in (False, True)),
    ],
)
def test_batches_of_robots(name, integrator, stamped, library):
    drive = DRIVES[name]
    random = np.random.default_rng(3)
    turned = random.uniform(0.1, 0.3, (3, 60, len(drive.measured_names)))
    positions = np.cumsum(turned, axis=1)
    steering = 0.3 * np.sin(np.arange(60) / 10.0 + random.uniform(0.0, 0.1, (len(drive.steered_names), 3, 1)))
    steering = np.moveaxis(steering, 0, -1) if drive.steered_names else None
    time_ns = np.cumsum(random.integers(5, 30, 60)) * 1_000_000 if stamped else None
    ours = tr.integrate_batch(
        drive,
        library.asarray(positions),
        time_ns if time_ns is None else library.asarray(time_ns),
        steering if steering is None else library.asarray(steering),
        integrator,
    )
    numpys = tr.integrate_batch(drive, positions, time_ns, steering, integrator)
    assert ours.shape == (3, 60, 3)
    assert array_api_compat.device(ours) == array_api_compat.device(library.asarray(positions))
    agree(ours, numpys, library, rtol=1e-12)


def test_batches_keep_single_precision(library):
    drive = DRIVES["differential"]
    positions = library.asarray(np.cumsum(np.full((20, 2), 0.1), axis=0), dtype=library.float32)
    # NumPy's poses are always double precision.
    kept = library.float64 if array_api_compat.is_numpy_namespace(library) else library.float32
    assert tr.integrate_batch(drive, positions).dtype == kept


@pytest.mark.parametrize("name", ["differential", "mecanum", "swerve", "ackermann"])
def test_whole_logs(name):
    """On the oldest NumPy too. Ackermann's log has one virtual steering angle."""
    drive = DRIVES[name]
    steered = ("front",) if name == "ackermann" else drive.steered_names
    angles = np.zeros((10, len(steered)))
    log = tr.WheelLog(
        time_ns=np.arange(10) * 20_000_000,
        wheel_names=drive.measured_names,
        wheels=np.cumsum(np.full((10, len(drive.measured_names)), 0.1), axis=0),
        steering_names=steered,
        steering=angles if steered else None,
    )
    poses = tr.integrate(drive, log).poses
    np.testing.assert_allclose(poses[-1], [0.9 * drive.wheels[0].radius, 0.0, 0.0], atol=1e-15)
