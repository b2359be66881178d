"""Maps of runs at extreme parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.pages.colours import BLUE, ENGINES, GREEN, GREY, ORANGE, PALE, PAPER, PURPLE, SKY, VERMILION, engine_name
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, legend_over, stacked_axes, tidy_logs
from flexlink.pages.tables import columns_csv, table_csv
from reports.curves import legend_above
from reports.figures import figure
from reports.results import Results
from reports.tables import series_csv

KNOWN = ("within", "near", "warned", "false doubt")
REFUSED = "error"
NOTHING, STOPPED, GOOD, WRONG = range(4)  # runs without reference; all refused; none wrong; some wrong
COLOURS = (PALE, GREY, GREEN, VERMILION)
WORDS = ("no reference", "all refused or stopped", "none wrong", "number of wrong runs")
TITLE = "Runs that are wrong without a warning"
ALONE = (
    "In each row one parameter is extreme. A run is wrong if its tip error exceeds ten tolerances (fixed steps: 5 % of "
    "the motion) without a warning."
)
PAIRS = (
    "In each cell two parameters are extreme. A run is wrong if its tip error exceeds ten tolerances (fixed steps: 5 % "
    "of the motion) without a warning."
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


@figure("extremes")
def extreme_runs(results: Results) -> Iterator[Picture]:
    """Runs at extreme parameters that are wrong without a warning, in flexlink and other engines: one cell per value.

    For each case with other engines: a map with one parameter at a time, and a map with pairs of parameters.
    """
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
    return Grid([_with_range(name, varied[name]) for name in names], [], members)


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
    figure, panels = _panels_beside(seen, grid.rows, 1.0) if not grid.columns else _stacked(seen, grid)
    rows = [row for axes, engine in zip(panels, seen, strict=True) for row in _panel(axes, grid, runs, engine)]
    _key(figure, list(zip(COLOURS, WORDS, strict=True)), 2)
    csv = table_csv(("engine", "axes", "varied", "runs", "wrong without a warning", "command of the first"), rows)
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
    _fill(axes, colours, ListedColormap(COLOURS), WRONG)
    axes.set_title(
        f"{ENGINES[engine].name}:{' ' if grid.columns else chr(10)}{np.sum(own & silent)} of {np.sum(own)}",
        loc="left",
        fontsize=9.5,
    )


def _state(outcomes: NDArray[np.str_]) -> int:
    """State of a cell in which no run is wrong without a warning."""
    return GOOD if np.isin(outcomes, KNOWN).any() else STOPPED if (outcomes == REFUSED).all() else NOTHING


MAPPED = ("native", "pinocchio", "mujoco")
MOST = 16  # decimal digits of float64
SHADES = ListedColormap(["#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#d1e5f0", "#92c5de", "#4393c3", "#2166ac"])
MAP = (
    "Each cell is one value of a parameter, in the order of its range, and shows the less accurate of two scenes. "
    "Grey: refused. The CSV includes pairs."
)
CLOUD = "Error of q̈ relative to its largest element, for all values and pairs of parameters. 1 means no correct digit."


@figure("extremes", "digits")
def extreme_digits(results: Results) -> Iterator[Picture]:
    """Maps of extreme parameters: correct digits of q̈ by parameter, value and engine, and errors against cond(M).

    Two pictures per case.
    """
    for case, series in results.showing("digits"):
        csv = columns_csv(series.columns)
        yield _map(case, series.columns, csv)
        yield _cloud(case, series.columns, csv)


def _map(case: str, columns: Mapping[str, NDArray[Any]], csv: str) -> Picture:
    axes_of, varied = columns["axes"].astype(str), columns["varied"].astype(str)
    alone = [name for name in dict.fromkeys(axes_of.tolist()) if " and " not in name]
    values = {name: list(dict.fromkeys(varied[axes_of == name].tolist())) for name in alone}
    rows = [_with_range(name, values[name]) for name in alone]
    figure, panels = _panels_beside(MAPPED, rows, 1.5)
    for axes, engine in zip(panels, MAPPED, strict=True):
        digits = np.full((len(alone), max(map(len, values.values()))), np.nan)
        for row, name in enumerate(alone):
            for place, value in enumerate(values[name]):
                errors = columns[f"{engine} q̈"][(axes_of == name) & (varied == value)].astype(float)
                axes.add_patch(Rectangle((place, row), 1, 1, facecolor=GREY, edgecolor="w", linewidth=0.6))
                if np.isfinite(errors).any():
                    digits[row, place] = -np.log10(max(np.nanmax(errors), 10.0**-MOST))
        shown = _fill(axes, digits, SHADES, MOST)
    figure.colorbar(shown, ax=panels, location="bottom", label="correct digits of q̈", fraction=0.03, pad=0.03)
    title = "Correct digits of q̈ at extreme parameters, compared with 100-digit arithmetic"
    return Picture(f"{case}.map", title, figure, MAP, csv)


def _cloud(case: str, columns: Mapping[str, NDArray[Any]], csv: str) -> Picture:
    figure, (axes,) = stacked_axes(1, 3.8)
    condition = columns["cond(M)"].astype(float)
    for engine in reversed(MAPPED):
        look = ENGINES[engine]
        error = columns[f"{engine} q̈"].astype(float)
        seen = np.isfinite(error) & np.isfinite(condition)
        axes.plot(
            condition[seen], np.maximum(error[seen], 10.0**-MOST), look.marker, color=look.colour, markersize=3.0,
            alpha=0.5, linestyle="", markeredgewidth=0, label=look.name, rasterized=True,
        )  # fmt: skip
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="condition number of M [1]",
        ylabel="relative error of q̈ [1]",
        xlim=(1e1, 1e22),
    )
    tidy_logs(axes)
    legend = legend_above(figure, axes, 3)
    for handle in legend.legend_handles:
        handle.set(markersize=6.0, alpha=1.0)
    return Picture(f"{case}.condition", "Error of q̈ against cond(M)", figure, CLOUD, csv)


SHOWN = {
    "within": ("within tolerance", GREEN), "near": ("within 10 tolerances", SKY), "warned": ("warned", BLUE),
    "error": ("ended with a message", GREY), "dear": ("too expensive", PALE),
    "unknown": ("no reference", PURPLE), "false doubt": ("unnecessary warning", ORANGE),
    "silent wrong": ("wrong, no warning", VERMILION),
}  # fmt: skip
"""Outcome of a run → words, colour."""
CAPTION = (
    "Outcomes of runs by method and by step or tolerance (relative to the arm's reach). Numbers in brackets count the "
    "runs with each outcome."
)


@figure("extremes", "runs")
def promised_errors(results: Results) -> Iterator[Picture]:
    """True errors of runs with a tolerance: share of runs below an error, one curve per tolerance."""
    for case, series in results.showing("runs"):
        tolerances, errors = (series.columns[name].astype(float) for name in (series.x, "error / tolerance"))
        figure, (axes,) = stacked_axes(1, 3.0)
        colours = BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY
        for tolerance, colour in zip(np.unique(tolerances), colours, strict=False):
            own = np.sort(errors[tolerances == tolerance])
            share = 100.0 * np.arange(1, len(own) + 1) / len(own)
            axes.plot(own, share, color=colour, label=f"tolerance {number(float(tolerance))}")
        axes.axvline(1.0, color=GREY, linestyle=":", zorder=0)
        axes.set(xscale="log", xlim=(1e-4, 1e2), ylim=(0, 102), xlabel="error / tolerance [1]", ylabel="runs [%]")
        tidy_logs(axes)
        legend_over(axes, figure=figure)
        caption = (
            "Share of runs of random arms whose ratio of tip error to tolerance is at most that on the axis. "
            "Tolerances are relative to the arm's reach."
        )
        yield Picture(f"{case}.runs", "Tip errors of runs with a tolerance", figure, caption, series_csv(series))


@figure("extremes", "outcomes")
def outcomes(results: Results) -> Iterator[Picture]:
    """Outcomes of runs at extreme parameters: counts per method and step, or per engine.

    One picture per case.
    """
    for case, rows in results.of_kind("extremes"):
        for series in (s for s in results.series[case] if s.what == "outcomes"):
            columns = {name: np.asarray(values).astype(str) for name, values in series.columns.items()}
            ways = _ways(columns)
            names = sorted(set(ways.tolist()), key=_in_order)
            figure, (axes,) = stacked_axes(1, 1.4 + 0.28 * len(names))
            left = np.zeros(len(names))
            for outcome, (words, colour) in SHOWN.items():
                counts = np.array([np.sum((ways == name) & (columns["outcome"] == outcome)) for name in names])
                if counts.any():
                    axes.barh(names, counts, left=left, color=colour, label=f"{words} ({counts.sum()})")
                left += counts
            axes.set(xlabel="runs [1]")
            axes.invert_yaxis()
            axes.grid(False, axis="y")
            legend_over(axes, figure=figure)
            csv = columns_csv(series.columns)
            yield Picture(f"{case}.{series.name}", rows[0].title, figure, CAPTION, csv)


def _ways(columns: dict[str, NDArray[np.str_]]) -> NDArray[np.str_]:
    """Name of each run: method and step, or engine and method if there are several engines."""
    methods = columns["method"]
    if len(set(columns["engine"].tolist())) > 1:
        engines = np.array([engine_name(name) for name in columns["engine"].tolist()])
        return np.char.add(np.char.add(engines, " "), methods)
    ways = np.char.add(np.char.add(methods, ", "), columns["steps"])
    return np.char.replace(np.char.replace(ways, " of the reach", ""), "tolerance", "tol.")


def _in_order(way: str) -> tuple[str, float]:
    """Sort key: words, then the number at the end in descending order (0.01 before 0.0001)."""
    words, _, end = way.removesuffix(" s").rpartition(" ")
    try:
        return words.casefold(), -float(end)
    except ValueError:
        return way.casefold(), 0.0


ROW = 0.24  # height of a row of cells [in]
LETTERS = 7.5  # font size of row names [pt]


def _panels_beside(engines: Sequence[str], rows: Sequence[str], room: float) -> tuple[Figure, list[Axes]]:
    """Figure with one panel per engine, the first with row names; `room` is the height without the rows [in]."""
    figure = Figure(figsize=(WIDTH, room + ROW * len(rows)), layout="constrained")
    axes = list(figure.subplots(1, len(engines), sharey=True, squeeze=False)[0])
    for panel, engine in zip(axes, engines, strict=True):
        panel.set_title(engine_name(engine), loc="left", fontsize=10.0)
        panel.set_xticks([])
        panel.tick_params(length=0)
        panel.grid(False)
        panel.spines[:].set_visible(False)
    axes[0].set_yticks(np.arange(len(rows)) + 0.5, rows, fontsize=LETTERS)
    axes[0].set_ylim(len(rows), 0)
    return figure, axes


def _fill(axes: Axes, values: Array, colours: object, highest: float) -> object:
    """Draw each value, 0 to `highest`, as a coloured cell; cells with nan stay empty."""
    cells = np.ma.masked_invalid(values)
    return axes.pcolormesh(cells, cmap=colours, vmin=0, vmax=highest, edgecolors="w", linewidth=0.6)


def _with_range(name: str, varied: Sequence[str]) -> str:
    """Name of a row with its first and last value: "density, times: 10⁻¹⁵ … 10⁶"."""
    values = [float(text.rsplit(" ", 1)[-1]) for text in varied]
    plain, unit = (found[1], found[2]) if (found := re.fullmatch(r"(.*?)( \[[^\]]*\])", name)) else (name, "")
    ends = number(values[0], 2) if len(values) == 1 else f"{number(values[0], 2)} … {number(values[-1], 2)}"
    return f"{plain}{' ×' if plain.endswith(', times') else ':'} {ends}{unit}".replace(", times ×", " ×")


def _key(figure: Figure, entries: Sequence[tuple[str, str]], columns: int) -> None:
    """Add a legend of colours, given as (colour, words), above the panels."""
    handles = [Patch(facecolor=colour, label=words) for colour, words in entries]
    figure.legend(
        handles=handles, loc="outside upper left", ncols=columns, frameon=False, fontsize=10.0, handlelength=1.0,
        columnspacing=1.0,
    )  # fmt: skip
