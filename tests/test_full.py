"""reports/full, the whole long study that is checked in: small, all of one run, and it says how it was made."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest
from studies import BUSY, VERSIONS, row, stored, timed

from flexlink.common.errors import FlexlinkError
from reports import __main__, full


@pytest.fixture(autouse=True)
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take nearly all of the time."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))


def machine(folder: Path) -> dict[str, str]:
    with (folder / "machine.csv").open(encoding="utf-8", newline="") as file:
        return {line["what"]: line["value"] for line in csv.DictReader(file)}


def test_it_says_command_machine_versions_and_what_the_machine_did_besides_or_why_a_case_is_missing(tmp_path: Path):
    results = stored(tmp_path / "results", row(), timed(0.5), conditions=BUSY, planned=("never_ran",))
    assert full.save(results, tmp_path / "full") == tmp_path / "full" / "index.html"
    said = machine(tmp_path / "full")
    assert said["command"] == "python -m validation --full"
    assert (said["processor"], said["commit"], said["mujoco"]) == ("A processor", "0123456789ab", VERSIONS["mujoco"])
    assert said["terms"].startswith("2026-07-01 10:30 UTC; 0.5 s; A processor")
    assert "other processes kept 1.8 of 2 cores busy" in said["calls"]
    assert said["never_ran"] == "not measured"


def test_what_an_earlier_study_left_there_is_gone_and_what_people_wrote_is_not(tmp_path: Path):
    folder = tmp_path / "full"
    folder.mkdir()
    for name in ("gone.csv", "gone.png", "NOTES.md"):
        (folder / name).write_text("", encoding="utf-8")
    full.save(stored(tmp_path / "results", row()), folder)
    assert {"NOTES.md", "index.html", "all_checks.csv", "terms.csv"} <= {file.name for file in folder.iterdir()}
    assert not list(folder.glob("gone.*"))


def test_an_older_study_stays_where_there_are_no_results(tmp_path: Path):
    page = full.save(stored(tmp_path / "results", row()), tmp_path / "full")
    with pytest.raises(FlexlinkError, match="no stored results"):
        full.save(tmp_path / "none", tmp_path / "full")
    assert page.is_file()


def test_more_than_may_be_checked_in_is_an_error_that_names_the_largest(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(full, "MOST", 10_000)
    with pytest.raises(
        FlexlinkError, match=r"more than the 0\.01 MB that are checked in; the largest: index\.html 0\."
    ):
        full.save(stored(tmp_path / "results", row()), tmp_path / "full")


def test_the_command_makes_it_from_stored_results(tmp_path: Path, monkeypatch, capsys):
    results = stored(tmp_path / "results", row())
    monkeypatch.setattr(full, "save", lambda path: path / "page")
    assert __main__.main(["--full", "--results", str(results)]) == 0
    assert capsys.readouterr().out.strip() == str(results / "page")


def checked_in() -> Iterator[Path]:
    return full.FOLDER.glob("*")


@pytest.mark.skipif(not full.FOLDER.is_dir(), reason="this checkout holds no full study")
def test_the_one_that_is_checked_in_is_small_and_says_how_it_was_made():
    assert sum(file.stat().st_size for file in checked_in()) <= full.MOST
    assert {file.suffix for file in checked_in()} <= {".html", ".csv", ".png", ".md"}
    said = machine(full.FOLDER)
    assert said["command"] == full.COMMAND
    assert said["processor"]
    assert said["numpy"]
