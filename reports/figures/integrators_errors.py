"""Runge-Kutta methods: error against step, evaluations and CPU time, and energy drift against step."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.pages.colours import CYCLE, MARKERS
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from reports.curves import floats, groups
from reports.results import Results
from reports.tables import series_csv
from validation.store import Series

SECTION = "integrators"
TAKES = ("comparison",)
ERROR = "error [rad]"
X_LABELS = {
    "evaluations per simulated second": "evaluations of q̈ per simulated time [1/s]",
    "core seconds per simulated second": "CPU time / simulated time [1]",
}  # fmt: skip
"""Column → axis label."""
VIEWS = (
    ("step", "step [s]", ERROR, "error against step"),
    ("evaluations", "evaluations per simulated second", ERROR, "error against evaluations of q̈"),
    ("seconds", "core seconds per simulated second", ERROR, "error against CPU time"),
    ("drift", "step [s]", "energy drift [J]", "energy drift against step"),
)


def draw(results: Results) -> Iterator[Picture]:
    """Four pictures of every comparison."""
    for case, series in results.showing(*TAKES):
        for view, x, y, words in VIEWS:
            yield _picture(f"{case}.{series.scene}.{view}", series, x, y, f"{series.scene}: {words}")


def _picture(name: str, series: Series, x: str, y: str, title: str) -> Picture:
    figure, (axes,) = stacked_axes(1, 3.4)
    for place, (method, rows) in enumerate(groups(series)):
        across, up = floats(series.columns[x][rows]), floats(series.columns[y][rows])
        seen = np.isfinite(up) & (up > 0.0)  # a diverged run has no finite error
        axes.plot(across[seen], up[seen], MARKERS[place] + "-", color=CYCLE[place], label=method)
    axes.set(xscale="log", yscale="log", xlabel=X_LABELS.get(x, x), ylabel=y.replace("error", "max |Δq|"))
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    return Picture(name, title, figure, f"{series.title}.", series_csv(series))
