"""Curves of motions, energies and errors."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.pages.colours import BLUE, CYCLE, ENGINES, GREEN, GREY, INK, MARKERS, VERMILION, look_of
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes, tidy_linear, tidy_logs
from reports.curves import curves, floats, groups, legend_above, put_labels
from reports.figures import figure
from reports.results import Results
from reports.tables import series_csv
from validation.store import Series

UNITS = ((1.0, "m"), (1e3, "mm"), (1e6, "µm"), (1e9, "nm"))
CAPTION = (
    "Distance of the tip of flexlink's chain from that of exact beams (Exudyn). Between the samples, the tip vibrates."
)


@figure("physics", "beams")
def beams(results: Results) -> Iterator[Picture]:
    """Distance of a chain's tip from the exact beam's; as points, because the tip vibrates too fast for a line.

    One picture per scene.
    """
    for case, series in results.showing("beams"):
        found = list(curves(series))
        largest = max(float(curve.y.max()) for curve in found)
        factor, unit = next((each for each in UNITS if each[0] * largest >= 1.0), UNITS[-1])
        figure, (axes,) = stacked_axes(1, 2.7)
        for curve in found:
            axes.plot(curve.x, factor * curve.y, "o", color=BLUE)
        axes.set(xlabel=series.x_label, ylabel=f"tip distance [{unit}]")
        axes.set_ylim(bottom=0.0)
        title = f"{series.scene}: chain and exact beams"
        yield Picture(f"{case}.{series.name}", title, figure, CAPTION, series_csv(series))


@figure("integrators", "convergence")
def convergence_slopes(results: Results) -> Iterator[Picture]:
    """Measured order of convergence: error against step, with the fitted slope.

    One picture per case.
    """
    for case, rows in results.of_kind("convergence"):
        slopes = {row.varied["method"]: row.value for row in rows if row.quantity == "slope"}
        for series in (s for s in results.series[case] if s.what == "convergence"):
            figure, (axes,) = stacked_axes(1, 3.2)
            for place, curve in enumerate(curves(series)):
                label = f"{curve.label}, slope {number(slopes.get(curve.label))}"
                axes.plot(curve.x, curve.y, MARKERS[place] + "-", color=CYCLE[place], label=label)
            put_labels(axes, series)
            legend_above(figure, axes, 2)
            words = f"{series.title}. Slopes are least-squares fits."
            yield Picture(f"{case}.{series.name}", rows[0].title, figure, words, series_csv(series))


LOOKS = {"kinetic": (BLUE, "-"), "gravity": (VERMILION, "-"), "elastic": (GREEN, "-"), "total": (INK, "--")}
OWN_SCALE = "elastic"  # often thousands of times smaller than the kinetic and potential energy


@figure("trajectory", "energy")
def energy_changes(results: Results) -> Iterator[Picture]:
    """Energy balance: change of each kind of energy since the start; the energy of the springs has a separate scale.

    One picture per scene with a stored motion.
    """
    for case, series in results.showing("energy"):
        if not series.engine:
            figure, (upper, lower) = stacked_axes(2, 2.1)
            for curve in curves(series):
                colour, line = LOOKS[curve.label]
                panel = lower if curve.label == OWN_SCALE else upper
                panel.plot(curve.x, curve.y - curve.y[0], color=colour, linestyle=line, label=curve.label)
            upper.set_ylabel("energy change [J]")
            lower.set(xlabel=series.x_label, ylabel="elastic [J]")
            tidy_linear(lower)
            legend_above(figure, upper, 3)
            title = f"{series.scene}: energy balance"
            yield Picture(f"{case}.{series.name}", title, figure, ENERGIES, series_csv(series))


ENERGIES = "Change of each energy since the start. Lower panel: elastic energy of the springs, on a separate scale."


@figure("trajectory", "drift")
def energy_drift_predicted(results: Results) -> Iterator[Picture]:
    """Energy drift of frictionless runs: measured and predicted.

    Points are measured, lines are predicted, with one colour per method.
    """
    for case, series in results.showing("drift"):
        figure, (axes,) = stacked_axes(1, 3.2)
        predicted = list(curves(series, "predicted"))
        for place, (found, line) in enumerate(zip(curves(series, "measured"), predicted, strict=True)):
            colour, marker = CYCLE[place % len(CYCLE)], MARKERS[place % len(MARKERS)]
            axes.plot(found.x, found.y, marker, color=colour, label=f"{found.label} measured")
            axes.plot(line.x, line.y, "--", color=colour, label=f"{line.label} predicted")
        put_labels(axes, series)
        legend_above(figure, axes, 2)
        yield Picture(f"{case}.{series.name}", series.title, figure, DRIFT, series_csv(series))


DRIFT = (
    "Largest change of the total energy, which is constant in the exact motion. Prediction: numerical damping of the "
    "excited elastic modes, plus rounding."
)


@figure("trajectory", "growth")
def growth(results: Results) -> Iterator[Picture]:
    """Growth of rounding errors in a chaotic motion, between runs of flexlink and between flexlink and other engines.

    Draw the difference up to time t on a log axis, the fitted growth, and the time up to which runs are compared.
    """
    for case, rows in results.of_kind("rounding_growth"):
        value = {(row.scene, row.quantity): row.value for row in rows if row.engine == "native"}
        for series in (s for s in results.series[case] if s.what == "growth"):
            scene = series.scene
            figure, (axes,) = stacked_axes(1, 3.6)
            for curve in curves(series):
                seen = curve.y > 0.0
                look = look_of(curve.label) or ENGINES["native"]
                label = look.name if look_of(curve.label) else "flexlink, different rounding"
                axes.plot(curve.x[seen], curve.y[seen], color=look.colour, label=label)
            rate, horizon = value.get((scene, "growth rate")), value.get((scene, "horizon"))
            if rate is not None and horizon is not None:
                first = next(curves(series))
                within = (first.x > 0.0) & (first.x <= horizon) & (first.y > 0.0)
                offset = np.mean(np.log(first.y[within]) - rate * first.x[within])
                axes.plot(first.x[within], np.exp(offset + rate * first.x[within]), "--", color=INK,
                          label=f"growth exp({number(rate)} t / s)")  # fmt: skip
                axes.axvline(horizon, color=GREY, linestyle=":", label=f"compared up to {number(horizon)} s")
            put_labels(axes, series)
            legend_above(figure, axes, 2)
            title = f"{scene}: growth of rounding errors"
            yield Picture(f"{case}.{series.name}", title, figure, GROWTH, series_csv(series))


GROWTH = (
    "Largest joint-angle difference up to time t. Blue: effect of rounding alone. The curve of an engine that computes "
    "the same motion follows the blue one."
)


ERROR = "error [rad]"
X_LABELS = {
    "evaluations per simulated second": "evaluations of q̈ per simulated time [1/s]",
    "core seconds per simulated second": "CPU time / simulated time [1]",
}  # fmt: skip
"""Column → axis label."""
VIEWS = (
    ("step", "step [s]", ERROR, "error against step"),
    ("evaluations", "evaluations per simulated second", ERROR, "error against evaluations of q̈"),
    ("seconds", "core seconds per simulated second", ERROR, "error against CPU time"),
    ("drift", "step [s]", "energy drift [J]", "energy drift against step"),
)


@figure("integrators", "comparison")
def integrators_errors(results: Results) -> Iterator[Picture]:
    """Runge-Kutta methods: error against step, evaluations and CPU time, and energy drift against step.

    Four pictures of every comparison.
    """
    for case, series in results.showing("comparison"):
        for view, x, y, words in VIEWS:
            yield _picture(f"{case}.{series.scene}.{view}", series, x, y, f"{series.scene}: {words}")


def _picture(name: str, series: Series, x: str, y: str, title: str) -> Picture:
    figure, (axes,) = stacked_axes(1, 3.4)
    for place, (method, rows) in enumerate(groups(series)):
        across, up = floats(series.columns[x][rows]), floats(series.columns[y][rows])
        seen = np.isfinite(up) & (up > 0.0)  # a diverged run has no finite error
        axes.plot(across[seen], up[seen], MARKERS[place] + "-", color=CYCLE[place], label=method)
    axes.set(xscale="log", yscale="log", xlabel=X_LABELS.get(x, x), ylabel=y.replace("error", "max |Δq|"))
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    return Picture(name, title, figure, f"{series.title}.", series_csv(series))
