"""All runs together: the numbers, frames and noises under which their fixes are most likely."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from trundle.calibrate.fixes import Fixes
from trundle.calibrate.frames import first_frame, residuals
from trundle.calibrate.jumps import joined
from trundle.calibrate.parameter import Parameter
from trundle.calibrate.predicted_path import PredictedPath, Readings, adjoint, predict
from trundle.calibrate.smoother import REFUSED, STILL, Levels, Linear, Reduced, eliminate, frame_covariances
from trundle.calibrate.vouching import vouched
from trundle.errors import ConfigError, MissingExtra, NotConverged
from trundle.geometry import se2
from trundle.robot import Robot

__all__ = ["Fit", "Observed", "belief_of", "fit", "information_of", "tracked_points"]

Floats = npt.NDArray[np.float64]
Words = Callable[[str], None]

FREEDOM = 5.0
"""Degrees of freedom of the Student t that the errors of fixes first are: gross ones count little."""
OUTLIER = 25.0
"""Squared distance, in standard deviations, beyond which a fix is no noisy fix but a wrong one."""
_LOOSE = (30.0, 10.0, 3.0)
"""The wheels' noise of the first iterations: before numbers are right, paths only hold over short ways."""
_NOTHING = 1e-9  # weight of a fix that is refused
_WEIGHED = 2  # iterations before fixes are believed more or less
_ALONE, _ALL = 3, 7
"""Iterations that look how large the noises are: the reference's alone, then the wheels' too."""
_ROBUST = 12  # iterations until most wrong fixes are found
_ROUND, _ROUNDS = 3, 5  # iterations from there on with one set of good fixes, and how often it may change
_MOST = 80
_LONGEST = 0.3
"""Greatest change of a number in one iteration, in parts of its size."""
_SETTLED = 0.02
"""Standard deviations: smaller steps change nothing that anybody could tell."""
_NORMAL = 0.6745  # median absolute deviation of a Gaussian, in standard deviations
_FEWEST_RUNS, _ENOUGH_FIXES = 4, 2000  # more say nothing new about how large the noises are


@dataclass(frozen=True, slots=True, eq=False)
class Observed:
    """A run as the likelihood sees it.

    Attributes:
        name: For people.
        readings: What its sensors said.
        fixes: What is known of where it went.
    """

    name: str
    readings: Readings
    fixes: Fixes


@dataclass(slots=True, eq=False)
class Fit:
    """Numbers, and what goes with them; the iterations change it until it is the maximum.

    Attributes:
        values: The parameters.
        levels: How large the noises are.
        frames: Of each run, at its fixes, shape (N, 3).
        weights: How far each fix of each run is believed, shape (N,).
        joined: Whether each fix of each run continues the one before, shape (N - 1,).
        information: About the parameters, shape (parameters, parameters).
        promised: Chi-square per degree of freedom, were the wheels' noise as described.
        iterations: How many it took.
    """

    values: Floats
    levels: Levels
    frames: list[Floats] = field(default_factory=list)
    weights: list[Floats] = field(default_factory=list)
    joined: list[npt.NDArray[np.bool_]] = field(default_factory=list)
    information: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    promised: float = 1.0
    iterations: int = 0

    def of_runs(self, chosen: Sequence[int]) -> Fit:
        """The same for some of the runs."""
        return replace(
            self,
            frames=[self.frames[k] for k in chosen],
            weights=[self.weights[k] for k in chosen],
            joined=[self.joined[k] for k in chosen],
        )

    def with_run(self, fixes: int) -> Fit:
        """The same with one more run of so many fixes, that agrees."""
        return replace(
            self,
            frames=[*self.frames, np.zeros((fixes, 3))],
            weights=[*self.weights, np.ones(fixes)],
            joined=[*self.joined, np.ones(fixes - 1, dtype=bool)],
        )


def fit(
    robot: Robot,
    runs: Sequence[Observed],
    parameters: Sequence[Parameter],
    *,
    prior: bool = False,
    progress: Words = lambda _: None,
) -> Fit:
    """Maximise the likelihood of all fixes: Gauss-Newton, with the frames eliminated.

    First with Student's t for the fixes, which finds those that are wrong; then with the others alone and
    Gaussian, which is efficient and knows its own uncertainty, until these stay the same ones. As long as
    nothing tells wrong fixes from right ones, the wheels are believed to be as good as described: noise of
    the wheels that is large enough explains every fix.

    Args:
        robot: As described.
        runs: What was observed.
        parameters: What may change.
        prior: Whether the description counts, as far as its noise section says.
        progress: Told how far it is.

    Raises:
        NotConverged: If the numbers do not come to rest.
    """
    state = _begin(robot, runs, parameters)
    try:
        _iterate(state, robot, runs, parameters, prior=prior, progress=progress)
    except ConfigError as error:  # no robot has such numbers
        raise NotConverged(state.iterations, [error.field]) from None
    except np.linalg.LinAlgError:
        raise NotConverged(state.iterations, [one.name for one in parameters[:3]]) from None
    return state


def _iterate(
    state: Fit,
    robot: Robot,
    runs: Sequence[Observed],
    parameters: Sequence[Parameter],
    *,
    prior: bool,
    progress: Words,
) -> None:
    """Change a fit until it is the maximum."""
    nominal, size = state.values.copy(), np.array([one.size for one in parameters])
    belief = belief_of(parameters) if prior else np.zeros((len(size), len(size)))
    change = np.zeros(len(size))
    good: list[Floats] = []  # weights of the last round
    agreed = False
    for iteration in range(_MOST):
        progress(f"iteration {iteration + 1}")
        loose = _LOOSE[iteration] if iteration < len(_LOOSE) else 1.0
        linear = [_linear(robot, run, parameters, state, k) for k, run in enumerate(runs)]
        if iteration == _WEIGHED:
            state.levels = _scatter(linear, state)
        elif iteration in (_ALONE, _ALL):
            state.levels = _levels(linear, state, belief, wheels=iteration == _ALL)
        elif not agreed and iteration in range(_ROBUST, _ROBUST + _ROUND * _ROUNDS, _ROUND):
            agreed = bool(good) and all(map(np.array_equal, good, state.weights))
            good = state.weights.copy()
            if not agreed:
                state.levels = _levels(linear, state, belief)
        levels = replace(state.levels, wheels=loose * state.levels.wheels)
        reduced = [eliminate(one, levels, w) for one, w in zip(linear, state.weights, strict=True)]
        state.information = sum((one.information for one in reduced), belief)
        slope = sum((one.slope for one in reduced), belief @ (state.values - nominal))
        change = _newton(state.information, slope, size)
        _step(state, change, reduced)
        state.iterations = iteration + 1
        agreed = agreed or iteration >= _ROBUST + _ROUND * _ROUNDS
        if iteration >= _WEIGHED and not agreed:
            _reweigh(state, linear, reduced, change, hard=iteration >= _ROBUST - 1)
        if agreed and change @ state.information @ change < _SETTLED**2:
            break
    else:
        loudest = np.argsort(-(change**2) * np.diag(state.information))
        raise NotConverged(_MOST, [parameters[k].name for k in loudest[:3]])
    state.promised = _promised(linear, state, len(parameters))


def information_of(
    robot: Robot, runs: Sequence[Observed], parameters: Sequence[Parameter], about: Fit, values: Floats
) -> Floats:
    """What the fixes say about other parameters, where the frames and noises are those of a fit."""
    state = replace(about, values=values)
    linear = [_linear(robot, run, parameters, state, k) for k, run in enumerate(runs)]
    parts = [eliminate(one, about.levels, w) for one, w in zip(linear, about.weights, strict=True)]
    total: Floats = sum((one.information for one in parts), np.zeros((len(values), len(values))))
    return total


def belief_of(parameters: Sequence[Parameter]) -> Floats:
    """What the description says about its own numbers, as information."""
    return np.diag([1.0 / one.belief**2 if 0.0 < one.belief < math.inf else 0.0 for one in parameters])


def tracked_points(
    path: PredictedPath, fixes: Fixes, parameters: Sequence[Parameter], values: Floats
) -> Floats:
    """Poses of what the reference followed, shape (N, 3)."""
    mounting = _mounting(fixes, parameters, values)
    tracked: Floats = se2.compose(path.poses, np.broadcast_to(mounting, path.poses.shape))
    return tracked


# --- the iterations ----------------------------------------------------------------------------


def _begin(robot: Robot, runs: Sequence[Observed], parameters: Sequence[Parameter]) -> Fit:
    state = Fit(np.array([one.nominal for one in parameters], dtype=float), Levels())
    for run in runs:
        path = predict(robot, run.readings, parameters, state.values, run.fixes.moments)
        frame = first_frame(tracked_points(path, run.fixes, parameters, state.values), run.fixes)
        state.frames.append(np.tile(frame, (len(run.fixes), 1)))
        good = vouched(path.poses, run.fixes)
        state.weights.append(np.where(good, 1.0, _NOTHING))
        state.joined.append(joined(path.poses, run.fixes, good))
    return state


def _linear(robot: Robot, run: Observed, parameters: Sequence[Parameter], state: Fit, number: int) -> Linear:
    """A run about the present numbers."""
    values, fixes, frames = state.values, run.fixes, state.frames[number]
    names = [one.name for one in parameters]
    delay = values[names.index("clock")] if "clock" in names and fixes.mounted else 0.0
    path = predict(robot, run.readings, parameters, values, fixes.moments - delay)
    mounting = _mounting(fixes, parameters, values)
    tracked = tracked_points(path, fixes, parameters, values)
    by_frame = _turned_into(frames[:, 2]) @ _lever(tracked)
    by_parameter = by_frame @ path.slopes
    turned = _turned_into(frames[:, 2] + path.poses[:, 2])
    if fixes.mounted:
        arm = _turned_into(mounting[2:]) @ np.array([*fixes.offset, 0.0])
        by_mounting = turned @ _lever(arm)
        for axis, name in enumerate(("reference.x", "reference.y", "reference.theta")):
            if name in names:
                by_parameter[:, :, names.index(name)] = by_mounting[:, :, axis]
        if "clock" in names:
            velocity = path.twists.copy()
            velocity[:, 0] -= path.twists[:, 2] * mounting[1]
            velocity[:, 1] += path.twists[:, 2] * mounting[0]
            by_parameter[:, :, names.index("clock")] = -np.einsum("kij,kj->ki", turned, velocity)
    measured = np.isfinite(fixes.poses)
    return Linear(
        residuals=residuals(frames, tracked, fixes),
        measured=measured,
        by_frame=by_frame,
        by_parameter=by_parameter,
        drift=se2.log(se2.compose(se2.inverse(frames[:-1]), frames[1:])),
        spread=np.diff(path.spread, axis=0),
        joined=state.joined[number],
        given=fixes.sigma,
    )


def _newton(information: Floats, slope: Floats, size: Floats) -> Floats:
    """The change that would bring a parabola to its bottom, kept short."""
    if not len(size):
        return np.zeros(0)
    scaled = information * np.outer(size, size)
    change = -np.linalg.lstsq(scaled, slope * size, rcond=1e-12)[0]
    longest = float(np.abs(change).max())
    found: Floats = size * change * min(1.0, _LONGEST / max(longest, 1e-9))
    return found


def _step(state: Fit, change: Floats, reduced: Sequence[Reduced]) -> None:
    state.values = state.values + change
    both = np.concatenate([[1.0], change])
    for k, one in enumerate(reduced):
        state.frames[k] = se2.compose(state.frames[k], se2.exp(one.frames @ both))


def _reweigh(
    state: Fit, linear: Sequence[Linear], reduced: Sequence[Reduced], change: Floats, *, hard: bool
) -> None:
    """Believe fixes less, the further they are from where the others say that they should be.

    Source:
        Lange, Little, Taylor 1989, "Robust statistical modeling using the t distribution": the expectation
        step, in which the place of a fix is uncertain too.
    """
    both = np.concatenate([[1.0], change])
    sure = [] if hard else frame_covariances(linear, state.levels, state.weights)
    for k, (one, part) in enumerate(zip(linear, reduced, strict=True)):
        if one.given is not None:
            continue
        moved = np.einsum("kij,kj->ki", one.by_frame, part.frames @ both) + one.by_parameter @ change
        variance = one.sigmas(state.levels) ** 2
        square = ((one.residuals + moved) ** 2 * one.measured / variance).sum(axis=1)
        if hard:
            state.weights[k] = np.where(square > OUTLIER, _NOTHING, 1.0)
            continue
        seen = np.einsum("kij,kjl,kil->ki", one.by_frame, sure[k], one.by_frame, optimize=True)
        square += (seen * one.measured / variance).sum(axis=1)
        state.weights[k] = (FREEDOM + one.measured.sum(axis=1)) / (FREEDOM + square)


# --- how large the noises are ------------------------------------------------------------------


def _scatter(linear: Sequence[Linear], state: Fit) -> Levels:
    """How large the reference's noises look, whatever nearly half of the fixes say.

    Source:
        Hampel 1974, "The influence curve and its role in robust estimation": the median absolute deviation.
    """

    def spread(columns: slice, otherwise: float) -> float:
        off = [
            np.abs(one.residuals[:, columns][one.measured[:, columns] & (weights > REFUSED)[:, np.newaxis]])
            for one, weights in zip(linear, state.weights, strict=True)
            if one.given is None
        ]
        seen = np.concatenate([np.zeros(0), *off])
        return max(float(np.median(seen)) / _NORMAL, STILL) if len(seen) else otherwise

    position = spread(slice(0, 2), state.levels.position)
    return replace(state.levels, position=position, heading=spread(slice(2, 3), state.levels.heading))


def _levels(linear: Sequence[Linear], state: Fit, belief: Floats, *, wheels: bool = True) -> Levels:
    """The noises under which the fixes are most likely, whatever the parameters (REML).

    Args:
        linear: The runs.
        state: Their weights, and the noises so far.
        belief: The prior.
        wheels: Whether that of the wheels is looked for, too.

    Source:
        Patterson, Thompson 1971, "Recovery of inter-block information when block sizes are unequal".
    """
    fixes = sum(len(one.residuals) for one in linear)
    count = min(len(linear), max(_FEWEST_RUNS, len(linear) * _ENOUGH_FIXES // max(fixes, 1)))
    chosen = np.unique(np.linspace(0, len(linear) - 1, count).astype(int))
    runs = [(linear[k], state.weights[k]) for k in chosen]
    free = [one for one, _ in runs if one.given is None]
    open_ = [
        wheels and any(int(one.measured.sum()) > 3 for one, _ in runs),
        any(one.measured[:, :2].any() for one in free),
        any(one.measured[:, 2].any() for one in free),
    ]
    if not any(open_):
        return state.levels
    try:
        from scipy.optimize import minimize
    except ImportError:
        raise MissingExtra("scipy", "calibrate") from None
    now = np.log([state.levels.wheels, state.levels.position, state.levels.heading])

    def levels_at(point: Floats) -> Levels:
        logs = now.copy()
        logs[open_] = np.clip(point, np.log((1e-2, 1e-5, 1e-5))[open_], np.log((1e3, 1e2, 1e1))[open_])
        return Levels(*np.exp(logs).tolist())

    def unlikelihood(point: Floats) -> float:
        levels = levels_at(point)
        return _unlikelihood([eliminate(one, levels, weights) for one, weights in runs], belief)

    simplex = now[open_] + np.vstack([np.zeros(sum(open_)), 0.7 * np.eye(sum(open_))])
    options = {"initial_simplex": simplex, "xatol": 0.05, "fatol": 0.05, "maxfev": 80}
    return levels_at(minimize(unlikelihood, now[open_], method="Nelder-Mead", options=options).x)


def _unlikelihood(parts: Sequence[Reduced], belief: Floats) -> float:
    """Minus twice the logarithm of the restricted likelihood, less a constant."""
    total = sum((one.chi2 + one.log_determinant for one in parts), 0.0)
    if not len(belief):
        return total
    information = sum((one.information for one in parts), belief)
    slope = sum((one.slope for one in parts), np.zeros(len(belief)))
    change, _, rank, _ = np.linalg.lstsq(information, slope, rcond=1e-14)
    sizes = np.linalg.eigvalsh(information)[-rank:]
    return total - float(slope @ change) + float(np.log(np.maximum(sizes, 1e-300)).sum())


def _promised(linear: Sequence[Linear], state: Fit, parameters: int) -> float:
    """Chi-square per degree of freedom, the wheels' noise as described."""
    levels = replace(state.levels, wheels=1.0)
    parts = [eliminate(one, levels, w) for one, w in zip(linear, state.weights, strict=True)]
    believed = sum(int(one.measured[w > REFUSED].sum()) for one, w in zip(linear, state.weights, strict=True))
    all_of_them = sum(int(one.measured.sum()) for one in linear)
    degrees = sum(part.count for part in parts) - (all_of_them - believed) - parameters
    information = sum((part.information for part in parts), np.zeros((parameters, parameters)))
    slope = sum((part.slope for part in parts), np.zeros(parameters))
    change = np.linalg.lstsq(information, slope, rcond=1e-14)[0] if parameters else np.zeros(0)
    chi2 = sum(part.chi2 for part in parts) - float(slope @ change)
    return chi2 / degrees if degrees > 0 else 1.0


# --- geometry ----------------------------------------------------------------------------------


def _mounting(fixes: Fixes, parameters: Sequence[Parameter], values: Floats) -> Floats:
    """Pose of what the reference followed, seen from the robot."""
    if not fixes.mounted:
        return np.zeros(3)
    found = {one.name: float(value) for one, value in zip(parameters, values, strict=True)}
    moved = np.array([found.get(f"reference.{part}", 0.0) for part in ("x", "y", "theta")])
    mounting: Floats = se2.compose(moved, np.array([*fixes.offset, 0.0]))
    return mounting


def _turned_into(headings: Floats) -> Floats:
    """Rotations of the plane, headings untouched, shape (N, 3, 3)."""
    return adjoint(np.stack([0.0 * headings, 0.0 * headings, headings], axis=-1))


def _lever(poses: Floats) -> Floats:
    """Change of poses by a small displacement (x, y, theta) of the frame that they are seen from."""
    found = np.tile(np.eye(3), (len(poses), 1, 1))
    found[:, 0, 2], found[:, 1, 2] = -poses[:, 1], poses[:, 0]
    return found
