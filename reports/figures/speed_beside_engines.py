"""Speed of a whole simulation beside the engines, same method and step."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import BLUE, GREY, INK, stacked_axes
from reports.results import Results
from reports.tables import rows_csv

SECTION = "speed"
TAKES: tuple[str, ...] = ()
QUANTITIES = ("real-time factor", "real-time factor of another engine")


def draw(results: Results) -> Iterator[Picture]:
    """A bar an engine, scene and way of solving for q̈."""
    for case, rows in results.of_kind("speed"):
        found = [row for row in rows if row.quantity in QUANTITIES and row.value]
        if not found:
            continue
        labels = [f"{row.engine} {row.varied.get('solver', '')}\n{row.scene}" for row in found]
        values = [row.value or 0.0 for row in found]
        figure, (axes,) = stacked_axes(1, 0.9 + 0.5 * len(found))
        colours = [BLUE if row.engine == "native" else GREY for row in found]
        bars = axes.barh(labels, values, color=colours, height=0.6)
        axes.bar_label(bars, [f"{number(value)}×" for value in values], padding=3)
        for row in found:
            if row.tolerance is not None:
                axes.axvline(row.tolerance, color=INK)
        axes.set(xlabel="simulated seconds per second [1]", xlim=(0.0, 1.25 * max(values)))
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        words = "Simulated seconds per CPU second on one core; engines are called from Python. Line: limit for LU."
        yield Picture(case, rows[0].title, figure, words, rows_csv(found))
