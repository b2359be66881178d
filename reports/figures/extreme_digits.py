"""Maps of extreme parameters: correct digits of q̈ by parameter, value and engine, and errors against cond(M)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from flexlink.pages.colours import ENGINES as ENGINE_LOOKS
from flexlink.pages.colours import GREY
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import columns_csv
from reports.cells import fill, panels_beside, with_range
from reports.results import Results

SECTION = "extremes"
TAKES = ("digits",)
ENGINES = ("native", "pinocchio", "mujoco")
MOST = 16  # decimal digits of float64
SHADES = ListedColormap(["#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#d1e5f0", "#92c5de", "#4393c3", "#2166ac"])
MAP = (
    "One cell per value of a parameter, in order; it shows the less accurate of two scenes. Grey: refused. The CSV "
    "includes pairs of parameters."
)
CLOUD = "Error of q̈ relative to its largest element, in every cell of the map and of its pairs. 1: no correct digit."


def draw(results: Results) -> Iterator[Picture]:
    """Two pictures per case."""
    for case, series in results.showing(*TAKES):
        csv = columns_csv(series.columns)
        yield _map(case, series.columns, csv)
        yield _cloud(case, series.columns, csv)


def _map(case: str, columns: Mapping[str, NDArray[Any]], csv: str) -> Picture:
    axes_of, varied = columns["axes"].astype(str), columns["varied"].astype(str)
    alone = [name for name in dict.fromkeys(axes_of.tolist()) if " and " not in name]
    values = {name: list(dict.fromkeys(varied[axes_of == name].tolist())) for name in alone}
    rows = [with_range(name, values[name]) for name in alone]
    figure, panels = panels_beside(ENGINES, rows, 1.5)
    for axes, engine in zip(panels, ENGINES, strict=True):
        digits = np.full((len(alone), max(map(len, values.values()))), np.nan)
        for row, name in enumerate(alone):
            for place, value in enumerate(values[name]):
                errors = columns[f"{engine} q̈"][(axes_of == name) & (varied == value)].astype(float)
                axes.add_patch(Rectangle((place, row), 1, 1, facecolor=GREY, edgecolor="w", linewidth=0.6))
                if np.isfinite(errors).any():
                    digits[row, place] = -np.log10(max(np.nanmax(errors), 10.0**-MOST))
        shown = fill(axes, digits, SHADES, MOST)
    figure.colorbar(shown, ax=panels, location="bottom", label="correct digits of q̈", fraction=0.03, pad=0.03)
    title = "Correct digits of q̈ at extreme parameters, compared with 100-digit arithmetic"
    return Picture(f"{case}.map", title, figure, MAP, csv)


def _cloud(case: str, columns: Mapping[str, NDArray[Any]], csv: str) -> Picture:
    figure, (axes,) = stacked_axes(1, 3.8)
    condition = columns["cond(M)"].astype(float)
    for engine in reversed(ENGINES):
        look = ENGINE_LOOKS[engine]
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
