"""Two pages about the study for the appendix of a thesis, as PDF: verdict and numbers, then four pictures."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from PIL import Image

from reports.build import StudyReport
from reports.verdict import Fact

NAME = "appendix.pdf"
A4 = 8.27, 11.69  # inches
MARGIN, LINE, WIDTH = 0.09, 0.0145, 98  # fractions of a page; characters of a line
SIZE = 8.5  # of the letters, unless the text is long
PICTURES = 4


def save(report: StudyReport, facts: Sequence[Fact], about: Sequence[str], folder: Path) -> None:
    """Write the pages to `folder`, which contains the pictures; `about` are sentences on what was measured, and where.

    A picture's page has the first picture of the report, then those of the chapters in order.
    """
    shown = [*report.overview, *(chapter.figures[0] for chapter in report.chapters if chapter.figures)][:PICTURES]
    with PdfPages(folder / NAME, metadata={"CreationDate": None, "Title": "Validation of flexlink"}) as pdf:
        pdf.savefig(_text(_paragraphs(report, facts, about)))
        pdf.savefig(_pictures([(folder / f"{one.name}.png", one.title) for one in shown]))


def _paragraphs(report: StudyReport, facts: Sequence[Fact], about: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Each paragraph of the first page, with its weight."""
    yield "Validation of flexlink", "bold"
    verdicts = (f"{one.about}: {one.word}. {one.text}".replace("**", "") for one in report.verdicts)
    for text in (*about, *verdicts):
        yield text, "normal"
    for fact in facts:
        values = (f"{value} ({note})" if note else value for value, note in fact.values)
        yield f"{'; '.join(values)}: {fact.label}.", "normal"
    for chapter in report.chapters:
        for k, headline in enumerate(chapter.headlines[:2]):
            yield from ((chapter.title, "bold"), (headline, "normal"))[min(k, 1) :]


def _text(paragraphs: Iterable[tuple[str, str]]) -> Figure:
    """Page of text, in smaller letters if it is long."""
    page = Figure(figsize=A4)
    lines = [(line, weight) for text, weight in paragraphs for line in (*textwrap.wrap(text, WIDTH), "")]
    height = min(LINE, (1 - 2 * MARGIN) / len(lines))
    for k, (line, weight) in enumerate(lines):
        place = MARGIN, 1 - MARGIN - k * height
        page.text(*place, line, size=SIZE * height / LINE, weight=weight, va="top", parse_math=False)
    return page


def _pictures(shown: Sequence[tuple[Path, str]]) -> Figure:
    page = Figure(figsize=A4, layout="constrained")
    for axes, (file, title) in zip(page.subplots(-(-len(shown) // 2) or 1, 2, squeeze=False).flat, shown, strict=False):
        axes.imshow(Image.open(file).convert("RGB"), interpolation="lanczos")
        axes.set_title(textwrap.fill(title, 48), size=SIZE)
    for axes in page.axes:
        axes.set_axis_off()
    return page
