"""Measured quantities: error, validation uncertainty with its parts, and verdict; fits to held-out recordings."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.tables import Table
from reports.measurements import WHAT
from reports.results import Results
from reports.wording import displayed

SECTION = "measured"
HELD_OUT, ONE_NUMBER = "held out", "one number"
TAKES = (HELD_OUT, ONE_NUMBER)
COLUMNS = ("quantity", "unit", "S", "D", "E", "u_num", "GCI", "order", "u_input", "u_D", "u_val", "verdict")
HEADS = {"GCI": "grid convergence index", "order": "observed order", "S": "S, simulated", "D": "D, measured"}
ONE = (
    "One number of the specimen is fitted to some of the quantities (misfit: root mean square of (S − D) / u_D), and "
    "the others are compared again. Start: value in the scene, or of the search. u and tolerance: of the number."
)
FIT = (
    "Fit: 100 (1 − |measured − model| / |measured|). 100 is a perfect model, 0 is no better than a zero signal. "
    "psf and fsf are the two recordings."
)


def find(results: Results) -> Iterator[Table]:
    """For each case, a table of fits to held-out recordings; then for each case, a table of quantities."""
    for case, series in results.showing(HELD_OUT):
        fits = tuple(zip(*(column.tolist() for column in series.columns.values()), strict=True))
        title = f"{results.cases[case][0].title}: fit [%]"
        yield Table(f"{case}.held_out", title, tuple(series.columns), fits, (FIT,), opened=True)
    for case, series in results.showing(ONE_NUMBER):
        found = tuple(zip(*(column.tolist() for column in series.columns.values()), strict=True))
        title = f"{results.cases[case][0].title}: one number fitted"
        yield Table(f"{case}.one_number", title, tuple(series.columns), found, (ONE,), opened=True)
    heads = tuple(HEADS.get(name, name) for name in COLUMNS)
    for case, series in results.showing(WHAT):
        columns = [series.columns[name].tolist() for name in COLUMNS[:-1]]
        lines = tuple(zip(*columns, map(displayed, series.columns[COLUMNS[-1]].tolist()), strict=True))
        title = results.cases[case][0].title
        yield Table(f"{case}.quantities", f"{title}: all quantities", heads, lines, (), to_look_up=True)
