"""CPU time against the number of joints on log axes, with fitted exponents: a panel per family of chains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexlink.pages.colours import ENGINES
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_over, stacked_axes, tidy_logs
from reports.curves import curves, panels_of
from reports.results import Results
from reports.tables import series_csv
from validation.facts import Fact
from validation.store import Series

SECTION = "speed"
TAKES = ("cost",)
LOOKS = {  # curve → engine, line style, fill colour of the marker, remark after the engine's name
    "native": ("native", "-", None, ", compiled loop"),
    "public": ("native", "--", "none", ", Python call"),
    "pinocchio": ("pinocchio", "-", None, ", one joint per hinge"),
    "pinocchio, fastest": ("pinocchio", "--", "none", ", fastest form"),
    "mujoco": ("mujoco", "-", None, ""),
}
Exponents = Mapping[tuple[Fact, Fact, str], float | None]  # (chain, job, engine)


def draw(results: Results) -> Iterator[Picture]:
    """One picture per job: q̈, RNE, M, T_GC, an RK4 step."""
    for case, series in results.showing(*TAKES):
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
        "CPU time against the number of joints n, one panel per family of chains. Exponents are fitted for n ≥ 100. "
        "Engines are called from Python."
    )
    return Picture(name, series.title, figure, caption, series_csv(series))


def _growth(chain: str, job: str, exponents: Exponents) -> str:
    """Growth of flexlink's and MuJoCo's CPU time: "flexlink ∝ n^1"."""
    names = (("native", "flexlink"), ("mujoco", "MuJoCo"))
    found = [(name, exponents.get((chain, job, engine))) for engine, name in names]
    return ", ".join(f"{name} ∝ $n^{{{number(p, 3)}}}$" for name, p in found if p is not None)
