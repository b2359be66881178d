"""Pages of fits and of checks: estimates and intervals, measurements and predictions, residuals, identifiability."""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from msgspec.structs import replace

from flexlink.common.output import begin_page, write_text
from flexlink.common.wording import plural, truncated
from flexlink.data.documents import in_json
from flexlink.describe.scene import Scene
from flexlink.describe.writing import toml_of, without_defaults
from flexlink.identification.data_page import Chapters, compared, data_chapters, look, response_picture, response_table
from flexlink.identification.fitted import Estimate, Fitted, FittedColumn
from flexlink.identification.identifiability import WIDE, Check, document
from flexlink.identification.problem import FitProblem
from flexlink.identification.proposals import Proposals
from flexlink.pages.colours import INK
from flexlink.pages.numbers import JOIN, amount, number
from flexlink.pages.page import Part, write_page, written
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import RC, stacked_axes
from flexlink.pages.tables import Cell, Table, columns_csv
from flexlink.pages.verdict import Chapter, Fact, Report, Verdict

START, PROBLEM = "start.toml", "problem.toml"
"""Files next to the page: the scene before the fit, and the problem, which refers to this scene."""


def build(fitted: Fitted, folder: Path, command: str, proposals: Proposals | None = None) -> Report:
    """Write the page and its files: fitted scene, JSON, tables, pictures; with `proposals` of experiments."""
    begin_page(folder)
    fitted.save(folder / "fit.json")
    facts = [Fact(_with_interval(one), f"{one.name}, {_confidence(one)}") for one in fitted.numbers if one.path]
    with mpl.rc_context(RC):
        parts = {
            "numbers": ("Estimated parameters", "Estimates", _numbers(fitted)),
            "data": ("Measured and predicted", "Data", _data(fitted)),
            "residuals": ("Residuals", "Residuals", _residuals(fitted)),
            **_identifiability(fitted.check, proposals),
            **_problem(fitted.problem),
            **_reproduction(fitted.scene, "fitted.toml", command),
        }
        return _written(folder, fitted.scene.name, parts, _verdicts(fitted), facts)


def build_check(
    problem: FitProblem, check: Check, folder: Path, command: str, proposals: Proposals | None = None
) -> Report:
    """Write page and files of a check, or of a fit that it refused, the data first; with `proposals` of experiments."""
    begin_page(folder)
    write_text(folder / "check.json", f"{in_json(document(check))}\n")
    identifiable = f"{plural(len(check.names), 'parameter')} identifiable at the initial guess. Nothing was fitted."
    refused = f"Nothing was fitted: {'; also '.join(one.text for one in check.lost)}."
    verdict = Verdict(
        "Identifiability", "pass" if check.passed else "fail", "identifiable" if check.passed else "refused",
        identifiable if check.passed else refused,
    )  # fmt: skip
    with mpl.rc_context(RC):
        parts = {
            **data_chapters(problem),
            **_identifiability(check, proposals),
            **_problem(problem, _priors_in_words(problem) + _differences_of_runs(problem)),
            **_reproduction(problem.scene, START, command),
        }
        return _written(folder, problem.scene.name, parts, [verdict])


def _written(
    folder: Path, name: str, parts: Chapters, verdicts: Sequence[Verdict], facts: Sequence[Fact] = ()
) -> Report:
    definitions: dict[str, str] = {}
    chapters = [
        written(Chapter(id, title, short), part, folder, definitions) for id, (title, short, part) in parts.items()
    ]
    return Report(write_page(folder, name, "fit", chapters, verdicts, facts, definitions), tuple(verdicts), chapters)


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
    return [*found, _of_noise(fitted)]


def _of_noise(fitted: Fitted) -> Verdict:
    """Whether what the model leaves is noise."""
    found = {one.id: f"{one[0].upper()}{one[1:]}." for one in reversed(fitted.warnings)}
    if not fitted.explained:
        return Verdict("Residuals", "fail", "not explained", found["not-explained"])
    if "noise-not-known" in found:
        return Verdict("Residuals", "info", "noise not known", found["noise-not-known"])
    return Verdict("Residuals", "pass", "noise", "The residuals of fitted columns are no more than their noise.")


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
         *(map(_none, one.profile or (math.nan, math.nan)) if profile else ()))
        for one in fitted.numbers
    ]  # fmt: skip
    heads += ["profile from", "profile to"] if profile else []
    sentences = (
        "Columns “from” and “to” are the ends of the 95 % interval. It covers the true value in 95 % of cases if the "
        "model is complete, and accounts for the autocorrelation of the residuals and for the grid error: the error "
        "due to the number of segments, estimated by a fit with twice the hinges.",
        *_priors_in_words(fitted.problem),
        *(f"Note: {warning}." for warning in fitted.warnings),
    )
    names = tuple(one.name for one in fitted.numbers)
    pairs = zip(names, fitted.correlation, strict=True)
    rows: tuple[tuple[Cell, ...], ...] = tuple((name, *row.tolist()) for name, row in pairs)
    return Part(sentences, tables=(
        Table("numbers", "Estimates with 95 % intervals", tuple(heads), tuple(lines)),
        Table("correlation", "Correlation", ("", *names), rows, to_look_up=True),
    ))  # fmt: skip


def _data(fitted: Fitted) -> Part:
    lines = tuple(
        (one.source, one.name, one.use, one.off(one.before), one.off(one.after),
         None if one.linear is None else one.off(one.linear), *(_none(one.fit(m)) for m in (one.before, one.after,
         one.linear)), _none(one.unexplained), one.floor, one.floor_from or "not known", one.gain, one.bias)
        for one in fitted.columns
    )  # fmt: skip
    heads = (
        "source", "column", "use", "RMS before", "RMS after", "RMS free linear", "fit before [%]", "fit after [%]",
        "fit free linear [%]", "unexplained [%]", "noise", "noise is", "gain", "bias",
    )  # fmt: skip
    sentences: tuple[str, ...] = (
        "Fit is 1 − |residual| / |measured − mean|. RMS residuals are in the unit of the column.",
        *_differences_of_runs(fitted.problem),
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
    return Part(sentences, pictures=(*_beside(fitted), *map(response_picture, responses)), tables=tuple(tables))


def _drawn(fitted: Fitted) -> list[FittedColumn]:
    """Columns to draw: first fitted columns, then columns of check runs."""
    most = 4  # largest number of panels
    return sorted((one for one in fitted.columns if one.t is not None), key=lambda one: one.use == "check")[:most]


def _beside(fitted: Fitted) -> tuple[Picture, ...]:
    """Pictures of the measured columns beside their predictions, and of the residuals; none without runs."""
    visible = 5.0  # the linear model is drawn if its residual is at most this multiple of the scene's residual
    if not (drawn := _drawn(fitted)):
        return ()
    curves = [{"measured": one.measured, "before": one.before, "fitted": one.after} for one in drawn]
    residuals = [{"fitted": one.after - one.measured} for one in drawn]
    for one, several in zip(drawn, residuals, strict=True):
        if one.linear is not None and one.off(one.linear) < visible * one.off(one.after):
            several["free linear"] = one.linear - one.measured
    return (
        _panels("beside", "Measured and predicted", "Measured, before and after the fit.", drawn, curves),
        _panels("difference", "Residuals", "Predicted − measured.", drawn, residuals),
    )


def _panels(
    name: str, title: str, caption: str, drawn: list[FittedColumn], curves: list[dict[str, np.ndarray]]
) -> Picture:
    """Picture with one panel per column; `curves` contains the curves of each panel by name."""
    _, axes = stacked_axes(len(drawn), 2.2, share=False)
    columns: dict[str, np.ndarray] = {}
    for panel, one, several in zip(axes, drawn, curves, strict=True):
        columns[f"{one.source}: t [s] of {one.name}"] = np.asarray(one.t)
        for label, values in several.items():
            panel.plot(one.t, values, label=label, **look(label))
            columns[f"{one.source}: {label} {one.name}"] = values
        panel.set_ylabel(one.name)
        panel.set_title(f"{one.source} ({one.use})", loc="left")
    return picture_of(name, title, caption, axes, "time [s]", columns)


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
    _, axes = stacked_axes(len(drawn), 2.0, share=False)
    columns: dict[str, np.ndarray] = {}
    for panel, one in zip(axes, drawn, strict=True):
        f, root = _spectrum(np.asarray(one.t), one.after - one.measured)
        panel.loglog(f, root, color=INK, linewidth=0.9)
        panel.set_ylabel(f"{one.unit}/√Hz")
        panel.set_title(f"{one.source}: {one.name}", loc="left")
        columns |= {f"{one.source}: f of {one.name} [Hz]": f, f"{one.source}: {one.name}": root}
    caption = "Square root of the power spectral density of the residuals."
    picture = picture_of("spectrum", "Spectrum of the residuals", caption, axes, "frequency [Hz]", columns)
    return Part((sentence,), pictures=(picture,), tables=(Table("left", "RMS residuals and whiteness", heads, lines),))


def _spectrum(t: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rate, window = (len(t) - 1) / (t[-1] - t[0]), np.hanning(len(e))
    power = np.abs(np.fft.rfft(window * (e - e.mean()))) ** 2 * 2 / (rate * (window @ window))
    return np.fft.rfftfreq(len(e), 1 / rate)[1:], np.sqrt(power[1:])


def _none(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _identifiability(check: Check, proposals: Proposals | None) -> Chapters:
    """Chapters on an identifiability check, and on what to measure next if there are proposals."""
    found = {"identifiability": ("Identifiability", "Identifiability", identifiability(check))}
    return found if proposals is None else found | {"next": ("What to measure next", "Next", proposals.part())}


def identifiability(check: Check) -> Part:
    """Result of an identifiability check."""
    heads = ("parameter", "± of 95 % [% of value or unit]", "grid error [% of value or unit]")
    lines = tuple(
        (name, 100 * WIDE * float(part) if np.isfinite(part) else None, None if u is None else 100 * float(u))
        for name, part, u in itertools.zip_longest(check.names, check.expected, check.grid)
    )
    sentences = tuple(f"{one.text}." for one in check.directions)
    sentences = sentences or ("Every parameter, and every combination of parameters, is identifiable.",)
    values = tuple((k, float(s)) for k, s in enumerate(check.singular_values, 1))
    return Part((*sentences, *(f"{note}." for note in check.notes)), tables=(
        Table("expected", "Expected 95 % intervals, linear estimate with white noise", heads, lines),
        Table("singular_values", "Singular values of the Jacobian over the noise", ("number", "value"), values,
              to_look_up=True),
    ))  # fmt: skip


def _problem(problem: FitProblem, sentences: tuple[str, ...] = ()) -> Chapters:
    """Chapter with the problem, its scene and its runs, as files."""
    files = {START: problem.scene.to_toml()}
    runs = []
    for k, run in enumerate(problem.run, 1):
        name = f"run_{k}.csv"
        if run.columns:
            files[name] = columns_csv({head: np.array(column) for head, column in run.columns.items()})
        runs.append(replace(run, columns={}, file=run.file or name))
    written_problem = without_defaults(replace(problem, run=tuple(runs))) | {"scene": START}
    text = toml_of({"scene": START, **written_problem})
    about = (f"{problem.about.rstrip('.')}.",) if problem.about else ()
    part = Part((*about, *sentences), literal=text, literal_title="Problem file", files={PROBLEM: text, **files})
    return {"problem": ("Problem", "Problem", part)}


def _priors_in_words(problem: FitProblem) -> tuple[str, ...]:
    """One sentence for each prior."""
    return tuple(
        f"Prior: {one.path} is {one.prior[0]:.6g} ± {one.prior[1]:.2g} (standard deviation)."
        for one in problem.parameter if one.prior
    )  # fmt: skip


def _differences_of_runs(problem: FitProblem) -> tuple[str, ...]:
    """One sentence for each run that differs from the scene."""
    return tuple(
        f"Differences of {run.name} from the scene: "
        f"{', '.join(f'{path} = {truncated(value)}' for path, value in run.set.items())}."
        for run in problem.run if run.set
    )  # fmt: skip


def _reproduction(scene: Scene, name: str, command: str) -> Chapters:
    """Chapter with the command and the scene."""
    sentences = (f"Made by: {command}",) if command else ()
    again = f"To repeat it with the files next to this page: flexlink fit {PROBLEM}"
    part = Part((*sentences, again), literal=scene.to_toml(), files={name: scene.to_toml()})
    return {"reproduce": ("How to reproduce this page", "Reproduce", part)}
