"""Equilibrium of an arm with ties: Newton's method for q and the multipliers λ of exact rows, dense.

    T_GC(q) + T_FL(q) + Jᵀ λ = T_EX     on all coordinates that are not held
    exact rows: g(q) = 0                springs: λ by their law at rest

The matrix is K + Σ k Jᵀ J + Σ λ ∂J/∂q, bordered by J of the exact rows.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ConvergenceError
from flexlink.common.types import Array, Indices
from flexlink.describe.actions import Frame
from flexlink.dynamics.forces import turns_with_tip
from flexlink.dynamics.free_motion import basis
from flexlink.dynamics.tangent import load_torque, stiffness_matrix
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.tied_tangent import bends
from flexlink.dynamics.ties import Ties, gaps, springs


def tied_equilibrium(
    ties: Ties, chain: Chain, q: Array, held: Indices, wrench: Array, frame: Frame, t: float, tau: Array | float = 0.0
) -> Array:
    """The equilibrium (n,) near q with these joints held, under a tip wrench (6,), at time t [s] of lengths that move.

    `tau` (n,): drive torques T_EX [N m]. If there is no stable equilibrium near q, it raises a ConvergenceError.
    """
    passes, largest, settled = 200, 0.1, 1e-12  # Newton steps; largest and last change of a coordinate [rad, m]
    start, still = q, np.zeros(chain.n)
    λ = np.zeros(len(ties[0]))
    B = basis(chain, np.setdiff1d(chain.free, held))
    exact, follower = np.isinf(ties[0]["stiffness"]), turns_with_tip(frame)
    for _ in range(passes):
        g, J, _ = gaps(ties, chain, q, t)
        own, slopes = springs(ties, t, g, np.zeros(len(g)))
        λ[~exact] = own[~exact]
        torque = load_torque(chain, q, still, wrench, follower) + elastic_torque(chain, q) + J.T @ λ - tau
        K = stiffness_matrix(chain, q, still, wrench, follower) + J.T @ (slopes[:, None] * J)
        K += np.tensordot(λ, bends(ties, chain, q), 1)
        reduced, border = B.T @ K @ B, J[exact] @ B
        r, f, least = len(border), len(reduced), _least(reduced, border)
        stable = least >= -1e-9 * np.abs(reduced).max(initial=0.0)
        if not stable:  # away from unstable equilibria
            reduced = reduced - 2.0 * least * np.eye(f)
        stiff = np.abs(reduced).max(initial=0.0) or 1.0  # in these units rows near a singular posture are not lost
        matrix = np.block([[reduced / stiff, border.T], [border, np.zeros((r, r))]])
        right = -np.concatenate([B.T @ torque / stiff, g[exact]])
        change = np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
        part = min(1.0, largest / max(np.abs(change[:f]).max(initial=0.0), 1e-300))
        q, λ[exact] = q + part * (B @ change[:f]), λ[exact] + part * stiff * change[f:]
        if stable and np.abs(change[:f]).max(initial=0.0) <= settled * max(1.0, chain.size):
            return np.asarray(q)
    why = f"{chain.name}: no stable equilibrium of the tied arm near its start; start nearer to it, or hold more joints"
    remedy = "a run starts anywhere with initial.passive = 'zero'"
    raise ConvergenceError(f"{why}; {remedy}", q=start, load=0.0, id="no-equilibrium")


def _least(K: Array, J: Array) -> float:
    """Least eigenvalue of K (f, f) on motions that exact rows J (r, f) allow; inf if they allow none."""
    free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, tol=1e-9) :] if len(J) else np.eye(len(K))
    return float(np.linalg.eigvalsh(free @ (K + K.T) @ free.T / 2.0).min(initial=np.inf))
