"""Planar chains: properties specific to the planar recursion."""

import dataclasses

import mpmath
import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics.rounding import of_residual
from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.bodies.plane import LINK, planar_workspace
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.tools.sincos import OFTEN, less_whole_turns
from tests.conftest import flexible, make_scene, random_state

EPS = np.finfo(float).eps
TIP = fl.RigidBody(mass=0.5, inertia=(0.1, 0.2, 0.3))


def assert_solves_its_equation_of_motion(chain: fl.Chain, rng: np.random.Generator) -> None:
    """Check that spatial inverse dynamics of the computed q̈ returns the torques, up to a few roundings."""
    assert chain.is_planar
    for _ in range(5):
        q, qd = random_state(chain, rng)
        tau, wrench = rng.normal(size=chain.n), rng.normal(size=6)
        qdd = fl.forward_dynamics(chain, q, qd, tau, tip_wrench=wrench)
        joints = fl.elastic_torque(chain, q) + fl.friction_torque(chain, qd)
        back = fl.inverse_dynamics(chain, q, qd, qdd, tip_wrench=wrench) + joints
        scale = np.abs(fl.mass_matrix(chain, q)) @ np.abs(qdd) + np.abs(joints) + 1.0
        assert np.abs(back - tau).max() <= 100 * EPS * scale.max()


def fixed_bodies(chain: fl.Chain, place: int) -> np.ndarray:
    """Two bodies without hinges, rotated and moved in the plane, attached at the start of body `place`."""
    fixed = np.repeat(chain.bodies[place - 1 : place], 2)
    fixed["first"] = fixed["stop"] = chain.bodies["first"][place]
    c, s = np.cos(0.4), np.sin(0.4)
    fixed["rotation"], fixed["turned"] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], 1
    fixed["translation"] = [[0.3, 0.2, 0.1], [-0.1, 0.25, 0.4]]
    fixed["mass"], fixed["inertia"] = [1.5, 0.7], [np.diag([0.1, 0.2, 0.25]), np.diag([0.3, 0.2, 0.15])]
    return fixed


@pytest.mark.parametrize("place", [1, 4, 7])
def test_bodies_without_hinges_move_with_the_link_before_them(place: int, rng: np.random.Generator) -> None:
    skew = fl.Mount(rpy_deg=(-75.0, 20.0, 30.0), xyz=(0.1, -0.2, 0.3))
    links = flexible("a", segments=4, mount=skew), flexible("b", segments=4, joint=fl.Joint(armature=0.2, coulomb=0.3))
    chain = fl.lump(make_scene(*links, tip=TIP, gravity=(3.0, -4.0, 8.0)))
    bodies = np.concatenate([chain.bodies[:place], fixed_bodies(chain, place), chain.bodies[place:]])
    assert_solves_its_equation_of_motion(dataclasses.replace(chain, bodies=bodies), rng)


def random_chain(rng: np.random.Generator) -> fl.Chain:
    """One to four links in a skew plane, some reversed or locked, with rotors and random mass centres."""
    links = []
    for k in range(rng.integers(1, 5)):
        over = fl.Mount(rpy_deg=(180.0 * rng.integers(2), 0.0, rng.uniform(-180, 180)), xyz=tuple(rng.normal(size=3)))
        skew = fl.Mount(rpy_deg=tuple(rng.uniform(-90, 90, 3)), xyz=tuple(rng.normal(size=3)))
        joint = fl.Joint(armature=rng.uniform(0, 2)) if k == 0 or rng.random() < 0.7 else fl.Joint(locked=True)
        links.append(flexible(f"l{k}", segments=int(rng.integers(2, 6)), mount=over if k else skew, joint=joint))
    tip = fl.RigidBody(mass=rng.uniform(0.1, 2), inertia=(0.1, 0.2, 0.25))
    chain = fl.lump(make_scene(*links, tip=tip, gravity=tuple(rng.normal(0, 8, 3))))
    hinges, bodies = chain.hinges.copy(), chain.bodies.copy()
    hinges["armature"] += rng.uniform(0, 0.1, chain.n) * rng.integers(2)
    bodies["center"] += rng.normal(0, 0.1, bodies["center"].shape)
    return dataclasses.replace(chain, hinges=hinges, bodies=bodies)


def test_planar_torques_equal_those_of_the_spatial_recursion(rng: np.random.Generator) -> None:
    """For random chains with reversed links, the torques differ only by rounding."""
    worst, signs = 0.0, set()
    for _ in range(60):
        chain, wrench = random_chain(rng), rng.normal(0, 5, 6)
        assert chain.is_planar
        q, qd = random_state(chain, rng)
        qdd, planar, spatial = rng.normal(0, 20, chain.n), np.empty(chain.n), np.empty(chain.n)
        work = planar_workspace(chain.arrays)
        powers = [
            inverse_dynamics_into(chain.arrays, wrench, q, qd, qdd, tau, scratch)
            for tau, scratch in ((planar, work), (spatial, rne_workspace(chain.arrays)))
        ]
        worst = max(worst, np.abs(planar - spatial).max() / of_residual(chain, q, qd, qdd, 0 * q, tip_wrench=wrench))
        assert powers[0] == pytest.approx(powers[1], abs=8 * EPS * np.abs(qd).sum() * np.abs(wrench).sum())
        signs |= set(work.links[:, LINK.sign])
    assert signs == {1.0, -1.0}
    assert worst <= 1


def two_links(armature: float = 0.0) -> fl.Chain:
    links = flexible("a", segments=4), flexible("b", segments=4)
    chain = fl.lump(make_scene(*links, tip=TIP, gravity=(3.0, -4.0, 8.0)))
    hinges = chain.hinges.copy()
    hinges["armature"][chain.active] = armature
    return dataclasses.replace(chain, hinges=hinges)


def in_space(chain: fl.Chain) -> fl.Chain:
    """The same chain with its last hinge slightly out of the plane, so that the spatial recursion is used."""
    bodies = chain.bodies.copy()
    bodies["turned"][-2], bodies["rotation"][-2] = 1, [[1.0, 0.0, 0.0], [0.0, 1.0, 1e-13], [0.0, -1e-13, 1.0]]
    chain = dataclasses.replace(chain, bodies=bodies)
    assert not chain.is_planar
    return chain


def errors_beside_space(
    chain: fl.Chain, q: np.ndarray, rng: np.random.Generator, joints: slice | np.ndarray = slice(None)
) -> float:
    """Largest relative difference between planar and spatial q̈ of these coordinates, for one state and for a batch."""
    qd, tau = rng.normal(size=(2, chain.n))
    exact = fl.forward_dynamics(in_space(chain), q, qd, tau)[joints]
    one, many = (fl.forward_dynamics(chain, state, qd, tau) for state in (q, np.array([q, q])))
    return float(max(np.abs(found[joints] - exact).max() for found in (one, *many)) / np.abs(exact).max())


@pytest.mark.parametrize("armature", [0.0, 1.0, 1e4, 1e8])
def test_heavy_rotors_do_not_reduce_accuracy(armature: float, rng: np.random.Generator) -> None:
    """The error of q̈ is about 1000 eps for any armature, because cond(M) of the links is about 1000.

    The accelerations of heavy rotors are small, but they have the same relative accuracy.
    """
    chain = two_links(armature)
    q = random_state(chain, rng)[0]
    assert errors_beside_space(chain, q, rng) < 1e-12
    assert errors_beside_space(chain, q, rng, chain.active) < 1e-12


@pytest.mark.parametrize("turns", [0.0, 1e3, 1e7, 1e12])
def test_angles_of_any_size_keep_full_accuracy(turns: float, rng: np.random.Generator) -> None:
    """An angle of any number of turns is treated as an exact number, also in sums of angles over many links."""
    chain = two_links()
    q = random_state(chain, rng)[0]
    q[chain.active] += 2 * np.pi * turns * np.array([1.0, -1.7])
    assert errors_beside_space(chain, q, rng) < 1e-12
    planar, spatial = (np.empty(chain.n) for _ in range(2))
    qdd = rng.normal(size=chain.n)
    for tau, work in ((planar, planar_workspace(chain.arrays)), (spatial, rne_workspace(chain.arrays))):
        inverse_dynamics_into(chain.arrays, np.zeros(6), q, np.zeros(chain.n), qdd, tau, work)
    np.testing.assert_allclose(planar, spatial, rtol=0, atol=1e-12 * np.abs(spatial).max())


def test_large_angles_in_one_simd_lane_do_not_change_the_other_lanes(rng: np.random.Generator) -> None:
    chain = two_links()
    q, qd, tau = rng.normal(size=(3, chain.n))
    q[0], q[4] = 40.0, -15.0
    beside = np.array([q, q + 1e5])
    calm, turned = (fl.forward_dynamics(chain, state, qd, tau)[0] for state in (np.array([q, q]), beside))
    np.testing.assert_array_equal(calm, turned)


@pytest.mark.parametrize("scale", [1.0, 100.0, 4e8, 1e12])
def test_angles_reduced_to_one_turn_are_correct_to_an_ulp_of_pi(scale: float, rng: np.random.Generator) -> None:
    x = np.concatenate([rng.uniform(-scale, scale, 500), np.rint(rng.uniform(-scale, scale, 500)) * np.pi])
    less = x.copy()
    less_whole_turns(less)
    with mpmath.workdps(60):
        for angle, value in zip(x.tolist(), less.tolist(), strict=True):
            whole = (mpmath.mpf(angle) - mpmath.mpf(value)) / (2 * mpmath.pi)
            assert abs(whole - mpmath.nint(whole)) * 2 * mpmath.pi <= np.spacing(np.pi)
            assert value == angle if abs(angle) < OFTEN else abs(value) <= 1.001 * np.pi
