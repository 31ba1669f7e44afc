"""A calibration as one HTML page that needs nothing else: numbers, pictures, and what stayed open."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from trundle.apps.calibration_plot import plot_errors, plot_parameters, plot_paths, plot_residuals
from trundle.apps.calibration_words import held_out_rows, parameter_rows, quality_lines, unobserved_lines
from trundle.apps.plot_style import rendered

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from trundle.calibrate.calibration import Calibration
    from trundle.calibrate.hold_out import HoldOut

__all__ = ["report_page"]

_STYLE = """
:root { color-scheme: light dark; --ink: #222; --soft: #666; --line: #ddd; --card: #fff; --back: #f6f7f8;
  --good: #00734f; --bad: #b34700; --accent: #0072b2; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --soft: #a0a4a8; --line: #3a3f44;
  --card: #1d2023; --back: #141618; --good: #4fd1a5; --bad: #ff9a5c; --accent: #6db9ee; } }
* { box-sizing: border-box; }
body { margin: 0; background: var(--back); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 62rem; margin: 0 auto; padding: 2rem 1.2rem 4rem; }
h1 { font-size: 1.7rem; margin: 0 0 .2rem; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 0 0 .8rem; }
p { margin: .4rem 0; } .soft { color: var(--soft); overflow-wrap: anywhere; }
section { background: var(--card); border: 1px solid var(--line); border-radius: .6rem;
  padding: 1.1rem 1.3rem; margin-top: 1.1rem; }
.verdict { border-left: .35rem solid var(--good); font-size: 1.05rem; }
.verdict.bad { border-left-color: var(--bad); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th { text-align: left; color: var(--soft); font-weight: 600; }
th, td { padding: .32rem .8rem .32rem 0; border-bottom: 1px solid var(--line); vertical-align: top; }
td.number, th.number { text-align: right; white-space: nowrap; }
tr:last-child td { border-bottom: 0; }
figure { margin: 0; background: #fff; border-radius: .4rem; padding: .3rem; }
figure svg { display: block; width: 100%; height: auto; }
ul { margin: .3rem 0; padding-left: 1.2rem; } li { margin: .35rem 0; }
code { background: var(--back); border-radius: .3rem; padding: .1rem .35rem; overflow-wrap: anywhere; }
"""


def report_page(
    calibration: Calibration, held_out: HoldOut | None, *, title: str, command: str = "", version: str = ""
) -> str:
    """The page.

    Args:
        calibration: What was found.
        held_out: What the held-out runs say of it.
        title: Headline: the robot's name.
        command: What was typed, so that it can be done again.
        version: Of Trundle.

    Raises:
        MissingExtra: If matplotlib is not installed.
    """
    parts = [
        _verdict(held_out),
        _section("The numbers", _table(parameter_rows(calibration), numbers=(1, 2, 3, 4))),
        _figure("What changed, with two standard deviations", plot_parameters(calibration.estimates)),
        _section("How well the logs fit", _list(quality_lines(calibration))),
        _section("What these logs could not tell", _list(unobserved_lines(calibration))),
        _section("Runs that were held out", _table(held_out_rows(held_out), numbers=(1, 2, 3))),
    ]
    if calibration.fits:
        parts.append(_figure("Paths before and after", plot_paths(calibration.fits)))
    # A tape measure and a gyro know no places in between.
    if seen := [fit for fit in calibration.fits if fit.reference is not None]:
        parts += [
            _figure("How far off they were", plot_errors(seen)),
            _figure("What is left", plot_residuals(seen)),
        ]
    parts.append(_section("Worth knowing", _list(calibration.warnings)))
    made = f"<p class=soft>Made by Trundle {html.escape(version)}: <code>{html.escape(command)}</code></p>"
    return "\n".join(
        [
            "<!doctype html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            # Nothing is loaded, and nothing runs.
            '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
            "style-src 'unsafe-inline'; img-src data:\">",
            f"<title>Calibration of {html.escape(title)}</title><style>{_STYLE}</style></head><body><main>",
            f"<h1>Calibration of {html.escape(title)}</h1>",
            _about(calibration),
            *filter(None, parts),
            made if command else "",
            "</main></body></html>",
            "",
        ]
    )


def _about(calibration: Calibration) -> str:
    names = ", ".join(fit.name for fit in calibration.fits)
    runs = len(calibration.fits)
    words = f"From {runs} run{'' if runs == 1 else 's'}, {calibration.samples} samples: {names}"
    return f'<p class="soft">{html.escape(words)}</p>'


def _verdict(held_out: HoldOut | None) -> str:
    if held_out is None:
        words, good = "Nothing was held out: whether these numbers are better was not asked.", False
    else:
        words, good = held_out.words, held_out.better
    bad = "" if good else " bad"
    return f'<section class="verdict{bad}">{html.escape(words)}</section>'


def _section(title: str, body: str) -> str:
    return f"<section><h2>{html.escape(title)}</h2>{body}</section>" if body else ""


def _list(lines: Iterable[str]) -> str:
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def _table(rows: Sequence[Sequence[str]], numbers: Sequence[int]) -> str:
    """The first row is the head; nothing where there is no other."""
    if len(rows) < 2:
        return ""

    def row(cells: Sequence[str], tag: str) -> str:
        made = [
            f"<{tag}{' class=number' if k in numbers else ''}>{html.escape(cell)}</{tag}>"
            for k, cell in enumerate(cells)
        ]
        return f"<tr>{''.join(made)}</tr>"

    body = "".join(row(cells, "td") for cells in rows[1:])
    return f'<div class="scroll"><table>{row(rows[0], "th")}{body}</table></div>'


def _figure(title: str, figure: Figure) -> str:
    return _section(title, f"<figure>{_svg(figure)}</figure>")


def _svg(figure: Figure) -> str:
    """The picture as a part of the page; its width is the page's."""
    from matplotlib import rc_context

    with rc_context({"svg.hashsalt": "trundle"}):  # the same picture, the same bytes
        text = rendered(figure, "svg", metadata={"Date": None}).decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, count=1, flags=re.DOTALL)
    return re.sub(r'(<svg[^>]*?) width="[^"]*"| height="[^"]*pt"', r"\1", text, count=2)
