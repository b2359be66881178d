"""Table of time limits: limit, result, value of the reference run, and why a limit is missed."""

from __future__ import annotations

from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path

from flexlink.data.documents import read_toml
from flexlink.describe.spec import Spec, decode
from flexlink.pages.numbers import amount
from flexlink.pages.tables import Table, table_csv
from reports.reference import Reference
from reports.results import Results
from reports.tables import STATES, limit
from validation.judgement import JudgedRow, crowd

FILE = Path(__file__).parent / "missed_limits.toml"


class Reason(Spec, frozen=True):
    """Why limits of the matching cases and quantities (globs) are missed."""

    case: str
    quantity: str
    why: str


class Reasons(Spec, frozen=True):
    """All entries of missed_limits.toml."""

    missed: tuple[Reason, ...]


@cache
def reasons() -> tuple[Reason, ...]:
    """Known reasons, the first matching one counts."""
    found: Reasons = decode(read_toml(FILE), Reasons)
    return found.missed


def reason_of(case: str, quantity: str) -> str:
    """Why a limit of this case and quantity is missed; empty if the reason is unknown."""
    known = (one.why for one in reasons() if fnmatchcase(case, one.case) and fnmatchcase(quantity, one.quantity))
    return next(known, "")


def why_missed(row: JudgedRow) -> str:
    """Why a limit is missed; empty if it is not, or if the reason is unknown."""
    return reason_of(row.case, row.quantity) if row.state in ("missed", "FAIL") else ""


def limits_of_time(results: Results) -> list[JudgedRow]:
    """Rows with a time limit: first those that miss it, then those not measured, then those that meet it."""
    found = [row for row in results.rows if row.timed and row.passed is not None]
    return sorted(found, key=lambda row: STATES.index(row.state))


def speed_table(results: Results, beside: Reference) -> Table:
    """Table of time limits for the page."""
    compared = bool(beside.machine)
    heads = "state", "quantity", "setting", "value", "limit", *(("reference run",) * compared), "why missed"
    rows = limits_of_time(results)
    lines = [
        (row.state, row.quantity, row.where, amount(row.value, row.unit), limit(row),
         *((amount(beside.value(row), row.unit if beside.value(row) is not None else ""),) * compared), why_missed(row))
        for row in rows
    ]  # fmt: skip
    return Table("speed", "Time limits", heads, tuple(lines), classes=tuple(row.state for row in rows))


def conditions(results: Results) -> list[tuple[str, str, str]]:
    """(case, end of its run, machine load) of every timed case."""
    timed = ((case, done.date, done.conditions) for case, done in results.finished.items())
    return [(case, f"{date:%Y-%m-%d %H:%M} UTC", crowd(found)) for case, date, found in timed if found]


def csv_text(results: Results, beside: Reference) -> str:
    """The same table with every digit, and with the load and timing spread of the machine."""
    what = "case", "quantity", "where", "value", "unit", "side", "limit", "state"
    heads = *what, "reference", "load", "spread", "why"
    return table_csv(heads, (_line(row, beside) for row in limits_of_time(results)))


def _line(row: JudgedRow, beside: Reference) -> tuple[object, ...]:
    machine = (row.conditions.load, row.conditions.spread) if row.conditions else (None, None)
    what = row.case, row.quantity, row.where, row.value, row.unit, row.bound, row.tolerance, row.state
    return *what, beside.value(row), *machine, why_missed(row)
