"""The same arm in a third-party file: agreement, differences, and the likely mistakes."""

from flexlink.diagnosis.comparison import compare
from flexlink.pages.page import Part
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Verdict
from flexlink.scene_report.study import Study


def made(study: Study) -> Part | None:
    """Build the chapter."""
    if study.against is None or study.measurements:
        return None
    states = 100
    (found,) = compare(study.scene, file=study.against, samples=states).diagnoses
    first, *why = str(found).splitlines()
    sentences = (
        f"{study.against.name}, read by {found.engine}, is compared with this scene: parameters of every joint and "
        f"body in one frame, and terms of the equation of motion at {states} states. Differences of terms are divided "
        "by the rounding bound; a ratio of at most 1 means that the terms agree to within rounding.",
        f"{first}.",
        *(line.strip() for line in why),
    )
    heads = ("quantity", "difference / rounding bound", "worst joint", "verdict")
    lines = tuple(
        (row.quantity, row.error, row.joint if row.error else "", "agrees" if row.passed else "DIFFERS")
        for row in found.rows
    )
    mistakes = [finding for finding in found.findings if finding.counts]
    details = f"{study.against.name} describes a different arm; see “Other file”."
    verdict = Verdict("Other file", "fail", "differs", f"{study.against.name}: {mistakes[0]}" if mistakes else details)
    if found.passed:
        verdict = Verdict("Other file", "pass", "agrees", f"{study.against.name} describes the same arm.")
    table = Table("theirs", "Terms of the equation of motion: this scene and the file", heads, lines)
    return Part(sentences, (verdict,), tables=(table,) if lines else ())
