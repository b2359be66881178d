"""Source files and data that results may depend on, and those that have changed since the measurement."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCE_FOLDERS = ("flexlink", "flexlink_witnesses", "validation", "models")
DATA = {".csv", ".json", ".toml", ".urdf"}
ELSEWHERE = {ROOT / "validation" / name for name in ("results", "cases", "tests")}
"""The store; the cases, each of which depends on its entry only; the tests."""
DISPLAY_ROOMS = {"pages", "pictures", "scene_report"}
"""Folders of the library that only display results; if they change, nothing is measured again. The command line is
not among them, since cases run and time it."""
DISPLAY_FILES_IN_NOTES = {"numbers.py"}
"""Files in these folders that the study does use, for its notes."""
WITHOUT_EFFECT = {"flexlink/common/versions.py"}
"""Files that every result would depend on, but that change no number: this one contains the version of a release."""


def sources() -> Iterator[Path]:
    """Modules and data files that some result may depend on, sorted in each folder."""
    for folder in (ROOT / name for name in SOURCE_FOLDERS):
        for path in sorted(folder.rglob("*")):
            if path.suffix in {".py", *DATA} and ELSEWHERE.isdisjoint(path.parents) and _counts(path):
                yield path


def _counts(path: Path) -> bool:
    name = path.relative_to(ROOT)
    shown = not DISPLAY_ROOMS.isdisjoint(name.parts) and path.name not in DISPLAY_FILES_IN_NOTES
    return not shown and name.as_posix() not in WITHOUT_EFFECT


def digests() -> dict[str, str]:
    """Path from the root → digest of every source.

    The digest is git's hash of the contents, so the sources of a study can be compared with any commit.
    """
    return {path.relative_to(ROOT).as_posix(): digest(path.read_bytes()) for path in sorted(sources())}


def differing(now: Mapping[str, str], then: Mapping[str, str]) -> list[str]:
    """Files whose digests differ, or that are in one of the two only."""
    return sorted(path for path in {*now, *then} if now.get(path) != then.get(path))


def digest(content: bytes) -> str:
    """Git's hash of a file with this content, shortened."""
    return hashlib.sha1(b"blob %d\0" % len(content) + content, usedforsecurity=False).hexdigest()[:16]
