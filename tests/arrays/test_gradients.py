"""Through poses to the numbers that a drive was made with: reverse, forward and differences agree."""

from __future__ import annotations

import numpy as np
import pytest

import trundle as tr

RANDOM = np.random.default_rng(11)
TURNED = np.cumsum(RANDOM.uniform(-0.1, 0.3, (50, 4)), axis=0)
STEERED = 0.3 * np.sin(np.arange(50) / 10.0)[:, None] * np.ones(4)


def swerve(a, b, r):
    return tr.Swerve(modules=[(a, b), (a, -b), (-a, b), (-a, -b)], wheel_radius=r)


def two_radii(left, right, track):
    return tr.Differential(track_width=track, wheel_radius={"left": left, "right": right})


def tracking(y, x, tilt, r):
    return tr.TrackingWheels([(0.0, y, 0.0), (0.0, -y, 0.0), (x, y, 1.5 + tilt)], wheel_radius=r)


# How each is made, and from what.
DRIVES = {
    "differential": (two_radii, (0.04, 0.041, 0.2)),
    "skid steer": (
        lambda t, b, r: tr.SkidSteer(track_width=t, wheelbase=b, wheel_radius=r),
        (0.4, 0.3, 0.05),
    ),
    "mecanum": (lambda t, b, r: tr.Mecanum(track_width=t, wheelbase=b, wheel_radius=r), (0.3, 0.4, 0.05)),
    "omni": (lambda d, r, a: tr.Omni(robot_radius=d, wheel_radius=r, first_wheel_angle=a), (0.2, 0.05, 0.1)),
    "bicycle": (lambda b, r: tr.Bicycle(wheelbase=b, wheel_radius=r), (0.3, 0.05)),
    "ackermann": (lambda b, t, r: tr.Ackermann(wheelbase=b, track_width=t, wheel_radius=r), (0.3, 0.2, 0.05)),
    "tricycle": (lambda b, r, y: tr.Tricycle(wheelbase=b, wheel_radius=r, front_y=y), (0.3, 0.05, 0.02)),
    "swerve": (swerve, (0.3, 0.2, 0.05)),
    "tracking wheels": (tracking, (0.3, 0.1, 0.1, 0.05)),
}


def last_pose(drive, xp):
    positions = xp.asarray(TURNED[:, : len(drive.measured_names)])
    steering = xp.asarray(STEERED[:, : len(drive.steered_names)]) if drive.steered_names else None
    return tr.integrate_batch(drive, positions, steering=steering)[-1, :]


def differences(make, numbers):
    """Central differences, by NumPy alone."""
    columns = []
    for k, number in enumerate(numbers):
        step = 1e-5 * number
        poses = []
        for sign in (1.0, -1.0):
            moved = list(numbers)
            moved[k] += sign * step
            poses.append(last_pose(make(*moved), np))
        columns.append((poses[0] - poses[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


@pytest.fixture(scope="module")
def jax():
    jax = pytest.importorskip("jax", reason="jax is not installed here (.envs/jax has it)")
    jax.config.update("jax_enable_x64", True)
    return jax


@pytest.mark.parametrize(("make", "numbers"), DRIVES.values(), ids=DRIVES)
def test_jax(make, numbers, jax):
    def pose(vector):
        return last_pose(make(*vector), jax.numpy)

    vector = jax.numpy.asarray(numbers)
    reverse = jax.jacrev(pose)(vector)
    np.testing.assert_allclose(reverse, jax.jacfwd(pose)(vector), rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(reverse, differences(make, numbers), rtol=1e-7, atol=1e-8)


@pytest.mark.filterwarnings("ignore:.*torch.jit.script.*:FutureWarning")  # torch's own, about itself
@pytest.mark.parametrize(("make", "numbers"), DRIVES.values(), ids=DRIVES)
def test_torch(make, numbers):
    torch = pytest.importorskip("torch", reason="torch is not installed here (no environment has it)")

    def pose(*scalars):
        return last_pose(make(*scalars), torch)

    scalars = tuple(torch.tensor(number, dtype=torch.float64) for number in numbers)
    reverse = torch.stack(torch.autograd.functional.jacobian(pose, scalars), dim=-1)
    ones = [
        tuple(float(i == k) * torch.ones_like(s) for i, s in enumerate(scalars)) for k in range(len(scalars))
    ]
    forward = torch.stack([torch.func.jvp(pose, scalars, one)[1] for one in ones], dim=-1)
    np.testing.assert_allclose(reverse, forward, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(reverse, differences(make, numbers), rtol=1e-7, atol=1e-8)


def test_jax_through_the_readings(jax):
    make, numbers = DRIVES["ackermann"]
    drive = make(*numbers)

    def x(positions):
        return tr.integrate_batch(drive, positions, steering=jax.numpy.asarray(STEERED[:, :2]))[-1, 0]

    positions = jax.numpy.asarray(TURNED[:, :2])
    slope = jax.jit(jax.grad(x))(positions)
    step = np.zeros_like(TURNED[:, :2])
    step[20, 1] = 1e-5
    np.testing.assert_allclose(slope[20, 1], (x(positions + step) - x(positions - step)) / 2e-5, atol=1e-9)


def test_a_drive_is_made_outside_of_jit(jax):
    make, numbers = DRIVES["differential"]
    with pytest.raises(tr.ConfigError, match=r"inside jax\.jit a drive can only be used"):
        jax.jit(lambda vector: last_pose(make(*vector), jax.numpy))(jax.numpy.asarray(numbers))


def test_impossible_numbers_are_refused_while_they_are_traced(jax):
    """Wheels in one line observe no turning, whether or not somebody differentiates."""
    make, _ = DRIVES["tracking wheels"]
    with pytest.raises(tr.ConfigError, match="turning"):
        jax.grad(lambda y: last_pose(make(y, 0.0, 0.0, 0.05), jax.numpy)[0])(0.0)


def test_a_drive_is_used_inside_of_jit(jax):
    make, numbers = DRIVES["ackermann"]
    drive = make(*numbers)
    twists = jax.numpy.asarray([[1.0, 0.0, 0.3], [2.0, 0.0, -0.3]])
    speeds, steering = jax.jit(drive.inverse_batch)(twists)
    np.testing.assert_allclose(speeds, drive.inverse_batch(np.asarray(twists))[0], rtol=1e-14)
    np.testing.assert_allclose(jax.jit(drive.forward_batch)(speeds[:, 2:], steering), twists, atol=1e-14)
