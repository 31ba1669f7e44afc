"""How all pictures look: colours that everybody can tell apart, quiet axes, figures without a window."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING, Any

from trundle.errors import MissingExtra

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "BLUE",
    "CYCLE",
    "GREY",
    "INK",
    "LINE",
    "SKY",
    "VERMILLION",
    "empty_figure",
    "rendered",
    "style_axis",
]

# Okabe and Ito 2008, "Color universal design": told apart with every kind of colour vision.
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
VERMILLION = "#D55E00"
SKY = "#56B4E9"
PURPLE = "#CC79A7"
INK = "#222222"
GREY = "#666666"
LINE = "#DDDDDD"
CYCLE = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, INK, GREY)


def empty_figure(width: float, height: float) -> Figure:
    """A matplotlib figure [in] that belongs to no window and no global state.

    Raises:
        MissingExtra: If matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine
    except ImportError:
        raise MissingExtra("matplotlib", "plot") from None
    layout = ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1)
    figure = Figure(figsize=(width, height), dpi=150, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def rendered(figure: Figure, form: str, **options: Any) -> bytes:
    """The picture as a file of a format. Letters that the font lacks are drawn as boxes, without a word."""
    picture = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from")
        figure.savefig(picture, format=form, **options)
    return picture.getvalue()


def style_axis(axis: Axes) -> None:
    """A light grid, two spines, small numbers."""
    axis.grid(color=LINE, linewidth=0.6)
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)
    axis.spines[["left", "bottom"]].set_color(GREY)
    axis.tick_params(colors=GREY, labelcolor=INK, labelsize=9)
