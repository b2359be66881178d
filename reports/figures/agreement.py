"""Every term of the equation of motion compared with the other engines: a marker per engine, a tick for the limit."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from flexlink.pages.colours import ENGINES, INK
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes
from reports.results import Results
from reports.tables import rows_csv
from validation.judgement import JudgedRow

SECTION = "agreement"
TAKES: tuple[str, ...] = ()
KINDS = {"pointwise": "flexlink", "judge": "50-digit arithmetic"}
"""Kind of case → the reference from which the differences are measured."""
LINE = 0.36  # height per term [in]


def draw(results: Results) -> Iterator[Picture]:
    """One picture per case and scene, all with the same scale."""
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
    for number, engine in enumerate(engines):
        found = [row for row in rows if row.engine == engine]
        values = [max(row.value or 0.0, limits[0] * 1.3) for row in found]  # draws 0 at the edge of the log axis
        offset = 0.16 * (number - 0.5 * (len(engines) - 1))
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
        f"Largest difference from {KINDS[rows[0].kind]} over joints and states. Left of the limit: equal to within "
        "rounding. At the left edge: exactly equal."
    )
    return Picture(f"{case}.{scene}", f"{scene}: {rows[0].title}", figure, caption, rows_csv(rows))
