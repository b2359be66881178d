"""Compare the run with measurements, and find the parameter of the scene that would explain the difference."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from flexlink.common.wording import plural
from flexlink.data.csv_table import head_of, read_measured
from flexlink.pages.colours import BLUE, GREY, VERMILION
from flexlink.pages.numbers import number, percent
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import stacked_axes
from flexlink.pages.tables import Cell, Table
from flexlink.pages.verdict import Verdict
from flexlink.scene_report.fitting import Comparison, Fit
from flexlink.scene_report.study import Study


def made(study: Study) -> Part | None:
    """Build the chapter."""
    if study.against is None or not study.measurements:
        return None
    measured = read_measured([study.against], study.run.columns)
    comparison = Comparison(study.scene, study.run, measured)
    if len(comparison.t) < 2:
        samples = f"samples of {study.against.name} ({measured.t[0]:g} … {measured.t[-1]:g} s)"
        text = f"Fewer than two {samples} are within the run ({study.run.t[0]:g} … {study.run.t[-1]:g} s). "
        text += "Subtract the time at which the run begins; name times in ms 't [ms]'."
        return Part((text,), (Verdict("Measurements", "fail", "not compared", text),))
    fits = comparison.fits
    best = fits[0] if fits else None
    # the cause removes most of the mean square difference, by a change of over two standard deviations
    if best and not (best.explained > 0.5 and abs(best.value - best.number.value) > 2 * best.spread):
        best = None
    span = f"{number(float(comparison.t[0]))} to {number(float(comparison.t[-1]))} s"
    columns = plural(len(comparison.measured), "column")
    first = f"{study.against.name}: {columns}, {len(comparison.t)} samples from {span}"
    first += f"; {comparison.left_out} outside the run are ignored." if comparison.left_out else "."
    every = comparison.off(study.run)  # the worst column has the largest difference relative to its spread
    name = max(every, key=lambda name: every[name] / (float(np.nanstd(comparison.measured[name])) or 1.0))
    off = every[name]
    size = float(np.nanmax(comparison.measured[name]) - np.nanmin(comparison.measured[name]))
    share = f", {percent(off / size)} of the measured range" if size > 0 else ""
    difference = f"RMS difference: {_with_unit(off, name)} in {head_of(name)[0]}{share}."
    sentences = (first, difference, *_about_fits(fits, best))
    text = f"RMS difference in {head_of(name)[0]}."
    if best is not None:
        text += f" Best explanation: {best.number.what} {_change(best)}."
    verdict = Verdict("Measurements", "info", _with_unit(off, name), text)
    tables = [_columns(study, comparison, best)]
    if fits:
        heads = ("parameter", "in the scene", "fitted", "±", "factor", "remaining difference", "path")
        lines = tuple(
            (f.number.what, f.number.value, f.value, f.spread, f.factor, f.remaining, f.number.path) for f in fits
        )
        tables.append(Table("numbers", "Parameters of the scene, each fitted alone", heads, lines))
    pictures = tuple(_pictures(study, comparison, best))
    return Part(tuple(filter(None, sentences)), (verdict,), pictures, tuple(tables))


def _about_fits(fits: Sequence[Fit], best: Fit | None) -> list[str]:
    if not fits:
        return ["No single parameter of the scene explains the difference, not even in part."]
    if best is None:
        return [
            "No single parameter of the scene explains the difference; check the units and the order of the columns. "
            f"With the best, {fits[0].number.what} {_change(fits[0])}, {percent(fits[0].remaining)} of it remains."
        ]
    value = f"{number(best.value, 4)} ± {number(best.spread, 2)} instead of {number(best.number.value)}"
    explained = f"Best explanation: {best.number.what} {_change(best)}, {value}"
    sentences = [f"{explained}; {percent(best.remaining)} of the difference remains."]
    clearly = 2.0  # a parameter is the cause if all others leave at least twice the difference
    near = [fit for fit in fits[1:] if fit.remaining < clearly * best.remaining]
    rivals = [f"{fit.number.what} ({_change(fit)}; {percent(fit.remaining)} remains)" for fit in near]
    if rivals:
        sentences.append(f"The cause is uncertain, because other parameters fit nearly as well: {', '.join(rivals)}.")
    elif len(fits) > 1:
        sentences.append(f"With the next best, {fits[1].number.what}, {percent(fits[1].remaining)} remains.")
    alone = "Each parameter is fitted alone; ± is one standard deviation if the remaining difference is noise."
    return [*sentences, alone]


def _change(fit: Fit) -> str:
    """Return the change from the scene's value to the best value, in %, or in ° or m for an initial position."""
    by, spread, unit = fit.value - fit.number.value, fit.spread, fit.number.sign
    if not fit.number.is_angle:
        by, spread, unit = 100 * by / fit.number.value, 100 * spread / abs(fit.number.value), " %"
    return f"{by:+.3g} ± {number(spread, 2)}{unit}".replace("-", "−")


def _with_unit(value: float, name: str) -> str:
    unit = head_of(name)[1]
    return f"{number(1e3 * value)} mm" if unit == "m" and value < 0.1 else f"{number(value)} {unit}"


def _columns(study: Study, comparison: Comparison, best: Fit | None) -> Table:
    heads = ["column", "RMS difference", "largest difference", "at [s]"]
    off, differences = comparison.off(study.run), comparison.differences(study.run)
    lines: list[tuple[Cell, ...]] = []
    for name, column in differences.items():
        worst = int(np.nanargmax(np.abs(column)))
        line = name, off[name], abs(float(column[worst])), float(comparison.t[worst])
        lines.append((*line, best.off[name]) if best else line)
    if best:
        heads.append("RMS after fitting")
    return Table("measured", "Run minus measurement", tuple(heads), tuple(lines))


def _pictures(study: Study, comparison: Comparison, best: Fit | None) -> Iterator[Picture]:
    """Yield the measurement with the runs, and the runs minus the measurement."""
    runs = {"this scene": study.run} | ({"fitted": best.run} if best else {})
    looks: dict[str, dict[str, Any]] = {
        "measured": {"marker": ".", "linestyle": "", "color": GREY, "markersize": 3},
        "this scene": {"color": VERMILION}, "fitted": {"color": BLUE, "linestyle": "--"},
    }  # fmt: skip
    beside = {"measured": comparison.measured} | {label: comparison.at_times(run) for label, run in runs.items()}
    apart = {label: comparison.differences(run) for label, run in runs.items()}
    for name, title, caption, sign, curves in (
        ("beside", "Measured and computed", "Measurement and run", "", beside),
        ("difference", "Difference", "Run minus measurement", "Δ ", apart),
    ):
        _, axes = stacked_axes(min(len(comparison.measured), 4), 2.2)  # more columns would make the page long
        for panel, column in zip(axes, comparison.measured, strict=False):
            for label, values in curves.items():
                panel.plot(comparison.t, values[column], label=label, **looks[label])
            panel.set_ylabel(f"{sign}{column}")
            panel.ticklabel_format(axis="y", style="sci", scilimits=(-3, 3))
        columns = {f"{label} {column}": y for label, values in curves.items() for column, y in values.items()}
        also = f", also with fitted {best.number.what}." if best else "."
        yield picture_of(name, title, caption + also, axes, "time [s]", {"t [s]": comparison.t} | columns)
