"""Write a description as readable TOML without defaults, one line per key, with inline tables inside links."""

import json
import re
from collections.abc import Iterator, Mapping
from decimal import Decimal
from typing import Any

from flexlink.describe.spec import Spec, default_of, fields_of


def without_defaults(value: Any, always: frozenset[str] = frozenset()) -> Any:
    """Values of a description that differ from the defaults, and `always` those of some fields, as built-in types."""
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
    """Return a document as TOML; tables at the keys `inline`, and tables in lists of tables, are written inline."""
    return "\n\n".join("\n".join(block) for block in _blocks(document, inline)) + "\n"


def _blocks(table: Mapping[str, Any], inline: frozenset[str], path: str = "") -> Iterator[list[str]]:
    """Blocks of lines: first the values of the table itself, then its subtables."""
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
    """One line per key, with aligned equals signs; a list longer than 120 characters has one line per item."""
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
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # text, true, false, or integer


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _value(name)


def _number(value: float) -> str:
    """Shortest decimals that read back to the same float64, with an exponent if that is much shorter."""
    plain = repr(value)
    mantissa, _, exponent = f"{Decimal(plain):e}".partition("e")
    digits = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    scientific = f"{digits}e{int(exponent)}"
    return scientific if len(scientific) + 2 < len(plain) else plain
