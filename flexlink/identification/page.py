"""The page of a fit: numbers and their intervals, data beside the scene, residuals and their spectrum."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from flexlink.common.output import make_folder
from flexlink.identification.checked_page import asked, known_before, reproduced, told, what_differs
from flexlink.identification.fitted import Estimate, Fitted, FittedColumn
from flexlink.pages.chapter import Chapter
from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.numbers import JOIN, amount, number, plural
from flexlink.pages.page import write_page
from flexlink.pages.part import Part, written
from flexlink.pages.picture import Picture
from flexlink.pages.style import RC, legend_over, stacked_axes
from flexlink.pages.tables import Cell, Table, columns_csv
from flexlink.pages.verdict import Fact, Report, Verdict


def build(fitted: Fitted, folder: Path, command: str) -> Report:
    """Write the page and its files: fitted scene, JSON, tables, pictures. Errors as in `Fitted.report`."""
    make_folder(folder)
    fitted.save(folder / "fit.json")
    parts = {
        "numbers": ("Numbers that were found", "Numbers", _numbers(fitted)),
        "data": ("Measured and computed", "Data", _data(fitted)),
        "left": ("What is left", "Residuals", _left(fitted)),
        "told": ("What the data can tell", "Identifiability", told(fitted.check)),
        "asked": ("What was asked", "Problem", asked(fitted.problem)),
        "reproduce": ("How to reproduce", "Reproduce", reproduced(fitted.scene, "fitted.toml", command)),
    }
    definitions: dict[str, str] = {}
    with mpl.rc_context(RC):
        chapters = [
            written(Chapter(name, title, short), part, folder, definitions)
            for name, (title, short, part) in parts.items()
        ]
    verdicts = _verdicts(fitted)
    facts = [Fact(_told(one), f"{one.name}, {_how_known(one)}") for one in fitted.numbers if one.path]
    page = write_page(folder, fitted.scene.name, "fit", chapters, verdicts, facts, definitions)
    return Report(page, tuple(verdicts), chapters)


def _told(one: Estimate) -> str:
    """A number as it is told first: ±, or both ends where they are not alike, and its unit."""
    level = 0.2  # part of half an interval by which its middle may be off, and ± be printed
    unit = f" {one.unit}" if one.unit else ""
    if not math.isfinite(one.half):
        return f"{number(one.value, 4)}{unit}"
    power = 0
    if one.value and not 1e-3 <= abs(one.value) < 1e4:
        power = math.floor(math.log10(abs(one.value)))
        unit = f"{JOIN}×{JOIN}{number(10.0**power)}{unit}"
    value, half, low, high = (part / 10**power for part in (one.value, one.half, one.low, one.high))
    if abs((low + high) / 2 - value) > level * half:
        return f"{number(value, 4)} ({number(low)}{JOIN}…{JOIN}{number(high)}){unit}"
    digits = 1 - math.floor(math.log10(half)) if half > 0 else 4  # two of what is not known
    both = f"{value:.{max(digits, 0)}f}{JOIN}±{JOIN}{half:.{max(digits, 0)}f}"
    return f"({both}){unit}" if power else f"{both}{unit}"


def _how_known(one: Estimate) -> str:
    if not math.isfinite(one.half):
        return "not held by the data"
    return f"95 %{', wider than slopes say' if one.widened else ''}"


def _verdicts(fitted: Fitted) -> list[Verdict]:
    held = fitted.identifiable
    found = [
        Verdict(
            "Identifiability", "pass" if held else "fail", "held" if held else "not held",
            f"The data hold {plural(len(fitted.numbers), 'number')}." if held else
            f"{fitted.check.lost[0].text if fitted.check.lost else fitted.warnings[0]}.",
        )
    ]  # fmt: skip
    worst = max(fitted.judged, key=lambda one: one.off(one.after) / (one.noise or 1.0))
    by = "kept to check" if worst.use == "check" else "fitted; none were kept to check"
    text = f"{worst.name} of {worst.source}: RMS difference {amount(worst.off(worst.before), worst.unit)} before, "
    text += f"{amount(worst.off(worst.after), worst.unit)} after ({by})."
    better = fitted.better
    found.append(Verdict("Fit", "pass" if better else "fail", "better" if better else "worse", text))
    linear = [one for one in fitted.judged if one.linear is not None and np.isfinite(one.linear).all()]
    if linear:
        ours, theirs = (float(np.mean([one.fit(model) for one, model in pairs])) for pairs in (
            [(one, one.after) for one in linear], [(one, one.linear) for one in linear]))  # fmt: skip
        found.append(_beside_linear(ours, theirs))
    return found


def _beside_linear(ours: float, theirs: float) -> Verdict:
    """The scene beside a free linear model, by what each explains of the signal [%]."""
    fails = 50.0  # part of the signal [%] below which a free linear model is no measure
    both = f"The fitted scene explains {number(ours)} % of the signal, a free linear model of the same order "
    both += f"{number(theirs)} %: "
    if theirs < fails:
        return Verdict("Model", "info", "not compared", f"{both}that one does not hold here, and tells nothing.")
    if ours >= theirs - 1.0:  # %
        return Verdict("Model", "pass", "complete", f"{both}nothing is missing that a linear model has.")
    return Verdict("Model", "doubt", "incomplete", f"{both}no values of its numbers give all that was measured.")


def _numbers(fitted: Fitted) -> Part:
    heads = ["number", "unit", "before", "fitted", "from", "to", "± of 95 % [%]", "standard deviation"]
    profile = any(one.profile for one in fitted.numbers)
    lines: list[tuple[Cell, ...]] = [
        (one.name, one.unit or "1", one.start, one.value, one.low, one.high,
         100 * one.half / abs(one.value) if one.value else None, one.deviation, *(_ends(one) if profile else ()))
        for one in fitted.numbers
    ]  # fmt: skip
    heads += ["profile from", "profile to"] if profile else []
    sentences = (
        "From and to are the ends of intervals that hold the true value in 95 % of cases if the scene is right; they "
        "count the autocorrelation of the residuals.",
        *known_before(fitted.problem),
        *(f"Note: {warning}." for warning in fitted.warnings),
    )
    names = tuple(one.name for one in fitted.numbers)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name, *row.tolist()) for name, row in zip(names, fitted.correlation, strict=True)
    )
    return Part(sentences, tables=(
        Table("numbers", "Numbers with 95 % intervals", tuple(heads), tuple(lines)),
        Table("correlation", "Correlation", ("", *names), rows, to_look_up=True),
    ))  # fmt: skip


def _ends(one: Estimate) -> tuple[float | None, float | None]:
    low, high = one.profile or (math.nan, math.nan)
    return _none(low), _none(high)


def _data(fitted: Fitted) -> Part:
    lines = tuple(
        (one.source, one.name, one.use, one.off(one.before), one.off(one.after),
         None if one.linear is None else one.off(one.linear), *(_none(one.fit(m)) for m in (one.before, one.after,
         one.linear)), one.gain, one.bias)
        for one in fitted.columns
    )  # fmt: skip
    heads = (
        "of", "column", "use", "RMS before", "RMS after", "RMS free linear", "fit before [%]", "fit after [%]",
        "fit free linear [%]", "gain", "bias",
    )  # fmt: skip
    sentences: tuple[str, ...] = (
        "Fit is 1 − |difference| / |measured less its mean|. RMS in the column's unit.",
        *what_differs(fitted.problem),
    )
    if all(one.linear is None for one in fitted.columns):
        sentences += ("No free linear model beside it: joints swing free, or there is no run.",)
    single = tuple(
        (f"{one.source}, {one.name}", float(m), float(b), float(a))
        for one in fitted.columns if one.t is None
        for m, b, a in zip(one.measured, one.before, one.after, strict=True)
    )  # fmt: skip
    tables = [Table("columns", "Measured columns", heads, lines)]
    if single:
        tables.append(Table("single", "Single numbers", ("number", "measured", "before", "fitted"), single))
    drawn = _drawn(fitted)
    return Part(sentences, pictures=(_overlay(drawn), _difference(drawn)) if drawn else (), tables=tuple(tables))


def _drawn(fitted: Fitted) -> list[FittedColumn]:
    """Columns that were fitted, then those kept to check."""
    most = 4  # more panels are too many for a page
    runs = (one for one in fitted.columns if one.t is not None)
    return sorted(runs, key=lambda one: one.use == "check")[:most]


def _overlay(drawn: list[FittedColumn]) -> Picture:
    curves = [{"measured": one.measured, "before": one.before, "fitted": one.after} for one in drawn]
    return _panels("beside", "Measured and computed", "Measured, before and after the fit.", drawn, curves)


def _difference(drawn: list[FittedColumn]) -> Picture:
    visible = 5.0  # largest curve that is drawn beside the residuals, over them
    curves = []
    for one in drawn:
        linear = {}
        if one.linear is not None and one.off(one.linear) < visible * one.off(one.after):
            linear = {"free linear": one.linear - one.measured}
        curves.append({"fitted": one.after - one.measured, **linear})
    return _panels("difference", "Computed less measured", "Computed less measured.", drawn, curves)


def _panels(
    name: str, title: str, caption: str, drawn: list[FittedColumn], curves: list[dict[str, np.ndarray]]
) -> Picture:
    """One panel a column, of what is drawn of it by name."""
    looks: dict[str, dict[str, Any]] = {
        "measured": {"color": GREY, "linestyle": "", "marker": ".", "markersize": 3}, "fitted": {"color": BLUE},
        "before": {"color": VERMILION, "linewidth": 0.8}, "free linear": {"color": INK, "linewidth": 0.8},
    }  # fmt: skip
    figure, axes = stacked_axes(len(drawn), 2.2, share=False)
    columns: dict[str, np.ndarray] = {}
    for panel, one, several in zip(axes, drawn, curves, strict=True):
        columns[f"{one.source}: t [s] of {one.name}"] = np.asarray(one.t)
        for label, values in several.items():
            panel.plot(one.t, values, label=label, **looks[label])
            columns[f"{one.source}: {label} {one.name}"] = values
        panel.set_ylabel(one.name)
        panel.set_title(f"{one.source} ({one.use})", loc="left")
    axes[-1].set_xlabel("time [s]")
    legend_over(axes[0], figure=figure)
    return Picture(name, title, figure, caption, _padded(columns))


def _left(fitted: Fitted) -> Part:
    white = 0.01  # probability below which residuals are no white noise
    runs = [one for one in fitted.columns if one.t is not None]
    coloured = [one for one in runs if one.whiteness < white]
    if not runs:
        return Part(("Single numbers only: see the table above.",))
    said = (
        f"{len(coloured)} of {plural(len(runs), 'column')} leave more than white noise (Ljung and Box, 20 lags, "
        f"p < {white:g}): coloured noise of instruments, or something that the scene does not have."
        if coloured else "What is left looks like white noise in every column (Ljung and Box, 20 lags)."
    )  # fmt: skip
    lines = tuple((one.source, one.name, one.off(one.after), one.noise, one.whiteness) for one in runs)
    heads = ("of", "column", "RMS", "noise", "p of whiteness")
    drawn = _drawn(fitted)
    figure, axes = stacked_axes(len(drawn), 2.0, share=False)
    columns: dict[str, np.ndarray] = {}
    for panel, one in zip(axes, drawn, strict=True):
        f, root = _spectrum(np.asarray(one.t), one.after - one.measured)
        panel.loglog(f, root, color=INK, linewidth=0.9)
        panel.set_ylabel(f"{one.unit}/√Hz")
        panel.set_title(f"{one.source}: {one.name}", loc="left")
        columns |= {f"{one.source}: f of {one.name} [Hz]": f, f"{one.source}: {one.name}": root}
    axes[-1].set_xlabel("frequency [Hz]")
    caption = "Square root of the residuals' power spectral density."
    picture = Picture("spectrum", "Spectrum of what is left", figure, caption, _padded(columns))
    return Part((said,), pictures=(picture,), tables=(Table("left", "What is left", heads, lines),))


def _spectrum(t: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rate, window = (len(t) - 1) / (t[-1] - t[0]), np.hanning(len(e))
    power = np.abs(np.fft.rfft(window * (e - e.mean()))) ** 2 * 2 / (rate * (window @ window))
    return np.fft.rfftfreq(len(e), 1 / rate)[1:], np.sqrt(power[1:])


def _padded(columns: dict[str, np.ndarray]) -> str:
    longest = max(len(column) for column in columns.values())
    return columns_csv({
        name: np.pad(column, (0, longest - len(column)), constant_values=np.nan) for name, column in columns.items()
    })  # fmt: skip


def _none(value: float) -> float | None:
    return value if np.isfinite(value) else None
