"""What was tried for the lumping of links, and what became of it: words, from reports/tried.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
FILE = Path(__file__).parent.parent / "tried.toml"


def find(results: Results) -> Iterator[Table]:
    """One table, if the study holds physics at all."""
    if any(results.of_kind("frequencies")):
        data = tomllib.loads(FILE.read_text(encoding="utf-8"))
        lines = tuple((entry["idea"], entry["outcome"]) for entry in data["tried"])
        yield Table("physics_tried", "Ideas that were tried", ("idea", "outcome"), lines, (data["text"],))
