"""Rounding bounds: large enough for all correct programs, and not much larger."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from flexlink import Chain, Joint, Link, Mount, RigidBody, bias_torque, load_scene, lump, mass_matrix
from flexlink.diagnosis.quantities import QUANTITIES, Difference, compare_engines, mixed_states
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import EPS
from flexlink.engines import load
from tests.conftest import MODELS, flexible, make_scene

M, L, G = 3.0, 2.0, 9.81
Q, QD, TAU, WRENCH = np.array([0.3]), np.array([-1.5]), np.array([4.0]), np.array([3.0, 0.0, -4.0, 0.0, 6.0, 8.0])


def pendulum(**joint: float) -> Chain:
    """A mass of 3 kg on a massless rod of 2 m."""
    return lump(
        make_scene(Link(name="rod", length=L, joint=Joint(**joint)), tip=RigidBody(mass=M), gravity=(0.0, -G, 0.0))
    )


def near(value: object) -> object:
    """Approximate value with a tolerance of a few eps; abs=0, because pytest's default 1e-12 exceeds some values."""
    return pytest.approx(value, rel=1e-12, abs=0)


def test_the_bound_of_a_pendulum_is_ten_eps_times_each_term() -> None:
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


def test_the_bound_of_a_spring_torque_scales_with_that_torque() -> None:
    chain = lump(make_scene(flexible("arm", "z", 3)))
    q = np.array([1.0, 1e-9, 0.5])
    explained = rounding.of_elastic_torque(chain, q)
    assert explained == near(10 * EPS * chain.stiffness * q)
    assert explained[0] == 0 < explained[1] < 1e-8 * explained[2]


def test_the_bound_grows_with_the_root_of_the_number_of_hinges() -> None:
    """A bar is divided into more segments, while M* and T_G* stay nearly the same."""
    few, many = (lump(make_scene(flexible("arm", "z", segments))) for segments in (4, 64))
    zero = [np.zeros(chain.n) for chain in (few, many)]
    ratio = rounding.of_mass_matrix(many, zero[1]) / rounding.of_mass_matrix(few, zero[0])
    assert ratio == pytest.approx(4.0, rel=0.02)


def mast() -> Chain:
    """A tilted post along its joint axis, which has no gravity torque except by rounding, and hardly any inertia."""
    post = Link(name="post", length=2.0, material="aluminium", section="square", joint=Joint(locked=True),
                mount=Mount(rpy_deg=(0.0, -90.0, 0.0)))  # fmt: skip
    return lump(make_scene(Link(name="mast", mount=Mount(rpy_deg=(33.0, 47.0, 21.0))), post))


def far_away() -> Chain:
    """An arm 1 km from the origin of frame 0, so the coordinates of its points lose three digits."""
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
def test_correct_engines_stay_within_the_bound_under_heavy_cancellation(arm) -> None:
    assert [row for row in rows_of(arm()) if not row.passed] == []


def test_only_sums_of_absolute_values_bound_the_rounding_of_a_mast() -> None:
    """Usual measures, M and the largest torque under gravity along x, y or z, do not bound this rounding error."""
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
def test_the_bound_is_within_a_factor_of_100_of_actual_errors() -> None:
    """The largest errors of correct engines are at least 1 % of the bound, so the bound is not too wide."""
    found: dict[str, float] = {}
    for path in MODELS:
        for row in rows_of(lump(load_scene(path))):
            found[row.quantity] = max(found.get(row.quantity, 0.0), row.error)
    assert all(found[name] > 0.01 for name in QUANTITIES if name not in ("T_FL", "T_FR")), found
    assert found["T_FL"] == found["T_FR"] == 0  # every engine does the same few operations


def test_an_error_that_is_not_finite_exceeds_every_bound() -> None:
    chain = pendulum()
    for bad in (np.inf, np.nan):
        error = rounding.acceleration_error(chain, Q, QD, TAU, solutions=(np.array([bad]), QD))
        assert not (error <= 1).any()
    assert_array_equal(rounding.in_units(np.array([0.0, 1.0, np.nan]), 0.0), [0.0, np.inf, np.nan])


def two_rods() -> Chain:
    """A mass of 3 kg at the end of two massless rods of 1 m."""
    rods = (Link(name=name, length=1.0) for name in "ab")
    return lump(make_scene(*rods, tip=RigidBody(mass=M), gravity=(0.0, -G, 0.0)))


def test_largest_loads_assume_a_stretched_arm_with_joint_rates_added() -> None:
    """By hand: 3 kg at 2 m and 1 m from the joints, |rates| add up to 2 + 1 rad/s, and m g is added to m Ω² r."""
    still, none = np.zeros(2), np.zeros(6)
    assert rounding.largest_loads(two_rods(), still, none) == near([M * G * 2.0, M * G])
    turning = M * (G + 3.0**2 * 2.0)
    assert rounding.largest_loads(two_rods(), np.array([2.0, -1.0]), none) == near([turning * 2.0, turning])


def test_a_tip_force_loads_hinges_by_its_lever_arm_and_a_moment_loads_all() -> None:
    light = dataclasses.replace(two_rods(), gravity=np.zeros(3))
    still, moment, force = (
        np.zeros(2),
        np.array([0.0, 0.0, 0.0, 0.0, 6.0, 8.0]),
        np.array([3.0, 4.0, 0.0, 0.0, 0.0, 0.0]),
    )
    assert rounding.largest_loads(light, still, moment) == near([10.0, 10.0])
    assert rounding.largest_loads(light, still, force + moment) == near([20.0, 15.0])


def test_the_bound_of_an_energy_balance_is_a_few_ulp() -> None:
    """For 1 + 2 + 3 + 4 J, and for m g L = 58.86 J at an angle below 1 rad, the bound is one to ten eps."""
    energy, work = np.array([[1.0], [-2.0], [3.0]]), np.array([-4.0])
    explained = rounding.of_energy_balance(pendulum(), energy, work, np.array([[0.5]]))
    assert (explained >= EPS * (10.0 + M * G * L)).all()
    assert (explained <= 10 * EPS * (10.0 + M * G * L)).all()
