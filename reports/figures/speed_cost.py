"""Cost against the number of joints on log axes, with fitted exponents: a panel a family of chains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, legend_above, stacked_axes, tidy_logs
from reports.curves import curves, panels_of
from reports.results import Results
from reports.tables import series_csv
from validation.facts import Fact
from validation.store import Series

SECTION = "speed"
TAKES = ("cost",)
LOOKS = {
    "native": (BLUE, "o-", "flexlink, loop"),
    "public": (GREEN, "v--", "flexlink, call"),
    "pinocchio": (VERMILION, "s-", "Pinocchio"),
    "pinocchio, fastest": (ORANGE, "^--", "its fastest form"),
    "mujoco": (PURPLE, "D-", "MuJoCo"),
}
Exponents = Mapping[tuple[Fact, Fact, str], float | None]  # (chain, job, engine)


def draw(results: Results) -> Iterator[Picture]:
    """One picture a job: q̈, RNE, M, T_GC, a step of RK4."""
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
            colour, line, label = LOOKS[curve.label]
            panel.plot(curve.x, curve.y, line, color=colour, label=label)
        panel.set(xscale="log", yscale="log", ylabel=series.y_label)
        growth = _growth(family, series.part, exponents)
        panel.set_title(f"{family}: {growth}" if growth else family, loc="left")
        tidy_logs(panel)
    axes[-1].set_xlabel(series.x_label)
    legend_above(figure, axes[0], 2)
    caption = (
        "Time against the number of joints n, for planar and skew T1, T2 and T3 where measured. Exponents are fitted "
        "for n ≥ 100. Engines are called from Python."
    )
    return Picture(name, series.title, figure, caption, series_csv(series))


def _growth(chain: str, job: str, exponents: Exponents) -> str:
    """Exponents of ours and of MuJoCo, "ours ∝ n^1"."""
    names = (("native", "ours"), ("mujoco", "MuJoCo"))
    found = [(name, exponents.get((chain, job, engine))) for engine, name in names]
    return ", ".join(f"{name} ∝ $n^{{{number(p, 3)}}}$" for name, p in found if p is not None)
