"""CPU time against error, for the tip and the deflection: every run of a scene, and each program's Pareto front."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from flexlink.pages.colours import GREY
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import table_csv
from reports.placing import Word, place_words
from reports.prices import AIMS, LOOKS, OURS, Run, front, named, runs, works
from reports.results import Results

SECTION = "trade"
TAKES = ("work",)
APART = 20.0  # smallest ratio of the errors of two labelled runs
SHOWN = 1.0  # runs with a relative error of this size or larger are not drawn
CAPTION = (
    "Left: more accurate; lower: cheaper. Line: best runs of each program, with their methods. Errors are relative "
    "to the motion of the tip or its deflection."
)
HEADS = ("program", "method", "step [s] or tolerance [m]", "CPU time [s]", "evaluations", *AIMS, *(
    f"on its front, {word}" for word in AIMS.values()
))  # fmt: skip


def draw(results: Results) -> Iterator[Picture]:
    """One picture per scene."""
    for case, series in works(results):
        many = [run for run in runs(series) if run.seconds > 0.0]
        figure, panels = stacked_axes(len(AIMS), 3.2, share=False)
        for axes, (aim, word) in zip(panels, AIMS.items(), strict=True):
            for who in LOOKS:
                _contestant(axes, [run for run in many if run.who == who and 0.0 < run.errors[aim] < SHOWN], aim)
            axes.set(xscale="log", yscale="log", xlabel=f"error of the {word} [1]", ylabel="CPU time [s]")
            axes.margins(0.08, 0.12)
            tidy_logs(axes)
        panels[1].sharey(panels[0])
        panels[0].plot([], [], "o", color=GREY, markersize=2.5, alpha=0.6, label="other runs")
        legend_above(figure, panels[0], 3)
        for axes, aim in zip(panels, AIMS, strict=True):
            _name(axes, [run for run in many if 0.0 < run.errors[aim] < SHOWN], aim)
        yield Picture(f"{case}.{series.name}", series.title, figure, CAPTION, _csv(many))


def _contestant(axes: Axes, many: Sequence[Run], aim: str) -> None:
    if not many:
        return
    who, best = many[0].who, front(many, aim)
    look = LOOKS[who]
    styles = (many, look.marker, {"markersize": 2.5, "alpha": 0.3, "markeredgewidth": 0}), (
        best, f"{look.marker}-", {"markersize": 4.0, "label": look.name},
    )  # fmt: skip
    for part, line, style in styles:
        x, y = [run.errors[aim] for run in part], [run.seconds for run in part]
        axes.plot(x, y, line, color=look.colour, zorder=4 if who == OURS else 3, **style)


def _name(axes: Axes, many: Sequence[Run], aim: str) -> None:
    """Label the fronts with methods where there is room."""
    fronts = {who: front([run for run in many if run.who == who], aim) for who in LOOKS}
    words = [
        Word(run.method, run.errors[aim], run.seconds, LOOKS[who].colour)
        for who, best in fronts.items()
        for run in named(best, aim, APART)
    ]
    place_words(axes, words, [point for best in fronts.values() for point in _along(best, aim)])


def _along(best: Sequence[Run], aim: str) -> Iterator[tuple[float, float]]:
    """Points along the line of a front."""
    corners = [(run.errors[aim], run.seconds) for run in best]
    for (x, y), (to_x, to_y) in pairwise(corners):
        yield from zip(np.geomspace(x, to_x, 12).tolist(), np.geomspace(y, to_y, 12).tolist(), strict=True)
    yield from corners[-1:]


def _csv(many: Sequence[Run]) -> str:
    """Every run, and whether it is on its program's front."""
    best = {(who, aim): front([run for run in many if run.who == who], aim) for who in LOOKS for aim in AIMS}
    lines = (
        (run.who, run.method, run.setting, run.seconds, run.evaluations, *run.errors.values(),
         *("yes" if run in best[run.who, aim] else "" for aim in AIMS))
        for run in many
    )  # fmt: skip
    return table_csv(HEADS, lines)
