"""compare(): engines agree with the native dynamics, and where one does not, it says what and where."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.compare import QUANTITIES, Comparison, compare, compare_engines, random_states
from flexlink.engines import load
from flexlink.errors import ArgumentError

MODELS = Path(__file__).parent.parent / "models"
SCENES = ["paper_fig5", "paper_fig5_raised", "t2_spatial", "t3_spatial"]


@pytest.fixture(scope="module")
def chain():
    return fl.load_scene(MODELS / "t3_spatial.toml").chain()


def against(chain, engine):
    """An engine compared with the native dynamics of the chain."""
    rows = compare_engines(chain, load("native", chain), [engine], random_states(chain, 20))
    return Comparison("scene", 20, rows)


def with_defect(chain, array, field, k, change):
    """The native dynamics of a chain with one number changed, compared with those of the chain."""
    edited = getattr(chain, array).copy()
    target = edited if field is None else edited[field]
    target[k] = change(target[k])
    return against(chain, load("native", dataclasses.replace(chain, **{array: edited})))


def failing(comparison):
    return {row.quantity for row in comparison.rows if not row.passed}


@pytest.mark.parametrize("name", SCENES)
def test_all_engines_agree_on_every_term_of_every_scene(name):
    comparison = compare(fl.load_scene(MODELS / f"{name}.toml"), samples=200)
    assert comparison.passed, str(comparison)
    assert {(row.engine, row.quantity) for row in comparison.rows} == {
        (engine, quantity) for engine in ("pinocchio", "mujoco") for quantity in QUANTITIES
    }


def test_a_chain_agrees_with_itself_exactly(chain):
    comparison = against(chain, load("native", chain))
    assert {row.error for row in comparison.rows} == {0.0}
    assert comparison.diagnosis == "native: all 7 quantities agree"


def test_doubled_damping_is_named_with_its_joint_and_factor(chain):
    k = chain.index(2, 2, 3)
    comparison = with_defect(chain, "hinges", "damping", k, lambda d: 2 * d)
    assert failing(comparison) == {"T_FR", "q̈"}
    assert f"T_FR differs: at joint '{chain.joint_name(k)}' by damping d" in comparison.diagnosis
    assert "(factor 2)" in comparison.diagnosis
    assert "q̈ differ with it" in comparison.diagnosis


def test_coulomb_friction_is_told_from_damping(chain):
    k = int(chain.active[1])
    comparison = with_defect(chain, "hinges", "coulomb", k, lambda c: c + 0.25)
    assert f"at joint '{chain.joint_name(k)}' by Coulomb torque c +0.25" in comparison.diagnosis


def test_a_rest_angle_is_told_from_a_stiffness(chain):
    k = chain.index(3, 1, 2)
    rest = with_defect(chain, "hinges", "rest", k, lambda r: r + 0.01)
    stiff = with_defect(chain, "hinges", "stiffness", k, lambda s: 1.1 * s)
    assert failing(rest) == failing(stiff) == {"T_FL", "q̈"}
    assert "by offset −k·rest -" in rest.diagnosis
    assert "by stiffness k +" in stiff.diagnosis
    assert "(factor 1.1)" in stiff.diagnosis


def test_an_armature_is_told_from_an_inertia(chain):
    k = int(chain.active[-1])
    armature = with_defect(chain, "hinges", "armature", k, lambda a: a + 0.02)
    mass = with_defect(chain, "bodies", "mass", 3, lambda m: 1.01 * m)
    assert f"at joint '{chain.joint_name(k)}' by a constant +0.02 kg m² on the diagonal: armature" in armature.diagnosis
    assert "M differs" in mass.diagnosis
    assert "armature" not in mass.diagnosis.replace("placements or armature", "")


def test_gravity_alone_is_named_as_gravity(chain):
    comparison = with_defect(chain, "gravity", None, 2, lambda g: 1.001 * g)
    assert failing(comparison) >= {"T_G", "T_GC"}
    assert "M" not in failing(comparison)
    assert "look at gravity" in comparison.diagnosis


def test_numbers_that_are_not_finite_never_pass(chain):
    engine = load("native", chain)
    engine.friction_torque = lambda qd: np.where(np.arange(len(qd)) == 2, np.nan, qd)
    comparison = against(chain, engine)
    assert failing(comparison) == {"T_FR"}
    assert f"at joint '{chain.joint_name(2)}' the engine returns numbers that are not finite" in comparison.diagnosis


def test_the_table_shows_every_row_and_the_diagnosis(chain):
    text = str(against(chain, load("native", chain)))
    assert all(quantity in text for quantity in QUANTITIES)
    assert text.endswith("all 7 quantities agree")


def test_states_cover_the_full_range_and_repeat_with_the_seed(chain):
    states = random_states(chain, 200, seed=3)
    q, qd = np.array([s.q for s in states]), np.array([s.qd for s in states])
    assert -np.pi < q.min() < -3.1 and 3.1 < q.max() < np.pi
    assert -10 < qd.min() < -9.9 and 9.9 < qd.max() < 10
    assert np.array_equal(q, [s.q for s in random_states(chain, 200, seed=3)])
    passive = np.setdiff1d(np.arange(chain.n), chain.active)
    assert all(not s.tau[passive].any() and s.tau[chain.active].all() for s in states)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"samples": 0}, "samples = 0: must be at least 1"),
    ({"engines": ("bullet",)}, "engine = 'bullet': unknown"),
])  # fmt: skip
def test_bad_arguments_are_named(arguments, message):
    with pytest.raises(ArgumentError, match=message):
        compare(fl.load_scene(MODELS / "paper_fig5.toml"), **arguments)
