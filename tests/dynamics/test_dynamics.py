"""Identities of the dynamics that every engine must satisfy."""

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.dynamics.accelerations import SOLVERS
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.terms import algorithms_of
from flexlink.kernels.tools.solve import solve_cholesky, solve_lu
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.conftest import flexible, make_scene, nasty_scene, random_state
from tests.support.words import refused


def test_inertia_without_mass_is_included_by_every_mass_matrix_algorithm(rng) -> None:
    """A wheel with inertia but no mass, on a skew mount, adds its moments of inertia about the joint axes to M."""
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
        axis = np.linalg.inv(fl.frames(chains[0], q).rotations[1])[:, 2]  # axis of the first joint, in wheel axes
        assert (loaded - bare)[0, 0] == pytest.approx(axis @ np.diag(hubs[1].inertia) @ axis, abs=1e-14)
        assert (loaded - bare)[0, 1] == pytest.approx(0.3 * axis[2], abs=1e-14)


def test_products_of_inertia_are_included_by_every_algorithm_and_solver(rng) -> None:
    """Sections have no products of inertia in body axes, but a skew mount or a payload may add them."""
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


def test_elastic_torque_is_the_gradient_of_elastic_energy_at_any_rest_angles(chain: fl.Chain, rng) -> None:
    hinges = chain.hinges.copy()
    hinges["rest"] = rng.normal(size=chain.n)
    bent, zero = dataclasses.replace(chain, hinges=hinges), np.zeros(chain.n)
    q, _ = random_state(chain, rng)
    elastic = float(fl.energy(bent, q, zero).elastic)
    assert fl.energy(bent, bent.rest, zero).elastic == 0
    for k in range(chain.n):
        e = np.eye(chain.n)[k]
        plus, minus = (float(fl.energy(bent, q + s * e, zero).elastic) for s in (1, -1))
        # the central difference of a quadratic function is exact; each energy is a sum of n terms
        rounding = chain.n * EPS * max(plus, minus, elastic)
        assert (plus - minus) / 2 == pytest.approx(fl.elastic_torque(bent, q)[k], abs=rounding)


def test_the_tip_of_a_straight_arm_is_at_the_sum_of_link_lengths() -> None:
    links = [fl.Link(name=f"l{i}", length=0.5) for i in range(3)]
    heavy = fl.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0))
    np.testing.assert_array_equal(fl.tip_position(fl.lump(make_scene(*links, tip=heavy)), np.zeros(3)), [1.5, 0, 0])


@pytest.mark.parametrize("method", SOLVERS)
def test_the_error_of_a_singular_mass_matrix_names_joint_and_posture(method: str) -> None:
    coaxial = fl.lump(make_scene(fl.Link(name="a"), fl.Link(name="b", length=1.0), tip=fl.RigidBody(mass=1.0)))
    with refused(fl.errors.SingularMassError, "joint-without-inertia"):
        fl.forward_dynamics(coaxial, [0.0, np.pi / 6], [0.0, 0.0], [0.0, 1.0], solver=method)
    states = np.array([[0.0, np.pi / 6]] * 3)
    with refused(fl.errors.SingularMassError, "joint-without-inertia"):
        fl.forward_dynamics(coaxial, states, 0 * states, 0 * states, solver=method)


@pytest.mark.parametrize("method", ["lu", "cholesky"])
@pytest.mark.parametrize("distance", [1e-6, 1e-7, 1e-8, 0.0])
def test_a_mass_matrix_that_is_singular_to_within_rounding_is_an_error(method: str, distance: float, rng) -> None:
    """Near gimbal lock of an unsprung hinge group, M is singular to within rounding, but its factors may be finite."""
    chain = fl.lump(make_scene(flexible("a", "xyz", 4, mount=fl.Mount(rpy_deg=(-90.0, 0.0, 0.0)))))
    q, qd, tau = rng.uniform(-0.3, 0.3, (3, chain.n))
    q[5] = np.pi / 2 - distance
    with refused(fl.errors.SingularMassError, "joint-without-inertia") as e:
        fl.forward_dynamics(chain, q, qd, tau, solver=method)
    assert len(str(e.value)) < 250
    assert not np.isfinite(SOLVERS[method].accelerations(chain.arrays, np.zeros(6), q, qd, tau)).any()
    assert np.isfinite(fl.forward_dynamics(chain, q, qd, tau)).all()


@pytest.mark.parametrize("solve", [solve_lu, solve_cholesky])
def test_badly_scaled_coordinates_do_not_make_a_matrix_singular(solve) -> None:
    """M = D H D with D = diag(1, 1e17), for which LU swaps rows; the error must be as small as for H."""
    H, D = np.array([[1.0, 0.5], [0.5, 1.0]]), np.array([1.0, 1e17])
    b = D * H.sum(axis=1)
    solve(D[:, None] * H * D, b, np.empty((3, 2)))
    np.testing.assert_allclose(D * b, 1.0, rtol=1e-15)


@pytest.mark.parametrize("method", ["lu", "cholesky"])
def test_a_run_with_a_singular_mass_matrix_is_refused(method: str) -> None:
    """Mounts that rotate there and back make two joints coaxial up to rounding: the pivot is 1e-16 instead of 0."""
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
    with pytest.raises(fl.errors.SingularMassError):  # detected before the run, or by NaN during the run
        fl.simulate(scene)
    with refused(fl.errors.DivergenceError, "diverged"):
        SingleRun(problem_of(scene), warnings=()).finish(Stop())


def test_a_heavy_payload_does_not_make_the_mass_matrix_singular(rng) -> None:
    """cond(M) of 1e10 costs ten digits and leaves six."""
    chain = fl.lump(make_scene(flexible("a", "xyz", 7), flexible("b", "xyz", 7), tip=fl.RigidBody(mass=1e4)))
    q, qd, tau = rng.uniform(-0.01, 0.01, (3, chain.n))
    right = fl.forward_dynamics(chain, q, qd, tau)
    for method in ("lu", "cholesky"):
        qdd = fl.forward_dynamics(chain, q, qd, tau, solver=method)
        assert np.abs(qdd - right).max() <= 10 * EPS * np.linalg.cond(fl.mass_matrix(chain, q)) * np.abs(right).max()


@pytest.mark.parametrize("method", SOLVERS)
def test_rates_that_overflow_are_not_reported_as_a_singular_mass_matrix(models, method: str) -> None:
    chain = fl.lump(fl.load_scene(models / "t3_spatial.toml"))
    with refused(fl.errors.ArgumentError, "overflow"):
        fl.forward_dynamics(chain, np.zeros(chain.n), np.full(chain.n, 1e200), np.zeros(chain.n), solver=method)


def test_coulomb_friction_saturates_beyond_three_widths() -> None:
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
def test_errors_of_bad_arrays_name_the_given_and_expected_shape(models, bad, wanted: str) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    with refused(ValueError, wanted):
        fl.mass_matrix(chain, bad)


def test_an_unknown_method_is_refused_with_a_list_of_methods(models) -> None:
    chain = fl.lump(fl.load_scene(models / "paper_fig5.toml"))
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.mass_matrix(chain, np.zeros(10), algorithm="qr")
    with refused(fl.errors.ArgumentError, "unknown-name"):
        fl.forward_dynamics(chain, *np.zeros((3, 10)), solver="qr")


def test_the_energy_of_coupled_springs_is_relative_to_their_rest_angles(rng: np.random.Generator) -> None:
    chain = fl.lump(make_scene(flexible("a", segments=5, lumping="lobatto2")))
    hinges, q = chain.hinges.copy(), rng.normal(size=chain.n)
    hinges["rest"] = np.where(chain.stiffness > 0, rng.normal(size=chain.n), 0.0)
    stretch = q - hinges["rest"]
    energy = fl.energy(dataclasses.replace(chain, hinges=hinges), q, np.zeros(chain.n))
    assert energy.elastic == pytest.approx(stretch @ chain.matrix("stiffness") @ stretch / 2, rel=1e-12)
