"""Source files that the results depend on, and those that have changed since the measurement."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCE_FOLDERS = ("flexlink", "validation")
DISPLAY_ROOMS = {"pages", "pictures", "scene_report"}
"""Folders of the library that only display results; if they change, nothing is measured again. The command line is
not among them, since cases run and time it."""
DISPLAY_FILES_IN_NOTES = {"numbers.py"}
"""Files in these folders that the study does use, for its notes."""


def sources() -> Iterator[Path]:
    """Files of the library and of the study that every result may depend on."""
    for folder in (ROOT / name for name in SOURCE_FOLDERS):
        for path in sorted([*folder.rglob("*.py"), *folder.rglob("data/*/*.toml"), *_study_data(folder)]):
            if DISPLAY_ROOMS.isdisjoint(path.relative_to(ROOT).parts) or path.name in DISPLAY_FILES_IN_NOTES:
                yield path


def _study_data(folder: Path) -> Iterator[Path]:
    """Reference values, recordings, and files that define several scenes by their differences."""
    yield from folder.glob("reference/**/*.json")
    yield from folder.glob("measured/data/*.csv")
    yield from folder.glob("scenes/*/*.toml")


def digests() -> dict[str, str]:
    """Path from the root → digest of every source, and of every case and scene that results depend on.

    The digest is git's hash of the contents, so the sources of a study can be compared with any commit.
    """
    own = [ROOT / "validation" / folder for folder in ("cases", "scenes")]
    files = {*sources(), *(path for folder in own for path in folder.glob("*.toml"))}
    return {path.relative_to(ROOT).as_posix(): _digest(path.read_bytes()) for path in sorted(files)}


def changed(measured: Mapping[str, str]) -> list[str]:
    """Files that have changed, are gone, or are new since these digests were taken."""
    now = digests()
    return sorted(path for path in {*now, *measured} if now.get(path) != measured.get(path))


def _digest(content: bytes) -> str:
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()[:16]
