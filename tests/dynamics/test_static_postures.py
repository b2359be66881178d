"""Equilibria computed in sequence are bit-equal to those of separate calls of `solve_static`."""

from __future__ import annotations

import numpy as np
import pytest

import flexlink as fl
from flexlink.dynamics import static_postures as module
from flexlink.dynamics.static_postures import _rounded, static_postures
from tests.conftest import flexible, make_scene, nasty_scene


def one_by_one(chain: fl.Chain, angles: np.ndarray) -> np.ndarray:
    q, held = np.zeros(chain.n), chain.active
    found = []
    for row in angles:
        q = q.copy()
        q[held] = row
        q = fl.solve_static(chain, q, locked=held.tolist()).q
        found.append(q)
    return np.array(found)


def way(start: object, end: object, rows: int) -> np.ndarray:
    return np.linspace(np.radians(start), np.radians(end), rows)


GEARED = make_scene(
    flexible("a", "xyz", 3, joint=fl.Joint(gear_stiffness=2e3, armature=0.5)), flexible("b", "yz", 3),
    gravity=(0.0, 5.0, 9.81), tip=fl.RigidBody(mass=1.0),
)  # fmt: skip


TURNED = make_scene(
    flexible("a", "xyz", lumping="lobatto2_rotation"), gravity=(0.0, 5.0, 9.81), tip=fl.RigidBody(mass=5.0)
)


@pytest.mark.parametrize("scene", [GEARED, nasty_scene(), make_scene(flexible("a"), gravity=(0.0, 9.81, 0.0)), TURNED])
def test_equilibria_of_a_sequence_equal_those_found_one_by_one(scene: fl.Scene) -> None:
    chain = fl.lump(scene)
    d = len(chain.active)
    angles = np.concatenate([way([0.0] * d, [40.0] * d, 12), way([40.0] * d, [40.0] * d, 2)])
    wanted = one_by_one(chain, angles)
    np.testing.assert_allclose(static_postures(chain, angles), wanted, rtol=0, atol=1e-15)
    held = fl.gravity_torque(chain, static_postures(chain, angles))
    np.testing.assert_allclose(held, fl.gravity_torque(chain, wanted), rtol=1e-12, atol=1e-12)


def test_equilibria_of_a_sequence_respect_rest_angles_of_springs() -> None:
    chain = fl.lump(make_scene(flexible("a", segments=3), gravity=(0.0, 9.81, 0.0)))
    hinges = chain.hinges.copy()
    hinges["rest"][1:] = 0.02
    chain = fl.Chain(chain.name, chain.bodies, hinges, chain.gravity, chain.coordinates, chain.link_names)
    angles = way([0.0], [10.0], 4)
    np.testing.assert_allclose(static_postures(chain, angles), one_by_one(chain, angles), rtol=0, atol=1e-15)


def test_after_a_jump_of_the_joints_the_load_is_applied_in_steps(monkeypatch) -> None:
    """A soft column jumps from hanging to upright: the nearest root is not the wanted equilibrium."""
    soft = make_scene(flexible("a", segments=7), gravity=(9.81, 0.0, 0.0), tip=fl.RigidBody(mass=20.0))
    chain = fl.lump(soft.varied({"material.aluminium.young": 3e8}))
    angles = np.radians([[0.0], [1.0], [100.0], [101.0], [179.0]])
    evaluated: list[float] = []
    solved = module.static_posture

    def counted(chain: fl.Chain, q: np.ndarray, *more: object) -> np.ndarray:
        evaluated.append(float(np.degrees(q[0])))
        return solved(chain, q, *more)

    monkeypatch.setattr(module, "static_posture", counted)
    np.testing.assert_allclose(static_postures(chain, angles), one_by_one(chain, angles), rtol=0, atol=1e-13)
    assert evaluated[0] == 0.0
    assert 100.0 in np.round(evaluated, 9)
    assert len(evaluated) < len(angles)


def test_a_column_that_buckles_in_a_sequence_does_not_stay_upright() -> None:
    """Beyond the buckling load the upright posture is not the wanted equilibrium; the result equals separate calls."""
    soft = make_scene(flexible("a", segments=5), gravity=(-9.81, 0.0, 0.0), tip=fl.RigidBody(mass=20.0))
    chain = fl.lump(soft.varied({"material.aluminium.young": 2e8}))
    angles = way([60.0], [0.0], 7)
    np.testing.assert_allclose(static_postures(chain, angles), one_by_one(chain, angles), rtol=0, atol=1e-12)


@pytest.mark.parametrize("decimals", range(-2, 25))
def test_rounding_to_decimals_equals_python_round(decimals: int, rng: np.random.Generator) -> None:
    size = 10.0 ** rng.integers(-12, 3)
    ties = (rng.integers(-1000, 1000, 300) + 0.5) / 10.0**decimals
    x = np.concatenate([size * rng.normal(size=2000), ties, [0.0]])
    found = _rounded(x[:, None], [decimals])[:, 0]
    np.testing.assert_array_equal(found, [round(each, decimals) for each in x.tolist()])
