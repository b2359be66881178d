"""Rounding bounds: large enough for all correct programs, and not much larger."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from conftest import MODELS, flexible, make_scene
from numpy.testing import assert_array_equal

from flexlink import Chain, Joint, Link, Mount, RigidBody, bias_torque, load_scene, lump, mass_matrix
from flexlink.diagnosis.quantities import QUANTITIES, Difference, compare_engines
from flexlink.diagnosis.states import mixed_states
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import EPS
from flexlink.engines import load

M, L, G = 3.0, 2.0, 9.81
Q, QD, TAU, WRENCH = np.array([0.3]), np.array([-1.5]), np.array([4.0]), np.array([3.0, 0.0, -4.0, 0.0, 6.0, 8.0])


def pendulum(**joint: float) -> Chain:
    """A mass of 3 kg on a massless rod of 2 m."""
    return lump(
        make_scene(Link(name="rod", length=L, joint=Joint(**joint)), tip=RigidBody(mass=M), gravity=(0.0, -G, 0.0))
    )


def near(value: object) -> object:
    """Equal up to a few roundings; abs=0, because the default of pytest, 1e-12, exceeds the values compared here."""
    return pytest.approx(value, rel=1e-12, abs=0)


def test_of_a_pendulum_it_is_ten_roundings_of_each_part() -> None:
    """By hand: M* = m L² + armature, T_G* = m g L, T_W* = |f| L + |m|: absolute values, without cancellation."""
    chain = pendulum(viscous=0.2, armature=0.5)
    inertia, weight, load_ = M * L**2 + 0.5, M * G * L, 5.0 * L + 10.0
    assert rounding.of_mass_matrix(chain, Q) == near(10 * EPS * inertia)
    assert rounding.of_bias_torque(chain, Q, 0 * QD) == near(10 * EPS * weight)
    assert rounding.of_bias_torque(chain, Q, QD) == near(10 * EPS * (inertia * 1.5**2 + weight))
    parts = inertia * (7.0 + 1.5**2) + weight + load_ + 4.0
    assert rounding.of_bias_torque(chain, Q, QD, tip_wrench=WRENCH) == near(10 * EPS * (parts - inertia * 7.0 - 4.0))
    qdd = np.array([-7.0])
    assert rounding.of_residual(chain, Q, QD, qdd, TAU, tip_wrench=WRENCH) == near(10 * EPS * parts)
    assert rounding.of_acceleration(chain, Q, QD, qdd, TAU, tip_wrench=WRENCH) == near(10 * EPS * parts / inertia)
    assert rounding.of_friction_torque(chain, QD) == near([10 * EPS * 0.2 * 1.5])
    off = qdd + 2000 * rounding.of_acceleration(
        chain, Q, QD, qdd, TAU, tip_wrench=WRENCH
    )  # 2000: large enough that rounding of −7 itself does not matter
    assert rounding.acceleration_error(chain, Q, QD, TAU, solutions=(qdd, off), tip_wrench=WRENCH) == pytest.approx(
        [2000.0], rel=1e-3
    )


def test_the_torque_of_a_spring_is_judged_by_its_own_size() -> None:
    chain = lump(make_scene(flexible("arm", "z", 3)))
    q = np.array([1.0, 1e-9, 0.5])
    explained = rounding.of_elastic_torque(chain, q)
    assert explained == near(10 * EPS * chain.stiffness * q)
    assert explained[0] == 0 < explained[1] < 1e-8 * explained[2]


def test_it_grows_with_the_root_of_the_number_of_hinges() -> None:
    """A bar is divided into more and more segments; M* and T_G* stay nearly the same."""
    few, many = (lump(make_scene(flexible("arm", "z", segments))) for segments in (4, 64))
    zero = [np.zeros(chain.n) for chain in (few, many)]
    ratio = rounding.of_mass_matrix(many, zero[1]) / rounding.of_mass_matrix(few, zero[0])
    assert ratio == pytest.approx(4.0, rel=0.02)


def mast() -> Chain:
    """A tilted post along its joint axis: without rounding it has no gravity torque and hardly any inertia."""
    post = Link(name="post", length=2.0, material="aluminium", section="square", joint=Joint(locked=True),
                mount=Mount(rpy_deg=(0.0, -90.0, 0.0)))  # fmt: skip
    return lump(make_scene(Link(name="mast", mount=Mount(rpy_deg=(33.0, 47.0, 21.0))), post))


def far_away() -> Chain:
    """An arm a kilometre from the origin of frame 0: every point loses three digits to the distance."""
    base = Link(name="base", mount=Mount(xyz=(1000.0, 200.0, 300.0), rpy_deg=(33.0, 47.0, 21.0)))
    return lump(make_scene(base, flexible("arm", "yz", 4, mount=Mount(rpy_deg=(90.0, 0.0, 0.0)))))


def heavy() -> Chain:
    """Ten tons at the end of forty soft hinges."""
    return lump(make_scene(Link(name="waist", joint=Joint(armature=0.05)),
                      flexible("arm", "z", 41, mount=Mount(rpy_deg=(-90.0, 0.0, 0.0))),
                      tip=RigidBody(mass=1e4)))  # fmt: skip


def rows_of(chain: Chain, count: int = 48) -> tuple[Difference, ...]:
    others = [load(name, chain) for name in ("pinocchio", "mujoco")]
    return compare_engines(chain, load("native", chain), others, mixed_states(chain, count))


@pytest.mark.parametrize("arm", [mast, far_away, heavy])
def test_right_engines_stay_within_it_where_nearly_everything_cancels(arm) -> None:
    assert [row for row in rows_of(arm()) if not row.passed] == []


def test_the_rounding_of_a_mast_is_estimated_only_by_terms_that_cannot_cancel() -> None:
    """The usual measures fail: neither M nor the largest torque under gravity along x, y and z bounds the rounding."""
    chain = mast()
    other, zero = load("mujoco", chain), np.zeros(1)
    along = [dataclasses.replace(chain, gravity=9.81 * axis) for axis in np.eye(3)]
    differ = usual = 0.0
    for q, *_ in mixed_states(chain, 24):
        differ = max(differ, float(np.abs(other.gravity_torque(q) - bias_torque(chain, q, zero)).max()))
        usual = max(usual, *(float(np.abs(bias_torque(each, q, zero)).max()) for each in along))
        assert differ <= rounding.of_bias_torque(chain, q, zero)
        assert rounding.of_mass_matrix(chain, q) > 1000 * EPS * mass_matrix(chain, q).max()
    assert differ > 1000 * EPS * usual


@pytest.mark.slow
def test_it_is_not_far_above_what_engines_do() -> None:
    """The largest errors of correct engines are at least 1 % of the bound, so the bound is not too wide."""
    found: dict[str, float] = {}
    for path in MODELS:
        for row in rows_of(lump(load_scene(path))):
            found[row.quantity] = max(found.get(row.quantity, 0.0), row.error)
    assert all(found[name] > 0.01 for name in QUANTITIES if name not in ("T_FL", "T_FR")), found
    assert found["T_FL"] == found["T_FR"] == 0  # the same few operations in every engine


def test_what_is_not_finite_is_explained_by_nothing() -> None:
    chain = pendulum()
    for bad in (np.inf, np.nan):
        error = rounding.acceleration_error(chain, Q, QD, TAU, solutions=(np.array([bad]), QD))
        assert not (error <= 1).any()
    assert_array_equal(rounding.in_units(np.array([0.0, 1.0, np.nan]), 0.0), [0.0, np.inf, np.nan])


def two_rods() -> Chain:
    """A mass of 3 kg at the end of two massless rods of 1 m."""
    rods = (Link(name=name, length=1.0) for name in "ab")
    return lump(make_scene(*rods, tip=RigidBody(mass=M), gravity=(0.0, -G, 0.0)))


def test_the_largest_loads_are_those_of_a_stretched_arm_that_turns_as_fast_as_its_joints_together() -> None:
    """By hand: 3 kg at 2 m and 1 m from the joints, 2 + 1 rad/s for any signs, and m g in addition to m Ω² r."""
    still, none = np.zeros(2), np.zeros(6)
    assert rounding.largest_loads(two_rods(), still, none) == near([M * G * 2.0, M * G])
    turning = M * (G + 3.0**2 * 2.0)
    assert rounding.largest_loads(two_rods(), np.array([2.0, -1.0]), none) == near([turning * 2.0, turning])


def test_a_force_on_the_tip_loads_by_its_lever_and_a_moment_loads_all_hinges() -> None:
    light = dataclasses.replace(two_rods(), gravity=np.zeros(3))
    still, moment, force = (
        np.zeros(2),
        np.array([0.0, 0.0, 0.0, 0.0, 6.0, 8.0]),
        np.array([3.0, 4.0, 0.0, 0.0, 0.0, 0.0]),
    )
    assert rounding.largest_loads(light, still, moment) == near([10.0, 10.0])
    assert rounding.largest_loads(light, still, force + moment) == near([20.0, 15.0])


def test_rounding_leaves_an_energy_balance_a_few_units_in_the_last_place() -> None:
    """For 1 + 2 + 3 + 4 J, and for m g L = 58.86 J at an angle below 1 rad: between one and ten roundings."""
    energy, work = np.array([[1.0], [-2.0], [3.0]]), np.array([-4.0])
    explained = rounding.of_energy_balance(pendulum(), energy, work, np.array([[0.5]]))
    assert (explained >= EPS * (10.0 + M * G * L)).all()
    assert (explained <= 10 * EPS * (10.0 + M * G * L)).all()
