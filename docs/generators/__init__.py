"""Reference pages, generated at every build and thus never out of date."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from docs.generators import (
    api,
    command_line,
    docstrings,
    extremes,
    keys,
    messages,
    notation,
    plausibility,
    schemes,
    study,
)

PAGES: dict[str, Callable[[Path], str]] = {
    "api.rst": api.page,
    "scene.rst": keys.scene_page,
    **{f"{name}.rst": partial(keys.scene_part, name) for name in keys.PARTS},
    "sweep.rst": keys.sweep_page,
    "fit.rst": keys.fit_page,
    "data_files.rst": keys.data_files_page,
    "command_line.rst": command_line.page,
    "methods.rst": schemes.methods_page,
    "rules.rst": schemes.rules_page,
    "shapers.rst": schemes.shapers_page,
    "plausibility.rst": plausibility.page,
    "messages.rst": messages.page,
    **{f"{messages.page_name(title)}.rst": partial(messages.group_page, title) for title in messages.groups()},
    "notation.md": notation.page,
    "study.rst": study.page,
    "extremes.txt": extremes.page,  # a part of docs/explanation/extremes.md
}
"""Text of each page, from the folder for its figures."""

KEYWORDS = {
    "api.rst": "Python, API, functions, classes",
    "scene.rst": "TOML, keys, parameters, defaults, units, configuration, input, file, PID, impact",
    "sweep.rst": "TOML, parameter, study, Monte, Carlo",
    "fit.rst": "TOML, identification, calibration, FRF",
    "data_files.rst": "TOML, plugin, Butcher, custom",
    "command_line.rst": "CLI, terminal, shell, command, exit, code, help, options",
    "methods.rst": "integrator, solver, ODE, Runge-Kutta, Butcher, stability, region, order",
    "rules.rst": "lumping, hinges, quadrature, weights, nodes",
    "shapers.rst": "input, shaping, ZV, ZVD, EI, residual, vibration, sway",
    "plausibility.rst": "units, GPa, mm, warning, hint",
    "messages.rst": "error, warning, exception, troubleshooting, refused, failed, traceback",
    "notation.md": "symbols, signs, frames, conventions, T_GC, T_FL, T_FR, T_EX",
    "study.rst": "validation, verification, benchmark, evidence, results",
}
"""Synonyms for the site's search."""


def write(folder: Path) -> None:
    """Write every page that has changed, with its figures next to it."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, page in PAGES.items():
        text, path = _with_keywords(name, page(folder)), folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def _with_keywords(name: str, text: str) -> str:
    """Return a page with its keywords in front."""
    if name not in KEYWORDS:
        return text
    if name.endswith(".md"):
        return f'---\nmyst:\n  html_meta:\n    keywords: "{KEYWORDS[name]}"\n---\n{text}'
    return f".. meta::\n   :keywords: {KEYWORDS[name]}\n\n{text}"


def setup(app: Any) -> dict[str, bool]:
    """Write the pages before Sphinx looks for them."""
    write(Path(app.srcdir) / "reference" / "generated")
    app.connect("autodoc-process-docstring", docstrings.escape, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
