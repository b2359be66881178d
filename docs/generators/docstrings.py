"""Escape docstrings for reStructuredText, which reads |λ| as a substitution and q_ as a link."""

from __future__ import annotations

import re
from typing import Any

SPECIAL = re.compile(r"(``[^`]*``|`[^`]*`)|(\||\*(?=\w)|(?<=\w)_(?=\W|$))")


def escape(_app: Any, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Escape what reStructuredText would read as markup, except in code and doctests."""
    for k, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            lines[k] = SPECIAL.sub(lambda found: found[1] or f"\\{found[2]}", line)
