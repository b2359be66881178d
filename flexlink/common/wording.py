"""Values and lists in the sentences of messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def did_you_mean(value: object, allowed: Iterable[str]) -> str:
    """The end of a message that names the one of `allowed` that `value` looks like; empty if none does."""
    by_case = {name.casefold(): name for name in reversed(list(allowed))}
    close = difflib.get_close_matches(value.casefold(), by_case, n=1) if isinstance(value, str) else []
    return f"; did you mean {by_case[close[0]]!r}?" if close else ""


def truncated(value: object) -> str:
    """`repr` in one line, cut to a length that fits into a message."""
    try:
        text = " ".join(repr(value).split())
    except Exception as error:  # whatever the class of the value raises, and an int of 5000 digits
        return "…" if isinstance(error, RecursionError) else f"<{type(value).__name__}>"
    return text if len(text) <= 60 else text[:57] + "…"


def short_list(items: Sequence[str]) -> str:
    """Items with commas, those in the middle of many left out."""
    return ", ".join(items if len(items) <= 8 else [*items[:5], "…", *items[-2:]])
