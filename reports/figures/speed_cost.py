"""Cost against the number of joints on log axes, with fitted exponents: a panel a family of chains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from reports.curves import Curve, curves
from reports.numbers import number
from reports.picture import Picture
from reports.results import Results
from reports.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, legend_above, panels, tidy_logs
from validation.store import Series

SECTION = "speed"
TAKES = ("cost.*",)
LOOKS = {
    "native": (BLUE, "o-", "flexlink, loop"),
    "public": (GREEN, "v--", "flexlink, call"),
    "pinocchio": (VERMILION, "s-", "Pinocchio"),
    "pinocchio, fastest": (ORANGE, "^--", "its fastest form"),
    "mujoco": (PURPLE, "D-", "MuJoCo"),
}
Exponents = Mapping[tuple[str, str], float | None]  # (family and job, engine)


def draw(results: Results) -> Iterator[Picture]:
    """One picture a job: q̈, RNE, M, T_GC, a step of RK4."""
    for case, found in results.series.items():
        exponents = {(row.scene, row.engine): row.value for row in results.cases[case] if "exponent" in row.quantity}
        for name, series in found.items():
            if name.startswith("cost."):
                yield _picture(f"{case}.{name.replace(' ', '_')}", name.removeprefix("cost."), series, exponents)


def _picture(name: str, job: str, series: Series, exponents: Exponents) -> Picture:
    families: dict[str, dict[str, Curve]] = {}
    for curve in curves(series):
        family, _, engine = curve.label.partition(" | ")
        families.setdefault(family, {})[engine] = curve
    figure, axes = panels(len(families), 2.3)
    for panel, (family, engines) in zip(axes, families.items(), strict=True):
        for engine, curve in engines.items():
            colour, line, label = LOOKS[engine]
            panel.plot(curve.x, curve.y, line, color=colour, label=label)
        panel.set(xscale="log", yscale="log", ylabel=series.y_label)
        growth = _growth(f"{family} {job}", exponents)
        panel.set_title(f"{family}: {growth}" if growth else family, loc="left")
        tidy_logs(panel)
    axes[-1].set_xlabel(series.x_label)
    legend_above(figure, axes[0], 2)
    caption = (
        f"{series.title} against the number of joints for T1 in a plane and skew, T2 and T3, where measured; exponents "
        "are fitted from n = 100 on. Engines are called from Python."
    )
    return Picture(name, figure, caption)


def _growth(label: str, exponents: Exponents) -> str:
    """Exponents of ours and of MuJoCo, "ours ∝ n^1"."""
    names = (("native", "ours"), ("mujoco", "MuJoCo"))
    found = [(name, exponents.get((label, engine))) for engine, name in names]
    return ", ".join(f"{name} ∝ $n^{{{number(p, 3)}}}$" for name, p in found if p is not None)
