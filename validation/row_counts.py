"""Check that each quantity is measured as often as its case states, and nothing is measured twice.

If a kind silently skips a scene, an engine or a method, rows are missing; this is reported as a failed check.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence

from validation.case import Case
from validation.store import OURS, Row

ROWS_OF = "rows of "


def wrong(case: Case, rows: Sequence[Row]) -> Iterator[Row]:
    """Yield a failed check for every quantity whose number of measurements differs from the number in the case."""
    for name in dict.fromkeys(row.quantity for row in rows):
        own, stated = [row for row in rows if row.quantity == name], case.quantity[name].rows
        if stated == "by machine" or own[0].timed:
            continue
        if len(own) != stated:
            yield _failed(own[0], len(own), stated, f"The case states {stated}; measured: {_where(own)}.")
        twice = [measured for measured, times in Counter(_measured(row) for row in own).items() if times > 1]
        if twice:
            yield _failed(own[0], len(own), len(own) - len(twice), f"Measured twice: {twice[0]}.")


def _measured(row: Row) -> str:
    """Scene, engine and varied conditions of a row."""
    return ", ".join([row.scene, row.engine, *(f"{name} {value}" for name, value in row.varied.items())])


def _where(rows: Sequence[Row]) -> str:
    """Number of rows for each scene and engine."""
    counts = Counter(" ".join(part for part in (row.scene, row.engine) if part) for row in rows)
    return ", ".join(f"{count} {where}" for where, count in counts.items())


def _failed(row: Row, found: int, stated: int, note: str) -> Row:
    return dataclasses.replace(
        row, scene="", engine=OURS, varied={}, quantity=f"{ROWS_OF}{row.quantity}", metric="rows measured", unit="rows",
        value=float(found), tolerance=float(stated), bound="at least" if found < stated else "at most", passed=False,
        reason="No measurement is skipped silently: the case states how often each quantity is measured.", note=note,
        given_up="", seconds=0.0,
    )  # fmt: skip
