"""What a key of a scene takes, in words, and what to do instead where people look for something that is not there."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from flexlink.common.wording import did_you_mean
from flexlink.data.documents import read_toml


@cache
def _words() -> dict[str, Any]:
    return read_toml(Path(__file__).parent / "data" / "expected.toml")


def expected(where: str, kind: Any, value: object) -> str:
    """What a key takes, by its annotation or its name; empty where neither tells."""
    return _allowed(kind, value) or _three_numbers(where, kind, value) or _as_written(where, value)


def _allowed(kind: Any, value: object) -> str:
    """What a `Literal` annotation allows, and which of it was likely meant; empty for others."""
    allowed = get_args(kind) if get_origin(kind) is Literal else ()
    return "allowed are " + ", ".join(map(repr, allowed)) + did_you_mean(value, allowed) if allowed else ""


def _three_numbers(where: str, kind: Any, value: object) -> str:
    """What a vector's key takes, and an example, of an axis the one that is meant; empty for others."""
    directions = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    known = _words()["three_numbers"].get(where.rpartition(".")[2])
    if kind != tuple[float, float, float] or known is None:
        return ""
    unit, example = known["unit"], known["example"]
    named = directions.get(value.strip("+- ").casefold(), example) if isinstance(value, str) and not unit else example
    length = f", got {len(value)}" if isinstance(value, list | tuple) else ""
    return f"expected three numbers{f' [{unit}]' if unit else ''}, such as {list(named)}{length}"


def _as_written(where: str, value: object) -> str:
    """How a key's list or table is written, where a single one was given; empty for others."""
    row = _words()["written"].get(where.rpartition(".")[2], {})
    given = float if isinstance(value, int | float) else type(value)
    expected: str = row["expected"] if row.get("type") == given.__name__ else ""
    return expected


@cache
def _instead(words: str) -> dict[str, str]:
    """What to do instead by each of the "keys", or "values"."""
    return {word: row["text"] for row in _words()["instead"] for word in row.get(words, ())}


def why_not(key: str, value: object) -> str:
    """What to do instead, as the end of a message on an unknown key or a value of the wrong type; empty if unknown."""
    by_value = _instead("values").get(value.casefold(), "") if isinstance(value, str) else ""
    found = by_value or _instead("keys").get(key.casefold(), "")
    return f": {found}" if found else ""
