"""`python -m validation --same DIR`: whether a reviewer's numbers are the published ones."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import pytest
from studies import row, stored, words_from

from flexlink.common.errors import FlexlinkError
from reports import full, same
from reports.build import build
from reports.results import Results
from tests.words import refused
from validation import __main__ as command
from validation import sources
from validation.store import Row

CHECK = {"value": 0.29, "tolerance": 1.0}
INFORMING = {"quantity": "order", "value": 3.907, "tolerance": None}
LEFT_OVER = {"quantity": "worst error", "value": 2.3e-15, "tolerance": None}


def published(path: Path, *rows: Row, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study as it is checked in, without its figures."""
    monkeypatch.setattr("reports.drawing.pictures", lambda *_: iter(()))
    return full.save(stored(path / "there", *rows), path / "there_page", path / "full").parent


def compared(path: Path, folder: Path, *rows: Row) -> same.Comparison:
    return same.compare(Results.read(stored(path / "here", *rows)), folder)


def kinds(found: same.Comparison) -> list[str]:
    return [pair.kind for pair in found.pairs]


@pytest.mark.parametrize(("there", "here", "kind"), [
    (CHECK, {}, "equal"),
    (CHECK, {"value": 0.35}, "rounding"),  # of a check a tenth of its limit
    (CHECK, {"value": 0.45}, "different"),
    (CHECK, {"value": 1.02}, "different"),  # it fails, too
    ({"value": 6e-14, "tolerance": 1e-12}, {"value": 9e-14}, "rounding"),
    ({"value": 16.3, "tolerance": 3.0, "bound": "at least"}, {"value": 16.5}, "rounding"),
    ({"value": 16.3, "tolerance": 3.0, "bound": "at least"}, {"value": 12.0}, "different"),
    (INFORMING, {"value": 3.9070001}, "rounding"),
    (INFORMING, {"value": 3.95}, "different"),
    (LEFT_OVER, {"value": 9e-16}, "rounding"),
    (LEFT_OVER, {"value": 1e-7}, "different"),
    (INFORMING | {"metric": "residual over what rounding explains", "value": 0.005}, {"value": 0.008}, "rounding"),
    (CHECK, {"value": None}, "different"),
    (CHECK | {"timed": True}, {"value": 9.0}, "timed"),
    ({"kind": "extremes", "quantity": "too expensive", "value": 9.0, "tolerance": None}, {"value": 1.0}, "timed"),
])  # fmt: skip
def test_a_number_is_equal_within_rounding_or_different(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: dict[str, object], here: dict[str, object], kind: str
) -> None:
    before = row(**there)
    folder = published(tmp_path, before, monkeypatch=monkeypatch)
    now = row(**(there | here))
    found = compared(tmp_path, folder, now)
    assert kinds(found) == [kind]
    assert found.same is (kind != "different")


def test_numbers_are_matched_by_what_was_varied_and_written_digits_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = [row(varied={"method": "RK4", "step": h, "n": 10}, value=h / 3, quantity="q") for h in (1e-4, 0.1 + 0.2)]
    folder = published(tmp_path, *rows, monkeypatch=monkeypatch)
    assert kinds(compared(tmp_path, folder, *reversed(rows))) == ["equal", "equal"]


def test_a_number_that_only_one_of_both_has_is_a_difference_and_a_case_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two, other = row(), row(quantity="T_GC"), row("other")
    folder = published(tmp_path, one, two, other, monkeypatch=monkeypatch)
    fewer = compared(tmp_path / "fewer", folder, one)
    assert (fewer.same, fewer.missing) == (False, ("terms: T_GC, paper_fig5, mujoco",))
    assert (fewer.cases, fewer.published) == (1, 2)
    assert compared(tmp_path / "both", folder, one, two).same
    assert not compared(tmp_path / "more", folder, one, two, row(quantity="new")).same


def edited_since(folder: Path, file: str) -> None:
    """The published study was measured with another file."""
    now = sources.digests() | {file: "older"}
    text = "file,digest\n" + "".join(f"{path},{digest}\n" for path, digest in now.items())
    (folder / "sources.csv").write_text(text, encoding="utf-8")


EDITED = [("flexlink/__init__.py", True), ("validation/cases/terms.toml", True), ("validation/cases/other.toml", False)]


@pytest.mark.parametrize(("file", "told"), EDITED)
@pytest.mark.parametrize(("there", "here", "kind"), [
    (INFORMING, {"value": 3.95}, "moved"), (CHECK, {"value": 0.45}, "rounding"), (CHECK, {"value": 1.4}, "different"),
])  # fmt: skip
def test_where_sources_were_edited_since_checks_agree_within_their_limits_and_other_numbers_may_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: dict[str, object], here: dict[str, object], kind: str,
    file: str, told: bool,
) -> None:  # fmt: skip
    folder = published(tmp_path, row(**there), monkeypatch=monkeypatch)
    edited_since(folder, file)
    assert kinds(compared(tmp_path, folder, row(**(there | here)))) == [kind if told else "different"]


@pytest.mark.parametrize(("file", "told"), EDITED)
def test_where_sources_were_edited_since_new_numbers_are_told_and_a_check_that_is_gone_still_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, told: bool
) -> None:
    one, check, note = row(), row(quantity="T_GC"), row(quantity="horizon", tolerance=None)
    folder = published(tmp_path, one, check, note, monkeypatch=monkeypatch)
    edited_since(folder, file)
    more = compared(tmp_path / "more", folder, one, check, note, row(quantity="new"))
    assert (more.same, len(more.moved)) == ((True, 1) if told else (False, 0))
    assert compared(tmp_path / "less", folder, one, check).same is told
    assert not compared(tmp_path / "least", folder, one, note).same


@pytest.mark.parametrize(("there", "here", "wider"), [
    (CHECK, {"tolerance": 1000.0}, True), (CHECK, {"tolerance": 1.0005}, False), (CHECK, {"tolerance": 0.5}, False),
    (CHECK, {"tolerance": None}, True), (CHECK, {"tolerance": None, "given_up": "why"}, False),
    (CHECK, {"tolerance": 1000.0, "widened": "why"}, False),
    (CHECK | {"bound": "at least", "value": 2.0}, {"tolerance": 1e-3}, True),
    (CHECK | {"bound": "at least", "value": 2.0}, {"tolerance": 1.5}, False),
    (INFORMING, {"tolerance": 5.0}, False),
])  # fmt: skip
def test_a_limit_that_is_wider_than_the_published_one_is_a_difference_unless_the_case_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: dict[str, object], here: dict[str, object], wider: bool
) -> None:
    folder = published(tmp_path, row(**there), monkeypatch=monkeypatch)
    found = compared(tmp_path, folder, row(**(there | here)))
    assert (bool(found.wider), found.same) == (wider, not wider)
    assert wider == any("limit wider than the published one: terms: M" in line for line in same.differences(found))


def test_cases_that_are_not_published_are_named_in_one_line_and_do_not_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = published(tmp_path, row(), monkeypatch=monkeypatch)
    found = compared(tmp_path, folder, row(), row("first"), row("second"))
    assert found.same
    assert "Not published yet: 2 cases (first, second)." in found.sentences()


def test_the_command_says_same_with_0_and_a_planted_difference_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [
        row(case, quantity=f"q{k}", value=0.01 * k, tolerance=1.0) for case in ("first", "second") for k in range(9)
    ]
    folder = published(tmp_path, *rows, monkeypatch=monkeypatch)
    monkeypatch.setattr(command, "REPORT", tmp_path / "report")
    arguments = ["--same", str(folder), "--results"]
    assert command.main([*arguments, str(stored(tmp_path / "same", *rows))]) == 0
    assert "These are the published numbers." in capsys.readouterr().out
    planted = [*rows[:-1], dataclasses.replace(rows[-1], value=0.5)]
    assert command.main([*arguments, str(stored(tmp_path / "planted", *planted))]) == 1
    said = capsys.readouterr().out
    assert "These are not the published numbers." in said
    assert "second: q8 (paper_fig5, mujoco) = 0.5 1, published 0.08" in said
    with (tmp_path / "report" / "same.csv").open(encoding="utf-8", newline="") as file:
        assert [(line["case"], line["verdict"]) for line in csv.DictReader(file)] == [
            ("second", "DIFFERENT"), ("first", "same"),
        ]  # fmt: skip


def test_the_page_says_whether_its_numbers_are_the_published_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = published(tmp_path, row(), monkeypatch=monkeypatch)
    for name, value, said in (("a", 1e-15, "These are the published"), ("b", 0.9e-12, "These are not the published")):
        page = build(stored(tmp_path / name, row(value=value)), tmp_path / f"{name}_page", tmp_path / "none", folder)
        assert said in page.read_text(encoding="utf-8")
        assert (tmp_path / f"{name}_page" / "same.csv").is_file()
    alone = words_from(stored(tmp_path / "c", row()), tmp_path)
    assert "published numbers" not in alone


@pytest.mark.parametrize(("name", "content", "said"), [
    (None, b"", "test-same"), ("all_checks.csv", b"case,scene\n", "test-same"),
    ("all_checks.csv.gz", b"no gzip", "test-same"),
    ("all_checks.csv", b"case,scene,engine,quantity,value,tolerance,bound,timed,seconds,state\na,,,q,many,,,,,\n",
     "test-same"),
])  # fmt: skip
def test_a_folder_without_numbers_is_one_line(tmp_path: Path, name: str | None, content: bytes, said: str) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    if name:
        (folder / name).write_bytes(content)
    with refused(FlexlinkError, said):
        compared(tmp_path, folder, row())


def test_a_study_that_shares_no_number_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = published(tmp_path, row("other"), monkeypatch=monkeypatch)
    assert command.main(["--same", str(folder), "--results", str(stored(tmp_path / "here", row()))]) == 2
    assert "no number in common" in capsys.readouterr().err
