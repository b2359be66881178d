"""Badges of the README as SVG files: version, licence, Python and the stored verification; no server is needed."""

from __future__ import annotations

import tomllib
from pathlib import Path

from docs.generators import study

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "badges"
GREY, BLUE, GREEN = "#555", "#0a66a3", "#2e7d32"
LETTER = 6.6
"""Mean width of a letter [px] at 11 px."""


def badges() -> dict[str, str]:
    """SVG texts by file name, from pyproject.toml and the stored study."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    counts = study.counts()
    verified = f"{counts['passed']:,} of {counts['checks']:,} checks"
    colour = GREEN if counts["passed"] == counts["checks"] else GREY
    return {
        "version.svg": badge("version", project["version"], BLUE),
        "licence.svg": badge("licence", project["license"], BLUE),
        "python.svg": badge("python", project["requires-python"].replace(">=", "≥ "), BLUE),
        "verification.svg": badge("verification", verified, colour),
    }


def badge(label: str, value: str, colour: str) -> str:
    """An SVG with a label on grey and a value on a colour."""
    left, right = (round(LETTER * len(text) + 12) for text in (label, value))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{left + right}" height="20" role="img" '
        f'aria-label="{label}: {value}"><title>{label}: {value}</title>'
        f'<rect width="{left + right}" height="20" rx="3" fill="{GREY}"/>'
        f'<path d="M{left} 0h{right - 3}a3 3 0 0 1 3 3v14a3 3 0 0 1-3 3H{left}z" fill="{colour}"/>'
        '<g fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" text-anchor="middle">'
        f'<text x="{left / 2:g}" y="14">{label}</text><text x="{left + right / 2:g}" y="14">{value}</text></g></svg>\n'
    )


def write() -> None:
    """Write the files."""
    FOLDER.mkdir(exist_ok=True)
    for name, text in badges().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
