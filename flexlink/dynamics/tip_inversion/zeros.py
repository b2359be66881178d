"""Transmission zeros from the torques of the driven joints to the tip: motion of the arm with its tip held.

With the joints' coordinates a and the springs' coordinates p, a tip that stays in place has δa = −R δp with
R = J_a⁺ J_p, and the springs move by E p̈ + F ṗ + G p = 0, with E = M_pp − M_pa R and so on. A torque computed from the
tip's path contains exp(λt) of these zeros: it must begin before the move for Re λ > 0, and end after it for Re λ < 0.
"""

from __future__ import annotations

import numpy as np
import scipy

from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Complex, Indices
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import forward_dynamics_derivatives
from flexlink.dynamics.placement import jacobian
from flexlink.dynamics.terms import mass_matrix


def required_torque(chain: Chain, q: Array, qd: Array, qdd: Array, wrench: Array) -> Array:
    """Torque T_EX of every coordinate that a motion needs, M (q̈ − q̈ without T_EX), shape (n,) or (b, n) [N m]."""
    wrenches = np.broadcast_to(wrench, (*q.shape[:-1], 6)).copy()
    free = forward_dynamics(chain, q, qd, np.zeros_like(q), tip_wrench=wrenches)
    return np.asarray((mass_matrix(chain, q) @ (qdd - free)[..., None])[..., 0])


def slopes_of(chain: Chain, q: Array, qd: Array, torque: Array, wrench: Array) -> tuple[Array, Array, Array]:
    """∂τ/∂q̈, ∂τ/∂q̇ and ∂τ/∂q of `required_torque`, shape (n, n) or (b, n, n), at the motion that torques cause."""
    wrenches = np.broadcast_to(wrench, (*q.shape[:-1], 6)).copy()
    by = forward_dynamics_derivatives(chain, q, qd, torque, tip_wrench=wrenches)
    M = mass_matrix(chain, q)
    return M, -M @ by.dqd, -M @ by.dq


def springs_of(chain: Chain) -> Indices:
    """Sequential indices of the coordinates that are not driven."""
    return np.setdiff1d(np.arange(chain.n), chain.active)


def aims_of(chain: Chain, postures: Array) -> Array:
    """J_a⁺ (b, d, 3): changes of the driven joints per displacement of the tip, at these postures (b, n)."""
    return np.asarray(np.linalg.pinv(jacobian(chain, postures).linear[:, :, chain.active]))


def transmission_zeros(chain: Chain, q: Array, wrench: Array) -> tuple[Complex, Complex]:
    """Zeros of an arm at rest in a posture (n,), the slowest first, and those of the arm without damping [1/s]."""
    driven, springs, zero = chain.active, springs_of(chain), np.zeros(chain.n)
    torque = required_torque(chain, q, zero, zero, wrench)
    R = (aims_of(chain, q[None])[0] @ jacobian(chain, q).linear)[:, springs]
    E, F, G = (
        part[np.ix_(springs, springs)] - part[np.ix_(springs, driven)] @ R
        for part in slopes_of(chain, q, zero, torque, wrench)
    )
    m = len(springs)
    one, none = np.eye(m), np.zeros((m, m))
    left, right = np.block([[none, one], [-G, -F]]), np.block([[one, none], [none, E]])
    both = [scipy.linalg.eigvals(left, right), np.sqrt(scipy.linalg.eigvals(-G, E).astype(complex))]
    damped, undamped = (each[np.isfinite(each)] for each in both)
    return _slowest_first(damped), _slowest_first(undamped)


def _slowest_first(zeros: Complex) -> Complex:
    return np.asarray(zeros[np.argsort(np.abs(zeros), kind="stable")])
