"""Tapered links and structural damping: the beam that a link is cut from."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import ALUMINIUM, flexible

import flexlink as fl

CONE = {"thick": fl.Section(shape="circle", diameter=0.06), "thin": fl.Section(shape="circle", diameter=0.02)}


def tapered(**fields: object) -> fl.Scene:
    link = flexible("a", section="thick", section_tip="thin", **fields)
    arm = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections=CONE)
    return fl.Scene(name="cone", arm=arm, initial=fl.Initial(joint_deg=(0.0,)))


def test_a_tapered_link_has_the_mass_centre_and_inertia_of_a_cone() -> None:
    R, r, L = 0.03, 0.01, 1.25
    body = tapered(flex="rigid", segments=1).chain().bodies[0]
    volume = np.pi * L / 3 * (R * R + R * r + r * r)
    assert body["mass"] == pytest.approx(2700 * volume, rel=1e-14)
    assert body["center"][0] == pytest.approx(L / 4 * (R * R + 2 * R * r + 3 * r * r) / (R * R + R * r + r * r))
    axial = 2700 * np.pi * L / 10 * (R**5 - r**5) / (R - r)
    assert body["inertia"][0, 0] == pytest.approx(axial, rel=1e-14)


def test_a_link_of_unequal_sides_has_the_inertia_of_a_brick() -> None:
    height, width, length = 0.3, 0.2, 1.25  # along y, z and x
    arm = fl.Arm(
        links=(flexible("a", "rigid", 1, length=length),),
        materials={"aluminium": ALUMINIUM},
        sections={"square": fl.Section(shape="rectangle", height=height, width=width)},
    )
    body = fl.lump(arm, (0.0, 0.0, 0.0)).bodies[0]
    mass = 2700 * height * width * length
    squares = [height**2 + width**2, length**2 + width**2, length**2 + height**2]
    np.testing.assert_allclose(body["inertia"], mass / 12 * np.diag(squares), rtol=1e-14)
    assert body["mass"] == pytest.approx(mass, rel=1e-15)


def test_segments_of_a_tapered_link_add_up_to_the_whole() -> None:
    whole, parts = tapered(flex="rigid", segments=1).chain(), tapered(flex="xyz", segments=6).chain()
    assert parts.bodies["mass"].sum() == pytest.approx(whole.bodies["mass"][0], rel=1e-14)
    assert parts.bodies["inertia"][:, 0, 0].sum() == pytest.approx(whole.bodies["inertia"][0, 0, 0], rel=1e-14)


def test_stiffness_is_the_rigidity_at_the_node() -> None:
    chain = tapered(segments=6, lumping="midpoint").chain()
    x = (np.arange(5) + 0.5) / 5
    diameter = 0.06 - 0.04 * x
    np.testing.assert_allclose(chain.stiffness[1:], 70e9 * np.pi * diameter**4 / 64 / (1.25 / 5), rtol=1e-14)


def test_gauss_converges_on_a_tapered_link_faster_than_midpoint() -> None:
    def first(rule: str, hinges: int) -> float:
        chain = tapered(segments=hinges + 1, lumping=rule, joint=fl.Joint(locked=True)).chain()
        return float(fl.natural_frequencies(chain, np.zeros(chain.n))[0])

    exact = first("gauss", 80)
    errors = {rule: [abs(first(rule, n) / exact - 1) for n in (4, 8, 16)] for rule in ("midpoint", "gauss")}
    assert errors["gauss"][2] < 0.1 * errors["midpoint"][2]
    assert errors["gauss"][0] / errors["gauss"][2] > 4**4  # order 4 over a factor 4
    assert errors["midpoint"][0] / errors["midpoint"][2] == pytest.approx(4**2, rel=0.1)


def test_a_taper_between_two_shapes_is_refused() -> None:
    with pytest.raises(fl.SceneError, match=r"link\[0\].section_tip = 'flat': is a rectangle, not a circle"):
        fl.Arm(
            links=(flexible("a", section="thick", section_tip="flat"),),
            materials={"aluminium": ALUMINIUM},
            sections={**CONE, "flat": fl.Section(shape="rectangle", height=0.1, width=0.1)},
        )


def damping_ratios(damping: fl.Damping, flex: str = "z") -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and damping ratios of a clamped link."""
    link = flexible("a", flex, 8, damping=damping, joint=fl.Joint(locked=True), lumping="midpoint")
    arm = fl.Arm(links=(link,), materials={"aluminium": ALUMINIUM}, sections={"square": CONE["thin"]})
    chain = fl.Scene(name="s", arm=arm, gravity=(0, 0, 0), initial=fl.Initial(joint_deg=(0.0,))).chain()
    found = fl.modes(chain, np.zeros(chain.n))
    return found.hertz, found.damping_ratios


def test_a_target_ratio_is_met_at_its_frequency_and_grows_with_frequency() -> None:
    hertz, ratios = damping_ratios(fl.Damping(ratio=0.02, at_hz=10.0))
    np.testing.assert_allclose(ratios[:3], 0.02 * hertz[:3] / 10.0, rtol=1e-6)
    assert ratios.max() == 1  # Kelvin-Voigt's side effect: fast modes no longer vibrate


@pytest.mark.parametrize("flex", ["z", "yz", "xyz"])
def test_a_cap_bounds_the_ratio_of_the_fastest_mode(flex: str) -> None:
    _, ratios = damping_ratios(fl.Damping(ratio=0.02, at_hz=10.0, cap=0.5), flex)
    assert 0.25 < ratios.max() <= 0.5 * (1 + 1e-9)
