"""Identities that hold whatever the engine: truth before agreement."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import flexible, make_scene, nasty_scene, random_state
from hypothesis import given, settings
from hypothesis import strategies as st

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.dynamics.rounding import EPS, of_mass_matrix, of_residual
from flexlink.dynamics.terms import algorithms_of
from flexlink.kernels.tools.solve import solve_cholesky, solve_lu
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.words import refused


def test_four_mass_methods_agree_and_m_is_symmetric_positive_definite(chain: fl.Chain, rng) -> None:
    for _ in range(10):
        q, _ = random_state(chain, rng)
        M = fl.mass_matrix(chain, q)
        for method in algorithms_of(chain):
            np.testing.assert_allclose(
                fl.mass_matrix(chain, q, algorithm=method), M, atol=of_mass_matrix(chain, q), rtol=0
            )
        assert np.array_equal(M, M.T)
        assert np.linalg.eigvalsh(M).min() > 0


def test_inertia_without_mass_counts_in_every_mass_method(rng) -> None:
    """A wheel given by its inertia alone, behind a skew mount, adds its moments about the joints' axes to M."""
    skew = fl.Mount(rpy_deg=(30.0, 40.0, 50.0))
    hubs = fl.RigidBody(), fl.RigidBody(inertia=(0.1, 0.2, 0.3))
    chains = [
        fl.lump(
            make_scene(
                fl.Link(name="a", length=0.5, hub=fl.RigidBody(inertia=(1.0, 2.0, 3.0))),
                fl.Link(name="b", mount=skew, hub=hub),
                fl.Link(name="c", length=0.5, mount=skew),
                tip=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1)),
            )
        )
        for hub in hubs
    ]
    q, _ = random_state(chains[0], rng)
    for method in algorithms_of(chains[0]):
        bare, loaded = (fl.mass_matrix(chain, q, algorithm=method) for chain in chains)
        np.testing.assert_allclose((loaded - bare)[1:, 1:], [[0.3, 0.0], [0.0, 0.0]], atol=1e-14)
        axis = np.linalg.inv(fl.frames(chains[0], q).rotations[1])[:, 2]  # of the first joint, in axes of the wheel
        assert (loaded - bare)[0, 0] == pytest.approx(axis @ np.diag(hubs[1].inertia) @ axis, abs=1e-14)
        assert (loaded - bare)[0, 1] == pytest.approx(0.3 * axis[2], abs=1e-14)


def test_products_of_inertia_count_in_every_method_and_solver(rng) -> None:
    """Inertias that are full in body axes, which no section has, but a skew mount or a payload may give."""
    chain = fl.lump(nasty_scene())
    bodies = chain.bodies.copy()
    B = rng.normal(size=(chain.n, 3, 3))[: len(bodies) - 1]
    bodies["inertia"][:-1] = 0.1 * B @ B.transpose(0, 2, 1)
    full = dataclasses.replace(chain, bodies=bodies)
    q, qd = random_state(full, rng)
    M, tau = fl.mass_matrix(full, q), rng.normal(size=full.n)
    for method in algorithms_of(full):
        np.testing.assert_allclose(fl.mass_matrix(full, q, algorithm=method), M, atol=1e-13 * np.abs(M).max(), rtol=0)
    assert fl.energy(full, q, qd).kinetic == pytest.approx(0.5 * qd @ M @ qd, rel=1e-13, abs=0)
    torque = fl.bias_torque(full, q, qd) + fl.elastic_torque(full, q) + fl.friction_torque(full, qd)
    for method in SOLVERS:
        qdd = fl.forward_dynamics(full, q, qd, tau, solver=method)
        scale = np.abs(M) @ np.abs(qdd) + np.abs(torque)
        assert np.abs(M @ qdd + torque - tau).max() <= 100 * EPS * scale.max()


def test_kinetic_energy_is_half_qd_m_qd(chain: fl.Chain, rng) -> None:
    q, qd = random_state(chain, rng)
    assert fl.energy(chain, q, qd).kinetic == pytest.approx(0.5 * qd @ fl.mass_matrix(chain, q) @ qd, rel=1e-13, abs=0)


@pytest.mark.parametrize("method", SOLVERS)
def test_inverse_dynamics_undoes_forward_dynamics(chain: fl.Chain, rng, method: str) -> None:
    q, qd = random_state(chain, rng)
    tau, wrench = rng.normal(size=chain.n), rng.normal(size=6)
    qdd = fl.forward_dynamics(chain, q, qd, tau, solver=method, tip_wrench=wrench)
    springs = fl.elastic_torque(chain, q) + fl.friction_torque(chain, qd)
    back = fl.inverse_dynamics(chain, q, qd, qdd, tip_wrench=wrench) + springs
    assert np.abs(back - tau).max() <= of_residual(chain, q, qd, qdd, tau, tip_wrench=wrench)


def test_power_balance(chain: fl.Chain, rng) -> None:
    """dE/dt = q̇·(T_EX − T_FR): along q(t) with the true q̈, by central differences with Richardson's step."""
    q, qd = random_state(chain, rng)
    qd /= 10
    tau = rng.normal(size=chain.n)
    qdd = fl.forward_dynamics(chain, q, qd, tau)

    def total(t: float) -> float:
        return float(fl.energy(chain, q + t * qd + t * t / 2 * qdd, qd + t * qdd).total)

    h = 1e-3 / (1 + np.sqrt(np.abs(qdd).max()))  # the motion changes on the scale 1/√|q̈|
    coarse, fine = ((total(s) - total(-s)) / (2 * s) for s in (h, h / 2))
    rate = (4 * fine - coarse) / 3
    power = qd @ (tau - fl.friction_torque(chain, qd))
    flows = np.abs(qd) @ np.abs(fl.elastic_torque(chain, q) + fl.bias_torque(chain, q, qd)) + abs(power)
    assert abs(rate - power) <= 1e-6 * flows


def test_elastic_torque_is_the_slope_of_elastic_energy_about_any_rest_angles(chain: fl.Chain, rng) -> None:
    hinges = chain.hinges.copy()
    hinges["rest"] = rng.normal(size=chain.n)
    bent, zero = dataclasses.replace(chain, hinges=hinges), np.zeros(chain.n)
    q, _ = random_state(chain, rng)
    elastic = float(fl.energy(bent, q, zero).elastic)
    assert fl.energy(bent, bent.rest, zero).elastic == 0
    for k in range(chain.n):
        e = np.eye(chain.n)[k]
        plus, minus = (float(fl.energy(bent, q + s * e, zero).elastic) for s in (1, -1))
        # of a quadratic the central difference is exact; each energy is a sum of n terms
        rounding = chain.n * EPS * max(plus, minus, elastic)
        assert (plus - minus) / 2 == pytest.approx(fl.elastic_torque(bent, q)[k], abs=rounding)


def test_frames_are_rotations_and_the_last_is_the_tip(chain: fl.Chain, rng) -> None:
    q, _ = random_state(chain, rng)
    placed = fl.frames(chain, q)
    np.testing.assert_allclose(placed.rotations @ placed.rotations.transpose(0, 2, 1), np.eye(3) + 0 * placed.rotations,
                               atol=1e-13)  # fmt: skip
    np.testing.assert_array_equal(placed.points[-1], fl.tip_position(chain, q))


def test_a_straight_arm_reaches_its_length() -> None:
    links = [fl.Link(name=f"l{i}", length=0.5) for i in range(3)]
    heavy = fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
    np.testing.assert_array_equal(fl.tip_position(fl.lump(make_scene(*links, tip=heavy)), np.zeros(3)), [1.5, 0, 0])


@pytest.mark.parametrize("method", SOLVERS)
def test_a_singular_mass_matrix_names_joint_and_posture(method: str) -> None:
    coaxial = fl.lump(make_scene(fl.Link(name="a"), fl.Link(name="b", length=1.0), tip=fl.RigidBody(mass=1.0)))
    with refused(fl.errors.SingularMassError, "joint-without-inertia"):
        fl.forward_dynamics(coaxial, [0.0, np.pi / 6], [0.0, 0.0], [0.0, 1.0], solver=method)
    states = np.array([[0.0, np.pi / 6]] * 3)
    with refused(fl.errors.SingularMassError, "joint-without-inertia"):
        fl.forward_dynamics(coaxial, states, 0 * states, 0 * states, solver=method)


@pytest.mark.parametrize("method", ["lu", "cholesky"])
@pytest.mark.parametrize("distance", [1e-6, 1e-7, 1e-8, 0.0])
def test_no_number_where_rounding_leaves_m_no_digit(method: str, distance: float, rng) -> None:
    """For a free group near gimbal lock M is singular to rounding, and its decomposition gave finite numbers."""
    chain = fl.lump(make_scene(flexible("a", "xyz", 4, mount=fl.Mount(rpy_deg=(-90.0, 0.0, 0.0)))))
    q, qd, tau = rng.uniform(-0.3, 0.3, (3, chain.n))
    q[5] = np.pi / 2 - distance
    with refused(fl.errors.SingularMassError, "joint-without-inertia") as e:
        fl.forward_dynamics(chain, q, qd, tau, solver=method)
    assert len(str(e.value)) < 250
    assert not np.isfinite(SOLVERS[method].accelerations(chain.arrays, np.zeros(6), q, qd, tau)).any()
    assert np.isfinite(fl.forward_dynamics(chain, q, qd, tau)).all()


@pytest.mark.parametrize("solve", [solve_lu, solve_cholesky])
def test_units_of_coordinates_do_not_make_a_matrix_singular(solve) -> None:
    """D H D of D = diag(1, 1e17), where LU exchanges rows: rounding is that of H, whose x is 1."""
    H, D = np.array([[1.0, 0.5], [0.5, 1.0]]), np.array([1.0, 1e17])
    b = D * H.sum(axis=1)
    solve(D[:, None] * H * D, b, np.empty((3, 2)))
    np.testing.assert_allclose(D * b, 1.0, rtol=1e-15)


@pytest.mark.parametrize("method", ["lu", "cholesky"])
def test_a_run_with_a_singular_mass_matrix_is_no_result(method: str) -> None:
    """Two joints on one line, but for the rounding of mounts that turn away and back: a pivot of 1e-16 instead of 0."""
    turns = (58.0, 47.0, 56.0), (-58.0, 0.0, 0.0), (0.0, -47.0, 0.0)
    locked = [
        fl.Link(name=f"turn {k}", mount=fl.Mount(rpy_deg=turn), joint=fl.Joint(locked=True))
        for k, turn in enumerate(turns)
    ]
    links = fl.Link(name="a"), *locked, fl.Link(name="b", length=1.0, mount=fl.Mount(rpy_deg=(0.0, 0.0, -56.0)))
    run = fl.RunSettings(step=1e-3, sample=5e-3, duration=0.01, solver=method)
    scene = make_scene(*links, tip=fl.RigidBody(mass=1.0, inertia=(0.1, 0.2, 0.3)), gravity=(0.0, 9.81, 0.0), run=run)
    M = fl.mass_matrix(fl.lump(scene), [0.0, 0.0])
    assert 0 < abs(np.linalg.det(M)) < 10 * EPS
    with pytest.raises(fl.errors.SingularMassError):  # before the run, or during the run, by nan
        fl.simulate(scene)
    with refused(fl.errors.DivergenceError, "diverged"):
        SingleRun(problem_of(scene), warnings=()).finish(Stop())


def test_heavy_payloads_are_not_singular(rng) -> None:
    """cond(M) of 1e10 costs ten digits and leaves six."""
    chain = fl.lump(make_scene(flexible("a", "xyz", 7), flexible("b", "xyz", 7), tip=fl.RigidBody(mass=1e4)))
    q, qd, tau = rng.uniform(-0.01, 0.01, (3, chain.n))
    right = fl.forward_dynamics(chain, q, qd, tau)
    for method in ("lu", "cholesky"):
        qdd = fl.forward_dynamics(chain, q, qd, tau, solver=method)
        assert np.abs(qdd - right).max() <= 10 * EPS * np.linalg.cond(fl.mass_matrix(chain, q)) * np.abs(right).max()


@pytest.mark.parametrize("method", SOLVERS)
def test_rates_beyond_float64_are_not_taken_for_a_singular_mass_matrix(models, method: str) -> None:
    chain = fl.lump(fl.load_scene(models / "t3_spatial.toml"))
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.forward_dynamics(chain, np.zeros(chain.n), np.full(chain.n, 1e200), np.zeros(chain.n), solver=method)


def test_coulomb_friction_is_dry_beyond_three_widths() -> None:
    joint = fl.Joint(coulomb=2.0, coulomb_width=0.05, viscous=0.0)
    chain = fl.lump(make_scene(fl.Link(name="a", length=1.0, joint=joint), tip=fl.RigidBody(mass=1.0)))
    assert fl.friction_torque(chain, [0.15])[0] == pytest.approx(2.0, rel=5e-3)
    assert fl.friction_torque(chain, [-10.0])[0] == pytest.approx(-2.0)
    assert fl.friction_torque(chain, [0.0])[0] == 0


@pytest.mark.parametrize(
    ("bad", "wanted"),
    [
        (np.zeros(9), "wrong-shape"),
        (np.zeros((1, 2, 10)), "wrong-shape"),
        (np.full(10, np.nan), "not-finite"),
        (np.zeros(10, complex), "wrong-type"),
        (["a"] * 10, "wrong-type"),
        ([[1], [1, 2]], "wrong-type"),
        (None, "wrong-type"),
    ],
)
def test_bad_arrays_are_named_with_shape_got_and_expected(models, bad, wanted: str) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    with refused(ValueError, wanted):
        fl.mass_matrix(chain, bad)


def test_unknown_methods_are_listed(models) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.mass_matrix(chain, np.zeros(10), algorithm="qr")
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.forward_dynamics(chain, *np.zeros((3, 10)), solver="qr")


@settings(max_examples=50)
@given(st.lists(st.floats(-1e3, 1e3), min_size=10, max_size=10), st.integers(0, 9), st.integers(-3, 3))
def test_dynamics_have_the_period_of_a_turn(angles: list[float], joint: int, turns: int) -> None:
    chain = fl.lump(make_scene(fl.Link(name="waist"), *[fl.Link(name=f"l{i}", length=0.3) for i in range(9)],
                       tip=fl.RigidBody(mass=1.0, inertia=(0.1, 0.1, 0.1))))  # fmt: skip
    q = np.array(angles)
    turned = q.copy()
    turned[joint] += 2 * np.pi * turns
    M = fl.mass_matrix(chain, q)
    # 2π is rounded to eps and so is an angle of up to 1000 rad, which M follows with slope ≤ its own size
    np.testing.assert_allclose(fl.mass_matrix(chain, turned), M, atol=1e4 * EPS * np.abs(M).max())
