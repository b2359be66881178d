"""Cases of axial load and large bending: their exact values by other ways, and what the kinds make of them."""

from __future__ import annotations

import pytest
from mpmath import mp

from validation.oracles import bent_rods, tensioned_beam
from validation.oracles.tensioned_beam import Beam
from validation.physics import axial_references
from validation.reference_values import look_up, reference_array

# --- exact values ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "beam"), [("heavy, γ = 100", Beam(gravity=100)), ("lag, Ω = 6", Beam(spin=6, lag=True))]
)
def test_the_stored_frequencies_are_those_of_the_series(key, beam):
    with mp.workdps(30):
        assert mp.almosteq(mp.mpf(look_up("axial_load", key)[0]), tensioned_beam.frequencies(beam, 1)[0], rel_eps=1e-18)


def test_the_stored_tips_are_those_of_the_integrations():
    assert float(bent_rods.follower(5.0)[0]) == pytest.approx(
        float(look_up("bent_rods", "follower", "5")[0]), rel=1e-15
    )
    tip = bent_rods.in_space(axial_references.FORCE, axial_references.RIGIDITY)
    assert tip == pytest.approx(reference_array("bent_rods", "space", "tip"), abs=1e-13)
    assert float(look_up("bent_rods", "space", "two_methods_apart")) < 1e-10  # the tolerance of the coarser one
