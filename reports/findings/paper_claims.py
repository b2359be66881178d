"""The paper's claims, one a line: what was measured, and the verdict."""

from __future__ import annotations

import re
from collections.abc import Iterator

from flexlink.pages.numbers import amount, plural
from flexlink.pages.tables import Table
from reports.results import Results
from validation.store import Row

SECTION = "claims"
CLAIM = "claim"
HOLDS, PLAINLY = "holds", r"holds($|[;:])"  # what the note of a claim begins with: at all, and without limits


def find(results: Results) -> Iterator[Table]:
    """One table over all cases that judge a claim."""
    claims = _once([row for row in results.rows if row.quantity.startswith(CLAIM)])
    if claims:
        heads = (CLAIM, "measured", "verdict")
        lines = tuple((_words(row), f"{amount(row.value, row.unit)}: {row.metric}", row.note) for row in claims)
        yield Table("paper_claims", "Claim by claim", heads, lines, (_sentence(claims),), opened=True)


def _once(rows: list[Row]) -> list[Row]:
    """Each claim once: of cases that judge the same one that which took the most arms."""
    found: dict[str, Row] = {}
    for row in rows:
        other = found.get(_words(row))
        if other is None or _arms(row) > _arms(other):
            found[_words(row)] = row
    return list(found.values())


def _words(row: Row) -> str:
    return str(row.varied.get(CLAIM, row.title))


def _arms(row: Row) -> float:
    return float(row.varied.get("arms", 0))


def _sentence(claims: list[Row]) -> str:
    plain = sum(bool(re.match(PLAINLY, row.note)) for row in claims)
    limited = sum(row.note.startswith(HOLDS) for row in claims) - plain
    left = len(claims) - plain - limited
    return (
        f"{plural(len(claims), 'claim')}: {plain} confirmed, {limited} confirmed within limits, {left} not confirmed."
    )
