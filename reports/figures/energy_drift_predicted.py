"""Energy drift of frictionless runs: measured and predicted."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.colours import CYCLE, MARKERS
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes
from reports.curves import curves, put_labels
from reports.results import Results
from reports.tables import series_csv

SECTION = "trajectory"
TAKES = ("drift",)


def draw(results: Results) -> Iterator[Picture]:
    """Points are measured, lines are predicted, with one colour per method."""
    for case, series in results.showing(*TAKES):
        figure, (axes,) = stacked_axes(1, 3.2)
        predicted = list(curves(series, "predicted"))
        for place, (found, line) in enumerate(zip(curves(series, "measured"), predicted, strict=True)):
            colour, marker = CYCLE[place % len(CYCLE)], MARKERS[place % len(MARKERS)]
            axes.plot(found.x, found.y, marker, color=colour, label=f"{found.label} measured")
            axes.plot(line.x, line.y, "--", color=colour, label=f"{line.label} predicted")
        put_labels(axes, series)
        legend_above(figure, axes, 2)
        yield Picture(f"{case}.{series.name}", series.title, figure, CAPTION, series_csv(series))


CAPTION = (
    "Largest change of the total energy, which is constant in the exact motion. Prediction: numerical damping of the "
    "excited elastic modes, plus rounding."
)
