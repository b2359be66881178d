"""What the report says first: two verdicts, the numbers that matter, and what is missing."""

from __future__ import annotations

import csv
import dataclasses
import re
from pathlib import Path

import pytest
from studies import BUSY, DATE, QUIET, first_screen, page_from, page_of, row, stored, timed, words_from, words_of

from flexlink.common.errors import FlexlinkError
from reports.build import build
from reports.chapters import contents, sections
from reports.reference import read, save
from reports.results import Results
from tests.words import refused
from validation.store import Conditions, Finished, Store

ROOT = Path(__file__).parent.parent

# the first screen


def test_the_first_screen_says_what_was_compared_when_and_on_what(tmp_path: Path) -> None:
    said = first_screen(words_of(tmp_path, row()))
    paper = "Dynamic Simulation of Nonrigid Link Manipulators (Nonlinear Dynamics, Chaos, Control"
    versions = "Compared: flexlink 0.1.0 with Pinocchio 4.1.0, MuJoCo 4.0.0, published and exact solutions of beams"
    machine = "A processor · 2 cores · Linux x86_64 · Python 3.11.7 · numpy 2.4"
    verdicts = ("Verification: PASS 1 of 1 check pass in 1 case", "Speed: not measured")
    for words in (paper, versions, "2026-07-01, 10:30 to 10:30 UTC", machine, "commit 0123456789ab", *verdicts):
        assert words in said


@pytest.mark.slow
def test_the_three_numbers_and_one_figure_stand_on_the_first_screen(tmp_path: Path) -> None:
    fast = timed(81.0, kind="speed", unit="1", passed=True, engine="native", quantity="real-time factor")
    slow = dataclasses.replace(fast, value=16.0)
    motion = row("fall", kind="trajectory", quantity="max |Δq|", unit="rad", value=4.5e-14)
    where = {"kind": "motion_benchmark", "scene": "torque_pulse", "unit": "m"}
    beam = row("pulse", quantity="tip error", value=6.2e-4, tolerance=1e-3, **where)
    results = stored(tmp_path / "results", row(), motion, beam, slow, fast, conditions=QUIET)
    page = page_from(results, tmp_path)
    values = re.findall(r'<p class="value">(.*?)</p>', page)
    assert [re.sub(r"<[^>]*>|\s", "", value) for value in values] == ["4.5×10⁻¹⁴rad", "0.62mm", "81×realtime"]
    assert page.index('id="figure-overview"') < page.index('<section id="agreement"')


@pytest.mark.slow
def test_the_overview_shows_every_check_of_correctness_and_no_other(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row(), row(value=1.0, quantity="q"), row(tolerance=None), timed(0.5))
    page_from(results, tmp_path)
    with (tmp_path / "report" / "overview.csv").open(encoding="utf-8", newline="") as file:
        assert [line["state"] for line in csv.DictReader(file)] == ["pass", "FAIL"]


@pytest.mark.slow
def test_all_chapters_of_the_page_stand_in_both_navigations(tmp_path: Path) -> None:
    page = page_of(tmp_path, row(), row("odd", kind="unheard"))
    for nav in re.findall(r"<nav .*?</nav>", page, re.DOTALL):
        for chapter in ("agreement", "other", "limitations", "environment", "reproduce"):
            assert f'href="#{chapter}"' in nav
    assert page.count("<nav ") == 2


def test_the_contents_are_well_formed_and_name_kinds_that_exist() -> None:
    files = {path.stem for path in (ROOT / "validation" / "kinds").glob("*.py")}
    assert {kind for section in sections() for kind in section.kinds} - {"*"} <= files
    wanted = [w for section in sections() for w in section.headline] + [w for n in contents().number for w in n.value]
    assert {want.kind for want in wanted} <= files


# two verdicts


def test_a_missed_limit_of_time_leaves_the_verdict_on_correctness_alone(tmp_path: Path) -> None:
    said = first_screen(words_from(stored(tmp_path / "results", row(), timed(2.0), conditions=QUIET), tmp_path))
    assert "Verification: PASS 1 of 1 check pass" in said
    assert "Speed: missed 1 missed on this machine." in said
    assert "Failing checks" not in said


@pytest.mark.parametrize("value", [0.5, 2.0])
def test_on_a_busy_machine_the_page_says_so_instead_of_met_or_missed(tmp_path: Path, value: float) -> None:
    page = words_from(stored(tmp_path / "results", row(), timed(value), conditions=BUSY), tmp_path)
    said = first_screen(page)
    assert "Verification: PASS" in said
    assert "1 not measured because the machine was busy (other processes used 1.8 of 2 cores" in said
    with (tmp_path / "report" / "speed.csv").open(encoding="utf-8", newline="") as file:
        (line,) = csv.DictReader(file)
    assert (line["state"], line["load"], line["spread"]) == ("not measured", "1.8", "0.9")
    assert '<tr class="met"' not in page
    assert '<tr class="missed"' not in page


@pytest.mark.slow
def test_the_speed_table_stands_beside_the_reference_run(tmp_path: Path) -> None:
    before = timed(0.75, engine="pinocchio, fastest", varied={"n": 10, "form": "local"})
    save(Results.read(stored(tmp_path / "quiet", row(), before, conditions=QUIET)), tmp_path / "reference")
    now = timed(0.5, engine="mujoco", varied={"n": 10, "form": "world"})
    results = stored(tmp_path / "results", row(), now, timed(0.5, varied={"n": 20}), conditions=QUIET)
    page = build(results, tmp_path / "report", tmp_path / "reference").read_text(encoding="utf-8")
    assert "Reference run: 2026-07-01, 10:30 to 10:30 UTC · A processor" in page
    assert re.search(r'data-head="reference run" class="num">0.75\N{NO-BREAK SPACE}µs<', page)
    assert page.count('data-head="reference run" class="num">–<') == 1, "what the reference run did not ask"


@pytest.mark.parametrize(("conditions", "value", "planned", "why"), [
    (BUSY, 1e-15, (), "test-verdicts"), (QUIET, 1e-9, (), "test-verdicts"),
    (QUIET, 1e-15, ("other",), "test-verdicts"),
])  # fmt: skip
def test_only_a_whole_right_and_quiet_study_becomes_the_reference_run(
    tmp_path: Path, conditions: Conditions, value: float, planned: tuple[str, ...], why: str
) -> None:
    results = stored(tmp_path / "results", row(value=value), timed(0.5), conditions=conditions, planned=planned)
    with refused(FlexlinkError, why):
        save(Results.read(results), tmp_path / "reference")
    assert not (tmp_path / "reference").exists()


def test_a_torn_reference_run_is_one_line(tmp_path: Path) -> None:
    save(Results.read(stored(tmp_path / "quiet", row(), timed(0.75), conditions=QUIET)), tmp_path / "reference")
    (tmp_path / "reference" / "speed.csv").write_text("case,quantity\ncalls,public call\n", encoding="utf-8")
    with refused(FlexlinkError, "test-verdicts"):
        read(tmp_path / "reference")


def test_the_reference_run_that_is_checked_in_can_be_read() -> None:
    found = read()
    assert bool(found.values) == bool(found.machine)


# only what belongs together


def killed(path: Path) -> Path:
    """A study that was killed in the middle of its second case, with a third one to come."""
    results = stored(path, row("first"), planned=("second", "third"))
    Store(results).append(row("second"))
    return results


def test_half_a_study_never_reads_like_a_whole_one(tmp_path: Path) -> None:
    page = words_from(killed(tmp_path / "results"), tmp_path)
    said = first_screen(page)
    assert "Verification: INCOMPLETE No failure in 1 check, but 2 of 3 cases are missing." in said
    assert not re.search(r"\ball\b[^.]*\bpass", said, re.IGNORECASE)
    assert "second ( Title of second ): stopped in the middle" in said.replace(
        "(Title of second)", "( Title of second )"
    )
    assert "third" in said
    assert "not measured" in said
    assert 'id="case-second"' not in page, "what was stopped is not shown as if it were whole"


def test_a_study_killed_in_its_first_case_passes_nothing(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", planned=("only",))
    Store(results).append(row("only"))
    said = first_screen(words_from(results, tmp_path))
    assert "Verification: INCOMPLETE No checks" in said
    assert "only (Title of only): stopped in the middle" in said


def test_rows_of_older_sources_are_not_mixed_in(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row("old", key="older", value=1.0), row("new"))
    store = Store(results)
    store.finish("old", Finished("older", DATE, "A processor", None))
    said = first_screen(words_from(results, tmp_path))
    assert "old (Title of old): measured with other sources or versions" in said
    assert "FAIL" not in said
    assert [r.case for r in Results.read(results).rows] == ["new"]


def test_a_line_of_an_older_run_of_a_finished_case_is_left_out(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row())
    Store(results).append(row(key="older", value=1.0))
    assert [r.value for r in Results.read(results).rows] == [1e-15]
