"""The speed of a wheel from its encoder, without the steps of single counts, and how late it is.

A smoothed speed is that of the middle of the time it was taken over: `delay` says how long ago that is.
"""

from __future__ import annotations

import msgspec

from trundle.errors import ConfigError, InputError, require_positive

__all__ = ["RollingMean", "RollingMeanState", "SmoothedSpeed", "WindowState", "WindowedSpeed"]

_NS = 1e9


class SmoothedSpeed(msgspec.Struct, frozen=True, gc=False):
    """A speed and its age.

    Attributes:
        speed: In the unit of the positions, per second.
        delay: How long ago it was the speed, if the speed changes evenly [s].
    """

    speed: float = 0.0
    delay: float = 0.0


class WindowState(msgspec.Struct, frozen=True, gc=False):
    """Samples (time [ns], position), oldest first, that the window still needs."""

    samples: tuple[tuple[int, float], ...] = ()


class WindowedSpeed(msgspec.Struct, frozen=True):
    """Change of position over a window of time. Quantisation shows as one count per window.

    Attributes:
        window: How far to look back [s]; further where samples are further apart.
    """

    window: float = 0.1

    def __post_init__(self) -> None:
        require_positive("window", self.window)

    def step(self, state: WindowState, time_ns: int, position: float) -> tuple[SmoothedSpeed, WindowState]:
        """The speed after a sample, and the state.

        Args:
            state: The state before.
            time_ns: Of the sample [ns].
            position: Cumulative, in any unit.

        Raises:
            InputError: If time does not go on.
        """
        samples = (*state.samples, (time_ns, position))
        if len(samples) == 1:
            return SmoothedSpeed(), WindowState(samples)
        if time_ns <= samples[-2][0]:
            raise InputError(f"time_ns {time_ns}, must be after the last sample ({samples[-2][0]})")
        # The youngest sample that is at least a window old; all older ones have served.
        old = [k for k, (then, _) in enumerate(samples) if time_ns - then >= self.window * _NS]
        samples = samples[old[-1] if old else 0 :]
        then, before = samples[0]
        seconds = (time_ns - then) / _NS
        return SmoothedSpeed((position - before) / seconds, 0.5 * seconds), WindowState(samples)


class RollingMeanState(msgspec.Struct, frozen=True, gc=False):
    """The last sample, and the latest single speeds with their durations [s], oldest first."""

    time_ns: int | None = None
    position: float = 0.0
    steps: tuple[tuple[float, float], ...] = ()


class RollingMean(msgspec.Struct, frozen=True):
    """Mean of the last single-step speeds, as ros2_controllers smooths its odometry.

    Attributes:
        size: How many speeds; `velocity_rolling_window_size` there, 10 by default. Until as many
            have come, the mean is over those that have.
    """

    size: int = 10

    def __post_init__(self) -> None:
        if not isinstance(self.size, int) or self.size < 1:
            raise ConfigError("size", f"{self.size!r}, must be a whole number >= 1")

    def step(
        self, state: RollingMeanState, time_ns: int, position: float
    ) -> tuple[SmoothedSpeed, RollingMeanState]:
        """The speed after a sample, and the state; as `WindowedSpeed.step`."""
        if state.time_ns is None:
            return SmoothedSpeed(), RollingMeanState(time_ns, position)
        if time_ns <= state.time_ns:
            raise InputError(f"time_ns {time_ns}, must be after the last sample ({state.time_ns})")
        seconds = (time_ns - state.time_ns) / _NS
        steps = (*state.steps, ((position - state.position) / seconds, seconds))[-self.size :]
        ages, age = [], 0.0
        for _, duration in reversed(steps):
            ages.append(age + 0.5 * duration)
            age += duration
        mean = sum(speed for speed, _ in steps) / len(steps)
        return SmoothedSpeed(mean, sum(ages) / len(ages)), RollingMeanState(time_ns, position, steps)
