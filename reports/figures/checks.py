"""All checks, terms of the equation of motion, parts of errors, and measurements."""

from __future__ import annotations

import textwrap
import zlib
from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexlink.pages.colours import BLUE, ENGINES, GREEN, GREY, INK, ORANGE, VERMILION
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, stacked_axes, tidy_logs
from reports.chapters import chapter_of_kinds, sections
from reports.curves import floats, legend_above
from reports.figures import figure
from reports.measurements import WHAT, Group, groups_of
from reports.results import Results, used
from reports.tables import rows_csv, series_csv
from validation.judgement import JudgedRow
from validation.measured.uncertainty import COVERAGE
from validation.store import Row, Series

KINDS = {"pointwise": "flexlink", "judge": "50-digit arithmetic"}
"""Kind of case → the reference from which the differences are measured."""
LINE = 0.36  # height per term [in]


@figure("agreement")
def agreement(results: Results) -> Iterator[Picture]:
    """Every term of the equation of motion compared with the other engines: a marker per engine, a tick for the limit.

    One picture per case and scene, all with the same scale.
    """
    rows = [row for row in results.rows if row.kind in KINDS and row.value is not None]
    shown = [value for row in rows for value in (row.value, row.tolerance) if value]
    if not shown:
        return
    limits = (min(shown) / 4.0, max(shown) * 4.0)
    for case, scene in dict.fromkeys((row.case, row.scene) for row in rows):
        own = [row for row in rows if (row.case, row.scene) == (case, scene)]
        yield _picture(case, scene, own, limits)


def _picture(case: str, scene: str, rows: Sequence[JudgedRow], limits: tuple[float, float]) -> Picture:
    terms = list(dict.fromkeys(row.quantity for row in rows))
    labels = [textwrap.fill(term, 16) for term in terms]
    engines = [name for name in ENGINES if any(row.engine == name for row in rows)]
    lines = sum(label.count("\n") + 1.3 for label in labels)
    figure, (axes,) = stacked_axes(1, 1.4 + LINE * lines / 1.3)
    for place, engine in enumerate(engines):
        found = [row for row in rows if row.engine == engine]
        values = [max(row.value or 0.0, limits[0] * 1.3) for row in found]  # draws 0 at the edge of the log axis
        offset = 0.16 * (place - 0.5 * (len(engines) - 1))
        places = [terms.index(row.quantity) + offset for row in found]
        look = ENGINES[engine]
        axes.plot(
            values, places, look.marker, linestyle="", color=look.colour, label=look.name, clip_on=False, zorder=3
        )
    limits_of = [(row.tolerance, terms.index(row.quantity)) for row in rows if row.tolerance is not None]
    if limits_of:
        axes.plot(*zip(*limits_of, strict=True), "|", color=INK, markersize=15, markeredgewidth=2, label="limit")
    axes.set(xscale="log", xlim=limits, yticks=range(len(labels)), yticklabels=labels)
    axes.set_xlabel("error / rounding bound [1]" if {row.tolerance for row in rows} <= {1.0} else "error [1]")
    axes.set_ylim(len(labels) - 0.5, -0.5)
    legend_above(figure, axes, len(engines) + 1)
    caption = (
        f"Largest difference from {KINDS[rows[0].kind]} over all joints and states. Marks left of the limit: equal to "
        "within rounding; at the left edge: exactly equal."
    )
    return Picture(f"{case}.{scene}", f"{scene}: {rows[0].title}", figure, caption, rows_csv(rows))


LEAST, MOST = 1e-4, 5.0  # share of the limit; smaller and larger shares are drawn at the left and right edge
SPREAD = 0.62  # part of the height of a line over which the dots of a chapter are spread


@figure("summary")
def overview(results: Results) -> Iterator[Picture]:
    """Figure for the first screen: a dot for every verification check, at its value as a share of its limit.

    One picture with a line per chapter.
    """
    rows = [row for row in results.rows if row.passed is not None and not row.timed]
    chapters = chapter_of_kinds()
    names = [section.short for section in sections() if any(chapters[row.kind] == section.id for row in rows)]
    if not rows:
        return
    lines = {section.id: names.index(section.short) for section in sections() if section.short in names}
    figure, (axes,) = stacked_axes(1, 0.75 + 0.36 * len(names))
    for passed, colour, marker, label in ((True, BLUE, "o", "passes"), (False, VERMILION, "X", "fails")):
        chosen = [row for row in rows if row.passed is passed]
        if chosen:
            x = [min(max(used(row) or 0.0, LEAST), MOST) for row in chosen]
            y = [lines[chapters[row.kind]] + _offset(row) for row in chosen]
            size = 2.6 if passed else 6.0
            axes.plot(x, y, marker, color=colour, markersize=size, markeredgewidth=0, label=label, clip_on=False)
    axes.axvline(1.0, color=INK, label="limit")
    axes.set(xscale="log", xlim=(LEAST, MOST), yticks=range(len(names)), yticklabels=names)
    axes.set(xlabel="value / limit [1]")
    axes.set_ylim(len(names) - 0.5, -0.5)
    tidy_logs(axes)
    axes.set_xticks([10.0**k for k in range(-4, 1)])
    axes.set_xticklabels([f"≤ {number(LEAST)}", *(number(10.0**k) for k in range(-3, 1))])
    legend_above(figure, axes, 3)
    title = "All verification checks: share of the limit that each uses"
    words = "Each dot is a check, at the share of its limit that it uses. Dots right of the line are failed checks."
    yield Picture("overview", title, figure, words, rows_csv(rows))


def _offset(row: Row) -> float:
    """Vertical offset of a dot within its line; the same row always has the same offset."""
    return SPREAD * ((zlib.crc32(f"{row.case} {row.quantity} {row.where}".encode()) % 97) / 96 - 0.5)


LOOKS = {
    "model": (VERMILION, "s"), "space": (BLUE, "o"), "time": (ORANGE, "^"), "rounding": (GREEN, "D"),
    "total": (INK, "|"),
}  # fmt: skip
PARTS = (
    "Total tip error, and its parts due to the link type (model), hinges (space), steps (time) and rounding. Reduce "
    "the largest part first."
)
RUN_LINE = 0.5  # height per run [in]


@figure("errors", "errors")
def errors_split(results: Results) -> Iterator[Picture]:
    """Error of each run and its parts on a logarithmic axis: one panel per scene, one line per run.

    One picture with all scenes.
    """
    found = [series for _, series in results.showing("errors")]
    if not found:
        return
    lengths = [len(series.columns["run"]) for series in found]
    figure = Figure(figsize=(WIDTH, RUN_LINE * sum(lengths) + 0.6 * len(found) + 0.7), layout="constrained")
    panels = figure.subplots(len(found), 1, sharex=True, squeeze=False, height_ratios=lengths)[:, 0]
    for axes, series in zip(panels, found, strict=True):
        _fill(axes, series)
    left, right = panels[-1].get_xlim()
    panels[-1].set(xlabel="tip error [m]", xlim=(0.3 * left, right))  # room for the first tick label
    legend_above(figure, panels[0], 3)
    yield Picture("errors_split.parts", "Where the error of a run comes from", figure, PARTS, series_csv(*found))


def _fill(axes: Axes, series: Series) -> None:
    runs = series.columns["run"].tolist()
    for part, (colour, marker) in LOOKS.items():
        sizes = floats(series.columns[part])
        places = [k for k, size in enumerate(sizes) if size > 0.0]
        size = 16.0 if part == "total" else 7.0
        axes.plot(sizes[places], places, marker, color=colour, label=part, markersize=size, linestyle="none")
    for k, run in enumerate(runs):
        axes.axhline(k, color=GREY, linewidth=0.6, zorder=0)
        axes.text(0.0, k - 0.22, run, transform=axes.get_yaxis_transform(), fontsize=9.5, va="bottom")
    axes.set(xscale="log", yticks=[], ylim=(len(runs) - 0.6, -0.8))
    axes.grid(False, axis="y")
    axes.set_title(series.title, loc="left")
    tidy_logs(axes)


VERDICT_COLOURS = {"validated to u_val": BLUE, "not validated": VERMILION, "cannot be told": GREY}
MEASURED = (
    "Points: error E / D. Bars: ± 2 u_val / D. Blue: validated. Orange: not validated, since the bar excludes 0. "
    "Grey: undecided, since u_val is too large."
)
QUANTITY_LINE = 0.17  # height per quantity [in]


@figure("measured", WHAT)
def measured(results: Results) -> Iterator[Picture]:
    """Errors against measurements, with the validation uncertainty from data, inputs and grid.

    One picture per case, with a panel per group and a line per quantity.
    """
    for case, series in results.showing(WHAT):
        title = results.cases[case][0].title
        found = list(groups_of(case, title, series))
        yield Picture(f"{case}.{series.name}", title, _figure(found), MEASURED, series_csv(series))


def _figure(found: Sequence[Group]) -> Figure:
    figure, panels = stacked_axes(len(found), 1.0, share=False)
    counts = [len(group.error) for group in found]
    figure.set_figheight(sum(0.75 + QUANTITY_LINE * count for count in counts))
    figure.set_layout_engine("constrained", rect=(0.0, 0.0, 0.98, 1.0))  # room for a number at the right end of an axis
    panels[0].get_gridspec().set_height_ratios([0.35 / QUANTITY_LINE + count for count in counts])
    for axes, group in zip(panels, found, strict=True):
        for k, (e, u, verdict) in enumerate(zip(group.error, group.u_val, group.columns["verdict"], strict=True)):
            colour = VERDICT_COLOURS[verdict]
            axes.plot([e - COVERAGE * u, e + COVERAGE * u], [k, k], color=colour, linewidth=1.2)
            axes.plot([e], [k], "o", color=colour, markersize=3)
        axes.axvline(0.0, color=INK, linewidth=0.8)
        axes.set(yticks=range(len(group.error)), yticklabels=group.columns["quantity"].tolist(), xlabel="E / D [%]")
        axes.tick_params(axis="y", labelsize=8.5)
        axes.set_ylim(len(group.error) - 0.4, -0.6)
        axes.set_title(group.name, loc="left")
        axes.grid(False, axis="y")
    return figure
