"""The chain against the beam: error by rule and number of hinges, its price, and the motions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexlink.pages.picture import Picture
from flexlink.pages.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    legend_above,
    stacked_axes,
)
from reports.curves import curves, put_labels
from reports.results import Results
from reports.tables import series_csv
from validation.store import Row, Series

SECTION = "physics"
TAKES = ("sweep", "price", "motion", "published")
LOOKS = {  # colour, marker, line of a rule, the same in all figures
    "paper": (VERMILION, "s", "-"),
    "midpoint": (BLUE, "o", "-"),
    "gauss": (GREEN, "^", "-"),
    "legendre": (PURPLE, "D", "-"),
    "gregory": (ORANGE, "v", "-"),
    "gauss_matched": (INK, "P", "-"),
    "clamped": (SKY, "P", "-"),
    "hencky": (GREY, "o", "--"),
    "open": (GREY, "s", ":"),
}
PLAIN = (GREY, ".", "-")
ROUNDING = 1e-15  # errors below say nothing


def draw(results: Results) -> Iterator[Picture]:
    """For each case its sweeps, then what it has of price and motion."""
    for case, found in results.series.items():
        rows = results.cases[case]
        title, shown = rows[0].title, {what: [s for s in found if s.what == what] for what in TAKES}
        if sweeps := shown["sweep"]:
            words = f"{sweeps[0].title} {READ}"
            yield Picture(f"{case}.sweep", f"{title}: error by rule", _sweeps(sweeps, rows), words, series_csv(*sweeps))
        for series in shown["price"]:
            yield Picture(f"{case}.price", f"{title}: price", _price(series), PRICE, series_csv(series))
        for series in shown["motion"]:
            yield Picture(f"{case}.motion", f"{title}: motion", _motion(series), MOTION, series_csv(series))


READ = (
    "StopTimes: numbers of hinges that were tried. The number beside a rule is its observed order, fitted to the last "
    "three marks of the first panel."
)
PRICE = (
    "Error of the first mode against the work of an explicit method: hinges × steps per second at RK4's largest stable "
    "step (EI = ρA = L = 1). Short segments at the ends of a link, as with legendre, need small steps."
)
MOTION = "Continuous reference, judged chain, and chain for comparison."


def _sweeps(sweeps: Sequence[Series], rows: Sequence[Row]) -> Figure:
    orders = {(row.varied["measure"], row.varied["rule"]): row.value for row in rows if row.quantity == "fitted order"}
    figure, all_axes = stacked_axes(len(sweeps), 2.9 if len(sweeps) > 1 else 3.4)
    for place, (axes, series) in enumerate(zip(all_axes, sweeps, strict=True)):
        _rules(axes, series, {rule: orders.get((series.part, rule)) for rule in LOOKS})
        if place < len(sweeps) - 1:
            axes.set_xlabel("")
    legend_above(figure, all_axes[0], 2)
    return figure


def _rules(axes: Axes, series: Series, orders: dict[str, float | None]) -> None:
    for curve in curves(series, "error"):
        colour, marker, line = LOOKS.get(curve.label, PLAIN)
        order = orders.get(curve.label)
        seen = np.isfinite(curve.y) & (curve.y > ROUNDING)
        label = curve.label if order is None else f"{curve.label}: {order:.1f}"
        axes.plot(curve.x[seen], curve.y[seen], line, marker=marker, color=colour, label=label, markersize=4)
    put_labels(axes, series)


def _price(series: Series) -> Figure:
    figure, (axes,) = stacked_axes(1, 3.4)
    _rules(axes, series, {})
    legend_above(figure, axes, 3)
    return figure


def _motion(series: Series) -> Figure:
    figure, (axes,) = stacked_axes(1, 2.9)
    for curve, (colour, line, marker) in zip(
        curves(series), ((INK, "", "o"), (VERMILION, "--", ""), (BLUE, "-", "")), strict=True
    ):
        axes.plot(curve.x, curve.y, linestyle=line or "none", marker=marker or None, color=colour, label=curve.label)
    put_labels(axes, series)
    legend_above(figure, axes, 2)
    return figure
