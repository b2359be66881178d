"""Check that the project can be released: python build_tools/release.py

Prints what differs or is missing, one line each, and exits with 1. "TODO by people" marks what only people can fill in.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent
PATTERNS = {
    "flexlink/common/versions.py": r'__version__ = "(.+)"',
    "CITATION.cff": r"^version: (.+)",
    "conda/recipe.yaml": r'^  version: "(.+)"',
    "docs/badges/version.svg": r"aria-label=.version: ([\d.]+)",
}
"""Other files that contain the version, and how."""


def text_of(name: str) -> str:
    """Text of a file of the project."""
    return (ROOT / name).read_text(encoding="utf-8")


def versions() -> dict[str, str]:
    """The version in every file that states it."""
    found = {"pyproject.toml": tomllib.loads(text_of("pyproject.toml"))["project"]["version"]}
    found |= {name: json.loads(text_of(name))["version"] for name in ("codemeta.json", ".zenodo.json")}
    for name, pattern in PATTERNS.items():
        match = re.search(pattern, text_of(name), re.MULTILINE)
        found[name] = match[1] if match else "missing"
    return found


def missing() -> Iterator[str]:
    """What a release needs and the project lacks."""
    stated = versions()
    version = stated["pyproject.toml"]
    yield from (f"{name}: version {other}, but pyproject.toml has {version}" for name, other in stated.items()
                if other != version)  # fmt: skip
    if not re.search(rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", text_of("CHANGELOG.md"), re.MULTILINE):
        yield f"CHANGELOG.md: no section '## {version} (date)'"
    if "urls" not in tomllib.loads(text_of("pyproject.toml"))["project"]:
        yield "pyproject.toml: no [project.urls]; TODO by people: Source, Issues, Documentation"
    yield from (
        f"CITATION.cff:{line.partition('#')[2]}" for line in text_of("CITATION.cff").splitlines() if "TODO" in line
    )


if __name__ == "__main__":
    lines = list(missing())
    print("\n".join(lines) or "ready for release")
    sys.exit(bool(lines))
