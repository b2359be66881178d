"""A report: verdicts on its first screen, one for each question that it answers, its chapters, and their figures."""

import dataclasses
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from flexlink.common.notebook import html_table
from flexlink.pages.tables import Table

State = Literal["pass", "fail", "doubt", "info", "incomplete", "met", "missed", "not-measured"]
"""CSS classes of verdicts."""


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Verdict on a subject, consisting of a word, coloured by `state`, and a sentence."""

    about: str
    state: State
    word: str
    text: str


class Fact(NamedTuple):
    """A number on the first screen, with its unit and label."""

    value: str
    label: str


@dataclasses.dataclass(frozen=True)
class Shown:
    """A figure on a page."""

    name: str
    id: str  # of its HTML element
    title: str
    svg: str
    caption: str
    files: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Chapter:
    """A chapter after its files have been written."""

    # id, title, short: target of links to the chapter, its heading, and its name in the list of chapters
    id: str
    title: str
    short: str
    sentences: tuple[str, ...] = ()  # paragraphs, the conclusion first
    # figures, tables: figures and tables that support the conclusion
    figures: tuple[Shown, ...] = ()
    tables: tuple[Table, ...] = ()
    literal: str = ""  # preformatted text, for example a scene, which the page folds
    literal_title: str = "Scene file"  # title of the preformatted text
    files: tuple[str, ...] = ()  # names of other files next to the page
    failure: str = ""  # reason why the chapter could not be computed; "" if it was computed


@dataclasses.dataclass(frozen=True, repr=False)
class Report:
    """A report on disk."""

    page: Path  # of index.html
    verdicts: tuple[Verdict, ...]  # on the first screen of the page
    chapters: Sequence[Chapter]  # of the page, in order

    def __repr__(self) -> str:
        words = ", ".join(f"{verdict.about} {verdict.word}" for verdict in self.verdicts)
        return f"<{type(self).__name__} {str(self.page)!r}: {words}>"

    def _repr_html_(self) -> str:
        rows = [(verdict.about, verdict.word, verdict.text) for verdict in self.verdicts]
        link = f'<a href="{html.escape(str(self.page))}">{html.escape(str(self.page))}</a>'
        return html_table(repr(self), ("about", "verdict", "number"), rows) + link

    @property
    def failures(self) -> tuple[str, ...]:
        """Chapters that could not be computed, each with the reason."""
        return tuple(f"{chapter.title}: {chapter.failure}" for chapter in self.chapters if chapter.failure)

    @property
    def passed(self) -> bool:
        """Whether no verdict is "fail"."""
        return all(verdict.state != "fail" for verdict in self.verdicts)
