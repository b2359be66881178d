"""Cost against accuracy of models, formulations and programs."""

from __future__ import annotations

import itertools
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

from flexlink.pages.colours import GREEN, GREY, INK, ORANGE, PAPER, SKY, Look
from flexlink.pages.numbers import JOIN, number
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, legend_over, stacked_axes, tidy_logs
from flexlink.pages.tables import columns_csv, table_csv
from reports.contests import ADVISE, AIM, CONTESTS, Contest, Scene, best, fronts, scenes
from reports.curves import legend_above
from reports.figures import figure
from reports.formulations import WHAT, looks, series_of
from reports.prices import AIMS, LOOKS, OURS, Price, Run, errors, front, named, prices, runs, works
from reports.results import Results
from validation.store import Series

APART = 20.0  # smallest ratio of the errors of two labelled runs
SHOWN = 1.0  # runs with a relative error of this size or larger are not drawn
CAPTION = (
    "Farther left is more accurate; lower is cheaper. Lines: best runs of each program, with methods. Errors are "
    "relative to the tip's motion or its deflection."
)
HEADS = ("program", "method", "step [s] or tolerance [m]", "CPU time [s]", "evaluations", *AIMS, *(
    f"on its front, {word}" for word in AIMS.values()
))  # fmt: skip


@figure("trade", "work")
def trade_fronts(results: Results) -> Iterator[Picture]:
    """CPU time against error, for the tip and the deflection: every run of a scene, and each program's Pareto front.

    One picture per scene.
    """
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


RATIOS = (
    "Each mark is the cheapest run of a program with that error. Left of the line, flexlink is slower. Hollow: "
    "extrapolated in favour of the other."
)
LETTERS = 74  # letters in a line of a scene's description
WRITTEN: dict[str, Any] = {
    "fontsize": 8.5, "va": "top", "bbox": {"facecolor": PAPER, "edgecolor": "none", "pad": 0.3},
}  # fmt: skip
HEIGHT, ROOM = 0.15, 0.24  # height of a line of the description, and of the marks below it [in]
RATIO_HEADS = (
    "scene",
    "program",
    "its cheapest",
    "CPU time [ms]",
    "flexlink's cheapest",
    "CPU time of flexlink [ms]",
    "ratio [1]",
)


@figure("trade")
def trade_ratios(results: Results) -> Iterator[Picture]:
    """CPU time of other programs relative to flexlink's at equal error, by scene; right of the line flexlink is faster.

    One picture per error of the tip.
    """
    scenes = list(works(results))
    about = {series.scene: series.title.removeprefix(f"{series.scene}: ") for _, series in scenes}
    for error in errors(results, AIM):
        found = {series.scene: prices(results, case, series, AIM, error) for case, series in scenes}
        found = {scene: price for scene, price in found.items() if OURS in price and len(price) > 1}
        if found:
            yield _ratios_picture(error, found, about)


def _ratios_picture(error: float, found: dict[str, dict[str, Price]], about: dict[str, str]) -> Picture:
    scenes = sorted(found, key=lambda scene: min(_ratios(found[scene]).values()))
    words = {scene: textwrap.fill(_with_units(f"{scene}: {about[scene]}"), LETTERS) for scene in scenes}
    tops = np.cumsum([0.0, *(ROOM + HEIGHT * (words[scene].count("\n") + 1) for scene in scenes)])
    figure, (axes,) = stacked_axes(1, 1.2 + float(tops[-1]))
    places = dict(zip(scenes, tops[1:] - 0.4 * ROOM, strict=True))
    for who, look in LOOKS.items():
        known = [scene for scene in scenes if who != OURS and who in found[scene]]
        if known:
            axes.plot([], [], look.marker, color=look.colour, linestyle="", label=look.name)
        for scene in known:
            axes.plot(
                found[scene][who].time / found[scene][OURS].time, places[scene], look.marker, color=look.colour,
                markerfacecolor="none" if found[scene][who].remark else look.colour, linestyle="",
            )  # fmt: skip
    for scene, top in zip(scenes, tops, strict=False):
        axes.axhline(places[scene], color=GREY, linewidth=0.5, zorder=0)
        axes.text(0.012, top + 0.03, words[scene], transform=axes.get_yaxis_transform(), **WRITTEN)
    axes.axvline(1.0, color=INK, label="equal to flexlink")
    axes.set(xscale="log", xlabel="CPU time / flexlink's CPU time [1]", yticks=[], ylim=(tops[-1] + 0.1, -0.1))
    axes.grid(False, axis="y")
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    title = f"CPU time of other programs relative to flexlink's, tip error {number(error)} of the motion"
    return Picture(f"trade_ratios.{error:g}", title, figure, RATIOS, _ratios_csv(found))


def _with_units(words: str) -> str:
    """Keep numbers and their units on one line."""
    return re.sub(r"(?<=\d) (?=\w)", JOIN, words)


def _ratios(price: dict[str, Price]) -> dict[str, float]:
    return {who: each.time / price[OURS].time for who, each in price.items() if who != OURS}


def _ratios_csv(found: dict[str, dict[str, Price]]) -> str:
    lines = (
        (scene, who, price[who].by, price[who].time, price[OURS].by, price[OURS].time, ratio)
        for scene, price in found.items()
        for who, ratio in _ratios(price).items()
    )
    return table_csv(RATIO_HEADS, lines)


TYPE_LOOKS = {"rigid": (GREY, "s"), "T1": (ORANGE, "o"), "T2": (GREEN, "^"), "T3": (SKY, "D")}
LEFT_ROOM = 0.15  # factor on the left limit of the axis, to leave room for the first label
NEAR = 4.0  # smallest ratio of the errors of two labelled runs
MODELS = (
    "A mark is a run with a link type, hinges, rule, method and step. Line: the best runs. Vertical edges: errors of "
    "link types, which hinges cannot reduce."
)


@figure("trade", "models")
def trade_models(results: Results) -> Iterator[Picture]:
    """Model needed for a given error: every link type, rule, number of hinges, method and step, and their Pareto front.

    One picture per scene.
    """
    for case, series in results.showing("models"):
        many = [run for run in _model_runs(series) if 0.0 < run.errors[AIM] < SHOWN]
        best = front(many, AIM)
        figure, (axes,) = stacked_axes(1, 4.2)
        for who, (colour, marker) in TYPE_LOOKS.items():
            if not (own := [run for run in many if run.who == who]):
                continue
            x, y = [run.errors[AIM] for run in own], [run.seconds for run in own]
            axes.plot(x, y, marker, color=colour, label=who, markersize=4.0, alpha=0.6, markeredgewidth=0)
        axes.plot([run.errors[AIM] for run in best], [run.seconds for run in best], "-", color=INK)
        axes.set(xscale="log", yscale="log", xlabel="error of the tip [1]", ylabel="CPU time [s]")
        axes.margins(0.1, 0.1)
        axes.set_xlim(LEFT_ROOM * axes.get_xlim()[0])
        tidy_logs(axes)
        legend_above(figure, axes, 4)
        words = [Word(_cut(run), run.errors[AIM], run.seconds, INK) for run in named(best, AIM, NEAR)]
        place_words(axes, words, [(run.errors[AIM], run.seconds) for run in many])
        yield Picture(f"{case}.{series.name}", series.title, figure, MODELS, columns_csv(series.columns))


def _cut(run: Run) -> str:
    """Link type, number of hinges and rule of a run."""
    return "rigid" if run.who == "rigid" else f"{run.who}, {run.method}"


def _model_runs(series: Series) -> Iterator[Run]:
    """Runs, with the link type in place of the program, and number of hinges and rule in place of the method."""
    names = ("type", "rule", "hinges", "setting", "error", "CPU time [s]")
    for flex, rule, hinges, setting, error, seconds in zip(*(series.columns[n].tolist() for n in names), strict=True):
        yield Run(flex, f"{hinges} {rule}", setting, seconds, 0, {AIM: error})


ROUNDING = 1e-9  # errors below are drawn here: rounding
FORMULATIONS = (
    "Farther left is more accurate; lower is cheaper or smaller. Pale: all runs; lines: best runs of each formulation. "
    "Errors are relative to the arm's length."
)


@figure("trade", WHAT)
def trade_formulations(results: Results) -> Iterator[Picture]:
    """CPU time and number of coordinates against error for every formulation of a bending link: all runs, and the best.

    One picture per scene.
    """
    for case, series in series_of(results):
        figure, panels = stacked_axes(2, 3.2, share=False)
        shown = looks(list(dict.fromkeys(series.columns["formulation"].tolist())))
        for axes, cost in zip(panels, ("CPU time [s]", "coordinates"), strict=True):
            for name, look in shown.items():
                _formulation(axes, look, [run for run in _formulation_runs(series, cost) if run.who == name])
            label = cost if "[" in cost else f"{cost} [1]"
            axes.set(xscale="log", yscale="log", xlabel="error of the tip [1]", ylabel=label)
            axes.margins(0.08, 0.12)
            tidy_logs(axes)
        legend_over(panels[0], figure=figure)
        yield Picture(f"{case}.{series.name}", series.title, figure, FORMULATIONS, columns_csv(series.columns))


def _formulation(axes: Axes, look: Look, many: list[Run]) -> None:
    """Draw all runs of a formulation, and the best."""
    styles = (many, look.marker, {"markersize": 2.5, "alpha": 0.3}), (
        front(many, AIM), f"{look.marker}-", {"markersize": 4.0, "markerfacecolor": "none", "label": look.name},
    )  # fmt: skip
    for part, line, style in styles if many else ():
        axes.plot([run.errors[AIM] for run in part], [run.seconds for run in part], line, color=look.colour, **style)


def _formulation_runs(series: Series, cost: str) -> Iterator[Run]:
    """Runs with the formulation in place of the program, and this cost in place of the CPU time."""
    columns = (series.columns[name].tolist() for name in ("formulation", "settings", AIM, cost))
    for name, settings, error, value in zip(*columns, strict=True):
        if error < SHOWN:
            yield Run(name, settings, 0.0, value, 0, {AIM: max(error, ROUNDING)})


FEWEST = 2  # scenes: with one, the picture of its formulations shows the same
LARGEST, SMALLEST = 0.1, 1e-6  # errors that are drawn
ERROR = 1e-3  # of the overview
ACROSS, TALL = 2, 1.75  # panels side by side; height of a row of panels [in]
PANELS = (
    "Farther left is more accurate; lower is cheaper. Lines: best runs of each contestant. Stars: what advise picks "
    "for errors of 0.01, 0.001, 0.0001."
)
COSTS = (
    "Each mark is the cheapest run of a contestant that reaches the error; farther left is cheaper. Stars: what advise "
    "picks."
)


@figure("trade")
def trade_page(results: Results) -> Iterator[Picture]:
    """The trade on one page: a small panel per scene with every contestant's front, and an overview of costs.

    The page of panels, and the overview.
    """
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
    return Picture("trade_page", title, figure, PANELS, _page_csv(found))


def _fronts(axes: Axes, scene: Scene) -> None:
    for contest, shown in fronts(scene, LARGEST, SMALLEST):
        x, y = [run.errors[AIM] for run in shown], [1e3 * run.seconds for run in shown]
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
        costs = {contest: best(tried, ERROR) for contest, tried in scene.runs.items()}
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
    return Picture("trade_overview", title, figure, COSTS, _page_csv(found))


def _page_csv(found: Sequence[Scene]) -> str:
    heads = ("scene", "contestant", "formulation", "error [1]", "CPU time [s]", "on its front")
    lines = []
    for scene in found:
        on_front = [run for _, shown in fronts(scene, float("inf"), 0.0) for run in shown]
        for run in (*itertools.chain(*scene.runs.values()), *scene.picks):
            known = "yes" if run in on_front else ""
            lines.append((scene.name, run.who, run.method, run.errors[AIM], run.seconds, known))
    return table_csv(heads, lines)


LETTER, LINE_HEIGHT = 0.60, 1.25  # mean width of a letter and height of a line, relative to the font size
PLACES = ((0, -9), (0, 9), (1, -7), (1, 7), (-1, -7), (-1, 7), (1, 0), (-1, 0), (1, -14), (-1, 14), (1, 14), (-1, -14))
"""Candidate positions of a label: side (-1 left, 0 centred, 1 right of the point) and height above the point [pt]."""
GAP = 5.0  # distance between a point and its label [pt]
COVERED = 3  # most points that a label may cover


class Word(NamedTuple):
    """A label and the point that it names, in axes units."""

    text: str
    x: float
    y: float
    colour: str


def place_words(axes: Axes, words: Sequence[Word], points: Iterable[tuple[float, float]], size: float = 8.5) -> None:
    """Write the labels, except those that would cover another label or more than `COVERED` points.

    Call it when the axes are complete, because it computes the layout.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # computes positions on the page
    unit = figure.dpi / 72.0
    dots = axes.transData.transform(list(points) or np.empty((0, 2)))
    room, taken = axes.get_window_extent(), list[Bbox]()
    for word in words:
        at = axes.transData.transform((word.x, word.y))
        boxes = [(side, up, _box(at, word.text, side, up, size, unit)) for side, up in PLACES]
        free = [
            (_covered(box, dots), number, side, up, box)
            for number, (side, up, box) in enumerate(boxes)
            if not any(box.overlaps(other) for other in taken) and _inside(box, room)
        ]
        if free and (best := min(free))[0] <= COVERED:
            _, _, side, up, box = best
            taken.append(box)
            axes.annotate(
                word.text, (word.x, word.y), xytext=(side * GAP, up), textcoords="offset points", color=word.colour,
                fontsize=size, ha={-1: "right", 0: "center", 1: "left"}[side], va="center",
            )  # fmt: skip


def _box(at: NDArray[np.float64], text: str, side: int, up: int, size: float, unit: float) -> Bbox:
    width, height = LETTER * size * len(text) * unit, LINE_HEIGHT * size * unit
    left = at[0] + side * GAP * unit - {-1: width, 0: width / 2, 1: 0.0}[side]
    return Bbox.from_bounds(left, at[1] + up * unit - height / 2, width, height)


def _covered(box: Bbox, dots: NDArray[np.float64]) -> int:
    inside = (dots[:, 0] > box.x0) & (dots[:, 0] < box.x1) & (dots[:, 1] > box.y0) & (dots[:, 1] < box.y1)
    return int(inside.sum())


def _inside(box: Bbox, room: Bbox) -> bool:
    return bool(box.x0 >= room.x0 and box.x1 <= room.x1 and box.y0 >= room.y0 and box.y1 <= room.y1)
