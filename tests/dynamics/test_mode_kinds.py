"""Elastic, pendulum and rigid modes, and the default posture for small motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import flexible, make_scene


def swinging(gravity: float, **changes: object) -> fl.Chain:
    """One flexible link on a free joint; with gravity along x it hangs."""
    return fl.lump(make_scene(flexible("a", "z", 6), gravity=(gravity, 0.0, 0.0)).varied(changes))


def test_the_first_mode_of_a_hanging_link_is_a_pendulum_and_higher_ones_are_elastic() -> None:
    found = fl.modes(swinging(9.81))
    assert found.kinds == ("pendulum", *["elastic"] * (len(found.kinds) - 1))
    assert found.elastic_shares[0] < 0.01
    assert (found.elastic_shares[1:] > 0.99).all()
    assert found.first_elastic_hertz == found.hertz[1]


def test_the_unstable_mode_of_an_upright_arm_is_a_pendulum_mode() -> None:
    found = fl.modes(swinging(-9.81))
    assert np.isnan(found.hertz[0])
    assert found.kinds[:2] == ("pendulum", "elastic")


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_without_gravity_a_free_joint_has_a_rigid_mode_with_or_without_friction(damping: float) -> None:
    found = fl.modes(swinging(0.0, **{"link.*.joint.viscous": damping}))
    assert found.kinds.count("rigid") == 1 + (damping > 0)
    assert found.kinds.count("elastic") == len(found.kinds) - 1 - (damping > 0)


def test_overdamped_modes_of_a_beam_are_elastic() -> None:
    damping = fl.Damping(ratio=5.0, at_hz=1.0)
    chain = swinging(9.81, **{"link.*.damping": damping, "link.*.joint.viscous": 2.0})
    held, free = fl.modes(chain, locked=[0]), fl.modes(chain)
    assert (held.damping_ratios == 1.0).all()
    assert set(held.kinds) == {"elastic"}
    assert free.kinds.count("elastic") == len(held.kinds)


def test_a_rigid_chain_has_no_elastic_frequency() -> None:
    link = fl.Link(name="a", length=0.5, material="aluminium", section="square")
    chain = fl.lump(make_scene(link, gravity=(9.81, 0.0, 0.0)))
    assert fl.modes(chain).kinds == ("pendulum",)
    assert np.isnan(fl.modes(chain).first_elastic_hertz)


def test_stable_steps_and_modes_default_to_the_posture_with_slack_springs() -> None:
    """The rest angles of the springs are not 0, so the straight arm has other frequencies."""
    straight = swinging(9.81)
    hinges = straight.hinges.copy()
    hinges["rest"][straight.stiffness > 0] = 0.2
    chain = dataclasses.replace(straight, hinges=hinges)
    assert fl.stable_step(chain) == fl.stable_step(chain, chain.rest)
    assert fl.stable_step(chain) != fl.stable_step(chain, np.zeros(chain.n))
    assert np.array_equal(fl.modes(chain).frequencies, fl.modes(chain, chain.rest).frequencies)
    for one in (chain, straight):  # RK4 on an undamped chain
        assert fl.stable_step(one) * fl.modes(one).frequencies.max() == pytest.approx(2.828427, rel=1e-6)
