"""The notation page: NOTATION.md, with links to source files replaced by their names."""

from __future__ import annotations

import re
from pathlib import Path

SOURCE = Path(__file__).parents[2] / "NOTATION.md"


def page(_: Path) -> str:
    """Return the text of NOTATION.md without links to source files."""
    return re.sub(r"\[(`[^`\]]+`)\]\((?!http)[^)]+\)", r"\1", SOURCE.read_text(encoding="utf-8"))
