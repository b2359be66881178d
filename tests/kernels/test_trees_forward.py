"""O(n) forward dynamics of trees, prismatic joints and free bases agrees with inverse dynamics and dense matrices."""

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.errors import ArgumentError
from flexlink.dynamics.rounding import of_mass_matrix
from flexlink.dynamics.terms import algorithms_of
from flexlink.kernels.forward.articulated import articulated
from flexlink.kernels.forward.articulated_rows import articulated_lanes_workspace, articulated_workspace
from flexlink.kernels.forward.inverse_mass import solve_on_articulated
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.forward.power_iteration import largest_eigenvalue
from flexlink.kernels.forward.solvers import dense, dense_workspace
from flexlink.kernels.layout import SLIDES, ChainArrays, Rare
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.lanes import LANES
from tests.support.words import refused
from validation.random_arms import random_tree

EPS = np.finfo(float).eps
SEEDS = range(24)


def tree(seed: int, *, cells: bool = False) -> fl.Chain:
    """A random tree with revolute or prismatic joints on a fixed or floating base, on request with coupled springs."""
    scene = random_tree(seed)
    bends = [link.name for link in scene.arm.links if link.flex != "rigid"] if cells else []
    rules = {f"link.{name}.lumping": ("lobatto2", "lobatto4")[k % 2] for k, name in enumerate(bends)}
    return fl.lump(scene.varied({**rules, **{f"link.{name}.segments": 5 for name in bends}}))


def moved(chain: fl.Chain, rng: np.random.Generator, share: float = 0.2) -> fl.Chain:
    """The chain with prescribed motion of some joints."""
    hinges = chain.hinges.copy()
    hinges["prescribed"] = (rng.random(chain.n) < share) & (hinges["stiffness"] == 0)
    return dataclasses.replace(chain, hinges=hinges)


def state_of(chain: fl.Chain, rng: np.random.Generator) -> np.ndarray:
    """Rows q, q̇, τ, and q̈ of joints with prescribed motion, shape (4, n)."""
    state = rng.uniform(-1, 1, (4, chain.n))
    state[1] *= 3.0
    state[3, chain.hinges["prescribed"] == 0] = 0.0
    return state


@kernel
def by_articulated_bodies(chain, wrench, state):
    """Write q̈ to the last row, and τ of given motions to the third; return the power."""
    work = articulated_workspace(chain)
    return articulated(wrench, state[0], state[1], state[2], state[3], work)


@kernel
def by_dense_matrix(chain, wrench, state):
    """The same as `by_articulated_bodies`, by Cholesky's method."""
    return dense(wrench, state[0], state[1], state[2], state[3], dense_workspace(chain, False))


@kernel
def side_by_side(work, wrench, state):
    """The same as `by_articulated_bodies` for eight states in SIMD lanes, (4, n, 8)."""
    articulated(wrench, state[0], state[1], state[2], state[3], work)


@kernel
def solved_on_articulated(chain, wrench, state, r, x):
    work = articulated_workspace(chain)
    articulated(wrench, state[0], state[1], state[2], state[3], work)
    solve_on_articulated(r, np.zeros((len(chain.bodies), 6, LANES)), x, work)


def missed(chain: fl.Chain, wrench: np.ndarray, state: np.ndarray) -> float:
    """Residual of the equations of motion for τ and q̈, in units of the rounding of their terms."""
    q, qd, tau, qdd = state
    inertial = fl.inverse_dynamics(chain, q, qd, qdd, tip_wrench=wrench)
    parts = tau, inertial, fl.elastic_torque(chain, q), fl.friction_torque(chain, qd)
    left = tau - inertial - parts[2] - parts[3]
    M = fl.mass_matrix(chain, q)
    size = np.abs(M).max() * np.abs(qdd).sum() + max(np.abs(part).max() for part in parts)
    return float(np.abs(left).max() / (10 * np.sqrt(chain.n) * EPS * size))


def test_random_trees_include_every_kind_of_joint_and_base() -> None:
    chains = [tree(seed) for seed in SEEDS]
    slides = [chain.hinges["axis"] >= SLIDES for chain in chains]
    assert sum(chain.has_free_base for chain in chains) > 5
    assert sum(not chain.is_serial for chain in chains) > 15
    assert sum(bool(some[6 * chain.has_free_base :].any()) for some, chain in zip(slides, chains, strict=True)) > 15
    assert any(chain.bodies["loaded"][-1] == 0 for chain in chains)
    sizes = {int(size) for chain in chains for size in chain.bodies["stop"] - chain.bodies["first"]}
    assert sizes == {0, 1, 2, 3}


def test_inverse_dynamics_reproduces_the_torques(rng) -> None:
    """Articulated bodies and dense matrices give the accelerations, also with prescribed motion, and equal powers."""
    for seed in SEEDS:
        chain, wrench = moved(tree(seed), rng), rng.normal(size=6)
        given = state_of(chain, rng)
        powers = []
        for method in (by_articulated_bodies, by_dense_matrix):
            state = given.copy()
            powers.append(method(chain.arrays, wrench, state))
            assert missed(chain, wrench, state) <= 1, (seed, method.__name__)
        assert abs(powers[0] - powers[1]) <= 1e-8 * np.abs(state[1] * state[2]).sum(), seed


def test_mass_methods_agree_and_those_for_serial_arms_are_refused(rng) -> None:
    for seed in SEEDS:
        chain = tree(seed)
        q = rng.uniform(-1, 1, chain.n)
        one, *others = (fl.mass_matrix(chain, q, algorithm=method) for method in algorithms_of(chain))
        assert all(np.abs(other - one).max() <= of_mass_matrix(chain, q) for other in others), seed
        if not chain.is_serial_revolute:
            for method in ("columns", "lower"):
                with refused(ArgumentError, "not-supported-here"):
                    fl.mass_matrix(chain, q, algorithm=method)


def test_eight_states_and_eight_chains_in_simd_lanes_equal_single_ones(rng) -> None:
    for seed in SEEDS[:12]:
        chain = moved(tree(seed), rng, 0.1)
        chains = [heavier(chain, factor) for factor in rng.uniform(1, 2, LANES)]
        *arrays, rare = zip(*(one.arrays for one in chains), strict=True)
        arrays = [*map(np.stack, arrays), None if rare[0] is None else Rare(*map(np.stack, zip(*rare, strict=True)))]
        wrench, state = rng.normal(size=(6, LANES)), np.stack([state_of(chain, rng) for _ in chains], axis=2)
        side_by_side(articulated_lanes_workspace(ChainArrays(*arrays)), wrench, state)
        for lane, one in enumerate(chains):
            assert missed(one, wrench[:, lane].copy(), state[:, :, lane]) <= 1, (seed, lane)


def heavier(chain: fl.Chain, factor: float) -> fl.Chain:
    """The chain with other masses and orientations."""
    bodies = chain.bodies.copy()
    bodies["mass"] *= factor
    c, s = np.cos(factor), np.sin(factor)
    bodies["rotation"][1] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ bodies["rotation"][1]
    bodies["turned"][1] = 1
    return dataclasses.replace(chain, bodies=bodies)


def test_the_factors_of_forward_dynamics_solve_with_the_mass_matrix(rng) -> None:
    for seed in SEEDS[:12]:
        chain = moved(tree(seed), rng)
        state, r = state_of(chain, rng), rng.normal(size=(chain.n, LANES))
        x, free = np.zeros((chain.n, LANES)), chain.hinges["prescribed"] == 0
        M = fl.mass_matrix(chain, state[0])
        solved_on_articulated(chain.arrays, rng.normal(size=6), state, r, x)
        assert not x[~free].any()
        assert np.abs((M @ x - r)[free]).max() <= 1e-13 * (np.abs(M).max() * np.abs(x).sum() + np.abs(r).max()), seed


def test_the_largest_eigenvalue_of_a_tree_equals_that_of_dense_matrices(rng) -> None:
    chain = tree(1)
    q = rng.uniform(-1, 1, chain.n)
    λ = np.linalg.eigvals(np.linalg.solve(fl.mass_matrix(chain, q), np.diag(chain.stiffness))).real.max()
    none = np.zeros(len(chain.couplings))
    found = largest_eigenvalue(chain.arrays, q, chain.stiffness, none, 100_000, 1e-13, space_posture(chain.arrays))
    assert found == pytest.approx(λ, rel=1e-6)
