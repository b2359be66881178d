"""(λ² M + λ C + K) x = r in O(n): products, solutions and pivots agree with those of the dense matrices."""

import dataclasses

import numpy as np
import pytest
from scipy import linalg

import flexlink as fl
from flexlink.dynamics import load_path, small_motion
from flexlink.dynamics.forces import damping_matrix
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.tangent import LoadedState, displacements, falls, gyroscopic_matrix, stiffness_matrix, tangent
from flexlink.errors import ConvergenceError
from tests.conftest import ROOT, random_state
from tests.support.beams import cantilever

Rng = np.random.Generator
EPS = np.finfo(float).eps


def matrices(chain: fl.Chain, q, qd, wrench, follower=False) -> np.ndarray:
    """The dense matrices K, C and M."""
    K = stiffness_matrix(chain, q, qd, wrench, follower)
    return np.array([K, gyroscopic_matrix(chain, q, qd) + damping_matrix(chain), fl.mass_matrix(chain, q)])


def of_springs(chain: fl.Chain, q) -> np.ndarray:
    """The part of K due to springs."""
    return stiffness_matrix(chain.with_numbers(gravity=np.zeros(3)), q, 0 * q, np.zeros(6))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("follower", [False, True])
def test_products_and_solutions_equal_those_of_the_matrices(any_chain, follower: bool, moving: bool, rng: Rng) -> None:
    """One joint, within a cell if there are any, is locked."""
    chain, n = any_chain, any_chain.n
    (q, qd), wrench, locked = random_state(chain, rng), rng.normal(size=6) * 10, np.zeros(n, bool)
    qd *= moving
    locked[n - 2 if len(chain.couplings) else n // 2] = True
    springs = [of_springs(chain, q), damping_matrix(chain), np.diag(chain.hinges["armature"])]
    motion, each = (
        SmallMotion(chain, 0.5 * q, qd, wrench, follower, np.flatnonzero(~locked)),
        matrices(chain, q, qd, wrench, follower),
    )
    motion.set_position(q)
    x = np.where(locked, 0.0, rng.normal(size=(2, n)))
    for weights in (*np.eye(3), np.array([1.0, 0.7, 0.49])):
        A = np.tensordot(weights, each, 1)
        wanted = np.where(locked, 0.0, x @ A.T)
        assert np.abs(motion.times(weights, x) - wanted).max() <= 1e-13 * n * np.abs(A).max()
    own, w = np.tensordot(weights, springs, 1), rng.uniform(0.3, 1.0, n)
    scaled = own + w[:, None] * (A - own)
    motion.eliminate(weights, w, np.abs(scaled).max(axis=1), 0.0)
    found = motion.solve(x @ scaled.T)[0]
    assert np.abs(found - x).max() <= 1e-14 * np.linalg.cond(scaled) * np.abs(x).max()
    assert np.abs(np.where(locked, 0.0, (found - x) @ scaled.T)).max() <= 1e-9 * np.abs(scaled).max()
    assert motion.times_mass(x) == pytest.approx(np.where(locked, 0.0, x @ each[2]), abs=1e-13 * np.abs(each[2]).max())


@pytest.mark.parametrize("smallest", [1e-8, 0.7, 1e9])
def test_a_newton_step_with_skipped_rows_equals_that_of_the_full_matrix(any_chain, smallest, rng, monkeypatch) -> None:
    """None, some or all pivots are too small; their coordinates are solved for together with the load factor."""
    monkeypatch.setattr(small_motion.SmallMotion.eliminate, "__defaults__", (smallest,))
    chain, n = any_chain, any_chain.n
    q = rng.uniform(-1, 1, n)
    acting = LoadedState(q, np.zeros(n), 10 * rng.normal(size=6) * bool(len(chain.couplings)), True, np.arange(n))
    equations = load_path.Equations(chain, acting, np.zeros(n))
    x = np.append(0.6, q + rng.normal(size=n) * 0.1)
    _, by_s = equations.with_slope(x)
    K, k = stiffness_matrix(chain, x[1:], acting.qd, acting.wrench, True), of_springs(chain, x[1:])
    w, row, wanted = np.where(chain.stiffness > 0, x[0], 1.0), rng.normal(size=n + 1), rng.normal(size=n + 1)
    A = np.vstack([np.column_stack([by_s, k + w[:, None] * (K - k)]), row])
    neutral = np.abs(A[:-1, 1:]).max(axis=0) < 1e-12  # a waist along gravity has no stiffness
    wanted[1:][neutral] = A[-1, 1:][neutral] = row[1:][neutral] = 0.0
    left = A @ wanted
    found = equations.solve(by_s, row, left[:-1], float(left[-1]))
    sizes = np.append(equations.motion.sizes, 1.0)[:, None]
    kept, rows = np.append(True, ~neutral), np.append(~neutral, True)
    condition = np.linalg.cond(A[np.ix_(rows, kept)] / sizes[rows])
    assert np.abs(found - wanted)[kept].max() <= 1e3 * EPS * condition * np.abs(wanted).max()
    rounded = len(wanted) * EPS * (np.abs(A) @ np.abs(wanted)).max()  # rounding of A x
    assert np.abs(found[1:][neutral]).max(initial=0.0) <= rounded
    assert (len(equations.motion.skipped) == n) == (smallest > 1)


def test_pivots_and_eigenvalues_agree_on_stability(rng: Rng) -> None:
    """Tested: columns near their buckling load, and arms in random postures in space with and without a wrench."""
    seen = []
    for k in range(60):
        column = cantilever(("gauss", "lobatto2", "lobatto4")[k % 3], 8)
        force = np.array([-rng.uniform(2.0, 3.0), 0, 0, 0, 0, rng.uniform(-1, 1)])
        seen.append((column, rng.uniform(-0.1, 0.1, column.n), force, np.arange(rng.integers(2), column.n)))
    for name in ("t3_spatial", "three_links"):
        arm = fl.lump(fl.load_scene(ROOT / "models" / f"{name}.toml"))
        for wrench in (np.zeros(6), rng.normal(size=6) * 100) * 10:
            q = np.where(arm.stiffness > 0, 0.01, 2.0) * rng.normal(size=arm.n)
            seen.append((arm, q, wrench, np.arange(arm.n)))
    found = []
    for arm, q, wrench, free in seen:
        for follower in (False, True):
            found.append(falls(arm, LoadedState(q, 0 * q, wrench, follower, free)))
            assert found[-1] == tangent(arm, q, 0 * q, wrench, follower, free).falls
    assert 20 < sum(found) < len(found) - 20
    resting = dataclasses.replace(fl.lump(fl.load_scene(ROOT / "models" / "three_links.toml")), gravity=np.zeros(3))
    zero = np.zeros(resting.n)
    assert not falls(resting, LoadedState(zero, zero, np.zeros(6), False, np.arange(resting.n))), (
        "a coordinate without stiffness has λ = 0"
    )


def test_a_symmetric_matrix_has_equal_numbers_of_negative_pivots_and_eigenvalues(any_chain: fl.Chain, rng: Rng) -> None:
    chain, n = any_chain, any_chain.n
    q, still = 0.3 * rng.normal(size=n), np.zeros(n)
    K, _, M = matrices(chain, q, still, np.zeros(6))
    motion = SmallMotion(chain, q, still, np.zeros(6), False, np.arange(n))
    μ = linalg.eigvalsh((K + K.T) / 2, M)
    for below in range(1, n):
        between = (μ[below - 1] + μ[below]) / 2
        if μ[below] - μ[below - 1] > 1e-6 * abs(between) + 1e-12 * np.abs(μ).max():
            assert motion.falling(np.array([1.0, 0.0, -between]), still) == below


@pytest.mark.parametrize(
    "name", ["models/three_links", "validation/scenes/pendulum", "validation/scenes/double_pendulum_rods"]
)
def test_an_arm_that_starts_level_finds_the_hanging_equilibrium(name: str) -> None:
    """The load torque is largest in the level posture, so the load path starts along the direction of the load."""
    scene = fl.load_scene(ROOT / f"{name}.toml")
    chain = fl.lump(scene)
    rest = fl.solve_static(chain, chain.rest)
    assert rest.stable
    assert rest.residual <= 1e-9
    zero = np.zeros(chain.n)
    assert fl.energy(chain, rest.q, zero).gravity < fl.energy(chain, chain.rest, zero).gravity, "down, not up"
    weightless = dataclasses.replace(chain, gravity=np.zeros(3))
    with pytest.raises(ConvergenceError):
        fl.solve_static(weightless, tau=np.eye(chain.n)[0])


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_a_joint_along_gravity_keeps_its_angle_in_equilibrium(name: str) -> None:
    scene = fl.load_scene(ROOT / "models" / "robots" / f"{name}.toml")
    chain = fl.lump(scene)
    start = fl.initial_state(scene, chain)[0]
    rest = fl.solve_static(chain, start)
    assert rest.q[0] == pytest.approx(start[0], abs=1e-9)
    assert rest.residual <= 1e-9


def test_displacements_equal_the_motion_of_the_points(chain: fl.Chain, rng: Rng) -> None:
    """Differences are exact over a quarter turn each way, because points move on circles, and over 1 m of sliding."""
    q = random_state(chain, rng)[0]
    ways = np.where(chain.slides, 1.0, np.pi / 2)
    turned = np.array(
        [(fl.frames(chain, q + quarter).points - fl.frames(chain, q - quarter).points) / 2 for quarter in np.diag(ways)]
    )
    assert displacements(chain, q, np.eye(chain.n)) == pytest.approx(turned, abs=1e-13 * chain.reach)


def test_springs_alone_give_a_diagonal_system() -> None:
    chain = dataclasses.replace(cantilever("midpoint", 5), gravity=np.zeros(3))
    motion = SmallMotion(chain, chain.rest, np.zeros(5), np.zeros(6), False, np.arange(5))
    assert motion.eliminate(K_ALONE, np.ones(5), chain.stiffness) == 0
    assert motion.solve(np.ones((1, 5)))[0][0] == pytest.approx(1 / chain.stiffness, rel=1e-15)
