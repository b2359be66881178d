"""Kinds of cases report the worst state, cut or row, wherever it is, and frequencies of elastic modes only."""

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

import flexlink as fl
from flexlink.describe.spec import decode
from flexlink.diagnosis.quantities import random_states
from tests.conftest import ROOT
from validation import sweep_processes
from validation.case import CASES, Measured, load_case, scene_file
from validation.formulations.ladder import ADVISE, Rung
from validation.kinds import (
    KINDS,
    data_sheets,
    engines,
    fifty_digits,
    floating_frames,
    formulations,
    frequencies,
    identities,
    integrators,
    orders,
    paper_equations,
    robots,
    speed_models,
    stable_steps,
    statics,
    sweeps,
    witnesses,
)
from validation.physics.variant import Rule, Variant
from validation.reference_values import reference_array
from validation.trade.error_parts import Fine, Part, Path, Split

ARM = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"link.*.segments": 3})
CHAIN = fl.lump(ARM)
OFF = 1e-3


@pytest.mark.parametrize("of", ["force", "moment"])
@pytest.mark.parametrize("cut", range(len(CHAIN.bodies)))
def test_a_wrong_load_at_any_cut_disturbs_the_equilibrium(cut: int, of: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (state,), right = random_states(CHAIN, 1), fl.strength.internal_loads
    assert identities._equilibrium(CHAIN, state) < 1e-12

    def wrong(*args: Any, **options: Any) -> Any:
        loads = right(*args, **options)
        found = {"force": loads.force.copy(), "moment": loads.moment.copy()}
        found[of][cut] += OFF * np.abs(found[of]).max()
        return SimpleNamespace(**found)

    monkeypatch.setattr(fl.strength, "internal_loads", wrong)
    assert identities._equilibrium(CHAIN, state) > OFF / 2


class Original:
    """A reference for `CHAIN` whose state number `wrong` is wrong by a factor."""

    def __init__(self, wrong: int) -> None:
        self.factors = {name: iter(np.where(np.arange(3) == wrong, 1 + OFF, 1.0)) for name in ("M", "T", "q̈")}

    def mass_matrix(self, q: Any) -> Any:
        return next(self.factors["M"]) * fl.mass_matrix(CHAIN, q)

    def bias_torque(self, q: Any, qd: Any) -> Any:
        return next(self.factors["T"]) * fl.bias_torque(CHAIN, q, qd)

    def acceleration(self, q: Any, qd: Any, tau: Any) -> Any:
        tau = tau + fl.friction_torque(CHAIN, qd)
        return next(self.factors["q̈"]) * fl.forward_dynamics(CHAIN, q, qd, tau)

    def sizes(self, q: Any) -> Any:
        return np.ones(CHAIN.n)


@pytest.mark.parametrize("wrong", range(3))
def test_an_error_in_any_state_of_a_robot_counts(wrong: int) -> None:
    original: Any = Original(wrong)
    found = {each.quantity: each.value for each in robots._against_original(ARM, original, 3)}
    for name in ("M", "T_GC", "T_GC by joints"):
        assert found[name] == pytest.approx(OFF / (1 + OFF))
    assert found["M by joints"] > 0 and found["q̈"] > 1e3


def test_the_worst_state_against_the_rigid_arm_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    apart = iter([3.0, 1.0, 2.0, 4.0])  # M and T_GC of two states
    monkeypatch.setattr(robots, "_apart", lambda *_: next(apart))
    scene = fl.load_scene(ROOT / "models" / "robots" / "z1_flexible.toml")
    assert [each.value for each in robots._against_rigid(scene, 2)] == [3.0, 4.0]


def test_a_free_beam_has_the_frequencies_of_elastic_modes_only() -> None:
    """Two panels on a hub of almost no mass are a free beam of length 2: ω = (4.7300² and 7.8532²)/4."""
    light = {"base.mass": 1e-9, "base.inertia": [1e-9, 1e-9, 1e-9]}
    scene = fl.load_scene(scene_file("panels")).varied(light)
    settings = frequencies.Settings(reference="", best=Rule(rule="gauss", hinges=16), variant=(), rules={}, modes=2)
    found = frequencies._frequencies(scene, Variant(), settings)
    assert found == pytest.approx(np.array([4.730041, 7.853205]) ** 2 / 4, rel=1e-3)


ROWS = [(k, "done", 0.5 * k) for k in range(4)]


@pytest.mark.parametrize(("rows", "not_once", "different"), [
    (ROWS, 0, 0), (ROWS[:-1], 1, 1), (ROWS[1:], 1, 4), ([*ROWS, (4, "done", 2.0)], 0, 1), ([*ROWS, ROWS[-1]], 1, 1),
    ([(0, "done", 0.1), *ROWS[1:]], 0, 1), ([(0, "failed", 0.0), *ROWS[1:]], 0, 1),
])  # fmt: skip
def test_missing_surplus_and_changed_rows_of_a_killed_sweep_differ(
    rows: list[Any], not_once: int, different: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rows of a killed sweep, the members without exactly one row, and the rows that differ."""
    undisturbed = SimpleNamespace(rows=ROWS)
    monkeypatch.setattr(sweep_processes, "killed_at", lambda counts, *_: len(counts))
    monkeypatch.setattr(sweep_processes, "rows", lambda _: rows)
    monkeypatch.setattr(fl, "sweep", lambda *_, **__: undisturbed)
    case = load_case(CASES / "sweep_killed.toml")
    found = [each.value for each in sweeps.sweeps(case, case.settings["sweep"], len(ROWS), kills=3)]
    assert found == [3, not_once, different, 0]


def test_a_method_with_too_low_a_slope_is_below_its_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Errors 1/N of a method of order 4: slope 1."""
    monkeypatch.setattr(orders, "_float64", lambda scene, method, duration, steps: [1 / steps if steps < 1e6 else 0.0])
    case = load_case(CASES / "convergence_float64.toml")
    reference = orders.Reference(method="RK10", steps=10**6)
    found = orders.convergence(case, 2, 1.0, "float64", reference, {"RK4": (10, 20, 40)})
    values = {each.quantity: each.value for each in found if isinstance(each, Measured)}
    assert values == pytest.approx({"slope": 1.0, "|slope − order|": 3.0, "order − slope": 3.0}, rel=1e-9)


def test_the_front_has_no_runs_that_advise_picks_and_no_formulation_beyond_the_error() -> None:
    rungs = {"chain": (1e-3, 2.0), "beam": (1e-1, 1.0), ADVISE: (1e-4, 0.5)}
    climbed = [formulations.Climbed(name, "", [Rung({}, *each, 1)]) for name, each in rungs.items()]
    assert formulations._costs(climbed, 1e-2) == {"chain": Rung({}, 1e-3, 2.0, 1)}


def test_angles_and_rates_of_another_program_are_compared_separately(monkeypatch: pytest.MonkeyPatch) -> None:
    ends = {"native": np.zeros((2, 2, 3)), "other": np.array([[[0, 1, 0], [0, 0, 0]], [[0, 0, 0], [7, 0, -2]]])}
    stub = {name: SimpleNamespace(integrate=lambda _, at=at: (None, *at)) for name, at in ends.items()}
    monkeypatch.setattr(witnesses.engines, "load", lambda name, chain: stub[name])
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml")
    assert [each.value for each in witnesses._motion(scene, "other")] == [1.0, 7.0]


def test_the_largest_stable_step_is_relative_to_the_least_predicted_along_a_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(integrators, "stable_step", lambda chain, q, method: 2.0 + q[0])
    monkeypatch.setattr(integrators, "_stable", lambda scene, method, step: step < 1.0)
    exact: Any = SimpleNamespace(q=np.array([[3.0], [-1.0], [1.0]]), chain=None)
    assert integrators._stability(ARM, "RK4", exact).value == pytest.approx(1.0, abs=2e-3)


def test_near_gimbal_lock_the_middle_hinge_of_three_is_at_90_degrees() -> None:
    """Fixed axes x, y and z: the first and the third axis are parallel if the middle angle is 90°."""
    chain = fl.lump(ARM.varied({"link.*.flex": "xyz"}))
    (state,) = random_states(chain, 1)
    q = fifty_digits._near_lock(chain, state, 1e-6).q
    (turned,) = np.nonzero(q != state.q)
    triples = chain.bodies["first"][chain.bodies["stop"] - chain.bodies["first"] == 3]
    assert len(turned) and set(turned) <= set(triples + 1)
    assert np.abs(q[turned]) == pytest.approx(np.pi / 2 - 1e-6)


def test_errors_for_small_bending_are_those_of_the_least_torque() -> None:
    settings: Any = SimpleNamespace(modes=(2,), torques=(1e-3, 1.0), stations=0.0)
    errors = {(floating_frames.OURS, 1e-3): 1e-9, (floating_frames.OURS, 1.0): 1e-4}
    points = [floating_frames.Point(name, 2, torque, error) for (name, torque), error in errors.items()]
    found = {each.quantity: each.value for each in floating_frames._comparisons(points, settings)}
    assert found == {floating_frames.LITTLE: 1e-9, floating_frames.MUCH: 1e-4}


@pytest.mark.parametrize(("name", "column"), [("hinges", "stiffness"), ("bodies", "mass")])
def test_a_number_of_a_hinge_or_a_body_that_a_file_changed_is_counted(name: str, column: str) -> None:
    rows = getattr(CHAIN, name).copy()
    rows[column][2] *= 1 + 1e-15
    assert engines._differences(CHAIN, CHAIN) == 0
    assert engines._differences(CHAIN, dataclasses.replace(CHAIN, **{name: rows})) == 1


def test_scenes_with_a_largest_stable_step_are_counted_once_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stable_steps, "observed", lambda rest, name, predicted: 1.01)
    case = replace(load_case(CASES / "stable_steps.toml"), scenes=("unit_two_links", "unit_beam"))
    found = [each for each in stable_steps.run(case, ("RK2", "RK4")) if isinstance(each, Measured)]
    numbers = {each.quantity: each.value for each in found}
    all_scenes, limited = numbers["scenes"], numbers["scenes with a largest stable step"]
    assert (all_scenes, limited) == (2, 2)


def test_mujocos_critical_load_in_a_data_sheet_is_mujocos(monkeypatch: pytest.MonkeyPatch) -> None:
    case = load_case(CASES / "physics_columns.toml")
    settings = KINDS[case.kind].settings
    decoded: Any = decode(case.settings, settings, "settings")
    load = decoded.load[0]
    exact = float(reference_array("critical_loads", load.key))
    monkeypatch.setattr(statics, "_critical_in_mujoco", lambda chain, load: 3 * exact)
    monkeypatch.setattr(statics, "_critical", lambda chain, load: 2 * exact)
    one = replace(decoded, load=(load,))
    at = Rule(rule="gauss", hinges=2)
    assert statics.mujoco_buckling_error_at(case, one, at) == pytest.approx(2.0)
    assert statics.buckling_error_at(case, one, at) == pytest.approx(1.0)


def test_each_type_of_link_gains_over_the_one_before(monkeypatch: pytest.MonkeyPatch) -> None:
    tips = {"rigid": 8.0, "T1": 4.0, "T2": 1.0, "T3": 0.0}
    types = {flex: name for name, flex in {"rigid": "rigid", **paper_equations.TYPES}.items()}
    monkeypatch.setattr(Fine, "limit", lambda self, scene, flex: Path(np.full((2, 3), tips[types[flex]]), 0.0))
    fine = Fine(method="RK4", tolerances=(1.0, 1.0))
    case: Any = SimpleNamespace(varied_scene=lambda name, change: ARM)
    motion = paper_equations.Motion(fine=fine, rigid=fine)
    found = [each for each in paper_equations.paper_types(case, {"arm": motion}) if each.quantity == "gain"]
    assert [each.value for each in found] == pytest.approx([2.0, 4.0])


def test_the_best_error_of_a_data_sheet_is_flexlinks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(data_sheets, "_timed", lambda measure, *_: (measure, 1.0))
    case = load_case(CASES / "physics_tip_mass.toml")
    sheet = dataclasses.replace(KINDS[case.kind], sheet={"native": 0.5, "mujoco": 0.1})
    monkeypatch.setitem(KINDS, case.kind, sheet)
    found = [each for each in data_sheets._sheet(case) if isinstance(each, Measured)]
    assert case.sheet is not None
    assert found[-1].value == pytest.approx(0.5 / case.sheet.accepted)


def test_an_error_is_divided_by_the_sum_of_its_parts() -> None:
    split = Split(3.0, 0.03, {"model": Part(1.0, 0.0), "space": Part(0.5, 0.1)}, 0.5)
    found = {each.quantity: each.value for each in speed_models._rows(ARM, "run", split)}
    whole, last = found["error / sum of parts"], found["own error / part"]
    assert (whole, last) == (1.5, 0.2)
