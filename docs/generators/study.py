"""The study's results, from `reports/full`: what was compared with what, and how it came out."""

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
PAGES_OF = {"extremes": "/explanation/extremes"}
"""Chapter → page that shows its results at a glance."""


@functools.cache
def stored() -> dict[str, Any]:
    """Chapters of the full study."""
    chapters: dict[str, Any] = json.loads((FULL / "chapters.json").read_text(encoding="utf-8"))
    return chapters


@functools.cache
def checks() -> list[dict[str, str]]:
    """Every number of the full study, with its limit where it has one."""
    with gzip.open(FULL / "all_checks.csv.gz", "rt", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rows(case: str, quantity: str, **columns: str) -> list[dict[str, str]]:
    """Rows of one quantity of a case, for sentences of pages."""
    wanted = {"case": case, "quantity": quantity, **columns}.items()
    return [row for row in checks() if wanted <= row.items()]


def values(case: str, quantity: str, **columns: str) -> list[float]:
    """Numbers of one quantity of a case, for sentences of pages."""
    return [float(row["value"]) for row in rows(case, quantity, **columns)]


def judged() -> list[dict[str, str]]:
    """Checks of correctness."""
    return [row for row in checks() if row["passed"] and row["timed"] == "False"]


def failing() -> list[dict[str, str]]:
    """Checks of correctness that fail."""
    return [row for row in judged() if row["passed"] != "True"]


def counts() -> dict[str, int]:
    """Numbers of checks of correctness, of passed checks, and of cases."""
    checked = len(judged())
    return {
        "checks": checked,
        "passed": checked - len(failing()),
        "cases": len({row["case"] for row in checks()}),
    }


def verdicts() -> list[tuple[str, str, str]]:
    """Verification and validation of the stored study: name, word, sentence."""
    found = [(one["about"], one["word"], one["text"]) for one in stored().get("verdicts", ())]
    if found:
        return found
    of = counts()
    text = (
        f"{of['passed']:,} of {of['checks']:,} checks pass in {of['cases']} cases: the equations are solved correctly."
    )
    return [
        ("Verification", stored()["state"], text),
        (
            "Validation",
            "not measured",
            "The stored study contains no comparison with measurements; `python -m validation` does.",
        ),
    ]


def picture(name: str, alt: str) -> str:
    """A stored figure as Markdown for a page of a subfolder of docs/, or a sentence that it is not stored yet."""
    if (FULL / f"{name}.png").is_file():
        return f"![{alt}](../../reports/full/{name}.png)"
    return "*The stored study does not contain this figure yet.*"


def finding(name: str) -> list[str]:
    """Sentences of a stored table, or one that it is not stored yet."""
    found = [one["sentences"] for chapter in stored()["chapters"] for one in chapter["findings"] if one["name"] == name]
    return found[0] if found else ["The stored study does not contain these numbers yet."]


def page(_: Path) -> str:
    """Verdicts and a table of chapters; then every chapter, with findings, figures and cases folded."""
    chapters = [chapter for chapter in stored()["chapters"] if chapter["figures"] or chapter["cases"]]
    titles = {
        section["id"]: section["title"] for section in tomllib.loads(SECTIONS.read_text(encoding="utf-8"))["section"]
    }
    rows = [(f":ref:`{titles[one['id']]} <study-{one['id']}>`", *_summary(one)) for one in chapters]
    parts = [
        heading("Results of the study"),
        ".. rst-class:: verdicts\n",
        "\n".join(f"- **{about}: {word}.** {prose(text)}" for about, word, text in verdicts()) + "\n",
        f"Measured {prose(stored()['measured'])}. To run it yourself: ``python -m validation --full``; to compare\n"
        "your results with these: ``python -m validation --same reports/full``. How the study works:\n"
        ":doc:`../../explanation/study`.\n",
        table(("chapter", "cases", "checks passed", "main result"), rows, "25 8 12 55"),
    ]
    for chapter in chapters:
        parts += [f".. _study-{chapter['id']}:\n", heading(titles[chapter["id"]], 1), *_chapter(chapter)]
    return "\n".join(parts)


def _summary(chapter: dict[str, Any]) -> tuple[str, str, str]:
    """Number of cases, passed checks and the first headline of a chapter."""
    cases = {case["case"] for case in chapter["cases"]}
    judged = [row["passed"] for row in checks() if row["case"] in cases and row["passed"] and row["timed"] == "False"]
    passed = f"{judged.count('True'):,} of {len(judged):,}" if judged else "–"
    return str(len(cases)), passed, prose(chapter["headlines"][0]) if chapter["headlines"] else "–"


def _chapter(chapter: dict[str, Any]) -> list[str]:
    """Headlines of a chapter; findings, figures and cases folded."""
    parts = [f"- {prose(headline)}" for headline in chapter["headlines"]] + [""]
    if page_of := PAGES_OF.get(chapter["id"]):
        parts.append(f"On one page: :doc:`{page_of}`.\n")
    findings = [
        f"**{prose(finding['title'])}.** {' '.join(prose(sentence) for sentence in finding['sentences'])}\n"
        for finding in chapter["findings"]
    ]
    figures = [
        directive(
            "figure", f"../../../reports/full/{figure['name']}.png",
            prose(f"{figure['title']}. {figure['caption']}"), alt=figure["title"],
        )
        for figure in chapter["figures"]
    ]  # fmt: skip
    rows = [
        (literal(case["case"]), prose(case["title"]), prose(f"{case['state']}: {case['text']}"))
        for case in chapter["cases"]
    ]
    cases = [table(("case", "what it measures", "result"), rows, "20 45 35")] if rows else []
    for name, inside in (("finding", findings), ("figure", figures), ("case", cases)):
        if inside:
            number = len(rows) if name == "case" else len(inside)
            parts.append(directive("dropdown", f"{number} {name}{'s' * (number > 1)}", "\n".join(inside)))
    return parts
