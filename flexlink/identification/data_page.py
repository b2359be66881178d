"""Chapters of a check's page that show the data: columns beside their prediction, residuals, spectra."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array, Complex
from flexlink.common.wording import plural
from flexlink.describe.scene import Scene
from flexlink.dynamics.vibration.steady import modes_at_rest
from flexlink.identification.block import GAP, UNEVEN, Block, noise_in, outliers_in, unit_in
from flexlink.identification.coordinates import coordinates_of, guess_of, run_coordinates
from flexlink.identification.data import Source, sources_of
from flexlink.identification.fitted import Fitted
from flexlink.identification.frequency_response import Response, at_rest, measured_response
from flexlink.identification.likelihood import Row, likelihood
from flexlink.identification.problem import FitProblem
from flexlink.identification.signals import Signals
from flexlink.pages.colours import BLUE, GREY, INK, ORANGE, PALE, VERMILION
from flexlink.pages.page import Part
from flexlink.pages.picture import Picture, picture_of
from flexlink.pages.style import stacked_axes
from flexlink.pages.tables import Table

Chapters = dict[str, tuple[str, str, Part]]  # parts of a page by name, with their titles and short titles


@dataclasses.dataclass(frozen=True, eq=False)
class Shown:
    """A measured column of a run with its prediction at the initial guess."""

    # source, block: the run and the column
    source: Source
    block: Block
    # prediction at the times of the samples, with optimal gain and bias if these are unknown, shape (n,)
    predicted: Array
    gaps: Array  # first and last times of the gaps in the samples, shape (gaps, 2)
    uneven: Array  # times of samples that follow the one before at another interval than usual, without gaps
    outliers: np.ndarray  # numbers of the samples that are outliers

    @property
    def t(self) -> Array:
        """Times of the samples [s]."""
        return np.asarray(self.block.t)

    @property
    def title(self) -> str:
        """Run and column."""
        return f"{self.source.name}: {self.block.name}"


def data_chapters(problem: FitProblem) -> Chapters:
    """Chapters "Data" and "Spectra" for the data of a problem, with predictions at the initial guess."""
    predicted = [*_predicted(problem)]
    shown = [_shown(source, row) for source, rows in predicted if source.is_run for row in rows]
    single = [(source, rows) for source, rows in predicted if not source.is_run]
    responses = [
        Compared(source.name, source.use, source.response, {"before": rows[0].y + 1j * rows[1].y})
        for source, rows in single if source.response is not None
    ]  # fmt: skip
    found = {"data": ("Measured and predicted at the initial guess", "Data", _data(shown, single))}
    if responses:
        part = Part(pictures=tuple(map(response_picture, responses)), tables=(response_table(responses),))
        found["responses"] = ("Frequency responses", "Responses", part)
    if shown:
        found["spectra"] = ("Spectra", "Spectra", _spectra(problem, shown))
    return found


def _predicted(problem: FitProblem) -> Iterator[tuple[Source, list[Row]]]:
    """All sources with their predictions at the initial guess, first the fitted ones."""
    common = [one for one in coordinates_of(problem) if not one.run]
    for source in (*sources_of(problem, "fit"), *sources_of(problem, "check")):
        own = [one for run in problem.run if run.name == source.name for one in run_coordinates(problem, run)]
        coordinates = [*common, *own]
        yield source, likelihood(Signals([source], coordinates), guess_of(coordinates), [source.blocks]).every


def _shown(source: Source, row: Row) -> Shown:
    block, predicted = row.block, row.shown
    t = np.asarray(block.t)
    between = np.diff(t)
    usual = float(np.median(between))
    wide = between > (1 + GAP) * usual
    other = ~wide & (np.abs(between - usual) > UNEVEN * usual)
    gaps = np.column_stack([t[:-1][wide], t[1:][wide]])
    return Shown(source, block, predicted, gaps, t[1:][other], np.flatnonzero(outliers_in(t, block.y, predicted)))


def _data(shown: Sequence[Shown], single: Sequence[tuple[Source, list[Row]]]) -> Part:
    heads = ("run", "column", "use", "samples", "rate [Hz]", "gaps", "uneven intervals", "outliers", "noise",
             "noise from", "RMS residual at the initial guess")  # fmt: skip
    lines = tuple(
        (one.source.name, one.block.name, one.source.use, len(one.t), 1 / float(np.median(np.diff(one.t))),
         len(one.gaps), len(one.uneven), len(one.outliers), *_noise(one.block),
         float(np.sqrt(np.mean((one.predicted - one.block.y) ** 2))))
        for one in shown
    )  # fmt: skip
    tables = [Table("columns", "Columns of the runs", heads, lines)] if shown else []
    rows = tuple(
        (f"{source.name}, {block.name}", float(m), float(σ), float(y), float((y - m) / σ))
        for source, several in single if source.response is None
        for block, values, *_ in several
        for m, σ, y in zip(block.y, block.σ, values, strict=True)
    )  # fmt: skip
    if rows:
        units = ("measurement", "measured", "standard deviation", "predicted", "residual in standard deviations")
        tables.append(Table("single", "Single measurements", units, rows))
    drawn, at = list[Picture](), "at the initial guess"
    for number, several in enumerate(_groups(shown), 1):
        caption = f"Measured, and predicted {at}."
        drawn.append(_picture(f"data_{number}", "Measured and predicted", caption, several, residual=False))
        caption = f"Predicted {at} − measured."
        drawn.append(_picture(f"start_{number}", f"Residuals {at}", caption, several, residual=True))
    return Part(_in_words(shown), pictures=tuple(drawn), tables=tuple(tables))


def _in_words(shown: Sequence[Shown]) -> tuple[str, ...]:
    """Sentences on gaps, uneven intervals and outliers."""
    if not shown:
        return ("Predictions are those of the scene at the initial guess. Nothing was fitted.",)
    found = []
    for kind, name in {"gap": "gaps", "uneven interval": "uneven", "outlier": "outliers"}.items():
        several = [f"{one.title} ({len(getattr(one, name))})" for one in shown if len(getattr(one, name))]
        found.append(f"{kind.capitalize()}s: {', '.join(several)}." if several else f"No {kind}s.")
    marks = (
        "Pale areas are gaps, orange ticks below are samples at uneven intervals, and circles are outliers: they are "
        "more than 5 robust standard deviations off a cubic through their four neighbours, in the data and in the "
        "residual. Outliers are not removed; loss = 'trimmed' or 'huber' reduces their effect on the fit."
    )
    return (" ".join(found), marks)


def _noise(block: Block) -> tuple[float | None, str]:
    if block.stated:
        return float(np.sqrt(np.mean(block.σ**2))), "problem or sensor"
    found = noise_in(block)
    return (float(np.mean(block.σ)), "1 % of range") if found is None else (found, "data")


def _groups(shown: Sequence[Shown]) -> Iterator[Sequence[Shown]]:
    """Columns of one picture each: of the same run, at most four."""
    most = 4
    for name in dict.fromkeys(one.source.name for one in shown):
        of_run = [one for one in shown if one.source.name == name]
        for k in range(0, len(of_run), most):
            yield of_run[k : k + most]


def _picture(name: str, title: str, caption: str, shown: Sequence[Shown], *, residual: bool) -> Picture:
    _, axes = stacked_axes(len(shown), 2.2)
    columns: dict[str, Array] = {}
    for panel, one in zip(axes, shown, strict=True):
        values = {"residual": one.predicted - one.block.y} if residual else {
            "measured": one.block.y, "predicted": one.predicted
        }  # fmt: skip
        gap = np.searchsorted(one.t, one.gaps[:, 1])  # nan there, where a line would suggest data
        t = np.insert(one.t, gap, one.gaps.mean(axis=1))
        for label, y in values.items():
            panel.plot(t, np.insert(y, gap, np.nan), label=label, **look(label, len(y)))
        _mark(panel, one, next(iter(values.values())))
        panel.set_ylabel(one.block.name)
        panel.set_title(f"{one.source.name} ({one.source.use})", loc="left")
        columns[f"t [s] of {one.block.name}"] = one.t
        columns |= {f"{label} {one.block.name}": y for label, y in values.items()}
        columns[f"outlier in {one.block.name}"] = np.isin(np.arange(len(one.t)), one.outliers).astype(float)
    return picture_of(name, f"{title}, {shown[0].source.name}", caption, axes, "time [s]", columns)


def look(label: str, samples: int = 0) -> dict[str, Any]:
    """Look of a curve, which is the same in all figures; measurements are dots."""
    most = 1500  # largest number of samples drawn as dots; more are drawn as a line
    dots = {"linestyle": "", "marker": ".", "markersize": 3} if samples <= most else {"linewidth": 0.9}
    looks: dict[str, dict[str, Any]] = {
        "measured": {"color": GREY, **dots}, "predicted": {"color": BLUE, "linewidth": 1.0}, "fitted": {"color": BLUE},
        "before": {"color": VERMILION, "linewidth": 0.8},
    }  # fmt: skip
    return looks.get(label, {"color": INK, "linewidth": 0.8})


def _mark(panel: Axes, one: Shown, y: Array) -> None:
    """Mark gaps, uneven intervals and outliers."""
    for first, last in one.gaps:
        panel.axvspan(first, last, color=PALE, linewidth=0)
    if len(one.uneven):
        low = np.zeros(len(one.uneven))
        panel.plot(one.uneven, low, "|", color=ORANGE, markersize=7, transform=panel.get_xaxis_transform())
    if len(one.outliers):
        panel.plot(one.t[one.outliers], y[one.outliers], "o", color=VERMILION, markerfacecolor="none", label="outlier")


def _spectra(problem: FitProblem, shown: Sequence[Shown]) -> Part:
    highest = max(0.5 / float(np.median(np.diff(one.t))) for one in shown)
    inside = [(k, hertz, ratio) for k, (hertz, ratio) in enumerate(_modes(problem.scene), 1) if hertz < highest]
    marked = ", ".join(f"{hertz:.3g} Hz" for _, hertz, _ in inside)
    other = [one.title for one in shown if len(one.gaps) or len(one.uneven)]
    text = f"{plural(len(other), 'column')} with gaps or uneven intervals interpolated: {', '.join(other)}."
    sentences = (
        f"Dashed lines are the elastic modes of the scene at the initial guess, at rest with its driven joints locked: "
        f"{marked}." if inside else "The scene has no elastic mode below half the sampling rate.",
        "A peak of the data beside a line is a mode with another frequency, or a motion that the scene lacks. Levels "
        "that stay equal at high frequencies are noise.",
        *([text] if other else []),
    )  # fmt: skip
    table = Table("modes", "Modes at the initial guess", ("mode", "frequency [Hz]", "damping ratio"), tuple(inside))
    pictures = tuple(
        _spectrum_picture(number, several, [hertz for _, hertz, _ in inside])
        for number, several in enumerate(_groups(shown), 1)
    )
    return Part(sentences, pictures=pictures, tables=(table,) if inside else ())


def _spectrum_picture(number: int, shown: Sequence[Shown], hertz: Sequence[float]) -> Picture:
    _, axes = stacked_axes(len(shown), 2.2)
    columns: dict[str, Array] = {}
    for panel, one in zip(axes, shown, strict=True):
        columns[f"f of {one.block.name} [Hz]"] = amplitudes(one.t, one.block.y)[0]
        for label, y in (("measured", one.block.y), ("predicted", one.predicted)):
            f, size = amplitudes(one.t, y)
            panel.loglog(f, np.where(size > 0, size, np.nan), label=label, color=GREY if label == "measured" else BLUE,
                         linewidth=0.9)  # fmt: skip
            columns[f"{label} {one.block.name}"] = size
        top = amplitudes(one.t, one.block.y)[1].max()
        panel.set_ylim(bottom=max(panel.get_ylim()[0], 1e-6 * top if top > 0 else 0))
        for mode in hertz:
            panel.axvline(mode, color=VERMILION, linewidth=0.9, linestyle="--")
        panel.set_ylabel(one.block.name)
        panel.set_title(f"{one.source.name} ({one.source.use})", loc="left")
    caption = "Amplitudes of measured and predicted columns, Hann window; dashed: modes at the initial guess."
    return picture_of(f"spectra_{number}", f"Spectra, {shown[0].source.name}", caption, axes, "frequency [Hz]", columns)


def amplitudes(t: Array, y: Array) -> tuple[Array, Array]:
    """Frequencies [Hz] and amplitudes of the sines in samples y, by a Hann window, without the mean, at even times."""
    n = len(t)
    even = np.linspace(t[0], t[-1], n)
    y = np.interp(even, t, y)
    window = np.hanning(n)
    size = 2 * np.abs(np.fft.rfft(window * (y - y.mean()))) / (window.sum() or 1.0)
    return np.fft.rfftfreq(n, (t[-1] - t[0]) / (n - 1))[1:], size[1:]


def _modes(scene: Scene) -> list[tuple[float, float]]:
    """Frequencies [Hz] and damping ratios of the first elastic modes at rest; empty without an equilibrium."""
    most = 8  # largest number of modes that are marked
    try:
        chain, rest, load = at_rest(scene)
        found = modes_at_rest(chain, rest, **load)
    except FlexlinkError:
        return []
    elastic = np.flatnonzero(np.array(found.kinds) == "elastic")[:most]
    return [(float(found.hertz[k]), float(found.damping_ratios[k])) for k in elastic]


class Compared(NamedTuple):
    """A measured response, and predictions by name: "before" and "fitted"."""

    name: str
    use: str
    measured: Response
    predicted: Mapping[str, Complex]


def compared(fitted: Fitted) -> list[Compared]:
    """The frequency responses of a fit, measured, before and after."""
    found = []
    for number, part in enumerate(fitted.problem.frf, 1):
        name, scene = f"frf {number}", fitted.problem.scene.varied(part.set)
        real, imaginary = (one for one in fitted.columns if one.source == name)
        predicted = {"before": real.before + 1j * imaginary.before, "fitted": real.after + 1j * imaginary.after}
        found.append(Compared(name, part.use, measured_response(scene, part, name), predicted))
    return found


def response_picture(one: Compared) -> Picture:
    """Picture of a response: magnitude, phase, and coherence if it is known."""
    f, known = one.measured.f, bool(np.isfinite(one.measured.coherence).any())
    _, axes = stacked_axes(2 + known, 2.2)
    columns = {"f [Hz]": f}
    for label, H in {"measured": one.measured.H, **one.predicted}.items():
        size, phase = np.abs(H), np.degrees(np.angle(H))
        axes[0].loglog(f, np.where(size > 0, size, np.nan), label=label, **look(label))
        turns = (np.abs(np.diff(phase, append=phase[-1])) > 180) & (label != "measured")  # no line is drawn there
        axes[1].semilogx(f, np.where(turns, np.nan, phase), **look(label))
        columns |= {f"{label} {one.measured.name}": size, f"{label} phase [deg]": phase}
    axes[0].set_ylabel(unit_in(one.measured.name))
    axes[0].set_title(f"{one.name} ({one.use}): {one.measured.name.rpartition(' [')[0]}", loc="left")
    axes[1].set_ylabel("phase [deg]")
    axes[1].set_yticks([-180, -90, 0, 90, 180])
    columns["standard deviation"] = one.measured.σ
    if known:
        axes[2].semilogx(f, one.measured.coherence, color=INK, linewidth=0.9)
        axes[2].set_ylabel("coherence")
        axes[2].set_ylim(0, 1.05)
        columns["coherence"] = one.measured.coherence
    names = ", ".join(("measured", *one.predicted))
    caption = f"Magnitude and phase: {names}{'; coherence of the measurement' if known else ''}."
    return picture_of(one.name.replace(" ", "_"), "Frequency response", caption, axes, "frequency [Hz]", columns)


def response_table(responses: Sequence[Compared]) -> Table:
    """RMS residuals of all responses, in their unit and in standard deviations."""
    heads = ("source", "response", "use", "frequencies", "from [Hz]", "to [Hz]", "prediction", "RMS residual",
             "RMS residual in standard deviations")  # fmt: skip
    lines = tuple(
        (one.name, one.measured.name, one.use, len(one.measured.f), float(one.measured.f[0]),
         float(one.measured.f[-1]), label, float(np.sqrt(np.mean(np.abs(H - one.measured.H) ** 2))),
         float(np.sqrt(np.mean(np.abs(H - one.measured.H) ** 2 / (2 * one.measured.σ**2)))))
        for one in responses for label, H in one.predicted.items()
    )  # fmt: skip
    return Table("responses", "Frequency responses", heads, lines)
