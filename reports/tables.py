"""Tables of checks: rounded text for the page, and CSV with every digit."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Sequence
from typing import get_args

from flexlink.pages.colours import engine_name
from flexlink.pages.numbers import amount
from flexlink.pages.tables import Table, table_csv
from reports.results import used
from reports.wording import displayed
from validation.facts import column_head, in_words
from validation.judgement import JudgedRow, State
from validation.store import Row, Series

STATES = get_args(State)  # order of the lines of a table
CSV_FIELDS = tuple(f.name for f in dataclasses.fields(Row) if f.name not in ("key", "varied"))


@dataclasses.dataclass(frozen=True)
class Meaning:
    """Definition of some quantities, the reason for their limit, and the reason for its withdrawal."""

    quantities: tuple[str, ...]
    metric: str
    reason: str
    given_up: str


def checks(rows: Sequence[JudgedRow]) -> tuple[Table, str]:
    """Table of a case's checks, failing ones first and rows without a limit last; and settings common to all rows."""
    facts = {name: {row.varied.get(name) for row in rows} for row in rows for name in row.varied}
    differ = {name for name, values in facts.items() if len(values) > 1}
    columns: dict[str, list[str]] = {
        "quantity": [displayed(row.quantity) for row in rows],
        "scene": [row.scene for row in rows],
        "engine": [engine_name(row.engine) for row in rows],
        "setting": [in_words({name: v for name, v in row.varied.items() if name in differ}) for row in rows],
    }
    shown = {name: column for name, column in columns.items() if len(set(column)) > 1 or name == "quantity"}
    alike = [columns[name][0] for name in columns if name not in shown and columns[name][0]]
    alike += [in_words({name: next(iter(values))}) for name, values in facts.items() if name not in differ]  # type: ignore[dict-item]
    shown |= {
        "value": [amount(row.value, row.unit) for row in rows],
        "limit": [limit(row) for row in rows],
        "share of its limit": [share(used(row)) for row in rows],
        "note": [row.note for row in rows],
    }
    states: list[str] = [row.state for row in rows]
    shown = {"state": states} | {name: column for name, column in shown.items() if any(column)}
    lines = tuple(sorted(zip(*shown.values(), strict=True), key=lambda line: STATES.index(line[0])))
    classes = tuple(line[0] for line in lines)
    return Table(rows[0].case, rows[0].title, tuple(shown), lines, classes=classes), ", ".join(alike)


def meanings(rows: Iterable[Row]) -> Iterable[Meaning]:
    """Definitions of the quantities of rows; quantities with the same definition share one entry."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        found.setdefault((row.metric, row.reason, row.given_up), []).append(row.quantity)
    for (metric, reason, given_up), quantities in found.items():
        yield Meaning(tuple(dict.fromkeys(map(displayed, quantities))), metric, reason, given_up)


def limit(row: Row) -> str:
    """The limit with its side, "≤ 10⁻¹² rad"; empty without a limit."""
    if row.tolerance is None:
        return ""
    return f"{'≥' if row.bound == 'at least' else '≤'} {amount(row.tolerance, row.unit)}"


def share(part: float | None) -> str:
    """Share of a limit as a percentage, or as a factor above ten; empty for None."""
    if part is None:
        return ""
    if part > 10.0:
        return f"{amount(part, '')}×"
    return f"{100.0 * part:.0f} %" if part >= 0.01 else "< 1 %"


def rows_csv(rows: Sequence[JudgedRow], without: Collection[str] = ()) -> str:
    """All fields of the rows, with a column per setting; numbers read back exactly."""
    fields = tuple(f for f in CSV_FIELDS if f not in without)
    facts = tuple(dict.fromkeys(name for row in rows for name in row.varied))
    heads = (*fields, *(column_head(name) for name in facts), "state")
    cells = ([getattr(row, f) for f in fields] + [row.varied.get(f) for f in facts] + [row.state] for row in rows)
    return table_csv(heads, cells)


def series_csv(*many: Series) -> str:
    """CSV text of all points of a figure; each line has series, panel, curve, column, x and y."""
    lines: list[tuple[object, ...]] = []
    for series in many:
        names = [n for n in series.columns if n not in (series.x, series.group, series.panel)]
        for k, x in enumerate(series.columns[series.x].tolist()):
            labels = [str(series.columns[c][k]) if c else "" for c in (series.panel, series.group)]
            for name in names:
                lines.append((series.name, *labels, name, x, series.columns[name][k].item()))
    return table_csv(("series", "panel", "curve", "column", many[0].x_label, many[0].y_label), lines)
