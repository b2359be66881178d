"""The report page: first screen, chapters of sections.toml with the results of the study, and the data files."""

from __future__ import annotations

import dataclasses
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatch
from pathlib import Path

import matplotlib as mpl

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import make_folder, write_text
from flexlink.common.wording import plural
from flexlink.pages.numbers import amount
from flexlink.pages.page import template
from flexlink.pages.style import RC
from flexlink.pages.tables import Table, table_csv
from flexlink.pages.verdict import Chapter, Report, Shown
from reports import measurements, reference, same, speed_limits, stored_full, verdict
from reports.chapters import Section, chapter_of_kinds, contents, sections
from reports.drawing import figures_of
from reports.figures import motion
from reports.findings import finding
from reports.results import Results, used
from reports.scene_names import scene_names
from reports.tables import Meaning, checks, limit, meanings, rows_csv
from validation.judgement import JudgedRow
from validation.store import Environment, Row

HERE = Path(__file__).parent
NO_TEXT = ("versions", "sources")  # fields of `Environment` that are mappings, not text
SUMMARY, ARM = "summary", "arm"  # id of the chapter with the first screen's figures; name of its figure beside the text


@dataclasses.dataclass(frozen=True)
class CaseBlock:
    """What a chapter shows of a case: texts, verdict, table of checks, and definitions of the quantities."""

    case: str
    title: str
    about: str
    verdict: verdict.CaseVerdict
    table: Table
    common: str  # settings common to all rows, which have no column
    meanings: tuple[Meaning, ...]


@dataclasses.dataclass(frozen=True)
class StudyChapter(Chapter):
    """A chapter with its cases; `more` are folded figures, `ran` states which cases ran, and which were left out."""

    headlines: tuple[str, ...] = ()
    more: tuple[Shown, ...] = ()
    cases: tuple[CaseBlock, ...] = ()
    ran: str = ""


@dataclasses.dataclass(frozen=True)
class StudyReport(Report):
    """The report page: chapters, and the figures of the first screen (`overview`)."""

    chapters: Sequence[StudyChapter]
    overview: tuple[Shown, ...]


def build(
    results: Path, out: Path, reference_run: Path = reference.FOLDER, beside_full: Path | None = stored_full.FOLDER
) -> Path:
    """Write the report of a study: one self-contained page, a CSV per table, and a PNG, SVG and CSV per figure.

    The report depends only on the stored results: building it needs no engine and runs no simulation.

    Parameters
    ----------
    results
        Folder of the stored results.
    out
        Folder for the report; made if missing.
    reference_run
        Folder of the reference run whose times are listed for comparison.
    beside_full
        Folder of the checked-in full study, which fills chapters without a case in this study; None to leave them out.

    Returns
    -------
    Path
        index.html in `out`. It is written last, in one piece.

    Raises
    ------
    FlexlinkError
        There are no readable results, or `out` cannot be written.
    """
    return write(Results.read(results), out, reference_run, beside_full).page


def write(
    study: Results, out: Path, reference_run: Path = reference.FOLDER, beside_full: Path | None = stored_full.FOLDER
) -> StudyReport:
    """Write the report of results that are already read, and return its contents."""
    beside, whole = reference.read(reference_run), stored_full.read(beside_full) if beside_full else None
    make_folder(out)
    shown, definitions = figures_of(study, out)
    chapters = tuple(_chapters(study, out, shown, whole))
    verdicts = tuple(filter(None, (verdict.verification(study), verdict.validation(study), verdict.fast(study))))
    write_text(out / "all_checks.csv", rows_csv(study.rows))
    write_text(out / "verdict.csv", _verdict_csv(study))
    write_text(out / "speed.csv", speed_limits.csv_text(study, beside))
    page = template(HERE / "template.html", limit=limit).render(
        title="flexlink validation report",
        compared=verdict.compared(study),
        measured=verdict.measured(study),
        verdicts=verdicts,
        speed_verdict=verdicts[-1],
        facts=verdict.numbers_that_matter(study, contents().number),
        paper=contents().paper,
        arm=[one for one in shown.get(SUMMARY, []) if one.name == ARM],
        overview=[one for one in shown.get(SUMMARY, []) if one.name != ARM],
        measurements=_measurements(study, out),
        scenes=scene_names(study),
        failed=(failed := [row for row in study.rows if row.state == "FAIL"]),
        failing=_failing(failed),
        missing=study.missing,
        chapters=chapters,
        speed=speed_limits.speed_table(study, beside),
        conditions=speed_limits.conditions(study),
        beside=beside,
        environment=Table("machine", "Machine and versions", ("what", "value"), environment_rows(study.environment)),
        limitations=_limitations(),
        unobtained=[row for row in study.rows if row.value is None],
        given_up=given_up(study),
        full=whole,
        same=_same(study, out, beside_full),
        full_command=stored_full.COMMAND,
        definitions=definitions,
    )
    write_text(out / "index.html", page)
    return StudyReport(out / "index.html", verdicts, chapters, tuple(shown.get(SUMMARY, ())))


def _same(study: Results, out: Path, beside_full: Path | None) -> Table | None:
    """Comparison of the study's numbers with the published ones; None if there is nothing to compare."""
    if beside_full is None or not (beside_full / stored_full.CHAPTERS).is_file():
        return None
    try:
        found = same.compare(study, beside_full)
    except FlexlinkError:  # the published numbers are unreadable; `python -m validation --same` reports the reason
        return None
    if not found.pairs:
        return None
    table = found.table()
    write_text(out / f"{table.name}.csv", table.csv)
    return table


def _measurements(study: Results, out: Path) -> Table | None:
    """The model compared with measurements, one line per group of quantities; None without measured cases."""
    found = measurements.table(measurements.groups(study))
    if found is not None:
        write_text(out / f"{found.name}.csv", found.csv)
    return found


def _failing(rows: Sequence[Row]) -> Table:
    """Table of the failing checks, for the first screen."""
    lines = tuple(
        (row.case, row.quantity, row.where, amount(row.value, row.unit), limit(row), f"{row.reason} {row.note}".strip())
        for row in rows
    )
    heads = ("case", "quantity", "setting", "value", "limit", "why this limit")
    return Table("failing", "Failing checks", heads, lines, classes=("FAIL",) * len(lines))


def readme_figure(results: Path, path: Path) -> Path:
    """Write the README's figure, the paper's figure 5, as PNG.

    Raises
    ------
    FlexlinkError
        There are no readable results, they do not contain the run, or `path` cannot be written.
    """
    with mpl.rc_context(RC):
        picture = motion.readme(Results.read(results))
    if picture is None:
        raise FlexlinkError(f"{results}: no run of the paper's figure 5; make results with: python -m validation")
    picture.save_png(path)
    return path


def given_up(results: Results) -> list[Row]:
    """One row for every quantity whose limit was withdrawn."""
    return list({(row.case, row.quantity): row for row in results.rows if row.given_up}.values())


def _chapters(
    results: Results, out: Path, shown: Mapping[str, list[Shown]], whole: stored_full.Stored | None
) -> Iterator[StudyChapter]:
    chapter_of, inferred, verdicts = chapter_of_kinds(), list(finding.made(results)), verdict.case_verdicts(results)
    for section in sections():
        blocks = tuple(
            _case_block(case, results.plan[case].about, rows, verdicts[case], out)
            for case, rows in results.cases.items()
            if chapter_of[rows[0].kind] == section.id
        )
        found = tuple(one for chapter, one in inferred if chapter == section.id)
        for each in found:
            write_text(out / f"{each.name}.csv", each.csv)
        drawn = shown.get(section.id, [])
        first = tuple(one for one in drawn if any(fnmatch(one.name, pattern) for pattern in section.open))
        more = tuple(one for one in drawn if one not in first)
        if drawn or blocks:
            yield StudyChapter(
                section.id, section.title, section.short, (section.text.strip(),), first, found,
                headlines=tuple(verdict.headlines(results, section.headline)), more=more,
                cases=tuple(sorted(blocks, key=lambda block: block.verdict.state != "FAIL")),
                ran=_ran(section, len(blocks), results, whole),
            )  # fmt: skip
        elif whole and whole.study.chapter(section.id).has_findings:
            yield _stored_chapter(section, whole, out)


def _ran(section: Section, here: int, results: Results, whole: stored_full.Stored | None) -> str:
    """Sentences: how many cases of the chapter ran for this page, and which cases only the full study has."""
    ran = f"{plural(here, 'case')} of this chapter {'was' if here == 1 else 'were'} run for this page."
    if not (here and whole):
        return ran if here else ""
    known = whole.study.chapter(section.id).cases
    beyond = sorted({one.case.partition("-")[0] for one in known if one.case not in results.plan})  # without parts
    if not beyond:
        return f"{ran} The full study has no further ones."
    return f"{ran} Cases only in the full study (reports/full): {', '.join(beyond)}."


def _stored_chapter(section: Section, whole: stored_full.Stored, out: Path) -> StudyChapter:
    """A chapter for which no case ran here, with the contents stored by the full study."""
    stored = whole.study.chapter(section.id)
    ran = (
        "No case of this chapter was run for this page. It shows the full study with "
        f"{plural(len(stored.cases), 'case')}, measured {whole.study.measured}. More figures are in reports/full."
    )
    found = tuple(whole.findings(section.id))
    for each in found:
        write_text(out / f"{each.name}.csv", each.csv)
    return StudyChapter(
        section.id, section.title, section.short, (section.text.strip(),), tables=found,
        headlines=stored.headlines, more=tuple(whole.figures(section, out)), ran=ran,
    )  # fmt: skip


def _case_block(case: str, about: str, rows: Sequence[JudgedRow], found: verdict.CaseVerdict, out: Path) -> CaseBlock:
    write_text(out / f"{case}.csv", rows_csv(rows))
    return CaseBlock(case, rows[0].title, about.strip(), found, *checks(rows), tuple(meanings(rows)))


def _verdict_csv(results: Results) -> str:
    heads = ("case", "title", "state", "checks", "failed", "informing", "worst_used", "worst", "speed", "seconds")
    lines = [
        (case, rows[0].title, v.state, v.judged, v.failed, v.informing, v.worst and used(v.worst),
         v.worst and f"{v.worst.quantity}, {v.worst.where}", v.speed, sum(row.seconds for row in rows))
        for case, rows, v in ((case, results.cases[case], v) for case, v in verdict.case_verdicts(results).items())
    ]  # fmt: skip
    missing = [(each.case, each.title, each.why, *[None] * 7) for each in results.missing]
    return table_csv(heads, [*lines, *missing])


def environment_rows(environment: Environment) -> tuple[tuple[str, str], ...]:
    """(name, text) of every known property of the environment."""
    versions = environment.versions.items()
    own = ((f.name, getattr(environment, f.name)) for f in dataclasses.fields(environment) if f.name not in NO_TEXT)
    return tuple((name, str(value) or "–") for name, value in (*own, *versions))


def _limitations() -> list[dict[str, str]]:
    found: list[dict[str, str]] = tomllib.loads((HERE / "limitations.toml").read_text(encoding="utf-8"))["limitation"]
    return found
