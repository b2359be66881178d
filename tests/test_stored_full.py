"""What the default report shows and says of the full study that is checked in, without git and without its results."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from studies import row, stored

from flexlink.common.errors import FlexlinkError
from reports import full, stored_full
from reports.build import build
from tests.words import refused, reviewed
from validation import sources
from validation.store import Store


@pytest.fixture(autouse=True)
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take nearly all of the time."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))


PRICE = {"kind": "speed_trade", "quantity": "MuJoCo / flexlink, error 0.0001", "tolerance": None}
CLAIM = {"kind": "paper_types", "value": 0.0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A full study with a case of prices in parts, one of claims, and one on which the chapter has a finding."""
    claim = row("paper_long", quantity="claim", title="Claims", varied={"claim": "It bends"}, note="holds", **CLAIM)
    prices = [row(f"speed_trade-{name}", value=7.0, **PRICE) for name in ("crane", "t3")]
    results = stored(tmp_path / "whole", claim, row("paper_short", **CLAIM), *prices)
    return full.save(results, tmp_path / "whole_page", tmp_path / "full").parent


def page(tmp_path: Path, folder: Path | None, *rows) -> str:
    results = stored(tmp_path / "results", *rows)
    return build(results, tmp_path / "report", tmp_path / "no reference", folder).read_text(encoding="utf-8")


def chapter(text: str, name: str) -> str:
    return text.partition(f'<section id="{name}">')[2].partition("</section>")[0]


def test_a_chapter_of_which_nothing_ran_is_the_full_studys_and_says_so(tmp_path: Path, folder: Path) -> None:
    text = page(tmp_path, folder, row("paper_short", **CLAIM))
    said = chapter(text, "trade")
    assert "No case of this chapter ran for this page. Shown: the full study, 2 cases" in said
    assert "7 × flexlink&#39;s CPU time or more: MuJoCo" in said
    assert 'id="agreement"' not in text, "neither study has it"


def test_tables_of_the_full_study_are_on_the_page_and_beside_it(tmp_path: Path, folder: Path) -> None:
    said = chapter(page(tmp_path, folder, row()), "claims")
    assert "1 claim: 1 confirmed" in said
    assert "It bends" in said
    assert (tmp_path / "report" / "paper_claims.csv").read_bytes() == (folder / "paper_claims.csv").read_bytes()


def test_a_chapter_says_what_ran_and_what_only_the_full_study_has(tmp_path: Path, folder: Path) -> None:
    text = page(tmp_path, folder, row("paper_short", **CLAIM), row("speed_trade-crane", **PRICE))
    assert "Ran for this page: 1 case. Only in the full study (reports/full): paper_long." in chapter(text, "claims")
    assert "Only in the full study (reports/full): speed_trade." in chapter(text, "trade")
    whole = page(tmp_path / "again", folder, row("paper_short", **CLAIM), row("paper_long", **CLAIM))
    assert "Ran for this page: 2 cases. The full study has no others." in chapter(whole, "claims")


@pytest.mark.parametrize("held", [True, False])
def test_the_page_names_the_command_of_the_full_study(tmp_path: Path, folder: Path, held: bool) -> None:
    text = page(tmp_path, folder if held else None, row())
    head = text.partition('<section class="glance"')[0]
    assert "python -m validation --full" in head
    assert ("is stored in reports/full: verification PASS" in head) == held


def test_a_study_says_which_files_have_changed_since_without_git(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(subprocess, "run", None)
    measured = sources.digests()
    assert {
        "flexlink/kernels/bodies/rne.py",
        "validation/runner.py",
        "validation/cases/pointwise.toml",
    } <= measured.keys()
    unchanged = stored_full.since("abc", measured)
    edited = measured | {"flexlink/kernels/bodies/rne.py": "another"}
    gone = measured | {"flexlink/gone.py": "any"}
    added = {file: digest for file, digest in measured.items() if file != "validation/runner.py"}
    changed = {stored_full.since("abc", files) for files in (edited, gone, added)}
    unknown = stored_full.since("abc", {})
    assert len(changed) == 1 and len({unchanged, unknown, *changed}) == 3
    for key, text in {"unchanged": unchanged, "changed": changed.pop(), "unknown": unknown}.items():
        reviewed(f"study since: {key}", text)


def test_what_was_measured_with_is_stored_and_the_readme_says_what_changed(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row())
    environment = Store(results).environment()
    now = sources.digests() | {"flexlink/kernels/bodies/rne.py": "older"}
    Store(results).note_environment(type(environment)(commit="0123456789ab", sources=now))
    folder = full.save(results, tmp_path / "latest", tmp_path / "full").parent
    assert stored_full.read_sources(folder) == now
    text = (folder / "README.md").read_text(encoding="utf-8")
    first = text.partition("\n## ")[0]
    words = (
        "# Validation of flexlink",
        "Dynamic Simulation of Nonrigid",
        "Compared: flexlink with",
        "**PASS**. 1 of 1",
    )
    assert all(word in first for word in words)
    assert stored_full.since("0123456789ab", now) in text


def test_limits_given_up_stand_in_the_readme_with_their_reasons(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row(), row("b", tolerance=None, given_up="It cannot be met."))
    text = (full.save(results, tmp_path / "latest", tmp_path / "full")).read_text(encoding="utf-8")
    assert "1 limit withdrawn: see “Known limitations”" in text
    assert re.search(r"## Limits withdrawn\n\n- b, M: It cannot be met\.", text)


def test_a_torn_file_of_the_full_study_is_one_line(tmp_path: Path, folder: Path) -> None:
    (folder / "chapters.json").write_text("{", encoding="utf-8")
    with refused(FlexlinkError, "test-stored-full"):
        page(tmp_path, folder, row())


@pytest.mark.skipif(not full.FOLDER.is_dir(), reason="this checkout holds no full study")
def test_the_one_that_is_checked_in_can_be_shown_and_says_what_it_was_measured_with() -> None:
    whole = stored_full.read()
    assert whole is not None
    assert whole.study.commit in (full.FOLDER / "README.md").read_text(encoding="utf-8")
    assert len(stored_full.read_sources()) > 300
    for one in whole.study.chapters:
        assert len(list(whole.findings(one.id))) == len(one.findings)
        assert all((full.FOLDER / f"{figure.name}.png").is_file() for figure in one.figures)
    assert whole.study.chapter("trade").findings, "the price list"
