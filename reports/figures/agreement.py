"""Every term of the equation of motion against the other engines: dots for engines, a tick for the limit."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from flexlink.pages.picture import Picture
from flexlink.pages.style import CYCLE, INK, MARKERS, legend_above, stacked_axes
from reports.results import Results
from reports.tables import rows_csv
from validation.judgement import JudgedRow
from validation.store import Row

SECTION = "agreement"
TAKES: tuple[str, ...] = ()
KINDS = ("pointwise", "judge")


def draw(results: Results) -> Iterator[Picture]:
    """One picture a case and scene, all on one scale."""
    rows = [row for row in results.rows if row.kind in KINDS and row.value is not None]
    shown = [value for row in rows for value in (row.value, row.tolerance) if value]
    if not shown:
        return
    limits = (min(shown) / 4.0, max(shown) * 4.0)
    for case, scene in dict.fromkeys((row.case, row.scene) for row in rows):
        own = [row for row in rows if (row.case, row.scene) == (case, scene)]
        yield _picture(case, scene, own, limits)


def _picture(case: str, scene: str, rows: Sequence[JudgedRow], limits: tuple[float, float]) -> Picture:
    labels = list(dict.fromkeys(_label(row) for row in rows))
    engines = list(dict.fromkeys(row.engine for row in rows))
    figure, (axes,) = stacked_axes(1, 1.3 + 0.33 * len(labels))
    for number, engine in enumerate(engines):
        found = [row for row in rows if row.engine == engine]
        values = [max(row.value or 0.0, limits[0] * 1.3) for row in found]  # 0 has no place on a log axis: at its edge
        offset = 0.16 * (number - 0.5 * (len(engines) - 1))
        places = [labels.index(_label(row)) + offset for row in found]
        axes.plot(values, places, MARKERS[number], color=CYCLE[number], label=engine, clip_on=False)
    limits_of = [(row.tolerance, labels.index(_label(row))) for row in rows if row.tolerance is not None]
    if limits_of:
        axes.plot(*zip(*limits_of, strict=True), "|", color=INK, markersize=15, markeredgewidth=2, label="limit")
    axes.set(xscale="log", xlim=limits, yticks=range(len(labels)), yticklabels=labels, xlabel="error [1]")
    axes.set_ylim(len(labels) - 0.5, -0.5)
    legend_above(figure, axes, len(engines) + 1)
    measures: dict[str, list[str]] = {}
    for row in rows:
        measures.setdefault(row.metric, []).append(row.quantity)
    words = "; ".join(f"{', '.join(dict.fromkeys(names))}: {metric}" for metric, names in measures.items())
    caption = f"A point at the left edge is exactly 0. {words}."
    return Picture(f"{case}.{scene}", f"{scene}: {rows[0].title}", figure, caption, rows_csv(rows))


def _label(row: Row) -> str:
    """The quantity; one whose limit is 1 is measured in parts of it."""
    return textwrap.fill(row.quantity + (", of its limit" if row.tolerance == 1.0 else ""), 14)
