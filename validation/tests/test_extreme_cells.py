"""The map of extreme scenes: its cells, their scenes and states, and a command that repeats one cell."""

import sys
from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.spec import decode
from reports.figures.extremes import extreme_runs, promised_errors
from reports.results import Results
from validation import cell
from validation.case import CASES, Measured, load_case
from validation.extremes.cells import Cell, Map
from validation.extremes.families import FAMILIES, Family, moving
from validation.extremes.outcomes import Outcome, RunOutcome
from validation.kinds import digits, extremes
from validation.measuring import kind_of
from validation.store import Series, Store
from validation.tests.studies import row, stored

MAP = {
    "scene": {"arm": {"about": "-", "base": "extreme_arm"}},
    "axis": {
        "young": {"paths": {"material.stuff.young": 1.0}, "unit": "times", "values": [1e-9, 1.0, 2.0, 1e9]},
        "segments": {"paths": {"link.*.segments": 1}, "values": [2.0, 3.0, 7.0], "few": [2.0, 7.0]},
        "links": {"unit": "links", "values": [3.0]},
        "rates": {"paths": {"state.rate": 2.0}, "values": [1e5]},
    },
}


def map_of(*plans: dict[str, object]) -> Map:
    return decode(MAP | {"plan": list(plans)}, Map)


def test_the_figure_of_promises_shows_the_share_of_runs_up_to_an_error_for_each_tolerance(tmp_path) -> None:
    x, y = "tolerance, of the reach", "error / tolerance"
    columns = {x: np.array([1e-6, 1e-3, 1e-6, 1e-3]), y: np.array([3.0, 0.1, 0.5, 0.2])}
    runs = Series("runs", "Error of every run", columns, x, x, y)
    results = stored(tmp_path, row("promises", kind="promises"))
    Store(results).add_series("promises", runs)
    (picture,) = promised_errors(Results.read(results))
    *curves, limit = picture.figure.axes[0].lines
    assert [curve.get_label() for curve in curves] == ["tolerance 10⁻⁶", "tolerance 0.001"]
    assert [curve.get_xydata().tolist() for curve in curves] == [[[0.5, 50], [3, 100]], [[0.1, 50], [0.2, 100]]]
    assert set(limit.get_xdata()) == {1.0}


def test_plans_of_pairs_combine_a_few_values_of_every_two_axes() -> None:
    axes = ["young", "segments", "links"]
    found = [c.values for c in map_of({"scenes": ["arm"], "axes": axes, "together": 2}).cells()]
    assert len(found) == 3 * 2 + 3 * 1 + 2 * 1
    assert {"young": 1e-9, "segments": 7.0} in found
    assert not any(values.get("young") == 1.0 for values in found)


def test_plans_of_one_or_all_axes_use_all_values() -> None:
    one, both = ({"scenes": ["arm"], "axes": ["young", "segments"], "together": k} for k in (1, 0))
    assert len(list(map_of(one).cells())) == 4 + 3
    assert len(list(map_of(both).cells())) == 4 * 3


def test_axes_can_scale_values_set_counts_repeat_links_or_change_the_state() -> None:
    whole = map_of({"scenes": ["arm"], "axes": ["young", "segments", "links", "rates"]})
    scene, state = whole.situation(next(iter(whole.cells())))
    assert scene.arm.materials["stuff"].young == 70e9 * 1e-9
    assert [(link.name, link.segments) for link in scene.arm.links] == [
        ("upper", 2), ("fore1", 2), ("fore2", 2), ("fore3", 2),
    ]  # fmt: skip
    assert state == {"rate": 2e5}


@pytest.mark.parametrize("name", ["extremes", "extremes_beside", "extremes_digits", "extremes_pairs", "extremes_short"])
def test_every_scene_of_every_plan_is_valid_for_some_values(name: str) -> None:
    settings = kind_of(load_case(CASES / f"{name}.toml"))[1]
    parts: dict[tuple[int, str], list[Cell]] = {}
    for each in settings.cells():
        parts.setdefault((id(each.plan), each.scene), []).append(each)
    assert {scene for _, scene in parts} == set(settings.scene)
    for cells in parts.values():
        assert any(is_valid(settings, each) for each in cells), (cells[0].scene, cells[0].plan.axes)


def is_valid(settings: Map, of: Cell) -> bool:
    try:
        settings.situation(of)
    except fl.FlexlinkError:
        return False
    return True


def test_an_accidentally_exact_engine_does_not_tighten_the_error_limit() -> None:
    eps = np.finfo(float).eps
    errors = {("native", "M"): 6e-16, ("pinocchio", "M"): 0.0, ("mujoco", "M"): 1e-13}
    assert digits.CellErrors(16, 1.0, errors, "").ratio("M") == pytest.approx(6e-16 / (4 * eps))
    errors["native", "M"], errors["pinocchio", "M"] = 4e-12, 2e-12
    assert digits.CellErrors(16, 1.0, errors, "").ratio("M") == pytest.approx(40.0)


def test_errors_of_a_mass_matrix_are_relative_to_its_largest_element_or_to_those_of_each_joint() -> None:
    exact = np.array([[4.0, 1.0], [1.0, 1.0]])
    value = np.array([[4.0, 1.02], [1.02, 1.0]])
    assert [digits._error(name, value, exact) for name in ("M", "M, scaled")] == pytest.approx([0.02 / 4, 0.02 / 2])


def measurements(found: Iterable[Measured | Series]) -> dict[str, float]:
    return {each.quantity: each.value for each in found if isinstance(each, Measured)}


def test_false_doubts_are_a_share_of_the_judged_cells() -> None:
    outcomes: tuple[Outcome, ...] = ("within", "within", "warned", "false doubt", "error", "unknown")
    how = extremes.HowTo("native", "RK4", "step", 0.1, 0)
    cells = [extremes.Cell("plane", {}, how, RunOutcome(outcome, 1.0, "", 0.0)) for outcome in outcomes]
    found = measurements(extremes._counts("native", {}, cells))
    assert [*found.values()][-3:] == [6, 4, 0.25]  # cells, those judged, share


def test_a_promise_is_broken_silently_only_without_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs by their error in tolerances, stated over true error, and whether they warn."""
    runs = [(0.05, 9.0, False), (0.5, 1.0, True), (40.0, 2.0, True), (20.0, 0.2, False), (30.0, 8.0, True)]
    found = [extremes.Found("plane", 0, 1e-3, "RK4", *run) for run in runs]
    monkeypatch.setattr(extremes, "_runs", lambda *_: iter(found))
    shares = measurements(extremes.promises(load_case(CASES / "extremes.toml"), ("plane",), 1, (1e-3,)))
    number, largest, beyond, silent, needless, honest, smallest = shares.values()
    assert (number, largest, beyond, silent) == (5, 40.0, 0.6, 1)
    assert (needless, honest, smallest) == (0.2, 0.5, 0.2)


@pytest.mark.parametrize(("travel", "doubt", "judged"), [
    (0.11, 0.04, True), (0.09, 0.04, False), (0.11, 0.06, False), (0.11, 0.9, False),
])  # fmt: skip
def test_a_promise_is_judged_if_the_arm_moves_and_the_reference_is_sure_to_a_twentieth_of_the_tolerance(
    travel: float, doubt: float, judged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Travel of the tip in units of the arm, and uncertainty of the reference in units of the tolerance."""
    arm, ε = moving("damped", 0), 1e-4
    size = fl.lump(arm.scene).size
    tip = np.array([[0.0, 0.0, 0.0], [travel * size, 0.0, 0.0], [0.0, 0.0, 0.0]])
    run = SimpleNamespace(
        tip=tip + np.array([[3.0], [2.0], [0.0]]) * [0.0, ε * size, 0.0], error=np.array([6.0, 0.0, 0.0]) * ε * size,
        steps=SimpleNamespace(method="RK4"), warnings=(),
    )  # fmt: skip
    monkeypatch.setattr(extremes, "_reference", lambda _: (tip, doubt * ε * size))
    monkeypatch.setattr(fl, "simulate", lambda *_, **__: run)
    found: list[Any] = [each[2:] for each in extremes._runs("damped", 0, (ε,))]
    assert found == ([(ε, "RK4", pytest.approx(3.0), pytest.approx(2.0), False)] if judged else [])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_states_have_the_given_distance_from_gimbal_lock(sign: float) -> None:
    chain = fl.lump(fl.load_scene(CASES.parent / "scenes" / "extreme_arm.toml"))
    (state,) = digits.States(gimbal=sign * 1e-3, samples=1).draw(chain)
    groups = chain.bodies[chain.bodies["stop"] - chain.bodies["first"] == 3]
    assert len(groups)
    assert (state.q[groups["first"] + 1] == sign * (np.pi / 2 - 1e-3)).all()


def test_the_cell_command_prints_the_error_of_each_engine(monkeypatch, capsys) -> None:
    pytest.importorskip("pinocchio")
    monkeypatch.setattr(sys, "argv", ["cell", "extremes_digits", "3"])
    assert cell.main() == 0
    printed = capsys.readouterr().out
    assert "cond(M) = 2.7e+06" in printed
    errors = {tuple(line.split()[:2]): float(line.split()[-5]) for line in printed.splitlines()[1:] if "error" in line}
    assert errors["native", "q̈"] < errors["pinocchio", "q̈"] < errors["mujoco", "q̈"] < 1e-9


def test_the_figure_of_runs_lists_silent_errors_with_engine_and_command(tmp_path) -> None:
    step, both = ("RK4", "step", 0.1, 0), {"young": 1.0, "mass": 2.0}
    found = [
        extremes.Cell("plane", values, extremes.HowTo(engine, *step), RunOutcome(outcome, 1.0, "", 0.0))
        for values in ({"young": 1.0}, {"young": 3.0}, both)
        for engine in ("native", "mujoco")
        for outcome in ("error", "silent wrong" if engine == "mujoco" and values != {"young": 3.0} else "within")
    ]
    case = load_case(CASES / "extremes_beside.toml")
    results = stored(tmp_path, row(case.name, kind="extremes"))
    Store(results).add_series(case.name, extremes._series(case, found))
    alone, pairs = extreme_runs(Results.read(results))
    lines = [line.split(",") for line in alone.csv.splitlines()[1:]]
    assert [line[:5] for line in lines] == [
        ["flexlink", "young", "young 1.0", "2", "0"], ["flexlink", "young", "young 3.0", "2", "0"],
        ["MuJoCo", "young", "young 1.0", "2", "1"], ["MuJoCo", "young", "young 3.0", "2", "0"],
    ]  # fmt: skip
    command = "python -m validation.cell extremes_beside 3"
    assert lines[2][5] == command
    assert [line.split(",")[4] for line in pairs.csv.splitlines()[1:]] == ["0", "1"]


@pytest.mark.parametrize("family", FAMILIES)
def test_a_seed_draws_the_same_arm_again(family: Family) -> None:
    (scene, arguments, _), again = moving(family, 3), moving(family, 3).scene
    assert scene == again != moving(family, 4).scene
    assert ("control" in arguments) == (family == "python law")
    if scene.drive.rate is not None:
        assert fl.loop(scene).growth <= 1.0
