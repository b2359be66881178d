"""Tapered links and structural damping of beams that are lumped into segments."""

from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy import linalg

import flexlink as fl
from tests.conftest import ALUMINIUM, chain_of, flexible
from tests.support.words import refused
from validation.physics.hinge_sweep import order

CONE = {"thick": fl.Section(shape="circle", diameter=0.06), "thin": fl.Section(shape="circle", diameter=0.02)}


def tapered(**fields: object) -> fl.Scene:
    link = flexible("a", section="thick", section_tip="thin", **fields)
    arm = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections=CONE)
    return fl.Scene(name="cone", arm=arm, initial=fl.InitialState(joint_deg=(0.0,)))


def test_a_tapered_link_has_the_mass_centre_and_inertia_of_a_cone() -> None:
    R, r, L = 0.03, 0.01, 1.25
    body = fl.lump(tapered(flex="rigid", segments=1)).bodies[0]
    volume = np.pi * L / 3 * (R * R + R * r + r * r)
    assert body["mass"] == pytest.approx(2700 * volume, rel=1e-14, abs=0)
    assert body["center"][0] == pytest.approx(L / 4 * (R * R + 2 * R * r + 3 * r * r) / (R * R + R * r + r * r))
    axial = 2700 * np.pi * L / 10 * (R**5 - r**5) / (R - r)
    assert body["inertia"][0, 0] == pytest.approx(axial, rel=1e-14, abs=0)


def test_a_link_of_rectangular_section_has_the_inertia_of_a_cuboid() -> None:
    height, width, length = 0.3, 0.2, 1.25  # along y, z and x
    arm = fl.Arm(
        links=(flexible("a", "rigid", 1, length=length),),
        materials={"aluminium": ALUMINIUM},
        sections={"square": fl.Section(shape="rectangle", height=height, width=width)},
    )
    body = chain_of(arm, (0.0, 0.0, 0.0)).bodies[0]
    mass = 2700 * height * width * length
    squares = [height**2 + width**2, length**2 + width**2, length**2 + height**2]
    np.testing.assert_allclose(body["inertia"], mass / 12 * np.diag(squares), rtol=1e-14)
    assert body["mass"] == pytest.approx(mass, rel=1e-15, abs=0)


def test_mass_and_axial_inertia_of_tapered_segments_add_up_to_the_whole_link() -> None:
    whole, parts = fl.lump(tapered(flex="rigid", segments=1)), fl.lump(tapered(flex="xyz", segments=6))
    assert parts.bodies["mass"].sum() == pytest.approx(whole.bodies["mass"][0], rel=1e-14, abs=0)
    assert parts.bodies["inertia"][:, 0, 0].sum() == pytest.approx(whole.bodies["inertia"][0, 0, 0], rel=1e-14, abs=0)


def test_hinge_stiffness_uses_the_bending_rigidity_at_the_node() -> None:
    chain = fl.lump(tapered(segments=6, lumping="midpoint"))
    x = (np.arange(5) + 0.5) / 5
    diameter = 0.06 - 0.04 * x
    np.testing.assert_allclose(chain.stiffness[1:], 70e9 * np.pi * diameter**4 / 64 / (1.25 / 5), rtol=1e-14)


def test_gauss_lumping_converges_faster_than_midpoint_on_a_tapered_link() -> None:
    def first(rule: str, hinges: int) -> float:
        chain = fl.lump(tapered(segments=hinges + 1, lumping=rule, joint=fl.Joint(locked=True)))
        return float(fl.natural_frequencies(chain, np.zeros(chain.n))[0])

    exact = first("gauss", 80)
    errors = {rule: [abs(first(rule, n) / exact - 1) for n in (4, 8, 16)] for rule in ("midpoint", "gauss")}
    assert errors["gauss"][2] < 0.1 * errors["midpoint"][2]
    assert errors["gauss"][0] / errors["gauss"][2] > 4**4  # order 4: four times as many hinges divide the error by 4⁴
    assert errors["midpoint"][0] / errors["midpoint"][2] == pytest.approx(4**2, rel=0.1)


def test_a_taper_between_two_shapes_is_refused() -> None:
    with refused(fl.errors.SceneError, "section-shapes-differ"):
        fl.Arm(
            links=(flexible("a", section="thick", section_tip="flat"),),
            materials={"aluminium": ALUMINIUM},
            sections={**CONE, "flat": fl.Section(shape="rectangle", height=0.1, width=0.1)},
        )


# --- twist of a tapered link ------------------------------------------------------------------------------------------


def cone_bar(ratio: float, hinges: int, rule: str = "gauss_matched", length: float = 1.5) -> fl.Chain:
    """A clamped round bar, 40 mm thick at the root and `ratio` times that at the tip, that bends and twists."""
    link = fl.Link(
        name="bar", length=length, flex="xyz", material="aluminium", section="root", section_tip="tip",
        segments=hinges + 1, lumping=rule, joint=fl.Joint(locked=True),
    )  # fmt: skip
    sections = {name: fl.Section(shape="circle", diameter=d) for name, d in (("root", 0.04), ("tip", 0.04 * ratio))}
    return chain_of(fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections=sections), (0.0, 0.0, 0.0))


def twist_of_a_cone(ratio: float, length: float = 1.5, terms: int = 24) -> float:
    """First twist frequency of the continuous bar by Ritz' method: G ∫ d⁴ θ'² = ω² ρ ∫ d⁴ θ², θ = x P_k(2x − 1)."""
    t, weights = legendre.leggauss(2 * terms)
    x, weights = (1 + t) / 2, weights / 2 * (1 + (ratio - 1) * (1 + t) / 2) ** 4
    series = np.eye(terms)
    P = np.array([legendre.legval(t, c) for c in series])
    θ, slope = x * P, P + 2 * x * np.array([legendre.legval(t, legendre.legder(c)) for c in series])
    square = linalg.eigh((slope * weights) @ slope.T, (θ * weights) @ θ.T, eigvals_only=True)[0]
    return float(np.sqrt(square * ALUMINIUM.shear / ALUMINIUM.density) / length)


def first_twist(chain: fl.Chain) -> float:
    return float(fl.natural_frequencies(chain, locked=[k for k, c in enumerate(chain.coordinates) if c.axis != 1])[0])


def test_the_twist_reference_without_taper_equals_the_frequency_of_a_prism() -> None:
    assert twist_of_a_cone(1.0) == pytest.approx(np.pi / 2 / 1.5 * np.sqrt(ALUMINIUM.shear / 2700.0), rel=1e-12)


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.9, 1.0, 2.0])
def test_matched_rotors_make_twist_of_a_tapered_link_converge_with_order_four(ratio: float) -> None:
    exact = twist_of_a_cone(ratio)
    errors = {n: first_twist(cone_bar(ratio, n)) / exact - 1 for n in (8, 16, 32)}
    assert order(errors) == pytest.approx(4, abs=0.2)
    assert abs(errors[16]) < 2e-5  # measured 9e-8 to 1.2e-5; with the rotors of a prism it would be 3.5e-5 to 1.3e-3


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.6, 0.9, 1.0, 2.0])
@pytest.mark.parametrize("hinges", [2, 12])
def test_matched_rotors_leave_the_mass_matrix_of_a_tapered_link_positive_definite(ratio: float, hinges: int) -> None:
    """M is checked for the straight link and for hinges bent by 40° in one direction or at random."""
    chain, rng = cone_bar(ratio, hinges), np.random.default_rng(1)
    bent = np.radians(40) * np.array([np.zeros(chain.n), np.ones(chain.n), *np.sign(rng.uniform(-1, 1, (20, chain.n)))])
    assert min(np.linalg.eigvalsh(fl.mass_matrix(chain, q)).min() for q in bent) > 0


def test_a_negative_rotor_reduces_the_outboard_inertia_passed_to_the_hinge(tmp_path: Path) -> None:
    """Inertia A = 0.45 outboard of hinge 2 and its rotor r = −0.2025 act on hinge 1 as A r / (A + r) = −0.368.

    The inertia between the hinges, 0.35, is less than that, so the sum outboard of hinge 1 is negative.
    """
    rule = tmp_path / "halves.toml"
    rule.write_text(
        'about = ""\nsource = ""\nmatched_twist = true\n[element]\nnodes = [0.2, 0.55]\nweights = [0.5, 0.5]\n'
    )
    with refused(fl.errors.SceneError, "twist-inertia-outweighs"):
        cone_bar(1.0, 2, str(rule))


def test_matched_rotors_that_exceed_the_outboard_inertia_are_refused(tmp_path: Path) -> None:
    rule = tmp_path / "heavy.toml"  # last hinge, weight 0.1: rotor 1/0.1 times the neglected outboard inertia
    rule.write_text(
        'about = ""\nsource = ""\nmatched_twist = true\n[element]\nnodes = [0.2, 0.5]\nweights = [0.9, 0.1]\n'
    )
    with refused(fl.errors.SceneError, "twist-inertia-outweighs"):
        cone_bar(1.0, 2, str(rule))
    link = flexible("a", "yz", 3, lumping=str(rule))  # accepted: this link has no twist hinges
    assert fl.lump(fl.Scene(
        name="s", arm=fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"square": CONE["thin"]}),
        initial=fl.InitialState(joint_deg=(0.0,)),
    )).n == 5  # fmt: skip


# --- structural damping -----------------------------------------------------------------------------------------------


def damping_ratios(damping: fl.Damping, flex: str = "z") -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and damping ratios of a clamped link."""
    link = flexible("a", flex, 8, damping=damping, joint=fl.Joint(locked=True), lumping="midpoint")
    arm = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"square": CONE["thin"]})
    chain = fl.lump(fl.Scene(name="s", arm=arm, gravity=(0, 0, 0), initial=fl.InitialState(joint_deg=(0.0,))))
    found = fl.modes(chain, np.zeros(chain.n))
    return found.hertz, found.damping_ratios


def test_a_target_ratio_is_met_at_its_frequency_and_grows_with_frequency() -> None:
    hertz, ratios = damping_ratios(fl.Damping(ratio=0.02, at_hz=10.0))
    np.testing.assert_allclose(ratios[:3], 0.02 * hertz[:3] / 10.0, rtol=1e-6)
    assert ratios.max() == 1  # Kelvin-Voigt's side effect: fast modes no longer vibrate


def crane(hinges: int, first: fl.Damping, second: fl.Damping) -> fl.Chain:
    """Two links at a right angle with locked joints and a load; each link has a different damping."""
    links = [
        flexible(name, "yz", hinges + 1, lumping="gauss", damping=damping, joint=fl.Joint(locked=True))
        for name, damping in (("a", first), ("b", second))
    ]
    arm = fl.Arm(
        links=tuple(links), materials={"aluminium": ALUMINIUM}, sections={"square": CONE["thin"]},
        tip=fl.RigidBody(mass=1.0),
    )  # fmt: skip
    return chain_of(arm, joint_deg=(0.0, 90.0))


@pytest.mark.slow
def test_every_mode_gets_the_requested_damping_ratio_for_any_discretization() -> None:
    damping = fl.Damping(ratio=0.01, at_hz=5.0)
    for hinges in (2, 4, 8, 16):
        found = fl.modes(crane(hinges, damping, damping))
        np.testing.assert_allclose(found.damping_ratios[:4], 0.01 * found.hertz[:4] / 5.0, rtol=1e-9)


@pytest.mark.slow
def test_damping_of_the_first_mode_converges_under_refinement() -> None:
    """Each link adds damping in proportion to its share of energy, which converges with order 4 like the mode shape."""
    ratios = {
        n: fl.modes(crane(n, fl.Damping(ratio=0.02, at_hz=5.0), fl.Damping(ratio=0.005, at_hz=5.0)))
        for n in (4, 8, 16, 32)
    }
    relative = {n: found.damping_ratios[0] / (found.hertz[0] / 5.0) for n, found in ratios.items()}
    assert 0.005 < relative[32] < 0.02
    assert order({n: relative[n] / relative[32] - 1 for n in (4, 8)}) == pytest.approx(4, abs=0.5)
    assert relative[16] == pytest.approx(relative[32], rel=1e-4)


def test_damping_has_no_cap_option() -> None:
    with refused(fl.errors.SceneError, "unknown-key"):
        fl.Damping(ratio=0.01, at_hz=4.0, cap=1.0)  # type: ignore[call-arg]
