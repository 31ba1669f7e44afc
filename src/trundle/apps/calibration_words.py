"""What a calibration found, in the words and numbers that the screen and the report share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from trundle.apps.wording import digits, plural

if TYPE_CHECKING:
    from trundle.calibrate.calibration import Calibration, Estimate
    from trundle.calibrate.hold_out import HoldOut

__all__ = [
    "held_out_rows",
    "is_scaled",
    "names_in",
    "parameter_rows",
    "quality_lines",
    "shown_unit",
    "unobserved_lines",
    "worded",
]

_SHOWN = {
    "m": ("mm", 1e-3),
    "rad": ("deg", math.radians(1.0)),
    "rad/s": ("deg/s", math.radians(1.0)),
    "s": ("ms", 1e-3),
}

STRAINED = 1.5
"""Chi-square per degree of freedom from which on the model, not the noise, is the limit."""


def names_in(words: Sequence[str] | None) -> tuple[str, ...] | None:
    """Names of parameters on a command line, `a,b` and `a b` alike; None where there are none."""
    return None if not words else tuple(part for word in words for part in word.split(",") if part)


def shown_unit(unit: str) -> tuple[str, float]:
    """What people read a unit in, and what one of that is in it."""
    return _SHOWN.get(unit, (unit, 1.0))


def parameter_rows(calibration: Calibration) -> list[tuple[str, ...]]:
    """A table: head, and one row per parameter."""
    rows: list[tuple[str, ...]] = [("parameter", "before", "now", "1 sigma", "change")]
    return rows + [_row(one) for one in calibration.estimates]


def _row(estimate: Estimate) -> tuple[str, ...]:
    unit, factor = shown_unit(estimate.unit)
    value, nominal, sigma = (part / factor for part in (estimate.value, estimate.nominal, estimate.sigma))
    places = _places(sigma)
    change = f"{_signed(100.0 * (value / nominal - 1.0))} %" if is_scaled(estimate) else ""
    name = f"{estimate.name} [{unit}]" if unit else estimate.name
    return name, f"{nominal:.{places}f}", f"{value:.{places}f}", f"±{sigma:.{places}f}", change


def is_scaled(estimate: Estimate) -> bool:
    """Whether a change in percent says something: places, angles and delays may begin anywhere."""
    anywhere = estimate.name.startswith("reference.") or estimate.name in ("clock", "gyro.bias")
    return estimate.nominal != 0.0 and not anywhere and not estimate.name.endswith(".offset")


def worded(estimate: Estimate) -> str:
    """`41.321 ± 0.021 mm`."""
    unit, factor = shown_unit(estimate.unit)
    places = _places(estimate.sigma / factor)
    value, sigma = (f"{part / factor:.{places}f}" for part in (estimate.value, estimate.sigma))
    return f"{value} ± {sigma} {unit}".rstrip()


def _places(sigma: float) -> int:
    """Decimals that show two digits of a standard deviation."""
    if not 0.0 < sigma < math.inf:
        return 3
    return min(max(1 - math.floor(math.log10(sigma)), 0), 9)


def _signed(value: float) -> str:
    return f"{'+' if value >= 0.0 else '-'}{digits(abs(value))}"


def quality_lines(calibration: Calibration) -> list[str]:
    """How well the logs fit, as sentences."""
    fit = f"chi-square per degree of freedom {digits(calibration.chi2_per_dof)}"
    if calibration.chi2_per_dof > STRAINED:
        fit += ": more than noise explains, so every sigma was scaled up by its root"
    outliers = calibration.samples - calibration.inliers
    share = 100.0 * outliers / max(calibration.samples, 1)
    return [
        fit,
        f"condition {calibration.condition:.2g} (above 1e5 a log tells nothing in some direction)",
        f"{plural(calibration.samples, 'sample')}, {outliers} of them outliers ({digits(share, 2)} %)",
    ]


def unobserved_lines(calibration: Calibration) -> list[str]:
    """What the logs could not tell, and what to drive."""
    lines = []
    for one in calibration.unobserved:
        line = one.words
        if one.manoeuvre:
            line += f"; {one.manoeuvre}"
        lines.append(line)
    return lines


def held_out_rows(held_out: HoldOut | None) -> list[tuple[str, ...]]:
    """A table: head, and one row per run that was held out."""
    rows: list[tuple[str, ...]] = [("run", "before", "after", "times better", "error")]
    if held_out is None:
        return rows
    for trial in held_out.trials:
        unit, factor = shown_unit(trial.unit)
        before, after = (digits(value / factor) for value in (trial.before, trial.after))
        rows.append(
            (trial.name, f"{before} {unit}", f"{after} {unit}", digits(trial.improvement), trial.error)
        )
    return rows
