"""The page: chapters from sections.toml, filled by what the study holds."""

from __future__ import annotations

import collections
import dataclasses
import importlib
import pkgutil
import tomllib
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from pathlib import Path
from types import ModuleType
from typing import Any

import jinja2
import matplotlib as mpl

from flexlink.errors import FlexlinkError
from flexlink.output import write_text
from reports import curves, figures, findings
from reports.finding import Finding
from reports.numbers import amount, number
from reports.picture import Picture
from reports.results import Results, used
from reports.style import RC
from reports.tables import Table, bar, rows_csv, table, table_csv
from reports.verdict import bottom_line, describe, headlines, informing_against_a_bar, judge
from validation.store import Row

HERE = Path(__file__).parent
ANY = "*"  # the chapter that takes the kinds which no other names


@dataclasses.dataclass(frozen=True)
class CaseBlock:
    """A case in its chapter."""

    case: str
    title: str
    table: Table
    csv: str


@dataclasses.dataclass(frozen=True)
class Shown:
    """A figure on the page."""

    name: str
    svg: str
    caption: str


@dataclasses.dataclass(frozen=True)
class Chapter:
    """A chapter of the page."""

    id: str
    title: str
    text: str
    figures: tuple[Shown, ...]
    findings: tuple[Finding, ...]
    cases: tuple[CaseBlock, ...]


def build(results: Path, out: Path) -> Path:
    """Write the report of a study: one page that stands alone, a CSV a table, a PNG and an SVG a figure.

    A pure function of what is stored: no engine is needed and nothing is simulated.

    Parameters
    ----------
    results
        Folder of the stored results (rows.jsonl, series/, environment.json).
    out
        Folder for the report; made if missing.

    Returns
    -------
    Path
        index.html in `out`. It is written last and whole.

    Raises
    ------
    FlexlinkError
        There are no readable results, or `out` cannot be written.
    """
    study = Results.read(results)
    make_folder(out)
    chapters = list(_chapters(study, out))
    write_text(out / "all_checks.csv", rows_csv(study.rows))
    write_text(out / "verdict.csv", _verdict_csv(study))
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(HERE),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters.update(number=number, amount=amount, describe=describe, bar=bar)
    page = environment.get_template("template.html").render(
        style=(HERE / "style.css").read_text(encoding="utf-8"),
        bottom_line=bottom_line(study),
        failed=[row for row in study.rows if row.passed is False],
        verdicts=judge(study),
        chapters=chapters,
        environment=_flat(study.environment),
        limitations=_data("limitations.toml")["limitation"],
        against=_against(study),
        informing=informing_against_a_bar(study),
        headlines=headlines(study, _data("sections.toml")["headline"]),
    )
    write_text(out / "index.html", page)
    return out / "index.html"


def make_folder(path: Path) -> None:
    """Make `path` and its parents; an impossible one is an error of the project."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FlexlinkError(f"{path}: cannot be made a folder: {error.strerror or error}") from None


def readme_figure(results: Path, path: Path) -> Path:
    """Write the README's figure, the paper's figure 5, as PNG.

    Raises
    ------
    FlexlinkError
        There are no readable results, they do not hold the run, or `path` cannot be written.
    """
    drawer = importlib.import_module("reports.figures.paper_fig5")
    with mpl.rc_context(RC):
        picture = drawer.readme(Results.read(results))
    if picture is None:
        raise FlexlinkError(f"{results}: holds no run of the paper's figure 5; make results with: python -m validation")
    picture.save_png(path)
    return path


def pictures(results: Results, chapter_of: Mapping[str, str]) -> Iterator[tuple[str, Picture]]:
    """(chapter id, picture): what reports/figures/ draws, by file name, then every series that nothing there takes."""
    taken: list[str] = []
    with mpl.rc_context(RC):
        for drawer in _modules(figures):
            taken += drawer.TAKES
            for picture in drawer.draw(results):
                yield drawer.SECTION, picture
        for case, found in results.series.items():
            for name in found:
                if any(fnmatch(name, pattern) for pattern in taken):
                    continue
                yield chapter_of[results.cases[case][0].kind], curves.picture(case, found[name])


def _findings(results: Results, out: Path) -> Iterator[tuple[str, Finding]]:
    for finder in _modules(findings):
        for finding in finder.find(results):
            write_text(out / f"{finding.name}.csv", table_csv(finding.heads, finding.lines))
            yield finder.SECTION, finding


def _modules(package: ModuleType) -> Iterator[Any]:
    """Every module of a package, by name."""
    for name in sorted(info.name for info in pkgutil.iter_modules(package.__path__)):
        yield importlib.import_module(f"{package.__name__}.{name}")


def _chapters(results: Results, out: Path) -> Iterator[Chapter]:
    sections = _data("sections.toml")["section"]
    rest = next(section["id"] for section in sections if ANY in section["kinds"])
    chapter_of = collections.defaultdict(lambda: rest, {kind: s["id"] for s in sections for kind in s["kinds"]})
    shown: dict[str, list[Shown]] = {}
    for chapter, picture in pictures(results, chapter_of):
        shown.setdefault(chapter, []).append(Shown(picture.name, picture.save(out), picture.caption))
    inferred = list(_findings(results, out))
    for section in sections:
        blocks = tuple(
            _case_block(case, rows, out)
            for case, rows in results.cases.items()
            if chapter_of[rows[0].kind] == section["id"]
        )
        found = tuple(finding for chapter, finding in inferred if chapter == section["id"])
        drawn = tuple(shown.get(section["id"], ()))
        if drawn or blocks:
            yield Chapter(section["id"], section["title"], section["text"].strip(), drawn, found, blocks)


def _case_block(case: str, rows: tuple[Row, ...], out: Path) -> CaseBlock:
    csv = f"{case}.csv"
    write_text(out / csv, rows_csv(rows))
    return CaseBlock(case, rows[0].title, table(rows), csv)


def _verdict_csv(results: Results) -> str:
    heads = ("case", "title", "state", "passed", "judged", "informing", "worst_used", "worst", "seconds")
    return table_csv(
        heads,
        (
            (v.case, v.title, v.state, v.passed, v.judged, v.informing, v.worst and used(v.worst),
             v.worst and describe(v.worst), v.seconds)
            for v in judge(results)
        ),
    )  # fmt: skip


def _against(results: Results) -> list[Row]:
    """Rows that speak against a bar, or were never obtained."""
    return [row for row in results.rows if row.passed is False or row.value is None]


def _flat(tree: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as (dotted name, text)."""
    flat: list[tuple[str, str]] = []
    for name, value in tree.items():
        if isinstance(value, dict):
            flat += _flat(value, f"{prefix}{name}.")
        else:
            flat.append((prefix + name, ", ".join(map(str, value)) if isinstance(value, list) else str(value) or "–"))
    return flat


def _data(name: str) -> dict[str, Any]:
    return tomllib.loads((HERE / name).read_text(encoding="utf-8"))
