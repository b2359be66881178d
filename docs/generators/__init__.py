"""Reference pages that are written anew at every build, so that none of them can be out of date."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from docs.generators import api, command_line, docstrings, keys, messages, notation, plausibility, schemes, study

PAGES: dict[str, Callable[[Path], str]] = {
    "api.rst": api.page,
    "scene.rst": keys.scene_page,
    "sweep.rst": keys.sweep_page,
    "fit.rst": keys.fit_page,
    "data_files.rst": keys.data_files_page,
    "command_line.rst": command_line.page,
    "methods.rst": schemes.methods_page,
    "rules.rst": schemes.rules_page,
    "shapers.rst": schemes.shapers_page,
    "plausibility.rst": plausibility.page,
    "messages.rst": messages.page,
    "notation.md": notation.page,
    "study.rst": study.page,
}
"""Text of each page, from the folder for its pictures."""


def write(folder: Path) -> None:
    """Write every page that has changed, with its pictures beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        text, path = page(folder), folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def setup(app: Any) -> dict[str, bool]:
    """Sphinx calls this, before it looks for pages."""
    write(Path(app.srcdir) / "reference" / "generated")
    app.connect("autodoc-process-docstring", docstrings.escape, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
