"""(M + A) x = r in O(n), and the displacements due to small changes of the angles."""

import numpy as np
import pytest

import flexlink as fl
from flexlink.kernels.forward.mass_plus import displacement, factor, place_bodies, solve
from flexlink.kernels.forward.mass_plus_cells import FACTORS
from flexlink.kernels.forward.mass_plus_plane import plane_posture
from flexlink.kernels.forward.mass_plus_space import space_posture
from flexlink.kernels.tools.compiler import kernel
from tests.conftest import compiled, flexible, make_scene, nasty_scene

MOVED = fl.PrescribedMotion(link="b", times=(0.0,), angle_deg=(0.0,), rate_deg=(0.0,), acceleration_deg=(0.0,))
PLANE = make_scene(flexible("a"), flexible("b", mount=fl.Mount(rpy_deg=(180.0, 0.0, 0.0))))
SCENES = {"plane": PLANE, "plane, moved": PLANE.varied({"motion": (MOVED,)}), "space": nasty_scene()}
EPS = np.finfo(float).eps


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
    return (plane_posture if chain.is_planar else space_posture)(*chain.arrays)


@compiled
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("number", [1.0, 1.0 + 0.7j, 0.01 - 2.0j])
def test_the_solution_equals_that_of_the_dense_matrix(name: str, number: complex) -> None:
    """The error is at most 100 eps cond(M + A), due to a few roundings per joint in the elimination."""
    chain, rng = fl.lump(SCENES[name]), np.random.default_rng(1)
    q, r = rng.uniform(-1, 1, chain.n), number * rng.normal(size=chain.n)
    A = number * rng.uniform(0.1, 1.0, chain.n) + chain.hinges["armature"]
    free = np.flatnonzero(chain.hinges["prescribed"] == 0)
    dense = fl.mass_matrix(chain, q) + np.diag(A - chain.hinges["armature"])
    wanted = np.zeros(chain.n, dtype=type(number))
    wanted[free] = np.linalg.solve(dense[np.ix_(free, free)], r[free])
    factors = np.zeros((chain.n, FACTORS.size), dtype=type(number))
    factors[:, 0] = A
    found = solved(q, factors, r.astype(type(number)), posture_of(chain))
    allowed = 100 * EPS * np.linalg.cond(dense[np.ix_(free, free)]) * np.abs(wanted).max()
    assert np.abs(found - wanted).max() <= allowed


@compiled
@pytest.mark.parametrize("name", SCENES)
def test_the_displacement_is_the_largest_motion_of_any_segment_end(name: str) -> None:
    chain, rng = fl.lump(SCENES[name]), np.random.default_rng(2)
    q, change = rng.uniform(-1, 1, chain.n), rng.normal(size=chain.n)
    small = 1e-6
    before, after = (fl.frames(chain, q + s * small * change).points for s in (-0.5, 0.5))
    wanted = np.linalg.norm(after - before, axis=1).max() / small
    assert displaced(q, change, posture_of(chain)) == pytest.approx(wanted, rel=1e-6)
