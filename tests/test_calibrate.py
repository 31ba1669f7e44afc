"""`calibrate`: what logs can tell of each drive is found; what they cannot is refused by name."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

import trundle as tr
from trundle.calibrate import Calibration, Closed, Rolled, Run, Spun, calibrate
from trundle.errors import Inconsistent, InputError, NotConverged, TooFewData, Unobservable
from trundle.evaluate import compare
from trundle.geometry import se2
from trundle.simulate import (
    Course,
    Gyro,
    arc,
    figure_eight,
    glide,
    simulate,
    slide,
    spin,
    square,
    stop,
    straight,
)

NOISE = tr.Noise(wheel_distance=0.002, lateral_slip=0.002)
CAMERA = (0.002, 0.002, 0.005)  # errors [m, m, rad]
TURN = math.tau
SQUARE = [(0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15)]

# Description and truth by kind. Beyond this, what is true is what is described.
KINDS: dict[str, tuple[tr.Kinematics, tr.Kinematics]] = {
    "differential": (
        tr.Differential(track_width=0.20, wheel_radius=0.042),
        tr.Differential(track_width=0.206, wheel_radius={"left": 0.0413, "right": 0.0417}),
    ),
    "skid_steer": (
        tr.SkidSteer(track_width=0.30, wheelbase=0.3, wheel_radius=0.050),
        tr.SkidSteer(track_width=0.33, wheelbase=0.3, wheel_radius=0.051),
    ),
    "bicycle": (
        tr.Bicycle(wheelbase=0.32, wheel_radius=0.050),
        tr.Bicycle(wheelbase=0.33, wheel_radius=0.049),
    ),
    "ackermann": (
        tr.Ackermann(wheelbase=0.32, track_width=0.2, wheel_radius=0.050),
        tr.Ackermann(wheelbase=0.33, track_width=0.2, wheel_radius=0.049),
    ),
    "tricycle": (
        tr.Tricycle(wheelbase=0.150, wheel_radius=0.0325),
        tr.Tricycle(wheelbase=0.156, wheel_radius=0.0330),
    ),
    "four_wheel_steering": (
        tr.FourWheelSteering(wheelbase=0.4, track_width=0.3, wheel_radius=0.05),
        tr.FourWheelSteering(wheelbase=0.412, track_width=0.309, wheel_radius=0.0505),
    ),
    "mecanum": (
        tr.Mecanum(track_width=0.2, wheelbase=0.2, wheel_radius=0.030),
        tr.Mecanum(track_width=0.206, wheelbase=0.206, wheel_radius=0.0305),
    ),
    "omni": (
        tr.Omni(robot_radius=0.195, wheel_radius=0.051),
        tr.Omni(robot_radius=0.200, wheel_radius=0.0505),
    ),
    "swerve": (
        tr.Swerve(modules=SQUARE, wheel_radius=0.05),
        tr.Swerve(modules=[(1.03 * x, 1.03 * y) for x, y in SQUARE], wheel_radius=0.0505),
    ),
    "custom": (
        tr.Custom(
            wheels=[
                tr.Wheel("left", 0.0, 0.1, 0.04),
                tr.Wheel("right", 0.0, -0.1, 0.04),
                tr.Wheel("tail", -0.2, 0.0, 0.02, kind="caster"),
            ]
        ),
        tr.Custom(
            wheels=[
                tr.Wheel("left", 0.0, 0.103, 0.0405),
                tr.Wheel("right", 0.0, -0.103, 0.0405),
                tr.Wheel("tail", -0.206, 0.0, 0.02, kind="caster"),
            ]
        ),
    ),
}
STRAIGHT = (Course.of(straight(3.0, 0.4)), Course.of(straight(2.0, 0.3), straight(-1.0, 0.3)))
SPIN = (Course.of(spin(3 * TURN, 1.5)), Course.of(spin(-3 * TURN, 1.5)))
ARC = (Course.of(arc(0.7, 1.5 * math.pi, 0.4)),)
CRAB = (Course.of(slide(1.0, 1.0, 0.4), slide(-1.0, 0.5, 0.3), straight(1.0, 0.4)),)
CAR = (
    Course.of(figure_eight(0.8, 0.4), straight(1.5, 0.4)),
    Course.of(arc(1.2, -4.0, 0.5), arc(0.7, 3.0, 0.3)),
)
BOX = (Course.of(square(1.0, 0.4, yaw_rate=1.2), straight(1.0, 0.4), spin(-TURN, 1.2)),)
DANCE = (Course.of(square(0.8, 0.4), slide(0.5, 1.0, 0.4), spin(-TURN, 1.5), glide(1.5, 0.4, yaw_rate=0.8)),)


def driven(
    kind: str,
    courses: tuple[Course, ...],
    *,
    seed: int = 1,
    seen: Callable[[tr.WheelLog, np.random.Generator], object] | None = None,
    noise: tr.Noise = NOISE,
    gyro: Gyro | None = None,
    rate: float = 20.0,
) -> list[Run]:
    """Runs of the true robot under a camera; `seen` may say otherwise what is known of the truth."""
    robot = tr.Robot(drive=KINDS[kind][1], noise=noise)
    runs = []
    for k, course in enumerate(courses):
        log = simulate(robot, course, rate=rate, seed=(seed, k), gyro=gyro)
        known = (seen or camera)(log, np.random.default_rng((seed, k, 7)))
        runs.append(Run(dataclasses.replace(log, reference=None), known, name=f"run {k}"))
    return runs


def camera(log: tr.WheelLog, chance: np.random.Generator, *, mounted=(0.0, 0.0, 0.0), every: int = 2):
    """Poses of a marker, about."""
    truth = log.reference
    poses = se2.compose(truth.poses[::every], np.array(mounted))
    poses = poses + np.array(CAMERA) * chance.standard_normal(poses.shape)
    poses[:, 2] = se2.wrap(poses[:, 2])
    return tr.Trajectory(time_ns=truth.time_ns[::every], poses=poses)


def positions_only(log, chance):
    return without(camera(log, chance), 2)


def headings_only(log, chance):
    return without(camera(log, chance), [0, 1])


def without(trajectory: tr.Trajectory, columns) -> tr.Trajectory:
    poses = trajectory.poses.copy()
    poses[:, columns] = math.nan
    return dataclasses.replace(trajectory, poses=poses)


def measured_by_tape(log, _):
    """Straight on, or on the spot: its end."""
    first, last = log.reference.poses[0], log.reference.poses[-1]
    if abs(last[2] - first[2]) > 1.0:
        return Spun(float(round((last[2] - first[2]) / TURN) * TURN))
    return Rolled(float(math.hypot(*(last - first)[:2])))


def described(kind: str, **changes) -> tr.Robot:
    return tr.Robot(drive=KINDS[kind][0], noise=NOISE, **changes)


def found_of(found: Calibration) -> dict[str, tuple[float, float]]:
    return {one.name: (one.value, one.sigma) for one in found.estimates}


# ------------------------------------------------------------ 20 good logs, 20 degenerate ones


class Good(NamedTuple):
    """Runs that tell all that matters."""

    kind: str
    courses: tuple[Course, ...]
    truth: dict[str, float]
    seen: Callable[..., object] = camera


RADII = {"wheel_radius.left": 0.0413, "wheel_radius.right": 0.0417}
GOOD = {
    "differential, eights": Good("differential", CAR, {"track_width": 0.206, **RADII}),
    "differential, box": Good("differential", BOX, {"track_width": 0.206, **RADII}),
    "differential, lines and spins": Good("differential", STRAIGHT + SPIN, {"track_width": 0.206, **RADII}),
    "differential, positions": Good("differential", CAR, {"track_width": 0.206}, positions_only),
    "differential, box, positions": Good("differential", BOX, {"track_width": 0.206}, positions_only),
    "skid, box": Good("skid_steer", BOX, {"track_width": 0.33, "wheel_radius": 0.051}),
    "skid, eights": Good("skid_steer", CAR, {"track_width": 0.33, "wheel_radius": 0.051}),
    "skid, lines and spins": Good("skid_steer", STRAIGHT + SPIN, {"track_width": 0.33}),
    "bicycle": Good("bicycle", CAR, {"wheelbase": 0.33, "wheel_radius": 0.049}),
    "bicycle, positions": Good("bicycle", CAR, {"wheelbase": 0.33, "wheel_radius": 0.049}, positions_only),
    "ackermann": Good("ackermann", CAR, {"wheelbase": 0.33, "wheel_radius": 0.049}),
    "tricycle": Good("tricycle", CAR, {"wheelbase": 0.156, "wheel_radius": 0.0330}),
    "tricycle, positions": Good("tricycle", CAR, {"wheelbase": 0.156}, positions_only),
    "four wheel steering": Good("four_wheel_steering", CAR, {"wheel_radius": 0.0505}),
    "mecanum, box": Good("mecanum", BOX, {"lx + ly": 0.206, "wheel_radius": 0.0305}),
    "mecanum, dance": Good("mecanum", DANCE, {"lx + ly": 0.206, "wheel_radius": 0.0305}),
    "mecanum, positions": Good("mecanum", DANCE, {"lx + ly": 0.206}, positions_only),
    "omni, dance": Good("omni", DANCE, {"robot_radius": 0.200, "wheel_radius": 0.0505}),
    "swerve, dance": Good("swerve", DANCE, {"wheel_distance": 1.03 * 0.25, "wheel_radius": 0.0505}),
    "custom, box": Good("custom", BOX, {"wheel_distance": 0.103}),
}


def some_now(names, now):
    """All of them in `make verify`, some in every run."""
    return [pytest.param(name, marks=() if name in now else pytest.mark.verify) for name in names]


@pytest.mark.parametrize("name", some_now(GOOD, ("differential, box", "tricycle", "mecanum, dance")))
def test_good_logs_tell(name):
    """None is refused, and what is found is true."""
    good = GOOD[name]
    found = calibrate(described(good.kind), driven(good.kind, good.courses, seen=good.seen))
    numbers = found_of(found)
    for number, truth in good.truth.items():
        # Radii may have been told apart even where all are the same.
        found_as = [name for name in numbers if name == number or name.startswith(f"{number}.")]
        assert found_as, number
        for name in found_as:
            value, sigma = numbers[name]
            assert abs(value - truth) < 4.5 * sigma, name
            assert sigma < 0.01 * truth, name
    assert found.condition < 1e5
    assert found.inliers > 0.97 * found.samples
    # What is written down drives as well as what was estimated.
    log = driven(good.kind, good.courses, seed=2)[0]
    assert miss(found.robot, log) < miss(described(good.kind), log)


def miss(robot: tr.Robot, run: Run) -> float:
    """Error of position by odometry [m]."""
    return compare(tr.integrate(robot, run.log, covariance=False), run.reference).position.rmse


class Degenerate(NamedTuple):
    """Runs that leave something open."""

    kind: str
    courses: tuple[Course, ...]
    names: tuple[str, ...]  # what the refusal must name
    seen: Callable[..., object] = camera


DEGENERATE = {
    "differential, straight": Degenerate("differential", STRAIGHT, ("track_width",)),
    "differential, straight, positions": Degenerate(
        "differential", STRAIGHT, ("track_width",), positions_only
    ),
    "differential, spins": Degenerate("differential", SPIN, ("track_width", "wheel_radius")),
    "differential, one arc": Degenerate("differential", ARC, ("track_width", "wheel_radius")),
    "differential, one arc, positions": Degenerate(
        "differential", ARC, ("track_width", "wheel_radius"), positions_only
    ),
    "differential, headings alone": Degenerate(
        "differential", CAR, ("track_width", "wheel_radius"), headings_only
    ),
    "differential, still": Degenerate("differential", (Course.of(stop(8.0)),), ("wheels stand still",)),
    "differential, rolled": Degenerate("differential", STRAIGHT[:1], ("track_width",), measured_by_tape),
    "differential, spun": Degenerate("differential", SPIN, ("track_width",), measured_by_tape),
    "skid, straight": Degenerate("skid_steer", STRAIGHT, ("track_width",)),
    "skid, spins": Degenerate("skid_steer", SPIN, ("track_width", "wheel_radius")),
    "bicycle, straight": Degenerate("bicycle", STRAIGHT, ("wheelbase",)),
    "bicycle, one arc": Degenerate("bicycle", ARC, ("wheelbase",)),
    "ackermann, straight": Degenerate("ackermann", STRAIGHT, ("wheelbase",)),
    "tricycle, straight": Degenerate("tricycle", STRAIGHT, ("wheelbase",)),
    "four wheel steering, crab": Degenerate("four_wheel_steering", CRAB, ("wheel_distance",)),
    "mecanum, no turn": Degenerate("mecanum", CRAB, ("lx + ly",)),
    "mecanum, spins": Degenerate("mecanum", SPIN, ("lx + ly", "wheel_radius")),
    "omni, no turn": Degenerate("omni", CRAB, ("robot_radius",)),
    "swerve, no turn": Degenerate("swerve", CRAB, ("wheel_distance",)),
    "custom, straight": Degenerate("custom", STRAIGHT, ("wheel_distance",)),
}


@pytest.mark.parametrize(
    "name",
    some_now(
        DEGENERATE, ("differential, rolled", "differential, still", "bicycle, one arc", "swerve, no turn")
    ),
)
def test_degenerate_logs_are_refused_by_name(name):
    bad = DEGENERATE[name]
    with pytest.raises((Unobservable, TooFewData)) as refused:
        calibrate(described(bad.kind), driven(bad.kind, bad.courses, seen=bad.seen))
    for number in bad.names:
        assert number in str(refused.value)


def test_what_is_asked_for_by_name_is_refused_when_it_cannot_be_told():
    """The rest can be; but that is not what was asked."""
    runs = driven("bicycle", STRAIGHT)
    with pytest.raises(Unobservable, match="wheelbase"):
        calibrate(described("bicycle"), runs, parameters=("wheel_radius", "wheelbase"))
    found = calibrate(described("bicycle"), runs, parameters=("wheel_radius",), mounting=False)
    assert [one.name for one in found.estimates if one.name != "clock"] == ["wheel_radius"]
    with pytest.raises(InputError, match="did you mean 'wheelbase'"):
        calibrate(described("bicycle"), runs, parameters=("wheelbas",))


# ------------------------------------------------------------ references of all kinds


def test_tape_measure_is_a_reference():
    """Two metres straight on, and three turns each way."""
    runs = driven("differential", STRAIGHT[:1] + SPIN, seen=measured_by_tape)
    runs += driven("differential", (Course.of(straight(2.0, 0.3)),), seen=measured_by_tape, seed=4)
    found = calibrate(described("differential"), runs, parameters=("wheel_radius", "track_width"))
    radius, track = found_of(found)["wheel_radius"], found_of(found)["track_width"]
    assert abs(radius[0] - 0.0415) < 4 * radius[1] + 1e-5
    assert abs(track[0] - 0.206) < 4 * track[1]
    assert track[1] < 2e-3


def test_squares_driven_both_ways_tell_the_wheels_apart():
    """UMBmark: what remains after squares in both directions tells unequal wheels from a wrong track."""
    boxes = [Course.of(square(2.0, 0.4, yaw_rate=1.0, clockwise=way)) for way in (False, True)]
    runs = driven(
        "differential", tuple(boxes) * 2, seen=lambda *_: Closed(), noise=tr.Noise(wheel_distance=1e-4)
    )
    runs += driven("differential", (Course.of(straight(3.0, 0.4)),), seen=measured_by_tape)
    robot = described("differential").replace(noise=tr.Noise(wheel_distance=1e-4))
    numbers = found_of(calibrate(robot, runs))
    ratio = numbers["wheel_radius.right"][0] / numbers["wheel_radius.left"][0]
    assert ratio == pytest.approx(0.0417 / 0.0413, rel=2e-3)
    assert numbers["track_width"][0] == pytest.approx(0.206, rel=5e-3)


def test_mounting_is_found_where_it_is_not_described():
    def seen(log, chance):
        return camera(log, chance, mounted=(0.04, -0.02, 0.1))

    numbers = found_of(calibrate(described("omni"), driven("omni", DANCE, seen=seen)))
    for axis, truth in zip("x y theta".split(), (0.04, -0.02, 0.1), strict=True):
        value, sigma = numbers[f"reference.{axis}"]
        assert abs(value - truth) < 4 * sigma
        assert sigma < 3e-3


def test_gyro_is_calibrated_with_the_wheels():
    drive = tr.Differential(track_width=0.2, wheel_radius=0.042, measured=("left", "right", "gyro"))
    robot = tr.Robot(drive=drive, noise=NOISE)
    gyro = Gyro(bias=0.02, scale=1.03)
    runs = []
    for k, course in enumerate(BOX + CAR):
        log = simulate(robot, course, rate=20.0, seed=(5, k), gyro=gyro)
        runs.append(
            Run(dataclasses.replace(log, reference=None), camera(log, np.random.default_rng(k)), f"{k}")
        )
    numbers = found_of(calibrate(robot, runs))
    bias, scale = numbers["gyro.bias"], numbers["gyro.scale"]
    assert abs(bias[0] + 0.02 / 1.03) < 4 * bias[1] + 1e-5
    assert abs(scale[0] - 1 / 1.03) < 4 * scale[1] + 1e-5


# ------------------------------------------------------------ B1 to B8


def fault_b1():
    for name in ("differential, straight", "differential, spins", "differential, one arc"):
        test_degenerate_logs_are_refused_by_name(name)
    # What the description believes of itself may be said to count.
    believing = described("differential").replace(
        noise=tr.Noise(wheel_distance=0.002, wheel_radius=0.01, track_width=0.02)
    )
    found = calibrate(believing, driven("differential", STRAIGHT), prior=True)
    value, sigma = found_of(found)["track_width"]
    assert value == pytest.approx(0.2, rel=0.02)
    assert sigma == pytest.approx(0.02 * 0.2, rel=0.1)


def fault_b2():
    """Loops that close say little of the scale."""

    boxes = tuple(Course.of(square(1.0, 0.4, yaw_rate=1.0, clockwise=way)) for way in (False, True))
    believing = described("differential").replace(
        noise=tr.Noise(wheel_distance=0.002, wheel_radius=0.02, track_width=0.02)
    )
    found = calibrate(believing, driven("differential", boxes, seen=lambda *_: Closed()), prior=True)
    sigma = found_of(found)["wheel_radius.left"][1]
    assert 0.005 < sigma / 0.042 < 0.03
    assert "straight" in advice(found)


def advice(found: Calibration) -> str:
    parts = [*found.warnings, *(f"{one.words} {one.manoeuvre}" for one in found.unobserved)]
    return " | ".join(parts)


def wrong(share: float):
    """A camera that is somewhere else for a share of its samples."""

    def seen(log, chance):
        known = camera(log, chance)
        poses = known.poses.copy()
        rows = chance.random(len(poses)) < share
        poses[rows] += chance.uniform(-1.0, 1.0, (int(rows.sum()), 3))
        return dataclasses.replace(known, poses=poses)

    return seen


def fault_b3():
    for share in (0.05, 0.2, 0.4):
        found = calibrate(described("differential"), driven("differential", CAR, seen=wrong(share)))
        assert found.inliers / found.samples == pytest.approx(1.0 - share, abs=0.07)
        value, sigma = found_of(found)["track_width"]
        assert abs(value - 0.206) < 4 * sigma
    for share, word in ((0.55, "half"), (0.65, "half"), (0.9, "scatters")):
        with pytest.raises(Inconsistent, match=word):
            calibrate(described("differential"), driven("differential", CAR, seen=wrong(share)))


def fault_b4():
    for delay in (0.01, 0.05, 0.2, -0.1):

        def late(log, chance, delay=delay):
            known = camera(log, chance)
            return dataclasses.replace(known, time_ns=known.time_ns + round(delay * 1e9))

        value, sigma = found_of(calibrate(described("differential"), driven("differential", CAR, seen=late)))[
            "clock"
        ]
        assert abs(value - delay) < 4 * sigma
        assert sigma < 0.004


def fault_b5():
    def jumped(log, chance):
        known = camera(log, chance)
        poses, half = known.poses.copy(), len(known) // 2
        poses[half:] = se2.compose(np.array([2.0, -1.0, 0.7]), poses[half:])
        poses[half - 10 : half] = math.nan  # tracking was lost for a while
        return dataclasses.replace(known, poses=poses)

    found = calibrate(described("differential"), driven("differential", CAR, seen=jumped))
    value, sigma = found_of(found)["track_width"]
    assert abs(value - 0.206) < 4 * sigma
    assert sigma < 0.002
    assert re.search("jump", advice(found))

    def mirrored(log, chance):
        known = camera(log, chance)
        return dataclasses.replace(known, poses=known.poses * (1.0, -1.0, -1.0))

    with pytest.raises(Inconsistent, match="hand"):
        calibrate(described("differential"), driven("differential", CAR, seen=mirrored))


def fault_b6():
    def few(log, chance):
        known = camera(log, chance)
        return dataclasses.replace(known, time_ns=known.time_ns[:2], poses=known.poses[:2])

    with pytest.raises(TooFewData, match="2"):
        calibrate(described("differential"), driven("differential", CAR, seen=few))
    with pytest.raises(TooFewData):
        calibrate(described("differential"), [])
    error = NotConverged(80, ["track_width"])
    assert error.iterations == 80
    assert "80" in str(error)
    assert "track_width" in str(error)


def fault_b7():
    far = tr.Robot(drive=tr.Differential(track_width=0.27, wheel_radius=0.042), noise=NOISE)
    found = calibrate(far, driven("differential", CAR))
    doubts = {one.name: one.doubt for one in found.estimates}
    assert "-23 % from its description" in doubts["track_width"]
    assert doubts["wheel_radius.left"] == ""
    backwards = [
        Run(dataclasses.replace(run.log, wheels=-run.log.wheels), run.reference, run.name)
        for run in driven("differential", CAR)
    ]
    with pytest.raises(Inconsistent, match="mirror image"):  # never a negative radius
        calibrate(described("differential"), backwards)


def fault_b8():
    """Wheels that slip four times as much as their description promises."""
    rough = tr.Noise(wheel_distance=0.008, lateral_slip=0.008)
    found = calibrate(described("differential"), driven("differential", CAR, noise=rough))
    calm = calibrate(described("differential"), driven("differential", CAR))
    assert found.chi2_per_dof > 1.5
    assert 0.7 < calm.chi2_per_dof < 1.3
    sigma, promised = (found_of(one)["track_width"][1] for one in (found, calm))
    assert sigma > 2.0 * promised


@pytest.mark.parametrize("row", [pytest.param(f"B{k}", id=f"B{k}") for k in range(1, 9)])
def test_fault(row):
    globals()[f"fault_{row.lower()}"]()
