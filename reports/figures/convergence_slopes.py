"""Measured order of convergence: error against step, with the fitted slope."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.colours import CYCLE, MARKERS
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes
from reports.curves import curves, put_labels
from reports.results import Results
from reports.tables import series_csv

SECTION = "integrators"
TAKES = ("convergence",)


def draw(results: Results) -> Iterator[Picture]:
    """One picture per case."""
    for case, rows in results.of_kind("convergence"):
        slopes = {row.varied["method"]: row.value for row in rows if row.quantity == "slope"}
        for series in (s for s in results.series[case] if s.what in TAKES):
            figure, (axes,) = stacked_axes(1, 3.2)
            for place, curve in enumerate(curves(series)):
                label = f"{curve.label}, slope {number(slopes.get(curve.label))}"
                axes.plot(curve.x, curve.y, MARKERS[place] + "-", color=CYCLE[place], label=label)
            put_labels(axes, series)
            legend_above(figure, axes, 2)
            words = f"{series.title}. Slopes are least-squares fits."
            yield Picture(f"{case}.{series.name}", rows[0].title, figure, words, series_csv(series))
