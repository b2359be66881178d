"""The page of a report: a template beside the common elements and style, filled."""

from __future__ import annotations

from pathlib import Path

import jinja2

from flexlink.common.errors import FlexlinkError
from flexlink.pages.numbers import amount, number

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
    environment.filters.update(number=number, amount=amount, **filters)
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
