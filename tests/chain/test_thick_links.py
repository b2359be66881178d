"""Links that shear and stretch: slides with springs at the stations of their hinges."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate import solve_bvp

import flexlink as fl
from flexlink.chain.coordinates import Kind
from flexlink.describe.material import SHEAR_FACTORS
from flexlink.dynamics import rounding
from flexlink.errors import SceneError
from tests.conftest import flexible, make_scene
from tests.support.words import refused
from validation.oracles import thick_beam
from validation.oracles.spatial_chain import SpatialChain, exactly
from validation.random_arms import random_arm, random_tree

ROOT = Path(__file__).parents[2]
E, G, DENSITY = 210e9, 210e9 / 2.6, 7850.0
"""Moduli [Pa] and density [kg/m³] of the steel in `thick_link`."""


def link(height: float, hinges: int, **keys: Any) -> fl.Scene:
    """A clamped square steel link of 1 m with this height [m], which shears."""
    scene = fl.load_scene(ROOT / "validation" / "scenes" / "thick_link.toml")
    changes = {f"link.beam.{key}": value for key, value in {"shear": True, "segments": hinges + 1, **keys}.items()}
    return scene.varied({"section.bar.height": height, "section.bar.width": height, **changes})


def timoshenko(h: float, count: int) -> np.ndarray:
    """Frequencies [rad/s] of the same beam by transfer matrices."""
    beam = thick_beam.Beam(E * h**4 / 12, DENSITY * h**2, DENSITY * h**4 / 12, 5 / 6 * G * h**2, 1.0)
    return thick_beam.frequencies(beam, count)


def errors(height: float, hinges: int) -> np.ndarray:
    """Relative errors of the first three frequencies."""
    return np.abs(fl.modes(fl.lump(link(height, hinges))).frequencies[:3] / timoshenko(height, 3) - 1)


def test_a_link_three_times_as_long_as_high_vibrates_like_timoshenkos_beam() -> None:
    few, many = errors(1 / 3, 20), errors(1 / 3, 40)
    assert few.max() <= 2e-5
    assert (np.log2(few / many) >= 3.8).all()


@pytest.mark.parametrize("slenderness", [5, 10, 20, 50])
@pytest.mark.parametrize("hinges", [4, 10])
def test_shear_never_costs_accuracy(slenderness: float, hinges: int) -> None:
    """With few hinges in a slender link, where matched inertias are left out, the error is that of bending."""
    thin = fl.modes(fl.lump(link(1 / slenderness, hinges, shear=False))).frequencies[0]
    bent = errors(1e-3, hinges)[0]
    assert errors(1 / slenderness, hinges)[0] <= abs(thin / timoshenko(1 / slenderness, 1)[0] - 1) + 2 * bent


def test_matched_inertias_are_left_out_only_where_M_would_be_indefinite() -> None:
    """With them, ten hinges of a link ten times as long as high have a third of the error."""
    assert errors(1 / 10, 10)[0] <= 3e-6


@pytest.mark.parametrize("slenderness", [3, 10, 20, 50, 100])
@pytest.mark.parametrize("hinges", [2, 6, 10, 20])
def test_M_is_positive_definite_in_bent_postures(slenderness: float, hinges: int) -> None:
    chain, rng = fl.lump(link(1 / slenderness, hinges, stretch=True)), np.random.default_rng(hinges)
    size = np.where([c.kind is Kind.STRAIN for c in chain.coordinates], 1e-3, 0.2)
    for _ in range(5):
        np.linalg.cholesky(fl.mass_matrix(chain, size * rng.normal(size=chain.n)))


def test_a_bar_vibrates_lengthwise_with_order_4() -> None:
    exact = (np.arange(1, 4) - 0.5) * math.pi * math.sqrt(E / DENSITY)
    found = []
    for hinges in (16, 32):
        chain = fl.lump(link(0.05, hinges, shear=False, stretch=True))
        bent = [k for k, c in enumerate(chain.coordinates) if c.kind is not Kind.STRAIN]
        found.append(np.abs(fl.modes(chain, locked=bent).frequencies[:3] / exact - 1))
    assert found[1].max() <= 2e-5
    assert (np.log2(found[0] / found[1]) >= 3.8).all()


def reissner(h: float, force: tuple[float, float]) -> np.ndarray:
    """Tip of the clamped beam that bends, shears and stretches under a dead force at its tip, by collocation [m]."""
    EA, GA, EI = E * h**2, 5 / 6 * G * h**2, E * h**4 / 12

    def slopes(_: np.ndarray, y: np.ndarray) -> np.ndarray:
        c, s = np.cos(y[2]), np.sin(y[2])
        ε, γ = (force[0] * c + force[1] * s) / EA, (force[1] * c - force[0] * s) / GA
        along, up = (1 + ε) * c - γ * s, (1 + ε) * s + γ * c
        return np.array([along, up, y[3] / EI, up * force[0] - along * force[1]])

    x = np.linspace(0.0, 1.0, 200)
    ends = [np.array([0.0, 0.0, 0.0, 0.0])]
    found = solve_bvp(
        slopes, lambda a, b: np.array([*a[:3], b[3]]) - ends[0], x, [x, 0 * x, 0 * x, 0 * x], tol=1e-9, max_nodes=20_000
    )
    assert found.success
    return np.asarray(found.y[:2, -1])


@pytest.mark.slow
def test_a_thick_beam_bends_by_half_a_radian_like_reissners() -> None:
    h = 0.2
    force = np.array([0.6, 1.2]) * E * h**4 / 12
    exact, found = reissner(h, (force[0], force[1])), []
    for hinges in (10, 20):
        chain = fl.lump(link(h, hinges, stretch=True))
        rest = fl.solve_static(chain, tip_wrench=[*force, 0, 0, 0, 0])
        found.append(np.linalg.norm(fl.tip_position(chain, rest.q)[:2] - exact))
    assert found[1] <= 1e-4
    assert np.log2(found[0] / found[1]) >= 1.9


def spinning(hinges: int) -> float:
    """Extension [m] of the beam of Kane's spin-up, 10 m long, at 6 rad/s."""
    scene = fl.load_scene(ROOT / "validation" / "scenes" / "spin_up.toml")
    stretched = {"link.arm.lumping": "gauss", "link.arm.segments": hinges + 1, "link.arm.stretch": True}
    chain = fl.lump(scene.varied(stretched))
    rest = fl.small_motion.equilibrium_in_motion(chain, {"arm": 6.0})
    return float(fl.tip_position(chain, rest.q)[0] - 10.0)


def test_the_spin_up_stretches_its_beam_by_half_a_millimetre() -> None:
    """A bar of E and ρ that turns at ω has u'' + k² (x + u) = 0, k = ω √(ρ/E)."""
    k = 6.0 * math.sqrt(1.2 / 2.8e7)
    exact = math.sin(10 * k) / (k * math.cos(10 * k)) - 10
    assert exact == pytest.approx(5.14e-4, rel=1e-3)
    assert spinning(10) == pytest.approx(exact, rel=1e-3)


def test_a_hanging_link_has_the_strain_of_its_weight() -> None:
    scene = link(0.05, 8, shear=False, stretch=True).varied({"gravity": (9.81, 0.0, 0.0)})
    chain = fl.lump(scene)
    gauge = fl.strength.beam_strain(scene, fl.solve_static(chain).q, link="beam", fibre=(0.0, 0.0))
    assert gauge.strain == pytest.approx(DENSITY * 9.81 * (1 - gauge.x) / E, rel=1e-6)


def test_slides_are_named_by_station_and_strain() -> None:
    chain = fl.lump(make_scene(flexible("a", "xyz", 3, lumping="gauss", shear=True, stretch=True)))
    slides = ["a.1.stretch", "a.1.shear.y", "a.1.shear.z", "a.2.stretch", "a.2.shear.y", "a.2.shear.z"]
    assert [name for name, slides in zip(chain.joint_names, chain.slides, strict=True) if slides] == slides
    assert [chain.joint_names[k] for k in chain.bending] == [
        f"a.{k}.{axis}" for k, axes in ((1, "xyz"), (2, "zyx")) for axis in axes
    ]


@pytest.mark.parametrize("shape", ["box", "tube"])
def test_shear_factors_are_those_of_the_shear_flow(shape: str) -> None:
    """κ = V² / (A ∫ q²/t ds), thin walls, with the shear flow q(s) = V S(s) / I."""
    x, weights = np.polynomial.legendre.leggauss(24)
    if shape == "tube":
        angle = np.pi / 2 * (x + 1)  # q = V r² t sin φ / (π r³ t), A = 2 π r t
        flow = 2 * np.pi / 2 * weights @ (np.sin(angle) / np.pi) ** 2
        assert SHEAR_FACTORS["tube"](1.0, 1.0 - 1e-9)[0] == pytest.approx(1 / (2 * np.pi * flow), rel=1e-6)
        return
    h, w, t = 0.07, 0.03, 1e-7  # walls along the force are h long
    I = t * h**3 / 6 + w * t * h**2 / 2
    across = (x + 1) / 4 * w  # from the middle of a wall across the force
    along = (x + 1) / 4 * h  # from the middle of a wall along it
    flow = weights @ (t * h / 2 * across / I) ** 2 * w
    flow += weights @ (t * (h * w / 4 + (h**2 / 4 - along**2) / 2) / I) ** 2 * h
    factors = SHEAR_FACTORS["box"](h + t, w + t, t)
    assert factors[0] == pytest.approx(1 / (2 * (h + w) * flow), rel=1e-5)
    assert factors[1] == pytest.approx(SHEAR_FACTORS["box"](w + t, h + t, t)[0])


def random_thick(seed: int) -> tuple[fl.Chain, np.ndarray, np.ndarray]:
    """Chain of a random arm or tree whose beams shear and stretch, where they can, with a state."""
    scene, changes = random_arm(seed) if seed % 3 else random_tree(seed), dict[str, Any]()
    for each in scene.arm.links:
        if each.flex != "rigid" and each.material is not None:
            changes |= {f"link.{each.name}.shear": seed % 2 == 0 or 0.7, f"link.{each.name}.stretch": seed % 5 > 0}
    chain, rng = fl.lump(scene.varied(changes)), np.random.default_rng(seed)
    size = np.where([c.kind is Kind.STRAIN for c in chain.coordinates], 1e-3, np.where(chain.stiffness > 0, 0.1, 1.0))
    return chain, chain.rest + size * rng.normal(size=chain.n), size * rng.normal(size=chain.n)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4, 6])
def test_M_and_bias_are_those_of_100_digits(seed: int) -> None:
    chain, q, qd = random_thick(seed)
    with mp.workdps(100):
        M, bias = (
            np.array(part.tolist() if hasattr(part, "tolist") else part, float)
            for part in SpatialChain(chain).equations(exactly(q), exactly(qd))
        )
    assert np.abs(fl.mass_matrix(chain, q) - M).max() <= rounding.of_mass_matrix(chain, q)
    assert np.abs(fl.bias_torque(chain, q, qd) - bias.ravel()).max() <= rounding.of_bias_torque(chain, q, qd)


def test_arms_of_other_materials_share_the_geometry_of_slides() -> None:
    """Chains that are lumped together equal those lumped alone, to the bit."""
    scene = make_scene(flexible("a", "yz", 5, lumping="gauss", shear=True, stretch=True))
    many = [scene.varied({"material.aluminium.young": young}) for young in (7e10, 8e10)]
    runs = fl.simulate_many([each.varied({"run.duration": 1e-3, "run.step": 1e-5}) for each in many])
    for each, run in zip(many, runs, strict=True):
        np.testing.assert_array_equal(run.chain.hinges, fl.lump(each).hinges)


REFUSED = {
    "rigid-strains": {"flex": "rigid", "segments": 1, "lumping": "gauss"},
    "cells-without-strains": {"lumping": "lobatto2"},
    "modes-without-strains": {"modes": 2, "lumping": "gauss"},
}


@pytest.mark.parametrize("id", REFUSED)
def test_what_cannot_shear_is_refused(id: str) -> None:
    with refused(SceneError, id):
        fl.lump(make_scene(flexible("a", **{"lumping": "gauss", "shear": True, **REFUSED[id]})))


def test_a_general_section_needs_a_shear_factor() -> None:
    section = fl.Section(shape="general", area=1e-4, i_y=1e-9, i_z=1e-9, torsion=2e-9)
    scene = make_scene(flexible("a", lumping="gauss")).varied({"section.square": section})
    with refused(SceneError, "shear-factor-unknown"):
        fl.lump(scene.varied({"link.a.shear": True}))
    assert fl.lump(scene.varied({"link.a.shear": 0.85})).slides.sum() == 4


def test_a_table_of_rigidities_neither_shears_nor_stretches() -> None:
    table = fl.Rigidity(x=(0.0, 1.25), ei_z=(1.0, 1.0), rho_a=(1.0, 1.0))
    stiff = make_scene(flexible("a")).varied({"rigidity.t": table})
    with refused(SceneError, "strains-need-a-section"):
        stiff.varied({"link.a": flexible("a", material=None, section=None, rigidity="t", stretch=True)})
