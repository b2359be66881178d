"""Cases of axial load and large bending: their exact values by other ways, and what the kinds make of them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from mpmath import mp
from scipy.optimize import brentq

import flexlink as fl
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import decode
from flexlink.engines import load
from validation.case import load_cases
from validation.kinds import buckling, frequencies
from validation.oracles import bending_chain, bent_rods, coupled_cells, tensioned_beam
from validation.oracles.tensioned_beam import Beam
from validation.physics import axial_references, parity
from validation.physics.tip_loads import TIP_LOADS
from validation.physics.variant import Rule
from validation.reference_values import look_up, reference_array

CASES = {case.name: case for case in load_cases("physics_*")}


# --- exact values ----------------------------------------------------------------------------------------------------


def test_without_load_the_series_give_the_clamped_beam():
    exact = brentq(lambda b: np.cos(b) * np.cosh(b) + 1, 1.5, 2.5, xtol=1e-15) ** 2
    assert float(tensioned_beam.frequencies(Beam(), 1)[0]) == pytest.approx(exact, rel=1e-14)


def test_a_beam_on_a_hub_without_stiffness_to_speak_of_lags_and_flaps_as_a_rod_would():
    """λ of w = x is Ω² whatever the stiffness: on a hinge the beam turns as a whole."""
    assert float(tensioned_beam.frequencies(Beam(spin=7, hinged=True), 1)[0]) == pytest.approx(7.0, rel=1e-14)
    flap, lag = (float(tensioned_beam.frequencies(Beam(spin=2, lag=lag), 1)[0]) for lag in (False, True))
    assert flap**2 - lag**2 == pytest.approx(4.0, rel=1e-13)


@pytest.mark.parametrize(
    ("key", "beam"), [("heavy, γ = 100", Beam(gravity=100)), ("lag, Ω = 6", Beam(spin=6, lag=True))]
)
def test_the_stored_frequencies_are_those_of_the_series(key, beam):
    with mp.workdps(30):
        assert mp.almosteq(mp.mpf(look_up("axial_load", key)[0]), tensioned_beam.frequencies(beam, 1)[0], rel_eps=1e-18)


def test_a_heavy_beam_tends_to_a_rope():
    rope, heavy = look_up("axial_load", "rope, γ = 1")[0], look_up("axial_load", "heavy, γ = 1000")[0]
    stiffer = float(heavy) / (float(rope) * np.sqrt(1000))
    assert 1.0 < stiffer < 1 + 1 / np.sqrt(1000)  # the clamp shortens it by its boundary layer, √(EI/T), over 2 L


def test_the_stored_tips_are_those_of_the_integrations():
    assert float(bent_rods.follower(5.0)[0]) == pytest.approx(
        float(look_up("bent_rods", "follower", "5")[0]), rel=1e-15
    )
    tip = bent_rods.in_space(axial_references.FORCE, axial_references.RIGIDITY)
    assert tip == pytest.approx(reference_array("bent_rods", "space", "tip"), abs=1e-13)
    assert float(look_up("bent_rods", "space", "two_methods_apart")) < 1e-10  # the tolerance of the coarser one


def test_a_rod_in_space_whose_force_lies_in_a_plane_is_the_elastica():
    (ten,) = (each for each in TIP_LOADS["elastica"]() if each.size == 10.0)
    tip = bent_rods.in_space(np.array([0.0, 10.0, 0.0]), np.array([0.7, 3.0, 1.0]))
    assert tip - [1, 0, 0] == pytest.approx(ten.displacement, abs=1e-12)


def test_a_follower_force_is_small_bending_when_it_is_small():
    x, y, angle = map(float, bent_rods.follower(1e-4))
    assert (y, angle, 1 - x) == pytest.approx((1e-4 / 3, 1e-4 / 2, 1e-8 / 15), rel=1e-6)


# --- cells in 40 digits ----------------------------------------------------------------------------------------------


def test_the_oracle_of_cells_tends_to_the_beam():
    exact = tensioned_beam.frequencies(Beam(), 1)[0]
    errors = [abs(coupled_cells.frequencies(2, n, 4.0)[0] / float(exact) - 1) for n in (8, 16)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_a_wrong_coupling_breaks_the_limit_of_finite_chains():
    case = CASES["physics_finite_chains"]
    limit = case.quantity["all bending modes, 40 digits"].tolerance
    scene = frequencies.Variant().build(case, Rule(rule="lobatto2", hinges=6))
    chain, exact = fl.lump(scene), coupled_cells.frequencies(2, 6, lumping_rule("lobatto2").cells.tip)
    assert np.abs(fl.natural_frequencies(chain) / exact - 1).max() < limit
    couplings = chain.couplings.copy()
    couplings["stiffness"][1] *= 1 + 1e-7
    wrong = dataclasses.replace(chain, couplings=couplings)
    assert np.abs(fl.natural_frequencies(wrong) / exact - 1).max() > limit
    independent = bending_chain.frequencies(*lumping_rule("lobatto2").hinges(6))
    assert np.abs(fl.natural_frequencies(chain)[0] / independent[0] - 1) > 1e-3


# --- kinds -----------------------------------------------------------------------------------------------------------


def test_a_guided_column_on_a_pin_buckles_at_four_times_the_clamped_one():
    case = CASES["physics_columns"]
    loads = {load.name: load for load in decode(case.settings, buckling.Settings).load}
    pinned, clamped = loads["pinned column"], loads["Euler's column"]
    chains = [fl.lump(load.variant.build(case, Rule(rule="lobatto4", hinges=16))) for load in (pinned, clamped)]
    ratio = buckling._critical(chains[0], pinned) / buckling._critical(chains[1], clamped)
    assert ratio == pytest.approx(4.0, rel=1e-8)


def test_slopes_at_steady_rates_are_the_centrifugal_stiffness():
    case = CASES["physics_spinning"]
    scene = frequencies.Variant(change={"initial.rate_deg": [120.0, 0.0]}).build(case, Rule(rule="gauss", hinges=4))
    chain = fl.lump(scene)
    qd = np.where(np.arange(chain.n) == 0, np.radians(120.0), 0.0)
    engine = load("mujoco", chain)
    K = parity.springs(engine) + parity.load_stiffness(engine, np.zeros(chain.n), qd=qd)
    theirs = parity.symmetric_squares(engine, np.zeros(chain.n), K, np.arange(1, chain.n))
    assert np.sqrt(theirs) == pytest.approx(fl.natural_frequencies(chain, qd=qd, locked=[0]), rel=1e-9)
    still = parity.symmetric_squares(engine, np.zeros(chain.n), parity.springs(engine), np.arange(1, chain.n))
    assert theirs[0] > still[0] + 0.1
