"""Values and lists in the sentences of messages."""

from __future__ import annotations

import difflib
import os
import sys
from collections.abc import Iterable, Sequence
from typing import Self


class Diagnostic(str):
    """A sentence for the user with a stable `id`, such as `"unknown-key"`, which the documentation explains.

    Refusals, warnings, notes and hints differ in severity alone: the text that `flexlink` prints before them.
    """

    __slots__ = ("id",)

    id: str

    def __new__(cls, text: str, id: str) -> Self:
        """The text as a string that knows its id."""
        self = super().__new__(cls, text)
        self.id = id
        return self

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]
        """For pickles: text and id."""
        return str(self), self.id


def id_of(text: object) -> str:
    """The id of an error or a diagnostic as it is printed: two blanks and [id]; empty without one."""
    name = getattr(text, "id", "")
    return f"  [{name}]" if name else ""


def coloured(word: str) -> str:
    """A word of severity in colour: red for errors, yellow for warnings, cyan for notes.

    Without colour if stderr is no terminal, or NO_COLOR is set.
    """
    codes = {"warning": 33, "note": 36, "flexlink": 31}
    if word not in codes or os.environ.get("NO_COLOR") or not sys.stderr.isatty():
        return word
    return f"\033[1;{codes[word]}m{word}\033[0m"


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
