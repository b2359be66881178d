"""(λ² M + λ C + K) x = r in O(n): products, solutions and pivots agree with those of the dense matrices."""

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics import load_path, small_motion
from flexlink.dynamics.forces import damping_slope
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.tangent import LoadedState, displacements, falls, gyroscopic_matrix, stiffness_matrix, tangent
from flexlink.errors import ConvergenceError
from tests.conftest import ROOT, random_state
from tests.support.beams import cantilever

Rng = np.random.Generator


def matrices(chain: fl.Chain, q, qd, wrench, follower) -> np.ndarray:
    """The dense matrices K, C and M."""
    K = stiffness_matrix(chain, q, qd, wrench, follower)
    C = gyroscopic_matrix(chain, q, qd) + np.diag(damping_slope(chain))
    return np.array([K, C, fl.mass_matrix(chain, q)])


@pytest.mark.parametrize("follower", [False, True])
def test_products_and_solutions_equal_those_of_the_matrices(chain: fl.Chain, follower: bool, rng: Rng) -> None:
    (q, qd), wrench, locked = random_state(chain, rng), rng.normal(size=6) * 10, np.zeros(chain.n, bool)
    locked[chain.n // 2] = True
    springs = [chain.stiffness, damping_slope(chain), chain.hinges["armature"]]
    motion, each = (
        SmallMotion(chain, q, qd, wrench, follower, np.flatnonzero(~locked)),
        matrices(chain, q, qd, wrench, follower),
    )
    x = np.where(locked, 0.0, rng.normal(size=(2, chain.n)))
    for weights in (*np.eye(3), np.array([1.0, 0.7, 0.49])):
        A = np.tensordot(weights, each, 1)
        wanted = np.where(locked, 0.0, x @ A.T)
        assert np.abs(motion.times(weights, x) - wanted).max() <= 1e-13 * chain.n * np.abs(A).max()
    own, w = np.diag(weights @ np.array(springs)), rng.uniform(0.3, 1.0, chain.n)
    scaled = own + w[:, None] * (A - own)
    motion.eliminate(weights, w, np.abs(scaled).max(axis=1), 0.0)
    found = motion.solve(x @ scaled.T)[0]
    assert np.abs(found - x).max() <= 1e-14 * np.linalg.cond(scaled) * np.abs(x).max()
    assert np.abs(np.where(locked, 0.0, (found - x) @ scaled.T)).max() <= 1e-9 * np.abs(scaled).max()
    assert motion.times_mass(x) == pytest.approx(np.where(locked, 0.0, x @ each[2]), abs=1e-13 * np.abs(each[2]).max())


@pytest.mark.parametrize("smallest", [1e-8, 0.9, 1e9])
def test_a_newton_step_with_skipped_rows_equals_that_of_the_full_matrix(chain, smallest, rng, monkeypatch) -> None:
    """None, some or all pivots are too small; their coordinates are solved for together with the load factor."""
    monkeypatch.setattr(small_motion.SmallMotion.eliminate, "__defaults__", (smallest,))
    q, n = rng.uniform(-1, 1, chain.n), chain.n
    acting = LoadedState(q, np.zeros(n), np.zeros(6), False, np.arange(n))
    equations = load_path.Equations(chain, acting, np.zeros(chain.n))
    x = np.append(0.6, q + rng.normal(size=chain.n) * 0.1)
    _, by_s = equations.with_slope(x)
    K, k = stiffness_matrix(chain, x[1:], acting.qd, acting.wrench), np.diag(chain.stiffness)
    w = np.where(chain.stiffness > 0, x[0], 1.0)
    row = rng.normal(size=chain.n + 1)
    A = np.vstack([np.column_stack([by_s, k + w[:, None] * (K - k)]), row])
    wanted = rng.normal(size=chain.n + 1)
    neutral = np.abs(A[:-1, 1:]).max(axis=0) < 1e-12  # a waist along gravity has no stiffness
    wanted[1:][neutral] = 0.0
    row[1:][neutral] = A[-1, 1:][neutral] = 0.0
    left = A @ wanted
    found = equations.solve(by_s, row, left[:-1], float(left[-1]))
    assert found == pytest.approx(wanted, abs=1e-7)
    rounded = len(wanted) * np.finfo(float).eps * (np.abs(A) @ np.abs(wanted)).max()  # rounding of A x
    assert np.abs(found[1:][neutral]).max(initial=0.0) <= rounded
    assert len(equations.motion.skipped) == chain.n or smallest < 1


def test_pivots_and_eigenvalues_agree_on_stability(rng: Rng) -> None:
    """Tested: columns near their buckling load, and arms in random postures in space with and without a wrench."""
    seen = []
    for _ in range(40):
        column = cantilever("gauss", 6)
        force = np.array([-rng.uniform(2.0, 3.0), 0, 0, 0, 0, rng.uniform(-1, 1)])
        seen.append((column, rng.uniform(-0.1, 0.1, column.n), force))
    for name in ("t3_spatial", "three_links"):
        arm = fl.lump(fl.load_scene(ROOT / "models" / f"{name}.toml"))
        for _ in range(10):
            q = np.where(arm.stiffness > 0, 0.01, 2.0) * rng.normal(size=arm.n)
            seen += [(arm, q, np.zeros(6)), (arm, q, rng.normal(size=6) * 100)]
    found = []
    for arm, q, wrench in seen:
        zero, free = np.zeros(arm.n), np.arange(arm.n)
        for follower in (False, True):
            found.append(falls(arm, LoadedState(q, zero, wrench, follower, free)))
            assert found[-1] == tangent(arm, q, zero, wrench, follower, free).falls
    assert 20 < sum(found) < len(found) - 20
    resting = dataclasses.replace(fl.lump(fl.load_scene(ROOT / "models" / "three_links.toml")), gravity=np.zeros(3))
    zero = np.zeros(resting.n)
    assert not falls(resting, LoadedState(zero, zero, np.zeros(6), False, np.arange(resting.n))), (
        "a coordinate without stiffness has λ = 0"
    )


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
