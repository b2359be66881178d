"""Work against precision: every run of a scene, and each contestant's front, of the tip and of the deflection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes

from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import table_csv
from reports.prices import AIMS, DISPLAY_NAMES, LOOKS, OURS, Run, front, named, runs, works
from reports.results import Results

SECTION = "trade"
TAKES = ("work",)
APART = 20.0  # in error, of two names
SHOWN = 1.0  # an error of everything or more is no result
CAPTION = (
    "Further left: more accurate; lower: cheaper. Faint: all runs. Line: Pareto front of each contestant, labelled "
    "where a method first joins it. Errors are relative to the motion or the deflection."
)
HEADS = ("contestant", "method", "step [s] or tolerance [m]", "CPU time [s]", "evaluations", *AIMS, *(
    f"on its front, {word}" for word in AIMS.values()
))  # fmt: skip


def draw(results: Results) -> Iterator[Picture]:
    """One picture a scene."""
    for case, series in works(results):
        many = [run for run in runs(series) if run.seconds > 0.0]
        figure, panels = stacked_axes(len(AIMS), 3.4)
        for axes, (aim, word) in zip(panels, AIMS.items(), strict=True):
            for who in LOOKS:
                _contestant(axes, [run for run in many if run.who == who and 0.0 < run.errors[aim] < SHOWN], aim)
            axes.set(xscale="log", yscale="log", xlabel=f"error of the {word} [1]", ylabel="CPU time [s]")
            axes.margins(0.06, 0.1)
            tidy_logs(axes)
        panels[1].sharey(panels[0])
        legend_above(figure, panels[0], 2)
        yield Picture(f"{case}.{series.name}", series.title, figure, CAPTION, _csv(many))


def _contestant(axes: Axes, many: Sequence[Run], aim: str) -> None:
    if not many:
        return
    who, best = many[0].who, front(many, aim)
    colour, marker = LOOKS[who]
    looks = (many, marker, {"markersize": 2.5, "alpha": 0.3, "markeredgewidth": 0}), (
        best, f"{marker}-", {"markersize": 4.0, "label": DISPLAY_NAMES.get(who, who)},
    )  # fmt: skip
    for part, line, look in looks:
        x, y = [run.errors[aim] for run in part], [run.seconds for run in part]
        axes.plot(x, y, line, color=colour, zorder=4 if who == OURS else 3, **look)
    for run in named(best, aim, APART):
        axes.annotate(
            run.method, (run.errors[aim], run.seconds), xytext=(0, -9 if who == OURS else 8), color=colour, fontsize=8,
            textcoords="offset points", ha="right" if who == OURS else "left", va="center",
        )  # fmt: skip


def _csv(many: Sequence[Run]) -> str:
    """Every run, and whether it is on its contestant's front."""
    best = {(who, aim): front([run for run in many if run.who == who], aim) for who in LOOKS for aim in AIMS}
    lines = (
        (run.who, run.method, run.setting, run.seconds, run.evaluations, *run.errors.values(),
         *("yes" if run in best[run.who, aim] else "" for aim in AIMS))
        for run in many
    )  # fmt: skip
    return table_csv(HEADS, lines)
