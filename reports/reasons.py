"""Reasons of bars: what is said of all rows of a quantity, and what is noted of one row."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence

from validation.store import Row


def split_reasons(rows: Sequence[Row]) -> dict[int, tuple[str, str]]:
    """`id(row)` → (the reason that all rows of its case and quantity share, the note on this row alone).

    The study stores both as one text: the reason of the case file, then a computed note. What the rows of a quantity
    have in common, up to the end of a sentence, is the reason.
    """
    texts: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        texts.setdefault((row.case, row.quantity), []).append(row.reason)
    shared = {where: _shared_sentences(found) for where, found in texts.items()}
    parts = {}
    for row in rows:
        reason = shared[row.case, row.quantity]
        parts[id(row)] = (plain(reason), row.reason[len(reason) :].strip())
    return parts


def _shared_sentences(texts: Sequence[str]) -> str:
    """What all texts begin with, up to the last place where each of them ends a sentence."""
    prefix = os.path.commonprefix(texts)  # noqa: RUF071  characters are meant
    ends = [
        match.end() for match in re.finditer(r"\.", prefix) if all(t[match.end() :][:1] in ("", " ") for t in texts)
    ]
    return prefix if all(text == prefix for text in texts) else prefix[: max(ends, default=0)]


def plain(reason: str) -> str:
    """The reason of a row without bar is often just "Information."; what is left without that word."""
    if not re.match(r"Information\b", reason):
        return reason
    words = re.sub(r"^Information[.:;,]?\s*", "", reason)
    return words[:1].upper() + words[1:]
