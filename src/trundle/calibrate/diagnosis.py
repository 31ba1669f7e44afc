"""What is wrong with a robot's wiring, signs and units: the one fault that explains its log."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from trundle.calibrate.counter_wraps import Wrap, find_wrap, unwrapped
from trundle.calibrate.hypotheses import Cause, Fault, Hypothesis, Patient, hypotheses, is_counted
from trundle.calibrate.mending import with_bits
from trundle.calibrate.misfit import Account, Bench, Fit
from trundle.calibrate.wheel_steps import WheelSteps, wheel_steps
from trundle.calibrate.witness import Drove, Label, windows_of, witnesses_of
from trundle.errors import TrundleError
from trundle.records import Reading, WheelLog
from trundle.robot import LogMapping, Robot

__all__ = ["Diagnosis", "Finding", "diagnose"]

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

QUIET = 0.35
"""Up to this score nothing is looked for: simulated robots without faults stay below 0.3."""
SOUND = 0.6
"""Up to this one a robot may be sound, if no fault explains it all but completely."""
LOST = 3.0
"""Above this it is not, even where no single fault explains it: rough floors and rulers reach 2."""
CURED = 0.3
"""A fault explains a log if without it the score is at most this share of what it was, or sound and"""
BETTER = 0.5
"""at most this share."""
MARGIN = 0.3
"""Rivals whose score is within this (and half) of the best one's explain the log as well."""
FEWEST = 4
"""Windows with motion, below which nothing is said."""
QUICK = 60
"""Windows on which free factors are sought first."""
COMMON = (0.25, 0.5, 2.0, 4.0, math.tau, math.pi / 180.0, math.pi / 30.0, 1e-3, 60.0, 0.3048)
FACTORS = np.unique([*np.geomspace(0.001, 1000.0, 19), *COMMON, *(1.0 / factor for factor in COMMON)])
"""Where free factors are sought first; units and slips of the pen are among them."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True, slots=True)
class Finding:
    """One fault, or several that this log cannot tell apart.

    Attributes:
        causes: What it may come from, the likeliest first.
        evidence: Sentences.
        advice: What to drive to tell several apart; empty where there is nothing to tell apart.
    """

    causes: tuple[Cause, ...]
    evidence: tuple[str, ...]
    advice: str = ""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a log says about a robot's description.

    Attributes:
        findings: Faults; none where all is well.
        witnesses: Who was heard beside the wheels.
        windows: How many spans of the log had motion.
        score: How badly wheels and witnesses contradict each other: up to 1 is a sound robot. NaN where
            nothing could contradict the wheels.
        unexplained: Whether they do, and no single fault explains it.
        hidden: Faults that this log would not have shown.
    """

    findings: tuple[Finding, ...]
    witnesses: tuple[str, ...]
    windows: int
    score: float
    unexplained: bool = False
    hidden: tuple[Cause, ...] = ()

    @property
    def judged(self) -> bool:
        """Whether the wheels were compared with anything."""
        return not math.isnan(self.score)


def diagnose(
    robot: Robot, log: WheelLog, *, label: Label | None = None, spoken: LogMapping | None = None
) -> Diagnosis:
    """Look for the single fault of wiring, sign, unit or length that explains a log.

    Args:
        robot: As described, perhaps wrongly.
        log: A short drive of it, best one that goes straight and turns both ways.
        label: What the person who drove it says.
        spoken: How the log says it, default columns included; None means the robot's own mapping.

    Raises:
        InputError: If the log has no wheels, or the label cannot be of this drive.
    """
    if label is not None:
        label.check(robot.measuring)
    spoken = spoken or robot.log
    steps, wrapping = _without_wraps(robot, log, spoken, wheel_steps(robot, log))
    windows = windows_of(steps, log.reference)
    witnesses = witnesses_of(robot.measuring, log, steps, windows)
    names = (*(one.name for one in witnesses), *((f"drove {label.drove.value}",) if label else ()))
    bench = Bench(robot, windows, witnesses, label, windows.share)
    account = Account.of(robot.measuring, steps)
    moving = bench.moving(account)
    count = int(moving.sum())
    if label is not None and not account.turned.any():
        wrapping.append(_nothing_moved(account.measured, label))
    if count < FEWEST or bench.freedom(account) < 1:
        return Diagnosis(tuple(wrapping), names, count, math.nan)

    patient = _patient(robot, log, spoken, account, bench, moving)
    return _Examination(patient, bench, account, moving, names).run(tuple(wrapping))


# --- wraps ----------------------------------------------------------------------------------------


def _without_wraps(
    robot: Robot, log: WheelLog, spoken: LogMapping, steps: WheelSteps
) -> tuple[WheelSteps, list[Finding]]:
    """Steps by the shorter way round, and what that means."""
    if log.reading not in (Reading.TICKS, Reading.POSITION):
        return steps, []
    turned = steps.turned.copy()
    wraps: dict[int | None, list[tuple[str, Wrap]]] = {}
    for k, name in enumerate(robot.measuring.measured_names):
        encoder = robot.encoders.get(name) if is_counted(name, log.reading, spoken) else None
        wrap = find_wrap(turned[:, k], encoder)
        if wrap is not None:
            turned[:, k] = unwrapped(turned[:, k], wrap.span)
            wraps.setdefault(wrap.bits, []).append((name, wrap))
    findings = [_wrap_finding(robot, bits, alike) for bits, alike in wraps.items()]
    return replace(steps, turned=turned), findings


def _wrap_finding(robot: Robot, bits: int | None, alike: list[tuple[str, Wrap]]) -> Finding:
    """Of wheels that begin anew after the same span."""
    names = tuple(name for name, _ in alike)
    whose = " and ".join(names)
    if bits is None:
        words = f"the angle of {whose} begins anew after every turn: log the running total, or speeds"
        cause = Cause(Fault.WRAPS, names, words, None)
        span, unit = "one turn, 6.283 rad", "rad"
    else:
        words = f"the counter of {whose} wraps at {bits} bits"
        cause = Cause(Fault.WRAPS, names, words, with_bits(robot, names, bits))
        span, unit = f"2^{bits} = {1 << bits} ticks", "ticks"
    evidence = []
    for name, wrap in alike:
        tick = 1.0 if bits is None else abs(robot.encoders[name].radians_per_tick)
        often = "once" if wrap.jumps == 1 else f"{wrap.jumps} times"
        usual = f"{wrap.usual / tick:.3g} {unit}"
        evidence.append(f"{name} jumps {often} by about {span}, between steps of {usual}")
    return Finding((cause,), tuple(evidence))


def _nothing_moved(names: tuple[str, ...], label: Label) -> Finding:
    """The robot was driven, and no wheel turned."""
    whose = " and ".join(names)
    words = f"the encoder of {whose} is frozen, or not connected: look at cables and power"
    evidence = f"you drove {label.drove.value}, and no wheel turned at all"
    return Finding((Cause(Fault.FROZEN, names, words, None),), (evidence,))


# --- the family of faults -------------------------------------------------------------------------


def _patient(
    robot: Robot, log: WheelLog, spoken: LogMapping, account: Account, bench: Bench, moving: Mask
) -> Patient:
    turned = bench.windows.sums(np.abs(account.turned))
    still = {
        name: stands
        for name, column in zip(account.measured, turned.T, strict=True)
        if (stands := (column == 0.0) & moving).sum() >= 2
    }
    held = tuple(
        name
        for name, column in zip(account.steered, account.steering.T, strict=True)
        if len(column) and np.ptp(column) == 0.0
    )
    separate = len(log.steering_names) == len(account.steered) > 1
    gyro, reference = (any(one.name == name for one in bench.witnesses) for name in ("gyro", "reference"))
    told = bench.label is not None and bench.label.amount is not None
    scaled = told or bool(bench.witnesses)
    return Patient(robot, spoken, log.reading, separate, gyro, reference, scaled, still, held)


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """A fault, the factor that suits it best, and how the log looks without it."""

    hypothesis: Hypothesis
    factor: float
    fit: Fit


class _Examination:
    """One log, and everything that is tried on it."""

    def __init__(
        self, patient: Patient, bench: Bench, account: Account, moving: Mask, names: tuple[str, ...]
    ) -> None:
        self.patient = patient
        self.bench = bench
        self.account = account
        self.moving = moving
        self.names = names
        self.count = int(moving.sum())
        self.quick, self.quick_moving = bench.thinned(moving, QUICK)

    def run(self, found: tuple[Finding, ...]) -> Diagnosis:
        described = self.bench.fit(self.account, self.moving)
        if described.score <= QUIET:
            hidden = tuple(self._hidden())
            return Diagnosis(found, self.names, self.count, described.score, hidden=hidden)
        trials = [trial for one in hypotheses(self.patient) if (trial := self._try(one)) is not None]
        best = min(trials, key=lambda trial: trial.fit.score, default=None)
        if best is None or best.fit.score > _explained(described.score):
            lost = described.score > LOST and not found
            return Diagnosis(found, self.names, self.count, described.score, unexplained=lost)
        limit = best.fit.score + min(
            max(MARGIN, 0.5 * best.fit.score), 0.5 * (described.score - best.fit.score)
        )
        likely = [trial for trial in trials if trial.fit.score <= limit]
        if any(trial.hypothesis.stands for trial in likely):  # nobody measures 0 by a wrong factor
            likely = [trial for trial in likely if not trial.hypothesis.free]
        finding = self._finding(described, likely)
        return Diagnosis((*found, finding), self.names, self.count, described.score)

    def _try(self, hypothesis: Hypothesis) -> _Trial | None:
        """None where the fault cannot be of this robot."""
        try:
            factor = self._factor(hypothesis) if hypothesis.free else 1.0
            fit = self.bench.fit(hypothesis.account(self.account, factor), self.moving)
        except TrundleError:
            return None
        return _Trial(hypothesis, factor, fit)

    def _factor(self, hypothesis: Hypothesis) -> float:
        """The factor with the least score: sought among few windows, then refined among all."""

        def quickly(factor: float) -> float:
            return self.quick.fit(hypothesis.account(self.account, factor), self.quick_moving).score

        factors = [one for one in FACTORS.tolist() if hypothesis.least <= one <= hypothesis.most]
        place = int(np.argmin([quickly(factor) for factor in factors]))
        return _least(quickly, factors[max(0, place - 1)], factors[min(len(factors) - 1, place + 1)])

    # --- words --------------------------------------------------------------------------------

    def _finding(self, described: Fit, likely: Sequence[_Trial]) -> Finding:
        by_cause = [(cause, trial) for trial in likely for cause in trial.hypothesis.causes(trial.factor)]
        if any(cause.common for cause, _ in by_cause):
            by_cause = [(cause, trial) for cause, trial in by_cause if cause.common]
        causes = tuple(cause for cause, _ in by_cause)
        trial = by_cause[0][1]
        return Finding(causes, tuple(self._evidence(described, trial)), self._advised(causes))

    def _advised(self, causes: Sequence[Cause]) -> str:
        drive = self.patient.drive
        return _advice(causes, self.bench.label, car=bool(drive.constraints and drive.steered_names))

    def _evidence(self, described: Fit, trial: _Trial) -> list[str]:
        off = int((described.each[self.moving] > SOUND).sum())
        who = " and ".join(("the wheels", *self.names)) if self.names else "the wheels"
        lines = [
            f"as described, {who} contradict each other in {off} of {self.count} windows: misfit "
            f"{described.score:.3g}, and {trial.fit.score:.2g} without this fault (sound robots: "
            f"below {SOUND:g})"
        ]
        if trial.hypothesis.wheels:
            return [*lines, *self._of_wheels(trial)]
        return [*lines, *self._of_turn(trial)]

    def _of_wheels(self, trial: _Trial) -> Iterator[str]:
        """What the suspected wheels said, against what they should have."""
        read = self.bench.ways(self.account)
        fault = trial.hypothesis.causes(trial.factor)[0]
        account = trial.hypothesis.account(self.account, trial.factor)
        described = fault.fault is Fault.ROLLERS
        should = self.bench.expected(self.account if described else account, trial.fit.moved)
        for name in trial.hypothesis.wheels:
            if fault.fault is Fault.FROZEN:
                still = self.patient.still[name]
                way = float(np.abs(should[name][still]).sum())
                yield f"{name} stands still in {int(still.sum())} windows in which it should roll {way:.3g} m"
                continue
            # Of a swapped pair each follows what the other should have done.
            at = fault.subject.index(name)
            partner = fault.subject[at ^ 1] if fault.fault is Fault.SWAPPED else name
            ratio = _ratio(read[name][self.moving], should[partner][self.moving])
            way = float(np.abs(should[partner][self.moving]).sum())
            whose = "it" if partner == name else partner
            yield f"{name} reads {ratio:.3g} m for every metre that {whose} should roll ({way:.3g} m in all)"

    def _of_turn(self, trial: _Trial) -> Iterator[str]:
        """How far the robot turned, as the wheels are described and as the gyro says."""
        turned = trial.fit.moved[self.moving, 2]
        way = float(np.degrees(np.abs(turned).sum()))
        alone = self.bench.alone()
        if alone.freedom(self.account) >= 0 and self.patient.drive.observable_without_gyro:
            ratio = _ratio(alone.fit(self.account, self.moving).moved[self.moving, 2], turned)
            all_in_all = f"{way:.3g} deg in all"
            yield f"as described, the wheels turn the robot by {ratio:.3g} of what it turned ({all_in_all})"
        for witness in self.bench.witnesses:
            if witness.name == "gyro":
                shown = np.nan_to_num(witness.moved[self.moving, 2])
                yield f"the gyro shows {_ratio(shown, turned):.3g} of that turn"

    def _hidden(self) -> list[Cause]:
        """Faults without which, or with which, this log looks the same."""
        hidden = []
        for hypothesis in hypotheses(self.patient):
            if hypothesis.stands:  # not to listen to a wheel never makes things worse, and proves nothing
                continue
            for factor in (0.5, 2.0) if hypothesis.free else (1.0,):
                try:
                    fit = self.bench.fit(hypothesis.account(self.account, factor), self.moving)
                except TrundleError:
                    continue
                if fit.score <= QUIET:
                    hidden += [cause for cause in hypothesis.causes(factor)[:1] if cause.common]
                    break
        return hidden


def _explained(described: float) -> float:
    """The score at which a fault explains a log."""
    return max(CURED * described, min(SOUND, BETTER * described) if described > SOUND else 0.0)


def _least(score: Callable[[float], float], low: float, high: float) -> float:
    """Where a score is least between two factors (golden section, over logarithms)."""
    a, b = math.log(low), math.log(high)
    c, d = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    at_c, at_d = score(math.exp(c)), score(math.exp(d))
    while b - a > 0.005:
        if at_c < at_d:
            b, d, at_d = d, c, at_c
            c = b - GOLDEN * (b - a)
            at_c = score(math.exp(c))
        else:
            a, c, at_c = c, d, at_d
            d = a + GOLDEN * (b - a)
            at_d = score(math.exp(d))
    return math.exp(0.5 * (a + b))


def _ratio(read: Floats, should: Floats) -> float:
    """By least squares, how much is read for what should be."""
    size = float(should @ should)
    return round(float(read @ should) / size, 4) + 0.0 if size > 0.0 else 0.0


_ALIKE = {Fault.TICKS, Fault.RADIUS, Fault.UNIT}


def _advice(causes: Sequence[Cause], label: Label | None, *, car: bool) -> str:
    """What would tell several causes apart."""
    if len(causes) < 2:
        return ""
    if len({cause.subject for cause in causes}) == 1 and {cause.fault for cause in causes} <= _ALIKE:
        return "no log can tell these apart: turn the wheel once by hand and count, or measure it"
    if any(cause.fault in {Fault.LENGTH, *_ALIKE} for cause in causes):
        return "drive a measured way straight on, and say so: --drove forward --distance METRES"
    if label is None or label.drove not in (Drove.COUNTER_CLOCKWISE, Drove.CLOCKWISE):
        turn = "drive forward along a curve to the left" if car else "turn on the spot to the left"
        return f"{turn}, and say so: --drove counter-clockwise"
    return "drive straight on, and say so: --drove forward"
