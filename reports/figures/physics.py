"""Segment chain compared with the continuous beam: error by rule and number of hinges, its cost, and motions."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexlink.pages.colours import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes, tidy_logs
from reports.curves import curves, legend_above, put_labels
from reports.figures import figure
from reports.results import Results
from reports.tables import series_csv
from validation.store import Row, Series

LOOKS = {  # rule → colour, marker, line style; the same in all figures
    "paper": (VERMILION, "s", "-"),
    "midpoint": (BLUE, "o", "-"),
    "gauss": (GREEN, "^", "-"),
    "legendre": (PURPLE, "D", "-"),
    "gregory": (ORANGE, "v", "-"),
    "gauss_matched": (GREEN, "^", "--"),
    "gauss_rotation": (GREEN, "^", ":"),
    "lobatto2": (INK, "<", "-"),
    "lobatto2_rotation": (INK, "<", ":"),
    "lobatto4": (INK, ">", "--"),
    "clamped": (SKY, "P", "-"),
    "hencky": (GREY, "o", "--"),
    "open": (GREY, "s", ":"),
}
PLAIN = (GREY, ".", "-")
LETTERS = 22  # letters that fit along the height of a panel
ROUNDING = 1e-15  # smaller errors are rounding errors


@figure("physics", "sweep", "price", "motion", "published")
def physics(results: Results) -> Iterator[Picture]:
    """Pictures of each case: its sweeps, then its cost and motion if stored."""
    for case, found in results.series.items():
        rows = results.cases[case]
        title, shown = (
            rows[0].title,
            {what: [s for s in found if s.what == what] for what in ("sweep", "price", "motion")},
        )
        if sweeps := shown["sweep"]:
            words = READ
            yield Picture(f"{case}.sweep", f"{title}: error by rule", _sweeps(sweeps, rows), words, series_csv(*sweeps))
        for series in shown["price"]:
            yield Picture(f"{case}.price", f"{title}: cost", _price(series), PRICE, series_csv(series))
        for series in shown["motion"]:
            yield Picture(f"{case}.motion", f"{title}: motion", _motion(series), MOTION, series_csv(series))


READ = (
    "Error against hinges per link. Orders are fitted to the three largest numbers of hinges with errors above "
    "rounding."
)
PRICE = (
    "Error of the first mode against the work of RK4 at its largest stable step (EI = ρA = L = 1). Short end segments, "
    "as with legendre, require small steps."
)
MOTION = (
    "Upper panel: the continuous beam, the tested chain, and a chain for comparison. Lower panel: errors of both "
    "chains."
)


def _sweeps(sweeps: Sequence[Series], rows: Sequence[Row]) -> Figure:
    orders = {(row.varied["measure"], row.varied["rule"]): row.value for row in rows if row.quantity == "fitted order"}
    figure, all_axes = stacked_axes(len(sweeps), 2.9 if len(sweeps) > 1 else 3.4)
    for place, (axes, series) in enumerate(zip(all_axes, sweeps, strict=True)):
        _rules(axes, series, {rule: orders.get((series.part, rule)) for rule in LOOKS})
        axes.set_ylabel(textwrap.fill(axes.get_ylabel(), LETTERS))
        if place < len(sweeps) - 1:
            axes.set_xlabel("")
    legend_above(figure, all_axes[0], 2)
    return figure


def _rules(axes: Axes, series: Series, orders: dict[str, float | None]) -> None:
    for curve in curves(series, "error"):
        colour, marker, line = LOOKS.get(curve.label, PLAIN)
        order = orders.get(curve.label)
        seen = np.isfinite(curve.y) & (curve.y > ROUNDING)
        label = curve.label if order is None else f"{curve.label}: order {order:.1f}"
        axes.plot(curve.x[seen], curve.y[seen], line, marker=marker, color=colour, label=label, markersize=4)
    put_labels(axes, series)


def _price(series: Series) -> Figure:
    figure, (axes,) = stacked_axes(1, 3.4)
    _rules(axes, series, {})
    axes.set_xlabel("hinges × RK4 steps [1/s]")
    legend_above(figure, axes, 3)
    return figure


def _motion(series: Series) -> Figure:
    figure, (motion, error) = stacked_axes(2, 2.2)
    reference, *chains = curves(series)
    motion.plot(reference.x, reference.y, "o", color=INK, label=reference.label, markersize=4.0)
    for curve, (colour, line) in zip(chains, ((VERMILION, "--"), (BLUE, "-")), strict=True):
        motion.plot(curve.x, curve.y, line, color=colour, label=curve.label)
        off = np.abs(curve.y - reference.y)
        error.plot(curve.x[off > 0.0], off[off > 0.0], line, color=colour)
    put_labels(motion, series)
    motion.set_xlabel("")
    error.set(yscale="log", xlabel=series.x_label, ylabel="difference [m]")
    tidy_logs(error)
    legend_above(figure, motion, 2)
    return figure
