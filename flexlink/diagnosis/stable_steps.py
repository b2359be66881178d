"""Largest stable step of the integrator that a file specifies, for a slightly bent arm without parallel axes.

Semi-implicit Euler, v' = v + h a(x, v), x' = x + h v', is stable for a mode λ² + d λ + ω² = 0 if

    h² ω² + 2 h d < 4        h < 4 / (d + √(d² + 4 ω²))

With implicit damping, v' = v + h (−ω² x − d v'), it is stable if h² ω² − 2 h d < 4, or h < (d + √(d² + 4 ω²)) / ω².
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.singularity import regular_mass
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.dynamics.vibration.stability import stable_step


def _modes(chain: Chain) -> tuple[Array, Array]:
    """ω [rad/s] and d = φᵀ D φ [1/s] of the undamped modes φ; for an unstable mode, ω is its growth rate."""
    q = chain.slightly_bent
    M, K = regular_mass(chain, q, np.arange(chain.n)), stiffness_matrix(chain, q, np.zeros(chain.n), np.zeros(6))
    square, φ = scipy.linalg.eigh((K + K.T) / 2, M)
    return np.sqrt(np.abs(square)), np.einsum("im,im->m", φ, chain.times("damping", φ.T).T)


def _euler(chain: Chain) -> float:
    ω, d = _modes(chain)
    rate = d + np.sqrt(d**2 + 4 * ω**2)
    return float(4 / rate.max()) if rate.any() else np.inf


def _damped_implicitly(chain: Chain) -> float:
    ω, d = _modes(chain)
    ω, d = ω[ω > 0], d[ω > 0]
    return float(((d + np.sqrt(d**2 + 4 * ω**2)) / ω**2).min(initial=np.inf))


LARGEST: dict[str, Callable[[Chain], float]] = {
    "RK4": lambda chain: stable_step(chain, chain.slightly_bent, method="RK4"),
    "Euler": _damped_implicitly,
    "Euler without eulerdamp": _euler,
    "Implicit": _damped_implicitly,
    "Implicitfast": _damped_implicitly,
}
"""Function for the largest stable step of each `ReadBack.integrator`; other integrators are not checked."""
