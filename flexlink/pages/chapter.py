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
