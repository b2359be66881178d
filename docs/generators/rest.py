"""Pieces of reStructuredText: headings, tables, directives."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

LEVELS = "=-~^"
ROLE = re.compile(r"(:\w+:`[^`]+`)")


def heading(text: str, level: int = 0) -> str:
    """Return a heading, underlined by its level."""
    return f"{text}\n{LEVELS[level] * (2 * len(text))}\n"


def indented(text: str, by: int = 3) -> str:
    """Return text indented as the body of a directive."""
    return "\n".join(f"{' ' * by}{line}" if line else "" for line in text.splitlines())


def directive(name: str, argument: str = "", body: str = "", **options: str) -> str:
    """Return `.. name:: argument` with its options and body."""
    lines = [f".. {name}:: {argument}".rstrip(), *(f"   :{key}: {value}".rstrip() for key, value in options.items())]
    return "\n".join([*lines, "", indented(body), ""])


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], widths: str = "auto") -> str:
    """Return a table with cells in reStructuredText."""
    lines = [_row(row) for row in (heads, *rows)]
    return directive("list-table", body="\n".join(lines), **{"header-rows": "1", "widths": widths})


def _row(cells: Sequence[str]) -> str:
    return "\n".join(f"{'  -' if k else '* -'} {cell}".rstrip() for k, cell in enumerate(cells))


def literal(text: object) -> str:
    """Return ``text``, as code."""
    return f"``{text}``"


def prose(text: str) -> str:
    """Return sentences of a docstring as reStructuredText: code in single backticks, as in Markdown, and roles."""
    parts = ROLE.split(text)
    return "".join(part if k % 2 else _marked(part) for k, part in enumerate(parts))


def _marked(text: str) -> str:
    parts = text.split("`")
    plain = ((k, part) for k, part in enumerate(parts) if not k % 2)
    marked = {k: part.replace("*", r"\*").replace("|", r"\|").replace("_…", r"\_…") for k, part in plain}
    return "".join(marked.get(k, f"``{part}``") for k, part in enumerate(parts)).replace("````", "")
