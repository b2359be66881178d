"""Page of a fit: estimates and intervals, measurements and predictions, residuals and their spectrum."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from flexlink.common.output import begin_page
from flexlink.common.wording import plural
from flexlink.identification.checked_page import (
    differences_of_runs,
    identifiability,
    measure_next,
    padded,
    priors_in_words,
    problem_part,
    reproduction,
)
from flexlink.identification.estimate import Estimate
from flexlink.identification.fitted import Fitted, FittedColumn
from flexlink.identification.proposals import Proposals
from flexlink.identification.response_page import compared, pictures
from flexlink.identification.response_page import table as response_table
from flexlink.pages.chapter import Chapter
from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.numbers import JOIN, amount, number
from flexlink.pages.page import write_page
from flexlink.pages.part import Part, written
from flexlink.pages.picture import Picture
from flexlink.pages.style import RC, legend_over, stacked_axes
from flexlink.pages.tables import Cell, Table
from flexlink.pages.verdict import Fact, Report, Verdict


def build(fitted: Fitted, folder: Path, command: str, proposals: Proposals | None = None) -> Report:
    """Write the page and its files: fitted scene, JSON, tables, pictures.

    Raises
    ------
    FlexlinkError
        As in `Fitted.report`.
    """
    begin_page(folder)
    fitted.save(folder / "fit.json")
    with mpl.rc_context(RC):
        parts = {
            "numbers": ("Estimated parameters", "Estimates", _numbers(fitted)),
            "data": ("Measured and predicted", "Data", _data(fitted)),
            "residuals": ("Residuals", "Residuals", _residuals(fitted)),
            "identifiability": ("Identifiability", "Identifiability", identifiability(fitted.check)),
            **measure_next(proposals),
            "problem": ("Problem", "Problem", problem_part(fitted.problem)),
            "reproduce": (
                "How to reproduce this page",
                "Reproduce",
                reproduction(fitted.scene, "fitted.toml", command),
            ),
        }
    definitions: dict[str, str] = {}
    with mpl.rc_context(RC):
        chapters = [
            written(Chapter(name, title, short), part, folder, definitions)
            for name, (title, short, part) in parts.items()
        ]
    verdicts = _verdicts(fitted)
    facts = [Fact(_with_interval(one), f"{one.name}, {_confidence(one)}") for one in fitted.numbers if one.path]
    page = write_page(folder, fitted.scene.name, "fit", chapters, verdicts, facts, definitions)
    return Report(page, tuple(verdicts), chapters)


def _with_interval(one: Estimate) -> str:
    """Estimate ± half-width of its interval, or both ends if the interval is asymmetric; with the unit."""
    level = 0.2  # largest asymmetry of an interval that is written with ±, relative to its half-width
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
    digits = 1 - math.floor(math.log10(half)) if half > 0 else 4  # two digits of the half-width
    both = f"{value:.{max(digits, 0)}f}{JOIN}±{JOIN}{half:.{max(digits, 0)}f}"
    return f"({both}){unit}" if power else f"{both}{unit}"


def _confidence(one: Estimate) -> str:
    """Confidence level and verdict."""
    if not math.isfinite(one.half):
        return "not identifiable"
    wider = "" if not one.widened else ", wider than the linear estimate"
    return f"95 %{wider}" if one.doubt is None else f"95 %{wider}; {one.verdict}"


def _verdicts(fitted: Fitted) -> list[Verdict]:
    identifiable = fitted.identifiable
    doubted = [one for one in fitted.numbers if one.doubt is not None]
    if fitted.check.lost:
        reason = f"{fitted.check.lost[0].text}."
    else:
        reason = " ".join(f"{one.name} is {one.verdict}." for one in doubted)
    unknown = fitted.check.lost or not all(one.determined for one in fitted.numbers)
    found = [
        Verdict(
            "Identifiability", "pass" if identifiable else "fail" if unknown else "doubt",
            "identifiable" if identifiable else "not identifiable" if unknown else "partly identifiable",
            f"{plural(len(fitted.numbers), 'parameter')} identified from the data." if identifiable else reason,
        )
    ]  # fmt: skip
    worst = max(fitted.verdict_columns, key=lambda one: one.off(one.after) / (one.noise or 1.0))
    by = "used as a check" if worst.use == "check" else "fitted; no data were used as a check"
    text = f"{worst.name} of {worst.source}: RMS residual {amount(worst.off(worst.before), worst.unit)} before, "
    text += f"{amount(worst.off(worst.after), worst.unit)} after ({by})."
    better = fitted.better
    found.append(Verdict("Fit", "pass" if better else "fail", "better" if better else "worse", text))
    linear = [one for one in fitted.verdict_columns if one.linear is not None and np.isfinite(one.linear).all()]
    if linear:
        ours, theirs = (float(np.mean([one.fit(model) for one, model in pairs])) for pairs in (
            [(one, one.after) for one in linear], [(one, one.linear) for one in linear]))  # fmt: skip
        found.append(_beside_linear(ours, theirs))
    return found


def _beside_linear(ours: float, theirs: float) -> Verdict:
    """Compare the scene with a free linear model by the percentage of the signal that each explains."""
    fails = 50.0  # a free linear model that explains less of the signal than this [%] is not a reference
    both = f"The fitted scene explains {number(ours)} % of the signal, a free linear model of the same order "
    both += f"{number(theirs)} %: "
    if theirs < fails:
        return Verdict("Model", "info", "not compared", f"{both}the linear model does not apply here.")
    if ours >= theirs - 1.0:  # at most one percentage point less
        return Verdict("Model", "pass", "complete", f"{both}the scene is as good as a linear model.")
    return Verdict("Model", "doubt", "incomplete", f"{both}the scene lacks an effect that no parameter can replace.")


def _numbers(fitted: Fitted) -> Part:
    heads = ["parameter", "unit", "before", "fitted", "from", "to", "± of 95 % [%]", "standard deviation"]
    heads += ["grid error", "input error", "verdict"]
    profile = any(one.profile for one in fitted.numbers)
    lines: list[tuple[Cell, ...]] = [
        (one.name, one.unit or "1", one.start, one.value, one.low, one.high,
         100 * one.half / abs(one.value) if one.value else None, one.deviation, one.u_num, one.u_input, one.verdict,
         *(_ends(one) if profile else ()))
        for one in fitted.numbers
    ]  # fmt: skip
    heads += ["profile from", "profile to"] if profile else []
    sentences = (
        "Columns “from” and “to” are the ends of the 95 % interval. It covers the true value in 95 % of cases if the "
        "model is complete, and accounts for the autocorrelation of the residuals and for the grid error: the error "
        "due to the number of segments, estimated by a fit with twice the hinges.",
        *priors_in_words(fitted.problem),
        *(f"Note: {warning}." for warning in fitted.warnings),
    )
    names = tuple(one.name for one in fitted.numbers)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name, *row.tolist()) for name, row in zip(names, fitted.correlation, strict=True)
    )
    return Part(sentences, tables=(
        Table("numbers", "Estimates with 95 % intervals", tuple(heads), tuple(lines)),
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
        "source", "column", "use", "RMS before", "RMS after", "RMS free linear", "fit before [%]", "fit after [%]",
        "fit free linear [%]", "gain", "bias",
    )  # fmt: skip
    sentences: tuple[str, ...] = (
        "Fit is 1 − |residual| / |measured − mean|. RMS residuals are in the unit of the column.",
        *differences_of_runs(fitted.problem),
    )
    if all(one.linear is None for one in fitted.columns):
        sentences += ("There is no free linear model for comparison: joints swing freely, or there is no run.",)
    single = tuple(
        (f"{one.source}, {one.name}", float(m), float(b), float(a))
        for one in fitted.columns if one.t is None and not one.source.startswith("frf ")
        for m, b, a in zip(one.measured, one.before, one.after, strict=True)
    )  # fmt: skip
    tables = [Table("columns", "Measured columns", heads, lines)]
    if single:
        tables.append(Table("single", "Single measurements", ("measurement", "measured", "before", "fitted"), single))
    responses = compared(fitted)
    tables += [response_table(responses)] if responses else []
    drawn = _drawn(fitted)
    shown = (*((_overlay(drawn), _difference(drawn)) if drawn else ()), *pictures(responses))
    return Part(sentences, pictures=shown, tables=tuple(tables))


def _drawn(fitted: Fitted) -> list[FittedColumn]:
    """Columns to draw: first fitted columns, then columns of check runs."""
    most = 4  # largest number of panels
    runs = (one for one in fitted.columns if one.t is not None)
    return sorted(runs, key=lambda one: one.use == "check")[:most]


def _overlay(drawn: list[FittedColumn]) -> Picture:
    curves = [{"measured": one.measured, "before": one.before, "fitted": one.after} for one in drawn]
    return _panels("beside", "Measured and predicted", "Measured, before and after the fit.", drawn, curves)


def _difference(drawn: list[FittedColumn]) -> Picture:
    visible = 5.0  # the linear model is drawn if its residual is at most this multiple of the scene's residual
    curves = []
    for one in drawn:
        linear = {}
        if one.linear is not None and one.off(one.linear) < visible * one.off(one.after):
            linear = {"free linear": one.linear - one.measured}
        curves.append({"fitted": one.after - one.measured, **linear})
    return _panels("difference", "Residuals", "Predicted − measured.", drawn, curves)


def _panels(
    name: str, title: str, caption: str, drawn: list[FittedColumn], curves: list[dict[str, np.ndarray]]
) -> Picture:
    """Picture with one panel per column; `curves` contains the curves of each panel by name."""
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
    return Picture(name, title, figure, caption, padded(columns))


def _residuals(fitted: Fitted) -> Part:
    white = 0.01  # p-value below which residuals are not white noise
    runs = [one for one in fitted.columns if one.t is not None]
    coloured = [one for one in runs if one.whiteness < white]
    if not runs:
        return Part(("Single measurements only: see the table above.",))
    sentence = (
        f"The residuals of {len(coloured)} of {plural(len(runs), 'column')} are autocorrelated (Ljung-Box, 20 lags, "
        f"p < {white:g}): coloured sensor noise, or an effect that the model lacks."
        if coloured else "The residuals of every column are consistent with white noise (Ljung-Box, 20 lags)."
    )  # fmt: skip
    lines = tuple((one.source, one.name, one.off(one.after), one.noise, one.whiteness) for one in runs)
    heads = ("source", "column", "RMS", "noise", "p of whiteness")
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
    caption = "Square root of the power spectral density of the residuals."
    picture = Picture("spectrum", "Spectrum of the residuals", figure, caption, padded(columns))
    return Part((sentence,), pictures=(picture,), tables=(Table("left", "RMS residuals and whiteness", heads, lines),))


def _spectrum(t: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rate, window = (len(t) - 1) / (t[-1] - t[0]), np.hanning(len(e))
    power = np.abs(np.fft.rfft(window * (e - e.mean()))) ** 2 * 2 / (rate * (window @ window))
    return np.fft.rfftfreq(len(e), 1 / rate)[1:], np.sqrt(power[1:])


def _none(value: float) -> float | None:
    return value if np.isfinite(value) else None
