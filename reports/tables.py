"""Tables: for the page as rows of text, beside it as CSV with every digit."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Sequence

from reports.numbers import amount, number
from reports.reasons import split_reasons
from reports.results import used
from validation.store import Row

FIELDS = tuple(field.name for field in dataclasses.fields(Row) if field.name != "key")
LABELS = ("scene", "engine", "setting", "quantity")
ORDER = {False: 0, True: 1, None: 2}  # of the lines: what fails, what is judged, what only informs
VERDICTS = {True: "pass", False: "FAIL", None: "info"}


@dataclasses.dataclass(frozen=True)
class Line:
    """One row on the page: cells in the order of the heads, verdict, metric, note, number of the reason below."""

    cells: tuple[str, ...]
    verdict: str
    metric: str
    note: str
    reason: int | None


@dataclasses.dataclass(frozen=True)
class Table:
    """The checks of one case.

    Attributes
    ----------
    common
        What is the same in all rows and therefore has no column.
    heads, numeric
        Heads of the columns, and which of them (by number) hold numbers.
    lines
        One per row: failing ones first, then those with a bar, then information.
    reasons
        Why the bars are what they are; lines refer to them by number, from 1.
    """

    common: str
    heads: tuple[str, ...]
    numeric: frozenset[int]
    lines: tuple[Line, ...]
    reasons: tuple[str, ...]

    @property
    def noted(self) -> bool:
        """Some line has a note."""
        return any(line.note for line in self.lines)


def table(rows: Sequence[Row]) -> Table:
    """The checks of a case as they are shown."""
    values = {field: dict.fromkeys(getattr(row, field) for row in rows) for field in LABELS}
    labels = [field for field in LABELS if len(values[field]) > 1]
    common = [f"{field} {next(iter(values[field]))}" for field in LABELS if field not in labels and any(values[field])]
    heads = (*labels, "value", "bar", "used")
    parts = split_reasons(rows)
    reasons = tuple(dict.fromkeys(reason for reason, _ in parts.values() if reason))
    lines = []
    for row in sorted(rows, key=lambda row: ORDER[row.passed]):
        cells = (*(getattr(row, field) for field in labels), amount(row.value, row.unit), bar(row), share(used(row)))
        reason, note = parts[id(row)]
        lines.append(Line(cells, VERDICTS[row.passed], row.metric, note, reasons.index(reason) + 1 if reason else None))
    numeric = frozenset(range(len(labels), len(heads)))
    return Table(", ".join(common), heads, numeric, tuple(lines), reasons)


def bar(row: Row) -> str:
    """The tolerance with its sense, "≤ 10⁻¹²"; empty without one."""
    if row.tolerance is None:
        return ""
    return f"{'≥' if row.bound == 'at least' else '≤'} {number(row.tolerance)}"


def share(part: float | None) -> str:
    """Part of a bar as a percentage, or how many times too much; empty for None."""
    if part is None:
        return ""
    if part > 10.0:
        return f"{number(part, 2)}×"
    return f"{100.0 * part:.0f} %" if part >= 0.01 else "< 1 %"


def rows_csv(rows: Iterable[Row]) -> str:
    """All fields of the rows, numbers written so that they read back exactly."""
    return table_csv(FIELDS, ([getattr(row, field) for field in FIELDS] for row in rows))


def table_csv(heads: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A CSV text of heads and lines."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(["" if cell is None else cell for cell in line] for line in lines)
    return buffer.getvalue()
