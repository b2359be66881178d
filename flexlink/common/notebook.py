"""Display objects in a notebook as a compact table, and import modules that draw figures or build pages on demand."""

import html
import importlib
from collections.abc import Sequence
from types import ModuleType

from flexlink.common.errors import MissingDependencyError, how_to_install, imported


def html_table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Table as HTML, with escaped cells and five-digit numbers; a long table shows only its first and last rows."""
    most_rows, ends = 16, 7
    texts = [[f"{cell:.5g}" if isinstance(cell, float) else str(cell) for cell in row] for row in rows]
    if len(texts) > most_rows:
        texts[ends:-ends] = [["…"] * len(heads)]
    body = "".join(f"<tr>{_cells('td', row)}</tr>" for row in texts)
    head = f"<thead><tr>{_cells('th', heads)}</tr></thead>"
    title = f"<caption>{html.escape(caption)}</caption>"
    return f'<table style="text-align: left">{title}{head}<tbody>{body}</tbody></table>'


def html_lines(text: str) -> str:
    """Preformatted lines as HTML."""
    return f'<pre style="text-align: left; white-space: pre-wrap">{html.escape(text)}</pre>'


def _cells(tag: str, texts: Sequence[str]) -> str:
    return "".join(f'<{tag} style="text-align: left">{html.escape(text)}</{tag}>' for text in texts)


def drawing_module(name: str) -> ModuleType:
    """Import a plotting module of flexlink when something is drawn; its layer may be above the caller's layer."""
    return imported(f"flexlink.{name}", "plotting needs matplotlib;", "report")


def builder(module: str, page: str) -> ModuleType:
    """Import the module that builds a `page`; it needs matplotlib and jinja2."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        why = f"a {page} needs matplotlib and jinja2 ({error}); install them with: {how_to_install('report')}"
        raise MissingDependencyError(why, id="package-missing") from None
