"""The physics cases: sweeps, benchmark scenes, inputs, references, runs in MuJoCo, and findings of the report."""

import re

import msgspec
import numpy as np
import pytest

import flexlink as fl
from flexlink.common.errors import DataFileError, SceneError
from flexlink.describe.spec import decode
from flexlink.kernels.inputs.drive_torque import drive_torque
from flexlink.motion.inputs.drives import drive_arrays
from reports.findings.physics import physics_choice, physics_price
from reports.results import Results
from tests.conftest import ROOT
from tests.support.words import refused, reviewed
from validation import reference_values
from validation.case import STUDY_SCENES, load_cases
from validation.facts import in_words
from validation.kinds import KINDS, validity
from validation.physics import formulas
from validation.physics.hinge_sweep import Need, Point, Sweep, order, report
from validation.physics.variant import Rule, Variant, existing
from validation.store import Environment, Series, Store
from validation.tests import studies

NEEDED, NOT_ENOUGH, FEWEST = "hinges needed", "hinges not enough", "fewest hinges: need"
MARGIN = "order − lower bound"
CLAMPED, FREE_JOINT = "clamped, mode 1 within 1 %", "free joint, mode 1 within 1 %"
CASES = {case.name: case for case in load_cases("physics_*")}
SCENES = sorted(path.stem for path in STUDY_SCENES.glob("*.toml"))
SOURCES = [path for folder in ("validation/cases", "validation/kinds", "validation/physics") for path in
           sorted((ROOT / folder).glob("*.*")) if path.suffix in {".toml", ".py"}]  # fmt: skip


def rows(sweep, errors):
    points = [
        Point(Rule(rule=rule, hinges=n), e if isinstance(e, dict) else {"tip": e})
        for rule, found in errors.items()
        for n, e in found.items()
    ]
    found = list(report(sweep, points, "about"))
    return {(m.quantity, in_words(m.varied)): m.value for m in found if not isinstance(m, Series)}


@pytest.mark.parametrize("power", [1, 2, 4])
def test_the_fitted_order_of_a_power_law_is_its_exponent(power):
    assert order({n: 3.0 * n**-power for n in (5, 7, 12)}) == pytest.approx(power, rel=1e-12)


def test_the_hinges_needed_are_the_fewest_beyond_which_the_error_stays_small():
    errors = {"lucky": {2: 0.5, 3: 0.001, 4: 0.3, 5: 0.001, 6: 0.0005}, "poor": {2: 0.5, 9: 0.2}}
    found = rows(Sweep(rules={}, needs=(Need(name="need", measures=("tip",), within=0.01),)), errors)
    assert found[NEEDED, "lucky, need"] == 5  # 3 hinges meet the allowed error only by chance
    assert found[NOT_ENOUGH, "poor, need"] == 9
    assert found[FEWEST, ""] == 5


@pytest.mark.parametrize("measures", [("tip", "angle"), ("angle", "tip")])
def test_a_requirement_is_met_if_the_worst_of_its_measures_is_small(measures: tuple[str, ...]) -> None:
    errors = {3: {"tip": 0.001, "angle": 0.5}, 4: {"tip": 0.02, "angle": 0.001}, 5: {"tip": 0.001, "angle": 0.009}}
    found = rows(Sweep(rules={}, needs=(Need(name="need", measures=measures, within=0.01),)), {"gauss": errors})
    assert found[NEEDED, "gauss, need"] == found[FEWEST, ""] == 5


def test_a_fitted_order_ignores_rounding_errors_and_accidentally_small_errors():
    lucky = {4: 4**-4.0, 8: 1e-9, 16: 16**-4.0, 32: 32**-4.0, 64: 1e-13, 128: 3e-13}  # at 8 the error changes sign
    sweep = Sweep(rules={}, least={"tip": {"lobatto4": 3.8}}, rounding={"tip": 1e-12}, fitted=4)
    found = rows(sweep, {"lobatto4": lucky})
    assert found["fitted order", "lobatto4, tip"] == pytest.approx(4)
    assert found[MARGIN, "lobatto4, tip"] == pytest.approx(0.2)
    with_all = rows(Sweep(rules={}, fitted=6), {"lobatto4": lucky})
    assert abs(with_all["fitted order", "lobatto4, tip"] - 4) > 1
    with refused(DataFileError, "test-physics-cases"):
        rows(sweep, {"lobatto4": {64: 1e-13, 128: 3e-13}})


@pytest.mark.parametrize("name", SCENES)
def test_every_benchmark_scene_has_the_name_of_its_file_and_is_used(name):
    assert fl.load_scene(STUDY_SCENES / f"{name}.toml").name == name
    assert any(
        name in case.scenes or f'"scene":"{name}"' in msgspec.json.encode(case).decode() for case in load_cases("*")
    )


@pytest.mark.parametrize("path", sorted(reference_values.REFERENCE_FOLDER.glob("*.json")), ids=lambda path: path.stem)
def test_every_reference_file_is_used(path):
    assert any(path.stem in source.read_text(encoding="utf-8") for source in SOURCES)


DEVICES = {
    "constant_damping", "rigidity_tables", "satellite", "saturation", "sensor_readings", "step_response",
    "without_length",
}  # fmt: skip
"""Kinds of cases that no other engine can run; independent references check them instead."""


@pytest.mark.parametrize(
    "name", sorted(name for name, case in CASES.items() if case.kind not in DEVICES | {"finite_chains"})
)
def test_every_benchmark_also_runs_in_mujoco(name):
    quantities = [q for key, q in CASES[name].quantity.items() if key.startswith("MuJoCo")]
    assert quantities
    assert all(q.tolerance is not None for q in quantities)


def test_a_variant_divides_every_flexible_link_by_the_rule():
    case = CASES["physics_two_links"]
    arm = Variant().build(case, Rule(rule="gauss", hinges=6)).arm
    assert [(link.lumping, link.segments) for link in arm.links] == [("gauss", 7)] * 2
    assert list(existing(case, {"gauss": (5,)})) == []
    with refused(fl.errors.ArgumentError, "unknown-name"):
        list(existing(case, {"none such": (6,)}))
    with refused(SceneError, "cannot-set"):
        list(existing(case, {"gauss": (6,)}, [Variant(change={"tip.mas": 1.0})]))
    with refused(fl.errors.ArgumentError, "unknown-name"):
        Variant(scene="none such").build(case, Rule(rule="gauss", hinges=6))


@pytest.mark.parametrize(("name", "key"), [("physics_spin_up", "input"), ("physics_elastica", "loads")])
def test_an_unknown_input_or_load_is_refused(name, key):
    case = CASES[name]
    kind = KINDS[case.kind]
    with refused(fl.errors.ArgumentError, "unknown-name"):
        list(kind.run(case, decode(case.settings | {key: "none such"}, kind.settings)))


@pytest.mark.parametrize("keys", [("no_such_file",), ("critical_loads", "no such key")])
def test_an_unknown_reference_is_refused(keys):
    with refused(DataFileError, "test-physics-cases"):
        reference_values.look_up(*keys)


def test_the_torque_pulse_matches_its_formula_to_2_micronewton_metres():
    scene = formulas.torque_pulse(fl.load_scene(STUDY_SCENES / "torque_pulse.toml"))
    chain = fl.lump(scene)
    drive, q, tau = drive_arrays(scene, chain), np.zeros(chain.n), np.zeros(chain.n)
    for t in np.linspace(0, 2, 777):
        drive_torque(drive, t, t, q, q, tau)
        exact = 4 * np.sin(2 * np.pi * t / 1.2) ** 3 if t < 1.2 else 0.0
        assert tau[0] == pytest.approx(exact, abs=2e-6)


def row(quantity, value, **varied):
    return studies.row("physics_x", value, None, kind="frequencies", varied=varied, quantity=quantity, scene="")


def test_the_choice_of_rules_is_computed_from_the_rows(tmp_path):
    stored = (
        row(NEEDED, 4.0, rule="gauss", need=CLAMPED),
        row(NOT_ENOUGH, 100.0, rule="paper", need=CLAMPED),
        row(NEEDED, 4.0, rule="paper", need=FREE_JOINT),
        row(NEEDED, 6.0, rule="gauss", need=FREE_JOINT),
        row("stable step of RK4", 3e-3, rule="gauss", hinges=10),
        row("stable step of RK4", 5e-4, rule="legendre", hinges=10),
    )
    (finding,) = physics_choice(Results(stored, Environment(), Store(tmp_path)))
    numbers = {text: re.findall(r"(?<![\w.])\d+", text) for text in finding.sentences}
    (gauss,) = (text for text in numbers if "gauss" in text and "legendre" not in text)
    assert numbers[gauss] == ["2", "2", "6"]
    (enough,) = (text for text in numbers if f"{FREE_JOINT} (4)" in text)
    assert CLAMPED not in enough
    assert ["1", "2"] in numbers.values()  # accuracies that the paper's layout does not reach
    (steps,) = (text for text in numbers if "legendre" in text)
    assert "6" in numbers[steps]
    reviewed("physics cases: choice of rules", "\n".join(finding.sentences))
    assert finding.lines[0][1] == "> 100"


def test_a_requirement_on_which_the_papers_layout_was_not_tried_does_not_count_as_missed(tmp_path):
    untried = (row(NEEDED, 4.0, rule="gauss", need=need) for need in (FREE_JOINT, "tip"))
    stored = (row(NOT_ENOUGH, 100.0, rule="paper", need=CLAMPED), *untried)
    (finding,) = physics_choice(Results(stored, Environment(), Store(tmp_path)))
    assert ["1", "3"] in [re.findall(r"\d+", text) for text in finding.sentences]


def test_stable_steps_of_other_cases_are_not_used_as_costs_of_rules(tmp_path):
    stored = (
        row("stable step of RK4", 3e-3, rule="gauss", hinges=10),
        row("stable step of RK4", 5e-4, rule="legendre", hinges=10),
        row("stable step", 1.5, method="RK10"),
    )
    (finding,) = physics_price(Results(stored, Environment(), Store(tmp_path)))
    assert [line[0] for line in finding.lines] == ["gauss", "legendre"]
    (text,) = finding.sentences
    assert re.findall(r"\d+", text.partition("legendre")[2]) == ["6"]
    reviewed("physics cases: price of rules", text)


def test_a_crossing_is_interpolated_and_nan_if_there_is_none():
    assert validity._crossing(np.array([0.0, 1.0, 2.0]), [0.0, 0.2, 0.6], 0.4) == pytest.approx(1.5)
    assert np.isnan(validity._crossing(np.array([0.0, 1.0]), [0.0, 0.2], 0.4))
