"""A chapter of a page, and its figures."""

from __future__ import annotations

import dataclasses

from flexlink.pages.tables import Table


@dataclasses.dataclass(frozen=True)
class Shown:
    """A figure on a page."""

    name: str
    id: str
    title: str
    svg: str
    caption: str
    files: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Chapter:
    """A chapter after its files have been written.

    Attributes
    ----------
    id, title, short
        Target of links to the chapter, its heading, and its name in the list of chapters.
    sentences
        Paragraphs, the conclusion first.
    figures, tables
        Figures and tables that support the conclusion.
    literal
        Preformatted text, for example a scene, which the page folds.
    literal_title
        Title of the preformatted text.
    files
        Names of other files next to the page.
    failure
        Reason why the chapter could not be computed; "" if it was computed.
    """

    id: str
    title: str
    short: str
    sentences: tuple[str, ...] = ()
    figures: tuple[Shown, ...] = ()
    tables: tuple[Table, ...] = ()
    literal: str = ""
    literal_title: str = "Scene file"
    files: tuple[str, ...] = ()
    failure: str = ""
