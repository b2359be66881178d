"""Stored studies for tests of the report, and pages made of them."""

import dataclasses
import datetime
import re
from pathlib import Path

import pytest

from reports.build import build
from validation.store import Conditions, Environment, Finished, Planned, Row, Store

REASON = "Rounding: n additions of numbers <= 1 & a margin of ten"


def row(case: str = "terms", value: float | None = 1e-15, tolerance: float | None = 1e-12, **fields: object) -> Row:
    """A row that passes if its value is at most its tolerance."""
    passed = None if tolerance is None else value is not None and value <= tolerance
    plain = Row(
        case=case, kind="pointwise", title=f"Title of {case}", scene="paper_fig5", engine="mujoco", varied={},
        quantity="M", metric="max |Δ|", value=value, unit="1", tolerance=tolerance, bound="at most",
        passed=passed, timed=False, reason=REASON, note="", given_up="", seconds=0.5, key="k",
    )  # fmt: skip
    return dataclasses.replace(plain, **fields)  # type: ignore[arg-type]


QUIET, BUSY = Conditions(0.02, 0.05, cores=2), Conditions(1.8, 0.9, cores=2)
DATE = datetime.datetime(2026, 7, 1, 10, 30, tzinfo=datetime.UTC)
VERSIONS = {"flexlink": "0.1.0", "pin": "4.1.0", "mujoco": "4.0.0", "numpy": "2.4"}
ENVIRONMENT = Environment(DATE, "0123456789ab", "3.11.7", VERSIONS, "A processor", 2, "Linux x86_64")


def stored(path: Path, *rows: Row, conditions: Conditions | None = None, planned: tuple[str, ...] = ()) -> Path:
    """A result folder with these rows of finished cases, and `planned` cases that were not measured."""
    store = Store(path)
    store.prepare({r.case for r in rows})
    store.note_environment(ENVIRONMENT)
    plan = {r.case: Planned("k", r.kind, r.title) for r in rows}
    store.note_plan(plan | {case: Planned("k", "pointwise", f"Title of {case}") for case in planned})
    for r in rows:
        store.append(r)
    for case in dict.fromkeys(r.case for r in rows):
        store.finish(case, Finished("k", DATE, "A processor", conditions))
    return path


def timed(value: float, **fields: object) -> Row:
    """A row with a time limit, which is met if the value is at most 1 µs."""
    speed = {"kind": "speed_calls", "quantity": "public call", "unit": "µs", "timed": True}
    return row("calls", value=value, tolerance=1.0, **speed | fields)  # type: ignore[arg-type]


def page_of(tmp_path: Path, *rows: Row) -> str:
    results = stored(tmp_path / "results", *rows)
    return page_from(results, tmp_path)


def page_from(results: Path, tmp_path: Path) -> str:
    return build(results, tmp_path / "report", tmp_path / "no reference", None).read_text(encoding="utf-8")


def words_from(results: Path, tmp_path: Path) -> str:
    """The report page without figures, since drawing them would take nearly all of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("reports.drawing.pictures", lambda *_: iter(()))
        return page_from(results, tmp_path)


def words_of(tmp_path: Path, *rows: Row) -> str:
    return words_from(stored(tmp_path / "results", *rows), tmp_path)


def first_screen(page: str) -> str:
    """The text before the first chapter, without tags."""
    return " ".join(re.sub(r"<[^>]*>", " ", first_screen_html(page)).split())


def first_screen_html(page: str) -> str:
    """The page before its first chapter."""
    return page[page.index("<h1>") : page.index("</main>")].partition('<section id="agreement"')[0]
