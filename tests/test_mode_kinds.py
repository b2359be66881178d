"""Elastic, pendulum and rigid modes; the posture that small motion is about by default."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import flexible, make_scene

import flexlink as fl


def swinging(gravity: float, **changes: object) -> fl.Chain:
    """One flexible link on a free joint; with gravity along x it hangs."""
    return fl.lump(make_scene(flexible("a", "z", 6), gravity=(gravity, 0.0, 0.0)).varied(changes))


def test_gravity_holds_a_pendulum_and_springs_the_modes_above_it() -> None:
    found = fl.modes(swinging(9.81))
    assert found.kinds == ("pendulum", *["elastic"] * (len(found.kinds) - 1))
    assert found.elastic_shares[0] < 0.01
    assert (found.elastic_shares[1:] > 0.99).all()
    assert found.first_elastic_hertz == found.hertz[1]


def test_an_upright_arm_falls_as_a_pendulum() -> None:
    found = fl.modes(swinging(-9.81))
    assert np.isnan(found.hertz[0])
    assert found.kinds[:2] == ("pendulum", "elastic")


@pytest.mark.parametrize("damping", [0.0, 2.0])
def test_without_gravity_a_free_joint_is_rigid_with_friction_or_without(damping: float) -> None:
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


def test_a_chain_that_nothing_bends_has_no_elastic_frequency() -> None:
    link = fl.Link(name="a", length=0.5, material="aluminium", section="square")
    chain = fl.lump(make_scene(link, gravity=(9.81, 0.0, 0.0)))
    assert fl.modes(chain).kinds == ("pendulum",)
    assert np.isnan(fl.modes(chain).first_elastic_hertz)


def test_stable_steps_and_modes_are_about_slack_springs_by_default() -> None:
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
