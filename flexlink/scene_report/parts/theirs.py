"""The same arm in a file of somebody else's: what agrees, what differs, and the likely mistakes."""

from __future__ import annotations

from flexlink.diagnosis.comparison import compare
from flexlink.diagnosis.diagnosis import Diagnosis
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Verdict
from flexlink.scene_report.part import Part
from flexlink.scene_report.study import Study

SAMPLES = 100  # states


def made(study: Study) -> Part | None:
    """The chapter."""
    if study.against is None or study.measurements:
        return None
    (found,) = compare(study.scene, file=study.against, samples=SAMPLES).diagnoses
    first, *why = str(found).splitlines()
    sentences = (
        f"{study.against.name} as {found.engine} has read it, beside this scene: terms of the equation of motion at "
        f"{SAMPLES} states, in units of what rounding explains, and the numbers of every joint and body in one frame.",
        f"{first}.",
        *(line.strip() for line in why),
    )
    return Part(sentences, (_verdict(study, found),), tables=_tables(found))


def _verdict(study: Study, found: Diagnosis) -> Verdict:
    name = study.against.name if study.against else ""
    if found.passed:
        return Verdict("Other file", "pass", "agrees", f"{name} holds this arm.")
    mistakes = [finding for finding in found.findings if finding.counts]
    text = f"{name}: {mistakes[0]}" if mistakes else f"{name} holds another arm; the chapter says what is known."
    return Verdict("Other file", "fail", "differs", text)


def _tables(found: Diagnosis) -> tuple[Table, ...]:
    if not found.rows:
        return ()
    heads = ("quantity", "difference over rounding", "worst joint", "in all")
    lines = tuple(
        (row.quantity, row.error, row.joint if row.error else "", "agrees" if row.passed else "DIFFERS")
        for row in found.rows
    )
    return (Table("theirs", "Terms, this scene against the file", heads, lines),)
