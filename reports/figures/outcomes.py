"""Outcomes of runs at extreme parameters: counts per method and step, or per engine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexlink.pages.colours import BLUE, GREEN, GREY, ORANGE, PALE, PURPLE, SKY, VERMILION, engine_name
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_over, stacked_axes
from flexlink.pages.tables import columns_csv
from reports.results import Results

SECTION = "extremes"
TAKES = ("outcomes",)
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


def draw(results: Results) -> Iterator[Picture]:
    """One picture per case."""
    for case, rows in results.of_kind("extremes"):
        for series in (s for s in results.series[case] if s.what in TAKES):
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
