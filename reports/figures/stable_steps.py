"""Stable steps: how far what runs show is from what is predicted, every explicit method on every scene."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.pages.picture import Picture
from flexlink.pages.style import CYCLE, GREY, MARKERS, legend_above, stacked_axes, tidy_logs
from reports.curves import floats, groups
from reports.results import Results
from reports.tables import series_csv

SECTION = "extremes"
TAKES = ("stable steps",)
CAPTION = (
    "Relative difference between the largest stable step, found by bisection, and its prediction from the modes: one "
    "point for each scene and method. The lowest points reach the resolution of the bisection. Line: limit."
)


def draw(results: Results) -> Iterator[Picture]:
    """One picture a case."""
    for case, series in results.showing(*TAKES):
        figure, (axes,) = stacked_axes(1, 3.8)
        predicted, ratio = floats(series.columns["predicted [s]"]), floats(series.columns["observed / predicted"])
        for place, (method, rows) in enumerate(groups(series)):
            axes.plot(
                predicted[rows], np.abs(ratio[rows] - 1.0), MARKERS[place % len(MARKERS)],
                color=CYCLE[place % len(CYCLE)], markersize=3.5, markeredgewidth=0, label=method,
            )  # fmt: skip
        for limit in {row.tolerance for row in results.cases[case] if row.tolerance and row.varied}:
            axes.axhline(limit, color=GREY, linewidth=1.0)
        axes.set(xscale="log", yscale="log", xlabel="predicted [s]", ylabel="|observed / predicted − 1| [1]")
        tidy_logs(axes)
        legend_above(figure, axes, 4)
        yield Picture(f"{case}.{series.name}", series.title, figure, CAPTION, series_csv(series))
