"""reports/full, the checked-in full study: how it was made, and the report that shows it without git or a new run."""

import base64
import csv
import gzip
import html
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
from PIL import Image

from flexlink.common.errors import FlexlinkError
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports import full, stale, stored_full
from reports.build import build
from reports.chapters import Section
from tests.support.words import line, refused, reviewed, sentence
from validation import __main__ as command
from validation import dependencies
from validation.store import Store
from validation.tests.studies import BUSY, QUIET, REASON, VERSIONS, row, stored, timed


@pytest.fixture(autouse=True)
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the figures, which take nearly all of the time."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the cases that the study has now."""
    names = ["paper_long", "paper_short", "speed_trade-crane", "speed_trade-t3"]
    for module in (stored_full, stale):
        monkeypatch.setattr(module, "load_cases", lambda *_: [SimpleNamespace(name=name) for name in names])
    return names


PRICE = {"kind": "speed_trade", "quantity": "MuJoCo / flexlink, error 0.0001", "tolerance": None}
CLAIM = {"kind": "paper_types", "value": 0.0}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder of a full study: a price case in parts, a claim case, and a claim case with a finding."""
    claim = row("paper_long", quantity="claim", title="Claims", varied={"claim": "It bends"}, note="holds", **CLAIM)
    prices = [row(f"speed_trade-{name}", value=7.0, **PRICE) for name in ("crane", "t3")]
    results = stored(tmp_path / "whole", claim, row("paper_short", **CLAIM), *prices)
    return full.save(results, tmp_path / "whole_page", tmp_path / "full").parent


def page(tmp_path: Path, folder: Path | None, *rows) -> str:
    results = stored(tmp_path / "results", *rows)
    return build(results, tmp_path / "report", tmp_path / "no reference", folder).read_text(encoding="utf-8")


def chapter(text: str, name: str) -> str:
    return text.partition(f'<section id="{name}">')[2].partition("</section>")[0]


def notes(text: str) -> list[str]:
    """Small print of a part of the page."""
    return [
        " ".join(html.unescape(re.sub(r"<[^>]+>", "", found)).split())
        for found in re.findall(r'<(?:p|span) class="files">(.*?)</(?:p|span)>', text, re.DOTALL)
    ]


def test_a_chapter_without_local_cases_is_taken_from_the_full_study(tmp_path: Path, folder: Path) -> None:
    text = page(tmp_path, folder, row("paper_short", **CLAIM))
    trade = chapter(text, "trade")
    (note,) = notes(trade)
    assert "2 cases" in note
    assert "0123456789ab" in note
    reviewed("stored full: chapter", note)
    price = re.search(r"<li>(7\b.*?)</li>", trade, re.DOTALL)[1]
    assert "MuJoCo" in price and "CPU" in price
    reviewed("stored full: price", price)
    assert 'id="agreement"' not in text, "neither study has this chapter"


def test_tables_of_the_full_study_are_on_the_page_and_next_to_it(tmp_path: Path, folder: Path) -> None:
    claims = chapter(page(tmp_path, folder, row()), "claims")
    assert "It bends" in claims
    reviewed("paper claims: verdicts", sentence(claims, "1 claim"))
    copies = [(path / "paper_claims.csv").read_bytes() for path in (tmp_path / "report", folder)]
    assert copies[0] == copies[1]


def test_a_chapter_lists_local_cases_and_those_only_in_the_full_study(tmp_path: Path, folder: Path) -> None:
    text = page(tmp_path, folder, row("paper_short", **CLAIM), row("speed_trade-crane", **PRICE))
    claims, trade = (notes(chapter(text, name))[0] for name in ("claims", "trade"))
    assert "1 case " in claims and claims.endswith("paper_long.")
    assert trade.endswith("speed_trade.")
    reviewed("stored full: cases", claims)
    reviewed("stored full: cases", trade)
    whole = page(tmp_path / "again", folder, row("paper_short", **CLAIM), row("paper_long", **CLAIM))
    claims = notes(chapter(whole, "claims"))[0]
    assert "2 cases " in claims and "paper_" not in claims
    reviewed("stored full: cases", claims)


@pytest.mark.parametrize("held", [True, False])
def test_the_page_names_the_command_of_the_full_study(tmp_path: Path, folder: Path, held: bool) -> None:
    text = page(tmp_path, folder if held else None, row())
    head = text.partition('<section class="glance"')[0]
    assert stored_full.COMMAND in head
    found = [note for note in notes(head) if "PASS" in note]
    assert len(found) == held
    for note in found:
        reviewed("stored full: study", note)


def test_the_page_counts_the_cases_that_the_full_study_lacks(tmp_path: Path, folder: Path, known: list[str]) -> None:
    known.append("paper_new")
    (note,) = (
        note for note in notes(page(tmp_path, folder, row()).partition('<section class="glance"')[0]) if "PASS" in note
    )
    assert note.endswith(" 1 of 5.")
    reviewed("stored full: study", note)


def test_the_study_stores_the_hash_of_each_case_and_the_cases_without_results(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row(), planned=("never",))
    folder = full.save(results, tmp_path / "latest", tmp_path / "full").parent
    whole = stored_full.read(folder)
    assert whole is not None
    assert whole.study.keys == {"terms": "k"}
    assert whole.study.missing == ("never",)
    lacking = (folder / "README.md").read_text(encoding="utf-8").partition("## Missing cases")[2]
    assert lacking.startswith("\n\n") and lacking.partition(":")[2].startswith(" 1 of 2.")


def test_the_appendix_has_two_pages_and_a_link(folder: Path) -> None:
    assert b"/Count 2" in (folder / "appendix.pdf").read_bytes()
    assert "](appendix.pdf)" in (folder / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("edited", [(), ("flexlink/a.py",), ("flexlink/a.py", "flexlink/b.py")])
def test_the_release_check_names_each_case_that_is_not_of_the_present_code(
    tmp_path: Path, folder: Path, known: list[str], monkeypatch: pytest.MonkeyPatch, capsys, edited: tuple[str, ...]
) -> None:
    files, first = {"flexlink/a.py": "1", "flexlink/b.py": "2"}, "paper_long: flexlink/a.py"
    (folder / "sources.csv").write_text("file,digest\nflexlink/a.py,1\nflexlink/b.py,2\n", encoding="utf-8")
    now = files | dict.fromkeys(edited, "new")
    monkeypatch.setattr(dependencies, "key", lambda own: "k" if own == files else "other")
    monkeypatch.setattr(
        dependencies,
        "of_cases",
        lambda cases: {case.name: now if case.name == "paper_long" else files for case in cases},
    )
    assert command.main(["--stale", str(folder)]) == bool(edited)
    shown = capsys.readouterr().out
    assert (first in shown) is bool(edited)
    assert "paper_short" not in shown and "0123456789ab" in shown
    known[1:] = ["paper_new"]  # other cases were dropped
    assert command.main(["--stale", str(folder)]) == 1
    shown += capsys.readouterr().out
    assert "paper_new: " in shown and "speed_trade-t3: " in shown
    for text in shown.splitlines():
        reviewed("validation: stale", text)


def test_a_folder_without_a_study_is_refused(tmp_path: Path, capsys) -> None:
    assert command.main(["--stale", str(tmp_path / "none")]) == 2
    reviewed("validation: nothing stored", capsys.readouterr().err)


def test_a_study_names_changed_files_without_git(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(subprocess, "run", None)
    measured = dependencies.everything()
    files = {"flexlink/kernels/bodies/rne.py", "validation/runner.py", "validation/cases/pointwise.toml"}
    assert files <= measured.keys()
    unchanged = stored_full.since("abc", measured)
    edited = measured | {"flexlink/kernels/bodies/rne.py": "another"}
    gone = measured | {"flexlink/gone.py": "any"}
    added = {file: digest for file, digest in measured.items() if file != "validation/runner.py"}
    changed = {stored_full.since("abc", files) for files in (edited, gone, added)}
    unknown = stored_full.since("abc", {})
    assert len(changed) == 1 and len({unchanged, unknown, *changed}) == 3
    for key, text in {"unchanged": unchanged, "changed": changed.pop(), "unknown": unknown}.items():
        reviewed(f"study since: {key}", text)


def test_the_measured_sources_are_stored_and_the_readme_names_changes(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row())
    environment = Store(results).environment()
    now = dependencies.everything() | {"flexlink/kernels/bodies/rne.py": "older"}
    Store(results).note_environment(type(environment)(commit="0123456789ab", sources=now))
    folder = full.save(results, tmp_path / "latest", tmp_path / "full").parent
    assert stored_full.read_sources(folder) == now
    text = (folder / "README.md").read_text(encoding="utf-8")
    first = text.partition("\n## ")[0]
    title, _, paper, comparison, *_ = first.splitlines()
    assert title.startswith("# ") and "flexlink" in title and "flexlink" in comparison
    assert paper.partition("*")[2].startswith("Dynamic")
    reviewed("stored full: paper", paper)
    reviewed("stored full: comparison", comparison)
    verification = line(first, "**PASS**")
    assert "1 of 1" in verification
    reviewed("stored full: verification", verification)
    assert stored_full.since("0123456789ab", now) in text


def test_the_readme_lists_withdrawn_limits_with_their_reasons(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row(), row("b", tolerance=None, given_up="It cannot be met."))
    text = (full.save(results, tmp_path / "latest", tmp_path / "full")).read_text(encoding="utf-8")
    verification = line(text, "**PASS**")
    assert " 1 limit " in verification
    reviewed("stored full: verification", verification)
    reason = "It cannot be met."
    assert f"\n\n- b, M: {reason}" in text


def test_an_unfolded_figure_is_embedded_and_its_image_and_data_are_copied(tmp_path: Path) -> None:
    image, data = b"\x89PNG, an image", b"t [s],x [m]\n0.0,1.0\n"
    (tmp_path / "drawn.png").write_bytes(image)
    (tmp_path / "drawn.csv.gz").write_bytes(gzip.compress(data))
    figures = tuple(stored_full.StoredFigure(name, name, "") for name in ("drawn", "folded"))
    study = stored_full.FullStudy("", "", "", (stored_full.StoredChapter("trade", figures=figures),))
    section = Section("trade", "Trade", "", "", open=("dr*",))
    (out := tmp_path / "page").mkdir()
    (shown,) = stored_full.Stored(tmp_path, study).figures(section, out)
    files = {name: (out / name).read_bytes() for name in shown.files}
    assert files == {"drawn.png": image, "drawn.csv": data}
    assert base64.b64encode(image).decode() in shown.svg


def test_a_truncated_file_of_the_full_study_is_refused_in_one_line(tmp_path: Path, folder: Path) -> None:
    (folder / "chapters.json").write_text("{", encoding="utf-8")
    with refused(FlexlinkError, "file-content"):
        page(tmp_path, folder, row())


@pytest.mark.skipif(not full.FOLDER.is_dir(), reason="this checkout lacks the full study")
def test_the_checked_in_study_can_be_shown_and_names_its_sources() -> None:
    whole = stored_full.read()
    assert whole is not None
    assert whole.study.commit in (full.FOLDER / "README.md").read_text(encoding="utf-8")
    assert len(stored_full.read_sources()) > 300
    for one in whole.study.chapters:
        assert len(list(whole.findings(one.id))) == len(one.findings)
        assert all((full.FOLDER / f"{figure.name}.png").is_file() for figure in one.figures)
    assert whole.study.chapter("trade").findings, "the price list"


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
    tables = {
        f"{name}.csv" for name in ("all_checks", "quantities", "verdict", "speed", "scenes", "machine", "sources")
    }
    assert {file.name for file in folder.iterdir()} == {
        *("NOTES.md", "README.md", "appendix.pdf", "chapters.json"), *tables,
    }  # fmt: skip
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
    for part in ("| terms | M |", "- never_ran: "):
        reviewed("full study: readme", line(text, part))
    assert set(re.findall(r"\]\((.*?)\)", text)) == {"appendix.pdf", *(file.name for file in folder.glob("*.csv"))}


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


def test_the_readme_gives_the_reason_of_missed_limits_once_with_the_worst(tmp_path: Path):
    missed = [timed(value, scene=f"{value} µs") for value in (2.0, 3.0)]
    text = (save(stored(tmp_path / "results", *missed, conditions=QUIET)) / "README.md").read_text(encoding="utf-8")
    section = text.partition("## Missed time limits")[2].partition("\n## ")[0]
    _, found = (each for each in section.splitlines() if each.startswith("| "))
    reviewed("full study: readme", found)


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
    assert {file.suffix for file in files} <= {".csv", ".gz", ".json", ".pdf", ".png", ".md"}
    facts = machine(full.FOLDER)
    assert facts["command"] == full.COMMAND
    assert facts["processor"]
    assert facts["numpy"]
