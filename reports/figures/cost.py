"""CPU time of a step: median over the runs of each method."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median

from flexlink.pages.colours import CYCLE
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports.results import Results
from reports.tables import rows_csv

SECTION = "integrators"
TAKES: tuple[str, ...] = ()


def draw(results: Results) -> Iterator[Picture]:
    """One bar per method."""
    for case, rows in results.of_kind("integrators"):
        costs: dict[str, list[float]] = {}
        for row in rows:
            if row.quantity == "cost per step" and row.value is not None:
                costs.setdefault(str(row.varied["method"]), []).append(row.value)
        if not costs:
            continue
        unit = next(row.unit for row in rows if row.quantity == "cost per step")
        figure, (axes,) = stacked_axes(1, 0.9 + 0.4 * len(costs))
        values = [median(found) for found in costs.values()]
        bars = axes.barh(list(costs), values, color=CYCLE[: len(costs)], height=0.6)
        axes.bar_label(bars, [f"{number(value)} {unit}" for value in values], padding=3)
        axes.set(xlabel=f"CPU time per step [{unit}]", xlim=(0.0, 1.3 * max(values)))
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        words = "CPU time per step on one core, including sampling and energies."
        shown = [row for row in rows if row.quantity == "cost per step"]
        title = f"{rows[0].scene}: CPU time per step by method"
        yield Picture(f"{case}.cost", title, figure, words, rows_csv(shown))
