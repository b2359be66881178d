"""reports/full, the complete checked-in study, is small, from one run, and records how it was made."""

import csv
import re
from pathlib import Path

import pytest
from PIL import Image

from flexlink.common.errors import FlexlinkError
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports import full
from tests.support.words import line, refused, reviewed
from validation.tests.studies import BUSY, REASON, VERSIONS, row, stored, timed


@pytest.fixture(autouse=True)
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the figures, which take nearly all of the time."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))


def save(results: Path) -> Path:
    """Make the folder to be checked in from these results, and return it."""
    return full.save(results, results.parent / "latest", results.parent / "full").parent


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def machine(folder: Path) -> dict[str, str]:
    return {fact["what"]: fact["value"] for fact in table(folder / "machine.csv")}


def test_machine_csv_has_command_versions_load_and_missing_cases(tmp_path: Path):
    results = stored(tmp_path / "results", row(), timed(0.5), conditions=BUSY, planned=("never_ran",))
    facts = machine(save(results))
    assert facts["command"] == full.COMMAND
    assert (facts["processor"], facts["commit"], facts["mujoco"]) == ("A processor", "0123456789ab", VERSIONS["mujoco"])
    assert facts["terms"].split("; ")[:2] == ["2026-07-01 10:30 UTC", "0.5 s"]
    assert facts["terms"].split("; ")[2].startswith(facts["processor"])
    assert " 1.8 of 2 " in facts["calls"]
    reviewed("full study: machine load", facts["calls"])
    assert facts["never_ran"] == "not measured"


def test_files_of_an_earlier_study_are_deleted_and_other_files_stay(tmp_path: Path):
    (tmp_path / "full").mkdir()
    for name in ("gone.csv", "gone.png", "NOTES.md"):
        (tmp_path / "full" / name).write_text("", encoding="utf-8")
    folder = save(stored(tmp_path / "results", row()))
    tables = {f"{name}.csv" for name in ("all_checks", "quantities", "verdict", "speed", "machine", "sources")}
    assert {file.name for file in folder.iterdir()} == {"NOTES.md", "README.md", "chapters.json", *tables}
    assert (tmp_path / "latest" / "index.html").is_file()


def test_texts_shared_by_rows_are_stored_once_and_all_numbers_are_stored(tmp_path: Path):
    folder = save(stored(tmp_path / "results", row(value=1e-15), row(value=2e-15, scene="other")))
    checks, quantities = table(folder / "all_checks.csv"), table(folder / "quantities.csv")
    assert [(line["scene"], float(line["value"])) for line in checks] == [("paper_fig5", 1e-15), ("other", 2e-15)]
    assert "reason" not in checks[0]
    assert [(line["case"], line["quantities"], line["reason"]) for line in quantities] == [("terms", "M", REASON)]


def test_the_readme_has_verdicts_failures_missing_cases_and_links_to_all_files(tmp_path: Path):
    folder = save(stored(tmp_path / "results", row(value=1.0, title="a | b"), timed(0.5), planned=("never_ran",)))
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert "**FAIL**" in text
    assert "mujoco | 1 |" in line(text, "| terms | M |")
    assert line(text, "- never_ran: ").endswith("not measured")
    assert "0 of 1" in line(text, r"| terms | a \| b |", "FAIL: ")
    for part in ("| terms | M |", "- never_ran: ", r"| terms | a \| b |"):
        reviewed("full study: readme", line(text, part))
    assert set(re.findall(r"\]\((.*?)\)", text)) == {file.name for file in folder.glob("*.csv")}


@pytest.mark.slow
def test_figures_are_png_files_next_to_their_data_and_shown_in_the_readme(tmp_path: Path, monkeypatch):
    figure, _ = stacked_axes(1, 1.0)
    picture = Picture("drawn", "A title", figure, "A caption.", "a,b\n")
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter([("agreement", picture)]))
    folder = save(stored(tmp_path / "results", row()))
    image = f"![{picture.title}](drawn.png)"
    assert image in (folder / "README.md").read_text(encoding="utf-8")
    assert {file.name for file in folder.glob("drawn.*")} == {"drawn.png", "drawn.csv"}
    with Image.open(folder / "drawn.png") as drawn:
        assert drawn.mode == "P", "the image uses a palette"


def test_without_results_an_older_study_is_kept(tmp_path: Path):
    folder = save(stored(tmp_path / "results", row()))
    with refused(FlexlinkError, "test-full"):
        save(tmp_path / "none")
    assert (folder / "README.md").is_file()


def test_a_study_too_large_to_check_in_is_refused_with_its_largest_file(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(full, "MOST", 1_000)
    with refused(FlexlinkError, "test-full"):
        save(stored(tmp_path / "results", row()))


@pytest.mark.skipif(not full.FOLDER.is_dir(), reason="this checkout lacks the full study")
def test_the_checked_in_study_is_small_and_records_how_it_was_made():
    files = list(full.FOLDER.iterdir())
    assert sum(file.stat().st_size for file in files) <= full.MOST
    assert {file.suffix for file in files} <= {".csv", ".gz", ".json", ".png", ".md"}
    facts = machine(full.FOLDER)
    assert facts["command"] == full.COMMAND
    assert facts["processor"]
    assert facts["numpy"]
