"""Distance of a chain's tip from the exact beam's; as points, because the tip vibrates too fast for a line."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.colours import BLUE
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports.curves import curves
from reports.results import Results
from reports.tables import series_csv

SECTION = "physics"
TAKES = ("beams",)
UNITS = ((1.0, "m"), (1e3, "mm"), (1e6, "µm"), (1e9, "nm"))
CAPTION = "Tip distance between flexlink's chain and exact beams (Exudyn). The tip vibrates between the samples."


def draw(results: Results) -> Iterator[Picture]:
    """One picture per scene."""
    for case, series in results.showing(*TAKES):
        found = list(curves(series))
        largest = max(float(curve.y.max()) for curve in found)
        factor, unit = next((each for each in UNITS if each[0] * largest >= 1.0), UNITS[-1])
        figure, (axes,) = stacked_axes(1, 2.7)
        for curve in found:
            axes.plot(curve.x, factor * curve.y, "o", color=BLUE)
        axes.set(xlabel=series.x_label, ylabel=f"tip distance [{unit}]")
        axes.set_ylim(bottom=0.0)
        title = f"{series.scene}: chain and exact beams"
        yield Picture(f"{case}.{series.name}", title, figure, CAPTION, series_csv(series))
