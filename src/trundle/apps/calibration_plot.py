"""Pictures of a calibration: paths before and after, how far off they were, numbers with error bars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from trundle.apps.calibration_words import is_scaled, shown_unit, worded
from trundle.apps.plot_style import BLUE, GREY, INK, LINE, VERMILLION, empty_figure, style_axis
from trundle.apps.wording import length

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from trundle.calibrate.calibration import Calibration, Estimate, RunFit
    from trundle.records import Trajectory

__all__ = ["plot_calibration", "plot_errors", "plot_parameters", "plot_paths", "plot_residuals"]

Floats = npt.NDArray[np.float64]

MOST_RUNS = 12
"""Runs that are drawn; of more, those spread evenly over them."""
COLUMNS = 3
WIDEST = 5.0
"""Residuals that are drawn where they are, in standard deviations."""
LEAST = 0.2
"""Size of a map [m]: what turns on the spot is a dot, not a scribble of micrometres."""


def plot_calibration(calibration: Calibration, *, title: str = "") -> Figure:
    """One picture: paths on the left, numbers on the right.

    Raises:
        MissingExtra: If matplotlib is not installed.
    """
    fits = _chosen(calibration.fits)
    columns = max(1, min(len(fits), COLUMNS))
    rows = -(-max(len(fits), 1) // columns)
    count = len(calibration.estimates)
    height = max(3.4 * rows, 1.4 + 0.5 * count)
    figure = empty_figure(3.3 * columns + 4.6, height + 0.7)
    if title:
        figure.suptitle(title, x=0.01, ha="left", fontsize=14, fontweight="bold", color=INK, parse_math=False)
    halves: Any = figure.subfigures(1, 2, width_ratios=(3.3 * columns, 4.6))
    _draw_runs(halves[0], fits, columns, _draw_paths)
    _draw_estimates(_upper(halves[1], height, 1.4 + 0.5 * count), calibration.estimates)
    return figure


def _upper(figure: Any, height: float, wanted: float) -> Any:
    """As much of the top of it as is wanted [in]: three numbers need no tower of paths' height."""
    if height - wanted < 1.0:
        return figure
    return figure.subfigures(2, 1, height_ratios=(wanted, height - wanted))[0]


def plot_paths(fits: Sequence[RunFit]) -> Figure:
    """Where each run went: by the old numbers, by the new ones, and really."""
    return _grid(fits, 3.5, _draw_paths)


def plot_errors(fits: Sequence[RunFit]) -> Figure:
    """How far the paths of each run were off over time, before and after."""
    return _grid(fits, 2.3, _draw_errors)


def plot_residuals(fits: Sequence[RunFit]) -> Figure:
    """What is left of all samples: the reference's own noise, and wider than that, what the wheels drift."""
    left = [fit.residuals[np.isfinite(fit.residuals)] for fit in fits]
    values = np.concatenate([*left, np.zeros(0)])
    figure = empty_figure(8.6, 2.9)
    axis = figure.subplots()
    style_axis(axis)
    edges = np.linspace(-WIDEST, WIDEST, 61)
    inside = np.clip(values, -WIDEST, WIDEST)
    axis.hist(inside, edges.tolist(), density=True, color=BLUE, alpha=0.55, label=f"{len(values)} residuals")
    middle = np.linspace(-WIDEST, WIDEST, 241)
    normal = np.exp(-0.5 * middle**2) / math.sqrt(math.tau)
    axis.plot(middle, normal, color=INK, linewidth=1.2, dashes=(4, 2), label="the reference's noise alone")
    axis.set_xlabel(
        "residual [standard deviations of the reference]; wider is the wheels' drift; edges: beyond"
    )
    axis.set_yticks([])
    axis.legend(frameon=False, fontsize=9, loc="upper right")
    return figure


def plot_parameters(estimates: Sequence[Estimate]) -> Figure:
    """What changed, with error bars of two standard deviations."""
    figure = empty_figure(8.6, 1.2 + 0.42 * max(len(estimates), 1))
    _draw_estimates(figure, estimates)
    return figure


# the runs


def _chosen(fits: Sequence[RunFit]) -> list[RunFit]:
    drawn = [fit for fit in fits if fit.before is not None and len(fit.before)]
    if len(drawn) <= MOST_RUNS:
        return drawn
    return [drawn[k] for k in np.linspace(0, len(drawn) - 1, MOST_RUNS).round().astype(int)]


def _grid(fits: Sequence[RunFit], height: float, draw: Any) -> Figure:
    chosen = _chosen(fits)
    columns = max(1, min(len(chosen), COLUMNS))
    rows = -(-max(len(chosen), 1) // columns)
    figure = empty_figure(4.0 * columns if columns > 1 else 7.0, height * rows + 0.4)
    _draw_runs(figure, chosen, columns, draw)
    return figure


def _draw_runs(figure: Any, fits: Sequence[RunFit], columns: int, draw: Any) -> None:
    rows = -(-max(len(fits), 1) // columns)
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat[len(fits) :]:
        axis.set_axis_off()
    for axis, fit in zip(axes.flat, fits, strict=False):
        style_axis(axis)
        draw(axis, fit)
        axis.set_title(_short(fit.name), loc="left", fontsize=9.5, color=INK, parse_math=False)
    for axis in axes[:, 0]:
        axis.set_ylabel("y [m]" if draw is _draw_paths else "off by [m]")
    for axis in axes[-1]:
        axis.set_xlabel("x [m]" if draw is _draw_paths else "time [s]")
    legend = {
        label: handle
        for axis in axes.flat
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    if legend:
        figure.legend(
            legend.values(), legend.keys(), loc="outside upper right", ncols=len(legend), frameon=False,
            fontsize=9,
        )  # fmt: skip


def _short(name: str, most: int = 34) -> str:
    return name if len(name) <= most else f"…{name[1 - most :]}"


def _draw_paths(axis: Axes, fit: RunFit) -> None:
    axis.set_aspect("equal", adjustable="datalim")
    axis.ticklabel_format(useOffset=False, style="plain")
    axis.locator_params(nbins=5)
    axis.margins(0.08)
    if len(fit.before) == 2:
        _draw_ends(axis, fit)
        return
    _leave_room(axis, fit)
    if fit.reference is not None:
        x, y = fit.reference.poses[:, :2].T
        axis.plot(x, y, color=INK, linewidth=1.0, dashes=(4, 2), zorder=5, label="reference")
    for path, color, width, word in (
        (fit.before, VERMILLION, 1.1, "before"),
        (fit.after, BLUE, 1.6, "after"),
    ):
        x, y = path.poses[:, :2].T
        axis.plot(x, y, color=color, linewidth=width, label=word, zorder=3 if word == "before" else 4)


def _draw_ends(axis: Axes, fit: RunFit) -> None:
    """A tape measure knows two ends, and so does this picture: where it began, and where it says it ended."""
    axis.plot(*fit.before.poses[0, :2], "o", color="none", mec=INK, mew=1.4, ms=9, label="start")
    for path, color, word in ((fit.before, VERMILLION, "before"), (fit.after, BLUE, "after")):
        x, y = path.poses[:, :2].T
        axis.plot(x, y, color=color, linewidth=1.0, dashes=(1, 2))
        axis.plot(x[-1], y[-1], "s", color=color, ms=6, label=f"end, {word}")


def _leave_room(axis: Axes, fit: RunFit) -> None:
    places = np.concatenate([fit.before.poses[:, :2], fit.after.poses[:, :2]])
    low, high = np.nanmin(places, axis=0), np.nanmax(places, axis=0)
    room = np.maximum(0.0, 0.5 * (LEAST - (high - low)))
    axis.update_datalim([low - room, high + room])


def _draw_errors(axis: Axes, fit: RunFit) -> None:
    for path, color, word in ((fit.before, VERMILLION, "before"), (fit.after, BLUE, "after")):
        seconds, off = _off(path, fit.reference)
        rms = math.sqrt(float(np.mean(off**2))) if len(off) else 0.0
        axis.plot(seconds, off, color=color, linewidth=1.2, label=word)
        axis.axhline(rms, color=color, linewidth=0.8, dashes=(1, 2))
        axis.annotate(
            length(rms), (1.0, rms), (3, 0), xycoords=("axes fraction", "data"), textcoords="offset points",
            color=color, fontsize=8, va="center", annotation_clip=False,
        )  # fmt: skip
    axis.set_ylim(bottom=0.0)
    axis.margins(x=0.0)


def _off(path: Trajectory, reference: Trajectory | None) -> tuple[Floats, Floats]:
    """Time since the start [s], and distance from the reference [m], at the reference's stamps."""
    if reference is None or not len(path):
        return np.zeros(0), np.zeros(0)
    inside = (reference.time_ns >= path.time_ns[0]) & (reference.time_ns <= path.time_ns[-1])
    moments = 1e-9 * (reference.time_ns[inside] - path.time_ns[0])
    own = 1e-9 * (path.time_ns - path.time_ns[0])
    x, y = (np.interp(moments, own, path.poses[:, k]) for k in (0, 1))
    return moments, np.hypot(x - reference.poses[inside, 0], y - reference.poses[inside, 1])


# the numbers


def _draw_estimates(figure: Any, estimates: Sequence[Estimate]) -> None:
    """Two panels: lengths and gains by how many percent they changed, what began at zero in its own unit."""
    scaled = [one for one in estimates if is_scaled(one)]
    plain = [one for one in estimates if not is_scaled(one)]
    groups = [group for group in (scaled, plain) if group]
    if not groups:
        return
    axes = figure.subplots(
        len(groups), 1, squeeze=False, height_ratios=[len(group) + 0.6 for group in groups]
    )[:, 0]
    for axis, group in zip(axes, groups, strict=True):
        style_axis(axis)
        axis.grid(visible=False, axis="y")
        if group is scaled:
            shown = [(100 * (e.value / e.nominal - 1.0), 100 * e.sigma / abs(e.nominal)) for e in group]
            axis.set_xlabel("change [%], bars: 2 sigma")
        else:
            shown = [
                ((e.value - e.nominal) / shown_unit(e.unit)[1], e.sigma / shown_unit(e.unit)[1])
                for e in group
            ]
            units = ", ".join(dict.fromkeys(shown_unit(e.unit)[0] for e in group))
            axis.set_xlabel(f"change [{units}], bars: 2 sigma")
        places = np.arange(len(group))[::-1]
        axis.axvline(0.0, color=GREY, linewidth=1.0)
        axis.hlines(places, 0.0, [value for value, _ in shown], color=LINE, linewidth=6, zorder=2)
        axis.errorbar(
            [value for value, _ in shown], places, xerr=[2.0 * sigma for _, sigma in shown],
            fmt="o", color=BLUE, ecolor=INK, capsize=3.5, markersize=6, elinewidth=1.3, zorder=4,
        )  # fmt: skip
        axis.set_yticks(places, [f"{e.name}\n{worded(e)}" for e in group], fontsize=9)
        for label in axis.get_yticklabels():
            label.set_parse_math(False)
        axis.set_ylim(-0.6, len(group) - 0.4)
        axis.margins(x=0.12)
