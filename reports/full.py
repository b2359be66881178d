"""Write the full study as checked in under reports/full: README.md, figures as PNG, and all numbers as CSV.

It is made from the report in reports/latest. The page, the SVGs and the tables of the cases are left out, because they
are too large for a repository.
"""

from __future__ import annotations

import gzip
import math
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
from PIL import Image, ImageColor

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import make_folder, write_text
from flexlink.pages.colours import CYCLE, GREY, INK, PAPER
from flexlink.pages.numbers import amount
from flexlink.pages.page import template
from flexlink.pages.tables import table_csv
from reports import appendix, verdict
from reports.build import StudyReport, environment_rows, given_up, write
from reports.chapters import contents
from reports.results import Results
from reports.scene_names import scene_names
from reports.speed_limits import why_missed
from reports.stored_full import (
    CHAPTERS,
    COMMAND,
    FOLDER,
    SOURCES,
    FullStudy,
    StoredCase,
    StoredChapter,
    StoredFigure,
    StoredFinding,
    StoredVerdict,
    since,
)
from reports.tables import limit, meanings, rows_csv
from reports.verdict import Fact
from validation.judgement import JudgedRow, crowd, quiet

HERE = Path(__file__).parent
MOST = 10_000_000  # bytes: limit for generated files in the repository
LARGE = 100_000  # bytes: larger tables are compressed
COLOURS = 96  # number of most frequent colours in a picture's palette, which reduces its size to a third
WRITTEN = ("README.md", "*.csv", "*.csv.gz", "*.json", "*.png", "*.pdf")
WORDS = ("kind", "title", "metric", "reason", "given_up")  # texts repeated in many rows; quantities.csv lists them once


def save(results: Path, out: Path, folder: Path = FOLDER) -> Path:
    """Write the report of a study to `out`, and replace the checked-in files in `folder`.

    Returns
    -------
    Path
        README.md in `folder`.

    Raises
    ------
    FlexlinkError
        There are no readable results, a folder cannot be written, or `folder` exceeds `MOST` bytes.
    """
    study = Results.read(results)
    report = write(study, out, beside_full=None)
    make_folder(folder)
    for pattern in WRITTEN:  # remove files of former cases
        for file in folder.glob(pattern):
            file.unlink()
    for name in ("verdict.csv", "speed.csv", *_files(report)):
        shutil.copyfile(out / name, folder / name)
    write_text(folder / "all_checks.csv", rows_csv(study.rows, without=WORDS))
    write_text(folder / "quantities.csv", table_csv(("case", *WORDS[2:], "quantities"), _meanings(study)))
    write_text(folder / "machine.csv", table_csv(("what", "value"), _machine(study)))
    if scenes := scene_names(study):
        write_text(folder / "scenes.csv", scenes.csv)
    for file in list(folder.iterdir()):
        _shrink(file)
    write_text(folder / SOURCES, table_csv(("file", "digest"), study.environment.sources.items()))
    write_text(
        folder / CHAPTERS, msgspec.json.format(msgspec.json.encode(_whole(study, report)), indent=1).decode() + "\n"
    )
    facts = verdict.numbers_that_matter(study, contents().number)
    write_text(folder / "README.md", _readme(study, report, facts, folder))
    about = verdict.compared(study), f"Measured: {verdict.measured(study)}."
    appendix.save(report, facts, about, folder)
    _demand_small(folder)
    return folder / "README.md"


def _files(report: StudyReport) -> Iterator[str]:
    """Names of the files of figures and findings."""
    for figure in (
        *report.overview,
        *(one for chapter in report.chapters for one in (*chapter.figures, *chapter.more)),
    ):
        yield from (f"{figure.name}.png", f"{figure.name}.csv")
    for chapter in report.chapters:
        yield from (f"{finding.name}.csv" for finding in chapter.tables)


def _shrink(file: Path) -> None:
    """Reduce the colours of a picture; compress a large table with gzip, which pandas and NumPy read directly."""
    if file.suffix == ".png":
        picture = Image.open(file).convert("RGB")
        picture.quantize(palette=_palette(picture), dither=Image.Dither.NONE).save(file, optimize=True)
    elif file.suffix == ".csv" and file.stat().st_size > LARGE:
        file.with_name(f"{file.name}.gz").write_bytes(gzip.compress(file.read_bytes(), mtime=0))
        file.unlink()


def _palette(picture: Image.Image) -> Image.Image:
    """Palette of the colours of engines and curves, however rare, and the most frequent colours of the picture."""
    counts = picture.getcolors(picture.width * picture.height) or []
    common = [colour for _, colour in sorted(counts, reverse=True)[:COLOURS]]
    named = [ImageColor.getrgb(colour) for colour in (*CYCLE, INK, PAPER, GREY)]
    found = Image.new("P", (1, 1))
    found.putpalette([part for colour in dict.fromkeys([*named, *common]) for part in colour])
    return found


def _meanings(study: Results) -> Iterator[tuple[str, ...]]:
    for case, rows in study.cases.items():
        for each in meanings(rows):
            yield case, each.metric, each.reason, each.given_up, "; ".join(each.quantities)


def _machine(study: Results) -> Iterator[tuple[str, str]]:
    """Text with the command, machine and versions of the study, and the end, duration and machine load of each case."""
    yield "command", COMMAND
    yield from environment_rows(study.environment)
    for case, done in study.finished.items():
        took = f"{sum(row.seconds for row in study.cases.get(case, ())):.1f} s"
        besides = (crowd(done.conditions),) if done.conditions else ()
        stored = study.environment.versions
        other = (f"{name} {version}" for name, version in done.versions.items() if stored.get(name, version) != version)
        yield case, "; ".join((f"{done.date:%Y-%m-%d %H:%M} UTC", took, done.machine, *besides, *other))
    for missing in study.missing:
        yield missing.case, missing.why


def _whole(study: Results, report: StudyReport) -> FullStudy:
    """The part of the full study that default reports show later, stored as chapters.json."""
    chapters = (
        StoredChapter(
            chapter.id,
            chapter.headlines,
            tuple(StoredFinding(one.name, one.title, one.sentences) for one in chapter.tables),
            tuple(StoredFigure(one.name, one.title, one.caption) for one in (*chapter.figures, *chapter.more)),
            tuple(
                StoredCase(one.case, one.title, one.verdict.word, one.verdict.text, study.finished[one.case].key)
                for one in chapter.cases
            ),
        )
        for chapter in report.chapters
    )
    verdicts = tuple(StoredVerdict(one.about, one.word, one.text) for one in report.verdicts)
    return FullStudy(
        verdict.measured(study),
        study.environment.commit,
        report.verdicts[0].word,
        tuple(chapters),
        verdicts,
        tuple(each.case for each in study.missing),
    )


def _readme(study: Results, report: StudyReport, facts: Sequence[Fact], folder: Path) -> str:
    def csv(name: str) -> str:
        whole = f"{name}.csv"
        return whole if (folder / whole).exists() else f"{whole}.gz"

    return template(HERE / "full.md").render(
        command=COMMAND,
        csv=csv,
        measured=verdict.measured(study),
        since=since(study.environment.commit, study.environment.sources),
        quiet=quiet(study.finished),
        paper=contents().paper,
        compared=verdict.compared(study),
        facts=facts,
        appendix=appendix.NAME,
        scenes=(folder / csv("scenes")).exists(),
        given_up=given_up(study),
        failed=[row for row in study.rows if row.state == "FAIL"],
        slow=_by_reason([row for row in study.rows if row.state == "missed"]),
        amount=amount,
        limit=limit,
        why_missed=why_missed,
        missing=study.missing,
        finished=len(study.finished),
        report=report,
    )


class Missed(NamedTuple):
    """Limits that are missed for one reason, and the one that is farthest from its limit."""

    why: str
    rows: list[JudgedRow]
    worst: JudgedRow


def _by_reason(rows: Sequence[JudgedRow]) -> list[Missed]:
    found: dict[str, list[JudgedRow]] = {}
    for row in rows:
        found.setdefault(why_missed(row), []).append(row)
    return [Missed(why, several, max(several, key=_excess)) for why, several in found.items()]


def _excess(row: JudgedRow) -> float:
    """How many times a value is beyond its limit."""
    if not row.value or not row.tolerance:
        return math.inf
    return row.tolerance / row.value if row.bound == "at least" else row.value / row.tolerance


def _demand_small(folder: Path) -> None:
    sizes = {file.name: file.stat().st_size for file in folder.iterdir()}
    if sum(sizes.values()) > MOST:
        largest = ", ".join(f"{name} {sizes[name] / 1e6:.2f} MB" for name in sorted(sizes, key=lambda n: -sizes[n])[:3])
        raise FlexlinkError(
            f"{folder}: {sum(sizes.values()) / 1e6:.2f} MB, more than the {MOST / 1e6:g} MB allowed in the repository; "
            f"largest files: {largest}"
        )
