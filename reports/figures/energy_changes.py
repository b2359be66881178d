"""Where the energy goes: each part's change since the start."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.picture import Picture
from flexlink.pages.style import CYCLE, INK, legend_above, stacked_axes
from reports.curves import curves
from reports.results import Results
from reports.tables import series_csv

SECTION = "trajectory"
TAKES = ("energy",)


def draw(results: Results) -> Iterator[Picture]:
    """One picture a scene of which a case stored the motion."""
    for case, series in results.showing(*TAKES):
        if not series.engine:
            figure, (axes,) = stacked_axes(1, 3.0)
            for place, curve in enumerate(curves(series)):
                total = curve.label == "total"
                colour, line = (INK, "--") if total else (CYCLE[place % len(CYCLE)], "-")
                axes.plot(curve.x, curve.y - curve.y[0], color=colour, linestyle=line, label=curve.label)
            axes.set(xlabel=series.x_label, ylabel="change of energy [J]")
            legend_above(figure, axes, 2)
            title = f"{series.scene}: where the energy goes"
            words = "Change of each energy since the start."
            yield Picture(f"{case}.{series.name}", title, figure, words, series_csv(series))
