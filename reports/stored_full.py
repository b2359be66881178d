"""The full study that is checked in, as `reports/full.py` wrote it: what the default report shows and says of it.

chapters.json    `FullStudy`: verdicts, commit, and of every chapter its sentences, figures and cases
sources.csv      digests of the files that it was measured with
NAME.csv[.gz]    the tables of its findings; NAME.png and NAME.csv[.gz]: its figures
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
from flexlink.pages.chapter import Shown
from flexlink.pages.numbers import plural
from flexlink.pages.tables import Table
from reports.chapters import Section
from validation.sources import changed

FOLDER = Path(__file__).parent / "full"
COMMAND = "python -m validation --full"
CHAPTERS, SOURCES = "chapters.json", "sources.csv"


class StoredFinding(Spec, frozen=True):
    """A finding without its table, which is its CSV."""

    name: str
    title: str
    sentences: tuple[str, ...]


class StoredFigure(Spec, frozen=True):
    """What the page says about a PNG."""

    name: str
    title: str
    caption: str


class StoredCase(Spec, frozen=True):
    """A case in a line."""

    case: str
    title: str
    state: str
    text: str


class StoredChapter(Spec, frozen=True):
    """A chapter of the full report."""

    id: str
    headlines: tuple[str, ...] = ()
    findings: tuple[StoredFinding, ...] = ()
    figures: tuple[StoredFigure, ...] = ()
    cases: tuple[StoredCase, ...] = ()

    @property
    def says(self) -> bool:
        """Whether there is more in it than cases."""
        return bool(self.headlines or self.findings)


class FullStudy(Spec, frozen=True):
    """The whole of it: when and on what it was measured, the verdict on correctness, chapters."""

    measured: str
    commit: str
    state: str
    chapters: tuple[StoredChapter, ...] = ()

    def chapter(self, name: str) -> StoredChapter:
        """The chapter of that id; an empty one where the study has none."""
        return next((chapter for chapter in self.chapters if chapter.id == name), StoredChapter(name))


class Since(NamedTuple):
    """What has changed in the checkout since a study was measured: a sentence, and the files."""

    text: str
    files: tuple[str, ...]


class Stored(NamedTuple):
    """The full study with its folder."""

    folder: Path
    study: FullStudy

    def findings(self, chapter: str) -> Iterator[Table]:
        """Those of a chapter, with the tables that they stand on."""
        for finding in self.study.chapter(chapter).findings:
            heads, *lines = csv.reader(io.StringIO(self._data(finding.name).decode(), newline=""))
            table = tuple(tuple(_cell(text) for text in line) for line in lines)
            yield Table(finding.name, finding.title, tuple(heads), table, finding.sentences, to_look_up=True)

    def figures(self, section: Section, out: Path) -> Iterator[Shown]:
        """Those of a chapter that stand unfolded, as part of the page; PNG and CSV are copied to `out`."""
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
        """How many it holds."""
        return sum(len(chapter.cases) for chapter in self.study.chapters)

    def since(self) -> Since:
        """What has changed in this checkout since it was measured."""
        return since(self.study.commit, read_sources(self.folder))

    def _data(self, name: str) -> bytes:
        plain = self.folder / f"{name}.csv"
        return plain.read_bytes() if plain.exists() else gzip.decompress(Path(f"{plain}.gz").read_bytes())


def _cell(text: str) -> str | float | None:
    """A number as one, nothing as None."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


def read(folder: Path = FOLDER) -> Stored | None:
    """The full study that is checked in; None where there is none.

    Raises
    ------
    FlexlinkError
        Its files cannot be understood.
    """
    file = folder / CHAPTERS
    if not file.is_file():
        return None
    try:
        return Stored(folder, msgspec.json.decode(file.read_bytes(), type=FullStudy))
    except (OSError, ValueError, msgspec.MsgspecError) as error:
        raise FlexlinkError(f"{file}: not a full study ({error}); make one with: {COMMAND}") from None


def read_sources(folder: Path = FOLDER) -> dict[str, str]:
    """Path → digest of the files that the study in this folder was measured with."""
    file = folder / SOURCES
    if not file.is_file():
        return {}
    with file.open(encoding="utf-8", newline="") as text:
        return {line["file"]: line["digest"] for line in csv.DictReader(text)}


def since(commit: str, measured: Mapping[str, str]) -> Since:
    """Which files of flexlink/ and validation/ are not those that were measured at a commit, by their digests."""
    at = f"measured at commit {commit}" if commit else "measured outside a repository"
    if not measured:
        return Since(f"It was {at}; changes since then are unknown.", ())
    files = tuple(changed(measured))
    if not files:
        return Since(f"It was {at}; no file that affects the results has changed since.", ())
    return Since(
        f"It was {at}; {plural(len(files), 'file')} that may affect the results changed since.", files,
    )  # fmt: skip
