"""A chapter of a page, and the figures in it."""

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
    """A chapter, its files written.

    Attributes
    ----------
    id, title, short
        Target of links to it, its heading, and its name in the list of chapters.
    sentences
        Paragraphs, the answer first.
    figures, tables
        What they stand on.
    literal
        Text that keeps its lines, such as a scene; it is folded.
    literal_title
        What it is.
    files
        Names of other files beside the page.
    failure
        Why it could not be computed; "" if it was.
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
