"""Rows B of the fault table in finer parts: what `calibrate` says, and what it never returns."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

import trundle as tr
from trundle.calibrate import Calibration, Closed, Run, calibrate, likelihood
from trundle.errors import Inconsistent, NotConverged, TooFewData, Unobservable
from trundle.simulate import Course, arc, figure_eight, simulate, spin, square, straight

NOISE = tr.Noise(wheel_distance=0.002, lateral_slip=0.002)
TRACK, LEFT, RIGHT = 0.206, 0.0413, 0.0417
DRIVES = {
    "differential": tr.Differential(track_width=TRACK, wheel_radius={"left": LEFT, "right": RIGHT}),
    "tricycle": tr.Tricycle(wheelbase=0.156, wheel_radius=0.033),
    "mecanum": tr.Mecanum(track_width=0.206, wheelbase=0.206, wheel_radius=0.0305),
}
DESCRIBED = {
    "differential": tr.Differential(track_width=0.20, wheel_radius=0.042),
    "tricycle": tr.Tricycle(wheelbase=0.150, wheel_radius=0.0325),
    "mecanum": tr.Mecanum(track_width=0.2, wheelbase=0.2, wheel_radius=0.030),
}
EIGHT = (Course.of(figure_eight(0.6, 0.4), straight(1.0, 0.4)),)
MIXED = (
    Course.of(
        straight(3.0, 0.3),
        arc(0.5, 7.2, 0.3),
        arc(0.5, -7.2, 0.3),
        spin(6.0, 1.0),
        spin(-6.0, 1.0),
        straight(3.0, 0.3),
    ),
)
SQUARES = tuple(Course.of(square(1.0, 0.4, yaw_rate=1.0, clockwise=way)) for way in (False, True)) * 2


def camera(log: tr.WheelLog, draw: np.random.Generator) -> tr.Trajectory:
    poses = log.reference.poses
    poses = poses + np.array([0.002, 0.002, 0.005]) * draw.normal(size=poses.shape)
    return tr.Trajectory(time_ns=log.reference.time_ns, poses=poses)


def rarely(log: tr.WheelLog, draw: np.random.Generator) -> tr.Trajectory:
    every = camera(log, draw)
    return tr.Trajectory(time_ns=every.time_ns[::8], poses=every.poses[::8])


def closed(*_) -> Closed:
    return Closed()


def driven(kind: str, courses, seen=camera, *, noise=NOISE, seed=1) -> list[Run]:
    robot = tr.Robot(drive=DRIVES[kind], noise=noise)
    runs = []
    for k, course in enumerate(courses):
        log = simulate(robot, course, rate=10.0, seed=(seed, k))
        known = seen(log, np.random.default_rng((seed, k, 7)))
        runs.append(Run(dataclasses.replace(log, reference=None), known, f"run {k}"))
    return runs


def described(kind: str = "differential", noise=NOISE, **numbers) -> tr.Robot:
    drive = tr.Differential(**{"track_width": 0.2, "wheel_radius": 0.042, **numbers}) if numbers else None
    return tr.Robot(drive=drive or DESCRIBED[kind], noise=noise)


def found_of(found: Calibration) -> dict[str, tuple[float, float]]:
    return {one.name: (one.value, one.sigma) for one in found.estimates}


# ------------------------------------------------------------ B1: what the logs do not tell

B1 = {
    "straight": ("differential", straight(3.0, 0.4), ("track_width",), "hardly turn", "turn as well"),
    "back-and-forth": (
        "differential",
        (straight(2.0, 0.4), straight(-2.0, 0.4)),
        ("track_width",),
        "hardly turn",
        "turn as well",
    ),
    "spin": ("differential", spin(4 * math.tau, 1.5), ("track_width",), "on the spot", "straight"),
    "arc": ("differential", arc(0.7, 5.0, 0.4), ("track_width",), "only one way, to the left", "other way"),
    "arc-right": ("differential", arc(0.7, -5.0, 0.4), ("track_width",), "to the right", "other way"),
    "tricycle-arc": ("tricycle", arc(0.7, 5.0, 0.4), ("wheelbase",), "only one way", "other way"),
    "mecanum-straight": ("mecanum", straight(3.0, 0.4), ("lx + ly",), "hardly turn", "turn as well"),
}


def fault_b1(case: str) -> None:
    kind, motions, names, why, cure = B1[case]
    course = Course.of(*(motions if isinstance(motions, tuple) else (motions,)))
    with pytest.raises(Unobservable) as refused:
        calibrate(described(kind), driven(kind, (course,)))
    words, helps = str(refused.value).split("What helps: ")
    assert all(name in words for name in names)
    assert why in words
    assert cure in helps


BOTH_WAYS = (spin(3 * math.tau, 1.0), spin(-3 * math.tau, 1.0))
CURES = {
    "straight": BOTH_WAYS,
    "spin": (straight(5.0, 0.4),),
    "arc": (straight(3.0, 0.4), spin(-3 * math.tau, 1.0)),
    "mecanum-straight": BOTH_WAYS,
}


@pytest.mark.parametrize("case", CURES)
def test_what_helps_tells_as_much_as_it_promises(case):
    kind, motions, *_ = B1[case]
    first, second = Course.of(motions), Course.of(*CURES[case])
    with pytest.raises(Unobservable) as refused:
        calibrate(described(kind), driven(kind, (first,)), mounting=False, clock=False)
    promised = re.findall(r"([\w.+ ]+) to ([\d.]+) %", str(refused.value).split("which would tell ")[1])
    assert promised
    numbers = found_of(calibrate(described(kind), driven(kind, (first, second)), mounting=False, clock=False))
    for name, percent in promised:
        value, sigma = numbers[name.strip()]
        assert 0.6 < 100.0 * sigma / value / float(percent) < 1.6


def test_a_sensor_that_stays_unknown_is_told_with_what_would_know_it():
    """Straight on, a reference may be mounted anywhere along the robot: turning shows where."""
    found = calibrate(
        described(), driven("differential", (Course.of(straight(4.0, 0.4)),)), parameters=("wheel_radius",)
    )
    (place,) = (one for one in found.unobserved if one.names == ("reference.x", "reference.y"))
    assert all(0.0 < sigma < 0.005 for sigma in place.sigmas)
    assert "turn as well" in place.manoeuvre
    assert "which would tell reference.x to 0.00" in place.manoeuvre


def test_what_only_noise_tells_stays_as_a_prior_says():
    """Wheels that jitter look like small turns; these say nothing of the track."""
    noise = tr.Noise(wheel_distance=0.01, lateral_slip=0.002, wheel_radius=0.02, track_width=0.05)
    runs = driven("differential", (Course.of(straight(6.0, 0.4)),) * 2, noise=noise)
    with pytest.raises(Unobservable, match="or a prior, from noise: wheel_radius, and track_width"):
        calibrate(described(noise=noise), runs, mounting=False, clock=False)
    found = calibrate(described(noise=noise), runs, prior=True, mounting=False, clock=False)
    value, sigma = found_of(found)["wheel_radius.left"]
    assert abs(value - LEFT) < 4 * sigma < 0.02 * LEFT
    assert found_of(found)["track_width"] == (0.2, pytest.approx(0.05 * 0.2))
    assert found.robot.drive.parameters["track_width"] == 0.2
    assert found.covariance.shape == (len(found.estimates),) * 2
    (open_,) = (one for one in found.unobserved if one.names == ("track_width",))
    assert "stays as described" in open_.words
    assert "turn as well" in open_.manoeuvre


# ------------------------------------------------------------ B2: loops that close


def fault_b2(case: str) -> None:
    if case == "ratio":  # one radius sets the scale, the rest is told
        found = calibrate(
            described(),
            driven("differential", SQUARES, closed),
            parameters=("wheel_radius.left", "track_width"),
        )
        for name, truth in (("wheel_radius.left", LEFT), ("track_width", TRACK)):
            value, sigma = found_of(found)[name]
            assert abs(value - truth * 0.042 / RIGHT) < 4 * sigma
            assert sigma < 0.005 * truth
    elif case == "believed":
        noise = tr.Noise(wheel_distance=0.002, lateral_slip=0.002, wheel_radius=0.02, track_width=0.02)
        found = calibrate(described(noise=noise), driven("differential", SQUARES, closed), prior=True)
        value, sigma = found_of(found)["wheel_radius.right"]
        assert 0.005 < sigma / value < 0.02
        assert abs(value - RIGHT) < 3 * sigma
        assert any("drive 10 m straight" in words for words in found.warnings)
    else:
        promise = (
            r"how far these logs went.* drive 10 m straight .*which would tell wheel_radius.* to 0\.0\d+ %"
        )
        with pytest.raises(Unobservable, match=promise):
            calibrate(described(case), driven(case, SQUARES, closed))


# ------------------------------------------------------------ B5 to B8


def fault_b5(case: str) -> None:
    columns = {"swapped": [1, 0, 2]}.get(case, [0, 1, 2])
    signs = {"reversed": (-1, 1, 1), "longer": (1, -1, -1), "among": (1, -1, -1), "headings": (1, 1, -1)}

    def seen(log, draw):
        known = camera(log, draw)
        return dataclasses.replace(
            known, poses=known.poses[:, columns] * np.array(signs.get(case, (1, 1, 1)))
        )

    # Over a longer drive, wheels that are described wrongly lead far from the path itself, too.
    runs = driven("differential", EIGHT if case in ("swapped", "reversed") else MIXED, seen)
    if case == "among":
        runs += driven("differential", MIXED * 2, seed=2)
    robot = described(track_width=0.185)
    with pytest.raises(Inconsistent, match="handedness"):
        calibrate(robot, runs)


def shuffled(log, draw):
    known = camera(log, draw)
    return dataclasses.replace(known, poses=draw.permutation(known.poses))


def fault_b6(case: str) -> None:
    if case.startswith("shuffled"):  # of wheels that are not said to slip sideways
        noise = tr.Noise(wheel_distance=float(case.split("-")[1]))
        for courses in (EIGHT, MIXED):
            with pytest.raises((NotConverged, Inconsistent)):
                calibrate(described(noise=noise), driven("differential", courses, shuffled, noise=noise))
        return
    if case == "converge":
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(likelihood, "_SETTLED", 1e-150)  # never at rest
            with pytest.raises(NotConverged) as refused:
                calibrate(described(), driven("differential", EIGHT))
        assert refused.value.iterations == 80
        assert "80 iterations" in str(refused.value)
        assert "wheel_radius" in str(refused.value)
        return

    def few(log, draw):
        known, count = camera(log, draw), {"two": 2, "three": 3}[case]
        return tr.Trajectory(time_ns=known.time_ns[:count], poses=known.poses[:count])

    refusals = {
        "two": (TooFewData, "must be 3 or more"),
        "three": (Unobservable, "track_width cannot be told"),
    }
    error, words = refusals[case]
    with pytest.raises(error, match=words):
        calibrate(described(), driven("differential", EIGHT, few))


def fault_b7(case: str) -> None:
    numbers = {"diameter": {"wheel_radius": 0.084}, "half-track": {"track_width": 0.1}}[case]
    found = calibrate(described(**numbers), driven("differential", EIGHT))
    doubted = {one.name for one in found.estimates if one.doubt}
    expected = {"diameter": {"wheel_radius.left", "wheel_radius.right"}, "half-track": {"track_width"}}
    assert doubted == expected[case]
    for name, truth in (("wheel_radius.left", LEFT), ("wheel_radius.right", RIGHT), ("track_width", TRACK)):
        value, sigma = found_of(found)[name]
        assert abs(value - truth) < 4 * sigma


def fault_b8(case: str) -> None:
    """Sigmas cover the scatter between runs, however wrong the noise section is."""
    noise = tr.Noise(wheel_distance=0.008, lateral_slip=0.002)
    off, chi2 = [], []
    for seed in range(5):
        found = calibrate(
            described(),
            driven("differential", EIGHT, rarely, noise=noise, seed=seed),
            mounting=False,
            clock=False,
        )
        numbers = found_of(found)
        truth = {"track_width": TRACK, "wheel_radius.left": LEFT, "wheel_radius.right": RIGHT}
        off += [(numbers[name][0] - truth[name]) / numbers[name][1] for name in truth]
        chi2.append(found.chi2_per_dof)
    assert min(chi2) > 1.5
    assert 0.5 < math.sqrt(float(np.mean(np.square(off)))) < 1.5


ROWS = {
    "B1": (fault_b1, tuple(B1)),
    "B2": (fault_b2, ("differential", "mecanum", "ratio", "believed")),
    "B5": (fault_b5, ("swapped", "reversed", "longer", "among", "headings")),
    "B6": (fault_b6, ("two", "three", "converge", "shuffled-0.003", "shuffled-0.01")),
    "B7": (fault_b7, ("diameter", "half-track")),
    "B8": (fault_b8, ("scatter",)),
}


@pytest.mark.parametrize(
    ("row", "case"),
    [pytest.param(row, case, id=f"{row}-{case}") for row, (_, cases) in ROWS.items() for case in cases],
)
def test_fault(row, case):
    check, _ = ROWS[row]
    check(case)
