"""Installed sizes of all extras, measured in an environment that has them; `python -m docs --extras` writes them."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
import textwrap
import tomllib
from collections.abc import Iterable
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "start" / "install.md"
BEGIN, END = "<!-- extras: python -m docs --extras writes this paragraph -->\n", "\n<!-- end of extras -->"


def paragraph() -> str:
    """Size of the required packages, and what each extra adds to it [MB], with date and system."""
    needed, optional = _declared()
    base = _closure(needed)
    added = {extra: _closure(packages) - base for extra, packages in optional.items()}
    sizes = ", ".join(f"`{extra}` {_megabytes(packages)}" for extra, packages in added.items())
    system = f"{platform.system()} {platform.machine()} with Python {platform.python_version()}"
    text = (
        f"Measured {datetime.date.today().isoformat()} on {system}: flexlink's required packages take "
        f"{_megabytes(base)} MB. Each extra adds, in MB: {sizes}. Packages that two extras share are counted in both."
    )
    return textwrap.fill(text, 120)


def with_paragraph(text: str, measured: str) -> str:
    """The page with a new paragraph."""
    before, _, rest = text.partition(BEGIN)
    return before + BEGIN + measured.rstrip() + END + rest.partition(END)[2]


def write() -> None:
    """Measure, and write the page."""
    PAGE.write_text(with_paragraph(PAGE.read_text(encoding="utf-8"), paragraph()), encoding="utf-8")


def _declared() -> tuple[list[str], dict[str, list[str]]]:
    """Required packages, and those of each extra."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project["dependencies"], project["optional-dependencies"]


def _closure(requirements: Iterable[str]) -> set[str]:
    """Names of installed packages that satisfy requirements, with those that these need in turn."""
    waiting, done = [(text, frozenset({""})) for text in requirements], set()
    while waiting:
        one = waiting.pop()
        requirement, of_extras = Requirement(one[0]), one[1]
        marker = requirement.marker
        if one in done or not (marker is None or any(marker.evaluate({"extra": extra}) for extra in of_extras)):
            continue
        done.add(one)
        if requirement.name == "flexlink":
            needed = [text for extra in requirement.extras for text in _declared()[1][extra]]
        else:
            needed = importlib.metadata.distribution(requirement.name).requires or []
        waiting += [(text, frozenset(requirement.extras or {""})) for text in needed]
    names: set[str] = {canonicalize_name(Requirement(text).name) for text, _ in done}
    return names - {"flexlink"}


def _megabytes(packages: Iterable[str]) -> str:
    files = (file for name in packages for file in importlib.metadata.distribution(name).files or ())
    size = 1e-6 * sum(path.stat().st_size for file in files if (path := Path(str(file.locate()))).is_file())
    return f"{size:.0f}" if size >= 0.5 else "less than 1"
