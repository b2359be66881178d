"""The trade on one page: a small panel per scene with every contestant's front, and an overview of costs."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flexlink.pages.colours import GREY, INK
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, tidy_logs
from flexlink.pages.tables import table_csv
from reports.contests import ADVISE, AIM, CONTESTS, Contest, Scene, best, fronts, scenes
from reports.results import Results

SECTION = "trade"
TAKES: tuple[str, ...] = ()
FEWEST = 2  # scenes: with one, the picture of its formulations shows the same
LARGEST, SMALLEST = 0.1, 1e-6  # errors that are drawn
ERROR = 1e-3  # of the overview
ACROSS, TALL = 2, 1.75  # panels side by side; height of a row of panels [in]
PANELS = (
    "Left: more accurate; lower: cheaper. Best runs of each contestant; stars: what advise picks for errors of "
    "1/100, 1/1000 and 1/10,000."
)
COSTS = (
    "Farther left: cheaper. The best run of each contestant that reaches the error; stars: the run that advise picks."
)


def draw(results: Results) -> Iterator[Picture]:
    """The page of panels, and the overview."""
    found = scenes(results)
    if len(found) >= FEWEST:
        yield _panels(found)
        yield _overview(found)


def _panels(found: Sequence[Scene]) -> Picture:
    rows = -(-len(found) // ACROSS)
    figure = Figure(figsize=(WIDTH, rows * TALL + 1.5), layout="constrained")
    panels = figure.subplots(rows, ACROSS, sharex=True, squeeze=False).flat
    for axes, scene in itertools.zip_longest(panels, found):
        if scene is None:
            axes.set_axis_off()
            continue
        _fronts(axes, scene)
        axes.set_title(scene.name.replace("_", " "), loc="left")
        axes.set(xscale="log", yscale="log", xlim=(SMALLEST, LARGEST))
        axes.margins(y=0.1)
        tidy_logs(axes)
    figure.supxlabel("error of the tip, of the length [1]", fontsize=11.5)
    figure.supylabel("CPU time [ms]", fontsize=11.5)
    _legend(figure, found)
    title = f"CPU time against error in {len(found)} scenes"
    return Picture("trade_page", title, figure, PANELS, _csv(found))


def _fronts(axes: Axes, scene: Scene) -> None:
    for contest, runs in fronts(scene, LARGEST, SMALLEST):
        x, y = [run.errors[AIM] for run in runs], [1e3 * run.seconds for run in runs]
        axes.plot(x, y, zorder=4 if contest.ours else 3, **_style(contest))
    x, y = [run.errors[AIM] for run in scene.picks], [1e3 * run.seconds for run in scene.picks]
    axes.plot(x, y, "*", color=INK, markersize=8.0, markeredgewidth=0, zorder=5)


def _style(contest: Contest) -> dict[str, Any]:
    width, size = (2.6, 4.5) if contest.ours else (1.0, 3.5)
    return {
        "color": contest.look.colour, "marker": contest.look.marker, "linestyle": contest.line, "linewidth": width,
        "markersize": size, "markeredgewidth": 0.8 if contest.look.marker in "PX" else 0,
    }  # fmt: skip


def _legend(figure: Figure, found: Sequence[Scene]) -> None:
    """A legend above all panels, of the contestants that any scene has."""
    there = [contest for contest in CONTESTS if any(scene.runs[contest] for scene in found)]
    handles = [Line2D([], [], label=each.look.name, **_style(each)) for each in there]
    handles.append(Line2D([], [], color=INK, marker="*", markersize=8.0, linestyle="", label=ADVISE))
    figure.legend(
        handles=handles, loc="outside upper left", ncols=3, frameon=False, columnspacing=0.9, handletextpad=0.4,
        fontsize=10.0,
    )  # fmt: skip


def _overview(found: Sequence[Scene]) -> Picture:
    figure = Figure(figsize=(WIDTH, 0.36 * len(found) + 1.7), layout="constrained")
    axes = figure.subplots()
    for place, scene in enumerate(found):
        costs = {contest: best(runs, ERROR) for contest, runs in scene.runs.items()}
        times = [1e3 * run.seconds for run in costs.values() if run]
        if times:
            axes.plot([min(times), max(times)], [place, place], color=GREY, linewidth=0.8, zorder=1)
        for contest, run in costs.items():
            if run:
                size = 8.0 if contest.ours else 5.5
                axes.plot(
                    1e3 * run.seconds, place, contest.look.marker, color=contest.look.colour, markersize=size,
                    markeredgewidth=0, zorder=2,
                )  # fmt: skip
        for run in scene.picks:
            if run.setting == ERROR:
                axes.plot(
                    1e3 * run.seconds, place, "*", color=INK, markersize=9.0, markeredgecolor="w",
                    markeredgewidth=0.5, zorder=5,
                )  # fmt: skip
    axes.set_yticks(range(len(found)), [scene.name.replace("_", " ") for scene in found])
    axes.set_ylim(len(found) - 0.4, -0.6)
    axes.set(xscale="log", xlabel=f"CPU time for an error of {ERROR:g} of the length [ms]")
    tidy_logs(axes)
    _legend(figure, found)
    title = f"CPU time of every contestant for one error in {len(found)} scenes"
    return Picture("trade_overview", title, figure, COSTS, _csv(found))


def _csv(found: Sequence[Scene]) -> str:
    heads = ("scene", "contestant", "formulation", "error [1]", "CPU time [s]", "on its front")
    lines = []
    for scene in found:
        on_front = [run for _, runs in fronts(scene, float("inf"), 0.0) for run in runs]
        for run in (*itertools.chain(*scene.runs.values()), *scene.picks):
            known = "yes" if run in on_front else ""
            lines.append((scene.name, run.who, run.method, run.errors[AIM], run.seconds, known))
    return table_csv(heads, lines)
