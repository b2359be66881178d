"""What a key of a scene accepts, in words, and alternatives to unknown keys and unsupported features."""

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from flexlink.common.wording import did_you_mean, short_list
from flexlink.data.documents import read_toml


@cache
def words() -> dict[str, Any]:
    """Common mistakes in scenes and calls, and what to write instead."""
    return read_toml(Path(__file__).parent / "data" / "expected.toml")


@cache
def limits() -> dict[str, dict[str, Any]]:
    """What flexlink does not model: a sentence, what to do instead, and the words by which a scene asks for it."""
    rows = read_toml(Path(__file__).parent / "data" / "limits.toml")
    return {name: {"text": f"{row['what']}: {row['instead']}", **row} for name, row in rows.items()}


@cache
def kinds_of(what: str) -> dict[str, tuple[list[str], list[str], str]]:
    """Keys that each kind of a "sensor", "tie", "drive", "reference" needs, and may have, and a sensor's unit."""
    rows = read_toml(Path(__file__).parent / "data" / "kinds.toml")[what]
    return {kind: (needs, may, "".join(unit)) for kind, (needs, may, *unit) in rows.items()}


def expected(where: str, kind: Any, value: object, reason: str, units: Sequence[str] = ()) -> str:
    """Describe what a key accepts, using its annotation, its name, or msgspec's reason and the key's units."""
    known = (
        _allowed(where, kind, value)
        or _three_numbers(where, kind, value)
        or ((kind is not float or isinstance(value, list)) and _as_written(where, value))
    )
    if known:
        return known
    keys = getattr(kind, "__struct_encode_fields__", ())
    return _in_words(reason, value, " or ".join(units)) + (f"; its keys are {short_list(keys)}" if keys else "")


def _allowed(where: str, kind: Any, value: object) -> str:
    """Values allowed by a `Literal` annotation, with their meaning or a suggestion (unless `why_not` has one)."""
    allowed = get_args(kind) if get_origin(kind) is Literal else ()
    meaning = words()["meaning"].get(where.rpartition(".")[2], "")
    suggestion = meaning or ("" if why_not("", value) else did_you_mean(value, allowed))
    return "allowed are " + ", ".join(map(repr, allowed)) + suggestion if allowed else ""


def _three_numbers(where: str, kind: Any, value: object) -> str:
    """Text for keys that expect three numbers, with an example (the axis named by `value`, if any), else empty."""
    directions = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
    known = words()["three_numbers"].get(where.rpartition(".")[2].partition("[")[0])
    if kind != tuple[float, float, float] or known is None or (isinstance(value, list) and list in map(type, value)):
        return ""
    unit, example = known["unit"], known["example"]
    named = directions.get(value.strip("+- ").casefold(), example) if isinstance(value, str) and not unit else example
    length = f", got {len(value)}" if isinstance(value, list | tuple) else ""
    return f"expected three numbers{f' [{unit}]' if unit else ''}, such as {list(named)}{length}"


def _as_written(where: str, value: object) -> str:
    """Example of a key's list or table, if a single value was given; empty for other keys."""
    above, _, key = where.partition("[")[0].rpartition(".")
    row = words()["written"].get("flexible" if above == "flexible" else key, {})
    given = float if isinstance(value, int | float) else type(value)
    return str(row["expected"] if given.__name__ in row.get("type", "").split() else row.get(given.__name__, ""))


def _in_words(reason: str, value: object, unit: str) -> str:
    """Reword msgspec's reason without names of Python types, and add the unit of a number."""
    if limit := re.fullmatch(r"Expected `(?:float|int)(?: \| null)?` ([<>]=?) (\S+)", reason):
        return f"must be {limit[1]} {limit[2].removesuffix('.0')}"
    if length := re.fullmatch(r"Expected `array(?: \| null)?` of length (>= |<= )?(\d+)(?:, got .*)?", reason):
        bound = {">= ": "at least ", "<= ": "at most "}.get(length[1], "")
        return f"expected {bound}{length[2]} value{'' if length[2] == '1' else 's'}"
    kinds = re.fullmatch(r"Expected `([^`]*)`(?:, got `([^`]*)`)?", reason)
    if kinds is None:
        return (reason[:1].lower() + reason[1:]).replace("`", "")
    wanted = [name for name in kinds[1].split(" | ") if name != "null"]
    called = words()["called"]
    text = " or ".join(called.get(name, name) for name in wanted)
    if unit and wanted == ["float"]:
        text += f" in {unit}"
        if isinstance(value, str) and re.match(r"\s*[+-]?\.?\d[\d.eE+-]*\s*[^\d\s]", value):
            return f"expected {text}, without its unit"
    if kinds[2] in {None, "null"} or (wanted, kinds[2]) == (["int"], "float"):
        return f"expected {text}"
    if "array" in wanted and kinds[2] in {"int", "float", "str"}:
        text += f", such as [{value!r}]"
    if "array" in wanted and kinds[2] == "object":
        text += " of tables, [{ … }]"
    return f"expected {text}, not {called.get(kinds[2], kinds[2])}"


@cache
def _instead(of: str) -> dict[str, str]:
    """Suggested alternatives to unknown keys or to values, by word; `of` is "keys" or "values"."""
    return {word: row["text"] for row in (*words()["instead"], *limits().values()) for word in row.get(of, ())}


def why_not(key: str, value: object, near: str = "") -> str:
    """End of a message on an unknown key or a wrong value; where a key is `near`, as run to Run, no other is named."""
    by_value = _instead("values").get(value.casefold(), "") if isinstance(value, str) else ""
    tables = () if near else words()["belongs"].items()
    belongs = next((f"this key belongs to {table}" for table, keys in tables if key.casefold() in keys), "")
    found = by_value or (f"'{key.casefold()}" not in near and _instead("keys").get(key.casefold(), belongs))
    return f": {found}" if found else ""
