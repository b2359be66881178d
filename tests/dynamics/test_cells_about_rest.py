"""Small motion, statics, modes and strain of chains with coupled springs agree with full matrices."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg

import flexlink as fl
from flexlink.cli import info
from flexlink.dynamics import load_path, small_motion
from flexlink.dynamics.equilibrium import static_postures
from flexlink.dynamics.forces import damping_matrix, deflections
from flexlink.dynamics.small_motion import SmallMotion
from flexlink.dynamics.tangent import LoadedState, falls, gyroscopic_matrix, stiffness_matrix, tangent
from flexlink.dynamics.vibration.extremes import CLOSE, fastest_decay, fastest_frequency, slowest_frequency
from flexlink.dynamics.vibration.stability import fastest_eigenvalues
from flexlink.kernels.forward.mass_plus_plane import plane_posture
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.forward.power_iteration import largest_eigenvalue
from flexlink.pages.tables import Table
from flexlink.results.convergence import resolved
from flexlink.scene_report.parts import model
from flexlink.scene_report.study import Study
from tests.chain.test_cells import CHAINS, DAMPED, RUNS, arm, state
from tests.conftest import flexible, make_scene
from tests.motion.test_sensitivity import check
from tests.support.beams import cantilever, thin_arm, thin_link
from tests.support.words import reviewed

EPS = np.finfo(float).eps
ESTIMATE = 0.1  # relative error of the highest frequency, as in `test_extremes`
WEIGHTS = (*np.eye(3), np.array([1.0, 0.7, 0.49]))
SPRUNG = [name for name in CHAINS if "across" not in name]  # chains whose K is positive definite for the sprung joints


def matrices(chain: fl.Chain, q, qd, wrench, follower=False) -> np.ndarray:
    """The dense matrices K, C and M."""
    K = stiffness_matrix(chain, q, qd, wrench, follower)
    return np.array([K, gyroscopic_matrix(chain, q, qd) + damping_matrix(chain), fl.mass_matrix(chain, q)])


def held_at(chain: fl.Chain, *joints: int) -> fl.Chain:
    """The same chain with the given joints prescribed."""
    hinges = chain.hinges.copy()
    hinges["prescribed"][list(joints)] = 1
    return dataclasses.replace(chain, hinges=hinges)


# Small motion: (λ² M + λ C + K) x = r.


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("follower", [False, True])
@pytest.mark.parametrize("name", CHAINS)
def test_products_and_solutions_agree_with_the_dense_matrices(name, follower, moving, tmp_path) -> None:
    """One joint within a cell is locked."""
    chain, rng = CHAINS[name](tmp_path), np.random.default_rng(3)
    n, wrench, locked = chain.n, rng.normal(size=6) * 10, np.zeros(chain.n, bool)
    q, qd, _ = state(chain)
    qd *= moving
    locked[n - 2] = True
    motion, each = (
        SmallMotion(chain, q, qd, wrench, follower, np.flatnonzero(~locked)),
        matrices(chain, q, qd, wrench, follower),
    )
    x = np.where(locked, 0.0, rng.normal(size=(2, n)))
    springs = [chain.matrix("stiffness"), damping_matrix(chain), np.diag(chain.hinges["armature"])]
    for weights in WEIGHTS:
        A, own, w = np.tensordot(weights, each, 1), np.tensordot(weights, springs, 1), rng.uniform(0.3, 1.0, n)
        assert np.abs(motion.times(weights, x) - np.where(locked, 0.0, x @ A.T)).max() <= 1e-13 * n * np.abs(A).max()
        scaled = own + w[:, None] * (A - own)
        if not (weights[0] and weights[1]):
            continue  # K and C alone may be singular; other tests cover M
        motion.eliminate(weights, w, np.abs(scaled).max(axis=1), 0.0)
        found = motion.solve(x @ scaled.T)[0]
        assert np.abs(found - x).max() <= 1e-14 * np.linalg.cond(scaled) * np.abs(x).max()
        assert np.abs(np.where(locked, 0.0, (found - x) @ scaled.T)).max() <= 1e-9 * np.abs(scaled).max()


@pytest.mark.parametrize("smallest", [1e-8, 0.7, 1e9])
@pytest.mark.parametrize("name", CHAINS)
def test_a_newton_step_with_eliminated_coordinates_agrees_with_the_full_matrix(
    name: str, smallest: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(small_motion.SmallMotion.eliminate, "__defaults__", (smallest,))
    chain, rng = CHAINS[name](tmp_path), np.random.default_rng(4)
    n, q = chain.n, rng.uniform(-1, 1, chain.n)
    acting = LoadedState(q, np.zeros(n), rng.normal(size=6) * 10, True, np.arange(n))
    equations = load_path.Equations(chain, acting, np.zeros(n))
    x = np.append(0.6, q + rng.normal(size=n) * 0.1)
    _, by_s = equations.with_slope(x)
    K, k = stiffness_matrix(chain, x[1:], acting.qd, acting.wrench, True), chain.matrix("stiffness")
    w, row, wanted = np.where(chain.stiffness > 0, x[0], 1.0), rng.normal(size=n + 1), rng.normal(size=n + 1)
    A = np.vstack([np.column_stack([by_s, k + w[:, None] * (K - k)]), row])
    left = A @ wanted
    found = equations.solve(by_s, row, left[:-1], float(left[-1]))
    sizes = np.append(equations.motion.sizes, 1.0)[:, None]
    assert np.abs(found - wanted).max() <= 1e3 * EPS * np.linalg.cond(A / sizes) * np.abs(wanted).max()
    assert (len(equations.motion.skipped) == n) == (smallest > 1)


@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_pivots_and_eigenvalues_agree_on_whether_a_column_is_stable(rule: str, rng: np.random.Generator) -> None:
    """The columns have loads near the buckling load, π²/4, and a free or a clamped root."""
    found = []
    for _ in range(40):
        column = cantilever(rule, 8)
        force = np.array([-rng.uniform(2.0, 3.0), 0, 0, 0, 0, rng.uniform(-1, 1)])
        q, zero, free = rng.uniform(-0.1, 0.1, column.n), np.zeros(column.n), np.arange(rng.integers(2), column.n)
        found.append(falls(column, LoadedState(q, zero, force, False, free)))
        assert found[-1] == tangent(column, q, zero, force, False, free).falls
    assert 5 < sum(found) < len(found) - 5


@pytest.mark.parametrize("name", CHAINS)
def test_a_symmetric_matrix_has_equal_numbers_of_negative_pivots_and_eigenvalues(name: str, tmp_path: Path) -> None:
    chain = CHAINS[name](tmp_path)
    n, q = chain.n, state(chain)[0]
    K, _, M = matrices(chain, q, np.zeros(n), np.zeros(6))
    motion, μ = (
        SmallMotion(chain, q, np.zeros(n), np.zeros(6), False, np.arange(n)),
        linalg.eigvalsh((K + K.T) / 2, M),
    )
    for below in range(1, n):
        between = (μ[below - 1] + μ[below]) / 2
        if μ[below] - μ[below - 1] > 1e-6 * abs(between):
            assert motion.falling(np.array([1.0, 0.0, -between]), np.zeros(n)) == below


# springs and their derivatives


@pytest.mark.parametrize("name", SPRUNG)
def test_deflections_follow_from_the_inverse_of_the_stiffness_matrix(name: str, tmp_path: Path) -> None:
    chain = CHAINS[name](tmp_path)
    K, torques = chain.matrix("stiffness"), np.random.default_rng(6).normal(size=(3, chain.n))
    block = np.ix_(chain.bending, chain.bending)
    wanted = np.zeros_like(torques)
    wanted[:, chain.bending] = np.linalg.solve(K[block], torques[:, chain.bending].T).T
    bound = 10 * EPS * np.linalg.cond(K[block]) * np.abs(wanted).max()
    assert np.abs(deflections(chain, torques) - wanted).max() <= bound
    assert deflections(chain, torques[0]) == pytest.approx(deflections(chain, torques)[0], abs=0)


# Statics.


@pytest.mark.parametrize("name", SPRUNG)
def test_static_configurations_found_in_a_batch_and_one_by_one_are_equal(name: str, tmp_path: Path) -> None:
    chain = CHAINS[name](tmp_path)
    hinges = chain.hinges.copy()
    hinges["rest"][chain.bending] = np.linspace(-0.02, 0.03, len(chain.bending))
    chain = dataclasses.replace(chain, hinges=hinges)
    angles = np.linspace(np.zeros(len(chain.active)), 0.5, 8)
    found = static_postures(chain, angles)
    for q in found:
        alone = fl.solve_static(chain, np.where(chain.stiffness > 0, 0.0, q), locked=chain.active.tolist())
        assert q == pytest.approx(alone.q, abs=1e-14)


@pytest.mark.parametrize("path", ["material.aluminium.young", "link.upper.length"])
def test_sensitivities_of_a_run_from_equilibrium_agree_with_finite_differences(path: str) -> None:
    """The initial configuration depends on the stiffness of the springs."""
    still = {"initial.passive": "static", "initial.joint_deg": [20.0, -30.0]}
    check(arm("z", "lobatto4").varied({**RUNS["RK4"], **still}), path)


@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_a_column_is_stable_only_below_its_buckling_load(rule: str) -> None:
    """The buckling factor agrees with the dense eigenproblem, and static stability is lost at this factor."""
    column, push = cantilever(rule, 8), np.array([-1.0, 0, 0, 0, 0, 0])
    factor = fl.strength.buckling_loads(column, tip_wrench=push)[0]
    K = column.matrix("stiffness")
    softening = K - stiffness_matrix(column, column.rest, np.zeros(column.n), push)
    assert factor == pytest.approx(1 / linalg.eigh(softening, K, eigvals_only=True)[-1], rel=1e-13)
    for part, stable in ((0.999999, True), (1.000001, False)):
        rest = fl.solve_static(column, tip_wrench=part * factor * push)
        assert not rest.q.any(), "a straight column under a load along it stays straight"
        assert rest.stable == stable


def test_joints_without_a_spring_count_as_locked_in_buckling_loads() -> None:
    """A free joint at the root does not change the buckling load of a clamped column; locking a hinge increases it."""
    push = np.array([-1.0, 0, 0, 0, 0, 0])
    alone = fl.strength.buckling_loads(cantilever("lobatto4", 8), tip_wrench=push)
    free = thin_arm(thin_link("lobatto4", 8, free=True, armature=1.0))
    assert fl.strength.buckling_loads(free, tip_wrench=push)[0] == pytest.approx(alone[0], rel=1e-12)
    locked = fl.strength.buckling_loads(cantilever("lobatto4", 8), tip_wrench=push, locked=[3])
    assert locked[0] > alone[0]


# Modes.


@pytest.mark.parametrize("name", SPRUNG)
def test_elastic_energy_fractions_agree_with_the_quadratic_forms(name: str, tmp_path: Path) -> None:
    """The only energies are E = φ* (K + |λ| D) φ of springs and P = |φ* K_load φ| of loads: joints have no friction."""
    chain = CHAINS[name](tmp_path)
    q = 0.1 * state(chain)[0]
    found = fl.modes(chain, q)
    k, D = chain.matrix("stiffness"), chain.matrix("damping")
    load = stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6)) - k
    for λ, φ, share in zip(found.eigenvalues, found.shapes, found.elastic_shares, strict=True):
        E, P = (φ.conj() @ (k + abs(λ) * D) @ φ).real, abs(φ.conj() @ load @ φ)
        assert share == pytest.approx(E / (E + P), rel=1e-9)
    assert {"elastic", "pendulum"} <= set(found.kinds)


@pytest.mark.slow
@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_the_slowest_modes_of_a_long_chain_agree_with_the_full_eigenproblem(rule: str, damped: bool) -> None:
    """The O(n) method agrees within the errors of both methods; the dense method's error is eps ω_max/ω."""
    links = [flexible(name, "yz", 29, lumping=rule, damping=DAMPED if damped else None) for name in ("a", "b")]
    chain = fl.lump(make_scene(*links, gravity=(0.0, -9.81, 0.0)))
    q = fl.solve_static(chain, locked=chain.active.tolist()).q
    some, every = (fl.modes(chain, q, locked=chain.active.tolist(), count=count) for count in (6, None))
    assert some.frequencies == pytest.approx(every.frequencies[:6], rel=1e-9 if damped else 1e-10)
    assert some.damping_ratios == pytest.approx(every.damping_ratios[:6], abs=1e-9)
    assert some.elastic_shares == pytest.approx(every.elastic_shares[:6], rel=1e-7)


@pytest.mark.parametrize("rule, least", [("gauss", 6), ("lobatto2", 6), ("lobatto4", 6)])
def test_modes_with_two_hinges_per_half_wave_count_as_resolved(rule: str, least: int) -> None:
    """One mode per two hinges is resolved, as with independent springs; higher modes are not physical."""
    column = cantilever(rule, 12)
    flags = resolved(fl.modes(column), column)
    assert flags == (True,) * least + (False,) * (12 - least)


# Ends of the spectrum.


@pytest.mark.parametrize("name", SPRUNG)
def test_lowest_and_highest_frequencies_agree_with_the_dense_eigenproblem(name: str, tmp_path: Path) -> None:
    """The frequencies also agree if the driven joints and a joint within a cell have prescribed motions."""
    chain = CHAINS[name](tmp_path)
    q = 0.3 * state(chain)[0]
    for one in (chain, held_at(chain, *chain.active.tolist(), chain.n - 2)):
        moving = one.hinges["prescribed"] == 0
        block = np.ix_(moving, moving)
        K, D, M = one.matrix("stiffness")[block], one.matrix("damping")[block], fl.mass_matrix(one, q)[block]
        ω = np.sqrt(np.abs(linalg.eigh(K, M, eigvals_only=True)))[np.count_nonzero(np.diag(K) == 0) :]
        assert slowest_frequency(one, q) == pytest.approx(ω[0], rel=CLOSE)
        assert fastest_frequency(one, q) == pytest.approx(ω[-1], rel=ESTIMATE)
        assert fastest_decay(one, q) == pytest.approx(linalg.eigh(D, M, eigvals_only=True)[-1], rel=2 * ESTIMATE)


@pytest.mark.parametrize("name", SPRUNG)
def test_the_highest_frequency_is_exact_with_enough_iterations(name: str, tmp_path: Path) -> None:
    """The usual result is inexact only because few iterations suffice, not because a coupling is missing."""
    chain = CHAINS[name](tmp_path)
    q, coupled = 0.3 * state(chain)[0], np.ascontiguousarray(chain.couplings["stiffness"])
    posture = (plane_posture if chain.is_planar else space_posture)(*chain.arrays)
    found = largest_eigenvalue(chain.arrays, q, chain.stiffness, coupled, 100_000, 1e-13, posture)
    wanted = linalg.eigh(chain.matrix("stiffness"), fl.mass_matrix(chain, q), eigvals_only=True)[-1]
    assert found == pytest.approx(wanted, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_the_fastest_eigenvalues_of_a_long_chain_agree_with_the_dense_problem(rule: str) -> None:
    """Above 100 joints only matrix products are used; with damping, the error of the Lanczos method is 1e-4."""
    chain = fl.lump(make_scene(flexible("a", "z", 121, lumping=rule, damping=fl.Damping(ratio=0.3, at_hz=2e4))))
    q, zero = np.zeros(chain.n), np.zeros(chain.n)
    K, C, M = matrices(chain, q, zero, np.zeros(6))
    square, δ = (linalg.eigh(A, M, eigvals_only=True)[-1] for A in (K, C))
    λ = fastest_eigenvalues(chain, q)
    assert np.abs(λ.imag).max() == pytest.approx(np.sqrt(square), rel=1e-4)
    assert -λ.real.min() == pytest.approx(max(δ, -np.roots([1, δ, square]).real.min()), rel=1e-4)


# outputs: gauges, info, notebooks, reports


@pytest.mark.parametrize("rule", ["lobatto2", "lobatto4"])
def test_strain_gauges_at_gauss_points_measure_the_local_moment(rule: str) -> None:
    """Under a small transverse tip force, κ = M/EI to second order; cells represent a linear moment exactly."""
    link = flexible("a", "xyz", 9, lumping=rule, joint=fl.Joint(locked=True))
    scene = make_scene(link, gravity=(0.0, 0.0, 0.0))
    chain, small = fl.lump(scene), 1e-3
    q = fl.solve_static(chain, tip_wrench=[0, small, 2 * small, 3 * small, 0, 0]).q
    gauge = fl.strength.beam_strain(scene, np.array([q, 2 * q]), link="a", fibre=(0.01, 0.02))
    assert len(gauge.x) == 8
    assert (np.diff(gauge.x) > 0).all()
    points = np.polynomial.legendre.leggauss(int(rule[-1]))[0]
    assert gauge.x[: len(points)] == pytest.approx(1.25 * (1 + points) / 2 * len(points) / 8, rel=1e-14)
    material, (_, i_y, i_z, torsion) = scene.arm.materials["aluminium"], scene.arm.sections["square"].properties
    κ, arm_left = gauge.curvature[0], link.length - gauge.x
    assert κ[:, 0] == pytest.approx(3 * small / (material.shear * torsion), rel=1e-5)
    assert κ[:, 1] == pytest.approx(-2 * small * arm_left / (material.young * i_y), rel=1e-5)
    assert κ[:, 2] == pytest.approx(small * arm_left / (material.young * i_z), rel=1e-5)
    assert gauge.strain[0] == pytest.approx(0.02 * κ[:, 1] - 0.01 * κ[:, 2], rel=1e-12)
    assert gauge.curvature[1] == pytest.approx(2 * κ, rel=1e-14)


def test_info_and_notebooks_show_coupled_hinges() -> None:
    chain = fl.lump(arm("z"))
    assert chain.coupled_joints == ((), (2,), (1,), (4,), (3,), (), (7,), (6,))
    stiffness, hinge = info._kind(chain, 2).split(", ")
    assert stiffness == f"k = {chain.stiffness[2]:.6g} N m/rad"
    assert re.findall(r"\d+", hinge) == ["1"]
    reviewed("cells about rest: coupled hinge", hinge)
    assert info._kind(chain, 0) == "driven"
    html = chain._repr_html_()
    assert "coupled with" in html
    assert "coupled with" not in cantilever("gauss", 2)._repr_html_()


def test_a_report_lists_coupled_springs() -> None:
    def springs(rule: str) -> Table:
        return model.made(Study(arm("z", rule, 5))).tables[-1]

    table, alone = springs("lobatto4"), model.made(Study(make_scene(flexible("a")))).tables[-1]
    assert table.heads == (*alone.heads, "coupled with")
    assert table.lines[1][-1] == ", ".join(f"upper.{k}.z" for k in (1, 3, 4))
    assert len(table.lines) == 6


def test_a_chain_without_structural_damping_has_no_damper() -> None:
    chain = fl.lump(arm("z"))
    bare = info._without_structural_damping(chain)
    assert not bare.matrix("damping").any()
    np.testing.assert_array_equal(bare.matrix("stiffness"), chain.matrix("stiffness"))
    assert info._without_structural_damping(bare) is bare
