"""The page of extremes: its numbers are those of the stored study, which may lack parts of it."""

import csv
import re
import tomllib
from collections import Counter
from pathlib import Path

import pytest

from docs.generators import extreme_runs, extremes, messages, study
from docs.generators.extreme_runs import NATIVE
from flexlink.pages.colours import engine_name
from flexlink.pages.numbers import JOIN
from validation.kinds import digits

HEADS = ("recipe", "varied", "axes", "engine", "method", "steps", "outcome", "said")
NEWTON = "space: even steps of 1e-9 s fail at t = 0 s: Newton's iteration does not converge (joint 'a')"
ROWS = (
    ("r 0", "load [N] 3.0", "load [N]", "native", "RK4", "h = 0.1 s", "within", ""),
    ("r 1", "load [N] 1e-310", "load [N]", "native", "auto", "tolerance 0.1 of the reach", "error", NEWTON),
    ("r 2", "load [N] 3.0", "load [N]", "native", "RK4", "h = 2 s", "error", "never heard of"),
    ("r 3", "load [N] 3.0", "load [N]", "mujoco", "RK4", "h = 0.1 s", "silent wrong", ""),
    ("r 4", "load [N] 3.0", "load [N]", "mujoco", "RK4", "h = 2 s", "error", "the state is no longer finite at 1 s"),
    ("r 5", "load [N] 3.0, links 2.0", "load [N] and links", "native", "Radau5", "h = 2 s", "dear", ""),
)
OF_EVERY_ROW = {
    "case", "scene", "engine", "quantity", "value", "unit", "tolerance", "bound", "passed", "timed", "note", "seconds",
    "state",
}  # fmt: skip
"""Columns of the stored checks; the others are conditions that vary."""
only_with_a_study = pytest.mark.skipif(not study.FULL.is_dir(), reason="a source distribution has no stored study")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A study with six runs and nothing else."""
    write(tmp_path / "extremes_few.outcomes.csv", HEADS, *ROWS)
    monkeypatch.setattr(study, "FULL", tmp_path)
    monkeypatch.setattr(study, "checks", list)
    monkeypatch.setattr(study, "stored", lambda: {"measured": "2026-07-01, 10:30 UTC", "commit": "0123456789abcdef"})
    return tmp_path


def write(path: Path, *rows: tuple[str, ...]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(rows)


def line(text: str, name: str) -> list[str]:
    """Cells of the row of a table that begins with this name."""
    rows = (re.findall(r"- (.*)", row) for row in re.split(r"\n +\* ", text))
    (found,) = (row for row in rows if row and row[0] == name)
    return [cell.replace(JOIN, " ") for cell in found]


def numbers(text: str) -> list[int]:
    """Whole numbers in a text, in order."""
    return [int(found.replace(",", "")) for found in re.findall(r"\d[\d,]*\d|\d", text)]


def bullet(text: str, program: str) -> list[int]:
    """Numbers in the sentence about a program."""
    (found,) = re.findall(rf"^- \*\*{program}: (.*)$", text, re.MULTILINE)
    return numbers(found)


@pytest.mark.slow
@only_with_a_study
def test_the_counts_of_the_page_are_those_of_the_stored_checks(tmp_path: Path) -> None:
    counts: dict[str, Counter[str]] = {}
    for row in study.checks():
        quantity, _, beside = row["quantity"].partition(", ")
        if row["case"].startswith("extremes") and row["value"] and quantity in extreme_runs.ENDS:
            varied = any(text for key, text in row.items() if key not in OF_EVERY_ROW)
            if not varied and bool(beside) == (row["engine"] != NATIVE):
                counts.setdefault(row["engine"], Counter())[quantity] += round(float(row["value"]))
    assert len(counts) == 3
    text = extremes.page(tmp_path)
    for engine, of in counts.items():
        wrong, total, right, *rest = bullet(text, engine_name(engine))
        assert (wrong, right) == (of["silent wrong"], of["within"])
        assert total == wrong + right + sum(rest)
        assert total == of.total() or engine != NATIVE, "checks of other engines leave out some outcomes"


def test_an_engine_that_is_wrong_or_not_finite_is_counted_and_its_command_given(folder: Path) -> None:
    text = extremes.page(folder)
    assert bullet(text, "flexlink") == [0, 4, 1, 2, 1]
    assert bullet(text, "MuJoCo") == [1, 2, 1]
    _, tried, ours, theirs, command = line(text, "Load")
    assert (tried, command) == ("10⁻³¹⁰ … 3 N", "``r 3``")
    assert numbers(ours) == [0, 4, 2] and ours.endswith(extreme_runs.REFUSED)
    assert numbers(theirs) == [1, 2, 1] and theirs.startswith("**1 ") and theirs.endswith(extreme_runs.NOT_FINITE)
    _, tried, ours, theirs, command = line(text, "Links")
    assert (tried, numbers(ours), theirs, command) == ("2", [0, 1], "–", "``r 5``")
    assert "2026-07-01" in text and "01234567" in text
    assert (folder / extremes.PICTURE).is_file()


def test_refusals_lead_to_the_pages_of_their_messages(folder: Path) -> None:
    text = extremes.page(folder)
    link = ":ref:`newton-failed <message-newton-failed>`"
    assert line(text, link)[2:] == ["1", "``r 1``"]
    assert line(text, "other")[2:] == ["1", "``r 2``"]


def test_bars_compare_the_same_cells_with_the_same_method(folder: Path) -> None:
    shown = extremes.bars(extreme_runs.runs(folder))
    assert [of.total() for of in shown.values()] == [4, 2, 2]
    assert [name.partition(",")[0] for name in shown] == ["flexlink", "flexlink", "MuJoCo"]


def test_digits_are_those_of_the_worst_regular_arm(folder: Path) -> None:
    heads = ("recipe", "varied", "axes", "cond(M)", "native q̈", "mujoco q̈")
    cells = ("1e9", "2e-15", "0.5"), ("1e15", "3e-8", "nan"), ("1e17", "1.0", "1.0")
    rows = ((f"d {k}", f"bend [rad] {k}", "bend [rad]", *cell) for k, cell in enumerate(cells))
    write(folder / "extremes_digits.map.csv", heads, *rows)
    text = extremes.page(folder)
    _, tried, ours, theirs, command = line(text, "Bend")
    assert (tried, numbers(ours), numbers(theirs), command) == ("0 … 2 rad", [7], [0], "``d 1``")
    (sentence,) = re.findall(r"^- .*q̈.*$", text, re.MULTILINE)
    assert numbers(sentence) == [2, 100, 0, 1]


def test_a_study_without_extremes_has_no_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "FULL", tmp_path)
    assert re.findall(r"\d", extremes.page(tmp_path)) == []


def test_words_of_refusals_occur_in_the_library() -> None:
    known = {each.id for group in messages.groups().values() for each in group}
    sources = "".join(path.read_text(encoding="utf-8") for path in messages.LIBRARY.rglob("*.py"))
    for name, pattern in tomllib.loads(extreme_runs.REFUSALS.read_text(encoding="utf-8")).items():
        assert name in known
        assert re.search(pattern, sources), name


def test_arms_count_as_regular_as_in_the_study() -> None:
    assert extreme_runs.SINGULAR == digits.SINGULAR_CONDITION


def test_a_parameter_has_one_name_in_all_parts_of_a_map() -> None:
    axes, varied = "segments, in a plane and links", "segments, in a plane 9.0, links 2.0"
    assert extreme_runs.values_of(axes, varied) == {"segments": 9.0, "links": 2.0}
