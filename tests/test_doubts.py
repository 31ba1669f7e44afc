"""What is doubtful about readable wheel columns, and the line of robot.yaml that each sentence names."""

from __future__ import annotations

import numpy as np
import pytest

from trundle.adapters.conversion import wheel_conversions
from trundle.adapters.doubts import WheelColumn, doubts
from trundle.robot import Differential, Encoder, Limits, Robot
from trundle.robot.log_mapping import Kind, Unit, WheelMapping

RADIUS, TICKS = 0.042, 2796.8
SECONDS = 0.02 * np.arange(3000)
ROLLED = 0.4 * SECONDS + 0.1 * np.sin(SECONDS)  # m: 0.3 to 0.5 m/s
METRE = {"rad": 1 / RADIUS, "ticks": TICKS / (2 * np.pi * RADIUS), "rev": 1 / (2 * np.pi * RADIUS), "m": 1.0}


def said(values, *, unit=None, bits=None, kind=None, ticks=TICKS, seconds=SECONDS, column="left", **limits):
    """What there is to say about two columns with these raw numbers."""
    encoder = Encoder(ticks_per_revolution=ticks, bits=bits)
    robot = Robot(
        drive=Differential(track_width=0.2, wheel_radius=RADIUS),
        encoders={"left": encoder, "right": encoder},
        limits=Limits(**limits),
    )
    mapping = WheelMapping(column=column, unit=None if unit is None else Unit(unit), kind=kind)
    reading, conversions = wheel_conversions(robot, {"left": mapping, "right": mapping})
    time_ns = np.rint(np.asarray(seconds) * 1e9).astype(np.int64)
    columns = [
        WheelColumn(name, mapping, reading, one, time_ns, one.of(np.asarray(values)))
        for name, one in conversions.items()
    ]
    return doubts(robot, columns)


@pytest.mark.parametrize(
    ("unit", "values"),
    [
        ("rad", ROLLED * METRE["rad"]),
        ("ticks", np.rint(ROLLED * METRE["ticks"])),
        ("m", ROLLED),
        ("rad/s", np.gradient(ROLLED, SECONDS) / RADIUS),
        ("m/s", np.gradient(ROLLED, SECONDS)),
    ],
)
def test_nothing_is_said_of_what_is_right(unit, values):
    assert said(values, unit=unit) == ()
    assert said(values, unit=unit, max_wheel_speed=10.0) == ()


@pytest.mark.parametrize(
    ("column", "kind", "words"),
    [
        ("left", None, "no unit for left, right, taken as rad (position); write unit: rad, or what it is"),
        ("left_rpm", None, "or unit: rpm, as its name says"),
        ("rate", Kind.VELOCITY, "taken as rad/s (velocity); write unit: rad/s"),
        ("left.m", Kind.INCREMENT, "taken as rad (increment)"),
    ],
)
def test_what_was_assumed_is_said(column, kind, words):
    (sentence,) = said(0.001 * np.sin(SECONDS), column=column, kind=kind)
    assert words in sentence


@pytest.mark.parametrize(
    ("written", "unit", "hint"),
    [
        ("ticks", None, "unit: ticks would make it 0.4 m/s"),
        ("ticks", "rad", "unit: ticks would make it 0.4 m/s"),
        ("ticks", "m", "unit: ticks would make it 0.4 m/s"),
    ],
)
def test_wheels_that_no_robot_has_are_in_another_unit(written, unit, hint):
    *_, sentence = said(np.rint(ROLLED * METRE[written]), unit=unit)
    assert sentence.startswith("log.wheels.left: as ")
    assert "faster than any robot, 15 m/s" in sentence
    assert hint in sentence


def test_limits_are_believed_where_they_are_given():
    degrees = np.degrees(ROLLED * METRE["rad"])
    assert said(degrees, unit="rev") != ()
    (sentence,) = said(degrees / 12.0, unit="rad", max_wheel_speed=20.0)
    assert "faster than limits.max_wheel_speed, 0.84 m/s" in sentence


def test_too_fast_a_clock_is_asked_about():
    (sentence,) = said(np.rint(ROLLED * METRE["ticks"]), unit="ticks", seconds=SECONDS / 1000.0)
    assert "is log.time.unit right? Its rows are 2e-05 s apart" in sentence


@pytest.mark.parametrize("bits", [8, 16, 24])
@pytest.mark.parametrize("signed", [False, True], ids=["unsigned", "signed"])
@pytest.mark.parametrize("declared", [None, 32])
def test_widths_that_nobody_declared(bits, signed, declared):
    counts = np.rint(np.linspace(0.0, 3.3 * 2**bits, 400)).astype(np.int64) % 2**bits
    if signed:
        counts = (counts + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1)
    (sentence,) = said(counts, unit="ticks", bits=declared, ticks=2.0**bits, seconds=0.1 * np.arange(400))
    before = "none" if declared is None else declared
    assert sentence.startswith(f"encoders.left.bits: {before}, but it jumps by about {2**bits} ticks 3 times")
    assert sentence.endswith(f"write bits: {bits}")
    assert said(counts, unit="ticks", bits=bits, ticks=2.0**bits, seconds=0.1 * np.arange(400)) == ()


def test_a_counter_that_begins_anew_does_not_wrap():
    counts = np.concatenate([np.arange(0, 50000, 20), np.arange(0, 10000, 20)])
    assert said(counts, unit="ticks", seconds=0.02 * np.arange(len(counts)), ticks=20000.0) == ()


def test_running_totals_that_are_called_speeds():
    (sentence,) = said(ROLLED * METRE["rev"], unit="rpm")
    assert "log.wheels.left.unit: rpm is a speed" in sentence
    assert "running total" in sentence
    braking = np.minimum(SECONDS, 60.0 - SECONDS)
    assert said(braking, unit="rpm") == ()


@pytest.mark.parametrize("values", [[], [1.0], [1.0, 2.0], [np.nan] * 5, [0.0] * 5, [np.inf, 1.0, 2.0, 3.0]])
def test_nothing_is_said_of_nothing(values):
    assert said(values, unit="rad", seconds=0.1 * np.arange(len(values))) == ()
