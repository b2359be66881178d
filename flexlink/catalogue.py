"""Data files that a user can add to: Runge-Kutta tableaus and lumping rules, found by name or by path."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from flexlink.errors import SceneError

DATA = Path(__file__).parent / "data"
LARGEST_FILE = 1_000_000  # bytes; a description is text that a person can read


def read_toml(path: Path) -> dict[str, Any]:
    """Parse a TOML file, with one-line errors.

    Raises
    ------
    SceneError
        The file is missing, unreadable, larger than 1 MB, empty, not UTF-8 or not TOML.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            raise SceneError(f"{path}: {size} bytes; a description has at most {LARGEST_FILE}")
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: not UTF-8 at byte {error.start}; a description is UTF-8 text") from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not text.strip():
        raise SceneError(f"{path}: empty; a description is a TOML file")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not TOML: {error}") from None


def names(folder: str) -> list[str]:
    """Names that come with flexlink in `folder` ("tableaus" or "lumping")."""
    return sorted(path.stem for path in (DATA / folder).glob("*.toml"))


def find(folder: str, name: str) -> Path:
    """Path of a named data file, or of the user's own if `name` ends in ".toml".

    Raises
    ------
    SceneError
        No such name; the message lists those that exist.
    """
    if name.endswith(".toml"):
        return Path(name)
    if name not in names(folder):
        raise SceneError(f"{name!r}: unknown; allowed are {', '.join(names(folder))} or a path ending in .toml")
    return DATA / folder / f"{name}.toml"
