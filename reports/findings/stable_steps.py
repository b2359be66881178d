"""Largest stable steps: difference between observation and prediction, per method."""

from __future__ import annotations

from collections.abc import Iterator
from statistics import median

from flexlink.common.wording import plural
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results
from validation.store import Row

SECTION = "extremes"
KIND, QUANTITY = "stable_steps", "observed / predicted − 1"
TAKES = ("stable steps",)
CLOSE = 1e-3  # relative difference up to which two steps are equal in practice


def find(results: Results) -> Iterator[Table]:
    """One table per case."""
    for case, rows in results.of_kind(KIND):
        found: dict[str, list[Row]] = {}
        for row in rows:
            if row.quantity == QUANTITY and row.value is not None:
                found.setdefault(str(row.varied["method"]), []).append(row)
        if found:
            heads = ("method", "scenes", "median difference [1]", "largest difference [1]", "scene of the largest")
            lines = tuple(_line(method, of) for method, of in found.items())
            title = "Largest stable step: runs compared with the prediction from the modes"
            sentence = _sentence([row for of in found.values() for row in of])
            yield Table(f"{case}.methods", title, heads, lines, (sentence,))


def _line(method: str, rows: list[Row]) -> tuple[str, int, float, float, str]:
    worst = max(rows, key=_off)
    return method, len(rows), median(map(_off, rows)), _off(worst), worst.scene


def _off(row: Row) -> float:
    return row.value or 0.0


def _sentence(rows: list[Row]) -> str:
    worst, close = max(rows, key=_off), sum(_off(row) <= CLOSE for row in rows)
    return (
        f"{close} of {plural(len(rows), 'largest stable step')}, found by bisection, are within {number(CLOSE)} of "
        f"the prediction; the largest difference is {number(_off(worst))} ({worst.where})."
    )
