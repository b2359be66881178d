"""The page of a report: a template beside the common elements and style, filled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import jinja2

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import write_text
from flexlink.pages.chapter import Chapter
from flexlink.pages.numbers import amount, number
from flexlink.pages.tables import as_head
from flexlink.pages.verdict import Fact, Verdict

DATA = Path(__file__).parent / "data"


def template(path: Path, **filters: object) -> jinja2.Template:
    """The template of a file; one of HTML may extend `page.html` and take macros from `elements.html`."""
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
    environment.filters.update(number=number, amount=amount, head=as_head, **filters)
    return environment.get_template(path.name)


def make_folder(path: Path) -> None:
    """Make `path` and its parents.

    Raises
    ------
    FlexlinkError
        It is impossible.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FlexlinkError(f"{path}: cannot be made a folder: {error.strerror or error}") from None


def write_page(
    folder: Path, name: str, kind: str, chapters: Sequence[Chapter], verdicts: Sequence[Verdict],
    facts: Sequence[Fact], definitions: Mapping[str, str],
) -> Path:  # fmt: skip
    """Write index.html, chapter after chapter, whole; `kind` is what the page is, such as "report"."""
    filled = template(DATA / "chapters.html").render(
        title=f"{name}: flexlink {kind}", name=name, chapters=chapters, verdicts=verdicts, facts=facts,
        definitions=definitions,
    )  # fmt: skip
    write_text(folder / "index.html", filled)
    return folder / "index.html"
