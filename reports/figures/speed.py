"""CPU times of calls, steps and runs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from statistics import median

from flexlink.pages.colours import CYCLE, ENGINES, INK
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_over, stacked_axes, tidy_logs
from reports.curves import curves, legend_above, panels_of
from reports.figures import figure
from reports.results import Results
from reports.tables import rows_csv, series_csv
from validation.facts import Fact
from validation.store import Row, Series

LOOKS = {  # curve → engine, line style, fill colour of the marker, remark after the engine's name
    "native": ("native", "-", None, ", compiled loop"),
    "public": ("native", "--", "none", ", Python call"),
    "pinocchio": ("pinocchio", "-", None, ", one joint per hinge"),
    "pinocchio, fastest": ("pinocchio", "--", "none", ", fastest form"),
    "mujoco": ("mujoco", "-", None, ""),
}
Exponents = Mapping[tuple[Fact, Fact, str], float | None]  # (chain, job, engine)


@figure("speed", "cost")
def speed_cost(results: Results) -> Iterator[Picture]:
    """CPU time against the number of joints on log axes, with fitted exponents: a panel per family of chains.

    One picture per job: q̈, RNE, M, T_GC, an RK4 step.
    """
    for case, series in results.showing("cost"):
        exponents = {
            (row.varied["chain"], row.varied["job"], row.engine): row.value
            for row in results.cases[case]
            if "to n" in row.varied
        }
        yield _picture(f"{case}.{series.name}", series, exponents)


def _picture(name: str, series: Series, exponents: Exponents) -> Picture:
    families = panels_of(series)
    figure, axes = stacked_axes(len(families), 2.3)
    for panel, (family, part) in zip(axes, families, strict=True):
        for curve in curves(part):
            engine, line, face, words = LOOKS[curve.label]
            look = ENGINES[engine]
            panel.plot(
                curve.x, curve.y, line, marker=look.marker, color=look.colour, markerfacecolor=face or look.colour,
                label=look.name + words,
            )  # fmt: skip
        panel.set(xscale="log", yscale="log", ylabel=series.y_label)
        growth = _growth(family, series.part, exponents)
        panel.set_title(f"{family}: {growth}" if growth else family, loc="left")
        tidy_logs(panel)
    axes[-1].set_xlabel(series.x_label)
    legend_over(axes[0], figure=figure)
    caption = (
        "CPU time against the number of joints n, with a panel per family of chains. Exponents are fitted for n ≥ 100. "
        "Engines are called from Python."
    )
    return Picture(name, series.title, figure, caption, series_csv(series))


def _growth(chain: str, job: str, exponents: Exponents) -> str:
    """Growth of flexlink's and MuJoCo's CPU time: "flexlink ∝ n^1"."""
    names = (("native", "flexlink"), ("mujoco", "MuJoCo"))
    found = [(name, exponents.get((chain, job, engine))) for engine, name in names]
    return ", ".join(f"{name} ∝ n^{number(p, 3)}" for name, p in found if p is not None)


SOLVERS = {"lu": "LU", "articulated": "articulated bodies"}
QUANTITIES = ("real-time factor", "real-time factor of another engine")


@figure("speed")
def speed_beside_engines(results: Results) -> Iterator[Picture]:
    """Speed of a complete simulation in flexlink and in the engines, with the same method and step.

    One bar per engine, scene and solver for q̈.
    """
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
        words = (
            "Simulated time / CPU time on one core; all use the same method and step. Engines are called from Python."
        )
        yield Picture(case, rows[0].title, figure, words, rows_csv(found))


def _solver(row: Row) -> str:
    """Solver for q̈, if the row states it."""
    solver = str(row.varied.get("solver", ""))
    return f",\n{SOLVERS.get(solver, solver)}" if solver else ""


@figure("integrators")
def cost(results: Results) -> Iterator[Picture]:
    """CPU time of a step: median over the runs of each method.

    One bar per method.
    """
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
