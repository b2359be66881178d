"""The table of speed: every limit of time, what became of it, and the same number in the reference run."""

from __future__ import annotations

import dataclasses

from flexlink.pages.numbers import amount
from flexlink.pages.tables import table_csv
from reports.reference import Reference
from reports.results import Results
from reports.tables import TIMED, limit
from validation.judgement import crowd, speed_state
from validation.store import Row

ORDER = tuple(TIMED)


@dataclasses.dataclass(frozen=True)
class Line:
    """A limit of time."""

    row: Row
    state: str
    reference: float | None

    @property
    def word(self) -> str:
        """The state in a word or two."""
        return TIMED[self.state]

    @property
    def cells(self) -> dict[str, str]:
        """Head → text."""
        row = self.row
        beside = {"reference run": amount(self.reference, row.unit)} if self.reference is not None else {}
        named = {"quantity": row.quantity, "setting": row.where}
        return named | {"value": amount(row.value, row.unit), "limit": limit(row)} | beside


def lines(results: Results, beside: Reference) -> list[Line]:
    """What was missed first, then what was not measured, then what was met."""
    found = [Line(row, speed_state(row, results.finished), beside.value(row)) for row in results.rows]
    return sorted((line for line in found if line.state), key=lambda line: ORDER.index(line.state))


def conditions(results: Results) -> list[tuple[str, str, str]]:
    """(case, end of its run, what the machine did besides) of everything that was timed."""
    timed = ((case, done.date, done.conditions) for case, done in results.finished.items())
    return [(case, f"{date:%Y-%m-%d %H:%M} UTC", crowd(found)) for case, date, found in timed if found]


def csv_text(results: Results, beside: Reference) -> str:
    """The table with every digit, and the machine's load and spread beside each line."""
    heads = ("case", "quantity", "where", "value", "unit", "side", "limit", "state", "reference", "load", "spread")
    return table_csv(heads, (_line(line, results) for line in lines(results, beside)))


def _line(line: Line, results: Results) -> tuple[object, ...]:
    row, done = line.row, results.finished[line.row.case].conditions
    machine = (done.load, done.spread) if done else (None, None)
    where = row.case, row.quantity, row.where
    return *where, row.value, row.unit, row.bound, row.tolerance, line.state, line.reference, *machine
