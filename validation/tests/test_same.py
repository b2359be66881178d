"""`python -m validation --same DIR` checks whether a reviewer's numbers equal the published numbers."""

import csv
import dataclasses
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from flexlink.common.errors import FlexlinkError
from reports import full, same
from reports.build import build
from reports.results import Results
from reports.same import exceptions
from reports.stored_full import FOLDER, FullStudy
from tests.support.words import line, refused, reviewed
from validation import __main__ as command
from validation.store import Row
from validation.tests.studies import row, stored, words_from

CHECK = {"value": 0.29, "tolerance": 1.0}
INFORMING = {"quantity": "order", "value": 3.907, "tolerance": None}
WITNESS = {"case": "other_solvers", "quantity": "witness, its two runs apart", "value": 1e-6, "tolerance": None}
SHEET = {"case": "data_sheets", "engine": "mujoco", "value": 3e-8, "tolerance": None}
LEFT_OVER = {"quantity": "worst error", "value": 2.3e-15, "tolerance": None}


def published(path: Path, *rows: Row, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checked-in study without its figures."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))
    return full.save(stored(path / "there", *rows), path / "there_page", path / "full").parent


def compared(path: Path, folder: Path, *rows: Row) -> same.Comparison:
    return same.compare(Results.read(stored(path / "here", *rows)), folder)


def kinds(found: same.Comparison) -> list[str]:
    return [pair.kind for pair in found.pairs]


@pytest.mark.parametrize(("there", "here", "kind"), [
    (CHECK, {}, "equal"),
    (CHECK, {"value": 0.35}, "rounding"),  # within a tenth of the limit
    (CHECK, {"value": 0.45}, "different"),
    (CHECK, {"value": 1.02}, "different"),  # this value also exceeds its limit
    ({"value": 6e-14, "tolerance": 1e-12}, {"value": 9e-14}, "rounding"),
    ({"value": 16.3, "tolerance": 3.0, "bound": "at least"}, {"value": 16.5}, "rounding"),
    ({"value": 16.3, "tolerance": 3.0, "bound": "at least"}, {"value": 12.0}, "different"),
    (INFORMING, {"value": 3.9070001}, "rounding"),
    (INFORMING, {"value": 3.95}, "different"),
    (LEFT_OVER, {"value": 9e-16}, "rounding"),
    (LEFT_OVER, {"value": 1e-7}, "different"),
    (INFORMING | {"metric": "residual relative to the rounding bound", "value": 0.005}, {"value": 0.008}, "rounding"),
    (CHECK, {"value": None}, "different"),
    (CHECK | {"timed": True}, {"value": 9.0}, "timed"),
    ({"case": "extremes", "quantity": "dear", "value": 9.0, "tolerance": None}, {"value": 1.0}, "timed"),
    ({"case": "formulations-crane", "engine": "exudyn"} | CHECK, {"value": 0.9}, "timed"),
    ({"case": "formulations-crane", "engine": "exudyn"} | CHECK, {"value": 1.1}, "different"),  # exceeds its limit
    ({"case": "formulations-crane", "engine": "exudyn"} | CHECK, {"value": None}, "different"),
    ({"case": "formulations-crane", "engine": "native"} | CHECK, {"value": 0.9}, "different"),
    (WITNESS, {"value": 9e-6}, "rounding"),
    (WITNESS, {"value": 1.1e-5}, "different"),
    (SHEET, {"value": 3.09e-8}, "rounding"),
    (SHEET, {"value": 3.11e-8}, "different"),
])  # fmt: skip
def test_a_number_is_equal_within_rounding_or_different(tmp_path, monkeypatch, there, here, kind) -> None:
    before = row(**there)
    folder = published(tmp_path, before, monkeypatch=monkeypatch)
    now = row(**(there | here))
    found = compared(tmp_path, folder, now)
    assert kinds(found) == [kind]
    assert found.same is (kind != "different")


def test_numbers_are_matched_by_their_settings_and_read_back_exactly(tmp_path, monkeypatch) -> None:
    rows = [row(varied={"method": "RK4", "step": h, "n": 10}, value=h / 3, quantity="q") for h in (1e-4, 0.1 + 0.2)]
    folder = published(tmp_path, *rows, monkeypatch=monkeypatch)
    assert kinds(compared(tmp_path, folder, *reversed(rows))) == ["equal", "equal"]


def test_a_number_missing_on_one_side_is_a_difference_and_a_missing_case_is_not(tmp_path, monkeypatch) -> None:
    one, two, other = row(), row(quantity="T_GC"), row("other")
    folder = published(tmp_path, one, two, other, monkeypatch=monkeypatch)
    fewer = compared(tmp_path / "fewer", folder, one)
    assert not fewer.same
    assert [missing.split(", ") for missing in fewer.missing] == [["terms: T_GC", "paper_fig5", "mujoco"]]
    assert (fewer.cases, fewer.published) == (1, 2)
    assert compared(tmp_path / "both", folder, one, two).same
    assert not compared(tmp_path / "more", folder, one, two, row(quantity="new")).same


def test_a_number_may_be_missing_if_the_speed_of_the_machine_decides(tmp_path, monkeypatch) -> None:
    always = row("formulations-crane")
    reached = row("formulations-crane", engine="exudyn", quantity="not reached", tolerance=None)
    folder = published(tmp_path, always, reached, monkeypatch=monkeypatch)
    assert compared(tmp_path, folder, always).same


def test_every_allowed_difference_is_about_published_numbers() -> None:
    keys = list(same.published_numbers(FOLDER))
    for one in exceptions():
        assert any(one.matches(case, engine, quantity) for case, _, engine, quantity, _ in keys), one


def edited_since(folder: Path, case: str) -> None:
    """Store a published study in which something that a case depends on was different."""
    file = folder / "chapters.json"
    study = msgspec.json.decode(file.read_bytes(), type=FullStudy)
    chapters = tuple(
        replace(one, cases=tuple(replace(each, key="older") if each.case == case else each for each in one.cases))
        for one in study.chapters
    )
    file.write_bytes(msgspec.json.encode(replace(study, chapters=chapters)))


EDITED = [("terms", True), ("other", False)]


@pytest.mark.parametrize(("case", "concerned"), EDITED)
@pytest.mark.parametrize(("there", "here", "kind"), [
    (INFORMING, {"value": 3.95}, "moved"), (CHECK, {"value": 0.45}, "rounding"), (CHECK, {"value": 1.4}, "different"),
])  # fmt: skip
def test_after_edits_of_sources_checks_agree_within_limits_and_other_numbers_may_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: dict[str, object], here: dict[str, object], kind: str,
    case: str, concerned: bool,
) -> None:  # fmt: skip
    folder = published(tmp_path, row(**there), monkeypatch=monkeypatch)
    edited_since(folder, case)
    assert kinds(compared(tmp_path, folder, row(**(there | here)))) == [kind if concerned else "different"]


@pytest.mark.parametrize(("case", "concerned"), EDITED)
def test_after_edits_of_sources_new_numbers_are_listed_and_a_missing_check_still_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str, concerned: bool
) -> None:
    one, check, note = row(), row(quantity="T_GC"), row(quantity="horizon", tolerance=None)
    folder = published(tmp_path, one, check, note, monkeypatch=monkeypatch)
    edited_since(folder, case)
    more = compared(tmp_path / "more", folder, one, check, note, row(quantity="new"))
    assert (more.same, len(more.moved)) == ((True, 1) if concerned else (False, 0))
    assert compared(tmp_path / "less", folder, one, check).same is concerned
    assert not compared(tmp_path / "least", folder, one, note).same


@pytest.mark.parametrize(("there", "here", "wider"), [
    (CHECK, {"tolerance": 1000.0}, True), (CHECK, {"tolerance": 1.0005}, False), (CHECK, {"tolerance": 0.5}, False),
    (CHECK, {"tolerance": None}, True), (CHECK, {"tolerance": None, "given_up": "why"}, False),
    (CHECK, {"tolerance": 1000.0, "widened": "why"}, False),
    (CHECK | {"bound": "at least", "value": 2.0}, {"tolerance": 1e-3}, True),
    (CHECK | {"bound": "at least", "value": 2.0}, {"tolerance": 1.5}, False),
    (INFORMING, {"tolerance": 5.0}, False),
])  # fmt: skip
def test_a_limit_wider_than_the_published_one_is_a_difference_unless_the_case_gives_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: dict[str, object], here: dict[str, object], wider: bool
) -> None:
    folder = published(tmp_path, row(**there), monkeypatch=monkeypatch)
    found = compared(tmp_path, folder, row(**(there | here)))
    assert (bool(found.wider), found.same) == (wider, not wider)
    limits = [text for text in same.differences(found) if any(text.endswith(limit) for limit in found.wider)]
    assert wider == any(limit.startswith("terms: M") for limit in found.wider) == bool(limits)
    for text in limits:
        reviewed("same: limit", text)


def test_unpublished_cases_are_named_in_one_line_and_do_not_fail(tmp_path, monkeypatch) -> None:
    folder = published(tmp_path, row(), monkeypatch=monkeypatch)
    found = compared(tmp_path, folder, row(), row("first"), row("second"))
    assert found.same
    (unpublished,) = (text for text in found.sentences() if "(first, second)" in text)
    assert "2 cases" in unpublished
    reviewed("same: unpublished", unpublished)


def test_the_command_exits_with_0_for_equal_numbers_and_with_1_for_a_difference(tmp_path, monkeypatch, capsys) -> None:
    rows = [
        row(case, quantity=f"q{k}", value=0.01 * k, tolerance=1.0) for case in ("first", "second") for k in range(9)
    ]
    folder = published(tmp_path, *rows, monkeypatch=monkeypatch)
    monkeypatch.setattr(command, "REPORT", tmp_path / "report")
    arguments = ["--same", str(folder), "--results"]
    assert command.main([*arguments, str(stored(tmp_path / "same", *rows))]) == 0
    reviewed("same: verdict", capsys.readouterr().out.splitlines()[-2])
    planted = [*rows[:-1], dataclasses.replace(rows[-1], value=0.5)]
    assert command.main([*arguments, str(stored(tmp_path / "planted", *planted))]) == 1
    shown = capsys.readouterr().out
    reviewed("same: verdict", shown.splitlines()[-2])
    assert all(part in line(shown, "second: ") for part in ("q8 (", "paper_fig5", "mujoco", "= 0.5 1", " 0.08"))
    reviewed("same: difference", line(shown, "second: "))
    with (tmp_path / "report" / "same.csv").open(encoding="utf-8", newline="") as file:
        verdicts = {case["case"]: case["verdict"] for case in csv.DictReader(file)}
    assert list(verdicts) == ["second", "first"]
    assert (verdicts["second"], verdicts["first"]) == ("DIFFERENT", "same")


def test_the_page_shows_whether_its_numbers_are_the_published_ones(tmp_path, monkeypatch) -> None:
    folder = published(tmp_path, row(), monkeypatch=monkeypatch)
    for name, value in (("a", 1e-15), ("b", 0.9e-12)):
        results = stored(tmp_path / name, row(value=value))
        page = build(results, tmp_path / f"{name}_page", tmp_path / "none", folder).read_text(encoding="utf-8")
        answer = same.compare(Results.read(results), folder).sentences()[0]
        assert answer in page
        reviewed("same: verdict", answer)
        assert (tmp_path / f"{name}_page" / "same.csv").is_file()
    alone = words_from(stored(tmp_path / "c", row()), tmp_path)
    assert "same.csv" not in alone


@pytest.mark.parametrize(("name", "content"), [
    (None, b""), ("all_checks.csv", b"case,scene\n"), ("all_checks.csv.gz", b"no gzip"),
    ("all_checks.csv", b"case,scene,engine,quantity,value,tolerance,bound,timed,seconds,state\na,,,q,many,,,,,\n"),
])  # fmt: skip
def test_a_folder_without_numbers_is_refused_in_one_line(tmp_path: Path, name: str | None, content: bytes) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    if name:
        (folder / name).write_bytes(content)
    with refused(FlexlinkError, "test-same"):
        compared(tmp_path, folder, row())


def test_a_study_without_common_numbers_is_an_error(tmp_path, monkeypatch, capsys) -> None:
    folder = published(tmp_path, row("other"), monkeypatch=monkeypatch)
    assert command.main(["--same", str(folder), "--results", str(stored(tmp_path / "here", row()))]) == 2
    error = capsys.readouterr().err
    assert str(folder) in error
    reviewed("same: nothing in common", error)


def test_a_number_whose_limit_is_zero_may_differ_like_one_without_a_limit() -> None:
    order = row(quantity="order − lower bound", value=0.1818, tolerance=0.0, bound="at least")
    assert same.allowed(order, 0.1818) == same.allowed(dataclasses.replace(order, tolerance=None), 0.1818) > 1e-4
    assert same.allowed(dataclasses.replace(order, tolerance=1e-9), 0.1818) < 1e-6


@pytest.mark.parametrize(("version", "same_numbers"), [("", True), ("1.13.6", False)])
def test_numbers_of_a_program_are_missing_only_if_it_is_installed(tmp_path, monkeypatch, version, same_numbers) -> None:
    theirs = row(engine="Exudyn", quantity="least error", value=1e-5)
    folder = published(tmp_path, row(), theirs, monkeypatch=monkeypatch)
    here = Results.read(stored(tmp_path / "here", row()))
    versions = {**here.environment.versions, "exudyn": version}
    here = dataclasses.replace(here, environment=dataclasses.replace(here.environment, versions=versions))
    found = same.compare(here, folder)
    assert found.same is same_numbers
    assert len(found.absent) == same_numbers
    assert len(found.missing) == (not same_numbers)
    reviewed("same: a program installed or not", "\n".join(found.sentences()))
