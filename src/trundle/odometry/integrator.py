"""How the displacements of single steps become a path."""

from __future__ import annotations

import enum
from typing import Any

from trundle.errors import ConfigError, did_you_mean

__all__ = ["Integrator", "commutator_factor", "mean_rate"]


class Integrator(enum.Enum):
    """Ways to integrate, by the names that people type."""

    ARC_PLUS = "arc+"
    """Arc, with what the previous step says about how the twist is changing. The default."""
    ARC = "arc"
    """Exact for a constant twist: the SE(2) exponential."""
    MIDPOINT = "midpoint"
    """Straight line along the mean heading."""
    EULER = "euler"
    """Straight line along the old heading."""
    SYMMETRIC = "symmetric"
    """Arc, with the steps before and after: offline only."""

    @classmethod
    def named(cls, name: str | Integrator) -> Integrator:
        """The integrator of that name.

        Raises:
            ConfigError: If there is none; the message names the nearest.
        """
        if isinstance(name, Integrator):
            return name
        words = [integrator.value for integrator in cls]
        if name not in words:
            raise ConfigError("integrator", f"{name!r}, {did_you_mean(str(name), words)}")
        return cls(name)


def commutator_factor(before: float, now: float) -> float:
    """Weight of `[D_before, D_now]` in the causal correction, for steps of these lengths.

    A twist that changes linearly over both steps turns the displacement of the second by
    `h1^2 / (6 h0 (h0 + h1))` times the commutator; 1/12 where the steps are equal.

    Source:
        Magnus 1954 to second order, the planar cousin of the coning correction (Savage 1998).
    """
    return now * now / (6.0 * before * (before + now))


def mean_rate(earlier: Any, then: Any, now: Any, before: Any, elapsed: Any) -> Any:
    """Mean of a rate between its samples `then` and `now`, from the parabola through the last three.

    Floats or arrays. The trapezoid alone makes every swing a little smaller than it is: 16 mm per km of
    slalom at 50 Hz.

    Args:
        earlier: Sample before `then`.
        then: Sample at the step's beginning.
        now: Sample at its end.
        before: Time from `earlier` to `then`.
        elapsed: Time from `then` to `now`.

    Source:
        Adams and Moulton 1883, third order, for unequal steps.
    """
    # A sample much nearer than the step is long says nothing of how the rate bends: the slope between
    # the two is their noise, and the parabola would stretch it over the whole step.
    near = elapsed <= 2.0 * before
    bend = near * ((now - then) / elapsed - (then - earlier) / before)
    return 0.5 * (then + now) - elapsed * elapsed / (6.0 * (before + elapsed)) * bend
