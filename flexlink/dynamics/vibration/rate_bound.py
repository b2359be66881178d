"""A cheap upper bound on eigenvalues of small motion; if the bound is small, the eigenvalues need not be computed.

    λ² φ + λ M⁻¹C φ + M⁻¹K φ = 0,    so    |λ|² ≤ c |λ| + k        c = ‖M⁻¹C‖, k = ‖M⁻¹K‖

in any matrix norm that is consistent with a vector norm; the Frobenius norm is used here.
"""

from __future__ import annotations

import math

import numpy as np
import scipy

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.forces import force_slopes
from flexlink.dynamics.rounding import EPS
from flexlink.dynamics.springs import about, damping_matrix
from flexlink.dynamics.tangent import load_matrices
from flexlink.dynamics.vibration.stability import DENSE, Gains
from flexlink.dynamics.wrench import turns_with_tip


def rate_bound(chain: Chain, q: Array, qd: Array, *, tip_wrench: Array, frame: Frame, gains: Gains) -> float:
    """Return an upper bound on |λ| [1/s] of all eigenvalues; the arguments are as in `eigenvalues`.

    The bound is inf if it is unknown: with more than 100 joints, shapes, prescribed joints, or a mass matrix that may
    be singular.
    """
    n = chain.n
    if n > DENSE or chain.shapes is not None or np.count_nonzero(chain.hinges["prescribed"]):
        return np.inf
    K, C, M = load_matrices(chain, q, qd, tip_wrench, turns_with_tip(frame))
    L, stopped = scipy.linalg.lapack.dpotrf(M, lower=1)
    if stopped or not (L.diagonal() ** 2 > n * EPS * M.diagonal()).all():
        return np.inf
    kp, kd = gains.matrices()
    K, C = K + about(chain, q).matrix("stiffness") + kp, C + damping_matrix(chain) + kd
    if chain.forces:
        of_angle, of_rate = force_slopes(chain, q, qd)
        K, C = K + of_angle, C + of_rate
    c, k = (math.sqrt(np.square(scipy.linalg.lapack.dpotrs(L, A, lower=1)[0]).sum()) for A in (C, K))
    return (c + math.sqrt(c * c + 4 * k)) / 2
