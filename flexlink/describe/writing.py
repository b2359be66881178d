"""A description as TOML that a person would write: defaults left out, one line a key, what a link holds inline."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import Any

from flexlink.describe.spec import Spec, default_of, fields_of


def without_defaults(value: Any, always: frozenset[str] = frozenset()) -> Any:
    """What a description says that is not so by default, as dicts, lists, texts and numbers.

    Parameters
    ----------
    value
        A `Spec`, or what stands in one.
    always
        Names of its fields that are said even where they are as by default.
    """
    if isinstance(value, Spec):
        fields = [(field, getattr(value, field.name)) for field in fields_of(type(value))]
        return {
            field.encode_name: without_defaults(item)
            for field, item in fields
            if item is not None and (field.name in always or item != default_of(field))
        }
    if isinstance(value, Mapping):
        return {key: without_defaults(item) for key, item in value.items()}
    return [without_defaults(item) for item in value] if isinstance(value, list | tuple) else value


def toml_of(document: Mapping[str, Any], inline: frozenset[str] = frozenset()) -> str:
    """The TOML text of a document; tables at the keys `inline`, and in a list of tables, stand in one line."""
    return "\n\n".join("\n".join(block) for block in _blocks(document, inline)) + "\n"


def _blocks(table: Mapping[str, Any], inline: frozenset[str], path: str = "") -> Iterator[list[str]]:
    """First what stands in the table itself, then table by table what stands below."""
    tables = {key: value for key, value in table.items() if isinstance(value, Mapping) and key not in inline}
    below = {key: value for key, value in table.items() if key in tables or _are_tables(value)}
    own = {key: value for key, value in table.items() if key not in below}
    if own or not (path and below):
        yield [*([f"[{path}]"] if path else []), *_lines(own)]
    for key, value in below.items():
        there = f"{path}.{_key(key)}".lstrip(".")
        if _are_tables(value):
            yield from ([f"[[{there}]]", *_lines(item)] for item in value)
        else:
            yield from _blocks(value, inline, there)


def _are_tables(value: object) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(item, Mapping) for item in value)


def _lines(table: Mapping[str, Any]) -> list[str]:
    """One line a key, with aligned signs; a list beyond 120 characters has one item a line."""
    width = max((len(_key(key)) for key in table), default=0)
    lines = []
    for key, value in table.items():
        line = f"{_key(key):<{width}} = {_value(value)}"
        if len(line) > 120 and isinstance(value, list):
            line = "\n".join([f"{_key(key):<{width}} = [", *(f"    {_value(item)}," for item in value), "]"])
        lines.append(line)
    return lines


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float):
        return _number(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # texts, true, false, and integers


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _value(name)


def _number(value: float) -> str:
    """The shortest decimals that read back to the same float64, with an exponent where that is shorter by far."""
    plain = repr(value)
    mantissa, _, exponent = f"{Decimal(plain):e}".partition("e")
    digits = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    scientific = f"{digits}e{int(exponent)}"
    return scientific if len(scientific) + 2 < len(plain) else plain
