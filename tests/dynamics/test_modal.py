"""Frequencies, damping and flutter agree with closed forms, exact finite chains and published arms."""

import dataclasses

import mpmath
import msgspec
import numpy as np
import pytest

import flexlink as fl
from flexlink import (
    Arm,
    Joint,
    Link,
    Material,
    Mount,
    RigidBody,
    Section,
    elastic_torque,
    modes,
    natural_frequencies,
    tip_position,
)
from flexlink.chain.rigid import matrix_from_rpy_deg
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.dynamics.tangent import gyroscopic_matrix, load_torque, stiffness_matrix, tangent
from flexlink.dynamics.vibration.eigenproblem import first_order_matrix
from flexlink.dynamics.vibration.modal import scaled
from flexlink.errors import ArgumentError
from tests.conftest import chain_of, flexible, make_scene, nasty_scene
from tests.support.beams import cantilever
from tests.support.words import refused
from validation.oracles import bending_chain
from validation.random_arms import random_arm
from validation.reference_values import look_up


@pytest.mark.parametrize("noise", [-1e-12, 0.0, 1e-12])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_sign_of_a_symmetric_shape_is_independent_of_rounding(noise: float, sign: float) -> None:
    found = scaled(sign * np.array([[0.2, 0.3], [0.5, -0.5 - noise], [0.1, 0.0], [-0.5 - noise, 0.5]]))
    np.testing.assert_allclose(found, [[0.4, -0.6], [1, 1], [0.2, 0], [-1, -1]], rtol=0, atol=1e-11)


# --- exact finite chains: theory and code have the same model ----------------------------------------------------


@pytest.mark.parametrize("rule", ["paper", "midpoint", "hencky", "gauss", "gregory", "clamped", "open", "legendre"])
def test_all_modes_of_a_bending_chain_agree_with_40_digit_values(rule):
    exact = bending_chain.frequencies(*lumping_rule(rule).hinges(10))
    assert natural_frequencies(cantilever(rule, 10)) == pytest.approx(exact, rel=1e-10)


# --- arms ------------------------------------------------------------------------------------------------------------


def test_frequencies_of_the_arm_of_de_luca_and_siciliano_are_reproduced():
    clamped = {
        "materials": {"link": Material(young=1e16, density=0.2)},
        "sections": {"thin": Section(shape="general", area=1.0, i_y=1e-16, i_z=1e-16, torsion=1e-16)},
    }
    link = Link(
        name="link", length=0.5, flex="z", material="link", section="thin", segments=9, lumping="legendre",
        joint=Joint(locked=True),
    )  # fmt: skip
    beyond = 0.1 + 0.2 * 0.5**3 / 3 + 0.1 * 0.5**2 + 5e-4  # hub, link 2 and payload about the elbow [kg m²]
    first = chain_of(
        Arm(links=(link,), tip=RigidBody(mass=1.2, inertia=(beyond, beyond, beyond)), **clamped), (0.0, 0.0, 0.0)
    )
    second = chain_of(
        Arm(links=(link,), tip=RigidBody(mass=0.1, inertia=(5e-4, 5e-4, 5e-4)), **clamped), (0.0, 0.0, 0.0)
    )
    measured = np.concatenate([modes(first).hertz[:2], modes(second).hertz[:2]])
    published = [0.4797, 1.7966, 2.1783, 15.9145]
    assert measured[:3] == pytest.approx(published[:3], rel=1e-3)  # the measured deviation is 1e-6
    assert measured == pytest.approx(published, rel=2e-4)  # within the published digits


# --- posture, gravity, spin, damping ---------------------------------------------------------------------------------


def test_tangent_matrices_are_derivatives_of_the_torques():
    chain, rng = fl.lump(nasty_scene()), np.random.default_rng(1)
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
    assert G @ qd == pytest.approx(2 * whole, abs=1e-12 * np.abs(whole).max() * chain.n)  # T_GC is of degree 2 in q̇


def test_follower_force_and_moment_act_in_axes_of_the_tip():
    """Every joint torque is the power R f · v + R m · ω per unit joint rate, with v and ω of the tip by differences."""
    chain, rng = fl.lump(nasty_scene()), np.random.default_rng(2)
    q, still, none = rng.uniform(-1, 1, chain.n), np.zeros(chain.n), np.zeros(6)
    R = fl.frames(chain, q).rotations[-1]
    for wrench in (np.array([3.0, -2.0, 5.0, 0, 0, 0]), np.array([0, 0, 0, 4.0, -1.0, 2.0])):
        found = load_torque(chain, q, still, wrench, follower=True) - load_torque(chain, q, still, none)
        for j, quarter in enumerate(np.pi / 2 * np.eye(chain.n)):
            ahead, behind = fl.frames(chain, q + quarter), fl.frames(chain, q - quarter)
            turning = (ahead.rotations[-1] - behind.rotations[-1]) / 2 @ R.T  # ω×, exact: R has degree 1 in cos, sin
            ω = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
            v = (ahead.points[-1] - behind.points[-1]) / 2
            work = (R @ wrench[:3]) @ v + (R @ wrench[3:]) @ ω
            assert found[j] == pytest.approx(-work, abs=1e-12)


def test_a_rigid_pendulum_has_its_closed_form_frequency():
    scene = make_scene(Link(name="rod", length=2.0, material="aluminium", section="square"), gravity=(9.81, 0.0, 0.0))
    chain = fl.lump(scene)
    I = 2.0**2 / 3 + 0.04**2 / 12 + 0.0  # per mass, about the joint: L²/3 + h²/12
    assert natural_frequencies(chain) == pytest.approx([np.sqrt(9.81 * 1.0 / I)], rel=1e-12)
    upright = modes(chain, [np.pi])
    assert np.isnan(upright.frequencies).all()
    assert not upright.stable
    assert upright.eigenvalues == pytest.approx([np.sqrt(9.81 / I)], rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rule, hinges", [("legendre", 20), ("midpoint", 10)])
def test_becks_column_flutters_at_the_published_load(rule, hinges):
    values = look_up("critical_loads")
    chain = cantilever(rule, hinges)

    def at(load):
        return modes(chain, tip_wrench=[-load, 0, 0, 0, 0, 0], frame="tip")

    low, high = 10.0, 30.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if at(middle).stable else (low, middle)
    load, frequency = (float(values[key]) for key in ("beck_PL2/EI", "beck_omega_at_flutter"))
    assert low == pytest.approx(load, rel=1.2e-2)
    assert at(low).frequencies[:2] == pytest.approx([frequency] * 2, rel=1e-2)
    assert (np.abs(at(high).eigenvalues.imag[:2]) > 1).all()  # flutter, not buckling


@pytest.mark.parametrize("loss_time", [1e-4, 1e-3, 3e-3])
def test_kelvin_voigt_damping_grows_with_frequency(loss_time):
    chain = cantilever("gauss", 4)
    ω = natural_frequencies(chain)
    hinges = chain.hinges.copy()
    hinges["damping"] = loss_time * chain.stiffness
    damped = modes(dataclasses.replace(chain, hinges=hinges))
    assert loss_time * ω.max() < 2  # all modes oscillate
    assert damped.frequencies == pytest.approx(ω, rel=1e-9)
    assert damped.damping_ratios == pytest.approx(loss_time * ω / 2, rel=1e-8)


# --- rounding: stiff and soft modes, and joints without restoring torque ---------------------------------------------


def l_arm(ratio, segments=9, gravity=(0.0, 0.0, 0.0), loss_time=0.0):
    """Two links at a right angle, EI_z = `ratio` EI_y, clamped."""
    links = [
        Link(
            name=name, length=1.0, flex="yz", segments=segments, material="m", section="s", joint=Joint(locked=True),
            mount=Mount(rpy_deg=(0.0, 0.0, turn)),
        )
        for name, turn in (("a", 0.0), ("b", 90.0))
    ]  # fmt: skip
    strip = Section(shape="general", area=1.0, i_y=1e-16, i_z=1e-16 * ratio, torsion=1e-16)
    material = Material(young=1e18, density=1.0, loss_time=loss_time)
    return chain_of(Arm(links=tuple(links), materials={"m": material}, sections={"s": strip}), gravity)


def sixty_digits(chain):
    """ω of the chain's M and K to 60 digits, slowest first."""
    q, every = np.zeros(chain.n), np.arange(chain.n)
    K = tangent(chain, q, q, np.zeros(6), False, every).symmetric
    with mpmath.workdps(60):
        inverse = mpmath.inverse(mpmath.cholesky(mpmath.matrix(fl.mass_matrix(chain, q).tolist())))
        S = inverse * mpmath.matrix(K.tolist()) * inverse.T
        return np.array([float(mpmath.sqrt(v)) for v in sorted(mpmath.eigsy(S, eigvals_only=True))])


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, 9.81)])
@pytest.mark.parametrize("ratio", [1e8, 1e12])
def test_soft_modes_stay_accurate_in_the_presence_of_stiff_ones(ratio, gravity):
    """If ω² were computed as eigenvalues, the error ω_max² eps would be 3e-4 of the first ω² at a ratio of 1e8."""
    chain = l_arm(ratio, segments=5, gravity=gravity)
    exact = sixty_digits(chain)
    assert exact[-1] / exact[0] > 50 * ratio**0.5
    M = fl.mass_matrix(chain, np.zeros(chain.n))
    size = np.sqrt(np.diag(M))
    # From the Cholesky factor of M scaled to unit diagonal (Demmel 1989), and from singular values next to the largest
    rounding = 2.3e-16 * (chain.n * np.linalg.cond(M / np.outer(size, size)) + exact[-1] / exact)
    assert (np.abs(natural_frequencies(chain) / exact - 1) < rounding).all()
    assert rounding[0] < 1e-7


@pytest.mark.parametrize("ratio", [1e8, 1e12])
def test_damping_of_soft_modes_stays_accurate_in_the_presence_of_stiff_ones(ratio):
    """ζ = η ω/2 ranges from 1 % in the first mode to 1e6 in the last, overdamped one."""
    undamped = sixty_digits(l_arm(ratio, segments=5))
    η = 0.02 / float(undamped[0])
    found = modes(l_arm(ratio, segments=5, loss_time=η))
    swinging = undamped[η * undamped < 2]
    assert found.stable
    assert found.damping_ratios[0] == pytest.approx(0.01, rel=1e-6)
    for ω in swinging:
        λ = ω * (-η * ω / 2 + 1j * np.sqrt(1 - (η * ω / 2) ** 2))
        assert np.abs(found.eigenvalues - λ).min() < 1e-5 * ω


def test_the_first_mode_converges_with_order_4_if_one_plane_is_very_stiff():
    first = {n: natural_frequencies(l_arm(1e12, segments=n + 1))[0] for n in (4, 8, 16)}
    assert (first[16] - first[8]) / (first[8] - first[4]) == pytest.approx(1 / 16, rel=0.4)


def test_the_mass_matrix_is_factored_from_its_checked_triangle():
    """Near singularity, rounding may make one triangle of M regular and the other singular; this M is such a case."""
    M = np.array([[1.0, 1.0], [0.5, 1.0]])  # regular below the diagonal, singular above
    judged = np.array([[1.0, 0.5], [0.5, 1.0]])
    A = first_order_matrix(M, 2 * np.eye(2), 3 * np.eye(2))
    assert A[2:] == pytest.approx(np.hstack([-3 * np.linalg.inv(judged), -2 * np.linalg.inv(judged)]))


@pytest.mark.parametrize("seed", range(0, 40, 3))
def test_each_free_joint_has_one_zero_eigenvalue_and_no_other_mode_has(seed: int) -> None:
    """λ = 0 exactly, once for each free joint, damped or not; no frequency is NaN, and no ζ is −1."""
    chain, rng = fl.lump(random_arm(seed).varied({"gravity": (0.0, 0.0, 0.0)})), np.random.default_rng(seed)
    q = np.zeros(chain.n)
    q[chain.active] = rng.uniform(-1, 1, len(chain.active))
    found = modes(chain, q)
    assert found.stable
    assert (found.eigenvalues == 0).sum() == len(chain.active)
    assert np.isfinite(found.frequencies).all()
    assert found.damping_ratios.min() == 0


def test_joints_with_axes_along_gravity_have_zero_eigenvalues(rng):
    """For a skewed, bent, loaded and damped arm the gravity torque about these axes is only a rounding error."""
    for damping in (None, fl.Damping(ratio=0.01, at_hz=5.0)):
        angles = tuple(rng.uniform(-180, 180, 3).tolist())
        links = (flexible("a", mount=Mount(rpy_deg=angles), damping=damping), flexible("b", joint=Joint(viscous=0.5)))
        along = tuple((9.81 * matrix_from_rpy_deg(angles)[:, 2]).tolist())
        chain = fl.lump(make_scene(*links, tip=RigidBody(mass=300.0), gravity=along))
        for _ in range(5):
            found = modes(chain, rng.uniform(-0.5, 0.5, chain.n))
            assert found.stable
            assert (found.eigenvalues == 0).sum() == 2


@pytest.mark.parametrize("damping", [None, fl.Damping(ratio=0.01, at_hz=5.0)])
def test_a_joint_that_turns_with_its_follower_load_is_not_unstable(damping, rng):
    """Nothing depends on the joint's angle, but K is not symmetric: the double λ = 0 is detected."""
    chain = fl.lump(make_scene(flexible("a", "yz", damping=damping)))
    for load in np.hstack([rng.uniform(-5, 5, (10, 3)), rng.uniform(-1, 1, (10, 3))]):
        found = modes(chain, rng.uniform(-0.2, 0.2, chain.n), tip_wrench=load, frame="tip")
        assert found.stable
        assert found.frequencies[0] == found.damping_ratios[0] == 0
        assert np.isfinite(found.frequencies).all()
        assert found.rounding.max() < 1e-6 * found.frequencies.max()


@pytest.mark.parametrize("viscous", [0.0, 1e-3])
@pytest.mark.parametrize("g", [9.81, 1e-9])
def test_a_slowly_falling_mode_is_unstable_not_rigid(g, viscous):
    """A stiff bar upright on a free joint: λ = √(g/l'), independent of the springs."""
    link = flexible("a", joint=Joint(viscous=viscous), lumping="gauss")
    chain = fl.lump(make_scene(link, tip=RigidBody(mass=5.0), gravity=(-g, 0.0, 0.0)))
    found = modes(chain)
    m, L = float(chain.bodies["mass"].sum()), 1.25
    beam = m - 5.0
    I, torque = 5.0 * L**2 + beam * (L**2 / 3 + 0.04**2 / 12), g * (5.0 * L + beam * L / 2)
    falls = -viscous / (2 * I) + np.sqrt((viscous / (2 * I)) ** 2 + torque / I)
    assert not found.stable
    assert np.isnan(found.frequencies).sum() == 1
    assert found.eigenvalues.real.max() == pytest.approx(falls, rel=2e-2)  # the bar also bends a little


@pytest.mark.parametrize("seed", range(1, 40, 3))
def test_counts_of_unstable_rigid_and_oscillating_modes_follow_sylvesters_law(seed: int) -> None:
    chain = fl.lump(random_arm(seed))
    q = np.zeros(chain.n)
    K = stiffness_matrix(chain, q, q, np.zeros(6))
    size = 1 / np.sqrt(np.abs(np.diag(K)) + 1e-3)  # 1e-3 N m/rad: less than the loads, more than rounding
    falling = (np.linalg.eigvalsh((K + K.T) / 2 * np.outer(size, size)) < -1e-9).sum()
    found = modes(chain, q)
    assert np.isnan(found.frequencies).sum() == falling
    assert found.stable == (falling == 0)


def test_mode_shape_paths_are_the_displacements_of_the_points():
    chain = fl.lump(nasty_scene())
    q = np.linspace(-1, 1, chain.n)
    found = modes(chain, q)
    h = 1e-6
    shape = found.shapes[2].real
    moved = (tip_position(chain, q + h * shape) - tip_position(chain, q - h * shape)) / (2 * h)
    assert found.paths[2, -1].real == pytest.approx(moved, abs=1e-8)
    assert found.points[-1] == pytest.approx(tip_position(chain, q))
    assert np.abs(found.shapes).max(axis=1) == pytest.approx(np.ones(len(found.shapes)))


def test_locked_coordinates_do_not_move():
    chain = fl.lump(nasty_scene())
    found = modes(chain, locked=chain.active)
    assert (found.shapes[:, chain.active] == 0).all()
    assert found.shapes.any(axis=1).all()


@pytest.mark.parametrize(
    "locked",
    [["upper", "fore.1.z"], np.array(["upper", "fore.1.z"]), ("upper", 6), np.array([0, 6]), [6, 0, 6],
     np.isin(np.arange(9), [0, 6]), [k in {0, 6} for k in range(9)], ("fore.1.z", "upper", "waist")],
    ids=["names", "array of names", "both", "array", "list", "mask", "list of bools", "a link locked in the scene"],
)  # fmt: skip
@pytest.mark.parametrize("function", [modes, natural_frequencies, fl.solve_static, fl.strength.buckling_loads])
def test_locked_coordinates_are_given_by_name_index_or_mask(function, locked):
    waist = Link(name="waist", joint=Joint(locked=True))
    chain = fl.lump(make_scene(waist, flexible("upper"), flexible("fore", segments=4), gravity=(-9.81, 0.0, 0.0)))
    assert [chain.joint_name(k) for k in (0, 6)] == ["upper", "fore.1.z"]
    found, expected = function(chain, locked=locked), function(chain, locked=[0, 6])
    if function is modes:
        found, expected = found.shapes, expected.shapes
        assert (found[:, [0, 6]] == 0).all()
    elif function is fl.solve_static:
        found, expected = found.q, expected.q
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("locked", "id"),
    [
        ([99], "unknown-joint"),
        ([-1], "unknown-joint"),
        ([1.0], "unknown-joint"),
        ([True, 3], "unknown-joint"),
        (None, "unknown-joint"),
        (list(range(10)), "nothing-to-move"),
        ([True] * 10, "nothing-to-move"),
        ([True, False], "wrong-shape"),
        ("lnk", "unknown-joint"),
        (["link.11.z"], "unknown-joint"),
    ],
)
@pytest.mark.parametrize("function", [modes, fl.solve_static, fl.strength.buckling_loads])
def test_bad_locks_are_named(function, locked, id):
    with refused(ArgumentError, id) as caught:
        function(cantilever("gauss", 10), locked=locked)
    assert str(caught.value).startswith("locked")


def test_a_prescribed_joint_is_excluded_from_modes_and_stable_steps():
    link = flexible("a", segments=5)
    held = fl.PrescribedMotion(link="a", times=[0.0], angle_deg=[0.0], rate_deg=[0.0], acceleration_deg=[0.0])
    prescribed = fl.lump(make_scene(link, motion=(held,)))
    locked = fl.lump(make_scene(msgspec.structs.replace(link, joint=fl.Joint(locked=True))))
    np.testing.assert_allclose(fl.natural_frequencies(prescribed), fl.natural_frequencies(locked), rtol=1e-12)
    assert fl.stable_step(prescribed) == pytest.approx(fl.stable_step(locked), rel=1e-9, abs=0)
    rigid = fl.lump(make_scene(fl.Link(name="a", length=1.0, material="aluminium", section="square"), motion=(held,)))
    assert fl.stable_step(rigid) == np.inf


def test_twist_frequency_is_independent_of_rod_thickness() -> None:
    """GJ and the inertia about the axis are both proportional to thickness⁴; tilted axes have no effect."""

    def fastest(thickness: float) -> np.ndarray:
        link = flexible("rod", "xyz", 4, mount=fl.Mount(rpy_deg=(-70.0, 15.0, 20.0)), joint=fl.Joint(locked=True))
        scene = make_scene(link, gravity=(0.0, 0.0, 0.0)).varied(
            {"section.square.height": thickness, "section.square.width": thickness}
        )
        chain = fl.lump(scene)
        return fl.natural_frequencies(chain, np.zeros(chain.n))[-3:]

    np.testing.assert_allclose(fastest(1e-5), fastest(1e-3), rtol=1e-12)


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


def test_slowly_growing_flutter_is_unstable() -> None:
    """Beck's column just below and above its flutter load: 20.05 EI/L², but 3 % less with 12 hinges."""
    chain = cantilever("legendre", 12)
    below, above = (fl.modes(chain, tip_wrench=[-20.05 * part, 0, 0, 0, 0, 0], frame="tip") for part in (0.93, 0.98))
    assert below.stable
    assert not above.stable
    assert above.damping_ratios.min() > -0.1


def test_damped_modes_are_sorted_slowest_first() -> None:
    """Overdamped modes are included: both real eigenvalues of a pair are sorted by rate."""
    damping = fl.Damping(ratio=0.3, at_hz=10.0)
    chain = fl.lump(make_scene(flexible("a", "xyz", 5, damping=damping, joint=fl.Joint(locked=True))))
    λ = fl.modes(chain, np.zeros(chain.n)).eigenvalues
    assert (λ.imag == 0).any()
    assert (λ.imag > 0).any()
    assert (np.diff(np.abs(λ)) >= 0).all()


def test_coaxial_joints_are_singular_even_if_rounding_hides_it(rng: np.random.Generator) -> None:
    skew = fl.Mount(rpy_deg=(-75.0, 20.0, 30.0))
    links = fl.Link(name="a", mount=skew), fl.Link(name="b", length=0.7, joint=fl.Joint(viscous=1.0))
    chain = fl.lump(make_scene(*links, tip=fl.RigidBody(mass=1.3, inertia=(0.1, 0.2, 0.3))))
    for q in rng.uniform(-np.pi, np.pi, (50, 2)):
        with refused(fl.errors.SingularMassError, "joint-without-inertia"):
            fl.modes(chain, q)
