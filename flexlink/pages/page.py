"""HTML page of a report: a template with the common elements and style."""

import dataclasses
import functools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import jinja2

from flexlink.common.output import write_text
from flexlink.pages.numbers import amount, number
from flexlink.pages.picture import Picture
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Chapter, Fact, Verdict

DATA = Path(__file__).parent / "data"


@functools.cache
def template(path: Path, **filters: object) -> jinja2.Template:
    """A file's template, cached; HTML templates may extend `page.html` and import macros from `elements.html`."""
    is_html = path.suffix == ".html"
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([path.parent, DATA]),
        autoescape=is_html,
        keep_trailing_newline=not is_html,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.globals["style"] = (DATA / "style.css").read_text(encoding="utf-8")
    environment.filters.update(number=number, amount=amount, sentence_case=sentence_case, **filters)
    return environment.get_template(path.name)


def sentence_case(head: str) -> str:
    """A column head with a capital letter, except for symbols, names and paths.

    >>> print([sentence_case(head) for head in ("standard deviation", "p of whiteness", "tip.mass")])
    ['Standard deviation', 'p of whiteness', 'tip.mass']
    """
    first = re.split(r"[ ,:/-]", head, maxsplit=1)[0]
    return head[:1].upper() + head[1:] if len(first) > 1 and first.isalpha() else head


def write_page(
    folder: Path, name: str, kind: str, chapters: Sequence[Chapter], verdicts: Sequence[Verdict],
    facts: Sequence[Fact], definitions: Mapping[str, str],
) -> Path:  # fmt: skip
    """Write index.html with all chapters; `kind` is the kind of the page, for example "report"."""
    filled = template(DATA / "chapters.html").render(
        title=f"{name}: flexlink {kind}", name=name, chapters=chapters, verdicts=verdicts, facts=facts,
        definitions=definitions,
    )  # fmt: skip
    write_text(folder / "index.html", filled)
    return folder / "index.html"


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
