"""Public functions for the terms of the equation of motion; they check their arguments, then call a kernel.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX                         (paper, equations 2 and 3)

All torques are in N m, all angles in rad. Arrays are float64 of shape (n,) in sequential order, or (b, n) for b states.
Results for b states have a leading axis b, and arguments of shape (n,) apply to all states. The tip wrench
(f_x, f_y, f_z, m_x, m_y, m_z) [N, N m] acts on the arm at the origin of the tip frame, in axes of `frame`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import NO_WRENCH, beyond_float64, require_one_of, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.batches import each, is_batch, rows
from flexlink.dynamics.bound import Bound, bound
from flexlink.dynamics.forces import force_torque, of_joint_rates, spring_torque, world_wrench, world_wrenches
from flexlink.kernels.bodies import mass, rne
from flexlink.kernels.tools.address import bind
from flexlink.kernels.tools.finite import is_finite

MASS_ALGORITHMS = {
    "columns": mass.mass_columns, "lower": mass.mass_lower, "upper": mass.mass_upper, "composite": mass.mass_composite,
}  # fmt: skip


def algorithms_of(chain: Chain) -> tuple[str, ...]:
    """Names of the mass matrix algorithms available for a chain."""
    return tuple(MASS_ALGORITHMS) if chain.is_serial_revolute else ("upper", "composite")


def inverse_dynamics(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
) -> Array:  # fmt: skip
    """Torque M q̈ + T_GC of the rigid-body motion, without springs and friction.

    Recursive Newton-Euler algorithm (Luh, Walker & Paul 1980; paper, section 3), as in Pinocchio's `rnea` and MuJoCo's
    `mj_rne`.

    Parameters
    ----------
    chain, q, qd, qdd
        The chain; angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,), or (b, n) for b states. Eight
        states are computed at a time; the results agree with single calls up to rounding (`rounding.of_residual`).
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], or one row per state, (b, 6), in axes of frame 0, "world",
        or of the "tip" frame.

    Returns
    -------
    Array
        τ = M(q) q̈ + T_GC(q, q̇), shape (n,), or (b, n) [N m].

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a torque is beyond float64.

    Examples
    --------
    >>> torque = fl.inverse_dynamics(chain, q, qd, qdd) + fl.elastic_torque(chain, q) + fl.friction_torque(chain, qd)
    >>> print(torque.round(2) + 0.0)  # N m; equilibrium: zero at hinges with springs
    [77.6   0.    0.   30.31  0.    0.  ]
    """
    if type(chain) is Chain and tip_wrench is None and type(frame) is str and frame == "world":
        tau = np.empty(chain.n)
        if newton_euler(chain)(NO_WRENCH, q, qd, qdd, tau):
            return tau
    n = require_type("chain", chain, Chain).n
    if is_batch(q, qd, qdd):
        state = {"q": q, "qd": qd, "qdd": qdd}
        many = rows(n, state)
        wrenches = world_wrenches([chain], many[0], tip_wrench, frame)
        found: Array = rne.inverse_dynamics_of_many(chain.arrays, wrenches, *many)
        if is_finite(found.reshape(-1)):
            return found
        return each(inverse_dynamics, chain, state, tip_wrench=tip_wrench, frame=frame)  # its error names the state
    q, qd, qdd = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("qdd", qdd, n, many=True)
    wrench = world_wrench(chain, q, tip_wrench, frame)
    tau = np.empty(n)
    if not newton_euler(chain)(wrench, q, qd, qdd, tau):
        raise beyond_float64(_at("torque", chain, tau), q=q, qd=qd, qdd=qdd, tip_wrench=wrench, gravity=chain.gravity)
    return tau


@bound
def newton_euler(chain: Chain) -> Bound:
    """Inverse dynamics of a chain, a function of (wrench, q, qd, qdd, tau)."""
    given = chain.arrays, rne.rne_workspace(chain.arrays)
    return bind(rne.inverse_dynamics, given, np.zeros(6), *np.zeros((4, chain.n)))


def _at(what: str, chain: Chain, values: Array) -> str:
    """Phrase that names the first joint whose entry in `values` is not finite."""
    return f"the {what} of joint {chain.joint_name(int(np.argmin(np.isfinite(values))))!r}"


def bias_torque(
    chain: Chain, q: ArrayLike, qd: ArrayLike, *, tip_wrench: ArrayLike | None = None, frame: Frame = "world"
) -> Array:
    """T_GC: torques of gravity, Coriolis and centrifugal forces and the tip wrench (paper, eq. 3).

    It is `inverse_dynamics` with q̈ = 0. Pinocchio calls it `nle`, MuJoCo `qfrc_bias`.

    Parameters
    ----------
    chain, q, qd
        The chain; angles [rad] and rates [rad/s], shape (n,), or (b, n) for b states.
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame.

    Returns
    -------
    Array
        T_GC, shape (n,), or (b, n) [N m].

    Raises
    ------
    ArgumentError
        As in `inverse_dynamics`.

    Examples
    --------
    >>> print(fl.bias_torque(chain, q, qd)[chain.active].round(2))  # N m; at rest the gravity torque
    [77.6  30.31]
    """
    still = np.zeros(require_type("chain", chain, Chain).n)
    return inverse_dynamics(chain, q, qd, still, tip_wrench=tip_wrench, frame=frame)


def gravity_torque(chain: Chain, q: ArrayLike) -> Array:
    """T_G: the joint torque that holds the arm against gravity, T_GC at q̇ = 0 without a tip wrench.

    Parameters
    ----------
    chain, q
        The chain; angles [rad], shape (n,), or (b, n) for b states.

    Returns
    -------
    Array
        T_G, shape (n,), or (b, n) [N m].

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.

    Examples
    --------
    >>> print(fl.gravity_torque(chain, q)[chain.active].round(2))  # N m
    [77.6  30.31]
    """
    return bias_torque(chain, q, np.zeros(require_type("chain", chain, Chain).n))


def elastic_torque(chain: Chain, q: ArrayLike) -> Array:
    """T_FL = k (θ − θ₀) for passive joints, 0 for active ones; K (θ − θ₀) for coupled springs.

    For springs that act on rotation vectors φ (lumping rules with `springs = "rotation"`) it is the gradient of
    ½ φ·K φ with respect to the angles. It includes c q³ of hardening springs, `joint.hardening`.

    Parameters
    ----------
    chain, q
        The chain; angles [rad], shape (n,), or (b, n) for b states.

    Returns
    -------
    Array
        T_FL, shape (n,), or (b, n) [N m].

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite, or a torque is beyond float64.

    Examples
    --------
    >>> print(fl.elastic_torque(chain, q).round(2) + 0.0)  # N m; zero for driven joints
    [  0.   -66.78 -39.47   0.   -23.36  -5.86]
    """
    if is_batch(q):
        return each(elastic_torque, chain, {"q": q})
    q = vector("q", q, require_type("chain", chain, Chain).n, many=True)
    with np.errstate(over="ignore"):
        torque = spring_torque(chain, q)
    if not is_finite(torque):
        raise beyond_float64(_at("elastic torque", chain, torque), q=q)
    return torque


def friction_torque(chain: Chain, qd: ArrayLike) -> Array:
    """T_FR = d q̇ + c tanh(q̇ / w).

    d is viscous friction of active joints and structural damping of passive ones. c is the Coulomb torque, and w the
    `coulomb_width` over which it changes sign smoothly.

    Parameters
    ----------
    chain, qd
        The chain; rates [rad/s], shape (n,), or (b, n) for b states.

    Returns
    -------
    Array
        T_FR, shape (n,), or (b, n) [N m].

    Raises
    ------
    ArgumentError
        `qd` has the wrong shape, is not real or not finite, or a torque is beyond float64.

    Examples
    --------
    >>> print(fl.friction_torque(chain, np.ones(chain.n)).round(2))  # N m at 1 rad/s in every joint
    [ 0.   10.95 10.95  0.   13.68 13.68]
    """
    if is_batch(qd):
        return each(friction_torque, chain, {"qd": qd})
    qd = vector("qd", qd, require_type("chain", chain, Chain).n, many=True)
    hinges = chain.hinges
    with np.errstate(over="ignore"):  # tanh saturates at 1
        torque: Array = chain.times("damping", qd) + hinges["coulomb"] * np.tanh(qd / hinges["coulomb_width"])
        if chain.forces:
            torque = torque + force_torque(of_joint_rates(chain), np.zeros(chain.n), qd)
    if not is_finite(torque):
        raise beyond_float64(_at("friction torque", chain, torque), qd=qd)
    return torque


def mass_matrix(chain: Chain, q: ArrayLike, *, algorithm: str = "composite") -> Array:
    """Joint-space inertia matrix M(q), symmetric positive definite; Pinocchio's `crba`, MuJoCo's `mj_fullM`.

    Parameters
    ----------
    chain, q
        The chain; angles [rad], shape (n,), or (b, n) for b states. "composite" computes eight states at a time; the
        results agree with single calls up to rounding (`rounding.of_mass_matrix`).
    algorithm
        "columns", "lower", "upper": methods 1, 2, 3 of Walker & Orin (1982), as named in the paper; the first two only
        for unbranched arms without sliding joints;
        "composite": composite-rigid-body algorithm in inertial axes (Featherstone 2008, section 6.2), the fastest.
        The error of every element is about eps times the largest element. With methods 1 to 3, in body axes, it is
        about eps √(M_jj M_kk), which matters for the twist j of a slender, nearly straight arm: M_jj is then tiny.

    Returns
    -------
    Array
        M, shape (n, n), or (b, n, n) [kg m²].

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite; the algorithm is unknown or not available for this chain; or
        M is beyond float64.

    Examples
    --------
    >>> M = fl.mass_matrix(chain, q)
    >>> print(M.shape, M[0, 0].round(3))  # kg m² about the first joint
    (6, 6) 12.181
    """
    if type(chain) is Chain and type(algorithm) is str and algorithm == "composite":
        M = np.zeros((chain.n, chain.n))
        if composite(chain)(q, M):
            return M
    n, kernel = require_type("chain", chain, Chain).n, require_one_of("algorithm", algorithm, MASS_ALGORITHMS)
    if algorithm not in algorithms_of(chain):
        allowed = " or ".join(map(repr, algorithms_of(chain)))
        why = f"algorithm = {algorithm!r}: requires an unbranched arm without sliding joints; use {allowed}"
        raise ArgumentError(why, id="not-supported-here")
    if is_batch(q):
        if kernel is mass.mass_composite:
            found: Array = mass.mass_of_many(chain.arrays, *rows(n, {"q": q}))
            if is_finite(found.reshape(-1)):
                return found
        return each(mass_matrix, chain, {"q": q}, algorithm=algorithm)
    q = vector("q", q, n, many=True)
    M = np.zeros((n, n))
    if not math.isfinite(kernel(chain.arrays, q, M)):
        why = f"the mass matrix of {chain.name!r} overflows float64; use smaller masses and lengths"
        raise ArgumentError(why, id="overflow")
    return M


@bound
def composite(chain: Chain) -> Bound:
    """Mass matrix of a chain by composite bodies, a function of (q, M), where M is zero."""
    n, work = chain.n, mass.composite_workspace(chain.arrays)
    return bind(mass.mass_matrix, (chain.arrays, work), np.zeros(n), np.zeros((n, n)))
