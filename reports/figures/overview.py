"""Figure for the first screen: a dot for every verification check, at its value as a share of its limit."""

from __future__ import annotations

import zlib
from collections.abc import Iterator

from flexlink.pages.colours import BLUE, INK, VERMILION
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from reports.chapters import chapter_of_kinds, sections
from reports.results import Results, used
from reports.tables import rows_csv
from validation.store import Row

SECTION = "summary"
TAKES: tuple[str, ...] = ()
LEAST, MOST = 1e-4, 5.0  # share of the limit; smaller and larger shares are drawn at the left and right edge
SPREAD = 0.62  # part of the height of a line over which the dots of a chapter are spread


def draw(results: Results) -> Iterator[Picture]:
    """One picture with a line per chapter."""
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
    words = "One dot per check. Checks right of the line fail."
    yield Picture("overview", title, figure, words, rows_csv(rows))


def _offset(row: Row) -> float:
    """Vertical offset of a dot within its line; the same row always has the same offset."""
    return SPREAD * ((zlib.crc32(f"{row.case} {row.quantity} {row.where}".encode()) % 97) / 96 - 0.5)
