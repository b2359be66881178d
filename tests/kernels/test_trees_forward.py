"""O(n) forward dynamics of trees, prismatic joints and free bases agrees with inverse dynamics and dense matrices."""

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from flexlink.common.errors import ArgumentError
from flexlink.describe.arm import Base
from flexlink.dynamics.rounding import of_mass_matrix
from flexlink.dynamics.terms import algorithms_of
from flexlink.kernels.forward.articulated import articulated
from flexlink.kernels.forward.articulated_rows import articulated_lanes_workspace, articulated_workspace
from flexlink.kernels.forward.inverse_mass import solve_on_articulated
from flexlink.kernels.forward.mass_plus import displacement, factor, place_bodies, solve
from flexlink.kernels.forward.mass_plus_cells import COUPLED, columns, put_couplings
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.forward.power_iteration import largest_eigenvalue
from flexlink.kernels.forward.solvers import dense, dense_workspace
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.layout import SLIDES, Rare
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.lanes import LANES
from tests.conftest import ALUMINIUM, SQUARE
from tests.support.words import refused
from validation.random_arms import Dice

EPS = np.finfo(float).eps
SEEDS = range(24)


def random_tree(seed: int, *lumpings: str) -> fl.Chain:
    """A chain of three to six links with revolute or prismatic joints, any parents, and a fixed or floating base."""
    dice = Dice(seed)
    links: list[fl.Link] = []
    for k in range(dice.one_of(3, 4, 5, 6)):
        on = dice.one_of("", "", "base", *(link.name for link in links)) if links else ""
        links.append(random_link(dice, f"link{k}", on, lumpings or ("gauss", "paper")))
    free = dice.chance(0.4)
    base = {"kind": "free", "mass": 20.0, "center": dice.three(0.2), "inertia": (3.0, 4.0, 5.0)} if free else {}
    scene = fl.Scene(
        name=f"tree {seed}",
        arm=fl.Arm(
            links=tuple(links), materials={"aluminium": ALUMINIUM}, sections={"square": SQUARE}, base=Base(**base),
            tip=fl.RigidBody(mass=0.7),
        ),
        gravity=dice.three(9.81),
        initial=fl.InitialState(
            joint_deg=tuple(10.0 * (link.joint.kind == "revolute") for link in links),
            joint_m=tuple(0.1 * (link.joint.kind == "prismatic") for link in links),
        ),
    )  # fmt: skip
    tips = {link.name for link in links} - {parent_of(links, k) for k in range(len(links))}
    return fl.lump(scene.varied({"wrench.on": dice.one_of(*sorted(tips))}))


def parent_of(links: list[fl.Link], k: int) -> str | None:
    """Name of the parent of a link."""
    return links[k].on or (links[k - 1].name if k else None)


def random_link(dice: Dice, name: str, on: str, lumpings: tuple[str, ...]) -> fl.Link:
    flex = dice.one_of("rigid", "z", "yz", "xyz")
    gear = {"gear_stiffness": dice.decades(3, 5), "gear_damping": 0.1} if dice.chance(0.3) else {}
    joint = fl.Joint(
        kind=dice.one_of("revolute", "prismatic"), axis=dice.direction(), locked=dice.chance(0.15),
        armature=dice.one_of(0.01, 2.0) if gear else dice.one_of(0.0, 0.05), viscous=0.2, coulomb=dice.one_of(0.0, 0.5),
        **gear,
    )  # fmt: skip
    return fl.Link(
        name=name, on=on, joint=joint, length=dice.linear(0.2, 1.0), flex=flex,
        segments=1 if flex == "rigid" else 5, material="aluminium", section="square",
        lumping="gauss" if flex == "rigid" else dice.one_of(*lumpings),
        mount=fl.Mount(xyz=dice.three(0.3), rpy_deg=dice.one_of((0.0, 0.0, 0.0), (90.0, 0.0, 0.0), dice.three(180.0))),
        hub=fl.RigidBody(mass=0.3, center=dice.three(0.1), inertia=(0.02, 0.02, 0.02)),
    )  # fmt: skip


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
    work = articulated_workspace(chain.bodies, chain.hinges, chain.gravity, chain.rare)
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
def solved(q, factors, u, v, r, posture):
    x = np.empty_like(r)
    place_bodies(q, posture)
    if len(posture.first) > 0:
        put_couplings(u, v, posture.coupled, factors)
    factor(factors, posture)
    solve(factors, r, x, posture)
    return x


@kernel
def solved_on_articulated(chain, wrench, state, r, x):
    work = articulated_workspace(chain.bodies, chain.hinges, chain.gravity, chain.rare)
    articulated(wrench, state[0], state[1], state[2], state[3], work)
    solve_on_articulated(r, np.zeros((len(chain.bodies), 6, LANES)), x, work)


@kernel
def displaced(q, change, posture):
    place_bodies(q, posture)
    return displacement(change, posture)


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
    chains = [random_tree(seed) for seed in SEEDS]
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
        chain, wrench = moved(random_tree(seed), rng), rng.normal(size=6)
        given = state_of(chain, rng)
        powers = []
        for method in (by_articulated_bodies, by_dense_matrix):
            state = given.copy()
            powers.append(method(chain.arrays, wrench, state))
            assert missed(chain, wrench, state) <= 1, (seed, method.__name__)
        assert abs(powers[0] - powers[1]) <= 1e-8 * np.abs(state[1] * state[2]).sum(), seed


def test_mass_methods_agree_and_those_for_serial_arms_are_refused(rng) -> None:
    for seed in SEEDS:
        chain = random_tree(seed)
        q = rng.uniform(-1, 1, chain.n)
        one, *others = (fl.mass_matrix(chain, q, algorithm=method) for method in algorithms_of(chain))
        assert all(np.abs(other - one).max() <= of_mass_matrix(chain, q) for other in others), seed
        if not chain.is_serial_revolute:
            for method in ("columns", "lower"):
                with refused(ArgumentError, "not-supported-here"):
                    fl.mass_matrix(chain, q, algorithm=method)


def test_eight_states_and_eight_chains_in_simd_lanes_equal_single_ones(rng) -> None:
    for seed in SEEDS[:12]:
        chain = moved(random_tree(seed), rng, 0.1)
        chains = [heavier(chain, factor) for factor in rng.uniform(1, 2, LANES)]
        *arrays, rare = zip(*(one.arrays for one in chains), strict=True)
        arrays = [*map(np.stack, arrays), None if rare[0] is None else Rare(*map(np.stack, zip(*rare, strict=True)))]
        wrench, state = rng.normal(size=(6, LANES)), np.stack([state_of(chain, rng) for _ in chains], axis=2)
        side_by_side(articulated_lanes_workspace(*arrays), wrench, state)
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


@pytest.mark.parametrize("number", [1.0, 1.0 + 0.7j])
@pytest.mark.parametrize("lumpings", [(), ("lobatto2", "lobatto4")], ids=["hinges", "cells"])
def test_solutions_with_a_modified_diagonal_equal_those_of_dense_matrices(number: complex, lumpings, rng) -> None:
    """(M + A) x = r within 1e-13 of |M + A| |x|, with A diagonal or full in cells of coupled springs."""
    for seed in SEEDS[:16]:
        chain = moved(random_tree(seed, *lumpings), rng)
        posture, q = space_posture(*chain.arrays), rng.uniform(-1, 1, chain.n)
        u, v = 1e-3 * number, 1e-6 * number
        own = u * chain.hinges["damping"] + v * chain.hinges["stiffness"] + chain.hinges["armature"] + 0.02 * number
        factors = np.zeros((chain.n, columns(posture.first)), dtype=type(number))
        factors[:, 0] = own
        dense = fl.mass_matrix(chain, q) + np.diag(own - chain.hinges["armature"])
        i, j = chain.couplings["inner"], chain.couplings["outer"]
        dense[i, j] = dense[j, i] = dense[i, j] + u * chain.couplings["damping"] + v * chain.couplings["stiffness"]
        r = (number * rng.normal(size=chain.n)).astype(type(number))
        x, free = solved(q, factors, u, v, r, posture), chain.hinges["prescribed"] == 0
        left = (dense @ x - r)[free]
        assert not x[~free].any()
        assert np.abs(left).max() <= 1e-13 * (np.abs(dense).max() * np.abs(x).sum() + np.abs(r).max()), seed
        if lumpings and len(chain.couplings):
            single = free & chain.slides
            inertia = 1.0 / factors[single, 1] - own[single]
            assert np.allclose(factors[single, COUPLED.inertia], inertia, rtol=1e-9)


def test_the_factors_of_forward_dynamics_solve_with_the_mass_matrix(rng) -> None:
    for seed in SEEDS[:12]:
        chain = moved(random_tree(seed), rng)
        state, r = state_of(chain, rng), rng.normal(size=(chain.n, LANES))
        x, free = np.zeros((chain.n, LANES)), chain.hinges["prescribed"] == 0
        M = fl.mass_matrix(chain, state[0])
        solved_on_articulated(chain.arrays, rng.normal(size=6), state, r, x)
        assert not x[~free].any()
        assert np.abs((M @ x - r)[free]).max() <= 1e-13 * (np.abs(M).max() * np.abs(x).sum() + np.abs(r).max()), seed


def test_the_displacement_norm_is_the_largest_over_all_segment_ends(rng) -> None:
    """Segment ends are the hinge points, and the points of the preceding body at the place of a prismatic hinge."""
    for seed in SEEDS[:12]:
        chain, h = random_tree(seed), 1e-6
        q, δ = rng.uniform(-1, 1, (2, chain.n))
        ahead, behind = (placed(chain, q + s * h * δ, q) for s in (1, -1))
        wanted = np.linalg.norm(ahead - behind, axis=1).max() / (2 * h)
        assert displaced(q, δ, space_posture(*chain.arrays)) == pytest.approx(wanted, rel=1e-7)
        for k in range(chain.n):
            wrong = np.where(np.arange(chain.n) == k, np.inf, δ)
            assert not displaced(q, wrong, space_posture(*chain.arrays)) < np.inf


def placed(chain: fl.Chain, q: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Hinge points at q, and points fixed to the parent bodies that coincide with hinge points at angles `where`."""
    then, now = forward_kinematics(chain.arrays, where), forward_kinematics(chain.arrays, q)
    ends = then.points.copy()
    for i, parent in enumerate(chain.bodies["parent"] - 1):
        if parent >= 0:
            lever = then.rotations[parent].T @ (then.points[i] - then.points[parent])
            ends[i] = now.points[parent] + now.rotations[parent] @ lever
    return np.vstack([now.points, ends])


def test_the_largest_eigenvalue_of_a_tree_equals_that_of_dense_matrices(rng) -> None:
    chain = random_tree(1)
    q = rng.uniform(-1, 1, chain.n)
    λ = np.linalg.eigvals(np.linalg.solve(fl.mass_matrix(chain, q), np.diag(chain.stiffness))).real.max()
    none = np.zeros(len(chain.couplings))
    found = largest_eigenvalue(chain.arrays, q, chain.stiffness, none, 100_000, 1e-13, space_posture(*chain.arrays))
    assert found == pytest.approx(λ, rel=1e-6)
