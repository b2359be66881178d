"""Data sheets of the benchmarks, one table each: description, accepted error, accuracy, CPU time at three settings."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
SHEET = "data sheet"
TAKES = (SHEET,)


def find(results: Results) -> Iterator[Table]:
    """One table per benchmark."""
    for case, series in results.showing(SHEET):
        title, _, about = series.title.partition(". ")
        lines = tuple(zip(*(column.tolist() for column in series.columns.values()), strict=True))
        yield Table(
            f"{case}.{series.part}", f"Data sheet: {title}", tuple(series.columns), lines, (about,), to_look_up=True
        )
