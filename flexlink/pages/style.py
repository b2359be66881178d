"""Common look of all figures: colour-blind safe, readable on a phone, and on light and dark pages."""

import math
from pathlib import Path
from typing import Any

from matplotlib import rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from flexlink.pages.numbers import number

WIDTH = 5.2  # in; 11.5 pt then matches the page's text in half a column of 66 rem, and 11 px on a 390 px phone
NAMED_CURVES = 6  # largest number of curves in the legend of a panel

RC: dict[str, Any] = dict(
    rc_params_from_file(Path(__file__).parent / "data" / "figures.mplstyle", use_default_template=False)
)


def stacked_axes(rows: int, height: float, share: bool = True) -> tuple[Figure, list[Axes]]:
    """Return a figure of `rows` panels, one above another, each `height` inches tall."""
    figure = Figure(figsize=(WIDTH, rows * height), layout="constrained")
    return figure, list(figure.subplots(rows, 1, sharex=share, squeeze=False)[:, 0])


def _steps(low: float, high: float) -> tuple[float, ...]:
    """Ticks in a decade: 1, 2 and 5 on a short axis, 1 and 3 if it contains only one power of ten, otherwise 1."""
    if high < 40.0 * low:
        return (1.0, 2.0, 5.0)
    powers = math.floor(math.log10(high)) - math.ceil(math.log10(low)) + 1 if low > 0.0 else 2
    return (1.0,) if powers > 1 else (1.0, 3.0)


def tidy_linear(axes: Axes) -> None:
    """Write a power of ten at each tick of linear axes if the numbers are very small or large."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "linear" and not 1e-3 <= max(map(abs, axis.get_view_interval())) < 1e4:
            axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))


def tidy_logs(axes: Axes) -> None:
    """Place ticks of log axes so labels do not overlap: at 1, 2 and 5 on short axes, otherwise at powers of ten."""
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=_steps(low, high)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: number(value)))
            axis.set_minor_formatter(NullFormatter())


def legend_over(axes: Axes, *, figure: Figure | None = None) -> None:
    """Add a legend above a panel, or above the complete figure, with as many columns as fit."""
    handles, labels = axes.get_legend_handles_labels()
    if not labels:
        return
    letters = 67 if figure is not None else 55  # letters across a figure, or across a panel
    handle = 5  # width of the line sample, in letters
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
        figure.set_figheight(figure.get_figheight() + 0.2 * max(0, more_rows))  # keeps the size of the panels


def colour_along(part: float) -> str:
    """Colour between pale and dark blue for 0 … 1, visible on light and dark pages."""
    pale, dark = (0.66, 0.80, 0.92), (0.05, 0.32, 0.62)
    return str(to_hex([a + part * (b - a) for a, b in zip(pale, dark, strict=True)]))
