"""Held-out runs: what is judged of each, and what the verdict is."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import trundle as tr
from trundle.calibrate import Calibration, Closed, Estimate, Rolled, Run, Spun
from trundle.calibrate.hold_out import HoldOut, Trial, groups_of, halves, hold_out
from trundle.errors import InputError, Unobservable
from trundle.geometry import se2
from trundle.simulate import NOISELESS, Course, Gyro, arc, simulate, spin, square, straight

TRUE = tr.Differential(track_width=0.2, wheel_radius=0.05)
DESCRIBED = tr.Robot(drive=tr.Differential(track_width=0.2, wheel_radius=0.051))
CAR = tr.Bicycle(wheelbase=0.3, wheel_radius=0.03)


def driven(*manoeuvres, drive=TRUE, **options):
    return simulate(drive, Course.of(*manoeuvres), rate=20.0, noise=NOISELESS, **options)


def found(drive, **values):
    """A calibration with these numbers."""
    nominal = {"steering.front.gain": 1.0, "gyro.scale": 1.0}
    estimates = [
        Estimate(name, "", nominal.get(name, 0.0), value, 1e-3)
        for name, value in ((name.replace("_", "."), value) for name, value in values.items())
    ]
    return Calibration(
        robot=tr.Robot(drive=drive),
        estimates=tuple(estimates),
        covariance=np.eye(len(estimates)),
        chi2_per_dof=1.0,
        condition=1.0,
        samples=1,
        inliers=1,
    )


def judged(run, robot=DESCRIBED, by=None):
    return hold_out(robot, [run], [[0]], lambda runs: by or found(TRUE)).trials[0]


@pytest.mark.parametrize(
    ("manoeuvre", "reference", "error", "unit", "before"),
    [
        (straight(2.0, 0.4), Rolled(2.0), "distance", "m", 0.02 * 2.0),
        (spin(2 * math.tau, 1.0), Spun(2 * math.tau), "heading", "rad", 0.02 * 2 * math.tau),
        (spin(-math.tau, 1.0), Spun(-math.tau), "heading", "rad", 0.02 * math.tau),
        (arc(0.5, math.tau, 0.4), Closed(), "closure", "m", 2 * 0.51 * math.sin(0.01 * math.tau) / 1.02),
    ],
)
def test_what_a_tape_measure_judges(manoeuvre, reference, error, unit, before):
    trial = judged(Run(driven(manoeuvre), reference, "a"))
    assert (trial.error, trial.unit) == (error, unit)
    assert trial.before == pytest.approx(before, rel=0.03)
    assert trial.after < 1e-3 * trial.before


def test_a_trajectory_is_judged_at_the_tracked_point_in_its_own_time():
    log = driven(square(1.0, 0.4))
    mounting = (0.1, -0.05, 0.3)
    seen = dataclasses.replace(
        log.reference,
        poses=se2.compose(log.reference.poses, np.array(mounting)),
        twists=None,
        time_ns=log.reference.time_ns + 50_000_000,
    )
    values = dict(zip(("reference_x", "reference_y", "reference_theta"), mounting, strict=True))
    run = Run(log, seen, "a")
    assert judged(run, by=found(TRUE, **values, clock=0.05)).after < 1e-5
    assert judged(run, by=found(TRUE, **values)).after > 1e-3
    assert judged(run, by=found(TRUE, clock=0.05)).after > 1e-3
    assert judged(run).error == "ATE"


def test_steering_is_judged_with_the_offset_that_was_found():
    log = driven(arc(0.8, 3.0, 0.5), arc(0.8, -3.0, 0.5), drive=CAR)
    off = dataclasses.replace(log, steering=(log.steering - 0.04) / 0.9)
    run = Run(off, log.reference, "a")
    values = {"steering_front_gain": 0.9, "steering_front_offset": 0.04}
    trial = judged(run, tr.Robot(drive=CAR), found(CAR, **values))
    assert trial.before > 0.05
    assert trial.after < 1e-3 * trial.before


def test_headings_of_a_gyro_judge_headings():
    log = dataclasses.replace(driven(spin(math.tau, 1.0), gyro=Gyro(bias=-0.02)), reference=None)
    wider = found(TRUE, gyro_bias=0.02)
    trial = judged(Run(log, None, "a"), by=wider)
    assert (trial.error, trial.unit) == ("heading", "rad")
    assert trial.before > 0.05
    assert trial.after < 1e-3


def test_each_group_is_judged_by_the_others():
    runs = [Run(driven(straight(1.0, 0.4)), Rolled(1.0), name) for name in "abc"]
    seen = []

    def calibrated(some):
        seen.append("".join(run.name for run in some))
        if seen[-1] == "c":
            raise Unobservable("c alone tells nothing")
        return found(TRUE)

    verdict = hold_out(DESCRIBED, runs, [[0, 1], [2]], calibrated)
    assert seen == ["c", "ab"]
    assert [trial.name for trial in verdict.trials] == ["c"]
    assert verdict.refused == ("without a, b the others cannot be calibrated: c alone tells nothing",)
    assert verdict.better


def test_what_cannot_be_judged_is_said_once():
    runs = [Run(driven(straight(1.0, 0.4)), Rolled(1.0), name) for name in "abc"]

    def calibrated(_some):
        raise Unobservable("too little")

    verdict = hold_out(DESCRIBED, runs, [[0], [1], [2]], calibrated)
    assert verdict.refused == (
        "without a or without b or without c the others cannot be calibrated: too little",
    )


@pytest.mark.parametrize(
    ("errors", "better", "words"),
    [
        (
            [(2.0, 1.0), (8.0, 1.0)],
            True,
            "Better: 2 runs that were held out are explained 4.00 times more",
        ),
        ([(8.0, 1.0), (1.0, 2.0)], True, "explained 2.00 times more accurately; 1 of them got worse."),
        (
            [(1.0, 2.0)],
            False,
            "Not better: 1 run that was held out is explained only 0.50 times as",
        ),
        ([(1.0, 0.999)], False, "Not better: 1 run"),
        ([(0.0, 0.0)], False, "Not better: 1 run"),
        ([], False, "No run could be held out"),
    ],
)
def test_the_verdict(errors, better, words):
    trials = tuple(Trial(str(k), "ATE", "m", *pair) for k, pair in enumerate(errors))
    verdict = HoldOut(trials)
    assert verdict.better is better
    assert words in verdict.words


def test_halves_are_the_run():
    log = driven(square(1.0, 0.4))
    first, second = halves(Run(log, log.reference, "a"))
    assert len(first.log) + len(second.log) == len(log)
    assert first.log.time_ns[-1] < second.log.time_ns[0]
    assert len(first.reference) + len(second.reference) == len(log.reference)
    assert (first.name, second.name) == ("first half of a", "second half of a")
    assert judged(second).after < 1e-5
    with pytest.raises(InputError, match="a: only a run with a trajectory as reference can be cut"):
        halves(Run(log, Rolled(1.0), "a"))


@pytest.mark.parametrize(
    ("labels", "most", "groups"),
    [
        ("abc", 4, [[0], [1], [2]]),
        ("abcab", 3, [[0, 3], [1, 4], [2]]),
        ("abcd", 2, [[0, 1], [2, 3]]),
        ("abcde", 2, [[0, 1], [2, 3, 4]]),
    ],
)
def test_groups(labels, most, groups):
    assert list(groups_of(labels, most)) == groups


@pytest.mark.parametrize(
    ("kinds", "groups"),
    [
        ("rrsz", [[0, 2], [1, 3]]),
        ("rrrrss", [[0, 1, 4], [2, 3, 5]]),
        ("rsz", [[0, 2], [1]]),
        ("rrr", [[0], [1, 2]]),
    ],
)
def test_every_group_gets_of_every_kind(kinds, groups):
    assert list(groups_of([str(k) for k in range(len(kinds))], 2, kinds)) == groups
