"""The case `formulations`: the best of each ladder is chosen, missing programs are named, other motions are found."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from flexlink.common.errors import ArgumentError, FlexlinkError
from reports import formulations as columns
from reports.figures import trade as figure
from reports.findings import trade as finding
from reports.results import Results
from tests.support.words import refused, reviewed
from validation.case import CASES, load_case
from validation.formulations import exported_chains, flexlink_links, ladder
from validation.formulations.ladder import FORMULATIONS, Formulation, Rung, cheapest, climb, most_accurate, smallest
from validation.formulations.stored import galerkin_arm
from validation.formulations.task import Described, Outcome, task_of
from validation.kinds import formulations
from validation.oracles import inextensible_rods
from validation.reference_values import look_up
from validation.runner import kind_of
from validation.store import Series, Store, table
from validation.tests.studies import row, stored
from validation.trade.first_order import FirstOrder

SHORT = load_case(CASES / "formulations_short.toml")
FULL = load_case(CASES / "formulations.toml")
FULL_TASKS = kind_of(FULL)[1].task
RUNGS = [
    Rung({"elements": 2}, 1e-2, 1.0, 10), Rung({"elements": 4}, 1e-4, 9.0, 20), Rung({"elements": 8}, 2e-4, 3.0, 40),
    Rung({"elements": 9}, math.inf, 0.1, 5), Rung({"elements": 10}, 1e-4, 4.0, 20),
]  # fmt: skip
PULSE = Described(scene="torque_pulse", input="torque_pulse", reference="single_link_torque_pulse")


def test_the_best_rung_is_the_cheapest_or_smallest_that_reaches_the_error() -> None:
    assert cheapest(RUNGS, 1e-3) is RUNGS[2]
    assert cheapest(RUNGS, 1e-4) is RUNGS[4]
    assert smallest(RUNGS, 1e-3) is RUNGS[4], "the cheaper of two with equal coordinates"
    assert smallest(RUNGS, 1e-1) is RUNGS[0], "a failed run has no error"
    assert cheapest(RUNGS, 1e-5) is smallest(RUNGS, 1e-5) is None
    assert most_accurate(RUNGS) is RUNGS[1]
    assert most_accurate(RUNGS[3:4]) is None


OURS = "ours", "advise"
FRONT, ELSEWHERE, OTHERS, REMARK = (
    "advise / front",
    "chains elsewhere / flexlink",
    "others / flexlink",
    "advice took 1 s",
)


def planted(distance: float, seconds: float):
    """A program whose tip is off by this fraction of the length."""

    def run(task, _element, setting) -> Outcome:
        return Outcome(np.add(task.reference.tip, [0.0, distance * task.length * setting["h"], 0.0]), seconds, 7)

    return run


def plant(monkeypatch: pytest.MonkeyPatch, **runs) -> None:
    """Replace all formulations by planted ones."""
    monkeypatch.setattr(ladder.Formulation, "run", property(lambda self: runs[self.module]))
    made = {name: Formulation("native" if name in OURS else "exudyn", "", name, "") for name in runs}
    monkeypatch.setattr(formulations, "FORMULATIONS", made | {"absent": Formulation("exudyn", "nowhere", "", "")})


def rows_of(names: tuple[str, ...], reaches: dict[str, float], errors=(1e-2, 1e-3)):
    described = replace(PULSE, ladder={name: {"h": (1.0, 0.5)} for name in names}, reaches=reaches)
    settings = formulations.Settings(scenes=("torque_pulse",), errors=errors, task={"torque_pulse": described})
    *rows, series = formulations.run(SHORT, settings)
    return rows, series


def test_rows_state_costs_least_errors_and_what_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, ours=planted(1e-3, 0.1), theirs=planted(1e-2, 0.3))
    rows, series = rows_of(("ours", "theirs", "absent"), {"ours": 5e-4, "theirs": 4e-3})
    found = {(each.quantity, each.varied.get("formulation"), each.varied.get("relative error")): each for each in rows}
    assert "nowhere" in found["runs", "absent", None].note
    assert found["CPU time", "ours", 1e-3].value == pytest.approx(100)
    assert found["not reached", "theirs", 1e-3].value == pytest.approx(5e-3)
    assert "h 0.5" in found["not reached", "theirs", 1e-3].note
    stated = [each.value for each in rows if each.quantity == formulations.STATED]
    assert stated == pytest.approx([1.0, 1.25]), "another motion fails"
    ratios = [each.value for each in rows if each.quantity.startswith("others")]
    assert ratios == pytest.approx([3.0]), "no other program reaches the smaller error"
    assert series.columns["coordinates"].tolist() == [7, 7, 7, 7]


def test_advice_is_compared_with_the_front_of_all_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def pick(task, _element, setting) -> Outcome:
        off = [0.0, 0.5 * setting["tip"] * task.length, 0.0]
        return Outcome(np.add(task.reference.tip, off), 0.6, 3, counted=True, note=REMARK)

    plant(monkeypatch, ours=planted(9e-4, 0.5), other_chains=planted(2e-3, 0.3), advise=pick)
    ladder = {"ours": {"h": (1.0,)}, "other_chains": {"h": (1.0,)}, "advise": {"tip": (1e-2, 1e-3)}}
    task = replace(PULSE, ladder=ladder, reaches={})
    settings = formulations.Settings(("torque_pulse",), errors=(1e-2, 1e-3), task={"torque_pulse": task})
    *rows, _ = formulations.run(SHORT, settings)
    found = {(each.quantity, each.varied.get("relative error")): each for each in rows}
    assert found[f"{FRONT}, error 0.01", 1e-2].value == pytest.approx(2), "theirs"
    assert "other_chains" in found[f"{FRONT}, error 0.01", 1e-2].note
    assert REMARK in found[f"{FRONT}, error 0.01", 1e-2].note
    assert found[f"{FRONT}, error 0.001", 1e-3].value == pytest.approx(1.2)
    assert found[f"torque_pulse, {ELSEWHERE}, error 0.01", 1e-2].value == pytest.approx(0.6)
    assert found[formulations.PICK_ERROR, 1e-3].value == pytest.approx(0.5)
    assert not [each for each in rows if each.quantity.startswith(OTHERS)]


def test_a_limit_of_one_scene_replaces_that_of_all() -> None:
    quantity = replace(FULL.quantity[f"{FRONT}, error 0.001"], given_up="why")
    case = replace(FULL, quantity={f"crane, {FRONT}, error 0.001": quantity})
    assert case.has_separate_limit("crane", f"{FRONT}, error 0.001")
    assert not case.has_separate_limit("ur5_soft", f"{FRONT}, error 0.001")


def test_a_ladder_runs_all_its_settings_and_a_program_that_gives_up_has_no_error(monkeypatch) -> None:
    plant(monkeypatch, ours=planted(1e-3, 0.4), lost=lambda *_: Outcome(np.empty((0, 3)), 0.2, 3))
    task = task_of("torque_pulse", PULSE)
    steps = {"h": [1.0, 0.5, 0.25, 0.1]}
    assert [rung.setting["h"] for rung in climb(task, formulations.FORMULATIONS["ours"], steps)] == steps["h"]
    assert {rung.error for rung in climb(task, formulations.FORMULATIONS["lost"], steps)} == {math.inf}


def test_cases_name_known_formulations_and_state_for_each_what_it_reaches() -> None:
    for case in (SHORT, FULL):
        _, settings = kind_of(case)
        for name in settings.scenes:
            task = settings.task[name]
            assert {*task.ladder, *task.cannot} <= set(FORMULATIONS)
            assert set(task.reaches) == set(task.ladder), f"{case.name}, {name}"


@pytest.mark.slow
def test_galerkin_rods_reproduce_the_independent_reference() -> None:
    task = task_of("torque_pulse", PULSE)
    found = inextensible_rods.tips(galerkin_arm(task), task.times[:5], 6, 1e-7)
    assert found == pytest.approx(task.reference.tip[:5, :2], abs=2e-5)


@pytest.mark.slow
@pytest.mark.first
def test_strain_modes_and_chains_run_with_their_numbers_of_coordinates() -> None:
    task = task_of("torque_pulse", PULSE)
    chain = flexlink_links.run(task, "gauss", {"hinges": 8, "tolerance": 1e-4})
    modes = flexlink_links.run(task, "lobatto4 eigenmodes", {"hinges": 12, "modes": 3, "tolerance": 1e-4})
    assert (chain.coordinates, modes.coordinates) == (9, 4)
    assert max(task.error(chain.tip), task.error(modes.tip)) < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize(
    "element, setting",
    [("mujoco implicitfast", {"step": 1e-4}), ("pinocchio Radau", {"tolerance": 1e-4})],
    ids=["mujoco", "pinocchio"],
)
def test_other_programs_compute_the_same_chain_as_flexlink(element: str, setting: dict[str, float]) -> None:
    task = task_of(
        "crane", replace(FULL_TASKS["crane"], change={"run.duration": 0.2, "run.sample": 0.05}, reference="")
    )
    ours = flexlink_links.run(task, "gauss", {"hinges": 2, "tolerance": 1e-7})
    theirs = exported_chains.run(task, element, {"hinges": 2} | setting)
    assert theirs.tip == pytest.approx(ours.tip, abs=1e-4 * task.length)
    assert not np.allclose(theirs.tip, ours.tip[0], atol=1e-2), "the crane has moved"
    assert theirs.coordinates == ours.coordinates


@pytest.mark.slow
def test_drake_computes_the_same_chain_as_flexlink_and_gives_up_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pydrake")
    task = task_of("paper_arm", replace(FULL_TASKS["paper_arm"], change={"run.duration": 0.2, "run.sample": 0.05}))
    ours = flexlink_links.run(task, "gauss", {"hinges": 2, "tolerance": 1e-7})
    theirs = exported_chains.run(task, "drake radau3", {"hinges": 2, "accuracy": 1e-5})
    assert theirs.tip == pytest.approx(ours.tip, abs=1e-4 * task.length)
    monkeypatch.setattr(exported_chains, "LONGEST", 0.0)
    with pytest.raises(FlexlinkError):
        exported_chains.in_drake(flexlink_links.chain_scene(task, "gauss", {"hinges": 2}), "radau3", 1e-3)


def test_independent_solvers_refuse_drives_that_they_would_ignore() -> None:
    drive = {"kind": "pd", "gravity": "rigid", "kp": [0.0, 1.0, 1.0], "kd": [0.0, 1.0, 1.0], "target_deg": [0.0] * 3}
    task = task_of("paper_arm", replace(FULL_TASKS["paper_arm"], change={"drive": drive}))
    with refused(ArgumentError, "formulations: gravity"):
        FirstOrder(task.scene)


def test_references_of_whole_scenes_are_confirmed_by_another_program_and_another_rule() -> None:
    for name in ("crane", "ur5_soft", "spatial_arm", "paper_arm", "dual_arm"):
        described = FULL_TASKS[name]
        known = look_up(described.reference, "own_error_m")
        assert known == max(look_up(name, part) for part in ("coarser_m", "other_rule_m", "witness_m")), name
        assert known / task_of(name, described).length < 0.2 * min(described.errors), name


FACTS = {"ours": {"formulation": "chain, gauss"}, "theirs": {"formulation": "Exudyn ANCF cable"}}
RATIO = {"kind": "formulations", "tolerance": None, "scene": "torque_pulse"}


def study(tmp_path: Path, ratio: float) -> Results:
    rows = [
        row("short", quantity="CPU time", value=1.5, varied=FACTS["ours"] | {"relative error": 1e-3}, **RATIO),
        row("short", quantity="coordinates", value=9, varied=FACTS["ours"] | {"relative error": 1e-3}, **RATIO),
        row("short", quantity="not reached", value=2e-3, varied=FACTS["theirs"] | {"relative error": 1e-3}, **RATIO),
        row("short", quantity="least error", value=2e-3, varied=FACTS["theirs"], note="elements 2", **RATIO),
        row("short", quantity="others / flexlink, error 0.001", value=ratio, varied={"relative error": 1e-3}, **RATIO),
        row("short", quantity="runs", value=0, varied={"formulation": "PyElastica"}, note="Not here.", **RATIO),
    ]
    results = stored(tmp_path, *rows)
    runs = (
        ("chain, gauss", "h 1", 9, 1e-3, 1e-3),
        ("chain, gauss", "h 2", 9, 1e-2, 2e-3),
        ("PyElastica", "", 60, 1e-2, 1.0),
    )
    columns = table(formulations.COLUMNS, runs)
    Store(results).add_series(
        "short", Series("formulations", "pulse", columns, "error", "e", "t", scene="torque_pulse")
    )
    return Results.read(results)


def test_the_table_has_every_formulation_with_its_cost_or_why_it_has_none(tmp_path: Path) -> None:
    (made,) = finding.trade_formulations(study(tmp_path, 30.0))
    ours, theirs, absent = made.lines
    assert ours[:4] == ("torque_pulse", "chain, gauss", 1.5, 9)
    assert theirs[2:] == (finding.NOT_REACHED, None, 2e-3, "elements 2")
    assert (absent[2], absent[-1]) == ("", "Not here.")
    reviewed("formulations: won", made.sentences[0])
    assert "30 (torque_pulse)" in made.sentences[0]


def test_a_loss_is_stated(tmp_path: Path) -> None:
    (made,) = finding.trade_formulations(study(tmp_path, 0.5))
    reviewed("formulations: lost", made.sentences[0])
    assert "0.5 (torque_pulse)" in made.sentences[0]


def test_the_picture_shows_time_and_coordinates_of_the_best_runs(tmp_path: Path) -> None:
    (picture,) = figure.trade_formulations(study(tmp_path, 30.0))
    lines = [
        {line.get_label(): line.get_ydata().tolist() for line in axes.lines if line.get_linestyle() == "-"}
        for axes in picture.figure.axes
    ]
    assert lines[0]["chain, gauss"] == [1e-3], "the run with both a larger error and a longer time is not on the line"
    assert lines[1]["PyElastica"] == [60]
    assert len(picture.csv.splitlines()) == 4


def test_a_value_is_that_of_its_quantity_formulation_and_error() -> None:
    rows = [
        row("scene", value, quantity=quantity, varied={"formulation": name, "relative error": error})
        for value, (quantity, name, error) in enumerate(itertools.product("CT", ("chain", "beam"), (1e-2, 1e-3)))
    ]
    assert [columns.value(rows, q, n, e) for q in "CT" for n in ("chain", "beam") for e in (1e-2, 1e-3)] == [*range(8)]
    assert columns.value(rows, "C", "chain", 1e-4) is None
