"""First screen of the report: two verdicts, the main numbers, and missing cases."""

import csv
import dataclasses
import gzip
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from docs.generators import study
from docs.generators.study import failing
from flexlink.common.errors import FlexlinkError
from reports.build import build
from reports.chapters import contents, sections
from reports.findings.physics import physics_published
from reports.reference import Reference, read, save
from reports.results import Results
from reports.speed_limits import reason_of, reasons, speed_table
from reports.verdict import verification
from tests.support.words import refused, reviewed
from validation.judgement import judged_rows, passing, speed
from validation.kinds import KINDS
from validation.store import Conditions, Finished, Store
from validation.tests.studies import (
    BUSY,
    DATE,
    QUIET,
    first_screen,
    page_from,
    page_of,
    row,
    stored,
    timed,
    words_from,
    words_of,
)

ROOT = Path(__file__).parents[2]


def verdicts(page: str, key: str) -> str:
    """Reviewed verdicts of the first screen, without the remarks that all pages have."""
    shown = first_screen(page)
    shown = shown[shown.index("Verification:") :].partition(" Known limitations ")[0]
    reviewed(f"verdicts: {key}", shown)
    return shown


def test_counts_of_passed_checks_are_in_the_singular_and_the_plural() -> None:
    assert [passing(*counts) for counts in ((1, 1), (1, 2), (2, 2))] == [
        "1 of 1 check passes", "1 of 2 checks passes", "2 of 2 checks pass",
    ]  # fmt: skip


def test_the_first_screen_names_versions_date_and_machine(tmp_path: Path) -> None:
    shown = first_screen(words_of(tmp_path, row()))
    versions = ("flexlink 0.1.0", "Pinocchio 4.1.0", "MuJoCo 4.0.0", "Python 3.11.7", "numpy 2.4", "0123456789ab")
    machine = ("A processor", "2 cores", "Linux x86_64", "2026-07-01, 10:30 ")
    for part in (*versions, *machine, "Verification: PASS 1 of 1 ", "Speed: not measured"):
        assert part in shown
    reviewed("verdicts: first screen", shown)


@pytest.mark.slow
def test_the_first_screen_has_three_numbers_and_one_figure(tmp_path: Path) -> None:
    fast = timed(81.0, kind="speed", unit="1", passed=True, engine="native", quantity="real-time factor")
    slow = dataclasses.replace(fast, value=16.0)
    motion = row("fall", kind="trajectory", quantity="max |Δq|", unit="rad", value=4.5e-14)
    where = {"kind": "motion_benchmark", "scene": "torque_pulse", "unit": "m"}
    beam = row("pulse", quantity="tip error", value=6.2e-4, tolerance=1e-3, **where)
    results = stored(tmp_path / "results", row(), motion, beam, slow, fast, conditions=QUIET)
    page = page_from(results, tmp_path)
    values = re.findall(r'<p class="value">(.*?)</p>', page)
    assert [re.sub(r"<[^>]*>|\s", "", value) for value in values] == ["4.5×10⁻¹⁴rad", "0.62mm", "81×realtime"]
    figure, chapter = (page.index(f'id="{name}"') for name in ("figure-overview", "agreement"))
    assert figure < chapter


@pytest.mark.slow
def test_the_overview_shows_every_check_of_correctness_and_no_other(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row(), row(value=1.0, quantity="q"), row(tolerance=None), timed(0.5))
    page_from(results, tmp_path)
    with (tmp_path / "report" / "overview.csv").open(encoding="utf-8", newline="") as file:
        assert [line["state"] for line in csv.DictReader(file)] == ["pass", "FAIL"]


@pytest.mark.slow
def test_both_navigations_list_all_chapters(tmp_path: Path) -> None:
    page = page_of(tmp_path, row(), row("odd", kind="unheard"))
    for nav in re.findall(r"<nav .*?</nav>", page, re.DOTALL):
        for chapter in ("agreement", "other", "limitations", "environment", "reproduce"):
            assert f'href="#{chapter}"' in nav
    assert page.count("<nav ") == 2


def test_the_contents_name_existing_kinds() -> None:
    assert {kind for section in sections() for kind in section.kinds} - {"*"} <= set(KINDS)
    wanted = [w for section in sections() for w in section.headline] + [w for n in contents().number for w in n.value]
    assert {want.kind for want in wanted} <= set(KINDS)


def test_a_missed_time_limit_does_not_change_the_verdict_on_correctness(tmp_path: Path) -> None:
    page = words_from(stored(tmp_path / "results", row(), timed(2.0), conditions=QUIET), tmp_path)
    shown = verdicts(page, "a missed time limit")
    assert "Verification: PASS 1 " in shown
    assert "Speed: missed 1 " in shown
    assert "calls" not in shown


@pytest.mark.parametrize("value", [0.5, 2.0])
def test_time_limits_are_not_measured_on_a_busy_machine(tmp_path: Path, value: float) -> None:
    page = words_from(stored(tmp_path / "results", row(), timed(value), conditions=BUSY), tmp_path)
    shown = verdicts(page, "a busy machine")
    assert "Verification: PASS" in shown
    assert "1.8 of 2 cores" in shown
    with (tmp_path / "report" / "speed.csv").open(encoding="utf-8", newline="") as file:
        (line,) = csv.DictReader(file)
    assert (line["state"], line["load"], line["spread"]) == ("not measured", "1.8", "0.9")
    assert 'class="met"' not in page
    assert 'class="missed"' not in page


@pytest.mark.slow
def test_the_speed_table_has_a_column_for_the_reference_run(tmp_path: Path) -> None:
    before = timed(0.75, engine="pinocchio, fastest", varied={"n": 10, "form": "local"})
    save(Results.read(stored(tmp_path / "quiet", row(), before, conditions=QUIET)), tmp_path / "reference")
    now = timed(0.5, engine="mujoco", varied={"n": 10, "form": "world"})
    results = stored(tmp_path / "results", row(), now, timed(0.5, varied={"n": 20}), conditions=QUIET)
    page = build(results, tmp_path / "report", tmp_path / "reference").read_text(encoding="utf-8")
    assert page.count("10:30 UTC · A processor") == 2  # of this run and of the reference run
    cells = re.findall(r'data-head="reference run" class="num">([^<]*)<', page)
    assert cells.count("0.75\N{NO-BREAK SPACE}µs") == 1
    assert cells.count("–") == 1  # a quantity that the reference run lacks


def test_a_value_of_the_reference_run_is_found_whichever_form_was_the_fastest(tmp_path: Path) -> None:
    before = timed(0.75, engine="pinocchio, fastest", varied={"n": 10, "form": "local"})
    folder = save(Results.read(stored(tmp_path / "quiet", row(), before, conditions=QUIET)), tmp_path / "reference")
    now = dataclasses.replace(before, engine="mujoco", varied={"n": 10, "form": "world"}, value=0.5)
    others = ({"varied": {"n": 20, "form": "local"}}, {"scene": "other"}, {"quantity": "M"}, {"case": "terms"})
    assert [read(folder).value(dataclasses.replace(now, **other)) for other in ({}, *others)] == [0.75] + 4 * [None]


@pytest.mark.parametrize(("conditions", "value", "planned"), [
    (BUSY, 1e-15, ()), (QUIET, 1e-9, ()), (QUIET, 1e-15, ("other",)),
])  # fmt: skip
def test_only_a_complete_correct_and_undisturbed_study_becomes_the_reference_run(
    tmp_path: Path, conditions: Conditions, value: float, planned: tuple[str, ...]
) -> None:
    results = stored(tmp_path / "results", row(value=value), timed(0.5), conditions=conditions, planned=planned)
    with refused(FlexlinkError, "verdicts: refused as a reference run"):
        save(Results.read(results), tmp_path / "reference")
    assert not (tmp_path / "reference").exists()


def test_a_damaged_reference_run_is_refused(tmp_path: Path) -> None:
    save(Results.read(stored(tmp_path / "quiet", row(), timed(0.75), conditions=QUIET)), tmp_path / "reference")
    (tmp_path / "reference" / "speed.csv").write_text("case,quantity\ncalls,public call\n", encoding="utf-8")
    with refused(FlexlinkError, "verdicts: damaged reference run"):
        read(tmp_path / "reference")


def test_the_reference_run_of_the_project_can_be_read() -> None:
    found = read()
    assert bool(found.values) == bool(found.machine)


def killed(path: Path) -> Path:
    """A study that was killed in the middle of its second case, with a third one to come."""
    results = stored(path, row("first"), planned=("second", "third"))
    Store(results).append(row("second"))
    return results


def test_an_incomplete_study_has_no_verdict_and_lists_the_missing_cases(tmp_path: Path) -> None:
    page = words_from(killed(tmp_path / "results"), tmp_path)
    shown = verdicts(page, "an incomplete study")
    assert "Verification: INCOMPLETE" in shown
    assert "2 of 3 cases" in shown
    assert "PASS" not in shown
    for case in ("second", "third"):
        assert f"Title of {case}): " in shown
    assert "not measured" in shown
    assert "case-second" not in page  # it was interrupted, so the page omits its results


def test_a_study_killed_in_its_first_case_has_no_passed_checks(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", planned=("only",))
    Store(results).append(row("only"))
    shown = verdicts(words_from(results, tmp_path), "a study without finished cases")
    assert "Verification: INCOMPLETE" in shown
    assert "1 of 1 case" in shown
    assert f"Title of {'only'}): " in shown


def test_a_study_without_a_check_has_no_verdict(tmp_path: Path) -> None:
    assert verification(Results.read(stored(tmp_path, row(tolerance=None)))).word == "INCOMPLETE"


def test_limits_of_unfinished_cases_are_not_measured_and_the_busiest_machine_is_named() -> None:
    """Three of four cores are busier than four of eight."""
    loads = {"a": Conditions(3.0, 0.0, 4), "b": Conditions(4.0, 0.0, 8)}
    finished = {case: Finished("k", DATE, "A processor", load) for case, load in loads.items()}
    rows = [dataclasses.replace(timed(0.5), case=case) for case in ("a", "b", "unfinished")]
    found = speed(judged_rows(rows, finished))
    assert (len(found.met), len(found.unmeasured), found.worst) == (0, 3, loads["a"])


def test_results_of_older_sources_are_left_out(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row("old", key="older", value=1.0), row("new"))
    store = Store(results)
    store.finish("old", Finished("older", DATE, "A processor", None))
    shown = verdicts(words_from(results, tmp_path), "results of older sources")
    assert f"Title of {'old'}): " in shown
    assert "FAIL" not in shown
    assert [r.case for r in Results.read(results).rows] == ["new"]


def test_a_line_of_an_older_run_of_a_finished_case_is_left_out(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row())
    Store(results).append(row(key="older", value=1.0))
    assert [r.value for r in Results.read(results).rows] == [1e-15]


def test_every_missed_time_limit_of_the_stored_study_has_a_reason() -> None:
    for file in (ROOT / "reports" / "full").glob("speed.csv*"):
        text = gzip.decompress(file.read_bytes()) if file.suffix == ".gz" else file.read_bytes()
        missed = [line for line in csv.DictReader(text.decode().splitlines()) if line["state"] == "missed"]
        assert [line["case"] + ", " + line["quantity"] for line in missed if not line["why"]] == []


def test_every_failing_check_of_the_stored_study_has_a_reason() -> None:
    unknown = [row for row in failing() if not reason_of(row["case"], row["quantity"])]
    assert [f"{row['case']}, {row['quantity']}" for row in unknown] == []


def test_a_missed_limit_states_its_reason_and_a_met_one_none(tmp_path: Path) -> None:
    slow, fast = (dataclasses.replace(timed(value, passed=value < 1), case="speed_calls") for value in (5.3, 0.5))
    results = Results.read(stored(tmp_path / "results", row(), slow, fast, conditions=QUIET))
    table = speed_table(results, Reference({}, ""))
    assert [bool(line[-1]) for line in table.lines] == [True, False]
    assert table.lines[0][-1] == next(one.why for one in reasons() if one.case == "speed_calls")


def test_differences_from_published_values_are_relative() -> None:
    theirs = np.array([2.0, 4.0, 5.0, 8.0, 10.0, 20.0])
    ours = theirs * (1 + np.array([0.001, -0.002, 0.0, 0.004, -0.05, 0.03]))
    columns = {"what": np.array(list("abcdef")), "published": theirs, "ours": ours}
    series = SimpleNamespace(columns=columns)
    results = SimpleNamespace(showing=lambda name: [("beam", series)], cases={"beam": [SimpleNamespace(title="Beam")]})
    (table,) = physics_published(cast("Any", results))
    shown = [str(line[3]).replace("−", "-") for line in table.lines]
    numbers = [float(text.removeprefix("at most ").split()[0].rstrip("%")) for text in shown]
    assert numbers == pytest.approx([0.1, -0.2, 0.0, 0.4, 5.0], abs=0.051)
    assert shown[-1].startswith("at most ")
    assert [line[0] for line in table.lines] == ["Beam: a", "Beam: b", "Beam: c", "Beam: d", "Beam: 2 more"]


def test_the_verdicts_of_the_study_are_one_row_of_boxes() -> None:
    page = study.page(ROOT)
    boxes = page.split(".. rst-class:: verdicts\n\n")[1].split("\n\n")[0]
    assert [line[:4] for line in boxes.splitlines()] == ["- **"] * len(study.verdicts())
