"""Content of a chapter of a report: sentences, tables, pictures, and verdicts for the first screen."""

import dataclasses
from pathlib import Path

from flexlink.common.output import write_text
from flexlink.pages.picture import Picture
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Chapter, Fact, Verdict


@dataclasses.dataclass(frozen=True)
class Part:
    """Content of a chapter."""

    sentences: tuple[str, ...] = ()  # paragraphs, the conclusion first
    verdicts: tuple[Verdict, ...] = ()  # verdicts for the first screen
    # pictures, tables: pictures and tables, with their files
    pictures: tuple[Picture, ...] = ()
    tables: tuple[Table, ...] = ()
    literal: str = ""  # preformatted text, for example a scene, which the page folds
    literal_title: str = "Scene file"  # title of the preformatted text
    files: dict[str, str] = dataclasses.field(default_factory=dict)  # texts of other files next to the page, by name
    facts: tuple[Fact, ...] = ()  # numbers for the first screen


def written(chapter: Chapter, part: Part, folder: Path, definitions: dict[str, str]) -> Chapter:
    """Write the files of a part, and return the chapter with its content."""
    for table in part.tables:
        write_text(folder / f"{table.name}.csv", table.csv)
    for name, text in part.files.items():
        write_text(folder / name, text)
    return dataclasses.replace(
        chapter, sentences=part.sentences, tables=part.tables, literal=part.literal,
        literal_title=part.literal_title, files=tuple(part.files),
        figures=tuple(picture.shown(folder, definitions) for picture in part.pictures),
    )  # fmt: skip
