"""Energy balance: change of each kind of energy since the start; the energy of the springs has a separate scale."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.colours import BLUE, GREEN, INK, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_linear
from reports.curves import curves
from reports.results import Results
from reports.tables import series_csv

SECTION = "trajectory"
TAKES = ("energy",)
LOOKS = {"kinetic": (BLUE, "-"), "gravity": (VERMILION, "-"), "elastic": (GREEN, "-"), "total": (INK, "--")}
OWN_SCALE = "elastic"  # often thousands of times smaller than the kinetic and potential energy


def draw(results: Results) -> Iterator[Picture]:
    """One picture per scene with a stored motion."""
    for case, series in results.showing(*TAKES):
        if not series.engine:
            figure, (upper, lower) = stacked_axes(2, 2.1)
            for curve in curves(series):
                colour, line = LOOKS[curve.label]
                panel = lower if curve.label == OWN_SCALE else upper
                panel.plot(curve.x, curve.y - curve.y[0], color=colour, linestyle=line, label=curve.label)
            upper.set_ylabel("energy change [J]")
            lower.set(xlabel=series.x_label, ylabel="elastic [J]")
            tidy_linear(lower)
            legend_above(figure, upper, 3)
            title = f"{series.scene}: energy balance"
            yield Picture(f"{case}.{series.name}", title, figure, CAPTION, series_csv(series))


CAPTION = "Change of each energy since the start. Lower panel: elastic energy of the springs, on a separate scale."
