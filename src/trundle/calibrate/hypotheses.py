"""Every single fault that the doctor knows: what the log would say without it, and what cures it."""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
import numpy.typing as npt

from trundle.calibrate import mending
from trundle.calibrate.misfit import Account
from trundle.errors import ConfigError
from trundle.records import Reading
from trundle.robot import Custom, Kinematics, LogMapping, Robot, Wheel
from trundle.robot.log_mapping import Unit

__all__ = ["Cause", "Fault", "Hypothesis", "Patient", "hypotheses", "is_counted", "mirrored"]

Mask = npt.NDArray[np.bool_]


class Fault(enum.Enum):
    """Kinds of faults."""

    SWAPPED = "swapped"
    REVERSED = "reversed"
    FROZEN = "frozen"
    ROLLERS = "rollers"
    UNIT = "unit"
    RADIUS = "radius"
    TICKS = "ticks"
    LENGTH = "length"
    GYRO = "gyro"
    MIRRORED = "mirrored"
    WRAPS = "wraps"


@dataclass(frozen=True, slots=True)
class Cause:
    """What may be wrong.

    Attributes:
        fault: Its kind.
        subject: Wheels, parameters, or "gyro", "reference" and "steering".
        words: A sentence for people.
        mended: The description with it put right; None where no description can.
        common: Whether it is a mistake that people often make (a half, degrees, ...), not just any factor.
    """

    fault: Fault
    subject: tuple[str, ...]
    words: str
    mended: Robot | None
    common: bool = True


def is_counted(name: str, reading: Reading, spoken: LogMapping) -> bool:
    """Whether a wheel is read by counting ticks.

    Args:
        name: Of the wheel.
        reading: What the log's wheel columns say.
        spoken: How the log's own numbers are written.
    """
    unit = spoken.wheels[name].unit if name in spoken.wheels else None
    return reading is Reading.TICKS or (unit is not None and unit.dimension.startswith("ticks"))


@dataclass(frozen=True, slots=True, eq=False)
class Patient:
    """A robot as described, and how its log was written.

    Attributes:
        robot: Description.
        spoken: Where the log's columns stand, defaults included.
        reading: What its wheels say.
        separate_steering: Whether each steered wheel has an angle of its own in the log.
        gyro: Whether there is a gyro.
        reference: Whether there is a reference.
        scaled: Whether anybody says how much the robot moved: without, one factor of all wheels is none.
        still: Measured wheels that stand still in some windows.
        held: Steered wheels whose angle never changes.
    """

    robot: Robot
    spoken: LogMapping
    reading: Reading
    separate_steering: bool
    gyro: bool
    reference: bool
    scaled: bool
    still: Mapping[str, Mask]
    held: tuple[str, ...]

    @property
    def drive(self) -> Kinematics:
        """Whose wheels are measured."""
        return self.robot.measuring

    def counted(self, name: str) -> bool:
        """Whether a wheel is read by counting ticks."""
        return is_counted(name, self.reading, self.spoken)

    def unit(self, name: str) -> Unit:
        """What a wheel's column is written in."""
        entry = self.spoken.wheels.get(name)
        if entry is not None and entry.unit is not None:
            return entry.unit
        return Unit.RAD_S if self.reading is Reading.VELOCITY else Unit.RAD


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One fault that may be.

    Attributes:
        account: What the wheels would have said without it; takes a factor where there is a free one.
        causes: What it may come from, the likeliest first; takes the factor.
        free: Whether a factor has to be found.
        least: Smallest factor that can be.
        most: Greatest one.
        wheels: Those whose readings show it.
        stands: Whether it is that a wheel stands still.
    """

    account: Callable[[Account, float], Account]
    causes: Callable[[float], list[Cause]]
    free: bool = False
    least: float = 0.0
    most: float = math.inf
    wheels: tuple[str, ...] = ()
    stands: bool = False


def hypotheses(patient: Patient) -> Iterator[Hypothesis]:
    """All single faults of a robot."""
    yield from _swaps(patient)
    yield from _reversals(patient)
    yield from _frozen(patient)
    yield from _rollers(patient)
    yield from _turn_factors(patient)
    yield from _lengths(patient)
    yield from _steering_factors(patient)
    yield from _gyro_faults(patient)
    yield from _mirrored_reference(patient)


# --- swapped --------------------------------------------------------------------------------------


def _swaps(patient: Patient) -> Iterator[Hypothesis]:
    drive = patient.drive
    both = [name for name in drive.measured_names if name in drive.steered_names]
    for one, other in itertools.combinations(drive.measured_names, 2):
        yield _swap(patient, [(one, other)], f"{one} and {other}", turned=True)
        if one in both and other in both and patient.separate_steering:
            yield _swap(patient, [(one, other)], f"{one} and {other}", turned=True, steering=True)
    if patient.separate_steering:
        for one, other in itertools.combinations(drive.steered_names, 2):
            yield _swap(patient, [(one, other)], f"{one} and {other}", steering=True)
    if len(drive.measured_names) >= 4:
        for mirror, words in (((1, -1), "left and right sides"), ((-1, 1), "front and rear wheels")):
            pairs = _pairs(drive, mirror)
            if pairs:
                steering = bool(both) and patient.separate_steering
                yield _swap(patient, pairs, f"the {words}", turned=True, steering=steering)


def _pairs(drive: Kinematics, mirror: tuple[int, int]) -> list[tuple[str, str]]:
    """Measured wheels and their mirror images; none unless every wheel has another one for its image."""
    wheels = [drive.wheel(name) for name in drive.measured_names]
    middle = [sum(getattr(wheel, axis) for wheel in wheels) / len(wheels) for axis in ("x", "y")]
    image = {}
    for wheel in wheels:
        place = [
            centre + sign * (at - centre)
            for centre, sign, at in zip(middle, mirror, (wheel.x, wheel.y), strict=True)
        ]
        near = [o.name for o in wheels if math.hypot(o.x - place[0], o.y - place[1]) < 1e-6]
        if not near or near[0] == wheel.name:
            return []
        image[wheel.name] = near[0]
    return [(a, b) for a, b in image.items() if drive.measured_names.index(a) < drive.measured_names.index(b)]


def _swap(
    patient: Patient, pairs: list[tuple[str, str]], who: str, *, turned: bool = False, steering: bool = False
) -> Hypothesis:
    what = {(True, False): "encoders", (False, True): "steering angles", (True, True): "modules"}
    noun = what[turned, steering] if patient.drive.steered_names else "encoders"
    names = tuple(name for pair in pairs for name in pair)
    subject = (*names, *(("steering",) if steering and not turned else ()))

    def causes(_factor: float) -> list[Cause]:
        mended = mending.with_exchanged(
            patient.robot, patient.spoken, pairs, turned=turned, steering=steering
        )
        words = f"the {noun} of {who} are swapped: exchange the plugs, or the names"
        return [Cause(Fault.SWAPPED, subject, words, mended)]

    def account(said: Account, _factor: float) -> Account:
        return said.exchanged(pairs, turned=turned, steering=steering)

    return Hypothesis(account, causes, wheels=names if turned else ())


# --- reversed -------------------------------------------------------------------------------------


def _reversals(patient: Patient) -> Iterator[Hypothesis]:
    drive = patient.drive
    measured = drive.measured_names
    for name in measured:
        yield _reversal(patient, (name,), f"{name} is reversed: it counts down when it rolls forward")
    if len(measured) >= 4:
        for sign, side in ((1, "left"), (-1, "right")):
            names = tuple(name for name in measured if sign * drive.wheel(name).y > 0.0)
            if len(names) > 1:
                yield _reversal(patient, names, f"the {side} wheels are reversed: they count down forward")
    if len(measured) > 1:
        words = "all wheels are reversed: they count down when the robot drives forward"
        yield _reversal(patient, measured, words)
    steered = drive.steered_names
    groups = [(name,) for name in steered] if patient.separate_steering and len(steered) > 1 else []
    for names in [*groups, steered] if steered else []:
        yield _steering_reversal(patient, names)


def _reversal(patient: Patient, names: tuple[str, ...], words: str) -> Hypothesis:
    def causes(_factor: float) -> list[Cause]:
        counted = patient.counted(names[0])
        mended = mending.with_inverted(patient.robot, patient.spoken, names, counted=counted)
        return [Cause(Fault.REVERSED, names, words, mended)]

    return Hypothesis(lambda said, _factor: said.scaled(names, -1.0), causes, wheels=names)


def _steering_reversal(patient: Patient, names: tuple[str, ...]) -> Hypothesis:
    whose = "" if names == patient.drive.steered_names else f" of {', '.join(names)}"

    def causes(_factor: float) -> list[Cause]:
        mended = mending.with_steering_turned(patient.robot, patient.spoken, names)
        words = f"the steering angle{whose} is reversed: it is positive to the right"
        return [Cause(Fault.REVERSED, ("steering", *names), words, mended)]

    return Hypothesis(lambda said, _factor: said.steered_by(names, -1.0), causes)


# --- frozen ---------------------------------------------------------------------------------------


def _frozen(patient: Patient) -> Iterator[Hypothesis]:
    for name, still in patient.still.items():
        yield _standing(patient, name, still)
    for name in patient.held:
        yield _held(name)


def _standing(patient: Patient, name: str, still: Mask) -> Hypothesis:
    def causes(_factor: float) -> list[Cause]:
        words = f"the encoder of {name} is frozen: look at its cable; until then, measure without it"
        return [Cause(Fault.FROZEN, (name,), words, mending.without_wheels(patient.robot, (name,)))]

    def account(said: Account, _factor: float) -> Account:
        return replace(said, deaf={name: still})

    return Hypothesis(account, causes, wheels=(name,), stands=True)


def _held(name: str) -> Hypothesis:
    def causes(_factor: float) -> list[Cause]:
        words = f"the steering angle of {name} is frozen: look at its sensor and cable"
        return [Cause(Fault.FROZEN, ("steering", name), words, None)]

    return Hypothesis(lambda said, _factor: replace(said, unled=(name,)), causes)


# --- rollers --------------------------------------------------------------------------------------


def mirrored(wheel: Wheel) -> Wheel:
    """The wheel with its rollers slanted the other way."""
    assert wheel.free_direction is not None
    return msgspec.structs.replace(wheel, free_direction=2.0 * wheel.heading - wheel.free_direction)


def _slanted(wheel: Wheel) -> bool:
    """Rollers square to the wheel look the same from both sides."""
    free = wheel.free_direction
    return free is not None and abs(math.cos(free - wheel.heading)) > 1e-3


def _rollers(patient: Patient) -> Iterator[Hypothesis]:
    drive = patient.drive
    slanted = tuple(name for name in drive.measured_names if _slanted(drive.wheel(name)))
    groups = [slanted, *((name,) for name in slanted)] if len(slanted) > 1 else [slanted]
    for names in groups if slanted else []:
        yield _mirrored_rollers(patient, names)


def _mirrored_rollers(patient: Patient, names: tuple[str, ...]) -> Hypothesis:
    if len(names) > 1:
        form = (
            "an O, not an X" if patient.drive.type_name == "mecanum" else "the mirror image of what is said"
        )
        words = f"seen from above, the rollers form {form}: exchange the left and right wheels, or say so"
    else:
        words = f"the rollers of {names[0]} slant the other way: it is a wheel for the other side"

    def account(said: Account, _factor: float) -> Account:
        wheels = {name: mirrored(one) if name in names else one for name, one in said.wheels.items()}
        return replace(said, wheels=wheels)

    def causes(_factor: float) -> list[Cause]:
        return [Cause(Fault.ROLLERS, names, words, _with_rollers(patient.robot, names))]

    return Hypothesis(account, causes, wheels=names)


def _with_rollers(robot: Robot, names: tuple[str, ...]) -> Robot | None:
    """A custom drive; None where with such rollers the wheels could not see all motions."""
    drive = robot.measuring
    measured = (*drive.measured_names, *(("gyro",) if drive.gyro else ()))
    wheels = [mirrored(wheel) if wheel.name in names else wheel for wheel in drive.wheels]
    try:
        custom = Custom(wheels=wheels, measured=None if measured == drive.wheel_names else measured)
    except ConfigError:
        return None
    return robot.replace(drive=custom) if robot.localizer is None else robot.replace(localizer=custom)


# --- factors --------------------------------------------------------------------------------------

_SLACK = 0.08
"""How near a factor must come to one that people often get wrong."""


def _near(factor: float, wanted: float) -> bool:
    return abs(math.log(factor / wanted)) < _SLACK


def _number(factor: float) -> str:
    return f"{factor:.3g}"


def _unit_causes(
    fault: Fault,
    subject: tuple[str, ...],
    whose: str,
    declared: Unit,
    factor: float,
    mend: Callable[[Unit], Robot | None],
) -> list[Cause]:
    """Units in which the log may be written where it is declared to be written in another."""
    causes = []
    for unit in Unit:
        other = unit.dimension == declared.dimension and unit is not declared
        if other and _near(factor, unit.factor / declared.factor):
            words = f"{whose} in {unit.value}, and robot.yaml takes it for {declared.value}"
            causes.append(Cause(fault, subject, words, mend(unit)))
    return causes


def _turn_factors(patient: Patient) -> Iterator[Hypothesis]:
    names = patient.drive.measured_names
    for name in names:
        yield _turn_factor(patient, (name,))
    if len(names) > 1 and patient.scaled:
        yield _turn_factor(patient, names)


def _turn_factor(patient: Patient, names: tuple[str, ...]) -> Hypothesis:
    def causes(factor: float) -> list[Cause]:
        counted = patient.counted(names[0])
        found = _tick_causes(patient, names, factor) if counted else _reading_causes(patient, names, factor)
        radius = _radius_causes(patient, names, factor)
        # One radius for all wheels cannot be wrong for one of them, and each encoder has its own count.
        return [*radius, *found] if len(names) == len(patient.drive.measured_names) else [*found, *radius]

    return Hypothesis(lambda said, factor: said.scaled(names, factor), causes, free=True, wheels=names)


def _whose(patient: Patient, names: tuple[str, ...]) -> str:
    return "every wheel" if len(names) == len(patient.drive.measured_names) > 1 else ", ".join(names)


def _tick_causes(patient: Patient, names: tuple[str, ...], factor: float) -> list[Cause]:
    exact = _rounded(1.0 / factor, (0.25, 0.5, 2.0, 4.0))
    whose = _whose(patient, names)
    words = f"the ticks per turn of {whose} are wrong: really {_number(exact)} times as many"
    return [Cause(Fault.TICKS, names, words, mending.with_ticks_scaled(patient.robot, names, exact))]


def _reading_causes(patient: Patient, names: tuple[str, ...], factor: float) -> list[Cause]:
    def mend(unit: Unit) -> Robot | None:
        return mending.with_unit(patient.robot, patient.spoken, names, unit)

    whose = f"the log has {_whose(patient, names)}"
    return _unit_causes(Fault.UNIT, names, whose, patient.unit(names[0]), factor, mend)


def _radius_causes(patient: Patient, names: tuple[str, ...], factor: float) -> list[Cause]:
    if patient.unit(names[0]).dimension.startswith("length") and not patient.counted(names[0]):
        return []  # a wheel that is read in metres rolls them whatever its radius
    common = {0.5: "holds the diameter", 2.0: "holds half the radius"}
    words = next((word for ratio, word in common.items() if _near(factor, ratio)), "")
    exact = _rounded(factor, tuple(common))
    said = words or f"is wrong: really {_number(factor)} times as large"
    whose = "wheel_radius" if len(names) > 1 else f"the wheel_radius of {names[0]}"
    mended = mending.with_radius_scaled(patient.robot, names, exact)
    return [Cause(Fault.RADIUS, names, f"{whose} {said}", mended, bool(words))]


def _rounded(factor: float, ratios: Sequence[float]) -> float:
    """The ratio that is meant, or the factor to three digits."""
    meant = [ratio for ratio in ratios if _near(factor, ratio)]
    return meant[0] if meant else float(f"{factor:.3g}")


# --- lengths --------------------------------------------------------------------------------------


def _lengths(patient: Patient) -> Iterator[Hypothesis]:
    drive = patient.drive
    if type(drive) is Kinematics:
        return  # the rest of a drive has no parameters
    for names in mending.LENGTHS.get(drive.type_name, ()):
        if all(drive.parameters[name] is not None for name in names):
            yield _length(patient, names)


_NOUNS = {
    "modules": "the places of the modules",
    "wheels": "the places of the wheels",
    "robot_radius": "robot_radius",
}


def _length(patient: Patient, names: tuple[str, ...]) -> Hypothesis:
    noun = " and ".join(_NOUNS.get(name, name) for name in names)
    together = names == ("track_width", "wheelbase")

    def causes(factor: float) -> list[Cause]:
        common = any(_near(factor, ratio) for ratio in (0.5, 2.0))
        if _near(factor, 2.0):
            words = f"{noun}: half of the full length is given"
            words += " (lx + ly is half of track_width + wheelbase)" if together else ""
        elif _near(factor, 0.5):
            words = f"{noun}: twice the full length is given"
            words = f"{noun} holds the diameter" if names == ("robot_radius",) else words
        else:
            words = f"{noun}: really {_number(factor)} times as long"
        mended = mending.with_layout(patient.robot, names, _rounded(factor, (0.5, 2.0)))
        return [Cause(Fault.LENGTH, names, words, mended, common)]

    def account(said: Account, factor: float) -> Account:
        return said.on(mending.with_layout(patient.robot, names, factor).measuring)

    return Hypothesis(account, causes, free=True, least=0.2, most=5.0)


# --- steering and gyro ----------------------------------------------------------------------------


def _steering_factors(patient: Patient) -> Iterator[Hypothesis]:
    names = patient.drive.steered_names
    if not names:
        return
    entry = next(iter(patient.spoken.steering.values()), None)
    declared = Unit.RAD if entry is None or entry.unit is None else entry.unit

    def causes(factor: float) -> list[Cause]:
        def mend(unit: Unit) -> Robot | None:
            return mending.with_steering_scaled(patient.robot, patient.spoken, unit)

        subject = ("steering",)
        found = _unit_causes(Fault.UNIT, subject, "the log has steering angles", declared, factor, mend)
        words = f"steering angles are wrong: really {_number(factor)} times as large"
        return found or [Cause(Fault.UNIT, subject, words, None, common=False)]

    yield Hypothesis(lambda said, factor: said.steered_by(names, factor), causes, free=True)


def _gyro_faults(patient: Patient) -> Iterator[Hypothesis]:
    if not patient.gyro:
        return
    entry = patient.spoken.gyro
    declared = Unit.RAD_S if entry is None or entry.unit is None else entry.unit

    def reversal(_factor: float) -> list[Cause]:
        words = "the gyro is reversed (upside down?): it is positive clockwise"
        mended = mending.with_gyro_turned(patient.robot, patient.spoken)
        return [Cause(Fault.GYRO, ("gyro",), words, mended)]

    def scale(factor: float) -> list[Cause]:
        def mend(unit: Unit) -> Robot | None:
            return mending.with_gyro_scaled(patient.robot, patient.spoken, unit)

        found = _unit_causes(Fault.UNIT, ("gyro",), "the log has the gyro", declared, factor, mend)
        words = f"the gyro is wrong: it should show {_number(factor)} times as much"
        return found or [Cause(Fault.GYRO, ("gyro",), words, None, common=False)]

    yield Hypothesis(lambda said, _factor: replace(said, gyro=-1.0), reversal)
    yield Hypothesis(lambda said, factor: replace(said, gyro=factor), scale, free=True)


def _mirrored_reference(patient: Patient) -> Iterator[Hypothesis]:
    if not patient.reference:
        return
    words = "the reference is mirrored: swap its x and y, or the sign of one of them and of its headings"
    cause = Cause(Fault.MIRRORED, ("reference",), words, None)
    yield Hypothesis(lambda said, _factor: replace(said, mirrored=True), lambda _factor: [cause])
