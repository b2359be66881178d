"""The map of extremes: digits of q̈ by axis and value in every engine, and errors against cond(M)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray

from flexlink.pages.picture import Picture
from flexlink.pages.style import BLUE, GREY, ORANGE, VERMILION, legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import columns_csv
from reports.results import Results

SECTION = "extremes"
TAKES = ("digits",)
ENGINES = (("native", BLUE, "o"), ("pinocchio", ORANGE, "s"), ("mujoco", VERMILION, "^"))
MOST = 16  # digits of float64
SHADES = ListedColormap(["#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#d1e5f0", "#92c5de", "#4393c3", "#2166ac"])
MAP = (
    "Correct digits of q̈, one cell for each value of one parameter, smallest left; the worse of two scenes. Grey: "
    "refused with an error message, or no such value. The CSV has all cells, also of two parameters, with the command "
    "that repeats each."
)
CLOUD = (
    "Largest error of q̈ relative to its largest element, in every cell of the map: one or two parameters at extremes. "
    "1: no correct digit."
)


def draw(results: Results) -> Iterator[Picture]:
    """Two pictures a case."""
    for case, series in results.showing(*TAKES):
        csv = columns_csv(series.columns)
        yield _map(case, series.columns, csv)
        yield _cloud(case, series.columns, csv)


def _map(case: str, columns: Mapping[str, NDArray[Any]], csv: str) -> Picture:
    axes_of, varied = columns["axes"].astype(str), columns["varied"].astype(str)
    alone = [name for name in dict.fromkeys(axes_of.tolist()) if " and " not in name]
    values = {name: list(dict.fromkeys(varied[axes_of == name].tolist())) for name in alone}
    width = max(map(len, values.values()))
    figure, panels = stacked_axes(len(ENGINES), 0.9 + 0.24 * len(alone))
    for axes, (engine, _, _) in zip(panels, ENGINES, strict=True):
        digits = np.full((len(alone), width), np.nan)
        for row, name in enumerate(alone):
            for place, value in enumerate(values[name]):
                errors = columns[f"{engine} q̈"][(axes_of == name) & (varied == value)].astype(float)
                if np.isfinite(errors).any():
                    worst = max(np.nanmax(errors), 10.0**-MOST)
                    digits[row, place] = -np.log10(worst)
        axes.set_facecolor(GREY)
        shown = axes.pcolormesh(digits, cmap=SHADES, vmin=0, vmax=MOST, edgecolors="w", linewidth=0.8)
        axes.set_yticks(np.arange(len(alone)) + 0.5, alone, fontsize=8)
        axes.set_xticks([])
        axes.invert_yaxis()
        axes.grid(False)
        axes.set_title({"native": "flexlink"}.get(engine, engine), loc="left")
    figure.colorbar(shown, ax=panels, location="bottom", label="digits of q̈", fraction=0.03, pad=0.02)
    return Picture(f"{case}.map", "Digits of q̈ at extremes", figure, MAP, csv)


def _cloud(case: str, columns: Mapping[str, NDArray[Any]], csv: str) -> Picture:
    figure, (axes,) = stacked_axes(1, 3.8)
    condition = columns["cond(M)"].astype(float)
    for engine, colour, marker in reversed(ENGINES):
        error = columns[f"{engine} q̈"].astype(float)
        seen = np.isfinite(error) & np.isfinite(condition)
        axes.plot(
            condition[seen], np.maximum(error[seen], 10.0**-MOST), marker, color=colour, markersize=2.5, alpha=0.5,
            markeredgewidth=0, label={"native": "flexlink"}.get(engine, engine), rasterized=True,
        )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="cond(M) [1]", ylabel="error of q̈ [1]", xlim=(1e1, 1e22))
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    return Picture(f"{case}.condition", "Error of q̈ against cond(M)", figure, CLOUD, csv)
