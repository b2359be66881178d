"""What became of runs at extremes: of every method and way of stepping, or engine, the parts that ended so or so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexlink.pages.picture import Picture
from flexlink.pages.style import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, legend_above, stacked_axes
from flexlink.pages.tables import columns_csv
from reports.results import Results

SECTION = "extremes"
TAKES = ("outcomes",)
SHOWN = (
    ("within", GREEN), ("near", SKY), ("warned", BLUE), ("error", GREY), ("dear", "#c9cdd1"), ("unknown", PURPLE),
    ("false doubt", ORANGE), ("silent wrong", VERMILION),
)  # fmt: skip
CAPTION = (
    "Runs by method and by step or tolerance (part of the reach): error at most one tolerance (within) or ten (near), "
    "with a warning, ended with an error message, too expensive to judge, without a reference, needless warning, wrong "
    "without a warning."
)


def draw(results: Results) -> Iterator[Picture]:
    """One picture a case."""
    for case, rows in results.of_kind("extremes"):
        for series in (s for s in results.series[case] if s.what in TAKES):
            columns = {name: np.asarray(values).astype(str) for name, values in series.columns.items()}
            ways = _ways(columns)
            names = list(dict.fromkeys(sorted(ways.tolist())))
            figure, (axes,) = stacked_axes(1, 1.4 + 0.28 * len(names))
            left = np.zeros(len(names))
            for outcome, colour in SHOWN:
                counts = np.array([np.sum((ways == name) & (columns["outcome"] == outcome)) for name in names])
                if counts.any():
                    axes.barh(names, counts, left=left, color=colour, label=f"{outcome} ({counts.sum()})")
                left += counts
            axes.set(xlabel="runs [1]")
            axes.invert_yaxis()
            axes.grid(False, axis="y")
            legend_above(figure, axes, 2)
            csv = columns_csv(series.columns)
            yield Picture(f"{case}.{series.name}", rows[0].title, figure, CAPTION, csv)


def _ways(columns: dict[str, NDArray[np.str_]]) -> NDArray[np.str_]:
    """How every run advanced, in words; beside other engines without its step."""
    methods = columns["method"]
    if len(set(columns["engine"].tolist())) > 1:
        engines = np.where(columns["engine"] == "native", "flexlink", columns["engine"])
        return np.char.add(np.char.add(engines, " "), methods)
    ways = np.char.add(np.char.add(methods, ", "), columns["steps"])
    return np.char.replace(np.char.replace(ways, " of the reach", ""), "tolerance", "tol.")
