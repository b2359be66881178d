"""Verdict on a published claim that the study checks: a word and a colour, separate from the checks of the case."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from flexlink.pages.verdict import State
from validation.store import Row

CLAIM = "claim"  # first word of the quantities that check a claim; also the name of the setting with the claim's text
PLAINLY, LIMITED = re.compile(r"holds($|[;:])"), re.compile(r"holds\b")  # notes of confirmed claims begin so


class Standing(NamedTuple):
    """Verdict on a claim."""

    word: str
    state: State


CONFIRMED = Standing("confirmed", "pass")
IN_PART = Standing("confirmed within limits", "doubt")
REFUTED = Standing("refuted", "fail")


def standing(row: Row) -> Standing:
    """Verdict on the claim of a row, from its note."""
    return CONFIRMED if PLAINLY.match(row.note) else IN_PART if LIMITED.match(row.note) else REFUTED


def judging(rows: Iterable[Row]) -> list[Row]:
    """Rows that check a claim."""
    return [row for row in rows if row.quantity.startswith(CLAIM)]


def words(row: Row) -> str:
    """Text of the claim."""
    return str(row.varied.get(CLAIM, row.title))
