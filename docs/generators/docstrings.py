"""Docstrings as reStructuredText: |λ| is an absolute value there, and q_ a name."""

from __future__ import annotations

import re
from typing import Any

SPECIAL = re.compile(r"(``[^`]*``|`[^`]*`)|(\||\*(?=\w)|(?<=\w)_(?=\W|$))")


def escape(_app: Any, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Put a backslash before what reStructuredText would take for a mark; code and examples stay as they are."""
    for k, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            lines[k] = SPECIAL.sub(lambda found: found[1] or f"\\{found[2]}", line)
