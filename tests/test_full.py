"""reports/full, the whole long study that is checked in: small, all of one run, and it says how it was made."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest
from PIL import Image
from studies import BUSY, REASON, VERSIONS, row, stored, timed

from flexlink.common.errors import FlexlinkError
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports import full
from tests.words import refused


@pytest.fixture(autouse=True)
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take nearly all of the time."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))


def save(results: Path) -> Path:
    """The folder that is checked in, of these results."""
    return full.save(results, results.parent / "latest", results.parent / "full").parent


def lines(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def machine(folder: Path) -> dict[str, str]:
    return {line["what"]: line["value"] for line in lines(folder / "machine.csv")}


def test_it_says_command_machine_versions_and_what_the_machine_did_besides_or_why_a_case_is_missing(tmp_path: Path):
    results = stored(tmp_path / "results", row(), timed(0.5), conditions=BUSY, planned=("never_ran",))
    said = machine(save(results))
    assert said["command"] == "python -m validation --full"
    assert (said["processor"], said["commit"], said["mujoco"]) == ("A processor", "0123456789ab", VERSIONS["mujoco"])
    assert said["terms"].startswith("2026-07-01 10:30 UTC; 0.5 s; A processor")
    assert "other processes used 1.8 of 2 cores" in said["calls"]
    assert said["never_ran"] == "not measured"


def test_what_an_earlier_study_left_there_is_gone_and_what_people_wrote_is_not(tmp_path: Path):
    (tmp_path / "full").mkdir()
    for name in ("gone.csv", "gone.png", "NOTES.md"):
        (tmp_path / "full" / name).write_text("", encoding="utf-8")
    folder = save(stored(tmp_path / "results", row()))
    tables = {f"{name}.csv" for name in ("all_checks", "quantities", "verdict", "speed", "machine", "sources")}
    assert {file.name for file in folder.iterdir()} == {"NOTES.md", "README.md", "chapters.json", *tables}
    assert (tmp_path / "latest" / "index.html").is_file()


def test_words_that_many_rows_share_stand_once_and_every_number_is_there(tmp_path: Path):
    folder = save(stored(tmp_path / "results", row(value=1e-15), row(value=2e-15, scene="other")))
    checks, quantities = lines(folder / "all_checks.csv"), lines(folder / "quantities.csv")
    assert [(line["scene"], float(line["value"])) for line in checks] == [("paper_fig5", 1e-15), ("other", 2e-15)]
    assert "reason" not in checks[0]
    assert [(line["case"], line["quantities"], line["reason"]) for line in quantities] == [("terms", "M", REASON)]


def test_the_readme_has_both_verdicts_what_fails_what_is_missing_and_leads_to_every_file(tmp_path: Path):
    folder = save(stored(tmp_path / "results", row(value=1.0, title="a | b"), timed(0.5), planned=("never_ran",)))
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert "Verification: **FAIL**" in text
    assert "- terms: M, paper_fig5, mujoco" in text
    assert "- never_ran: not measured" in text
    assert r"| terms | a \| b | FAIL: 0 of 1 pass |" in text
    assert set(re.findall(r"\]\((.*?)\)", text)) == {file.name for file in folder.glob("*.csv")}


@pytest.mark.slow
def test_figures_are_pngs_beside_their_data_and_stand_in_the_readme(tmp_path: Path, monkeypatch):
    figure, _ = stacked_axes(1, 1.0)
    picture = Picture("drawn", "A title", figure, "A caption.", "a,b\n")
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter([("agreement", picture)]))
    folder = save(stored(tmp_path / "results", row()))
    assert "![A title](drawn.png)" in (folder / "README.md").read_text(encoding="utf-8")
    assert {file.name for file in folder.glob("drawn.*")} == {"drawn.png", "drawn.csv"}
    with Image.open(folder / "drawn.png") as drawn:
        assert drawn.mode == "P", "few colours, as a palette"


def test_an_older_study_stays_where_there_are_no_results(tmp_path: Path):
    folder = save(stored(tmp_path / "results", row()))
    with refused(FlexlinkError, "test-full"):
        save(tmp_path / "none")
    assert (folder / "README.md").is_file()


def test_more_than_may_be_checked_in_is_an_error_that_names_the_largest(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(full, "MOST", 1_000)
    with refused(FlexlinkError, "test-full"):
        save(stored(tmp_path / "results", row()))


@pytest.mark.skipif(not full.FOLDER.is_dir(), reason="this checkout holds no full study")
def test_the_one_that_is_checked_in_is_small_and_says_how_it_was_made():
    files = list(full.FOLDER.iterdir())
    assert sum(file.stat().st_size for file in files) <= full.MOST
    assert {file.suffix for file in files} <= {".csv", ".gz", ".json", ".png", ".md"}
    said = machine(full.FOLDER)
    assert said["command"] == full.COMMAND
    assert said["processor"]
    assert said["numpy"]
