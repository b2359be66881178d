"""Derivatives of the dynamics, compared with 50-digit arithmetic and with each other, and edge cases."""

import numpy as np
import pytest
from mpmath import mp
from numpy.typing import NDArray

import flexlink as fl
from flexlink import Chain, Joint, Link, Mount, PrescribedMotion, RigidBody
from flexlink.dynamics.derivatives import derivatives_by
from flexlink.errors import ArgumentError, SingularMassError
from flexlink.kernels.derivatives.forward_derivatives import forward_derivatives_workspace
from flexlink.kernels.derivatives.planar_derivatives import planar_derivatives_workspace
from tests.conftest import flexible, make_scene, random_state
from tests.support.words import refused
from validation.oracles.spatial_chain import DIFFERENCES, SpatialChain, accelerations, derivatives, exactly
from validation.random_arms import random_arm, random_tree

Array = NDArray[np.float64]
CLOSE = 1e-12
"""Error limit of the project, relative to the largest element; rounding alone gives 1e-13 for arms of ten hinges."""


def bent_state(chain: Chain, rng: np.random.Generator) -> tuple[Array, Array]:
    """Random joint angles, hinge angles up to 30°, rates up to 10 rad/s."""
    q, qd = random_state(chain, rng)
    return np.where(np.isin(np.arange(chain.n), chain.active), q, q / 6), qd


def off(ours: Array, exact: Array) -> float:
    """Largest error relative to the largest element, or to 1 if the reference is zero (below 1e-30)."""
    largest = np.abs(exact).max()
    return float(np.abs(ours - exact).max() / (largest if largest > 1e-30 else 1.0))


def friction_derivative(chain: Chain, qd: Array) -> Array:
    """∂T_FR/∂q̇, shape (n,)."""
    joints = chain.hinges
    return joints["damping"] + joints["coulomb"] / joints["coulomb_width"] * (
        1 - np.tanh(qd / joints["coulomb_width"]) ** 2
    )


def worst_of_forward(chain: Chain, q: Array, qd: Array, tau: Array, wrench: Array) -> float:
    exact = derivatives(chain, q, qd, tau, wrench)
    found = fl.forward_dynamics_derivatives(chain, q, qd, tau, tip_wrench=wrench)
    return max(off(ours, theirs) for ours, theirs in zip((found.dq, found.dqd, found.dtau), exact, strict=True))


def worst_of_inverse(chain: Chain, q: Array, qd: Array, qdd: Array, wrench: Array) -> float:
    found = fl.inverse_dynamics_derivatives(chain, q, qd, qdd, tip_wrench=wrench)
    oracle = SpatialChain(chain)
    with mp.workdps(DIFFERENCES):
        exact = oracle.slopes(*(exactly(part) for part in (q, qd, qdd, wrench)))
        by_angle, by_rate = (np.array(part.tolist(), dtype=float) for part in exact)
        M = np.array(oracle.equations(exactly(q), exactly(qd))[0].tolist(), dtype=float)
    own = found.dq + np.diag(chain.stiffness), found.dqd + np.diag(friction_derivative(chain, qd)), found.dqdd
    return max(off(ours, theirs) for ours, theirs in zip(own, (by_angle, by_rate, M), strict=True))


SLOW = [(random_tree, seed) for seed in (35, 42, 48)]
LIGHT = [(random_arm, 221), (random_arm, 266), (random_tree, 384)]
SEEDS = [(random_arm, seed) for seed in (0, 5, 14, 27, 40)] + [(random_tree, seed) for seed in (2, 14, 23, 49, 57)]


@pytest.mark.parametrize(
    ("make", "seed"), [*SEEDS, *LIGHT, *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW)]
)
def test_derivatives_agree_with_50_digit_arithmetic(make, seed: int) -> None:
    """Arms and trees with every key of a link, on fixed and free bases; 300 others: `derivatives_50_digits`.

    Light segments have q̈ > 1e7 rad/s²; without body accelerations, their rounding would change ∂q̈/∂q by 5e-12.
    """
    chain, rng = fl.lump(make(seed)), np.random.default_rng(seed)
    q, qd = bent_state(chain, rng)
    (qdd, tau), wrench = rng.normal(size=(2, chain.n)), rng.normal(size=6)
    assert worst_of_inverse(chain, q, qd, qdd, wrench) <= CLOSE
    assert worst_of_forward(chain, q, qd, tau, wrench) <= CLOSE


def test_accelerations_of_a_small_rotor_at_an_elastic_gear_stay_accurate() -> None:
    """A relative rounding error of 1e-16 in the arm's inertia about the motor axis is 1e-8 of the rotor's inertia."""
    gear = Joint(armature=1e-8, gear_stiffness=100.0)
    links = Link(name="a"), Link(name="b", joint=gear, length=0.5, mount=Mount(rpy_deg=(40.0, 50.0, 60.0)))
    chain = fl.lump(make_scene(*links, tip=RigidBody(mass=3.0, inertia=(1.0, 1.0, 1.0)), gravity=(1.0, 2.0, 9.0)))
    q, qd, tau = np.array([0.3, 0.7, 0.02]), np.array([1.0, -2.0, 3.0]), np.array([0.1, 0.2, 0.0])
    (exact,) = accelerations(chain, (q, qd, tau))
    assert fl.forward_dynamics(chain, q, qd, tau) == pytest.approx(exact, rel=1e-14)


def test_planar_and_spatial_recursions_give_the_same_derivatives(rng: np.random.Generator) -> None:
    """The two recursions share nothing but the equation of motion."""
    motion = PrescribedMotion(
        link="b", times=(0.0, 1.0), angle_deg=(0.0, 9.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
    )
    links = (
        flexible("a"),
        flexible("b", joint=Joint(armature=0.1)),
        flexible("c", mount=Mount(rpy_deg=(180.0, 0.0, 0.0))),
    )
    for motions in ((), (motion,)):
        chain = fl.lump(make_scene(*links, gravity=(1.0, 9.81, 2.0), motion=motions))
        q, qd = bent_state(chain, rng)
        state = rng.normal(size=6), q, qd, rng.normal(size=chain.n)
        plane, space = np.empty((2, 3, chain.n, chain.n))
        assert chain.is_planar and derivatives_by(chain, planar_derivatives_workspace(chain.arrays))(*state, plane)
        assert derivatives_by(chain, forward_derivatives_workspace(chain.arrays))(*state, space)
        assert max(map(off, plane, space)) <= CLOSE


def test_derivatives_at_a_prescribed_joint_are_with_respect_to_its_acceleration(rng: np.random.Generator) -> None:
    links = Link(name="a", length=0.5, material="aluminium", section="square"), flexible("b", "yz", 3)
    motion = (
        PrescribedMotion(
            link="a", times=(0.0, 1.0), angle_deg=(0.0, 90.0), rate_deg=(0.0, 0.0), acceleration_deg=(0.0, 0.0)
        ),
    )
    given = fl.lump(make_scene(*links, motion=motion))
    free = fl.lump(make_scene(*links))
    q, qd = bent_state(given, rng)
    tau = rng.normal(size=given.n)
    found = fl.forward_dynamics_derivatives(given, q, qd, tau)
    M, others = fl.mass_matrix(free, q), np.arange(1, given.n)
    inverse = fl.inverse_dynamics_derivatives(free, q, qd, fl.forward_dynamics(given, q, qd, tau))
    block = M[1:, 1:]
    assert not found.dq[0].any() and not found.dqd[0].any() and found.dtau[0, 0] == 1 and not found.dtau[0, 1:].any()
    assert off(found.dtau[1:, 0], -np.linalg.solve(block, M[1:, 0])) <= 1e-10
    assert off(found.dtau[1:, 1:], np.linalg.inv(block)) <= 1e-10
    K = inverse.dq[1:] + np.diag(free.stiffness)[1:]
    assert off(found.dq[1:], -np.linalg.solve(block, K)) <= 1e-10
    assert others.size


def test_derivatives_that_do_not_exist_are_errors() -> None:
    chain = fl.lump(make_scene(flexible("a", "xyz", 2)))
    q = np.zeros(chain.n)
    with refused(ArgumentError, "wrong-shape"):
        fl.forward_dynamics_derivatives(chain, [0.0], q, q)
    with refused(ArgumentError, "overflow"):
        fl.inverse_dynamics_derivatives(chain, q, np.full(chain.n, 1e200), q)
    with refused(ArgumentError, "overflow"):
        fl.forward_dynamics_derivatives(chain, q, np.full(chain.n, 1e200), q)
    for name in ("q", "qd", "tau"):
        state = {"q": q, "qd": q, "tau": q, name: np.full(chain.n, np.inf)}
        with refused(ArgumentError, "not-finite"):
            fl.forward_dynamics_derivatives(chain, **state)
    with refused(ArgumentError, "out-of-range"):
        fl.jacobian(chain, q, body=3)
    massless = fl.lump(make_scene(Link(name="a"), Link(name="b", length=1.0), tip=RigidBody(mass=1.0)))
    with refused(SingularMassError, "joint-without-inertia"):
        fl.forward_dynamics_derivatives(massless, [0.0, 0.0], [0.0, 0.0], [0.0, 0.0])
