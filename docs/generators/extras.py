"""Installed size of each extra, measured in an environment that has all of them; `python -m docs --extras` writes it."""

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
    text = (
        f"Measured {datetime.date.today().isoformat()} on {platform.system()} {platform.machine()} with Python "
        f"{platform.python_version()}: flexlink's required packages take {_megabytes(base)} MB. Each extra adds, in MB: "
        f"{sizes}. Packages that two extras share are counted in both."
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


def _closure(requirements: Iterable[str], extras: frozenset[str] = frozenset()) -> set[str]:
    """Names of installed packages that satisfy requirements, with those that these need in turn."""
    found: set[str] = set()
    waiting = [(text, extras) for text in requirements]
    done = set()
    while waiting:
        text, parents = waiting.pop()
        requirement = Requirement(text)
        if (text, parents) in done or not _applies(requirement, parents):
            continue
        done.add((text, parents))
        wanted = frozenset(requirement.extras)
        if requirement.name == "flexlink":
            waiting += [(each, wanted) for extra in wanted for each in _declared()[1][extra]]
            continue
        found.add(canonicalize_name(requirement.name))
        waiting += [(each, wanted) for each in importlib.metadata.distribution(requirement.name).requires or ()]
    return found


def _applies(requirement: Requirement, extras: frozenset[str]) -> bool:
    """Whether a requirement counts on this system, with these extras of the package that states it."""
    return requirement.marker is None or any(requirement.marker.evaluate({"extra": extra}) for extra in extras or {""})


def _megabytes(packages: Iterable[str]) -> str:
    files = (file for name in packages for file in importlib.metadata.distribution(name).files or ())
    size = 1e-6 * sum(path.stat().st_size for file in files if (path := Path(str(file.locate()))).is_file())
    return f"{size:.0f}" if size >= 0.5 else "less than 1"
