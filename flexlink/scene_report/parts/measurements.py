"""Compare the run with measurements, and find the parameter of the scene that would explain the difference."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from flexlink.common.wording import plural
from flexlink.data.csv_table import read_measured
from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.numbers import number, percent
from flexlink.pages.part import Part
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
    measured = read_measured(study.against, study.run.columns)
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
    difference = f"RMS difference: {_with_unit(off, name)} in {_bare(name)}{share}."
    sentences = (first, difference, *_about_fits(fits, best))
    text = f"RMS difference in {_bare(name)}."
    if best is not None:
        text += f" Best explanation: {best.number.what} {_change(best)}."
    verdict = Verdict("Measurements", "info", _with_unit(off, name), text)
    tables = [_columns(study, comparison, best)]
    if fits:
        tables.append(_numbers(fits))
    pictures = (_overlay(study, comparison, best), _difference(study, comparison, best))
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


def _bare(name: str) -> str:
    return name.rpartition(" [")[0]


def _with_unit(value: float, name: str) -> str:
    unit = name.rpartition(" [")[2].rstrip("]")
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


def _numbers(fits: Sequence[Fit]) -> Table:
    heads = ("parameter", "in the scene", "fitted", "±", "factor", "remaining difference", "path")
    lines = tuple(
        (f.number.what, f.number.value, f.value, f.spread, f.factor, f.remaining, f.number.path) for f in fits
    )
    return Table("numbers", "Parameters of the scene, each fitted alone", heads, lines)


def _drawn(comparison: Comparison) -> list[str]:
    """Return the first four columns, which are plotted; more would make the page long."""
    return list(comparison.measured)[:4]


def _overlay(study: Study, comparison: Comparison, best: Fit | None) -> Picture:
    figure, axes = stacked_axes(len(_drawn(comparison)), 2.2)
    columns: dict[str, np.ndarray] = {"t [s]": comparison.t}
    found = {"run": comparison.at_times(study.run)} | ({"fitted": comparison.at_times(best.run)} if best else {})
    for panel, name in zip(axes, _drawn(comparison), strict=True):
        panel.plot(comparison.t, comparison.measured[name], ".", color=GREY, markersize=3, label="measured")
        panel.plot(comparison.t, found["run"][name], color=VERMILION, label="this scene")
        if best:
            panel.plot(comparison.t, found["fitted"][name], color=BLUE, linestyle="--", label="fitted")
        panel.set_ylabel(name)
    for name, column in comparison.measured.items():
        columns |= {f"measured {name}": column} | {f"{label} {name}": run[name] for label, run in found.items()}
    return _finished("beside", "Measured and computed", "Measurement and run", figure, columns, best)


def _difference(study: Study, comparison: Comparison, best: Fit | None) -> Picture:
    figure, axes = stacked_axes(len(_drawn(comparison)), 2.0)
    columns: dict[str, np.ndarray] = {"t [s]": comparison.t}
    runs = [("this scene", VERMILION, study.run)] + ([("fitted", BLUE, best.run)] if best else [])
    for panel, name in zip(axes, _drawn(comparison), strict=True):
        panel.axhline(0.0, color=INK, linewidth=0.8)
        for label, colour, run in runs:
            columns[f"{label} {name}"] = comparison.differences(run)[name]
            panel.plot(comparison.t, columns[f"{label} {name}"], color=colour, label=label)
        panel.set_ylabel(f"Δ {name}")
        panel.ticklabel_format(axis="y", style="sci", scilimits=(-3, 3))
    return _finished("difference", "Difference", "Run minus measurement", figure, columns, best)


def _finished(
    name: str, title: str, caption: str, figure: Figure, columns: dict[str, np.ndarray], best: Fit | None
) -> Picture:
    caption += f", also with fitted {best.number.what}." if best else "."
    return picture_of(name, title, caption, figure.axes, "time [s]", columns)
