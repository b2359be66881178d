"""CPU time and number of coordinates against error for every formulation of a bending link: all runs, and the best."""

from __future__ import annotations

from collections.abc import Iterator

from matplotlib.axes import Axes

from flexlink.pages.colours import Look
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_over, stacked_axes, tidy_logs
from flexlink.pages.tables import columns_csv
from reports.formulations import WHAT, looks, series_of
from reports.prices import Run, front
from reports.results import Results
from validation.store import Series

SECTION = "trade"
TAKES = (WHAT,)
SHOWN = 1.0  # runs with an error of the arm's length or more are not drawn
SMALLEST = 1e-9  # errors below are drawn here: rounding
CAPTION = (
    "Left: more accurate; lower: cheaper, or fewer coordinates. Pale: all settings; lines: best of each formulation. "
    "Errors are relative to the length of the arm."
)


AIM = "error"


def draw(results: Results) -> Iterator[Picture]:
    """One picture per scene."""
    for case, series in series_of(results):
        figure, panels = stacked_axes(2, 3.2, share=False)
        shown = looks(list(dict.fromkeys(series.columns["formulation"].tolist())))
        for axes, cost in zip(panels, ("CPU time [s]", "coordinates"), strict=True):
            for name, look in shown.items():
                _formulation(axes, look, [run for run in _runs(series, cost) if run.who == name])
            label = cost if "[" in cost else f"{cost} [1]"
            axes.set(xscale="log", yscale="log", xlabel="error of the tip [1]", ylabel=label)
            axes.margins(0.08, 0.12)
            tidy_logs(axes)
        legend_over(panels[0], figure=figure)
        yield Picture(f"{case}.{series.name}", series.title, figure, CAPTION, columns_csv(series.columns))


def _formulation(axes: Axes, look: Look, many: list[Run]) -> None:
    """Draw all runs of a formulation, and the best."""
    styles = (many, look.marker, {"markersize": 2.5, "alpha": 0.3}), (
        front(many, AIM), f"{look.marker}-", {"markersize": 4.0, "markerfacecolor": "none", "label": look.name},
    )  # fmt: skip
    for runs, line, style in styles if many else ():
        axes.plot([run.errors[AIM] for run in runs], [run.seconds for run in runs], line, color=look.colour, **style)


def _runs(series: Series, cost: str) -> Iterator[Run]:
    """Runs with the formulation in place of the program, and this cost in place of the CPU time."""
    columns = (series.columns[name].tolist() for name in ("formulation", "settings", AIM, cost))
    for name, settings, error, value in zip(*columns, strict=True):
        if error < SHOWN:
            yield Run(name, settings, 0.0, value, 0, {AIM: max(error, SMALLEST)})
