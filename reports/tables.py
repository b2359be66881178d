"""Tables of checks: for the page as rows of text, beside it as CSV with every digit."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping, Sequence

from flexlink.pages.numbers import amount
from flexlink.pages.tables import table_csv
from reports.results import used
from validation.facts import column_head, in_words
from validation.judgement import BUSY, MET, MISSED, speed_state
from validation.store import Finished, Row, Series

PASS, FAIL, INFO = "pass", "FAIL", "info"
TIMED = {MISSED: "missed", BUSY: "not measured", MET: "met"}  # what became of a limit of time, in a word or two
ORDER = (FAIL, *TIMED.values(), PASS, INFO)  # of the lines
CSV_FIELDS = tuple(f.name for f in dataclasses.fields(Row) if f.name not in ("key", "varied"))


@dataclasses.dataclass(frozen=True)
class Line:
    """One row on the page: its state, and its cells in the order of the heads."""

    state: str
    cells: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Meaning:
    """Of some quantities: how they are measured, why their limit is what it is, why a limit was given up."""

    quantities: tuple[str, ...]
    metric: str
    reason: str
    given_up: str


@dataclasses.dataclass(frozen=True)
class Table:
    """The checks of one case.

    Attributes
    ----------
    common
        What is the same in all rows and therefore has no column.
    heads, numeric
        Heads of the columns, and which of them hold numbers.
    lines
        One per row: failing ones first, then those with a limit, then information.
    meanings
        What the quantities are.
    """

    common: str
    heads: tuple[str, ...]
    numeric: frozenset[str]
    lines: tuple[Line, ...]
    meanings: tuple[Meaning, ...]


def state(row: Row, finished: Mapping[str, Finished]) -> str:
    """In a word: pass or FAIL, met, missed or not measured of a limit of time, info without a limit."""
    if row.passed is None:
        return INFO
    if row.timed:
        return TIMED[speed_state(row, finished)]
    return PASS if row.passed else FAIL


def table(rows: Sequence[Row], finished: Mapping[str, Finished]) -> Table:
    """The checks of a case as they are shown."""
    facts = {name: {row.varied.get(name) for row in rows} for row in rows for name in row.varied}
    differ = {name for name, values in facts.items() if len(values) > 1}
    columns: dict[str, list[str]] = {
        "quantity": [row.quantity for row in rows],
        "scene": [row.scene for row in rows],
        "engine": [row.engine for row in rows],
        "setting": [in_words({name: v for name, v in row.varied.items() if name in differ}) for row in rows],
    }
    shown = {name: column for name, column in columns.items() if len(set(column)) > 1 or name == "quantity"}
    alike = [columns[name][0] for name in columns if name not in shown and columns[name][0]]
    alike += [in_words({name: next(iter(values))}) for name, values in facts.items() if name not in differ]  # type: ignore[dict-item]
    shown |= {
        "value": [amount(row.value, row.unit) for row in rows],
        "limit": [limit(row) for row in rows],
        "of its limit": [share(used(row)) for row in rows],
        "note": [row.note for row in rows],
    }
    shown = {name: column for name, column in shown.items() if any(column)}
    cells = zip(*shown.values(), strict=True)
    lines = [Line(state(row, finished), line) for row, line in zip(rows, cells, strict=True)]
    return Table(
        ", ".join(alike), tuple(shown), frozenset({"value", "limit", "of its limit"}),
        tuple(sorted(lines, key=lambda line: ORDER.index(line.state))), tuple(meanings(rows)),
    )  # fmt: skip


def meanings(rows: Iterable[Row]) -> Iterable[Meaning]:
    """What the quantities of rows are; those that share all words stand together."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        found.setdefault((row.metric, row.reason, row.given_up), []).append(row.quantity)
    for (metric, reason, given_up), quantities in found.items():
        yield Meaning(tuple(dict.fromkeys(quantities)), metric, reason, given_up)


def limit(row: Row) -> str:
    """The limit with its side, "≤ 10⁻¹² rad"; empty without one."""
    if row.tolerance is None:
        return ""
    return f"{'≥' if row.bound == 'at least' else '≤'} {amount(row.tolerance, row.unit)}"


def share(part: float | None) -> str:
    """Part of a limit as a percentage, or how many times too much; empty for None."""
    if part is None:
        return ""
    if part > 10.0:
        return f"{amount(part, '')}×"
    return f"{100.0 * part:.0f} %" if part >= 0.01 else "< 1 %"


def rows_csv(rows: Sequence[Row], finished: Mapping[str, Finished], without: Collection[str] = ()) -> str:
    """All fields of the rows, a column for each thing varied; numbers are written so that they read back exactly."""
    fields = tuple(f for f in CSV_FIELDS if f not in without)
    facts = tuple(dict.fromkeys(name for row in rows for name in row.varied))
    heads = (*fields, *(column_head(name) for name in facts), "state")
    return table_csv(
        heads,
        (
            [*(getattr(row, f) for f in fields), *(row.varied.get(f) for f in facts), state(row, finished)]
            for row in rows
        ),
    )


def series_csv(*many: Series) -> str:
    """The points of a figure, one line each: which series, which curve, x and y."""
    lines: list[tuple[object, ...]] = []
    for series in many:
        names = [n for n in series.columns if n not in (series.x, series.group, series.panel)]
        for k, x in enumerate(series.columns[series.x].tolist()):
            labels = [str(series.columns[c][k]) if c else "" for c in (series.panel, series.group)]
            for name in names:
                lines.append((series.name, *labels, name, x, series.columns[name][k].item()))
    return table_csv(("series", "panel", "curve", "column", many[0].x_label, many[0].y_label), lines)
