"""Springs at the root of a link: closed forms of elastically clamped beams, other engines, and refused input."""

import itertools

import numpy as np
import pytest
from scipy.optimize import brentq

import flexlink as fl
from tests.conftest import make_scene
from tests.support.words import refused

E, RHO, LENGTH, WIDTH, HEIGHT = 210e9, 7850.0, 2.0, 0.03, 0.002
EI, RHO_A = E * WIDTH * HEIGHT**3 / 12, RHO * WIDTH * HEIGHT
HELD = fl.Joint(locked=True)


def clamped(rule: str = "gauss", hinges: int = 16, **fields: object) -> fl.Scene:
    """A steel strip of 2 m that bends about z, with a root spring of k L / EI = 3 unless the fields override it."""
    usual = {"root_stiffness": fl.details.RootStiffness(z=3 * EI / LENGTH), "joint": HELD}
    strip = fl.Link(
        name="strip", length=LENGTH, flex="z", segments=hinges + 1, lumping=rule, material="steel", section="strip",
        **{**usual, **fields},
    )  # fmt: skip
    arm = fl.Arm(
        links=(strip,), materials={"steel": fl.Material(young=E, density=RHO)},
        sections={"strip": fl.Section(shape="rectangle", height=HEIGHT, width=WIDTH)},
    )  # fmt: skip
    return fl.Scene(name="strip", arm=arm, gravity=(0.0, 0.0, 0.0))


def softly_clamped(ratio: float, count: int) -> np.ndarray:
    """First frequencies [rad/s] of a beam on a root spring k = ratio EI/L, free at its tip, with x = β L:

    ratio (1 + cos x cosh x) + x (cos x sinh x − sin x cosh x) = 0        ω = x² √(EI/ρA) / L²
    """

    def condition(x: float) -> float:
        both = np.cos(x) * np.sinh(x) - np.sin(x) * np.cosh(x)
        return float(ratio * (1 + np.cos(x) * np.cosh(x)) + x * both)

    x = np.linspace(0.1, 4.0 * count, 2000)
    roots = [brentq(condition, a, b) for a, b in itertools.pairwise(x) if condition(a) * condition(b) < 0]
    return np.square(roots[:count]) * np.sqrt(EI / RHO_A) / LENGTH**2


RULES = {
    "gauss": 2e-5, "gauss_matched": 2e-5, "gauss_rotation": 2e-5, "legendre": 2e-5, "gregory": 6e-5, "lobatto2": 1e-4,
    "lobatto2_rotation": 1e-4, "lobatto4": 3e-5, "midpoint": 1e-3, "open": 5e-3, "paper": 3e-2,
}  # fmt: skip
"""Allowed error of the first two frequencies with 16 hinges, by rule; it is about ten times the error of a rigidly
clamped beam."""


@pytest.mark.parametrize("rule", RULES)
def test_an_elastically_clamped_beam_has_the_closed_form_frequencies(rule: str) -> None:
    chain = fl.lump(clamped(rule))
    assert chain.joint_names[0] == "strip.root.z"
    assert chain.coordinate("strip.root.z") == (1, 0, 6)
    ω = fl.natural_frequencies(chain)
    np.testing.assert_allclose(ω[:2], softly_clamped(3.0, 2), rtol=RULES[rule])


def test_errors_fall_with_order_4_down_to_the_effect_of_rotary_inertia() -> None:
    exact = softly_clamped(3.0, 3)[2]
    errors = [abs(fl.natural_frequencies(fl.lump(clamped("gauss", n)))[2] / exact - 1) for n in (4, 8, 16)]
    assert errors[1] < errors[0] / 10
    assert errors[2] < errors[1] / 10


def test_a_stiff_root_spring_acts_as_a_clamp_and_a_soft_one_as_a_pin() -> None:
    free, rigid = clamped(joint=fl.Joint(), root_stiffness=None), clamped(root_stiffness=None)
    stiff = fl.natural_frequencies(fl.lump(clamped(root_stiffness=fl.details.RootStiffness(z=1e6 * EI))))[:3]
    soft = fl.natural_frequencies(fl.lump(clamped(root_stiffness=fl.details.RootStiffness(z=1e-6 * EI))))[:3]
    np.testing.assert_allclose(stiff, fl.natural_frequencies(fl.lump(rigid))[:3], rtol=1e-5)
    np.testing.assert_allclose(soft[1:], fl.natural_frequencies(fl.lump(free))[1:3], rtol=1e-5)
    assert soft[0] == pytest.approx(np.sqrt(1e-6 * EI / (RHO_A * LENGTH**3 / 3)), rel=1e-5)


def test_a_root_spring_adds_its_rotation_to_the_sag_of_the_beam() -> None:
    """The tip sags by δ = F L³/(3 EI) + F L²/k."""
    scene, force, k = clamped(), 1e-4, 3 * EI / LENGTH
    chain = fl.lump(scene)
    q = fl.solve_static(chain, np.zeros(chain.n), tip_wrench=[0, force, 0, 0, 0, 0]).q
    sag = force * LENGTH**3 / (3 * EI) + force * LENGTH**2 / k
    assert fl.tip_position(chain, q)[1] == pytest.approx(sag, rel=1e-6)
    assert q[0] == pytest.approx(force * LENGTH / k, rel=1e-6)


def test_a_rigid_link_on_root_springs_vibrates_about_each_axis_separately() -> None:
    """ω² = k/I and ζ = d ω/(2 k) about every axis of the link frame, for any direction of the beam in it."""
    k, d, inertia = (300.0, 500.0, 700.0), (0.3, 0.0, 0.7), (0.1, 0.2, 0.5)
    link = fl.Link(
        name="a", line=((0.0, 0.0, 0.0), (0.0, 0.5, 0.5)), joint=HELD, end=fl.RigidBody(inertia=inertia),
        root_stiffness=fl.details.RootStiffness(x=k[0], y=k[1], z=k[2]),
        root_damping=fl.details.RootDamping(x=d[0], z=d[2]),
    )  # fmt: skip
    chain = fl.lump(make_scene(link, gravity=(0.0, 0.0, 0.0)))
    assert chain.joint_names == ("a.root.x", "a.root.y", "a.root.z")
    found = fl.modes(chain)
    ω = np.sqrt(np.divide(k, inertia))
    order = np.argsort(ω)
    np.testing.assert_allclose(found.frequencies, ω[order], rtol=1e-12)
    np.testing.assert_allclose(found.damping_ratios, (np.array(d) * ω / (2 * np.array(k)))[order], atol=1e-12)


def test_the_sensitivity_to_a_root_stiffness_equals_that_of_an_oscillator() -> None:
    """After release from rest at θ₀, θ = θ₀ cos(ω t) with ω² = k/I, so ∂θ/∂k = −θ₀ t sin(ω t) ω/(2k)."""
    k, inertia, t, moment = 80.0, 0.2, 0.4, 1.0
    link = fl.Link(
        name="a", joint=HELD, end=fl.RigidBody(inertia=(inertia,) * 3), root_stiffness=fl.details.RootStiffness(z=k)
    )
    scene = make_scene(
        link, gravity=(0.0, 0.0, 0.0), initial=fl.InitialState(joint_deg=(0.0,), q=(moment / k,)),
        run=fl.RunSettings(duration=t, step=1e-3, sample=t),
    )  # fmt: skip
    found = fl.sensitivities(scene, ["link.a.root_stiffness.z"])
    ω = np.sqrt(k / inertia)
    wanted = -moment / k * t * np.sin(ω * t) * ω / (2 * k)
    assert found.q[-1, 0, 0] == pytest.approx(wanted, rel=1e-6)


def test_advice_keeps_the_root_spring() -> None:
    scene = clamped(root_stiffness=fl.details.RootStiffness(z=30 * EI)).varied(
        {"gravity": (0.0, -0.2, 0.0), "run": fl.RunSettings(duration=0.5)}
    )
    found = fl.advise(scene, tip=5e-3)
    assert found.scene.arm.links[0].root_stiffness == scene.arm.links[0].root_stiffness


def test_impossible_root_springs_are_refused() -> None:
    with refused(fl.errors.SceneError, "root-stiffness-axis"):
        fl.lump(clamped(joint=fl.Joint()))
    geared = fl.Joint(armature=0.1, gear_stiffness=100.0)
    with refused(fl.errors.SceneError, "root-stiffness-axis"):
        fl.lump(clamped(joint=geared))
    fl.lump(clamped(joint=geared, hub=fl.RigidBody(inertia=(0.0, 0.0, 0.1))))
    for fine in ({"joint": fl.Joint(armature=0.1)}, {"hub": fl.RigidBody(inertia=(0.0, 0.0, 0.1))}):
        chain = fl.lump(clamped(**{"joint": fl.Joint(), **fine}))
        assert np.linalg.eigvalsh(fl.mass_matrix(chain, np.zeros(chain.n))).min() > 0
    for rule in ("hencky", "clamped"):
        with refused(fl.errors.SceneError, "hinge-without-inertia"):
            fl.lump(clamped(rule))
    with refused(fl.errors.SceneError, "needs-another-key"):
        clamped(root_damping=fl.details.RootDamping(x=1.0))
    with refused(fl.errors.SceneError, "wrong-value"):
        fl.details.RootStiffness(z=0.0)
