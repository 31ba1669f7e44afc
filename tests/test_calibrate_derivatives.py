"""The linear problem of `calibrate`: its slopes are those of differences, its solution the dense one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import trundle as tr
from trundle.calibrate.fixes import Fixes
from trundle.calibrate.likelihood import Fit, Observed, _linear
from trundle.calibrate.parameter import Parameter, candidates_of
from trundle.calibrate.predicted_path import predict, readings_of
from trundle.calibrate.smoother import Levels, Linear, eliminate, frame_covariances
from trundle.geometry import se2
from trundle.simulate import Course, Gyro, arc, simulate, straight

R, TRACK, BASE = 0.05, 0.4, 0.6
SQUARE = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.2), (-0.3, -0.2)]
DRIVES = {
    "differential": tr.Differential(track_width=TRACK, wheel_radius=R),
    "differential+gyro": tr.Differential(
        track_width=TRACK, wheel_radius=R, measured=("left", "right", "gyro")
    ),
    "skid_steer": tr.SkidSteer(track_width=TRACK, wheelbase=BASE, wheel_radius=R),
    "bicycle": tr.Bicycle(wheelbase=BASE, wheel_radius=R),
    "ackermann": tr.Ackermann(wheelbase=BASE, track_width=TRACK, wheel_radius=R),
    "tricycle": tr.Tricycle(wheelbase=BASE, wheel_radius=R),
    "four_wheel_steering": tr.FourWheelSteering(wheelbase=BASE, track_width=TRACK, wheel_radius=R),
    "mecanum": tr.Mecanum(track_width=TRACK, wheelbase=BASE, wheel_radius=R),
    "omni": tr.Omni(robot_radius=0.3, wheel_radius=R),
    "swerve": tr.Swerve(modules=SQUARE, wheel_radius=R),
    "tracking_wheels": tr.TrackingWheels(
        [(0.1, 0.2, 0.0), (0.1, -0.2, 0.0), (-0.1, 0.0, math.pi / 2)], wheel_radius=R
    ),
    "custom": tr.Custom(wheels=[tr.Wheel("left", 0.0, 0.2, R), tr.Wheel("right", 0.0, -0.2, R)]),
}
COURSE = Course.of(straight(0.5, 0.5), arc(1.0, 0.7, 0.5), arc(1.2, -1.0, 0.4))
POINT = (0.05, -0.03)
"""Of a reference that was described but could not be moved to the robot, for want of headings [m]."""
REFERENCES = {
    "poses": {},
    "positions": {"lacks": [2], "offset": POINT},
    "headings": {"lacks": [0, 1]},
    "the robot's own": {"mounted": False, "whole_turns": True, "sigma": (0.002, 0.01)},
}


# --------------------------------------------------------------------- slopes


def observed(kind: str, *, lacks=(), offset=(0.0, 0.0), mounted=True, whole_turns=False, sigma=None):
    """A short run of a drive, and fixes somewhere near it, at moments between the log's rows."""
    drive = DRIVES[kind]
    robot = tr.Robot(drive=drive, noise=tr.Noise(wheel_distance=0.01, lateral_slip=0.01))
    if isinstance(drive, tr.TrackingWheels):
        robot = robot.replace(drive=DRIVES["differential"], localizer=drive)
    log = simulate(robot, COURSE, rate=10.0, seed=3, gyro=Gyro(bias=0.01) if drive.gyro else None)
    readings = readings_of(robot, log)
    moments = np.array([0.234, 1.01, 2.718, 3.33, 4.449])
    poses = predict(robot, readings, (), np.zeros(0), moments).poses + 0.1 * chance(1).normal(size=(5, 3))
    poses[:, list(lacks)] = math.nan
    fixes = Fixes(
        moments=moments, poses=poses, sigma=sigma, whole_turns=whole_turns, mounted=mounted, offset=offset
    )
    return robot, log, Observed(kind, readings, fixes)


def chance(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def linear_at(robot, run: Observed, parameters, values, frames) -> Linear:
    together = np.ones(len(frames) - 1, dtype=bool)
    state = Fit(values, Levels(), [frames], [np.ones(len(frames))], [together])
    return _linear(robot, run, parameters, state, 0)


def central(function, step: float) -> np.ndarray:
    return (function(step) - function(-step)) / (2.0 * step)


@pytest.mark.parametrize("seen", REFERENCES)
@pytest.mark.parametrize("kind", DRIVES)
def test_slopes_of_residuals_are_those_of_differences(kind, seen):
    """By each number that can be asked for, mounting and clock included, and by each frame."""
    robot, log, run = observed(kind, **REFERENCES[seen])
    candidates = candidates_of(robot, log.steering_names, mounted=True, headings=True, clock=True)
    parameters = by_one_name(candidates.all)
    values = np.array([one.nominal + 0.03 * one.size for one in parameters])
    frames = 0.2 * chance(2).normal(size=(5, 3))
    found = linear_at(robot, run, parameters, values, frames)
    for k, one in enumerate(parameters):

        def by_number(step, k=k):
            changed = values + step * np.eye(len(values))[k]
            return linear_at(robot, run, parameters, changed, frames).residuals

        slope = central(by_number, 1e-6 * one.size)
        assert_close(found.by_parameter[:, :, k] * found.measured, slope, one.name)
    for axis in range(3):

        def by_frame(step, axis=axis):
            moved = se2.compose(frames, se2.exp(step * np.eye(3)[axis]))
            return linear_at(robot, run, parameters, values, moved).residuals

        assert_close(found.by_frame[:, :, axis] * found.measured, central(by_frame, 1e-6), axis)


def by_one_name(all_of_them) -> list[Parameter]:
    """Each number once, and a radius either of all wheels or of each."""
    found = {one.name: one for one in all_of_them}
    if any(name.startswith("wheel_radius.") for name in found):
        found.pop("wheel_radius", None)
    if "icr_left" in found:
        found.pop("track_width", None)
    return list(found.values())


def assert_close(slope, difference, of) -> None:
    scale = 1.0 + np.abs(difference).max()
    assert slope == pytest.approx(difference, abs=1e-6 * scale), of


# --------------------------------------------------------------------- the dense problem


def some_linear(seed: int, count: int, given=None) -> Linear:
    """Any linear problem: three numbers, some components missing."""
    draw = chance(seed)
    measured = draw.random((count, 3)) < 0.8
    half = draw.normal(size=(count - 1, 3, 3))
    return Linear(
        residuals=0.01 * draw.normal(size=(count, 3)) * measured,
        measured=measured,
        by_frame=np.eye(3) + 0.3 * draw.normal(size=(count, 3, 3)),
        by_parameter=draw.normal(size=(count, 3, 3)),
        drift=0.01 * draw.normal(size=(count - 1, 3)),
        spread=1e-4 * (half @ half.transpose(0, 2, 1) + 0.1 * np.eye(3)),
        joined=np.ones(count - 1, dtype=bool),
        given=given,
    )


@dataclasses.dataclass
class Dense:
    """The same problem with the covariance of all fixes written out."""

    covariance: np.ndarray  # of the measured components
    residuals: np.ndarray  # as expected by the walk of the frames
    slopes: np.ndarray  # by the parameters
    frames: np.ndarray  # information about all frames, by walk and fixes


def dense(linear: Linear, levels: Levels, weights: np.ndarray) -> Dense:
    count = len(linear.residuals)
    # The walk: each frame is the sum of the steps before it.
    sums = np.kron(np.tril(np.ones((count, count))), np.eye(3))
    steps = np.zeros((3 * count, 3 * count))
    steps[:3, :3] = 1e2 * np.eye(3)
    for k, spread in enumerate(linear.spread):
        at = slice(3 * k + 3, 3 * k + 6)
        steps[at, at] = spread * levels.wheels**2 + 1e-10 * np.eye(3)
    walk = sums @ steps @ sums.T
    middle = -sums @ np.concatenate([np.zeros(3), linear.drift.ravel()])
    seen = np.zeros((3 * count, 3 * count))
    for k, block in enumerate(linear.by_frame):
        seen[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    position, heading = linear.given or (levels.position, levels.heading)
    variance = np.tile([position**2, position**2, heading**2], count) / np.repeat(weights, 3)
    known = linear.measured.ravel()
    seen, variance = seen[known], variance[known]
    return Dense(
        covariance=seen @ walk @ seen.T + np.diag(variance),
        residuals=linear.residuals.ravel()[known] + seen @ middle,
        slopes=linear.by_parameter.reshape(-1, 3)[known],
        frames=np.linalg.inv(walk) + seen.T @ (seen / variance[:, np.newaxis]),
    )


LEVELS = (Levels(1.0, 0.005, 0.01), Levels(3.0, 0.02, 0.05))


@pytest.mark.parametrize("levels", LEVELS)
@pytest.mark.parametrize("given", [None, (0.004, 0.02)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_elimination_is_generalised_least_squares(seed, given, levels):
    linear = some_linear(seed, 9, given)
    weights = chance(seed + 10).uniform(0.1, 1.0, 9)
    found, whole = eliminate(linear, levels, weights), dense(linear, levels, weights)
    slopes = np.linalg.solve(whole.covariance, whole.slopes)
    assert found.information == pytest.approx(whole.slopes.T @ slopes, rel=1e-5)
    assert found.slope == pytest.approx(slopes.T @ whole.residuals, rel=1e-5, abs=1e-6)
    chi2 = whole.residuals @ np.linalg.solve(whole.covariance, whole.residuals)
    assert found.chi2 == pytest.approx(chi2, rel=1e-5)
    assert found.count == linear.measured.sum() - 3  # which say where it began


def test_jump_makes_two_runs_of_one():
    whole, weights = some_linear(4, 9), chance(4).uniform(0.1, 1.0, 9)
    parts = [
        dataclasses.replace(
            whole,
            **{
                name: getattr(whole, name)[at]
                for name in ("residuals", "measured", "by_frame", "by_parameter")
            },
            **{name: getattr(whole, name)[between] for name in ("drift", "spread", "joined")},
        )
        for at, between in ((slice(0, 4), slice(0, 3)), (slice(4, 9), slice(4, 8)))
    ]
    cut = eliminate(dataclasses.replace(whole, joined=np.arange(8) != 3), LEVELS[0], weights)
    first, second = (
        eliminate(one, LEVELS[0], weights[at])
        for one, at in zip(parts, (slice(0, 4), slice(4, 9)), strict=True)
    )
    assert cut.information == pytest.approx(first.information + second.information, rel=1e-3)
    assert cut.slope == pytest.approx(first.slope + second.slope, rel=1e-3)
    assert cut.chi2 == pytest.approx(first.chi2 + second.chi2, rel=1e-3)
    assert cut.count == first.count + second.count


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_likelihood_tells_noises_apart_as_the_dense_one_does(seed):
    """Up to a constant that no level of noise changes."""
    linear, weights = some_linear(seed, 9), chance(seed).uniform(0.1, 1.0, 9)
    banded = [eliminate(linear, levels, weights).log_determinant for levels in LEVELS]
    whole = [np.linalg.slogdet(dense(linear, levels, weights).covariance)[1] for levels in LEVELS]
    assert banded[1] - banded[0] == pytest.approx(whole[1] - whole[0], abs=1e-3)


def test_frames_are_as_sure_as_the_dense_inverse_says():
    """Runs of different lengths, side by side."""
    runs = [some_linear(seed, count) for seed, count in ((1, 9), (2, 5), (3, 2))]
    weights = [chance(k).uniform(0.1, 1.0, len(one.residuals)) for k, one in enumerate(runs)]
    for one, believed, found in zip(runs, weights, frame_covariances(runs, LEVELS[0], weights), strict=True):
        whole = np.linalg.inv(dense(one, LEVELS[0], believed).frames)
        blocks = [whole[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(len(found))]
        scale = np.sqrt(np.einsum("kii->k", np.stack(blocks)))
        for own, block, size in zip(found, blocks, scale, strict=True):
            assert own == pytest.approx(block, abs=1e-5 * size**2)


def test_frames_stay_sure_where_wheels_cannot_slip():
    """Two wheels move a robot in two ways only: seen from afar, loud noise is all but singular."""
    linear = some_linear(5, 9)
    ways = np.array([[10.0, -3.0, 1.0], [2.0, 7.0, 0.0]])
    spread = np.tile(ways.T @ np.diag([1e-6, 1e-9]) @ ways, (8, 1, 1))
    stiff = dataclasses.replace(linear, spread=spread)
    levels = Levels(wheels=1e3, position=0.035, heading=0.6)
    eliminated = eliminate(stiff, levels, np.full(9, 1e-9))
    assert np.isfinite(eliminated.log_determinant)
    assert np.linalg.eigvalsh(eliminated.information).min() >= 0.0
    (sure,) = frame_covariances([stiff], levels, [np.full(9, 1e-9)])
    assert np.linalg.eigvalsh(0.5 * (sure + np.swapaxes(sure, 1, 2))).min() > 0.0
