"""Slopes of trees of arms that turn and slide, on fixed and free bases, are those of the equations by complex steps."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from trees import random_tree, slopes

import flexlink as fl
from flexlink.common.types import Array
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.springs import damping_slope
from flexlink.dynamics.tangent import displacements, gyroscopic_matrix, stiffness_matrix

SEEDS = range(8)


def state(chain: fl.Chain, rng: np.random.Generator) -> tuple[Array, ...]:
    """q, q̇, a third and a wrench."""
    return (*rng.normal(size=(3, chain.n)), rng.normal(size=6))


def apart(chain: fl.Chain) -> np.ndarray:
    """Which pairs of joints are not on one path from the base, (n, n)."""
    on_path = np.zeros((chain.n, chain.n), bool)
    for body in chain.bodies:
        above = chain.bodies[body["parent"] - 1] if body["parent"] else None
        for k in range(body["first"], body["stop"]):
            on_path[k, body["first"] : k + 1] = True
            while above is not None:
                on_path[k, above["first"] : above["stop"]] = True
                above = chain.bodies[above["parent"] - 1] if above["parent"] else None
            on_path[k] |= on_path[body["first"]]
    return ~(on_path | on_path.T)


def off(ours: Array, exact: Array) -> float:
    """Largest error, in units of the largest element."""
    return float(np.abs(ours - exact).max() / (np.abs(exact).max() or 1.0))


@pytest.fixture(params=SEEDS)
def tree(request: pytest.FixtureRequest) -> tuple[fl.Chain, np.random.Generator]:
    """A random one, every second on a free base, and a stream of numbers."""
    rng = np.random.default_rng(request.param)
    return random_tree(rng, int(rng.integers(1, 5)), free=bool(request.param % 2)), rng


def test_inverse_dynamics_has_the_slopes_of_newton_s_and_euler_s_equations(tree) -> None:
    chain, rng = tree
    q, qd, qdd, wrench = state(chain, rng)
    found = fl.inverse_dynamics_derivatives(chain, q, qd, qdd, tip_wrench=wrench)
    exact = slopes(chain, q, qd, qdd, wrench)
    for ours, wanted in zip((found.dq, found.dqd, found.dqdd), exact, strict=True):
        assert off(ours, wanted) < 1e-14
        assert not ours[apart(chain)].any()
    turning = fl.inverse_dynamics_derivatives(chain, q, qd, qdd, tip_wrench=wrench, frame="tip")
    springs = np.abs(chain.matrix("stiffness")).max()  # which the difference of two stiffnesses is taken of
    assert np.abs(turning.dq - slopes(chain, q, qd, qdd, wrench, follower=True)[0]).max() < 1e-14 * (
        np.abs(exact[0]).max() + springs
    )


def test_forward_dynamics_has_them_too(tree) -> None:
    chain, rng = tree
    hinges = chain.hinges.copy()
    hinges["prescribed"][chain.active[-1]] = 1
    for each in (chain, dataclasses.replace(chain, hinges=hinges)):
        q, qd, tau, wrench = state(each, rng)
        q /= 3
        given = each.hinges["prescribed"] != 0
        free = ~given
        qdd = fl.forward_dynamics(each, q, qd, tau, tip_wrench=wrench)
        K, C, M = slopes(each, q, qd, qdd, wrench)
        width = each.hinges["coulomb_width"]
        friction = each.damping + each.hinges["coulomb"] / width * (1 - np.tanh(qd / width) ** 2)
        K, C = K + each.matrix("stiffness"), C + np.diag(friction)
        inverse = np.zeros_like(M)
        inverse[np.ix_(free, free)] = np.linalg.inv(M[np.ix_(free, free)])
        by_input = inverse.copy()
        by_input[:, given], by_input[given, given] = -inverse @ M[:, given], 1.0
        found = fl.forward_dynamics_derivatives(each, q, qd, tau, tip_wrench=wrench)
        rounding = 1e-15 * np.linalg.cond(M)
        assert off(found.dq, -inverse @ K) < rounding
        assert off(found.dqd, -inverse @ C) < rounding
        assert off(found.dtau, by_input) < rounding


def test_many_states_have_the_slopes_of_each() -> None:
    rng = np.random.default_rng(3)
    chain = random_tree(rng, 3, free=True)
    q, qd, given = rng.normal(size=(3, 3, chain.n))
    wrench = rng.normal(size=(3, 6))
    for function, names in (
        (fl.inverse_dynamics_derivatives, ("dq", "dqd", "dqdd")),
        (fl.forward_dynamics_derivatives, ("dq", "dqd", "dtau")),
    ):
        many = function(chain, q, qd, given, tip_wrench=wrench)
        for k in range(3):
            one = function(chain, q[k], qd[k], given[k], tip_wrench=wrench[k])
            assert all(np.array_equal(getattr(many, name)[k], getattr(one, name)) for name in names)


@pytest.mark.parametrize("follower", [False, True])
def test_small_motion_has_the_products_and_solutions_of_the_matrices(tree, follower: bool) -> None:
    chain, rng = tree
    q, rates, _, wrench = state(chain, rng)
    locked = np.zeros(chain.n, bool)
    locked[rng.integers(chain.n)] = chain.n > 1
    free = ~locked
    for qd in (rates, 0 * rates):
        K, C, M = slopes(chain, q, qd, 0 * q, wrench, follower=follower)
        size = np.abs(K).max() + chain.stiffness.max()
        K, D = K + chain.matrix("stiffness"), np.diag(damping_slope(chain))
        assert np.abs(stiffness_matrix(chain, q, qd, wrench, follower) - K).max() < 1e-14 * size
        assert np.abs(gyroscopic_matrix(chain, q, qd) - C).max() <= 1e-13 * np.abs(C).max()
        motion = SmallMotion(chain, q, qd, wrench, follower, locked)
        x = np.where(locked, 0.0, rng.normal(size=(2, chain.n)))
        for weights in (*np.eye(3), np.array([1.0, 0.7, 0.49])):
            A = np.tensordot(weights, [K, C + D, M], 1)
            right = np.where(locked, 0.0, x @ A.T)
            assert np.abs(motion.times(weights, x) - right).max() <= 1e-14 * chain.n * np.abs(A).max()
        motion.eliminate(weights, np.ones(chain.n), np.abs(A).max(axis=1), 0.0)
        assert np.abs(motion.solve(right)[0] - x).max() <= 1e-14 * np.linalg.cond(A[np.ix_(free, free)])
        assert off(motion.times_mass(x), np.where(locked, 0.0, x @ M)) < 1e-14


def test_displacements_are_those_of_the_points(tree) -> None:
    chain, rng = tree
    q, φ, *_ = state(chain, rng)
    ε = 1e-6
    ahead, behind = (fl.frames(chain, q + sign * ε * φ).points for sign in (1, -1))
    assert np.abs(displacements(chain, q, φ[None])[0] - (ahead - behind) / (2 * ε)).max() < 1e-7


def test_a_posture_of_rest_balances_and_the_pivots_tell_whether_it_stays() -> None:
    chain = random_tree(np.random.default_rng(4), 4)
    rest = fl.solve_static(chain, locked=chain.active)
    left = fl.inverse_dynamics(chain, rest.q, 0 * rest.q, 0 * rest.q) + chain.times("stiffness", rest.q) - rest.tau
    assert np.abs(left).max() < 1e-9
    held = np.isin(np.arange(chain.n), chain.active)
    motion = SmallMotion(chain, rest.q, 0 * rest.q, np.zeros(6), False, held)
    K = stiffness_matrix(chain, rest.q, 0 * rest.q, np.zeros(6))[np.ix_(~held, ~held)]
    assert (motion.falling(K_ALONE, np.zeros(chain.n)) > 0) == (np.linalg.eigvalsh(K).min() < 0) == (not rest.stable)
