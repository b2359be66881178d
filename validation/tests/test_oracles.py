"""The independent references of the study agree with textbooks and with each other."""

from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf

import flexlink as fl
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.vibration.stability_function import stability_function
from reports.findings import oracles
from tests.conftest import chain_of
from tests.support.words import refused
from validation.kinds.energy_drift import modal_loss, released_modes
from validation.oracles import exact_runge_kutta, rigid_motions, transfer_beam
from validation.oracles.common_origin import of_state
from validation.oracles.planar_chain import DIGITS, PlanarChain
from validation.oracles.spatial_chain import SpatialChain, exactly

ROOT = Path(__file__).parents[2]


def test_the_50_digit_chain_agrees_with_the_textbook_double_pendulum():
    links = tuple(
        fl.Link(name=name, length=length, material="m", section="s") for name, length in (("a", 1.5), ("b", 0.75))
    )
    arm = fl.Arm(
        links=links,
        materials={"m": fl.Material(young=1e9, density=1000.0)},
        sections={"s": fl.Section(shape="rectangle", height=0.25, width=0.5)},
    )
    oracle = PlanarChain(chain_of(arm, (0.0, -9.81, 0.0)))
    m1, m2, l1, l2 = 187.5, 93.75, 1.5, 0.75
    I1, I2 = m1 * (l1**2 + 0.25**2) / 12, m2 * (l2**2 + 0.25**2) / 12
    q, qd = (0.3, -1.1), (2.0, 5.0)
    c = np.cos(q[1])
    m22 = I2 + m2 * l2**2 / 4
    m12 = m22 + m2 * l1 * l2 / 2 * c
    M = [[I1 + m1 * l1**2 / 4 + m2 * l1**2 + m2 * l1 * l2 * c + m22, m12], [m12, m22]]
    h = -m2 * l1 * l2 / 2 * np.sin(q[1])
    g2 = m2 * 9.81 * l2 / 2 * np.cos(q[0] + q[1])
    g1 = (m1 * l1 / 2 + m2 * l1) * 9.81 * np.cos(q[0]) + g2
    bias = [h * qd[1] * (2 * qd[0] + qd[1]) + g1, -h * qd[0] ** 2 + g2]
    with mp.workdps(DIGITS):
        assert np.allclose(np.array(oracle.mass_matrix(exactly(q)).tolist(), float), M, rtol=1e-14)
        assert np.allclose(np.array(oracle.bias_torque(exactly(q), exactly(qd)), float), bias, rtol=1e-13)


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


DATA = ("flexlink.chain.chain", "flexlink.describe.schemes.methods")
"""Modules that references may import; they contain only numbers of a chain and coefficients of a method."""


def test_every_independent_reference_is_listed_and_imports_no_algorithm_of_the_library() -> None:
    judges = oracles.judges()
    files = {path.stem for path in oracles.ORACLES.glob("*.py")} - {"__init__"}
    assert {file for judge in judges for file in judge.files} == files
    for judge in judges:
        assert set(judge.imports) <= set(DATA), judge.name


@pytest.mark.parametrize(("oracle", "data"), [*zip(("common_origin", "exact_runge_kutta"), DATA, strict=True)])
def test_indirect_imports_are_found(oracle: str, data: str) -> None:
    assert data in oracles.imports_of(oracle)


def test_transfer_matrices_give_the_roots_of_a_uniform_beam() -> None:
    found = transfer_beam.frequencies(((0.0, 0.5, 0.5, 1.0), (1.0,) * 4, (1.0,) * 4), 2)
    assert found == pytest.approx([1.8751040687119611**2, 4.694091132974175**2], rel=1e-9)


def test_overshoot_and_settling_time_of_a_servo_match_its_closed_form() -> None:
    servo = rigid_motions.Servo(inertia=0.5, kp=50.0, kd=3.0, target=0.6)
    t = np.linspace(0.0, 3.0, 300_001)
    angles = np.array([servo.angle(x) for x in t[::100].tolist()])
    assert angles.max() == pytest.approx(servo.peak, abs=1e-5)
    last = t[::100][np.flatnonzero(np.abs(angles - 0.6) > 0.01)[-1]]
    assert 0.0 <= servo.settled(0.01) - last <= 1e-3


def test_two_rigidly_joined_bodies_conserve_momentum_and_energy() -> None:
    box = rigid_motions.Body(2.0, np.zeros(3), np.diag([1.0, 2.0, 2.5]))
    both = box.with_another(rigid_motions.Body(1.0, np.array([0.0, 0.3, 0.0]), np.diag([0.1, 0.1, 0.1])))
    q, ω = both.tumbling(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.1, 2.0, 0.3]), np.linspace(0.0, 2.0, 5))
    kept = np.array([rigid_motions.rotation(a) @ both.inertia @ b for a, b in zip(q, ω, strict=True)])
    assert np.abs(kept - kept[0]).max() < 1e-10
    assert np.ptp([b @ both.inertia @ b for b in ω]) < 1e-10
