"""What became of somebody's claims that cases of the study judge: a word and a colour, apart from the case's checks."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

from flexlink.pages.verdict import State
from validation.store import Row

CLAIM = "claim"  # what the quantities that judge one begin with, and the fact that has its words
PLAINLY, LIMITED = re.compile(r"holds($|[;:])"), re.compile(r"holds\b")  # what the note of a claim begins with


class Standing(NamedTuple):
    """How a claim came out."""

    word: str
    state: State


CONFIRMED = Standing("confirmed", "pass")
IN_PART = Standing("confirmed within limits", "doubt")
REFUTED = Standing("refuted", "fail")


def standing(row: Row) -> Standing:
    """What the measurement says of the row's claim."""
    return CONFIRMED if PLAINLY.match(row.note) else IN_PART if LIMITED.match(row.note) else REFUTED


def judging(rows: Iterable[Row]) -> list[Row]:
    """The rows that judge a claim."""
    return [row for row in rows if row.quantity.startswith(CLAIM)]


def words(row: Row) -> str:
    """The claim's own words."""
    return str(row.varied.get(CLAIM, row.title))
