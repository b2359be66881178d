"""compare(): engines agree with the native dynamics, and a deviation is reported with its field and joint."""

import dataclasses
import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import ArgumentError
from flexlink.diagnosis.comparison import Comparison, compare
from flexlink.diagnosis.diagnosis import diagnose
from flexlink.diagnosis.mistakes import table
from flexlink.diagnosis.quantities import QUANTITIES, compare_engines, mixed_states, random_states
from flexlink.dynamics import rounding
from flexlink.engines import ENGINES, load
from tests.support.words import line, refused, refused_line, reviewed

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "models"
WRENCHED = "T_GC with tip wrench"


@pytest.fixture(scope="module")
def chain():
    return fl.lump(fl.load_scene(MODELS / "t3_spatial.toml"))


def against(chain, engine):
    """An engine compared with the native dynamics of the chain."""
    states = random_states(chain, 20)
    rows = compare_engines(chain, load("native", chain), [engine], states)
    return Comparison("scene", 20, (diagnose(chain, engine, rows, states),))


def with_defect(chain, array, field, k, change):
    """Compare the native dynamics of a chain before and after a change of one number."""
    edited = getattr(chain, array).copy()
    target = edited if field is None else edited[field]
    target[k] = change(target[k])
    return against(chain, load("native", dataclasses.replace(chain, **{array: edited})))


def failing(comparison):
    return {row.quantity for row in comparison.rows if not row.passed}


def with_stiffness(chain, k, factor):
    hinges = chain.hinges.copy()
    hinges["stiffness"][k] *= factor
    return dataclasses.replace(chain, hinges=hinges)


@pytest.mark.parametrize(("engine", "export"), [
    ("pinocchio", "to_urdf"), ("mujoco", "to_mjcf"), ("exudyn", "to_urdf"),
])  # fmt: skip
@pytest.mark.parametrize(("scene", "k"), [
    ("models/paper_fig5", 1), ("models/t3_spatial", 20), ("validation/scenes/princeton_beam", 17),
    ("validation/scenes/deep_beam", 0),
])  # fmt: skip
def test_a_stiffness_error_of_1e_9_in_an_engine_file_is_found(scene, k, engine, export, monkeypatch, capsys):
    pytest.importorskip(engine)
    module = importlib.import_module(ENGINES[engine].module)
    write = getattr(module, export)
    monkeypatch.setattr(module, export, lambda chain, **how: write(with_stiffness(chain, k, 1 + 1e-9), **how))
    path = ROOT / f"{scene}.toml"
    assert main(["compare", str(path), "--engines", engine, "--samples", "40"]) == 1
    name = fl.lump(fl.load_scene(path).varied({"motion": ()})).joint_name(k)
    finding = line(capsys.readouterr().out, "1. ", repr(name))
    reviewed("compare: stiffness 1e-9", finding, values=False)
    assert label("stiffness") in finding
    for part in ("N m/rad", " 1e-09", "T_FL"):
        assert part in finding


def label(field):
    """Readable name of a field of a record."""
    return table().fields[field].label


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_equilibrium_states_show_a_stiffness_error_in_the_acceleration_of_its_joint(chain, engine):
    balanced = [state for number, state in enumerate(mixed_states(chain, 80)) if number % 8 in {1, 5}]
    native = load("native", chain)
    for k in np.flatnonzero(chain.stiffness)[[0, 7, -1]]:
        wrong = load(engine, with_stiffness(chain, k, 1 + 1e-9))

        def errors(states, wrong=wrong):
            evaluate, of, _ = QUANTITIES["q̈"]
            return np.array([of(chain, s, evaluate(wrong, s), evaluate(native, s)) for s in states])

        error = errors(balanced)
        assert error.max() > 1e4
        assert error.max(axis=0).argmax() == k
        assert np.delete(error, k, axis=1).max() <= 1


@pytest.mark.parametrize("name", QUANTITIES)
def test_errors_pass_up_to_the_rounding_bound_of_each_quantity(name, chain):
    s, rest, native = random_states(chain, 1)[0], np.zeros(chain.n), load("native", chain)
    value = QUANTITIES[name].evaluate(native, s)
    explained = {
        "M": lambda: rounding.of_mass_matrix(chain, s.q),
        "T_G": lambda: rounding.of_bias_torque(chain, s.q, rest),
        "T_GC": lambda: rounding.of_bias_torque(chain, s.q, s.qd),
        "T_GC with tip wrench": lambda: rounding.of_bias_torque(chain, s.q, s.qd, tip_wrench=s.wrench),
        "T_FL": lambda: rounding.of_elastic_torque(chain, s.q),
        "T_FR": lambda: rounding.of_friction_torque(chain, s.qd),
        "q̈": lambda: np.linalg.solve(
            fl.mass_matrix(chain, s.q),
            rounding.of_residual(chain, s.q, s.qd, value, s.tau, tip_wrench=s.wrench) * np.eye(chain.n)[0],
        ),
    }[name]()
    half, twice = (QUANTITIES[name].error(chain, s, value + part * explained, value).max() for part in (0.5, 2.0))
    assert half <= 1 < twice


def test_accelerations_that_omit_the_tip_wrench_are_reported(chain):
    engine, native = load("native", chain), load("native", chain)
    engine.forward_dynamics = lambda q, qd, tau, **_: native.forward_dynamics(q, qd, tau)
    assert failing(against(chain, engine)) == {"q̈"}


def test_a_tip_frame_error_of_1_um_shows_only_under_a_tip_wrench(chain):
    bodies = chain.bodies.copy()
    bodies[-1]["translation"][1] += 1e-6
    comparison = against(chain, load("native", dataclasses.replace(chain, bodies=bodies)))
    assert failing(comparison) == {WRENCHED}
    assert WRENCHED in found(comparison, "tip frame")


def test_equal_comparisons_and_imports_are_equal(models: Path) -> None:
    """They contain arrays, which NumPy refuses to compare as a whole."""
    scene, robot = fl.load_scene(models / "paper_fig5.toml"), models.parent / "examples" / "reach_arm.urdf"
    makes = (
        lambda k: compare(scene, engines=["native"], samples=2 + k),
        lambda k: fl.import_urdf(robot, gravity=(0, 0, k)),
    )
    assert [(make(0) == make(0), make(0) == make(1)) for make in makes] == [(True, False)] * 2


def test_a_chain_agrees_with_itself_exactly(chain):
    comparison = against(chain, load("native", chain))
    assert {row.error for row in comparison.rows} == {0.0}
    assert comparison.passed
    reviewed("compare: agreement", comparison.diagnosis)
    assert comparison.diagnosis.startswith("native: ")
    assert str(len(QUANTITIES)) in comparison.diagnosis
    lines = str(comparison).splitlines()
    reviewed("compare: heading", "\n".join(lines[:2]))
    assert [row.split()[0] for row in lines[2:]] == ["native"] * len(QUANTITIES) + ["native:"]
    assert lines[-1] == comparison.diagnosis


def found(comparison, key):
    """Text of the only finding, which must explain all differences and match the reviewed file."""
    (diagnosis,) = comparison.diagnoses
    assert diagnosis.explained
    (finding,) = diagnosis.findings
    assert set(finding.affects) == failing(comparison)
    reviewed(f"compare: {key}", str(finding))
    return str(finding)


DEFECTS = {
    "doubled damping": ("damping", lambda c: c.index(2, 2, 3), lambda d: 2 * d, {"T_FR", "q̈"}, r"N m.* 2\b"),
    "Coulomb friction": ("coulomb", lambda c: int(c.active[1]), lambda x: x + 0.25, {"T_FR", "q̈"}, r": 0\.75 .* 0\.5 "),
    "rest angle": ("rest", lambda c: c.index(3, 1, 2), lambda r: r + 0.01, {"T_FL", "q̈"}, r": 0\.01 .* 0 rad"),
    "stiffness": ("stiffness", lambda c: c.index(3, 1, 2), lambda s: 1.1 * s, {"T_FL", "q̈"}, r" 1\.1\b(?! )"),
    "armature": ("armature", lambda c: int(c.active[-1]), lambda a: a + 0.02, {"M", "q̈"}, ""),
    "masses": ("mass", lambda c: 3, lambda m: 1.01 * m, {"M", "T_G", "T_GC", WRENCHED, "q̈"}, ""),
    "inertias": ("inertia", lambda c: 3, lambda I: 1.01 * I, {"M", "T_GC", WRENCHED, "q̈"}, ""),
}  # fmt: skip
"""A field, the joint or body concerned, a change, the quantities that differ, and a part of the finding."""


@pytest.mark.parametrize("what", DEFECTS)
def test_one_wrong_number_is_named_with_its_field_and_joint(what, chain):
    field, of, change, differing, shown = DEFECTS[what]
    k, array = of(chain), "bodies" if what in ("masses", "inertias") else "hinges"
    comparison = with_defect(chain, array, field, k, change)
    assert failing(comparison) == differing
    finding = found(comparison, what)
    joint = k if array == "hinges" else int(chain.bodies["stop"][k]) - 1
    named = label(what if array == "bodies" else field)
    assert finding.startswith(f"{named} of joint {chain.joint_name(joint)!r}: ") and re.search(shown, finding)


def test_a_gravity_error_is_reported_as_gravity(chain):
    comparison = with_defect(chain, "gravity", None, 2, lambda g: 1.001 * g)
    assert failing(comparison) == {"T_G", "T_GC", WRENCHED, "q̈"}
    finding = found(comparison, "gravity")
    assert finding.startswith(f"{label('gravity')}: (0, 0, 9.81981) ")
    assert " (0, 0, 9.81) m/s²" in finding
    assert re.search(r" 1\.001\b", finding)


def test_an_engine_that_computes_differently_from_the_same_record_is_reported(chain):
    engine, native = load("native", chain), load("native", chain)
    engine.friction_torque = lambda qd: 2 * native.friction_torque(qd)
    comparison = against(chain, engine)
    (diagnosis,) = comparison.diagnoses
    assert diagnosis.findings == () and diagnosis.explained is False
    worst = max(comparison.rows, key=lambda row: row.error)
    conclusion = line(str(diagnosis), repr(worst.joint))
    reviewed("compare: unexplained", conclusion)
    assert f" {worst.quantity} " in conclusion


@pytest.mark.parametrize("number", [0, 7, 19])
def test_a_single_state_that_is_not_finite_fails_the_comparison(number, chain):
    engine, calls = load("native", chain), []

    def friction_torque(qd):
        calls.append(qd)
        torque = fl.friction_torque(chain, qd)
        torque[2] *= np.nan if len(calls) == number + 1 else 1.0
        return torque

    engine.friction_torque = friction_torque
    comparison = against(chain, engine)
    assert failing(comparison) == {"T_FR"}
    conclusion = line(comparison.diagnosis, repr(chain.joint_name(2)))
    reviewed("compare: not finite", conclusion)
    assert "T_FR" in conclusion


def test_a_long_comparison_reports_its_progress():
    parts = []
    compare(fl.load_scene(MODELS / "paper_fig5.toml"), engines=("pinocchio",), samples=30, progress=parts.append)
    assert parts == sorted(parts) and parts[0] == pytest.approx(1 / 30) and parts[-1] == 1


@pytest.mark.parametrize(("arguments", "id"), [
    ({"samples": 0}, "out-of-range"),
    ({"samples": 99999999999}, "out-of-range"),
    ({"engines": ("bullet",)}, "unknown-name"),
])  # fmt: skip
def test_bad_arguments_are_refused_by_name(arguments, id):
    with refused(ArgumentError, id):
        compare(fl.load_scene(MODELS / "paper_fig5.toml"), **arguments)


def test_compare_goes_on_with_the_engines_that_can_load_the_arm_and_shows_why_another_cannot(tmp_path, capsys):
    path = tmp_path / "speck.toml"
    path.write_text(SPECK)
    assert main(["compare", str(path), "--engines", "pinocchio", "mujoco"]) == 2
    refusal = refused_line(capsys.readouterr().err, "engine-cannot-load")
    assert "MuJoCo" in refusal
    found = compare(fl.load_scene(path), samples=20)
    assert found.passed
    assert [diagnosis.engine for diagnosis in found.diagnoses] == ["pinocchio"]
    assert main(["compare", str(path), "--samples", "20"]) == 0
    assert line(capsys.readouterr().out, "not compared: ") == f"not compared: {found.refused[0]}"
    reviewed("compare: refused", found.refused[0])
    assert found.refused[0].partition(":")[0] == "mujoco"
    assert main(["compare", str(path), "--samples", "20", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["refused"] == [*found.refused]


SPECK = """
name = "speck"
[[link]]
name = "rod"
length = 1e-6
[tip]
mass = 1e-9
[initial]
joint_deg = [0.0]
"""
