"""Results of the study, from `reports/full`: what was compared with what, and the outcome."""

from __future__ import annotations

import csv
import functools
import gzip
import json
import tomllib
from pathlib import Path
from typing import Any

from docs.generators.rest import directive, heading, literal, prose, table

FULL = Path(__file__).parents[2] / "reports" / "full"
SECTIONS = FULL.parent / "sections.toml"


@functools.cache
def stored() -> dict[str, Any]:
    """Return the chapters of the full study."""
    chapters: dict[str, Any] = json.loads((FULL / "chapters.json").read_text(encoding="utf-8"))
    return chapters


@functools.cache
def checks() -> list[dict[str, str]]:
    """Return every number of the full study, with its limit if it has one."""
    with gzip.open(FULL / "all_checks.csv.gz", "rt", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def counts() -> dict[str, int]:
    """Return the numbers of correctness checks, of passed checks, and of cases."""
    judged = [row for row in checks() if row["passed"] and row["timed"] == "False"]
    return {
        "checks": len(judged),
        "passed": sum(row["passed"] == "True" for row in judged),
        "cases": len({row["case"] for row in checks()}),
    }


def page(_: Path) -> str:
    """Return the verdict, then findings, figures and cases by chapter."""
    total = counts()
    titles = {
        section["id"]: section["title"] for section in tomllib.loads(SECTIONS.read_text(encoding="utf-8"))["section"]
    }
    parts = [
        heading("Results of the study"),
        f"**{total['passed']} of {total['checks']} checks pass**, in {total['cases']} cases. "
        f"{prose(stored()['measured'])}.\n",
        "To run the study: ``python -m validation --full``. To check your results against the published ones:\n"
        "``python -m validation --same reports/full``. Method of the study: :doc:`../../explanation/study`.\n",
    ]
    for chapter in stored()["chapters"]:
        if chapter["figures"] or chapter["cases"] or chapter["findings"]:
            parts += [heading(titles[chapter["id"]], 1), *_chapter(chapter)]
    return "\n".join(parts)


def _chapter(chapter: dict[str, Any]) -> list[str]:
    parts = []
    for finding in chapter["findings"]:
        sentences = " ".join(prose(sentence) for sentence in finding["sentences"])
        parts.append(f"**{prose(finding['title'])}.** {sentences}\n")
    for figure in chapter["figures"]:
        path = f"../../../reports/full/{figure['name']}.png"
        parts.append(directive("figure", path, prose(f"{figure['title']}. {figure['caption']}"), alt=figure["title"]))
    rows = [
        (literal(case["case"]), prose(case["title"]), prose(f"{case['state']}: {case['text']}"))
        for case in chapter["cases"]
    ]
    if rows:
        parts.append(table(("case", "what it measures", "result"), rows, "20 45 35"))
    return parts
