"""Descriptions of scenes, from their files or from the titles of their runs."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator
from pathlib import Path

from flexlink.pages.tables import Table
from reports.prices import works
from reports.results import Results
from validation.case import MODELS, STUDY_SCENES

FOLDERS = (STUDY_SCENES, MODELS, MODELS / "robots")


def scene_names(results: Results) -> Table | None:
    """A line per scene of the study that has a description; None if there are none."""
    names = {row.scene for row in results.rows}
    known = dict(_words(results, names))
    lines = tuple((name, known[name]) for name in sorted(names & known.keys()))
    return Table("scenes", "Names of the scenes", ("scene", "what it is"), lines) if lines else None


def _words(results: Results, names: Collection[str]) -> Iterator[tuple[str, str]]:
    for path in (path for folder in FOLDERS for path in sorted(folder.glob("*.toml"))):
        if path.stem in names and (about := _about(path)):
            yield path.stem, about
    for _, series in works(results):
        yield series.scene, series.title.removeprefix(f"{series.scene}: ")


def _about(path: Path) -> str:
    found = tomllib.loads(path.read_text(encoding="utf-8")).get("about", "")
    return " ".join(str(found).split())
