"""(M + A) x = r in O(n), and the displacements due to small changes of the angles."""

from pathlib import Path

import numpy as np
import pytest

import flexlink as fl
from flexlink.kernels.forward.mass_plus import displacement, factor, place_bodies, solve
from flexlink.kernels.forward.mass_plus_cells import COUPLED, FACTORS, columns
from flexlink.kernels.forward.mass_plus_plane import plane_posture
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.tools.compiler import kernel
from tests.chain.test_cells import CHAINS
from tests.conftest import compiled, flexible, make_scene, nasty_scene
from tests.kernels.test_trees_forward import moved, tree

MOVED = fl.PrescribedMotion(link="b", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
PLANE = make_scene(flexible("a"), flexible("b", mount=fl.Mount(rpy_deg=(180.0, 0.0, 0.0))))
SCENES = {"plane": PLANE, "plane, moved": PLANE.varied({"motion": (MOVED,)}), "space": nasty_scene()}
TREES = {f"tree {seed}": lambda seed=seed: tree(seed) for seed in range(8)}
TREES |= {f"tree {seed} of cells": lambda seed=seed: tree(seed, cells=True) for seed in range(8, 16)}


def chain_of(name: str, folder: Path) -> fl.Chain:
    if name in TREES:
        return moved(TREES[name](), np.random.default_rng(5))
    return fl.lump(SCENES[name]) if name in SCENES else CHAINS[name](folder)


@kernel
def solved(q, factors, r, posture):
    x = np.empty_like(r)
    place_bodies(q, posture)
    factor(factors, posture)
    solve(factors, r, x, posture)
    return x


@kernel
def displaced(q, change, posture):
    place_bodies(q, posture)
    return displacement(change, posture)


def posture_of(chain: fl.Chain) -> tuple:
    return (plane_posture if chain.is_planar else space_posture)(chain.arrays)


@compiled
@pytest.mark.parametrize("name", [*SCENES, *CHAINS, *TREES])
@pytest.mark.parametrize("z", [1e-4, 0.01 + 0.007j, 3.0, 0.01 - 2.0j])
def test_the_solution_equals_that_of_the_dense_matrix(name: str, z: complex, tmp_path: Path) -> None:
    """A = z D + z² K, with rotors, and with an own number for every joint; the residual is a few roundings."""
    chain, rng = chain_of(name, tmp_path), np.random.default_rng(1)
    q, r = 0.5 * rng.normal(size=chain.n), z * rng.normal(size=chain.n)
    A = z * chain.matrix("damping") + z * z * chain.matrix("stiffness") + np.diag(z * rng.uniform(0.1, 1.0, chain.n))
    dense, posture = fl.mass_matrix(chain, q) + A, posture_of(chain)
    factors = np.zeros((chain.n, columns(posture.first)), dtype=type(z))
    own = factors[:, FACTORS.A] = np.diag(A) + chain.hinges["armature"]
    for k, first in enumerate(posture.first if len(chain.couplings) else ()):
        factors[k, COUPLED.L : COUPLED.L + k - first] = A[k, first:k]
    x, free = solved(q, factors, r.astype(type(z)), posture), chain.hinges["prescribed"] == 0
    left = (dense @ x - r)[free]
    assert not x[~free].any()
    assert np.abs(left).max() <= 1e-13 * (np.abs(dense).max() * np.abs(x).sum() + np.abs(r).max())
    wanted = np.linalg.solve(dense[np.ix_(free, free)], r[free])
    condition = np.linalg.cond(dense[np.ix_(free, free)])
    assert np.abs(x[free] - wanted).max() <= 100 * np.finfo(float).eps * condition * np.abs(wanted).max()
    if len(chain.couplings):
        single = free & chain.slides
        assert np.allclose(factors[single, COUPLED.inertia], 1.0 / factors[single, 1] - own[single], rtol=1e-9)


@compiled
@pytest.mark.parametrize("name", [*SCENES, *TREES])
def test_the_displacement_is_the_largest_motion_of_any_segment_end(name: str, tmp_path: Path) -> None:
    """Segment ends are the hinge points, and the points of the preceding body at the place of a prismatic hinge."""
    chain, rng, h = chain_of(name, tmp_path), np.random.default_rng(2), 1e-6
    q, δ = rng.uniform(-1, 1, (2, chain.n))
    ahead, behind = (placed(chain, q + s * h * δ, q) for s in (1, -1))
    wanted = np.linalg.norm(ahead - behind, axis=1).max() / (2 * h)
    assert displaced(q, δ, posture_of(chain)) == pytest.approx(wanted, rel=1e-6)
    for k in range(chain.n):
        wrong = np.where(np.arange(chain.n) == k, np.inf, δ)
        assert not displaced(q, wrong, posture_of(chain)) < np.inf


def placed(chain: fl.Chain, q: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Hinge points at q, and points fixed to the parent bodies that coincide with hinge points at angles `where`."""
    then, now = forward_kinematics(chain.arrays, where), forward_kinematics(chain.arrays, q)
    ends = then.points.copy()
    for i, parent in enumerate(chain.bodies["parent"] - 1):
        if parent >= 0:
            lever = then.rotations[parent].T @ (then.points[i] - then.points[parent])
            ends[i] = now.points[parent] + now.rotations[parent] @ lever
    return np.vstack([now.points, ends])
