"""Format parts of messages: values, lists, and suggestions."""

import difflib
import os
import sys
from collections.abc import Iterable, Sequence

from flexlink.common.errors import SceneError


def id_of(text: object) -> str:
    """The id of an error or a diagnostic as it is printed, two spaces and [id]; empty if there is no id."""
    name = getattr(text, "id", "")
    return f"  [{name}]" if name else ""


def coloured(word: str) -> str:
    """Colour a word by severity, red, yellow or cyan; not if stderr is not a terminal, or NO_COLOR is set."""
    codes = {"warning": 33, "note": 36, "flexlink": 31}
    if word not in codes or os.environ.get("NO_COLOR") or not sys.stderr.isatty():
        return word
    return f"\033[1;{codes[word]}m{word}\033[0m"


def did_you_mean(value: object, allowed: Iterable[str]) -> str:
    """End of a message that suggests the `closest` name in `allowed`, with its unit if `value` names another one."""
    names = list(allowed)
    if isinstance(value, str) and "," in value and all(part.strip() in names for part in value.split(",")):
        return "; these are several names: give each separately"
    if (near := closest(value, names)) is None:
        return ""
    units, given = {"_deg": "degrees", "_m": "metres", "_hz": "Hz"}, str(value).casefold()
    other = (word for end, word in units.items() if near.endswith(end) and not given.endswith(end))
    return f"; did you mean {near!r}{''.join(f', in {word}' for word in other)}?"


def closest(value: object, allowed: Iterable[str]) -> str | None:
    """The name in `allowed` that is `value` with a unit, or the closest one, or one that begins with it, if any."""
    if not isinstance(value, str):
        return None
    by_case = {name.casefold(): name for name in reversed(list(allowed))}
    with_unit = [name for unit in ("deg", "hz", "m") if (name := f"{value.casefold()}_{unit}") in by_case]
    begun = [name for name in by_case if len(value) > 2 and name.startswith(value.casefold())]
    close = with_unit or difflib.get_close_matches(value.casefold(), by_case, n=1) or begun
    return by_case[close[0]] if close else None


def truncated(value: object) -> str:
    """`repr` on one line, truncated to fit into a message."""
    try:
        text = " ".join(repr(value).split())
    except Exception as error:  # any error of the value's class, or an int of 5000 digits
        return "…" if isinstance(error, RecursionError) else f"<{type(value).__name__}>"
    return text if len(text) <= 60 else text[:57] + "…"


def both_given(key: str, value: object, other: str, remedy: str = "specify only one") -> SceneError:
    """The error of a key that may not be given beside another one."""
    shown = repr(value) if isinstance(value, str) else truncated(value)
    return SceneError(f"{key} = {shown}: {other} is also given; {remedy}", id="both-given")


def missing(key: str, why: str) -> SceneError:
    """The error of a key that must be given."""
    return SceneError(f"{key}: missing; {why}", id="missing-key")


def short_list(items: Sequence[str]) -> str:
    """Items separated by commas; the middle of a long list is left out."""
    return ", ".join(items if len(items) <= 8 else [*items[:5], "…", *items[-2:]])


def plural(count: int, noun: str) -> str:
    """Count and noun: '1 check', '2 checks'."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
