"""The calibration from beginning to end: choose what can be told, fit, and say how good it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.calibrate.calibration import Calibration, Estimate, RunFit, Unobserved
from trundle.calibrate.cure import Cure, imagined, seen_like
from trundle.calibrate.fixes import fixes_of
from trundle.calibrate.frames import residuals
from trundle.calibrate.handedness import mirrored
from trundle.calibrate.likelihood import Fit, Observed, belief_of, fit, information_of, tracked_points
from trundle.calibrate.parameter import DRIVE, SENSOR, Candidates, Parameter, candidates_of, robot_with
from trundle.calibrate.predicted_path import Readings, predict, readings_of
from trundle.calibrate.run import Run
from trundle.calibrate.selection import (
    Excitation,
    condition_of,
    grown,
    open_directions,
    select,
    why_open,
    without_scale,
)
from trundle.errors import Inconsistent, InputError, TooFewData, TrundleError, Unobservable
from trundle.evaluate import align
from trundle.geometry import se2
from trundle.records import Trajectory
from trundle.robot import Robot

__all__ = ["calibrate"]

Floats = npt.NDArray[np.float64]
Words = Callable[[str], None]

MOST_FIXES = 6_000
"""Samples of all references together that are used; of more, every second, third, ..."""
_FEWEST_A_RUN = 100
_FAR = 0.2
"""A number that changed by more than this part of itself is hardly a better number (FAULTS.md B7)."""
_WEAK = 0.005
"""A radius known no better than this deserves a longer drive (FAULTS.md B2)."""
_SURE = 1.5
_HALF = 0.5
_TURN = 0.2
"""A heading that changed by less than this may only jitter [rad]."""
_LOOKS = 3
_FOR_NOISE, _DRAWS = 12, 3  # runs, and how often their noise is drawn
_SCATTERED = 8.0
"""A reference whose errors are more than one part in so many of what was driven says nothing of it."""


def calibrate(
    robot: Robot,
    runs: Sequence[Run],
    *,
    parameters: Sequence[str] | None = None,
    mounting: bool | None = None,
    clock: bool = True,
    prior: bool = False,
    progress: Words = lambda _: None,
) -> Calibration:
    """Find the numbers of a robot that explain its runs best.

    Maximum likelihood over all runs together. Unknown beside the numbers: where each run began, how its
    wheels' noise went, how large both noises are, which samples of the reference are wrong, where the
    reference is mounted and how late its clock is.

    Args:
        robot: As described; where the search begins.
        runs: Drives, each with what is known of where the robot really went.
        parameters: What to find, by name; None means all that the runs can tell.
        mounting: Whether to find where the reference is mounted; None means where the runs can tell.
        clock: Whether to find the reference's delay, where the runs can tell.
        prior: Whether the description itself counts, as far as its `noise` section says.
        progress: Told what is done next.

    Raises:
        Unobservable: If the runs cannot tell the numbers that a drive needs, or those that were asked for.
        TooFewData: If there is less data than unknowns.
        Inconsistent: If most of the reference contradicts the wheels, or is mirrored.
        NotConverged: If the search does not come to rest.
        InputError: If a run lacks a wheel or a reference, or there is no parameter of a name.

    Source:
        Antonelli et al. 2005 and Censi et al. 2013 calibrate by linear least squares over whole runs, which
        the first iterations here amount to; the likelihood as in Kuemmerle et al. 2012.
    """
    if not runs:
        raise TooFewData("no run is given; needs one or more")
    progress("reading the runs")
    most = max(_FEWEST_A_RUN, MOST_FIXES // len(runs))
    observed = [Observed(r.name, readings_of(robot, r.log), fixes_of(robot, r, most)) for r in runs]
    driven = _check(robot, observed)
    candidates = _candidates(robot, observed, mounting=mounting, clock=clock)
    asked = candidates.needed if parameters is None else candidates.named(parameters)
    if mounting:
        asked = (*asked, *(one for one in candidates.all if one.name.startswith("reference.")))
    asked = tuple(dict.fromkeys(asked))
    _require_data(observed, asked)

    progress("looking at what the runs can tell")
    chosen: tuple[Parameter, ...] = ()
    refused: list[tuple[str, ...]] = []
    found = _unbiased(fit(robot, observed, (), prior=prior))
    if parameters is None:
        asked = _radii_told(robot, observed, candidates, asked, found, prior)
    asked, held = _held(robot, observed, asked, found) if prior else (asked, ())
    # The first look takes the description's word for the noise, later ones what the fit before has found.
    for _ in range(_LOOKS):
        again, refused = _choose(robot, observed, candidates, asked, found, prior, grow=parameters is None)
        if again == chosen:
            break
        _require_observable(robot, observed, again, found, driven, prior)
        chosen, found = again, fit(robot, observed, again, prior=prior, progress=progress)
    _require_agreement(robot, observed, found)
    known = {one.name for one in chosen}
    stays = [
        _unobserved(robot, observed, grown(chosen, candidates.named(names)), names, found, driven, prior)
        for names in refused
        if not known >= set(names)
    ]
    for one in held:
        words, cure = why_open((one.name,), driven)
        stays.append(Unobserved((one.name,), f"{words}, and stays as described and as sure", cure.words))
    return _result(robot, observed, chosen, found, stays, held)


# --- before ------------------------------------------------------------------------------------


def _unbiased(nominal: Fit) -> Fit:
    """A fit of no number, in which their errors do not count as noise of the wheels."""
    return replace(nominal, levels=replace(nominal.levels, wheels=min(nominal.levels.wheels, 1.0)))


def _check(robot: Robot, observed: Sequence[Observed]) -> Excitation:
    distance = left = right = 0.0
    for run in observed:
        moments = run.readings.moments
        path = predict(robot, run.readings, (), np.zeros(0), moments)
        turns = _turns(path.poses[:, 2])
        distance += float(path.distance[-1])
        left += sum(turn for turn in turns if turn > 0.0)
        right -= sum(turn for turn in turns if turn < 0.0)
        at_fixes = predict(robot, run.readings, (), np.zeros(0), run.fixes.moments)
        if mirrored(at_fixes.poses, run.fixes):
            raise Inconsistent(
                f"{run.name}: the reference is the mirror image of the path: one of its axes points the "
                "other way (handedness); swap x and y, or the sign of one, or the wheels left and right"
            )
    if distance + left + right == 0.0:
        raise TooFewData("the wheels stand still in all runs: nothing can be learnt from them")
    return Excitation(distance, left, right, _measured(observed))


def _turns(headings: Floats) -> list[float]:
    """What was turned, in pieces that no jitter makes [rad]."""
    turns, last = [], float(headings[0])
    for heading in headings.tolist():
        if abs(heading - last) > _TURN:
            turns.append(heading - last)
            last = heading
    return turns


def _measured(observed: Sequence[Observed]) -> bool:
    """Whether any reference says how far it went."""
    return any(bool(np.nan_to_num(run.fixes.poses[:, :2]).any()) for run in observed)


def _candidates(
    robot: Robot, observed: Sequence[Observed], *, mounting: bool | None, clock: bool
) -> Candidates:
    names = observed[0].readings.steering_names
    if any(run.readings.steering_names != names for run in observed):
        raise InputError("the runs do not measure the same steering angles")
    seen = [run.fixes for run in observed if run.fixes.mounted]
    return candidates_of(
        robot,
        names,
        mounted=mounting is not False and any(one.positions for one in seen),
        headings=any(one.headings for one in seen),
        clock=clock and bool(seen),
    )


def _require_data(observed: Sequence[Observed], asked: Sequence[Parameter]) -> None:
    known = sum(int(np.isfinite(run.fixes.poses).sum()) for run in observed)
    starts = sum(int(np.isfinite(run.fixes.poses).any(axis=0).sum()) for run in observed)
    if known - starts < len(asked):
        raise TooFewData(
            f"{known} numbers are known of where the robot went, {starts} of which only say where it began; "
            f"{len(asked)} are looked for: {', '.join(one.name for one in asked)}. What helps: more runs, or "
            f"to look for less (--parameters {'wheel_radius' if _measured(observed) else asked[-1].name})"
        )


def _choose(
    robot: Robot,
    observed: Sequence[Observed],
    candidates: Candidates,
    asked: tuple[Parameter, ...],
    about: Fit,
    prior: bool,
    *,
    grow: bool,
) -> tuple[tuple[Parameter, ...], list[tuple[str, ...]]]:
    """The numbers to find; of those that were not asked for by name, as many as can be told."""
    groups = candidates.more
    if not grow:
        groups = tuple(group for group in groups if group[0].name.startswith(("reference.", "clock")))
    return select(
        asked,
        groups,
        lambda trial: _information(robot, observed, trial, about, prior),
        lambda trial: _spurious(robot, observed, trial, about),
    )


def _information(
    robot: Robot, observed: Sequence[Observed], parameters: Sequence[Parameter], about: Fit, prior: bool
) -> Floats:
    nominal = np.array([one.nominal for one in parameters], dtype=float)
    information = information_of(robot, observed, parameters, about, nominal)
    if not _measured(observed) and _scalable(robot, parameters):
        information = without_scale(parameters, information)
    return information + belief_of(parameters) if prior else information


def _scalable(robot: Robot, parameters: Sequence[Parameter]) -> bool:
    """Whether all lengths that make the path may change together."""
    names = {one.name for one in parameters if one.part == DRIVE}
    radii = {name for name in names if name.startswith("wheel_radius")}
    each = {f"wheel_radius.{name}" for name in robot.measuring.measured_names}
    turns = robot.measuring.gyro or names > radii
    return turns and ("wheel_radius" in radii or each <= radii)


def _radii_told(
    robot: Robot,
    observed: Sequence[Observed],
    candidates: Candidates,
    asked: tuple[Parameter, ...],
    about: Fit,
    prior: bool,
) -> tuple[Parameter, ...]:
    """One radius for all wheels where nothing but the difference between them stays open."""
    information = _information(robot, observed, asked, about, prior)
    directions = open_directions(asked, information, _spurious(robot, observed, asked, about))
    names = {name for direction in directions for name in direction}
    if not names or not all(name.startswith("wheel_radius.") for name in names):
        return asked
    (common,) = candidates.named(["wheel_radius"])
    return (common, *(one for one in asked if not one.name.startswith("wheel_radius.")))


def _held(
    robot: Robot, observed: Sequence[Observed], asked: tuple[Parameter, ...], about: Fit
) -> tuple[tuple[Parameter, ...], tuple[Parameter, ...]]:
    """What is looked for, and what stays as described: of this a prior knows, and the runs say but noise.

    Such noise would still pull at it: readings that jitter look like small turns.
    """
    information = _information(robot, observed, asked, about, prior=True)
    directions = open_directions(asked, information, _spurious(robot, observed, asked, about))
    names = {name for direction in directions for name in direction}
    held = tuple(one for one in asked if one.name in names and 0.0 < one.belief < math.inf)
    return tuple(one for one in asked if one not in held), held


def _spurious(
    robot: Robot, observed: Sequence[Observed], parameters: Sequence[Parameter], about: Fit
) -> Floats:
    """What the noise of the wheels seems to tell: by how much as much noise again would add.

    Source:
        Cook, Stefanski 1994, "Simulation-extrapolation estimation in parametric measurement error models".
    """
    nominal = np.array([one.nominal for one in parameters], dtype=float)
    some = sorted({int(k) for k in np.linspace(0, len(observed) - 1, min(len(observed), _FOR_NOISE))})
    runs = [observed[k] for k in some]
    chosen = about.of_runs(some)
    share = len(observed) / len(runs)
    plain = information_of(robot, runs, parameters, chosen, nominal)
    draw = np.random.default_rng(0)
    noisy = np.zeros_like(plain)
    for _ in range(_DRAWS):
        shaken = [replace(run, readings=_shaken(robot, run.readings, about, draw)) for run in runs]
        noisy += information_of(robot, shaken, parameters, chosen, nominal) / _DRAWS
    return share * (noisy - plain)


def _shaken(robot: Robot, readings: Readings, about: Fit, draw: np.random.Generator) -> Readings:
    """The readings with as much noise of the wheels again."""
    drive = robot.measuring
    radii = np.array([drive.wheel(name).radius for name in drive.measured_names])[:, np.newaxis]
    sigma = about.levels.wheels * robot.noise.wheel_distance * np.sqrt(np.abs(readings.turned) / radii)
    return replace(readings, turned=readings.turned + sigma * draw.standard_normal(sigma.shape))


def _require_observable(
    robot: Robot,
    observed: Sequence[Observed],
    chosen: Sequence[Parameter],
    about: Fit,
    driven: Excitation,
    prior: bool,
) -> None:
    information = _information(robot, observed, chosen, about, prior)
    directions = open_directions(chosen, information, _spurious(robot, observed, chosen, about))
    if directions:
        stays = [_unobserved(robot, observed, chosen, names, about, driven, prior) for names in directions]
        words, cures = (one.words for one in stays), (one.manoeuvre for one in stays)
        described = "noise: wheel_radius, and track_width for any distance between wheels"
        otherwise = (
            f"the prior is what it says of itself, {described}" if prior else f"or a prior, from {described}"
        )
        raise Unobservable(
            f"{'; '.join(dict.fromkeys(words))}. What helps: {'; '.join(dict.fromkeys(cures))}. "
            f"(condition {condition_of(chosen, information):.1e}; {otherwise})"
        )


def _unobserved(
    robot: Robot,
    observed: Sequence[Observed],
    parameters: Sequence[Parameter],
    names: tuple[str, ...],
    about: Fit,
    driven: Excitation,
    prior: bool,
) -> Unobserved:
    """What stays open, and what would tell it how well."""
    words, cure = why_open(names, driven)
    sigmas = _reached(robot, observed, parameters, names, about, cure, prior)
    known = {one.name: one for one in parameters}
    told = [_to_within(known[name], sigma) for name, sigma in zip(names, sigmas, strict=False)]
    promise = f" (which would tell {', '.join(told)})" if told else ""
    return Unobserved(names, words, cure.words + promise, sigmas)


def _to_within(one: Parameter, sigma: float) -> str:
    if one.part == DRIVE:
        return f"{one.name} to {100.0 * sigma / one.size:.2g} %"
    return f"{one.name} to {sigma:.2g} {one.unit}".rstrip()


def _reached(
    robot: Robot,
    observed: Sequence[Observed],
    parameters: Sequence[Parameter],
    names: tuple[str, ...],
    about: Fit,
    cure: Cure,
    prior: bool,
) -> tuple[float, ...]:
    """Standard deviations with one more run; none where it would not tell these numbers either."""
    try:
        log = imagined(robot, cure)
        run = Observed("", readings_of(robot, log), seen_like(observed[0].fixes, log))
        both, more = [*observed, run], about.with_run(len(run.fixes))
        information = _information(robot, both, parameters, more, prior)
        if open_directions(parameters, information, _spurious(robot, both, parameters, more)):
            return ()
    except TrundleError:  # not every robot can be simulated
        return ()
    sizes = np.array([one.size for one in parameters])
    scaled = information * np.outer(sizes, sizes)
    if np.linalg.eigvalsh(scaled)[0] <= 0.0:
        return ()
    sigmas = sizes * np.sqrt(np.diag(np.linalg.inv(scaled)))
    places = [one.name for one in parameters]
    return tuple(float(sigmas[places.index(name)]) for name in names)


# --- after -------------------------------------------------------------------------------------


def _require_agreement(robot: Robot, observed: Sequence[Observed], found: Fit) -> None:
    total = sum(len(run.fixes) for run in observed)
    inliers = _inliers(found)
    if inliers < _HALF * total:
        raise Inconsistent(
            f"{total - inliers} of {total} samples of the reference contradict the wheels, more than half: "
            "is it this robot's, in metres and radians, and do the clocks agree?"
        )
    wide = max((_width(robot, run) for run in observed), default=0.0)
    if 0.0 < wide < _SCATTERED * found.levels.position:
        scatter = f"{found.levels.position:.2g} m about paths that are {wide:.2g} m wide"
        raise Inconsistent(f"the reference scatters by {scatter}: is it of this robot?")


def _width(robot: Robot, run: Observed) -> float:
    """How wide the path is where a sensor saw it [m]; 0 where none did."""
    if run.fixes.sigma is not None or not run.fixes.positions:
        return 0.0
    path = predict(robot, run.readings, (), np.zeros(0), run.fixes.moments).poses[:, :2]
    return float(np.hypot(*np.ptp(path, axis=0)))


def _inliers(found: Fit) -> int:
    return sum(int((weights > _HALF).sum()) for weights in found.weights)


def _result(
    robot: Robot,
    observed: Sequence[Observed],
    chosen: Sequence[Parameter],
    found: Fit,
    unobserved: Sequence[Unobserved],
    held: Sequence[Parameter],
) -> Calibration:
    told: Any = np.linalg.inv(found.information) if len(chosen) else np.zeros((0, 0))
    sigmas = np.sqrt(np.diag(told))
    covariance = np.diag([*np.zeros(len(chosen)), *(one.belief**2 for one in held)])
    covariance[: len(chosen), : len(chosen)] = told
    estimates = tuple(
        Estimate(one.name, one.unit, one.nominal, float(value), float(sigma), _doubt(one, float(value)))
        for one, value, sigma in zip(chosen, found.values, sigmas, strict=True)
    )
    believed = tuple(Estimate(one.name, one.unit, one.nominal, one.nominal, one.belief) for one in held)
    return Calibration(
        robot=robot_with(robot, chosen, found.values.tolist()),
        estimates=(*estimates, *believed),
        covariance=covariance,
        chi2_per_dof=found.promised,
        condition=condition_of(chosen, found.information),
        samples=sum(len(run.fixes) for run in observed),
        inliers=_inliers(found),
        unobserved=tuple(unobserved),
        fits=tuple(_run_fit(robot, run, chosen, found, number) for number, run in enumerate(observed)),
        warnings=tuple(_warnings(observed, chosen, found, sigmas)),
        iterations=found.iterations,
    )


def _doubt(one: Parameter, value: float) -> str:
    if one.part == SENSOR or one.name.startswith("icr_"):
        return ""
    change = value / one.nominal - 1.0
    if abs(change) <= _FAR:
        return ""
    return (
        f"{one.name} came out as {value:.4g} {one.unit}, {100 * change:+.0f} % from its description: is the "
        "rest right (ticks, units, which wheel is which)?"
    )


def _warnings(
    observed: Sequence[Observed], chosen: Sequence[Parameter], found: Fit, sigmas: Floats
) -> Iterator[str]:
    for run, together in zip(observed, found.joined, strict=True):
        for k in np.flatnonzero(~together):
            yield (
                f"{run.name}: the reference jumps at {run.fixes.moments[k + 1]:.1f} s; what comes after is "
                "used as a run of its own"
            )
    if found.promised > _SURE:
        yield (
            f"the runs scatter {math.sqrt(found.promised):.1f} times as much as the noise section "
            f"says (chi-square {found.promised:.1f} per degree of freedom); the standard deviations follow "
            "the runs"
        )
    weak = [
        (one.name, sigma / one.size)
        for one, sigma in zip(chosen, sigmas, strict=True)
        if one.name.startswith("wheel_radius") and sigma > _WEAK * one.size
    ]
    if weak:
        names, worst = ", ".join(name for name, _ in weak), max(share for _, share in weak)
        yield f"{names}: known to {100 * worst:.1f} % only; drive 10 m straight on as well"


@dataclass(frozen=True, slots=True, eq=False)
class _Laid:
    """A path, laid onto its fixes."""

    poses: Floats
    off: Floats


def _run_fit(robot: Robot, run: Observed, chosen: Sequence[Parameter], found: Fit, number: int) -> RunFit:
    fixes = run.fixes
    nominal = np.array([one.nominal for one in chosen], dtype=float)
    names = [one.name for one in chosen]
    delay = float(found.values[names.index("clock")]) if "clock" in names and fixes.mounted else 0.0
    believed = found.weights[number] > _HALF
    before = _laid(robot, run, chosen, nominal, 0.0, believed)
    after = _laid(robot, run, chosen, found.values, delay, believed)
    stamps = (1e9 * fixes.moments).round().astype(np.int64)
    seen = fixes.positions and len(fixes) > 2
    sigma = fixes.sigma or (found.levels.position, found.levels.heading)
    measured = np.isfinite(fixes.poses)
    return RunFit(
        name=run.name,
        before=Trajectory(time_ns=stamps, poses=before.poses),
        after=Trajectory(time_ns=stamps, poses=after.poses),
        reference=Trajectory(time_ns=stamps, poses=fixes.poses) if seen else None,
        residuals=np.where(measured, after.off / np.array([sigma[0], sigma[0], sigma[1]]), np.nan),
    )


def _laid(
    robot: Robot,
    run: Observed,
    chosen: Sequence[Parameter],
    values: Floats,
    delay: float,
    believed: npt.NDArray[np.bool_],
) -> _Laid:
    """The path of the tracked point in the reference's frame, as near to it as it can be laid."""
    path = predict(robot, run.readings, chosen, values, run.fixes.moments - delay)
    tracked = tracked_points(path, run.fixes, chosen, values)
    fixes = run.fixes
    good = believed & np.isfinite(fixes.poses[:, 0])
    if good.sum() > 2 and np.ptp(tracked[good, :2], axis=0).max() > 0.0:
        stamps = np.arange(int(good.sum()), dtype=np.int64)
        own = Trajectory(time_ns=stamps, poses=tracked[good])
        seen = Trajectory(time_ns=stamps, poses=fixes.poses[good])
        laid = align(own, seen)
        frame = np.array([laid.x, laid.y, laid.theta])
    else:
        frame = se2.compose(np.nan_to_num(fixes.poses[0]), se2.inverse(tracked[0]))
    return _Laid(
        se2.compose(np.broadcast_to(frame, tracked.shape), tracked), residuals(frame, tracked, fixes)
    )
