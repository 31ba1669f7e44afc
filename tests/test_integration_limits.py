"""How far integration can be trusted: the figures of ACCURACY.md section 1, against closed forms.

Wheel positions are exact (Gauss quadrature of the twist), so what is left is integration alone.
"""

from __future__ import annotations

import math
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

import trundle as tr
from trundle import Pose2D, Reading, WheelLog
from trundle.geometry import se2
from trundle.odometry.integrate import integrate_batch

R = 0.05
DIFF = tr.Differential(track_width=0.4, wheel_radius=R)
MECANUM = tr.Mecanum(track_width=0.4, wheelbase=0.3, wheel_radius=R)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def columns(times, vx, vy, omega):
    return np.stack([np.broadcast_to(np.asarray(part, float), times.shape) for part in (vx, vy, omega)], -1)


def circle(times):
    """1 m/s on a circle of 1 m."""
    return columns(times, 1.0, 0.0, 1.0)


def circle_pose(times):
    return np.stack([np.sin(times), 1.0 - np.cos(times), times], axis=-1)


def slalom(times):
    return columns(times, 1.0, 0.0, np.cos(2.0 * times))


def weaving(times):
    """A slalom that begins straight ahead: rates have no history before their first sample."""
    return columns(times, 1.0, 0.0, np.sin(2.0 * times))


def stop_and_go(times):
    speed = 1.0 + np.sin(times)
    return columns(times, speed, 0.0, speed * np.cos(2.0 * times))


def spinning(times):
    """Straight along x at 1 m/s while spinning at 2 rad/s."""
    return columns(times, np.cos(2.0 * times), -np.sin(2.0 * times), 2.0)


def spinning_pose(times):
    return np.stack([times, np.zeros_like(times), 2.0 * times], axis=-1)


def by_quadrature(heading_of, twist_at):
    """Poses of a robot whose heading is known in closed form."""

    def pose(times):
        fine = np.concatenate([np.linspace(a, b, 3)[:-1] for a, b in pairwise(times)])
        fine = np.append(fine, times[-1])
        h = np.diff(fine)
        at = fine[:-1, None] + 0.5 * h[:, None] * (NODES + 1.0)
        vx, vy, _ = np.moveaxis(twist_at(at), -1, 0)
        c, s = np.cos(heading_of(at)), np.sin(heading_of(at))
        moved = [0.5 * h * ((c * vx - s * vy) @ WEIGHTS), 0.5 * h * ((s * vx + c * vy) @ WEIGHTS)]
        x, y = (np.append(0.0, np.cumsum(part))[::2] for part in moved)
        return np.stack([x, y, heading_of(times)], axis=-1)

    return pose


weaving_pose = by_quadrature(lambda t: np.sin(t) ** 2, weaving)
slalom_pose = by_quadrature(lambda t: 0.5 * np.sin(2.0 * t), slalom)


def _stop_and_go_heading(t):
    # The integral of (1 + sin t) cos 2t.
    return 0.5 * np.sin(2.0 * t) - np.cos(3.0 * t) / 6.0 + np.cos(t) / 2.0 - 1.0 / 3.0


stop_and_go_pose = by_quadrature(_stop_and_go_heading, stop_and_go)


def edges_of(rate: float, seconds: float):
    return np.linspace(0.0, seconds, round(seconds * rate) + 1)


def turned_along(drive, twist_at, edges):
    """Exact cumulative wheel angles at the edges."""
    h = np.diff(edges)
    times = edges[:-1, None] + 0.5 * h[:, None] * (NODES + 1.0)
    speeds, _ = drive.inverse_batch(twist_at(times))
    steps = 0.5 * h[:, None] * np.einsum("k,nkw->nw", WEIGHTS, speeds)
    return np.vstack([np.zeros(steps.shape[1]), np.cumsum(steps, axis=0)])


def log_of(drive, edges, wheels, reading=Reading.POSITION):
    stamps = np.round(edges * 1e9).astype(np.int64)
    return WheelLog(time_ns=stamps, wheel_names=drive.measured_names, wheels=wheels, reading=reading)


def worst_error(drive, twist_at, pose_at, integrator, edges, reading=Reading.POSITION) -> float:
    """Largest position error along the way [m]."""
    if reading is Reading.VELOCITY:
        wheels, _ = drive.inverse_batch(twist_at(edges))
    else:
        wheels = turned_along(drive, twist_at, edges)
    log = log_of(drive, edges, wheels, reading)
    poses = tr.integrate(drive, log, covariance=False, integrator=integrator).poses
    return float(np.hypot(*(poses - pose_at(edges))[:, :2].T).max())


# Drive, twist, pose, integrator, reading, what issue 4 allows on 1 km at 50 Hz [m] (stop-and-go: our own).
FIGURES = {
    "circle of 1 m": (DIFF, circle, circle_pose, "arc+", Reading.POSITION, 1e-8),
    "slalom": (DIFF, slalom, slalom_pose, "arc+", Reading.POSITION, 2e-5),
    "stop-and-go slalom": (DIFF, stop_and_go, stop_and_go_pose, "arc+", Reading.POSITION, 2e-4),
    "while spinning, live": (MECANUM, spinning, spinning_pose, "arc+", Reading.POSITION, 5e-3),
    "while spinning, offline": (MECANUM, spinning, spinning_pose, "symmetric", Reading.POSITION, 1e-4),
    "slalom from wheel speeds": (DIFF, weaving, weaving_pose, "arc+", Reading.VELOCITY, 1e-3),
}


@pytest.mark.parametrize("name", FIGURES)
def test_short(name: str) -> None:
    """A tenth of the way, and the same bound: what is wrong shows at once."""
    drive, twist_at, pose_at, integrator, reading, allowed = FIGURES[name]
    assert worst_error(drive, twist_at, pose_at, integrator, edges_of(50.0, 100.0), reading) < allowed


@pytest.mark.verify
@pytest.mark.parametrize("name", FIGURES)
def test_one_kilometre(name: str) -> None:
    drive, twist_at, pose_at, integrator, reading, allowed = FIGURES[name]
    error = worst_error(drive, twist_at, pose_at, integrator, edges_of(50.0, 1000.0), reading)
    print(f"1 km at 50 Hz, {name}, {integrator}: {error:.2g} m (allowed {allowed:g})")
    assert error < allowed


@pytest.mark.parametrize(("integrator", "least"), [("arc+", 2.9), ("symmetric", 2.9), ("arc", 1.9)])
def test_order_of_convergence(integrator: str, least: float) -> None:
    """Halving the step divides the error by 2^order: the slope over two halvings."""
    errors = [
        worst_error(DIFF, slalom, slalom_pose, integrator, edges_of(rate, 50.0))
        for rate in (10.0, 20.0, 40.0)
    ]
    slope = math.log2(errors[0] / errors[2]) / 2.0
    print(f"{integrator}: errors {errors}, order {slope:.2f}")
    assert slope > least


def test_unequal_steps() -> None:
    """10 and 30 ms in turn, straight while spinning, 100 s: with the factor of equal steps 6.7e-3 m."""
    edges = np.concatenate([[0.0], np.cumsum(np.tile([0.01, 0.03], 2500))])
    assert worst_error(MECANUM, spinning, spinning_pose, "arc+", edges) < 7e-4
    assert worst_error(MECANUM, spinning, spinning_pose, "arc", edges) > 5e-3


@pytest.mark.parametrize("integrator", ["arc+", "arc", "midpoint", "euler", "symmetric"])
def test_change_of_frame(integrator: str) -> None:
    """4 km from another pose are the same 4 km seen from there."""
    edges = edges_of(10.0, 4000.0)
    log = log_of(DIFF, edges, turned_along(DIFF, slalom, edges))
    start = Pose2D(3.0, -2.0, 2.5)
    here = tr.integrate(DIFF, log, covariance=False, integrator=integrator).poses
    there = tr.integrate(DIFF, log, covariance=False, integrator=integrator, pose=start).poses
    moved = se2.compose(np.array([start.x, start.y, start.theta]), here)
    assert np.abs(there - moved).max() < 1e-9


def test_splitting_a_log() -> None:
    """4 km in one piece, and in pieces: live at the seams, arrays between them."""
    edges = edges_of(10.0, 4000.0)
    positions = turned_along(DIFF, slalom, edges)
    whole = tr.integrate(DIFF, log_of(DIFF, edges, positions), covariance=False).poses
    odometry = tr.WheelOdometry(DIFF, covariance=False)
    pieces = [
        odometry.update(time_ns=int(stamp), positions=row).pose
        for stamp, row in zip(np.round(edges * 1e9), positions.tolist(), strict=True)
    ]
    assert np.abs(np.array([(p.x, p.y, p.theta) for p in pieces]) - whole).max() < 1e-9


@pytest.mark.parametrize("integrator", ["arc", "symmetric"])
def test_time_reversal(integrator: str) -> None:
    """Driven backwards, reading by reading, the robot comes home: 4 km there, 4 km back."""
    edges = edges_of(10.0, 4000.0)
    positions = turned_along(DIFF, stop_and_go, edges)
    there = integrate_batch(DIFF, positions, integrator=integrator)
    back = integrate_batch(DIFF, positions[::-1], integrator=integrator)
    relative = se2.compose(se2.inverse(there[-1]), there)
    assert np.abs(back[::-1] - relative).max() < 1e-9


# --- a day of it -------------------------------------------------------------------------------------------

# What the wheels turn in a millisecond [rad]; its sums are exact.
LEFT, RIGHT = 2.0**-6, 2.0**-6 + 2.0**-10


def a_day(samples: int, odometry: tr.WheelOdometry, begun: int = 0) -> Pose2D:
    """Samples at 1 kHz of a robot that circles."""
    update = odometry.update
    for k in range(begun, samples):
        update(time_ns=k * 1_000_000, positions=(k * LEFT, k * RIGHT))
    return odometry.state.pose


def on_the_circle(samples: int) -> Pose2D:
    """Where exact arithmetic ends with the same steps."""
    mpmath = pytest.importorskip("mpmath")
    dx, _, dt = DIFF.displacement([LEFT, RIGHT])
    with mpmath.workdps(50):
        turn = mpmath.mpf(dt) * (samples - 1)
        radius = mpmath.mpf(dx) / mpmath.mpf(dt)
        return Pose2D(float(radius * mpmath.sin(turn)), float(radius * (1 - mpmath.cos(turn))), float(turn))


def test_a_short_day_adds_up() -> None:
    count = 200_000
    pose = a_day(count, tr.WheelOdometry(DIFF, covariance=False))
    wanted = on_the_circle(count)
    assert math.hypot(pose.x - wanted.x, pose.y - wanted.y) < 1e-9
    assert abs(pose.theta - wanted.theta) < 1e-10


def s26() -> None:
    """24 h at 1 kHz: nothing grows, and rounding stays far below a micrometre; here a minute of it."""
    odometry = tr.WheelOdometry(DIFF)
    a_day(10_000, odometry)
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        a_day(70_000, odometry, begun=10_000)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 16 * 1024
    pose, wanted = odometry.state.pose, on_the_circle(70_000)
    assert math.hypot(pose.x - wanted.x, pose.y - wanted.y) < 1e-9
    assert np.linalg.eigvalsh(np.array(odometry.state.covariance))[0] > 0.0


@pytest.mark.parametrize("check", [pytest.param(s26, id="S26")])
def test_fault(check) -> None:
    check()


@pytest.mark.verify
def test_a_whole_day() -> None:
    """S26 in full: 86.4 million samples; some minutes."""
    resource = pytest.importorskip("resource")
    odometry, count = tr.WheelOdometry(DIFF, covariance=False), 86_400_000
    a_day(100_000, odometry)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    pose = a_day(count, odometry, begun=100_000)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    wanted = on_the_circle(count)
    error = math.hypot(pose.x - wanted.x, pose.y - wanted.y)
    print(
        f"24 h at 1 kHz: off by {error:.2g} m and {abs(pose.theta - wanted.theta):.2g} rad, grown {grown} KiB"
    )
    assert error < 1e-6
    assert grown <= 1024
