"""Lumping rules that were tried, and the outcome of each, from reports/tried.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
FILE = Path(__file__).parent.parent / "tried.toml"


def find(results: Results) -> Iterator[Table]:
    """One table, if the study has a case of the physics chapter."""
    if any(results.of_kind("frequencies")):
        data = tomllib.loads(FILE.read_text(encoding="utf-8"))
        lines = tuple((entry["idea"], entry["outcome"]) for entry in data["tried"])
        yield Table("physics_tried", "Lumping rules that were tried", ("idea", "outcome"), lines, (data["text"],))
