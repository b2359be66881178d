"""The page of notation: NOTATION.md, whose links to source files are names here."""

from __future__ import annotations

import re
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "NOTATION.md"


def page(_: Path) -> str:
    """Its text."""
    return re.sub(r"\[(`[^`\]]+`)\]\((?!http)[^)]+\)", r"\1", SOURCE.read_text(encoding="utf-8"))
