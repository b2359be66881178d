"""Verdicts on pages: boxes in one row on a desktop screen."""

from __future__ import annotations

import re

from docs.generators import study
from tests.conftest import ROOT


def test_four_verdicts_of_a_report_fit_into_one_row() -> None:
    style = (ROOT / "flexlink" / "pages" / "data" / "style.css").read_text()
    box = re.search(r"\.verdicts \{.*minmax\(min\(100%, (\d+)rem\), 1fr\)\); gap: ([.\d]+)rem", style)
    assert box
    text = 66.0  # width of the text [rem]: 68 less the padding
    assert 4 * float(box[1]) + 3 * float(box[2]) <= text


def test_the_verdicts_of_the_study_are_one_row_of_boxes() -> None:
    page = study.page(ROOT)
    boxes = page.split(".. rst-class:: verdicts\n\n")[1].split("\n\n")[0]
    assert [line[:4] for line in boxes.splitlines()] == ["- **"] * len(study.verdicts())


def test_a_column_of_states_is_as_narrow_as_its_text() -> None:
    style = (ROOT / "flexlink" / "pages" / "data" / "style.css").read_text()
    assert re.search(r"^td\.state \{ white-space: nowrap; .*width: 1%;", style, re.MULTILINE)
