"""The paper's claims, one a line: what was measured, and the verdict."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.reporting.numbers import amount, plural
from reports.finding import Finding
from reports.results import Results
from validation.store import Row

SECTION = "claims"
CLAIM = "claim"
HOLDS = "holds"  # what the note of a claim begins with if it does, with or without limits


def find(results: Results) -> Iterator[Finding]:
    """One table over all cases that judge a claim."""
    claims = [row for row in results.rows if row.quantity == CLAIM]
    if claims:
        heads = (CLAIM, "measured", "verdict")
        lines = tuple((row.title, f"{amount(row.value, row.unit)}: {row.metric}", row.note) for row in claims)
        yield Finding("paper_claims", "Claim by claim", (_said(claims),), heads, lines, opened=True)


def _said(claims: list[Row]) -> str:
    plain = sum(row.note == HOLDS for row in claims)
    limited = sum(row.note.startswith(HOLDS) for row in claims) - plain
    left = len(claims) - plain - limited
    return (
        f"Of {plural(len(claims), 'claim')} those that hold as they stand: {plain}; within limits: "
        f"{limited}; that do not hold: {left}."
    )
