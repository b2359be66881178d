"""Frequencies against closed forms, exact finite chains and published arms; spin, flutter, damping."""

from __future__ import annotations

import dataclasses
import itertools

import mpmath
import msgspec
import numpy as np
import pytest
from beams import cantilever, order, reference, thin_arm, thin_link, torsion_bar
from conftest import flexible, make_scene, nasty_scene
from numpy.polynomial import legendre
from scipy import linalg

import flexlink as fl
from flexlink import (
    ArgumentError,
    Arm,
    Joint,
    Link,
    Material,
    Payload,
    Section,
    elastic_torque,
    forward_dynamics,
    lump,
    modes,
    natural_frequencies,
    tip_position,
)
from flexlink.rules import lumping_rule
from flexlink.tangent import gyroscopic_matrix, load_torque, stiffness_matrix

BEAM = reference("eb_beam_roots")["dimensionless_omega_(betaL)^2"]
CLAMPED = np.array(BEAM["clamped_free"][:3], float)
PINNED = np.array(BEAM["pinned_free_and_clamped_pinned"][:3], float)


def clamped_error(rule, hinges):
    return natural_frequencies(cantilever(rule, hinges))[:3] / CLAMPED - 1


# --- bars: the continuous beam ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", ["gauss", "legendre"])
def test_four_hinges_give_the_first_clamped_mode_within_a_thousandth(rule):
    assert abs(clamped_error(rule, 4)[0]) < 1e-3  # measured: gauss 1.9e-4, legendre 6.2e-5; paper 0.25


@pytest.mark.parametrize("rule", ["gauss", "legendre"])
def test_ten_hinges_give_three_clamped_modes_within_two_thousandths(rule):
    assert (np.abs(clamped_error(rule, 10)) < 2e-3).all()  # measured in mode 3: gauss 1.6e-3, legendre 9.8e-4


@pytest.mark.parametrize(
    "rule, hinges, expected",
    [
        ("paper", (20, 40, 80), 1),
        ("hencky", (20, 40, 80), 2),
        ("midpoint", (10, 20, 40), 2),
        ("open", (20, 40, 80), 3),
        ("gauss", (8, 16, 32), 4),
        ("gregory", (16, 32, 64), 4),
        ("clamped", (8, 12, 16), 4),
        ("legendre", (6, 12, 24), 4),
        ("gauss_matched", (8, 16, 32), 4),
    ],
)
def test_order_of_the_first_clamped_mode(rule, hinges, expected):
    fitted = order({n: clamped_error(rule, n)[0] for n in hinges})
    assert expected - 0.25 < fitted < expected + 1  # `clamped` and `gregory` reach 4 from above


def test_at_a_torque_free_joint_the_papers_layout_has_order_four():
    errors = {}
    for n in (5, 10, 20):
        ω = natural_frequencies(thin_arm(thin_link("paper", n, free=True)))
        assert ω[0] < 1e-6  # rigid rotation
        errors[n + 1] = ω[1] / PINNED[0] - 1  # order in the number of equal segments
    assert order(errors) == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize("case", ["mu=1,j=0", "mu=1,j=0.1", "mu=5,j=0", "mu=0.5,j=0.01"])
def test_clamped_link_with_payload(case):
    μ, j = (float(part.split("=")[1]) for part in case.split(","))
    exact = np.array(reference("cantilever_tip_mass")["beta_n_L"][case][:3], float) ** 2
    tip = Payload(mass=μ, inertia=(0.0, 0.0, j))
    assert natural_frequencies(cantilever("legendre", 10, tip=tip))[:3] == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("ratio", ["0", "0.5", "1", "10"])
def test_four_hinges_twist_within_a_thousandth(ratio):
    values = reference("torsion_bar")
    exact = (
        values["x_n"]["clamped_free"] if ratio == "0" else values["x_n_clamped_tip_inertia_ratio_Jt/(rho Ip L)"][ratio]
    )
    chain, bending = torsion_bar("gauss_matched", 4, float(ratio))
    assert natural_frequencies(chain, locked=bending)[0] == pytest.approx(float(exact[0]), rel=1e-3)  # measured 8.7e-5


def test_matched_rotors_lift_the_order_of_twist_from_two_to_four():
    exact = np.pi / 2
    measured = {}
    for rule in ("midpoint", "gauss", "legendre", "gauss_matched"):
        errors = {}
        for n in (4, 8, 16):
            chain, bending = torsion_bar(rule, n)
            errors[n] = natural_frequencies(chain, locked=bending)[0] / exact - 1
        measured[rule] = order(errors)
    assert measured == pytest.approx({"midpoint": 2, "gauss": 2, "legendre": 2, "gauss_matched": 4}, abs=0.25)


# --- exact finite chains: theory and code describe the same thing ----------------------------------------------------


@pytest.mark.parametrize("rule, name", [("paper", "paper"), ("hencky", "nodal_2k"), ("midpoint", "midpoint")])
@pytest.mark.parametrize("n", [3, 4, 5, 8, 10, 20])
def test_finite_bending_chains_to_rounding(rule, name, n):
    exact = np.array(reference("hencky_closed_forms")["dimensionless_omega_rod_chain"][f"CF,{name},n={n}"], float)
    ω = natural_frequencies(cantilever(rule, n - 1 if rule == "paper" else n))
    assert ω[: len(exact)] == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("rule", ["paper", "midpoint", "hencky", "gauss", "gregory", "clamped", "open", "legendre"])
def test_all_modes_of_a_bending_chain_against_forty_digits(rule):
    nodes, weights = lumping_rule(rule).hinges(10)
    with mpmath.workdps(40):
        x, w = [mpmath.mpf(v) for v in nodes], [mpmath.mpf(v) for v in weights]
        S = mpmath.matrix(10)  # W½ M W½, M_ij = ∫ (ξ − x_i)₊ (ξ − x_j)₊ dξ: rods without rotary inertia, EI = 1
        for i, j in itertools.product(range(10), repeat=2):
            a, d = 1 - max(x[i], x[j]), abs(x[i] - x[j])
            S[i, j] = mpmath.sqrt(w[i] * w[j]) * (a**3 / 3 + d * a**2 / 2)
        exact = sorted(float(1 / mpmath.sqrt(v)) for v in mpmath.eigsy(S, eigvals_only=True))
    assert natural_frequencies(cantilever(rule, 10)) == pytest.approx(exact, rel=1e-10)


@pytest.mark.parametrize("n", [2, 3, 5, 10, 20])
def test_all_modes_of_finite_torsion_chains_to_rounding(n):
    j = np.arange(1, n + 1)
    midpoint, bending = torsion_bar("midpoint", n)
    assert natural_frequencies(midpoint, locked=bending) == pytest.approx(
        2 * n * np.sin((2 * j - 1) * np.pi / (4 * n)), rel=1e-10
    )
    paper, bending = torsion_bar("paper", n - 1)
    assert natural_frequencies(paper, locked=bending) == pytest.approx(
        2 * n * np.sin((2 * j[:-1] - 1) * np.pi / (2 * (2 * n - 1))), rel=1e-10
    )


# --- arms ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0, 30, 45, 60, 90])
@pytest.mark.parametrize(
    "key, elbow, root",
    [("2 equal links L=EI=rhoA=1, elbow locked at {} deg, clamped base", "locked", "locked"),
     ("2 equal links, base torque-free, elbow locked at {} deg (elastic modes)", "locked", "free"),
     ("2 equal links, base clamped, elbow torque-free at {} deg", "free", "locked")],
)  # fmt: skip
def test_two_link_arms_with_locked_and_free_joints(angle, key, elbow, root):
    exact = np.array(reference("multilink_locked_freq")["two_link_dimensionless_omega"][key.format(angle)][:3], float)
    links = thin_link("legendre", 8, "upper", free=True), thin_link("legendre", 8, "fore", free=True)
    chain = thin_arm(*links)
    q = np.zeros(chain.n)
    q[chain.active[1]] = np.radians(angle)
    locked = [k for k, state in zip(chain.active, (root, elbow), strict=True) if state == "locked"]
    elastic = natural_frequencies(chain, q, locked=locked)[2 - len(locked) :]  # every free joint is one rigid mode
    assert elastic[:3] == pytest.approx(exact, rel=1e-3)


def de_luca_siciliano(rule, hinges, *, elbow_deg=90.0, **root):
    """The two-link arm of De Luca & Siciliano (1991): EI = 1 N m², ρA = 0.2 kg/m, L = 0.5 m, elbow hub 1 kg."""
    hub = Section(shape="general", area=1e9, i_y=1e-20, i_z=1e8, torsion=1e-20)  # 1 kg, 0.1 kg m² on 1 nm
    flexible_link = {"length": 0.5, "flex": "z", "material": "link", "section": "thin", "segments": hinges + 1}
    return lump(
        Arm(
            links=(
                Link(name="upper", lumping=rule, joint=Joint(**root), **flexible_link),
                Link(name="hub", length=1e-9, material="hub", section="hub", joint=Joint(locked=True)),
                Link(name="fore", lumping=rule, joint=Joint(locked=True), **flexible_link),
            ),
            materials={"link": Material(young=1e16, density=0.2), "hub": Material(young=1.0, density=1.0)},
            sections={"thin": Section(shape="general", area=1.0, i_y=1e-16, i_z=1e-16, torsion=1e-16), "hub": hub},
            tip=Payload(mass=0.1, inertia=(0.0, 0.0, 5e-4)),
        ),
        (0.0, 0.0, 0.0),
        (0.0, elbow_deg, 0.0),
    )


def test_de_luca_and_sicilianos_clamped_links():
    clamped = {
        "materials": {"link": Material(young=1e16, density=0.2)},
        "sections": {"thin": Section(shape="general", area=1.0, i_y=1e-16, i_z=1e-16, torsion=1e-16)},
    }
    link = Link(
        name="link", length=0.5, flex="z", material="link", section="thin", segments=9, lumping="legendre",
        joint=Joint(locked=True),
    )  # fmt: skip
    beyond = 0.1 + 0.2 * 0.5**3 / 3 + 0.1 * 0.5**2 + 5e-4  # hub, link 2 and payload about the elbow [kg m²]
    first = lump(Arm(links=(link,), tip=Payload(mass=1.2, inertia=(0.0, 0.0, beyond)), **clamped), (0.0, 0.0, 0.0))
    second = lump(Arm(links=(link,), tip=Payload(mass=0.1, inertia=(0.0, 0.0, 5e-4)), **clamped), (0.0, 0.0, 0.0))
    measured = np.concatenate([modes(first).hertz[:2], modes(second).hertz[:2]])
    published = [0.4797, 1.7966, 2.1783, 15.9145]
    assert measured[:3] == pytest.approx(published[:3], rel=1e-3)  # measured 1e-6
    assert measured == pytest.approx(published, rel=2e-4)  # the published digits


@pytest.mark.parametrize("angle", [0, 45, 90])
def test_de_luca_and_sicilianos_assembled_arm(angle):
    values = reference("de_luca_siciliano_two_link")["exact system frequencies Hz (inextensible EB)"]
    clamped = modes(de_luca_siciliano("legendre", 8, elbow_deg=angle, locked=True)).hertz
    assert clamped[:3] == pytest.approx(
        np.array(values[f"clamped base, elbow locked at {angle} deg"][:3], float), rel=1e-5
    )
    hub = modes(de_luca_siciliano("legendre", 8, elbow_deg=angle, armature=0.1)).hertz
    exact = values[f"base torque-free hub Jh1=0.1, elbow locked at {angle} deg (elastic)"]
    assert hub[1:4] == pytest.approx(np.array(exact[:3], float), rel=1e-5)


# --- posture, gravity, spin, damping ---------------------------------------------------------------------------------


def test_tangents_are_slopes_of_the_torques():
    chain, rng = nasty_scene().chain(), np.random.default_rng(1)
    q, qd, wrench = rng.uniform(-1, 1, chain.n), rng.uniform(-3, 3, chain.n), rng.uniform(-5, 5, 6)
    for follower in (False, True):
        K = stiffness_matrix(chain, q, qd, wrench, follower)
        for j, e in enumerate(np.eye(chain.n)):
            h = 1e-3  # Richardson-extrapolated central difference: truncation h⁴, rounding eps/h

            def slope(h, e=e, follower=follower):
                places = (q + h * e, q - h * e)
                ahead, behind = (load_torque(chain, x, qd, wrench, follower) + elastic_torque(chain, x) for x in places)
                return (ahead - behind) / (2 * h)

            difference = (4 * slope(h / 2) - slope(h)) / 3
            assert K[:, j] == pytest.approx(difference, abs=1e-9 * np.abs(K).max())
    G = gyroscopic_matrix(chain, q, qd)
    whole = load_torque(chain, q, qd, np.zeros(6)) - load_torque(chain, q, 0 * qd, np.zeros(6))
    assert G @ qd == pytest.approx(2 * whole, abs=1e-12 * np.abs(whole).max() * chain.n)  # Euler: degree 2 in q̇


def test_rigid_pendulum():
    scene = make_scene(Link(name="rod", length=2.0, material="aluminium", section="square"), gravity=(9.81, 0.0, 0.0))
    chain = scene.chain()
    I = 2.0**2 / 3 + 0.04**2 / 12 + 0.0  # per mass, about the joint: L²/3 + h²/12
    assert natural_frequencies(chain) == pytest.approx([np.sqrt(9.81 * 1.0 / I)], rel=1e-12)
    upright = modes(chain, [np.pi])
    assert np.isnan(upright.frequencies).all()
    assert not upright.stable
    assert upright.eigenvalues == pytest.approx([np.sqrt(9.81 / I)], rel=1e-12)


def rotating_beam(Ω, terms=20):
    """Flapping frequencies of a clamped beam turning at Ω, Ritz: ∫ w''² + ½Ω²(1 − x²) w'² = ω² ∫ w², w = x² P_k."""
    t, weights = np.polynomial.legendre.leggauss(60)
    x, weights = (t + 1) / 2, weights / 2
    w, dw, ddw = [], [], []
    for k in range(terms):
        c = np.eye(terms)[k]
        p, dp, ddp = (2**m * legendre.legval(t, legendre.legder(c, m)) for m in range(3))
        w.append(x**2 * p)
        dw.append(2 * x * p + x**2 * dp)
        ddw.append(2 * p + 4 * x * dp + x**2 * ddp)
    w, dw, ddw = np.array(w), np.array(dw), np.array(ddw)
    K = (ddw * weights) @ ddw.T + (dw * weights * Ω**2 * (1 - x**2) / 2) @ dw.T
    return np.sqrt(linalg.eigh(K, (w * weights) @ w.T, eigvals_only=True))


@pytest.mark.parametrize("Ω", [3.0, 6.0])
def test_spin_stiffens_flapping_and_lagging(Ω):
    exact = rotating_beam(Ω)[:2]
    assert rotating_beam(3.0)[0] == pytest.approx(4.7973, abs=5e-5)  # Wright et al. 1982
    expected = np.sort([*exact, *np.sqrt(exact**2 - Ω**2)])  # lag: ω² = ω_flap² − Ω²
    errors = {}
    for n in (10, 20):
        chain = thin_arm(thin_link("legendre", n, flex="yz", free=True))
        rates = np.zeros(chain.n)
        rates[0] = Ω
        spinning = modes(chain, qd=rates, locked=[0])
        assert spinning.stable
        errors[n] = np.abs(spinning.frequencies[:4] / expected - 1).max()
    assert errors[20] < 2e-3
    assert order(errors) == pytest.approx(2, abs=0.3)  # centrifugal stiffness sees chords, not arcs


def test_without_centrifugal_stiffness_the_spinning_beam_would_be_ten_percent_off():
    chain = thin_arm(thin_link("legendre", 10, flex="yz", free=True))
    assert natural_frequencies(chain, locked=[0])[0] / rotating_beam(3.0)[0] < 0.9


@pytest.mark.parametrize("rule, hinges", [("legendre", 20), ("midpoint", 10)])
def test_becks_column_flutters_at_the_published_load(rule, hinges):
    values = reference("critical_loads")
    chain = cantilever(rule, hinges)

    def at(load):
        return modes(chain, tip_wrench=[-load, 0, 0, 0, 0, 0], follower=True)

    low, high = 10.0, 30.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if at(middle).stable else (low, middle)
    assert low == pytest.approx(float(values["beck_PL2/EI"]), rel=1.2e-2)
    assert at(low).frequencies[:2] == pytest.approx([float(values["beck_omega_at_flutter"])] * 2, rel=1e-2)
    assert (np.abs(at(high).eigenvalues.imag[:2]) > 1).all()  # it flutters, it does not buckle


@pytest.mark.parametrize("loss_time", [1e-4, 1e-3, 3e-3])
def test_kelvin_voigt_damping_grows_with_frequency(loss_time):
    chain = cantilever("gauss", 4)
    ω = natural_frequencies(chain)
    hinges = chain.hinges.copy()
    hinges["damping"] = loss_time * chain.stiffness
    damped = modes(dataclasses.replace(chain, hinges=hinges))
    assert loss_time * ω.max() < 2  # all oscillate
    assert damped.frequencies == pytest.approx(ω, rel=1e-9)
    assert damped.damping_ratios == pytest.approx(loss_time * ω / 2, rel=1e-8)


def test_eigenvalues_are_those_of_the_linearised_forward_dynamics():
    """Gravity, wrench, springs, all friction, joints free: δq̈ = A δq + B δq̇ by differences of `forward_dynamics`."""
    chain = nasty_scene().chain()
    n, wrench = chain.n, np.array([3.0, -2.0, 5.0, 1.0, 0.5, -1.0])
    q, rest = np.linspace(-0.3, 0.4, n), np.zeros(n)
    tau = load_torque(chain, q, rest, wrench) + elastic_torque(chain, q)  # holds the arm: an equilibrium

    def slope(f, h):
        return np.array([(f(h * e) - f(-h * e)) / (2 * h) for e in np.eye(n)]).T

    A = slope(lambda d: forward_dynamics(chain, q + d, rest, tau, tip_wrench=wrench), 1e-6)
    B = slope(lambda d: forward_dynamics(chain, q, d, tau, tip_wrench=wrench), 1e-6)
    λ = linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [A, B]]))
    found = modes(chain, q, tip_wrench=wrench).eigenvalues
    for value in found:
        assert np.abs(λ - value).min() < 1e-6 * np.abs(found).max()


def test_a_column_stands_up_to_its_buckling_load_and_hangs_stiffer():
    standing, hanging, weightless = (
        natural_frequencies(cantilever("gauss", 8, gravity=(g, 0.0, 0.0)))[0] for g in (-7.0, 7.0, 0.0)
    )
    assert standing < 0.4 * weightless < weightless < hanging  # buckles at 7.84
    assert not modes(cantilever("gauss", 8, gravity=(-8.5, 0.0, 0.0))).stable


def test_paths_are_the_displacements_of_the_points():
    chain = nasty_scene().chain()
    q = np.linspace(-1, 1, chain.n)
    found = modes(chain, q)
    h = 1e-6
    shape = found.shapes[2].real
    moved = (tip_position(chain, q + h * shape) - tip_position(chain, q - h * shape)) / (2 * h)
    assert found.paths[2, -1].real == pytest.approx(moved, abs=1e-8)
    assert found.points[-1] == pytest.approx(tip_position(chain, q))
    assert np.abs(found.shapes).max(axis=1) == pytest.approx(np.ones(len(found.shapes)))


def test_locked_coordinates_do_not_move():
    chain = nasty_scene().chain()
    found = modes(chain, locked=chain.active)
    assert (found.shapes[:, chain.active] == 0).all()
    assert found.shapes.any(axis=1).all()


@pytest.mark.parametrize("locked", [[99], [-1], list(range(10))])
def test_bad_locks_are_named(locked):
    with pytest.raises(ArgumentError, match="locked"):
        modes(cantilever("gauss", 10), locked=locked)


def test_a_joint_with_prescribed_motion_takes_no_part_in_modes_and_stable_steps():
    link = flexible("a", segments=5)
    held = fl.Motion(link="a", times=[0.0], angle_deg=[0.0], rate_deg=[0.0], acceleration_deg=[0.0])
    prescribed = make_scene(link, motion=(held,)).chain()
    locked = make_scene(msgspec.structs.replace(link, joint=fl.Joint(locked=True))).chain()
    np.testing.assert_allclose(fl.natural_frequencies(prescribed), fl.natural_frequencies(locked), rtol=1e-12)
    assert fl.stable_step(prescribed) == pytest.approx(fl.stable_step(locked), rel=1e-9)
    rigid = make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"), motion=(held,)).chain()
    assert fl.stable_step(rigid) == np.inf
