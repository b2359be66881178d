"""compare(): engines agree with the native dynamics, and where one does not, it says what and where."""

import dataclasses
import importlib
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.errors import ArgumentError
from flexlink.diagnosis.comparison import MAX_SAMPLES, Comparison, compare
from flexlink.diagnosis.diagnosis import diagnose
from flexlink.diagnosis.quantities import QUANTITIES, compare_engines
from flexlink.diagnosis.states import mixed_states, random_states
from flexlink.dynamics import rounding
from flexlink.engines import ENGINES, load
from tests.words import refused

ROOT = Path(__file__).parent.parent
MODELS = ROOT / "models"


@pytest.fixture(scope="module")
def chain():
    return fl.lump(fl.load_scene(MODELS / "t3_spatial.toml"))


def against(chain, engine):
    """An engine compared with the native dynamics of the chain."""
    states = random_states(chain, 20)
    rows = compare_engines(chain, load("native", chain), [engine], states)
    return Comparison("scene", 20, (diagnose(chain, engine, rows, states),))


def with_defect(chain, array, field, k, change):
    """The native dynamics of a chain with one number changed, compared with those of the chain."""
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
def test_a_stiffness_wrong_by_1e_9_in_an_engine_s_file_is_found(scene, k, engine, export, monkeypatch, capsys):
    pytest.importorskip(engine)
    module = importlib.import_module(ENGINES[engine].module)
    write = getattr(module, export)
    monkeypatch.setattr(module, export, lambda chain, **how: write(with_stiffness(chain, k, 1 + 1e-9), **how))
    path = ROOT / f"{scene}.toml"
    assert main(["compare", str(path), "--engines", engine, "--samples", "40"]) == 1
    told = capsys.readouterr().out
    name = fl.lump(fl.load_scene(path).varied({"motion": ()})).joint_name(k)
    assert f"1. spring stiffness of joint {name!r}: " in told
    assert "N m/rad, relative error 1e-09: another value; affects T_FL" in told


@pytest.mark.parametrize("engine", ["pinocchio", "mujoco"])
def test_balanced_states_show_it_in_the_accelerations_and_at_the_right_joint(chain, engine):
    balanced = [state for number, state in enumerate(mixed_states(chain, 80)) if number % 8 in {1, 5}]
    native = load("native", chain)
    for k in np.flatnonzero(chain.stiffness)[[0, 7, -1]]:
        wrong = load(engine, with_stiffness(chain, k, 1 + 1e-9))

        def errors(states, wrong=wrong):
            evaluate, of = QUANTITIES["q̈"]
            return np.array([of(chain, s, evaluate(wrong, s), evaluate(native, s)) for s in states])

        error = errors(balanced)
        assert error.max() > 1e4
        assert error.max(axis=0).argmax() == k
        assert np.delete(error, k, axis=1).max() <= 1


@pytest.mark.parametrize("name", QUANTITIES)
def test_of_every_quantity_half_of_what_rounding_explains_passes_and_twice_does_not(name, chain):
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


def test_accelerations_without_the_tip_wrench_show(chain):
    engine, native = load("native", chain), load("native", chain)
    engine.forward_dynamics = lambda q, qd, tau, **_: native.forward_dynamics(q, qd, tau)
    assert failing(against(chain, engine)) == {"q̈"}


def test_a_tip_frame_a_micrometre_off_shows_under_a_tip_wrench_only(chain):
    bodies = chain.bodies.copy()
    bodies[-1]["translation"][1] += 1e-6
    comparison = against(chain, load("native", dataclasses.replace(chain, bodies=bodies)))
    assert failing(comparison) == {"T_GC with tip wrench"}
    assert "the tip frame is misplaced; affects T_GC with tip wrench" in comparison.diagnosis


def test_a_chain_agrees_with_itself_exactly(chain):
    comparison = against(chain, load("native", chain))
    assert {row.error for row in comparison.rows} == {0.0}
    assert comparison.diagnosis == "native: all 7 quantities agree"


def found(comparison):
    """The one finding, which explains all that differs."""
    (diagnosis,) = comparison.diagnoses
    assert diagnosis.explained
    (finding,) = diagnosis.findings
    assert set(finding.affects) == failing(comparison)
    return str(finding)


def test_doubled_damping_is_named_with_its_joint_and_factor(chain):
    k = chain.index(2, 2, 3)
    comparison = with_defect(chain, "hinges", "damping", k, lambda d: 2 * d)
    assert failing(comparison) == {"T_FR", "q̈"}
    assert f"damping of joint '{chain.joint_name(k)}': " in found(comparison)
    assert ", factor 2: doubled or halved" in found(comparison)


def test_coulomb_friction_is_told_from_damping(chain):
    k = int(chain.active[1])
    comparison = with_defect(chain, "hinges", "coulomb", k, lambda c: c + 0.25)
    c = chain.hinges["coulomb"][k]
    assert f"Coulomb torque of joint '{chain.joint_name(k)}': {c + 0.25:g} instead of {c:g} N m" in found(comparison)


def test_a_rest_angle_is_told_from_a_stiffness(chain):
    k = chain.index(3, 1, 2)
    rest = with_defect(chain, "hinges", "rest", k, lambda r: r + 0.01)
    stiff = with_defect(chain, "hinges", "stiffness", k, lambda s: 1.1 * s)
    assert failing(rest) == failing(stiff) == {"T_FL", "q̈"}
    assert f"rest angle of joint '{chain.joint_name(k)}': 0.01 instead of 0 rad" in found(rest)
    assert f"spring stiffness of joint '{chain.joint_name(k)}'" in found(stiff)
    assert "factor 1.1:" in found(stiff)


def test_an_armature_is_told_from_an_inertia_and_a_mass(chain):
    k, b = int(chain.active[-1]), 3
    armature = with_defect(chain, "hinges", "armature", k, lambda a: a + 0.02)
    mass = with_defect(chain, "bodies", "mass", b, lambda m: 1.01 * m)
    inertia = with_defect(chain, "bodies", "inertia", b, lambda I: 1.01 * I)
    behind = chain.joint_name(int(chain.bodies["stop"][b]) - 1)
    assert f"armature of joint '{chain.joint_name(k)}': " in found(armature)
    assert f"mass of joint '{behind}': " in found(mass)
    assert f"inertia of joint '{behind}': " in found(inertia)


def test_gravity_alone_is_named_as_gravity(chain):
    comparison = with_defect(chain, "gravity", None, 2, lambda g: 1.001 * g)
    assert failing(comparison) == {"T_G", "T_GC", "T_GC with tip wrench", "q̈"}
    assert "gravity: (0, 0, 9.81981) instead of (0, 0, 9.81) m/s², factor 1.001: another value of g" in found(
        comparison
    )


def test_an_engine_that_computes_otherwise_what_it_has_read_right_is_told_so(chain):
    engine, native = load("native", chain), load("native", chain)
    engine.friction_torque = lambda qd: 2 * native.friction_torque(qd)
    (diagnosis,) = against(chain, engine).diagnoses
    assert diagnosis.findings == () and diagnosis.explained is False
    assert "What the engine has read does not explain all differences; the largest is in T_FR at joint" in str(
        diagnosis
    )
    assert ": the engine computes it differently, or something else acts" in str(diagnosis)


def test_numbers_that_are_not_finite_never_pass(chain):
    engine = load("native", chain)
    engine.friction_torque = lambda qd: np.where(np.arange(len(qd)) == 2, np.nan, qd)
    comparison = against(chain, engine)
    assert failing(comparison) == {"T_FR"}
    told = f"T_FR: the engine returns numbers that are not finite, first at joint '{chain.joint_name(2)}'"
    assert told in comparison.diagnosis


@pytest.mark.parametrize("number", [0, 7, 19])
def test_one_state_of_many_that_is_not_finite_does_not_pass(number, chain):
    engine, asked = load("native", chain), []

    def friction_torque(qd):
        asked.append(qd)
        return (np.nan if len(asked) == number + 1 else 1.0) * fl.friction_torque(chain, qd)

    engine.friction_torque = friction_torque
    assert failing(against(chain, engine)) == {"T_FR"}


def test_the_table_reads_alike_in_every_row(chain):
    table = str(against(chain, load("native", chain)))
    first, head, *rows = table.splitlines()
    assert "difference from flexlink / rounding bound, equal if ≤ 1" in first
    assert "difference / bound" in head
    assert [row.split()[0] for row in rows] == ["native"] * len(QUANTITIES) + ["native:"]
    assert table.endswith("all 7 quantities agree")


def test_a_long_comparison_tells_how_far_it_is():
    told = []
    compare(fl.load_scene(MODELS / "paper_fig5.toml"), engines=("pinocchio",), samples=30, progress=told.append)
    assert told == sorted(told) and told[0] == pytest.approx(1 / 30) and told[-1] == 1


@pytest.mark.parametrize(("arguments", "message"), [
    ({"samples": 0}, "out-of-range"),
    ({"samples": 99999999999}, "out-of-range"),
    ({"engines": ("bullet",)}, "unknown-name"),
])  # fmt: skip
def test_bad_arguments_are_named(arguments, message):
    with refused(ArgumentError, message):
        compare(fl.load_scene(MODELS / "paper_fig5.toml"), **arguments)


def test_an_absurd_number_of_samples_is_refused_in_one_line(capsys):
    assert main(["compare", str(MODELS / "paper_fig5.toml"), "--samples", "99999999999"]) == 2
    assert capsys.readouterr().err.endswith(f"1 … {MAX_SAMPLES}\n")


def test_an_arm_that_an_engine_cannot_hold_is_named_in_one_line(tmp_path, capsys):
    path = tmp_path / "speck.toml"
    path.write_text(SPECK)
    assert main(["compare", str(path)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "MuJoCo" in told
    assert main(["compare", str(path), "--engines", "pinocchio", "--samples", "20"]) == 0


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
