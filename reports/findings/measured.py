"""Every measured quantity: error beside validation uncertainty, its parts, and the verdict."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.tables import Table
from reports.measurements import WHAT
from reports.results import Results

SECTION = "measured"
COLUMNS = ("quantity", "unit", "S", "D", "E", "u_num", "GCI", "order", "u_input", "u_D", "u_val", "verdict")
HEADS = {"GCI": "grid convergence index", "order": "observed order", "S": "S, simulated", "D": "D, measured"}
DIGITS = 4


def find(results: Results) -> Iterator[Table]:
    """One table a case."""
    heads = tuple(HEADS.get(name, name) for name in COLUMNS)
    for case, series in results.showing(WHAT):
        lines = tuple(zip(*(series.columns[name].tolist() for name in COLUMNS), strict=True))
        title = results.cases[case][0].title
        yield Table(f"{case}.quantities", f"{title}: all quantities", heads, lines, (), to_look_up=True)
