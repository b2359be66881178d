"""Bounded inverse dynamics of a flexible arm: a boundary-value problem in time, solved by Newton's method.

The equations at equally spaced times are the tip's position and the balance of torques at every spring:

    J_a⁺ (tip(q) − path) = 0        T_p(q, q̇, q̈) = 0        q at rest before the first and after the last time

Boundary values at both ends make the solution bounded: unstable zeros are integrated backwards (Devasia, Chen & Paden
1996; in the frequency domain Bayo 1987). Derivatives are central differences of order 6; each correction solves the
equations linearized about the motion, with differences of order 2 (defect correction).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.dynamics.placement import jacobian, tip_position
from flexlink.dynamics.tip_inversion.zeros import aims_of, required_torque, slopes_of, springs_of

DIFFERENCES = (
    np.array([[-3.0, 27.0, -135.0, 0.0, 135.0, -27.0, 3.0], [2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]]) / 180
)
"""Central differences of order 6 for q̇ and q̈, in units of the spacing, shape (2, 7)."""


class TipPath(NamedTuple):
    """Positions of the tip (m, 3) [m] every `spacing` [s] from rest to rest, and the arm at rest there (m, n)."""

    spacing: float
    postures: Array
    tips: Array
    wrench: Array


class InverseMotion(NamedTuple):
    """Motion q, q̇, q̈ (m, n) of all coordinates, torques of the driven joints (m, d) [N m], and the last correction.

    `correction` is relative to the range of the motion; it is infinite if the corrections grew.
    """

    q: Array
    qd: Array
    qdd: Array
    torques: Array
    correction: float


def inverse_motion(chain: Chain, path: TipPath, *, most: int = 60, enough: float = 1e-10) -> InverseMotion:
    """Find the bounded motion whose tip follows a path, from the postures at rest, to a correction of `enough`."""
    aims, springs, q = aims_of(chain, path.postures), springs_of(chain), path.postures.copy()
    span, change, factors = float(np.ptp(q, axis=0).max()), np.inf, None
    best = InverseMotion(q, q, q, q, np.inf)
    for _ in range(most):
        qd, qdd = _differences(q, path.spacing)
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
        banded, pivots, scale = factors
        correction, _ = dgbtrs(banded, *_widths(chain.n), (defect / scale).ravel(), pivots)
        before, change = change, float(np.abs(correction).max()) / span
        if not change < 10.0:  # farther than ten times the whole motion, or not a number
            return best._replace(correction=np.inf)
        if change < best.correction:
            best = InverseMotion(q, qd, qdd, torque[:, chain.active], change)
        if change <= enough or (change < 1e-6 and change > 2.0 * before):
            break
        q = q + correction.reshape(q.shape)
    return best


def _differences(q: Array, h: float) -> tuple[Array, Array]:
    """Rates and accelerations (m, n) of angles (m, n) that are at rest before and after."""
    padded = np.concatenate([q[:1], q[:1], q[:1], q, q[-1:], q[-1:], q[-1:]])
    windows = np.lib.stride_tricks.sliding_window_view(padded, DIFFERENCES.shape[1], axis=0)
    rate, second = DIFFERENCES
    return windows @ rate / h, windows @ second / h**2


def _widths(n: int) -> tuple[int, int]:
    """Number of diagonals below and above the main diagonal."""
    return 2 * n - 1, 2 * n - 1


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
    below, above = _widths(n)
    banded = np.zeros((2 * below + above + 1, m * n))
    row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    for shift, block in zip((-1, 0, 1), blocks, strict=True):
        k = np.arange(max(0, -shift), min(m, m - shift))[:, None, None]
        i, j = k * n + row, (k + shift) * n + column
        banded[below + above + i - j, j] = block[k[:, 0, 0]]
    factors, pivots, _ = dgbtrf(banded, below, above, overwrite_ab=True)
    return factors, pivots, scale
