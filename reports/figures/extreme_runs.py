"""Runs at extreme parameters that are wrong without a warning, in flexlink and other engines: one cell per value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from flexlink.pages.colours import ENGINES, GREEN, GREY, PALE, PAPER, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from flexlink.pages.tables import table_csv
from reports.cells import fill, key, panels_beside, with_range
from reports.results import Results

SECTION = "extremes"
TAKES = ()  # the series is already listed by `outcomes.py`, which also draws it
KNOWN = ("within", "near", "warned", "false doubt")
REFUSED = "error"
NOTHING, STOPPED, GOOD, WRONG = range(4)  # runs without reference; all refused; none wrong; some wrong
COLOURS = (PALE, GREY, GREEN, VERMILION)
WORDS = ("no reference", "all refused or stopped", "none wrong", "number of wrong runs")
TITLE = "Runs that are wrong without a warning"
ALONE = (
    "One parameter at a time, all scenes. Wrong: the tip error exceeds ten tolerances (fixed steps: 5 % of the motion) "
    "without a warning. The CSV has all runs."
)
PAIRS = (
    "Two parameters at a time, a few values each. Wrong: the tip error exceeds ten tolerances (fixed steps: 5 % of the "
    "motion) without a warning."
)
AND = " and "
"""Separator between the parameter names of a cell."""


class Runs(NamedTuple):
    """Columns of the runs of a map."""

    engine: NDArray[np.str_]
    axes: NDArray[np.str_]
    varied: NDArray[np.str_]
    outcome: NDArray[np.str_]
    recipe: NDArray[np.str_]


class Grid(NamedTuple):
    """Names of rows, names of columns if there are any, and the runs of each cell (row, column)."""

    rows: list[str]
    columns: list[str]
    members: Mapping[tuple[int, int], NDArray[np.bool_]]


def draw(results: Results) -> Iterator[Picture]:
    """For each case with other engines: a map with one parameter at a time, and a map with pairs of parameters."""
    for case, series in results.showing("outcomes"):
        runs = Runs(*(np.asarray(series.columns[name]).astype(str) for name in Runs._fields))
        if set(runs.engine.tolist()) <= {"native"}:
            continue
        for name, caption, grid in (("alone", ALONE, _alone(runs)), ("pairs", PAIRS, _pairs(runs))):
            if grid.members:
                yield _picture(f"{case}.{name}", caption, grid, runs)


def _alone(runs: Runs) -> Grid:
    names = [name for name in dict.fromkeys(runs.axes.tolist()) if name and AND not in name]
    members = {
        (row, place): (runs.axes == name) & (runs.varied == value)
        for row, name in enumerate(names)
        for place, value in enumerate(dict.fromkeys(runs.varied[runs.axes == name].tolist()))
    }
    varied = {name: list(dict.fromkeys(runs.varied[runs.axes == name].tolist())) for name in names}
    return Grid([with_range(name, varied[name]) for name in names], [], members)


def _pairs(runs: Runs) -> Grid:
    pairs = [name.split(AND) for name in dict.fromkeys(runs.axes.tolist()) if name.count(AND) == 1]
    names = list(dict.fromkeys(name for pair in pairs for name in pair))
    members = {
        (max(places), min(places)): runs.axes == AND.join(pair)
        for pair in pairs
        if (places := [names.index(name) for name in pair])
    }
    numbered = [f"{name} · {k}" for k, name in enumerate(names, 1)]
    return Grid(numbered, [str(k) for k in range(1, len(names) + 1)], members)


def _picture(name: str, caption: str, grid: Grid, runs: Runs) -> Picture:
    seen = [engine for engine in ENGINES if engine in runs.engine]
    figure, panels = panels_beside(seen, grid.rows, 1.0) if not grid.columns else _stacked(seen, grid)
    rows = [row for axes, engine in zip(panels, seen, strict=True) for row in _panel(axes, grid, runs, engine)]
    key(figure, list(zip(COLOURS, WORDS, strict=True)), 2)
    csv = table_csv(("engine", "axes", "varied", "runs", "wrong without a word", "recipe of the first"), rows)
    return Picture(name, TITLE, figure, caption, csv)


def _stacked(engines: Sequence[str], grid: Grid) -> tuple[Figure, list[Axes]]:
    """Panels one above the other, for maps with as many columns as rows."""
    figure, panels = stacked_axes(len(engines), 0.6 + 0.2 * len(grid.rows))
    for axes in panels:
        axes.set_yticks(np.arange(len(grid.rows)) + 0.5, grid.rows, fontsize=8)
        axes.set_xticks(np.arange(len(grid.columns)) + 0.5, grid.columns, fontsize=8)
        axes.tick_params(length=0)
        axes.set_ylim(len(grid.rows), 0)
        axes.grid(False)
    return figure, panels


def _panel(axes: Axes, grid: Grid, runs: Runs, engine: str) -> Iterator[tuple[object, ...]]:
    """Draw the cells of one engine and yield a CSV line for each."""
    colours = np.full((len(grid.rows), 1 + max(column for _, column in grid.members)), np.nan)
    own, silent = runs.engine == engine, runs.outcome == "silent wrong"
    for (row, column), at in grid.members.items():
        members = at & own
        if not members.any():
            continue
        wrong = np.flatnonzero(members & silent)
        colours[row, column] = WRONG if wrong.size else _state(runs.outcome[members])
        if wrong.size:
            axes.text(column + 0.5, row + 0.5, str(wrong.size), color=PAPER, fontsize=8, ha="center", va="center")
        first = np.flatnonzero(members)[0]
        recipe = runs.recipe[wrong[0]] if wrong.size else ""
        varied = "" if grid.columns else runs.varied[first]
        yield ENGINES[engine].name, runs.axes[first], varied, int(np.sum(members)), wrong.size, recipe
    fill(axes, colours, ListedColormap(COLOURS), WRONG)
    axes.set_title(
        f"{ENGINES[engine].name}:{' ' if grid.columns else chr(10)}{np.sum(own & silent)} of {np.sum(own)}",
        loc="left",
        fontsize=9.5,
    )


def _state(outcomes: NDArray[np.str_]) -> int:
    """State of a cell in which no run is wrong without a warning."""
    return GOOD if np.isin(outcomes, KNOWN).any() else STOPPED if (outcomes == REFUSED).all() else NOTHING
