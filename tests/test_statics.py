"""Static equilibrium against exact discrete chains, the elastica, buckling loads and the Princeton beam."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from beams import cantilever, princeton_beam, thin_arm, thin_link
from conftest import chain_of, flexible, make_scene, nasty_scene
from scipy import optimize

from flexlink import (
    Arm,
    Joint,
    Link,
    Material,
    Section,
    bias_torque,
    buckling_loads,
    elastic_torque,
    forward_dynamics,
    lump,
    mass_matrix,
    solve_static,
    tip_position,
)
from flexlink.dynamics import rounding
from flexlink.dynamics.equilibrium import LARGEST_ARC
from flexlink.errors import ArgumentError, ConvergenceError
from validation.oracles import hencky
from validation.physics.hinge_sweep import order
from validation.reference_values import look_up

# --- the elastica ----------------------------------------------------------------------------------------------------

DISCRETE = {"paper": "paper", "midpoint": "midpoint", "nodal2k": "hencky"}


@pytest.mark.parametrize("alpha", ["1.0", "10"])
@pytest.mark.parametrize("name", DISCRETE)
@pytest.mark.parametrize("n", [5, 10, 20, 40])
def test_discrete_elastica_to_rounding(alpha, name, n):
    """Dead transverse tip force α EI/L²: deflection, shortening, slope and all joint angles of the finite chain."""
    exact = look_up("discrete_elastica")[f"alpha={alpha},rule={name}"][str(n)]
    chain = cantilever(DISCRETE[name], n - 1 if name == "paper" else n)
    q = solve_static(chain, tip_wrench=[0, float(alpha), 0, 0, 0, 0]).q
    x, y, _ = tip_position(chain, q)
    assert [y, 1 - x, q.sum()] == pytest.approx([float(exact[key]) for key in ("w/L", "u/L", "theta_tip")], abs=1e-10)
    if "joint_angles_rad" in exact:
        assert q == pytest.approx(np.array(exact["joint_angles_rad"], float), abs=1e-10)


def elastica_error(rule, hinges, alpha):
    exact = look_up("elastica_tip_load")[alpha]
    chain = cantilever(rule, hinges)
    x, y, _ = tip_position(chain, solve_static(chain, tip_wrench=[0, float(alpha), 0, 0, 0, 0]).q)
    w, u = float(exact["w/L (transverse tip deflection)"]), float(exact["u/L (tip shortening)"])
    return float(np.hypot(y - w, 1 - x - u))


@pytest.mark.parametrize("alpha", ["0.2", "1.0", "2.0", "5", "10"])
def test_ten_hinges_follow_the_elastica_within_two_thousandths_of_its_length(alpha):
    assert elastica_error("legendre", 10, alpha) < 2e-3  # measured 1.5e-3 at α = 10; paper 6.7e-2


@pytest.mark.parametrize("rule, expected", [("paper", 1), ("midpoint", 2), ("gauss", 2), ("legendre", 2)])
def test_order_of_large_deflection_is_two_at_best(rule, expected):
    """A rigid segment keeps its direction over its length: a midpoint rule for the arc, whatever the springs."""
    assert order({n: elastica_error(rule, n, "10") for n in (8, 16, 32)}) == pytest.approx(expected, abs=0.25)


@pytest.mark.parametrize("n", [4, 5, 8, 10, 16, 20])
@pytest.mark.parametrize("turns", [0.5, 1])
def test_an_end_moment_rolls_the_chain_into_a_polygon(n, turns):
    for rule, exact in look_up("rollup_end_moment")["discrete_closed_form"][f"n={n},ML/2piEI={turns}"].items():
        chain = cantilever(rule, n - 1 if rule == "paper" else n)
        q = solve_static(chain, tip_wrench=[0, 0, 0, 0, 0, 2 * np.pi * turns]).q
        x, y, _ = tip_position(chain, q)
        found, expected = [x, y, q.sum()], [float(exact[name]) for name in ("x/L", "y/L", "theta_tip")]
        assert found == pytest.approx(expected, abs=1e-12)


def test_two_turns_of_end_moment_close_twice():
    chain = cantilever("midpoint", 12)
    q = solve_static(chain, tip_wrench=[0, 0, 0, 0, 0, 4 * np.pi]).q
    assert q.sum() == pytest.approx(4 * np.pi, abs=1e-12)
    assert tip_position(chain, q) == pytest.approx([0, 0, 0], abs=1e-12)


# --- three dimensions ------------------------------------------------------------------------------------------------


def princeton_errors(rule, hinges):
    chain, errors = princeton_beam(rule, hinges), []
    for case in look_up("princeton_beam")["kirchhoff"].values():
        force, angle = case["force_N"], np.radians(case["beta_deg"])
        wrench = [0, -force * np.cos(angle), force * np.sin(angle), 0, 0, 0]
        u = tip_position(chain, solve_static(chain, tip_wrench=wrench).q) - [0.508, 0, 0]
        exact = np.array([case["ux"], case["uy(height dir)"], case["uz(flap dir)"]])
        errors.append(np.linalg.norm(u - exact) / np.linalg.norm(exact))
    assert len(errors) == 21
    return max(errors)


def test_princeton_beam_within_a_percent_in_all_21_cases():
    assert princeton_errors("gauss", 12) < 1e-2  # measured 6.1e-3; midpoint without alternating axes 1.9e-2
    assert princeton_errors("legendre", 6) < 1e-2  # measured 2.1e-3


@pytest.mark.slow
def test_a_fixed_order_of_axes_bends_and_twists_to_first_order_only():
    assert order({n: princeton_errors("midpoint", n) for n in (6, 12, 24)}) == pytest.approx(1, abs=0.2)


def test_tip_moment_in_space_is_reached_and_balanced():
    chain = princeton_beam("legendre", 6)
    found = solve_static(chain, tip_wrench=[1.0, 2.0, 3.0, 2.0, 0.5, -4.0])
    torque = bias_torque(chain, found.q, np.zeros(chain.n), tip_wrench=[1.0, 2.0, 3.0, 2.0, 0.5, -4.0])
    assert torque + elastic_torque(chain, found.q) == pytest.approx(np.zeros(chain.n), abs=1e-9)
    assert found.stable


def test_a_follower_force_turns_with_the_tip():
    chain = cantilever("midpoint", 20)
    dead, follower = (solve_static(chain, tip_wrench=[0, 2.0, 0, 0, 0, 0], frame=f).q for f in ("world", "tip"))
    slope = optimize.brentq(lambda end: _follower_shooting(end, 2.0), 0.0, 3.0)
    assert follower.sum() == pytest.approx(slope, abs=2e-3)
    assert follower.sum() > dead.sum() + 0.05


def _follower_shooting(end, force, steps=400):
    """θ'' = −F cos(θ − θ_end) along the beam, θ(0) = 0, θ'(1) = 0: backward from a guessed end slope; returns θ(0)."""
    θ, κ, h = end, 0.0, -1 / steps
    for _ in range(steps):  # Störmer-Verlet
        κ -= h / 2 * force * np.cos(θ - end)
        θ += h * κ
        κ -= h / 2 * force * np.cos(θ - end)
    return θ


# --- paths, stability ------------------------------------------------------------------------------------------------


def test_the_path_turns_back_where_the_column_snaps_over():
    """A buckled column leaning left, pushed right a little beyond what the left side can bear."""
    chain = cantilever("midpoint", 8)
    leaning = solve_static(chain, tip_wrench=[-3.0, 0.5, 0, 0, 0, 0])
    left = solve_static(chain, leaning.q, tip_wrench=[-3.0, 0, 0, 0, 0, 0])
    assert left.stable
    assert tip_position(chain, left.q)[1] > 0.5
    right = solve_static(chain, left.q, tip_wrench=[-3.0, -0.25, 0, 0, 0, 0])
    assert right.stable
    assert tip_position(chain, right.q)[1] < -0.5
    assert (np.diff(right.path[:, 0]) < 0).any()


def test_a_step_that_would_jump_to_another_branch_is_taken_smaller():
    """Followed there, the path would never reach the full load."""
    chain, wrench = cantilever("midpoint", 7), [-15.078, -56.753, 0, 0, 0, 10.457]
    found = solve_static(chain, tip_wrench=wrench)
    assert found.residual < 1e-9
    assert np.linalg.norm(np.diff(found.path, axis=0), axis=1).max() <= 2 * LARGEST_ARC


@pytest.mark.parametrize("hinges", [2, 4, 8])
def test_a_limp_cantilever_hangs_along_its_load_however_large_that_is(hinges):
    """The path was lost from 40 EI/L² on: a step ended where a hinge had turned round, and the load ran to −∞."""
    chain, slope = cantilever("gauss", hinges), 0.0
    for force in (20.0, 40.0, 80.0, 160.0, 500.0):
        hanging = solve_static(chain, tip_wrench=[0, force, 0, 0, 0, 0])
        assert hanging.stable
        assert hanging.residual < 1e-9 * force
        assert (hanging.q > 0).all()
        assert slope < hanging.q.sum() < np.pi / 2 + 1e-12
        slope = hanging.q.sum()


@pytest.mark.parametrize(("push", "aside"), [(8.0, 0.02), (8.0, 0.2), (12.0, 0.3), (30.0, 0.3)])
def test_a_column_far_beyond_its_buckling_load_bends_to_the_side_it_is_pushed_to(push, aside):
    """It was found straight, leaning against the push, on the unstable branch."""
    found = solve_static(cantilever("midpoint", 7), tip_wrench=[-push, aside, 0, 0, 0, 0])
    assert found.stable
    assert found.residual < 1e-9
    assert np.pi / 2 < found.q.sum() < np.pi


def test_load_beyond_a_limit_point_without_another_side_is_refused():
    """A rigid bar that a motor torque larger than its weight can hold nowhere."""
    arm = Arm(
        links=(Link(name="bar", length=1.0, material="m", section="s"),),
        materials={"m": Material(young=1.0, density=1.0)},
        sections={"s": Section(shape="general", area=1.0, i_y=1e-6, i_z=1e-6, torsion=1e-6)},
    )
    chain = chain_of(arm, (10.0, 0.0, 0.0))  # hangs along X; holding torque 5 sin q
    assert solve_static(chain, tau=[4.0]).q == pytest.approx([np.arcsin(0.8)], abs=1e-12)
    with pytest.raises(ConvergenceError, match="of the load") as caught:
        solve_static(chain, tau=[6.0])
    assert caught.value.load == pytest.approx(5 / 6, abs=0.05)  # the largest of 5 sin q over 6
    assert np.sin(caught.value.q) == pytest.approx([1.0], abs=0.05)


def test_free_joints_find_their_place_and_locked_ones_stay():
    chain = lump(nasty_scene())
    locked = [int(k) for k in chain.active]
    q0 = np.zeros(chain.n)
    q0[locked] = 0.3
    held = solve_static(chain, q0, locked=locked)
    assert held.q[locked] == pytest.approx(np.full(len(locked), 0.3), abs=0)
    tau = np.zeros(chain.n)
    tau[locked] = (bias_torque(chain, held.q, np.zeros(chain.n)))[locked]
    assert forward_dynamics(chain, held.q, np.zeros(chain.n), tau) == pytest.approx(np.zeros(chain.n), abs=1e-6)
    again = solve_static(chain, q0, tau=tau)  # the drive holds what the lock held
    assert again.residual < 1e-8
    assert again.q == pytest.approx(held.q, abs=1e-8)


def test_a_joint_that_nothing_holds_stays_unless_something_pushes_it():
    weightless = thin_arm(thin_link("midpoint", 4, free=True))
    assert solve_static(weightless, [0.4, 0, 0, 0.1, 0]).q == pytest.approx([0.4, 0, 0, 0, 0], abs=1e-14)
    with pytest.raises(ConvergenceError):
        solve_static(weightless, tau=[1.0, 0, 0, 0, 0])


def test_steady_spin_bends_a_leaning_beam_outward():
    """Rates are held: the relative equilibrium of a turning arm, r(q, q̇) = 0."""
    chain = thin_arm(thin_link("midpoint", 6, flex="yz", free=True), gravity=(0.0, 0.0, 2.0))
    rates = np.zeros(chain.n)
    rates[0] = 3.0
    sag = [abs(tip_position(chain, solve_static(chain, qd=s * rates, locked=[0]).q)[2]) for s in (0, 1)]
    assert 0.3 * sag[0] < sag[1] < 0.8 * sag[0]


def test_a_wrong_argument_is_named():
    with pytest.raises(ArgumentError, match="tip_wrench"):
        solve_static(cantilever("midpoint", 3), tip_wrench=[1, 2, 3])


# --- buckling --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 4, 5, 8, 10, 20])
def test_finite_columns_buckle_at_henckys_loads(n):
    for rule in ("midpoint", "hencky", "paper"):
        column = cantilever(rule, n - 1 if rule == "paper" else n)
        found = buckling_loads(column, tip_wrench=[-1.0, 0, 0, 0, 0, 0])
        assert found == pytest.approx(hencky.buckling(rule, n), rel=1e-10)


@pytest.mark.parametrize("rule", ["midpoint", "gauss", "legendre"])
def test_euler_and_greenhill_with_order_two(rule):
    values = look_up("critical_loads")
    euler, greenhill = float(values["euler_PL2/EI"]), float(values["greenhill_qL3/EI (q=weight per length)"])
    by_tip, by_weight = {}, {}
    for n in (8, 16, 32):
        by_tip[n] = buckling_loads(cantilever(rule, n), tip_wrench=[-1, 0, 0, 0, 0, 0])[0] / euler - 1
        by_weight[n] = buckling_loads(cantilever(rule, n, gravity=(-1.0, 0.0, 0.0)))[0] / greenhill - 1
    assert order(by_tip) == pytest.approx(2, abs=0.15)
    assert order(by_weight) == pytest.approx(2, abs=0.15)
    assert abs(by_tip[32]) < 1e-3
    assert abs(by_weight[32]) < 2e-3


def test_a_deep_beam_tips_over_sideways_at_the_published_load():
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


def test_the_tangent_loses_stability_at_the_buckling_load():
    chain = cantilever("gauss", 6)
    critical = buckling_loads(chain, tip_wrench=[-1, 0, 0, 0, 0, 0])[0]
    assert solve_static(chain, tip_wrench=[-0.999 * critical, 0, 0, 0, 0, 0]).stable
    assert not solve_static(chain, tip_wrench=[-1.001 * critical, 0, 0, 0, 0, 0]).stable


def test_joints_without_a_spring_take_no_part_in_buckling():
    chain = lump(make_scene(flexible("a"), flexible("b"), gravity=(-9.81, 0.0, 0.0)))
    free, held = buckling_loads(chain), buckling_loads(chain, locked=chain.active.tolist())
    np.testing.assert_array_equal(free, held)
    assert (np.diff(free) > 0).all()
    assert len(free) <= 8


def test_a_load_that_stiffens_buckles_nothing():
    assert len(buckling_loads(lump(make_scene(flexible("a"), gravity=(9.81, 0.0, 0.0))))) == 0


# --- the path itself -------------------------------------------------------------------------------------------------


def test_without_a_load_springs_let_go_in_proportion_from_any_posture_to_any_rest_angles():
    """F = k (q − θ₀) − (1 − s) k (q₀ − θ₀): the path is straight."""
    chain = cantilever("midpoint", 4)
    hinges = chain.hinges.copy()
    hinges["rest"] = rest = np.array([0.1, -0.2, 0.3, 0.2])
    q0 = np.array([0.5, 0.4, -0.3, 0.2])
    path = solve_static(dataclasses.replace(chain, hinges=hinges), q0).path
    s = path[:, :1]
    assert len(path) > 2
    np.testing.assert_allclose(path[:, 1:], rest + (1 - s) * (q0 - rest), rtol=0, atol=1e-14)


def test_the_residual_is_what_is_left_at_the_end_of_the_path():
    """A coarse tolerance leaves more than rounding."""
    chain, wrench = cantilever("midpoint", 8), [0, 5.0, 0, 0, 0, 0]
    found = solve_static(chain, tip_wrench=wrench, tolerance=0.1)
    left = np.abs(
        bias_torque(chain, found.q, np.zeros(chain.n), tip_wrench=wrench) + elastic_torque(chain, found.q)
    ).max()
    assert left > 1e-9
    assert found.residual == pytest.approx(left, rel=1e-6, abs=0)


def test_an_equilibrium_tells_the_torque_that_holds_it() -> None:
    """T_EX = T_GC + T_FL on what is held, a bent hinge too; what was given elsewhere: nothing accelerates."""
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
