"""The independent references of the study agree with textbooks and with each other."""

from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf

import flexlink as fl
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.vibration.stability_function import stability_function
from reports.findings import oracles
from tests.support.words import refused
from validation.kinds.drifts import modal_loss, released_modes
from validation.oracles import exact_runge_kutta, rooted_trees
from validation.oracles.common_origin import of_state
from validation.oracles.planar_chain import DIGITS, PlanarChain, joint_torques
from validation.oracles.spatial_chain import SpatialChain, exactly

ROOT = Path(__file__).parents[2]


def test_spatial_vectors_about_one_point_agree_with_projected_newton_euler(rng):
    """These two references share no recursion; rounded to float64, they differ by one rounding at most."""
    arm = fl.load_scene(ROOT / "models" / "t3_spatial.toml").varied({"link.*.segments": 2})
    chain = fl.lump(arm)
    q, qd, tau = rng.normal(size=(3, chain.n))
    found, judge = of_state(chain, q, qd, tau), SpatialChain(chain)
    with mp.workdps(2 * DIGITS):
        M, bias = judge.equations(exactly(q), exactly(qd))
        qdd = judge.forward_dynamics(exactly(q), exactly(qd), exactly(tau))
        for name, exact in (("M", M.tolist()), ("T_GC", bias), ("q̈", qdd)):
            np.testing.assert_array_max_ulp(found[name], np.array(exact, dtype=float), 1)


def test_a_body_with_inertia_but_without_mass_counts() -> None:
    """A flywheel on a bar without mass: I θ̈ = τ."""
    payload = fl.RigidBody(inertia=(0.1, 0.2, 0.25))
    bar = fl.Link(name="bar", length=1.0)
    scene = fl.Scene(name="flywheel", arm=fl.Arm(links=(bar,), tip=payload), run=fl.RunSettings(step=1e-3))
    found = of_state(fl.lump(scene), np.array([0.5]), np.array([2.0]), np.array([3.0]))
    assert {name: value.ravel() for name, value in found.items()} == {"M": [0.25], "T_GC": [0.0], "q̈": [3.0 / 0.25]}


def test_springs_dampers_and_friction_of_joints_are_those_of_a_hand_calculation() -> None:
    springs = {"stiffness": 10.0, "rest": 0.2, "damping": 3.0}
    rubbing, smooth = {"coulomb": 2.0, "coulomb_width": 0.1}, {"coulomb": 0.0, "coulomb_width": 0.0}
    found = joint_torques([springs | rubbing, springs | smooth], [mpf(0.5), mpf(0.2)], [mpf(-0.1), mpf(0.0)])
    assert [float(x) for x in found] == pytest.approx([10 * 0.3 - 3 * 0.1 - 2 * np.tanh(1), 0.0])


def test_the_embedded_method_of_order_3_of_dop853_has_the_published_weights() -> None:
    """bhh of Hairer's code, at stages 1, 9 and 12; the others are zero."""
    A, b = rooted_trees.embedded(method("DOP853"), 1)
    published = np.zeros(13)
    published[[0, 8, 11]] = 0.244094488188976377952755905512, 0.733846688281611857341361741547, 3 / 136
    assert np.array(b, dtype=float) == pytest.approx(published, abs=1e-16)
    assert [float(sum(row)) for row in A[-2:]] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("name", ["RK4", "DOP853", "Gauss4", "Radau5", "Radau9"])
def test_runge_kutta_in_many_digits_multiplies_an_oscillator_by_the_stability_function(name):
    """For q̈ = −q, every step of an explicit or implicit method multiplies q + i q̇ by R(−ih)."""
    with mp.workdps(DIGITS):
        q, p = exact_runge_kutta.integrate(lambda q, _: [-q[0]], method(name), ([mpf(1)], [mpf(0)]), mpf("0.5"), 1)
    R = complex(stability_function(method(name), np.array([-0.5j]))[0])
    assert float(q[0]) == pytest.approx(R.real, abs=1e-14)
    assert float(p[0]) == pytest.approx(R.imag, abs=1e-14)


def test_stages_that_do_not_converge_raise_an_error():
    with mp.workdps(DIGITS), refused(ArithmeticError, "test-oracles"):
        exact_runge_kutta.integrate(lambda q, _: [-q[0]], method("Radau5"), ([mpf(1)], [mpf(0)]), mpf(50), 1)


def test_the_50_digit_chain_refuses_axes_that_are_not_parallel():
    chain = fl.lump(fl.load_scene(ROOT / "models" / "t2_spatial.toml"))
    with refused(fl.errors.ArgumentError, "test-oracles"):
        PlanarChain(chain)


DATA = ("flexlink.chain.chain", "flexlink.describe.schemes.methods")
"""Modules that references may import; they contain only numbers of a chain and coefficients of a method."""


def test_every_independent_reference_is_listed_and_imports_no_algorithm_of_the_library() -> None:
    judges = oracles.judges()
    files = {path.stem for path in oracles.ORACLES.glob("*.py")} - {"__init__"}
    assert {file for judge in judges for file in judge.files} == files
    for judge in judges:
        assert set(judge.imports) <= set(DATA), judge.name


@pytest.mark.parametrize("how", ["from validation.oracles import inner", "from validation.oracles.inner import x"])
def test_indirect_imports_are_found(how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in (("outer", how), ("inner", "from flexlink.chain.chain import Chain")):
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    monkeypatch.setattr(oracles, "ORACLES", tmp_path)
    assert oracles.imports_of("outer") == {DATA[0]}


def test_predicted_energy_loss_of_an_oscillator_follows_from_the_stability_function():
    ω, h, steps = 700.0, 1e-3, 200  # ω h = 0.7
    A, b, _ = method("RK4").arrays
    z = 1j * ω * h
    R = 1 + z * b @ np.linalg.solve(np.eye(4) - z * A, np.ones(4))
    assert modal_loss("RK4", np.array([ω * h]), np.array([2.0]), steps) == pytest.approx(2 * (1 - abs(R) ** 400))


def test_the_release_of_a_straight_arm_gives_its_modes_the_energy_of_the_static_bend():
    """With all joints locked, the mode energies add up to the spring energy at static deflection, ½ T_G·K⁻¹·T_G."""
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"link.*.joint.locked": True})
    chain = fl.lump(scene)
    ω, E = released_modes(scene)
    load = fl.gravity_torque(chain, np.zeros(chain.n))
    assert len(ω) == chain.n == 8
    assert E.sum() == pytest.approx(0.5 * load @ (load / chain.stiffness), rel=1e-12, abs=0)
