"""Pictures of trajectories: the path with its uncertainty, and what the wheels did."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from trundle.adapters.reference import jumps
from trundle.apps.plot_style import (
    BLUE,
    CYCLE,
    GREY,
    INK,
    SKY,
    VERMILLION,
    empty_figure,
    rendered,
    style_axis,
)
from trundle.apps.wording import seconds
from trundle.errors import InputError, OutputError, TrundleError
from trundle.evaluate import compare, transform
from trundle.geometry import se2
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Robot

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["plot_trajectory", "save_plot"]

Floats = npt.NDArray[np.float64]

_WIDTH = 9.0  # of the figure [in]
_CHI_SQUARE_95 = 5.991  # two degrees of freedom
_CIRCLE = np.stack([f(np.linspace(0.0, 2.0 * np.pi, 61)) for f in (np.cos, np.sin)])
_ELLIPSES = 8  # at most
_FORMATS = (".png", ".svg", ".pdf")
_BINS = 450  # across a time axis: about one per two pixels
_LEAST = 0.2  # size of the map [m]: what turns on the spot is a dot, not a scribble of micrometres
_LETTERS = 96  # that fit into one row of a legend


def plot_trajectory(
    trajectory: Trajectory,
    *,
    log: WheelLog | None = None,
    robot: Robot | None = None,
    reference: Trajectory | None = None,
    title: str = "",
) -> Figure:
    """A picture of where the robot went, how sure that is, and how fast its wheels turned.

    Args:
        trajectory: The path, with arrows for its heading and ellipses that hold the position with 95 %.
        log: What was measured; its wheel speeds and steering angles are drawn below.
        robot: Its encoders turn the log's ticks into radians; without it they stay ticks.
        reference: Where the robot really was. It is brought into the trajectory's frame by the best
            alignment; one that cannot be aligned is not drawn, and the picture says why.
        title: Headline.

    Returns:
        A matplotlib figure that belongs to no window and no global state.

    Raises:
        MissingExtra: If matplotlib is not installed.
    """
    aligned, remark = _align(reference, trajectory)
    panels = _panels(log, robot, trajectory)
    low, high = _extent(trajectory, aligned)
    width, height = high - low
    heights = [_WIDTH * float(np.clip(height / width, 0.35, 0.66)), *([1.5] * len(panels))]
    figure = empty_figure(_WIDTH, sum(heights) + 1.0)
    axes = figure.subplots(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]

    _headline(axes[0], title, _facts(trajectory) + remark)
    _draw_path(axes[0], trajectory, aligned, low, high)
    for axis, panel in zip(axes[1:], panels, strict=True):
        axis.sharex(axes[1])
        _draw_panel(axis, panel)
    for axis in axes[1:-1]:
        axis.tick_params(labelbottom=False)
    if panels:
        axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    return figure


def _facts(trajectory: Trajectory) -> str:
    length = trajectory.distance
    return f"{seconds(trajectory.duration)}  ·  {length:{'.2f' if length >= 1.0 else '.3g'}} m driven"


def save_plot(figure: Figure, path: str | Path) -> None:
    """Write a picture: the complete new file, or the old one untouched.

    Args:
        figure: What `plot_trajectory` made.
        path: Its suffix says the format: .png, .svg or .pdf.

    Raises:
        InputError: If the suffix is another one.
        OutputError: If it cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in _FORMATS:
        raise InputError(f"{path}: a picture must end in one of {', '.join(_FORMATS)}")
    _replace(path, rendered(figure, suffix[1:]))


def _replace(path: Path, content: bytes) -> None:
    """Put a new file in the place of an old one, in one step."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            draft.write_bytes(content)
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error


def _align(reference: Trajectory | None, trajectory: Trajectory) -> tuple[Trajectory | None, str]:
    """The reference in the trajectory's frame, and what to say about it."""
    if reference is None:
        return None, ""
    try:
        comparison = compare(trajectory, reference)
    except TrundleError as error:
        return None, f"  ·  reference not drawn: {error}"
    aligned = transform(reference, comparison.alignment.inverse(), frame=trajectory.frame)
    return aligned, f"  ·  {comparison.ate:.3g} m RMSE from the reference"


# the path


def _extent(trajectory: Trajectory, reference: Trajectory | None) -> tuple[Floats, Floats]:
    """Corners of what the map shows [m], with some room around."""
    paths = [t.poses[:, :2] for t in (trajectory, reference) if t is not None and len(t)]
    points = np.concatenate([*paths, np.zeros((0 if paths else 1, 2))])
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = max(float((high - low).max()), _LEAST)
    ellipses = _ellipses(trajectory)
    if ellipses.size:  # as much of the uncertainty as leaves the path readable
        low = np.clip(ellipses.min(axis=(0, 1)), low - 0.4 * size, low)
        high = np.clip(ellipses.max(axis=(0, 1)), high, high + 0.4 * size)
    room = np.maximum(0.06 * size, 0.5 * (max(0.2 * size, _LEAST) - (high - low)))
    return low - room, high + room


def _along(trajectory: Trajectory, count: int) -> npt.NDArray[np.intp]:
    """Indices of samples that are spread evenly along the path, the last one among them."""
    if not len(trajectory):
        return np.zeros(0, dtype=np.intp)
    step = np.diff(trajectory.poses[:, :2], axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    # A trace of time spreads them where the robot does not move.
    travelled = (
        np.concatenate(([0.0], np.cumsum(length + 1e-6 * length.mean() + 1e-12)))
        if len(step)
        else np.zeros(1)
    )
    return np.unique(np.searchsorted(travelled, np.linspace(0.0, travelled[-1], count + 1)[1:]))


def _ellipses(trajectory: Trajectory) -> Floats:
    """Outlines that hold the position with 95 %, in the trajectory's frame, shape (M, 61, 2)."""
    if trajectory.covariances is None:
        return np.zeros((0, _CIRCLE.shape[1], 2))
    chosen = _along(trajectory, _ELLIPSES)
    poses, covariances = trajectory.poses[chosen], trajectory.covariances[chosen, :2, :2]
    chosen_finite = np.isfinite(covariances).all(axis=(1, 2))
    poses, covariances = poses[chosen_finite], covariances[chosen_finite]
    variance, vectors = np.linalg.eigh(covariances)
    axes = vectors * np.sqrt(_CHI_SQUARE_95 * np.maximum(variance, 0.0))[:, None, :]
    outline = np.einsum("nij,jm->nmi", axes, _CIRCLE)
    body = np.concatenate([outline, np.zeros_like(outline[..., :1])], axis=-1)
    outlines = np.asarray(se2.compose(poses[:, None, :], body)[..., :2])
    return outlines[_distinct(poses[:, :2], np.linalg.norm(axes, axis=1).max(axis=1))]


def _distinct(centres: Floats, sizes: Floats) -> list[int]:
    """Ellipses that do not hide each other: from the last on, what lies elsewhere or is half as large."""
    kept: list[int] = []
    for k in range(len(sizes) - 1, -1, -1):
        apart = np.hypot(*(centres[kept] - centres[k]).T) > 0.5 * (sizes[kept] + sizes[k])
        if np.all(apart | (sizes[k] <= 0.5 * sizes[kept])):
            kept.append(k)
    return kept[::-1]


def _draw_path(
    axis: Axes, trajectory: Trajectory, reference: Trajectory | None, low: Floats, high: Floats
) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgba

    style_axis(axis)
    axis.update_datalim([low, high])
    axis.margins(0.0)
    axis.set_aspect("equal", adjustable="datalim")
    axis.ticklabel_format(useOffset=False, style="plain")
    axis.set_xlabel(f"x in {trajectory.frame} [m]", parse_math=False)
    axis.set_ylabel(f"y in {trajectory.frame} [m]", parse_math=False)

    ellipses = _ellipses(trajectory)
    if len(ellipses):
        outlines = PolyCollection(list(ellipses), linewidth=0.7, zorder=2, label="95 % uncertainty")
        outlines.set_facecolor(to_rgba(SKY, 0.13))
        outlines.set_edgecolor(to_rgba(BLUE, 0.45))
        axis.add_collection(outlines, autolim=False)
    if reference is not None:
        x, y = _broken(reference).T
        axis.plot(x, y, color=VERMILLION, dashes=(4, 2), linewidth=1.3, zorder=3, label="reference, aligned")
    x, y, theta = trajectory.poses.T
    axis.plot(x, y, color=BLUE, linewidth=1.8, zorder=4, label="odometry", solid_joinstyle="round")
    if len(trajectory):
        axis.plot(x[0], y[0], "o", color="none", mec=INK, mew=1.6, ms=12, zorder=6, label="start")
        axis.plot(x[-1], y[-1], "s", color=INK, mec="white", ms=7.5, zorder=6, label="end")
    lengths = trajectory.distance / float((high - low).max())  # of the path, in widths of the map
    arrows = _along(trajectory, int(np.clip(11.0 * lengths, 6, 40)))
    axis.quiver(
        x[arrows], y[arrows], np.cos(theta[arrows]), np.sin(theta[arrows]), color=INK, zorder=5,
        units="inches", scale_units="inches", scale=1 / 0.17, width=0.012,
        headwidth=8, headlength=8, headaxislength=6.5,
    )  # fmt: skip
    _legend(axis)


def _broken(reference: Trajectory) -> Floats:
    """Its positions, with NaN before those that nothing can have reached: no line is drawn across a jump."""
    at = np.searchsorted(reference.time_ns, jumps(reference))
    return np.insert(reference.poses[:, :2], at, np.nan, axis=0)


# the wheels


class _Panel(NamedTuple):
    """Curves over the time since the trajectory's start."""

    label: str
    time: Floats
    curves: dict[str, Floats]


def _panels(log: WheelLog | None, robot: Robot | None, trajectory: Trajectory) -> list[_Panel]:
    """What is drawn over time: wheel speeds (or body speeds, where a log says only those), steering."""
    if log is None or not len(log) or not len(trajectory):
        return []
    kept = _rising(log.time_ns, trajectory.time_ns[0], trajectory.time_ns[-1])
    time = (log.time_ns[kept] - trajectory.time_ns[0]) * 1e-9
    panels = []
    if log.wheels is not None:
        unit, speeds = _wheel_speeds(log, robot, kept)
        curves = dict(zip(log.wheel_names, speeds.T, strict=True))
        panels.append(_Panel(f"wheel speed [{unit}]", time[1:], curves))
    elif log.twists is not None:
        names = ("forward [m/s]", "left [m/s]", "yaw rate [rad/s]")
        panels.append(_Panel("body speed", time, dict(zip(names, log.twists[kept].T, strict=True))))
    if log.steering is not None and log.steering_names:
        curves = dict(zip(log.steering_names, log.steering[kept].T, strict=True))
        panels.append(_Panel("steering [rad]", time, curves))
    return panels


def _rising(time_ns: npt.NDArray[np.int64], first: np.int64, last: np.int64) -> npt.NDArray[np.intp]:
    """Rows within a time, each later than all before it: others would draw lines back."""
    inside = np.flatnonzero((first <= time_ns) & (time_ns <= last))
    latest = np.maximum.accumulate(time_ns[inside])
    return inside[np.diff(latest, prepend=first - 1) > 0]


def _wheel_speeds(log: WheelLog, robot: Robot | None, kept: npt.NDArray[np.intp]) -> tuple[str, Floats]:
    """Unit, and speeds of the wheels at the kept stamps after the first, shape (M - 1, wheels)."""
    wheels: Any = log.wheels
    unit = "rad/s"
    change = np.diff(wheels[kept], axis=0)
    if log.reading is Reading.VELOCITY:
        return unit, wheels[kept][1:]
    if log.reading is Reading.INCREMENT:
        change = wheels[kept][1:]
    elif log.reading is Reading.TICKS:
        encoders = [None if robot is None else robot.encoders.get(name) for name in log.wheel_names]
        known = [encoder for encoder in encoders if encoder is not None]
        if len(known) == len(encoders):
            turned = [
                _unwrapped(c, e.bits) * e.radians_per_tick for c, e in zip(change.T, known, strict=True)
            ]
            change = np.stack(turned, axis=1)
        else:
            unit = "ticks/s"
    return unit, change / (np.diff(log.time_ns[kept])[:, None] * 1e-9)


def _unwrapped(change: npt.NDArray[np.int64], bits: int | None) -> npt.NDArray[np.int64]:
    """Differences of a counter, across its wrap; int64 itself wraps at 64 bits."""
    if bits is None or bits == 64:
        return change
    half = np.int64(1) << (bits - 1)
    return (change + half) % (2 * half) - half


def _draw_panel(axis: Axes, panel: _Panel) -> None:
    style_axis(axis)
    axis.set_ylabel(panel.label)
    axis.margins(x=0.01)
    # The first lines are the widest, so that one that lies below another can be seen.
    widths = np.linspace(1.9, 1.0, max(len(panel.curves), 2))
    for (name, values), color, width in zip(panel.curves.items(), cycle(CYCLE), widths, strict=False):
        time, mean, low, high = _thinned(panel.time, values)
        axis.plot(time, mean, color=color, linewidth=width, label=name, zorder=4)
        axis.fill_between(time, low, high, color=color, alpha=0.18, linewidth=0, zorder=3)
    _leave_out_spikes(axis, np.concatenate(list(panel.curves.values())))
    _legend(axis)


def _leave_out_spikes(axis: Axes, values: Floats) -> None:
    """Limit the axis to what nearly all samples need, and say how many are beyond."""
    values = values[np.isfinite(values)]
    if not values.size:
        return
    low, high = np.percentile(values, (1.0, 99.0))
    room = 2.0 * (high - low) + 1e-9
    beyond = int(((values < low - room) | (values > high + room)).sum())
    if beyond:
        axis.set_ylim(low - 0.25 * room, high + 0.25 * room)
        axis.text(
            1.0, 1.0, f"{beyond} samples beyond, {values.min():.6g} to {values.max():.6g}",
            transform=axis.transAxes, ha="right", va="bottom", fontsize=9, color=GREY,
        )  # fmt: skip


def _thinned(time: Floats, values: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Time, mean, least and greatest of as many samples together as share a pixel."""
    finite = np.isfinite(values)
    time, values = time[finite], values[finite]
    size = -(-len(time) // _BINS)
    if size <= 1:
        return time, values, values, values
    first = np.arange(0, len(time), size)
    count = np.diff(np.append(first, len(time)))
    return (
        np.add.reduceat(time, first) / count,
        np.add.reduceat(values, first) / count,
        np.minimum.reduceat(values, first),
        np.maximum.reduceat(values, first),
    )


# the style


def _headline(axis: Axes, title: str, facts: str) -> None:
    """Title, and below it, smaller, what there is to say in words; below that is room for a legend."""
    lines = textwrap.wrap(facts, 110)
    axis.annotate(
        "\n".join(lines), (0.0, 1.0), (0.0, 25.0), xycoords="axes fraction", textcoords="offset points",
        fontsize=10, color=GREY, va="bottom", parse_math=False,
    )  # fmt: skip
    axis.set_title(
        textwrap.fill(title, 70), loc="left", fontsize=14, fontweight="bold", color=INK,
        pad=31.0 + 14.0 * len(lines), parse_math=False,
    )  # fmt: skip


def _legend(axis: Axes) -> None:
    """Rows above the axes, where they hide nothing."""
    names = axis.get_legend_handles_labels()[1]
    legend = axis.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=_columns(names), frameon=False,
        markerscale=0.75, fontsize=9, borderaxespad=0.1, borderpad=0.2, handlelength=1.6, columnspacing=1.6,
    )  # fmt: skip
    for text in legend.get_texts():  # wheels are named by people; a dollar in a name is no formula
        text.set_parse_math(False)


def _columns(names: Sequence[str]) -> int:
    """Of a legend: up to six, as many as fit beside each other."""
    for count in range(min(len(names), 6), 1, -1):
        widest = [
            max(map(len, column)) + 6 for column in np.array_split(np.array(names, dtype=object), count)
        ]
        if sum(widest) <= _LETTERS:
            return count
    return 1
