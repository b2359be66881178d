"""What a case has left out: each quantity is measured as often as its file says, and no number twice.

A scene, an engine or a method that a kind skips in silence has fewer rows. That is a failed check, which says so.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Sequence

from validation.case import Case
from validation.store import OURS, Row

ROWS_OF = "rows of "


def wrong(case: Case, rows: Sequence[Row]) -> Iterator[Row]:
    """A failed check for every quantity of a case that was not measured as often as its file says."""
    for name in dict.fromkeys(row.quantity for row in rows):
        own, stated = [row for row in rows if row.quantity == name], case.quantity[name].rows
        if stated == "by machine" or own[0].timed:
            continue
        if len(own) != stated:
            yield _failed(own[0], len(own), stated, f"The case states {stated}; measured: {_where(own)}.")
        twice = [asked for asked, times in Counter(_asked(row) for row in own).items() if times > 1]
        if twice:
            yield _failed(own[0], len(own), len(own) - len(twice), f"Measured twice: {twice[0]}.")


def _asked(row: Row) -> str:
    """What a row answers, apart from its quantity."""
    return ", ".join([row.scene, row.engine, *(f"{name} {value}" for name, value in row.varied.items())])


def _where(rows: Sequence[Row]) -> str:
    """How many rows each scene and engine has."""
    counts = Counter(" ".join(part for part in (row.scene, row.engine) if part) for row in rows)
    return ", ".join(f"{count} {where}" for where, count in counts.items())


def _failed(row: Row, found: int, stated: int, note: str) -> Row:
    return dataclasses.replace(
        row, scene="", engine=OURS, varied={}, quantity=f"{ROWS_OF}{row.quantity}", metric="rows measured", unit="rows",
        value=float(found), tolerance=float(stated), bound="at least" if found < stated else "at most", passed=False,
        reason="Nothing is left out in silence: how often each quantity is measured is part of the case.", note=note,
        given_up="", seconds=0.0,
    )  # fmt: skip
