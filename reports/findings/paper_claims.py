"""The paper's claims, one per line: verdict, limits, and what was measured."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.common.wording import plural
from flexlink.pages.numbers import amount
from flexlink.pages.tables import Table
from reports.claims import CLAIM, CONFIRMED, IN_PART, REFUTED, judging, standing, words
from reports.results import Results
from validation.store import Row

SECTION = "claims"


def find(results: Results) -> Iterator[Table]:
    """One table over all cases that check a claim."""
    claims = _once(judging(results.rows))
    if claims:
        heads = ("verdict", f"{CLAIM} of the paper", "limits", "measured")
        lines = tuple(
            (standing(row).word, f"“{words(row)}”", _limits(row), f"{amount(row.value, row.unit)}: {row.metric}")
            for row in claims
        )
        classes = tuple(standing(row).state for row in claims)
        title = "Claim by claim"
        yield Table("paper_claims", title, heads, lines, (_sentence(claims),), opened=True, classes=classes)


def _limits(row: Row) -> str:
    """Limits within which the claim is confirmed."""
    return row.note.removeprefix("holds").lstrip(" ;:")


def _once(rows: list[Row]) -> list[Row]:
    """Each claim once; if several cases check the same claim, the one with the most arms."""
    found: dict[str, Row] = {}
    for row in rows:
        other = found.get(words(row))
        if other is None or _arms(row) > _arms(other):
            found[words(row)] = row
    return list(found.values())


def _arms(row: Row) -> float:
    return float(row.varied.get("arms", 0))


def _sentence(claims: Sequence[Row]) -> str:
    found = [standing(row) for row in claims]
    counts = ", ".join(f"{found.count(each)} {each.word}" for each in (CONFIRMED, IN_PART, REFUTED))
    return f"{plural(len(claims), 'claim')}: {counts}."
