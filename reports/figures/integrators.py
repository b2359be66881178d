"""Runge-Kutta methods: error against step, evaluations and seconds, and energy drift against step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from reports.curves import groups, numbers
from reports.picture import Picture
from reports.results import Results
from reports.style import CYCLE, MARKERS, legend_above, panels, tidy_logs
from validation.store import Series

SECTION = "integrators"
TAKES = ("*.error",)
ERROR = "error [rad]"
VIEWS = (
    ("step", "step [s]", ERROR, "error against step"),
    ("evaluations", "evaluations per simulated second", ERROR, "error against work counted in evaluations of q̈"),
    ("seconds", "core seconds per simulated second", ERROR, "error against work in time of one core"),
    ("drift", "step [s]", "energy drift [J]", "largest change of the total energy, which the exact motion keeps"),
)


def draw(results: Results) -> Iterator[Picture]:
    """Four views of every comparison."""
    for case, _ in results.of_kind("integrators"):
        for name, series in results.series[case].items():
            scene = name.removesuffix(".error")
            for view, x, y, words in VIEWS:
                yield _picture(f"{case}.{scene}.{view}", series, x, y, f"{scene}: {words}.")


def _picture(name: str, series: Series, x: str, y: str, caption: str) -> Picture:
    figure, (axes,) = panels(1, 3.4)
    for place, (method, rows) in enumerate(groups(series)):
        across, up = numbers(series.columns[x][rows]), numbers(series.columns[y][rows])
        seen = np.isfinite(up) & (up > 0.0)  # a run that diverged has no error to draw
        axes.plot(across[seen], up[seen], MARKERS[place] + "-", color=CYCLE[place], label=method)
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y.replace("error", "max |Δq|"))
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    return Picture(name, figure, caption)
