"""Linear dynamics of a chain: its eigenvalues, and the largest step at which a Runge-Kutta method is stable."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from flexlink.chain import Chain
from flexlink.dynamics import mass_matrix, vector
from flexlink.errors import SceneError
from flexlink.tableaus import Tableau, tableau

Array = NDArray[np.float64]

GROWTH = 1e-6
"""Growth of the amplitude per step that still counts as stable: a factor e in a million steps. Exactly zero would
call RK2 unstable at every step, since its amplitude grows by (ω h)⁴/8."""


def eigenvalues(chain: Chain, q: ArrayLike) -> NDArray[np.complex128]:
    """Eigenvalues λ of the springs and the friction about posture `q`, gravity left out, shape (2n,) [1/s].

    λ² M + λ D + K = 0 with D the slope of T_FR at rest, d + coulomb / coulomb_width. |Im λ| ≈ ω of lightly damped modes.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    """
    q = vector("q", q, chain.n)
    M = mass_matrix(chain, q)
    D = chain.damping + chain.hinges["coulomb"] / chain.hinges["coulomb_width"]
    if not D.any():
        squares = linalg.eigh(np.diag(chain.stiffness), M, eigvals_only=True)
        ω = np.sqrt(np.maximum(squares, 0.0))
        return np.concatenate([1j * ω, -1j * ω])
    zero, one = np.zeros_like(M), np.eye(chain.n)
    A = np.block([[zero, one], [-linalg.solve(M, np.diag(chain.stiffness)), -linalg.solve(M, np.diag(D))]])
    values: NDArray[np.complex128] = linalg.eigvals(A)
    return values


def largest_frequency(chain: Chain, q: ArrayLike) -> float:
    """Largest |λ| of `eigenvalues` [rad/s]: what the step of an explicit method has to follow."""
    return float(np.abs(eigenvalues(chain, q)).max())


def stability_polynomial(method: Tableau) -> Array:
    """Coefficients of R(z) = 1 + z b·(1 − zA)⁻¹·1 = Σ r_k z^k, r_0 first (Hairer & Wanner, II, eq. IV.2.11)."""
    A, b, _ = method.arrays
    coefficients, power = [1.0], np.ones(method.stages)
    for _ in range(method.stages):
        coefficients.append(float(b @ power))
        power = A @ power
    return np.array(coefficients)


def stable_step(chain: Chain, method: str = "RK4", q: ArrayLike | None = None) -> float:
    """Largest step [s] at which `method` does not blow up on this chain about posture `q` (default: straight).

    The largest h with |R(h'λ)| ≤ 1 + 1e-6 for all eigenvalues λ of the chain and all h' ≤ h. Fast large motion
    shifts the eigenvalues; stay a few per cent below.

    Raises
    ------
    ArgumentError
        Unknown method, or `q` with a wrong shape.
    """
    λ = eigenvalues(chain, np.zeros(chain.n) if q is None else q)
    λ = λ[np.abs(λ) > 1e-9 * max(np.abs(λ).max(), 1e-300)]
    if len(λ) == 0:
        return np.inf
    r = stability_polynomial(tableau(method))
    fastest = float(np.abs(λ).max())

    def unstable(x: float) -> bool:
        return bool((np.abs(np.polynomial.polynomial.polyval(x / fastest * λ, r)) > 1 + GROWTH).any())

    grid = np.arange(1, 4001) * 0.01  # h |λ|; no explicit method with 40 stages or fewer reaches 40
    high = next((x for x in grid if unstable(x)), None)
    if high is None:
        raise SceneError(f"{method!r}: stable beyond h |λ| = {grid[-1]}; not an explicit Runge-Kutta method")
    low = high - 0.01
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return float(low / fastest)
