"""Random arms use every key of a link, and all solvers and engines agree on them."""

import numpy as np
import pytest

import flexlink as fl
from flexlink.describe.spec import Spec
from flexlink.describe.writing import without_defaults
from flexlink.engines import load
from validation.random_arms import random_arm, random_tree

EPS = np.finfo(float).eps


def keys_of(table: object, above: str = "") -> set[str]:
    """Paths of all keys in a table."""
    if isinstance(table, dict):
        return {f"{above}{key}" for key in table}.union(*(keys_of(v, f"{above}{k}.") for k, v in table.items()))
    return set().union(*(keys_of(item, above) for item in table)) if isinstance(table, list) else set()


def fields(kind: type[Spec], above: str = "") -> set[str]:
    return {f"{above}{name}" for name in kind.__struct_fields__}


def test_random_arms_use_every_key_of_a_link() -> None:
    draws = [draw(seed) for seed in range(100) for draw in (random_arm, random_tree)]
    found = keys_of([without_defaults(link) for scene in draws for link in scene.arm.links])
    wanted = fields(fl.Link) | fields(fl.Joint, "joint.") | fields(fl.Mount, "mount.")
    wanted |= fields(fl.details.DenavitHartenberg, "dh.") | fields(fl.RigidBody, "end.") | {"friction.coulomb"}
    # these have separate cases and tests
    left_out = {"curvature", "drag", "modes", "shear", "stretch", "thermal", "twist"}
    left_out |= {f"joint.{key}" for key in ("name", "quadratic", "hardening", "viscous_lag")}
    assert wanted - left_out <= found


def test_a_seed_always_gives_the_same_arm() -> None:
    assert random_arm(7) == random_arm(7)
    assert random_arm(7) != random_arm(8)
    assert {len(random_arm(seed).arm.links) for seed in range(60)} == {1, 2, 3, 4, 5, 6}


def test_a_disc_beyond_the_triangle_inequality_by_rounding_is_exported() -> None:
    """The file contains 0.1 + 0.2 instead of 0.1 + 0.2 + ε, because ε violates the triangle inequality."""
    disc = fl.RigidBody(mass=1.0, inertia=(0.1, 0.2, np.nextafter(0.1 + 0.2, 1.0)))
    arm = fl.Arm(links=(fl.Link(name="a", hub=disc),))
    chain = fl.lump(fl.Scene(name="disc", arm=arm, initial=fl.InitialState(joint_deg=(0.0,))))
    engine = load("mujoco", chain)
    assert engine.mass_matrix(np.zeros(1))[0, 0] == pytest.approx(0.3, rel=4 * EPS)
