"""Cases with axial load and large bending: stored exact values are recomputed and compared with the library."""

import numpy as np
import pytest
from mpmath import mp
from scipy import special

import flexlink as fl
from flexlink.dynamics.vibration.modal import Modes, relieved
from flexlink.engines import load
from tests.conftest import ROOT
from validation.case import load_cases
from validation.kinds import frequencies
from validation.oracles import bent_rods, tensioned_beam
from validation.oracles.tensioned_beam import Beam
from validation.physics import axial_references, parity
from validation.physics.variant import Rule
from validation.reference_values import look_up, reference_array

CASES = {case.name: case for case in load_cases("physics_*")}


@pytest.mark.parametrize(
    ("key", "beam"), [("heavy, γ = 100", Beam(gravity=100)), ("lag, Ω = 6", Beam(spin=6, lag=True))]
)
def test_stored_frequencies_agree_with_the_power_series_solution(key, beam):
    with mp.workdps(30):
        assert mp.almosteq(mp.mpf(look_up("axial_load", key)[0]), tensioned_beam.frequencies(beam, 1)[0], rel_eps=1e-18)


def test_stored_tip_positions_agree_with_numerical_integration():
    assert float(bent_rods.follower(5.0)[0]) == pytest.approx(
        float(look_up("bent_rods", "follower", "5")[0]), rel=1e-15
    )
    tip = bent_rods.in_space(axial_references.FORCE, axial_references.RIGIDITY)
    assert tip == pytest.approx(reference_array("bent_rods", "space", "tip"), abs=1e-13)
    assert float(look_up("bent_rods", "space", "two_methods_apart")) < 1e-10  # tolerance of the coarser method


def test_derivatives_at_a_steady_rate_give_the_centrifugal_stiffness():
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


def string(rule: str, hinges: int, *, spins: bool) -> Modes:
    """Modes of a cable of 10 m with almost no EI, hanging, or turning at 3 rad/s and flapping."""
    rod = fl.Rigidity(x=(0.0, 10.0), rho_a=(1.0, 1.0), ei_z=(5e-4, 5e-4))
    cable = fl.Link(
        name="cable", length=10.0, rigidity="rod", flex="z", segments=hinges + 1, lumping=rule,
        joint=fl.Joint(axis=(0.0, 1.0, 0.0)), mount=fl.Mount(rpy_deg=(0.0, 0.0 if spins else 90.0, 0.0)),
    )  # fmt: skip
    arm = fl.Arm(links=(fl.Link(name="hub"), cable), rigidities={"rod": rod})
    gravity = (0.0, 0.0, 0.0 if spins else -9.81)
    chain = fl.lump(fl.Scene(name="string", arm=arm, gravity=gravity, run=fl.RunSettings(step=1e-3)))
    return fl.small_motion.modes_in_motion(chain, {"hub": 3.0}) if spins else fl.modes(chain, locked=["hub"])


@pytest.mark.parametrize("hinges", [8, 16, 40])
@pytest.mark.parametrize("spins", [False, True])
def test_cells_of_a_string_have_no_artificial_mode_among_the_first_and_less_error_than_gauss(spins, hinges) -> None:
    """Exact: ω = ½ j₀ₖ √(g/L) if hanging, Ω √(k (2k − 1)) if spinning (Bir 2009)."""
    k = np.arange(1, 4)
    exact = 3.0 * np.sqrt(k * (2 * k - 1)) if spins else special.jn_zeros(0, 3) / 2 * np.sqrt(0.981)
    error = lambda found: np.abs(found.frequencies[:3] / exact - 1).max()  # noqa: E731
    gauss = error(string("gauss", hinges, spins=spins))
    for rule in ("lobatto2", "lobatto4"):
        found = string(rule, hinges, spins=spins)
        assert error(found) < gauss / 2
        assert found.kinds == ("pendulum",) * hinges + ("artificial",)


def test_without_tension_cells_keep_their_inertia() -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"gravity": (0.0, 0.0, 0.0)})
    chain = fl.lump(scene.varied({"link.upper.lumping": "lobatto2", "link.fore.lumping": "lobatto4"}))
    for push in (0.0, -1e3):
        still, wrench = np.zeros(chain.n), np.array([push, 0.0, 0.0, 0.0, 0.0, 0.0])
        same, lent = relieved(chain, still, still, wrench, "tip")
        assert same.bodies.tobytes() == chain.bodies.tobytes()
        assert [chain.joint_name(k) for k in np.flatnonzero(lent)] == ["upper.4.z", "fore.4.z"]
