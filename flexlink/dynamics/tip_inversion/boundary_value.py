"""Bounded inverse dynamics of a flexible arm: a boundary-value problem in time, solved by Newton's method.

The equations at equally spaced times are the tip's position and the balance of torques at every spring:

    J_a⁺ (tip(q) − path) = 0        T_p(q, q̇, q̈) = 0        q at rest before the first and after the last time

Boundary values at both ends make the solution bounded: unstable zeros are integrated backwards (Devasia, Chen & Paden
1996; in the frequency domain Bayo 1987). Derivatives are central differences of order 6; each correction solves the
equations linearized about the motion, with differences of order 2 (defect correction).
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array, Complex, Indices
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.derivatives import forward_dynamics_derivatives
from flexlink.dynamics.placement import jacobian, tip_position
from flexlink.dynamics.terms import mass_matrix

DIFFERENCES = np.array([[-3, 27, -135, 0, 135, -27, 3], [2, -27, 270, -490, 270, -27, 2]]) / 180
"""Central differences of order 6 for q̇ and q̈, in units of the spacing, shape (2, 7)."""


class TipPath(NamedTuple):
    """Positions of the tip (m, 3) [m] every `spacing` [s] from rest to rest, and the arm at rest there (m, n)."""

    spacing: float
    postures: Array
    tips: Array
    wrench: Array


class InverseMotion(NamedTuple):
    """Motion q, q̇, q̈ (m, n), drive torques (m, d) [N m], and the last correction of the range, inf if it grew."""

    q: Array
    qd: Array
    qdd: Array
    torques: Array
    correction: float


def inverse_motion(chain: Chain, path: TipPath) -> InverseMotion:
    """Find the bounded motion whose tip follows a path, from the postures at rest."""
    aims, springs, q = aims_of(chain, path.postures), springs_of(chain), path.postures.copy()
    span, change, factors = float(np.ptp(q, axis=0).max()), np.inf, None
    best = InverseMotion(q, q, q, q, np.inf)
    for _ in range(60):
        padded = np.concatenate([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])  # at rest before and after
        windows = np.lib.stride_tricks.sliding_window_view(padded, DIFFERENCES.shape[1], axis=0)
        qd, qdd = windows @ DIFFERENCES[0] / path.spacing, windows @ DIFFERENCES[1] / path.spacing**2
        try:
            torque = required_torque(chain, q, qd, qdd, path.wrench)
            if change > 1e-4:  # else Newton's matrix is known well enough
                factors = _factored(chain, path, q, qd, torque, aims)
        except FlexlinkError:  # the motion is beyond float64
            return best._replace(correction=np.inf)
        if factors is None:
            break
        defect = np.empty_like(q)
        defect[:, chain.active] = np.einsum("kij,kj->ki", aims, path.tips - tip_position(chain, q))
        defect[:, springs] = -torque[:, springs]
        (banded, pivots, scale), width = factors, 2 * chain.n - 1
        correction, _ = dgbtrs(banded, width, width, (defect / scale).ravel(), pivots)
        before, change = change, float(np.abs(correction).max()) / span
        if not change < 10.0:  # farther than ten times the whole motion, or not a number
            return best._replace(correction=np.inf)
        if change < best.correction:
            best = InverseMotion(q, qd, qdd, torque[:, chain.active], change)
        if change <= 1e-10 or (change < 1e-6 and change > 2.0 * before):
            break
        q = q + correction.reshape(q.shape)
    return best


def _factored(
    chain: Chain, path: TipPath, q: Array, qd: Array, torque: Array, aims: Array
) -> tuple[Array, NDArray[np.int32], Array]:
    """LU factors and pivots of the equations linearized about a motion, and the divisors of their rows (m, n)."""
    h, (m, n) = path.spacing, q.shape
    M, D, K = slopes_of(chain, q, qd, torque, path.wrench)
    blocks = np.stack([M / h**2 - D / (2 * h), K - 2 * M / h**2, M / h**2 + D / (2 * h)])
    blocks[:, :, chain.active] = 0.0
    blocks[1][:, chain.active] = aims @ jacobian(chain, q).linear
    scale = np.abs(blocks[1]).max(axis=2)
    blocks /= scale[:, :, None]
    width = 2 * n - 1  # diagonals on either side of the main diagonal
    banded = np.zeros((3 * width + 1, m * n))
    row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    for shift, block in zip((-1, 0, 1), blocks, strict=True):
        k = np.arange(max(0, -shift), min(m, m - shift))[:, None, None]
        i, j = k * n + row, (k + shift) * n + column
        banded[2 * width + i - j, j] = block[k[:, 0, 0]]
    factors, pivots, _ = dgbtrf(banded, width, width, overwrite_ab=True)
    return factors, pivots, scale


# Transmission zeros from the torques of the driven joints to the tip: motion of the arm with its tip held.
#
# With the joints' coordinates a and the springs' coordinates p, a tip that stays in place has δa = −R δp with R = J_a⁺
# J_p, and the springs move by E p̈ + F ṗ + G p = 0, with E = M_pp − M_pa R and so on. A torque computed from the tip's
# path contains exp(λt) of these zeros: it must begin before the move for Re λ > 0, and end after it for Re λ < 0.


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
    damped, undamped = (np.array(sorted(each[np.isfinite(each)], key=abs), dtype=complex) for each in both)
    return damped, undamped
