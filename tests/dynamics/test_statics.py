"""Static equilibria agree with exact discrete chains, the elastica, buckling loads and the Princeton beam."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg, optimize

import flexlink as fl
from flexlink import (
    Arm,
    Joint,
    Link,
    Material,
    Section,
    bias_torque,
    elastic_torque,
    forward_dynamics,
    lump,
    mass_matrix,
    solve_static,
    tip_position,
)
from flexlink.dynamics import equilibrium as module
from flexlink.dynamics import rounding
from flexlink.dynamics.equilibrium import static_postures
from flexlink.dynamics.load_path import LARGEST_ARC
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.errors import ArgumentError, ConvergenceError
from flexlink.strength import buckling_loads
from tests.chain.test_cells import CHAINS, SPRUNG
from tests.conftest import chain_of, flexible, make_scene, nasty_scene
from tests.support.beams import branching, cantilever, thin_arm, thin_link
from tests.support.words import refused
from validation.oracles import hencky
from validation.physics.hinge_sweep import order
from validation.reference_values import look_up

# --- three dimensions ------------------------------------------------------------------------------------------------


def test_equilibrium_under_a_follower_force_matches_shooting():
    chain = cantilever("midpoint", 20)
    dead, follower = (solve_static(chain, tip_wrench=[0, 2.0, 0, 0, 0, 0], frame=f).q for f in ("world", "tip"))
    slope = optimize.brentq(lambda end: _follower_shooting(end, 2.0), 0.0, 3.0)
    assert follower.sum() == pytest.approx(slope, abs=2e-3)
    assert follower.sum() > dead.sum() + 0.05


def _follower_shooting(end, force, steps=400):
    """Integrate θ'' = −F cos(θ − θ_end), θ'(1) = 0, backward from a guessed end slope; return θ(0), which must be 0."""
    θ, κ, h = end, 0.0, -1 / steps
    for _ in range(steps):  # Störmer-Verlet
        κ -= h / 2 * force * np.cos(θ - end)
        θ += h * κ
        κ -= h / 2 * force * np.cos(θ - end)
    return θ


# --- paths, stability ------------------------------------------------------------------------------------------------


def test_the_load_path_turns_back_where_the_column_snaps_through():
    """A column buckled to the left is pushed right by slightly more than the left equilibrium can carry."""
    chain = cantilever("midpoint", 8)
    leaning = solve_static(chain, tip_wrench=[-3.0, 0.5, 0, 0, 0, 0])
    left = solve_static(chain, leaning.q, tip_wrench=[-3.0, 0, 0, 0, 0, 0])
    assert left.stable
    assert tip_position(chain, left.q)[1] > 0.5
    right = solve_static(chain, left.q, tip_wrench=[-3.0, -0.25, 0, 0, 0, 0])
    assert right.stable
    assert tip_position(chain, right.q)[1] < -0.5
    assert (np.diff(right.path[:, 0]) < 0).any()


def test_a_load_step_that_would_jump_to_another_branch_is_reduced():
    """On the other branch the path would never reach the full load."""
    chain, wrench = cantilever("midpoint", 7), [-15.078, -56.753, 0, 0, 0, 10.457]
    found = solve_static(chain, tip_wrench=wrench)
    assert found.residual < 1e-9
    assert np.linalg.norm(np.diff(found.path, axis=0), axis=1).max() <= 2 * LARGEST_ARC


@pytest.mark.parametrize("hinges", [2, 4, 8])
def test_a_soft_cantilever_hangs_along_its_load_for_any_load(hinges):
    """A former error: above 40 EI/L², a step turned a hinge by a full revolution, and the load went to −∞."""
    chain, slope = cantilever("gauss", hinges), 0.0
    for force in (20.0, 40.0, 80.0, 160.0, 500.0):
        hanging = solve_static(chain, tip_wrench=[0, force, 0, 0, 0, 0])
        assert hanging.stable
        assert hanging.residual < 1e-9 * force
        assert (hanging.q > 0).all()
        assert slope < hanging.q.sum() < np.pi / 2 + 1e-12
        slope = hanging.q.sum()


@pytest.mark.parametrize(("push", "aside"), [(8.0, 0.02), (8.0, 0.2), (12.0, 0.3), (30.0, 0.3)])
def test_a_column_far_beyond_its_buckling_load_bends_to_the_pushed_side(push, aside):
    """A former error: the result was on the unstable branch, nearly straight and bent against the push."""
    found = solve_static(cantilever("midpoint", 7), tip_wrench=[-push, aside, 0, 0, 0, 0])
    assert found.stable
    assert found.residual < 1e-9
    assert np.pi / 2 < found.q.sum() < np.pi


def test_a_load_beyond_a_limit_point_without_an_equilibrium_is_refused():
    """A rigid bar under a motor torque that exceeds its largest gravity torque has no equilibrium."""
    arm = Arm(
        links=(Link(name="bar", length=1.0, material="m", section="s"),),
        materials={"m": Material(young=1.0, density=1.0)},
        sections={"s": Section(shape="general", area=1.0, i_y=1e-6, i_z=1e-6, torsion=1e-6)},
    )
    chain = chain_of(arm, (10.0, 0.0, 0.0))  # hangs along X; holding torque 5 sin q
    assert solve_static(chain, tau=[4.0]).q == pytest.approx([np.arcsin(0.8)], abs=1e-12)
    with refused(ConvergenceError, "no-equilibrium") as caught:
        solve_static(chain, tau=[6.0])
    assert caught.value.load == pytest.approx(5 / 6, abs=0.05)  # largest holding torque, 5 N m, over the motor's 6 N m
    assert np.sin(caught.value.q) == pytest.approx([1.0], abs=0.05)


def test_free_joints_find_their_equilibrium_and_locked_ones_stay():
    chain = lump(nasty_scene())
    locked = [int(k) for k in chain.active]
    q0 = np.zeros(chain.n)
    q0[locked] = 0.3
    held = solve_static(chain, q0, locked=locked)
    assert held.q[locked] == pytest.approx(np.full(len(locked), 0.3), abs=0)
    tau = np.zeros(chain.n)
    tau[locked] = (bias_torque(chain, held.q, np.zeros(chain.n)))[locked]
    assert forward_dynamics(chain, held.q, np.zeros(chain.n), tau) == pytest.approx(np.zeros(chain.n), abs=1e-6)
    again = solve_static(chain, q0, tau=tau)  # the drive applies the holding torque of the locked joints
    assert again.residual < 1e-8
    assert again.q == pytest.approx(held.q, abs=1e-8)


def test_an_unloaded_free_joint_stays_and_a_torque_on_it_has_no_equilibrium():
    weightless = thin_arm(thin_link("midpoint", 4, free=True))
    assert solve_static(weightless, [0.4, 0, 0, 0.1, 0]).q == pytest.approx([0.4, 0, 0, 0, 0], abs=1e-14)
    with pytest.raises(ConvergenceError):
        solve_static(weightless, tau=[1.0, 0, 0, 0, 0])


def test_steady_spin_bends_a_leaning_beam_outward():
    """With constant rates the arm is in relative equilibrium, r(q, q̇) = 0."""
    chain = thin_arm(thin_link("midpoint", 6, flex="yz", free=True), gravity=(0.0, 0.0, 2.0))
    rates = np.zeros(chain.n)
    rates[0] = 3.0
    sag = [abs(tip_position(chain, solve_static(chain, qd=s * rates, locked=[0]).q)[2]) for s in (0, 1)]
    assert 0.3 * sag[0] < sag[1] < 0.8 * sag[0]


def test_a_wrong_argument_is_named():
    with refused(ArgumentError, "wrong-shape"):
        solve_static(cantilever("midpoint", 3), tip_wrench=[1, 2, 3])


# --- buckling --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 4, 5, 8, 10, 20])
def test_finite_columns_buckle_at_henckys_loads(n):
    for rule in ("midpoint", "hencky", "paper"):
        column = cantilever(rule, n - 1 if rule == "paper" else n)
        found = buckling_loads(column, tip_wrench=[-1.0, 0, 0, 0, 0, 0])
        assert found == pytest.approx(hencky.buckling(rule, n), rel=1e-10)


def test_a_deep_beam_buckles_laterally_at_the_published_load():
    exact = float(look_up("critical_loads")["lateral_tipload_PL2/sqrt(EI_min*GJ)"])

    def error(hinges):
        arm = Arm(
            links=(
                Link(
                    name="beam", length=1.0, flex="xyz", material="m", section="deep", segments=hinges + 1,
                    lumping="legendre", joint=Joint(locked=True),
                ),
            ),
            materials={"m": Material(young=1.0, poisson=0.0, density=1.0)},
            sections={"deep": Section(shape="general", area=1.0, i_y=1.0, i_z=1e8, torsion=2.0)},
        )  # fmt: skip
        return buckling_loads(chain_of(arm, (0.0, 0.0, 0.0)), tip_wrench=[0, 1, 0, 0, 0, 0])[0] / exact - 1

    errors = {n: error(n) for n in (12, 16, 32)}
    assert abs(errors[32]) < 3e-3
    assert order(errors) == pytest.approx(2, abs=0.2)


@pytest.mark.parametrize("rule", ["gauss", "lobatto2", "lobatto4"])
def test_a_column_is_stable_only_below_its_buckling_load(rule: str) -> None:
    """The buckling factor agrees with the dense eigenproblem, and static stability is lost at this factor."""
    column, push = cantilever(rule, 8), np.array([-1.0, 0, 0, 0, 0, 0])
    factor = buckling_loads(column, tip_wrench=push)[0]
    K = column.matrix("stiffness")
    softening = K - stiffness_matrix(column, column.rest, np.zeros(column.n), push)
    assert factor == pytest.approx(1 / linalg.eigh(softening, K, eigvals_only=True)[-1], rel=1e-12)
    for part, stable in ((0.999999, True), (1.000001, False)):
        rest = solve_static(column, tip_wrench=part * factor * push)
        assert not rest.q.any(), "a straight column under a load along it stays straight"
        assert rest.stable == stable


@pytest.mark.parametrize(("held", "exact"), [(False, np.pi**2), (True, 20.190728556426629)])  # tan x = x, x²
def test_a_column_on_a_slider_buckles_at_eulers_loads(held: bool, exact: float) -> None:
    """Pinned or clamped at its root; a tie guides its end along the load."""
    guide = {"name": "guide", "kind": "slider", "link": "a", "to": {"point": [0, 0, 0], "axis": [1, 0, 0]}}
    errors, push = {}, [-1.0, 0, 0, 0, 0, 0]
    for n in (8, 16, 32):
        scene = make_scene(flexible("a", segments=n + 1, lumping="gauss"), gravity=(0.0, 0.0, 0.0))
        tied = scene.varied({"tie": [guide], "run": {"method": "auto"}})
        found = buckling_loads(lump(scene), tip_wrench=push, locked=["a"] if held else (), ties=tied)
        errors[n] = found[0] * 1.25**2 / (scene.arm.bending_stiffness(scene.arm.links[0])[1] * exact) - 1
    assert order(errors) == pytest.approx(2, abs=0.2)


def test_joints_without_a_spring_are_excluded_from_buckling():
    chain = lump(make_scene(flexible("a"), flexible("b"), gravity=(-9.81, 0.0, 0.0)))
    free, held = buckling_loads(chain), buckling_loads(chain, locked=chain.active.tolist())
    np.testing.assert_array_equal(free, held)
    assert (np.diff(free) > 0).all()
    assert len(free) <= 8


def test_a_load_that_stiffens_the_chain_has_no_buckling_load():
    assert len(buckling_loads(lump(make_scene(flexible("a"), gravity=(9.81, 0.0, 0.0))))) == 0


# --- the path itself -------------------------------------------------------------------------------------------------


def test_without_a_load_the_path_to_the_rest_angles_is_straight():
    """F = k (q − θ₀) − (1 − s) k (q₀ − θ₀) = 0 is a straight path from any posture to the rest angles."""
    chain = cantilever("midpoint", 4)
    hinges = chain.hinges.copy()
    hinges["rest"] = rest = np.array([0.1, -0.2, 0.3, 0.2])
    q0 = np.array([0.5, 0.4, -0.3, 0.2])
    path = solve_static(dataclasses.replace(chain, hinges=hinges), q0).path
    s = path[:, :1]
    assert len(path) > 2
    np.testing.assert_allclose(path[:, 1:], rest + (1 - s) * (q0 - rest), rtol=0, atol=1e-14)


def test_the_residual_is_the_torque_that_remains_at_the_end_of_the_path():
    """With a coarse tolerance the residual is larger than rounding."""
    chain, wrench = cantilever("midpoint", 8), [0, 5.0, 0, 0, 0, 0]
    found = solve_static(chain, tip_wrench=wrench, tolerance=0.1)
    left = np.abs(
        bias_torque(chain, found.q, np.zeros(chain.n), tip_wrench=wrench) + elastic_torque(chain, found.q)
    ).max()
    assert left > 1e-9
    assert found.residual == pytest.approx(left, rel=1e-6, abs=0)


def test_an_equilibrium_contains_its_holding_torque() -> None:
    """q̈ = 0 with T_EX = T_GC + T_FL at locked hinges, one of which is bent, and with the given torque elsewhere."""
    chain = lump(make_scene(flexible("a", "yz"), flexible("b", "yz"), gravity=(1.0, 9.81, 2.0)))
    wrench, given = np.arange(6.0), np.zeros(chain.n)
    given[chain.n - 1] = 0.5
    held = [0, 1, int(chain.active[1])]
    start = np.full(chain.n, 0.02)
    rest = solve_static(chain, start, tau=given, tip_wrench=wrench, locked=held)
    assert rest.tau[chain.n - 1] == 0.5 and rest.tau[held].all()
    zero = np.zeros(chain.n)
    qdd = forward_dynamics(chain, rest.q, zero, rest.tau, tip_wrench=wrench)
    limit = rounding.of_acceleration(chain, rest.q, zero, zero, rest.tau, tip_wrench=wrench)
    left = rest.residual / np.linalg.norm(mass_matrix(chain, rest.q), -2)
    assert np.abs(qdd).max() <= limit + np.sqrt(chain.n) * left


def one_by_one(chain: fl.Chain, angles: np.ndarray) -> np.ndarray:
    q, held = np.zeros(chain.n), chain.active
    found = []
    for row in angles:
        q = q.copy()
        q[held] = row
        q = fl.solve_static(chain, q, locked=held.tolist()).q
        found.append(q)
    return np.array(found)


def way(start: object, end: object, rows: int) -> np.ndarray:
    return np.linspace(np.radians(start), np.radians(end), rows)


GEARED = make_scene(
    flexible("a", "xyz", 3, joint=fl.Joint(gear_stiffness=2e3, armature=0.5)), flexible("b", "yz", 3),
    gravity=(0.0, 5.0, 9.81), tip=fl.RigidBody(mass=1.0),
)  # fmt: skip
TURNED = make_scene(
    flexible("a", "xyz", lumping="lobatto2_rotation"), gravity=(0.0, 5.0, 9.81), tip=fl.RigidBody(mass=5.0)
)
PLANE = make_scene(flexible("a"), gravity=(0.0, 9.81, 0.0))
ARMS = {"geared": GEARED, "nasty": nasty_scene(), "plane": PLANE, "turned": TURNED, "branching": branching()}


@pytest.mark.parametrize("name", [*ARMS, *SPRUNG])
def test_equilibria_of_a_sequence_equal_those_found_one_by_one(name: str, tmp_path: Path) -> None:
    """Rest angles of coupled springs are not zero."""
    chain = fl.lump(ARMS[name]) if name in ARMS else CHAINS[name](tmp_path)
    hinges, d = chain.hinges.copy(), len(chain.active)
    if name in SPRUNG:
        hinges["rest"][chain.bending] = np.linspace(-0.02, 0.03, len(chain.bending))
        chain = dataclasses.replace(chain, hinges=hinges)
    angles = np.concatenate([way([0.0] * d, [40.0] * d, 12), way([40.0] * d, [40.0] * d, 2)])
    wanted = one_by_one(chain, angles)
    np.testing.assert_allclose(static_postures(chain, angles), wanted, rtol=0, atol=1e-14)
    held = fl.gravity_torque(chain, static_postures(chain, angles))
    np.testing.assert_allclose(held, fl.gravity_torque(chain, wanted), rtol=1e-12, atol=1e-12)


def test_after_a_jump_of_the_joints_the_load_is_applied_in_steps(monkeypatch) -> None:
    """A soft column jumps from hanging to upright: the nearest root is not the wanted equilibrium."""
    soft = make_scene(flexible("a", segments=7), gravity=(9.81, 0.0, 0.0), tip=fl.RigidBody(mass=20.0))
    chain = fl.lump(soft.varied({"material.aluminium.young": 3e8}))
    angles = np.radians([[0.0], [1.0], [100.0], [101.0], [179.0]])
    evaluated: list[float] = []
    solved = module.static_posture

    def counted(chain: fl.Chain, q: np.ndarray, *more: object) -> np.ndarray:
        evaluated.append(float(np.degrees(q[0])))
        return solved(chain, q, *more)

    monkeypatch.setattr(module, "static_posture", counted)
    np.testing.assert_allclose(static_postures(chain, angles), one_by_one(chain, angles), rtol=0, atol=1e-13)
    assert evaluated[0] == 0.0
    assert 100.0 in np.round(evaluated, 9)
    assert len(evaluated) < len(angles)


def test_a_column_that_buckles_in_a_sequence_does_not_stay_upright() -> None:
    """Beyond the buckling load the upright posture is not the wanted equilibrium; the result equals separate calls."""
    soft = make_scene(flexible("a", segments=5), gravity=(-9.81, 0.0, 0.0), tip=fl.RigidBody(mass=20.0))
    chain = fl.lump(soft.varied({"material.aluminium.young": 2e8}))
    angles = way([60.0], [0.0], 7)
    np.testing.assert_allclose(static_postures(chain, angles), one_by_one(chain, angles), rtol=0, atol=1e-12)
