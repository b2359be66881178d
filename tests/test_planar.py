"""Chains in a plane: what only the recursion in a plane has to get right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import flexible, make_scene, random_state

import flexlink as fl

EPS = np.finfo(float).eps
TIP = fl.Payload(mass=0.5, inertia=(0.1, 0.2, 0.3))


def assert_solves_its_equation_of_motion(chain: fl.Chain, rng: np.random.Generator) -> None:
    """Inverse dynamics, which knows no plane, gives the torques back, to some roundings of the largest term."""
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
    """Two bodies without hinges, turned in the plane and moved, that hang where body `place` begins."""
    fixed = np.repeat(chain.bodies[place - 1 : place], 2)
    fixed["first"] = fixed["stop"] = chain.bodies["first"][place]
    c, s = np.cos(0.4), np.sin(0.4)
    fixed["rotation"], fixed["turned"] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], 1
    fixed["translation"] = [[0.3, 0.2, 0.1], [-0.1, 0.25, 0.4]]
    fixed["mass"], fixed["inertia"] = [1.5, 0.7], [np.diag([0.1, 0.2, 0.25]), np.diag([0.3, 0.2, 0.15])]
    return fixed


@pytest.mark.parametrize("place", [1, 4, 7])
def test_bodies_without_hinges_hang_on_the_link_before_them(place: int, rng: np.random.Generator) -> None:
    skew = fl.Mount(rpy_deg=(-75.0, 20.0, 30.0), xyz=(0.1, -0.2, 0.3))
    links = flexible("a", segments=4, mount=skew), flexible("b", segments=4, joint=fl.Joint(armature=0.2, coulomb=0.3))
    chain = fl.lump(make_scene(*links, tip=TIP, gravity=(3.0, -4.0, 8.0)))
    bodies = np.concatenate([chain.bodies[:place], fixed_bodies(chain, place), chain.bodies[place:]])
    assert_solves_its_equation_of_motion(dataclasses.replace(chain, bodies=bodies), rng)
