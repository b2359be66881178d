"""Two pages about the study for the appendix of a thesis, as PDF: verdict and numbers, then four pictures."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from PIL import Image

from reports.build import StudyReport
from reports.verdict import Fact

NAME = "appendix.pdf"
A4 = 8.27, 11.69  # inches
MARGIN, LINE, WIDTH = 0.09, 0.0145, 98  # fractions of a page; characters of a line
PICTURES = 4


def save(report: StudyReport, facts: Sequence[Fact], about: Sequence[str], folder: Path) -> None:
    """Write the pages to `folder`, which contains the pictures; `about` are sentences on what was measured, and where.

    A picture's page has the first picture of the report, then those of the chapters in order.
    """
    shown = [*report.overview, *(chapter.figures[0] for chapter in report.chapters if chapter.figures)][:PICTURES]
    lines = [*_sentences(report, facts, about)]
    with PdfPages(folder / NAME, metadata={"CreationDate": None, "Title": "Validation of flexlink"}) as pdf:
        pdf.savefig(_text(lines))
        pdf.savefig(_pictures([(folder / f"{one.name}.png", one.title) for one in shown]))


def _sentences(report: StudyReport, facts: Sequence[Fact], about: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each line of the first page, with its weight."""
    yield "Validation of flexlink", "bold"
    paragraphs = [
        *about,
        *(f"{one.about}: {one.word}. {one.text}" for one in report.verdicts),
        *(
            "; ".join(f"{value} ({note})" if note else value for value, note in f.values) + f": {f.label}."
            for f in facts
        ),
    ]
    for paragraph in paragraphs:
        yield "", "normal"
        for line in textwrap.wrap(paragraph.replace("**", ""), WIDTH):
            yield line, "normal"
    for chapter in report.chapters:
        if chapter.headlines:
            yield from (("", "normal"), (chapter.title, "bold"))
        for headline in chapter.headlines[:2]:
            for line in textwrap.wrap(headline, WIDTH):
                yield line, "normal"


def _text(lines: Sequence[tuple[str, str]]) -> Figure:
    page = Figure(figsize=A4)
    room = int((1 - 2 * MARGIN) / LINE)
    for k, (line, weight) in enumerate(lines[:room]):
        page.text(MARGIN, 1 - MARGIN - k * LINE, line, size=8.5, weight=weight, va="top", parse_math=False)
    return page


def _pictures(shown: Sequence[tuple[Path, str]]) -> Figure:
    page = Figure(figsize=A4, layout="constrained")
    for axes, (file, title) in zip(page.subplots(-(-len(shown) // 2) or 1, 2, squeeze=False).flat, shown, strict=False):
        axes.imshow(Image.open(file).convert("RGB"), interpolation="lanczos")
        axes.set_title(textwrap.fill(title, 48), size=8.5)
    for axes in page.axes:
        axes.set_axis_off()
    return page
