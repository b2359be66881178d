"""One look for all figures: colour-blind safe, readable at the width of a phone, right on light and dark pages."""

from __future__ import annotations

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from flexlink.pages.colours import GREY, INK, PAPER
from flexlink.pages.numbers import number

WIDTH = 5.2  # in; half a page's column of 66 rem shows 11.5 pt as the text beside it, a phone of 390 px as 11 px
NAMED_CURVES = 6  # of a panel; more do not fit into its legend

RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 11.5,
    "axes.titlesize": 11.5,
    "axes.labelsize": 11.5,
    "xtick.labelsize": 11.5,
    "ytick.labelsize": 11.5,
    "legend.fontsize": 11.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "figure.facecolor": PAPER,
    "figure.autolayout": False,  # a figure says itself how it is laid out
    "figure.constrained_layout.use": False,
    "axes.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "legend.facecolor": PAPER,
    "legend.framealpha": 0.85,
    "legend.edgecolor": GREY,
    "legend.handlelength": 1.4,
    "axes.grid": True,
    "grid.color": GREY,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.markersize": 5.0,
    "path.simplify_threshold": 0.3,  # pt; a third of a line
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "path",  # letters as outlines: a text would need the reader's fonts
    "svg.hashsalt": "flexlink",  # the same results give the same bytes
}


def stacked_axes(rows: int, height: float, share: bool = True) -> tuple[Figure, list[Axes]]:
    """A figure of `rows` panels above each other, each `height` inches tall."""
    figure = Figure(figsize=(WIDTH, rows * height), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=share, squeeze=False)
    return figure, list(axes[:, 0])


def _steps(low: float, high: float) -> tuple[float, ...]:
    """Where in a decade ticks stand: 1, 2 and 5 if the axis spans little, 1 and 3 if it has but one power of ten."""
    if high < 40.0 * low:
        return (1.0, 2.0, 5.0)
    powers = math.floor(math.log10(high)) - math.ceil(math.log10(low)) + 1 if low > 0.0 else 2
    return (1.0,) if powers > 1 else (1.0, 3.0)


def tidy_linear(axes: Axes) -> None:
    """On linear axes of very small or large numbers, each tick with its power of ten instead of one in a corner."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "linear" and not 1e-3 <= max(map(abs, axis.get_view_interval())) < 1e4:
            axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))


def tidy_logs(axes: Axes) -> None:
    """On log axes, ticks at 1, 2 and 5 where they span little, else at powers of ten only: never on each other."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=_steps(low, high)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
            axis.set_minor_formatter(NullFormatter())


def legend_above(figure: Figure, axes: Axes, columns: int) -> Legend:
    """One legend over all panels, where it hides no curve."""
    handles, labels = axes.get_legend_handles_labels()
    return figure.legend(
        handles, labels, loc="outside upper left", ncols=columns, frameon=False, columnspacing=1.0, handletextpad=0.5
    )


def legend_over(axes: Axes, *, figure: Figure | None = None) -> None:
    """A legend above a panel, or above the whole figure: in as many columns as its words fit in."""
    handles, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    letters = 67 if figure is not None else 55  # that fit into the width of a figure, and of a panel beside its axis
    handle = 5  # letters that the sample of a line takes
    columns = max(1, min(int(letters / (max(map(len, labels)) + handle)), len(labels)))
    look: dict[str, Any] = {
        "ncols": columns, "frameon": False, "columnspacing": 1.0, "handletextpad": 0.5, "fontsize": 10.0,
        "borderaxespad": 0.2,
    }  # fmt: skip
    if figure is None:
        axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.0), **look)
    else:
        figure.legend(handles, labels, loc="outside upper left", **look)
        more_rows = -(-len(labels) // columns) - 2
        figure.set_figheight(figure.get_figheight() + 0.2 * max(0, more_rows))  # so that no panel shrinks


def colour_along(part: float) -> str:
    """A colour between pale and dark blue, for 0 … 1, on light and dark pages."""
    pale, dark = (0.66, 0.80, 0.92), (0.05, 0.32, 0.62)
    return str(to_hex([a + part * (b - a) for a, b in zip(pale, dark, strict=True)]))
