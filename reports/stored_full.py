"""The checked-in full study, written by `reports/full.py`, for the default report and the site.

chapters.json    `FullStudy`: verdicts, commit, and the sentences, figures and cases of every chapter
sources.csv      digests of the source files that the study used
NAME.csv[.gz]    table of a finding; NAME.png and NAME.csv[.gz]: a figure
"""

from __future__ import annotations

import base64
import csv
import gzip
import io
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from functools import partial
from html import escape
from pathlib import Path
from typing import NamedTuple

import msgspec

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import write_whole
from flexlink.describe.spec import Spec
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Shown
from reports.chapters import Section
from validation import dependencies
from validation.case import ALL, load_cases
from validation.sources import differing

FOLDER = Path(__file__).parent / "full"
COMMAND = "python -m validation --full"
CHAPTERS, SOURCES = "chapters.json", "sources.csv"


class StoredFinding(Spec, frozen=True):
    """A finding, whose table is a CSV file."""

    name: str
    title: str
    sentences: tuple[str, ...]


class StoredFigure(Spec, frozen=True):
    """Title and caption of a PNG."""

    name: str
    title: str
    caption: str


class StoredCase(Spec, frozen=True):
    """Name, title, state and verdict of a case in the full study, and the hash of what it depended on."""

    case: str
    title: str
    state: str
    text: str
    key: str = ""


class StoredChapter(Spec, frozen=True):
    """A chapter of the full report."""

    id: str
    headlines: tuple[str, ...] = ()
    findings: tuple[StoredFinding, ...] = ()
    figures: tuple[StoredFigure, ...] = ()
    cases: tuple[StoredCase, ...] = ()

    @property
    def has_findings(self) -> bool:
        """Whether the chapter has headlines or findings."""
        return bool(self.headlines or self.findings)


class StoredVerdict(Spec, frozen=True):
    """A verdict of the first screen."""

    about: str
    word: str
    text: str


class FullStudy(Spec, frozen=True):
    """Date, machine and commit of the full study, its verification verdict, its chapters, and cases without results."""

    measured: str
    commit: str
    state: str
    chapters: tuple[StoredChapter, ...] = ()
    verdicts: tuple[StoredVerdict, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def keys(self) -> dict[str, str]:
        """Case → hash of what it depended on; "" if it was stored without."""
        return {case.case: case.key for chapter in self.chapters for case in chapter.cases}

    def chapter(self, name: str) -> StoredChapter:
        """The chapter with this id; an empty one if the study has none."""
        return next((chapter for chapter in self.chapters if chapter.id == name), StoredChapter(name))


class Stored(NamedTuple):
    """The full study with its folder."""

    folder: Path
    study: FullStudy

    def findings(self, chapter: str) -> Iterator[Table]:
        """Findings of a chapter with their tables."""
        for finding in self.study.chapter(chapter).findings:
            heads, *lines = csv.reader(io.StringIO(self._data(finding.name).decode(), newline=""))
            table = tuple(tuple(_cell(text) for text in line) for line in lines)
            yield Table(finding.name, finding.title, tuple(heads), table, finding.sentences, to_look_up=True)

    def figures(self, section: Section, out: Path) -> Iterator[Shown]:
        """Figures of a chapter that are shown unfolded; their PNG and CSV are copied to `out`."""
        for figure in self.study.chapter(section.id).figures:
            if any(fnmatch(figure.name, pattern) for pattern in section.open):
                png, data = (self.folder / f"{figure.name}.png").read_bytes(), self._data(figure.name)
                files = tuple(f"{figure.name}.{ending}" for ending in ("csv", "png"))
                for name, content in zip(files, (data, png), strict=True):
                    write_whole(out / name, partial(Path.write_bytes, data=content))
                source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
                image = f'<img src="{source}" alt="{escape(figure.title)}" loading="lazy">'
                yield Shown(figure.name, figure.name.replace(" ", "_"), figure.title, image, figure.caption, files)

    @property
    def cases(self) -> int:
        """Number of cases of the full study."""
        return len(self.study.keys)

    def since(self) -> str:
        """Sentences on whether the code has changed since the study was measured, and on cases that are not in it."""
        known = [case.name for case in load_cases(*ALL)]
        missing = [name for name in known if name not in self.study.keys]
        lacking = f" Cases that it lacks: {len(missing)} of {len(known)}." if missing else ""
        return since(self.study.commit, read_sources(self.folder)) + lacking

    def _data(self, name: str) -> bytes:
        plain = self.folder / f"{name}.csv"
        return plain.read_bytes() if plain.exists() else gzip.decompress(Path(f"{plain}.gz").read_bytes())


def _cell(text: str) -> str | float | None:
    """Convert a cell to a number, text, or None if it is empty."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


def read(folder: Path = FOLDER) -> Stored | None:
    """The checked-in full study; None if there is none.

    Raises
    ------
    FlexlinkError
        Its files cannot be read.
    """
    file = folder / CHAPTERS
    if not file.is_file():
        return None
    try:
        return Stored(folder, msgspec.json.decode(file.read_bytes(), type=FullStudy))
    except (OSError, ValueError, msgspec.MsgspecError) as error:
        raise FlexlinkError(
            f"{file}: not a full study ({error}); make one with: {COMMAND}", id="file-content"
        ) from None


def read_sources(folder: Path = FOLDER) -> dict[str, str]:
    """Path → digest of the source files that the study in this folder used."""
    file = folder / SOURCES
    if not file.is_file():
        return {}
    with file.open(encoding="utf-8", newline="") as text:
        return {line["file"]: line["digest"] for line in csv.DictReader(text)}


def since(commit: str, measured: Mapping[str, str]) -> str:
    """Commit of the study, and whether flexlink/ or validation/ have changed since, in one sentence."""
    at = f"The study was measured at commit {commit}" if commit else "The study was measured outside a repository"
    if not measured:
        return f"{at}; later changes of the code are unknown."
    if not differing(dependencies.everything(), measured):
        return f"{at}; the code that affects the results has not changed since."
    return f"{at}; code that may affect the results has changed since. To measure again, run {COMMAND}."
