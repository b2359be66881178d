"""Speed of a complete simulation in flexlink and in the engines, with the same method and step."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.colours import ENGINES, INK
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes
from reports.results import Results
from reports.tables import rows_csv
from validation.store import Row

SECTION = "speed"
TAKES: tuple[str, ...] = ()
SOLVERS = {"lu": "LU", "articulated": "articulated bodies"}
QUANTITIES = ("real-time factor", "real-time factor of another engine")


def draw(results: Results) -> Iterator[Picture]:
    """One bar per engine, scene and solver for q̈."""
    for case, rows in results.of_kind("speed"):
        found = [row for row in rows if row.quantity in QUANTITIES and row.value]
        if not found:
            continue
        labels = [f"{ENGINES[row.engine].name}{_solver(row)}" for row in found]
        values = [row.value or 0.0 for row in found]
        figure, (axes,) = stacked_axes(1, 1.2 + 0.55 * len(found))
        colours = [ENGINES[row.engine].colour for row in found]
        bars = axes.barh(labels, values, color=colours, height=0.6)
        axes.bar_label(bars, [f"{number(value)}×" for value in values], padding=3)
        for limit in sorted({row.tolerance for row in found if row.tolerance is not None}):
            axes.axvline(limit, color=INK, label=f"limit: {number(limit)}×")
        axes.set(xlabel="simulated time / CPU time [1]", xlim=(0.0, 1.25 * max(values)))
        axes.invert_yaxis()
        axes.grid(visible=False, axis="y")
        legend_above(figure, axes, 1)
        words = "Simulated time per CPU time on one core, same method and step. Engines are called from Python."
        yield Picture(case, rows[0].title, figure, words, rows_csv(found))


def _solver(row: Row) -> str:
    """Solver for q̈, if the row states it."""
    solver = str(row.varied.get("solver", ""))
    return f",\n{SOLVERS.get(solver, solver)}" if solver else ""
