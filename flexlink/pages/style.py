"""One look for all figures: colour-blind safe, readable at the width of a phone, right on light and dark pages."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from flexlink.pages.numbers import number

WIDTH = 4.4  # in; on a 360 px screen the page shows this at 3/4, so that 11.5 pt reads as 9 pt
INK, PAPER = "#1c2024", "#fefefe"  # text and ground of the files; the page replaces both by its own

# Okabe and Ito's palette (2008), which stays apart for the common kinds of colour blindness
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"
GREY = "#8a8f94"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
NAMED_CURVES = 6  # of a panel; more do not fit into its legend
MARKERS = ("o", "s", "^", "D", "v", "P")

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


def tidy_logs(axes: Axes) -> None:
    """On log axes, ticks at 1, 2 and 5 where they span little, else at powers of ten only: never on each other."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 40.0 * low else (1.0,)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
            axis.set_minor_formatter(NullFormatter())


def legend_above(figure: Figure, axes: Axes, columns: int) -> None:
    """One legend over all panels, where it hides no curve."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper left", ncols=columns, frameon=False, columnspacing=1.0, handletextpad=0.5
    )


def legend_over(axes: Axes, *, figure: Figure | None = None) -> None:
    """A legend above a panel, or above the whole figure: in as many columns as its words fit in."""
    handles, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    letters = 56 if figure is not None else 45  # that fit into the width of a figure, and of a panel beside its axis
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
