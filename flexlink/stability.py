"""What an explicit Runge-Kutta method may do on a chain: its eigenvalues, and the largest stable step."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from flexlink.chain import Chain
from flexlink.checks import given, vector
from flexlink.dynamics import forward_dynamics, inverse_dynamics
from flexlink.modal import damping_slope, first_order_matrix, regular_mass
from flexlink.tableaus import Tableau, tableau

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

DENSE = 300
"""Joints up to which all eigenvalues are found, in O(n³); beyond, only those that bound the step, in O(n)."""

GROWTH = 1e-6
"""Growth of the amplitude per step that still counts as stable: a factor e in a million steps. Exactly zero would
call RK2 unstable at every step, since its amplitude grows by (ω h)⁴/8."""


def eigenvalues(chain: Chain, q: ArrayLike) -> Complex:
    """Eigenvalues λ of the springs and the friction about posture `q`, gravity left out [1/s], 2 per free joint.

    λ² M + λ D + K = 0 with D the slope of T_FR at rest. |Im λ| ≈ ω of lightly damped modes. Joints whose motion is
    prescribed do not take part.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    SingularMassError
        A coordinate moves no inertia of its own at this posture.
    """
    q = vector("q", q, chain.n)
    free = np.flatnonzero(chain.hinges["prescribed"] == 0)
    M = regular_mass(chain, q, free)
    K, D = np.diag(chain.stiffness[free]), damping_slope(chain)[free]
    if not D.any():
        ω = np.sqrt(np.maximum(linalg.eigh(K, M, eigvals_only=True), 0.0))
        return np.concatenate([1j * ω, -1j * ω])
    values: Complex = linalg.eigvals(first_order_matrix(M, np.diag(D), K))
    return values


def fastest_eigenvalues(chain: Chain, q: ArrayLike) -> Complex:
    """Those of `eigenvalues` that bound an explicit method's step; of more than 300 joints, estimates in O(n) [1/s].

    The largest ω² of K φ = ω² M φ and the largest δ of D φ = δ M φ by Lanczos' method, M and M⁻¹ through inverse and
    forward dynamics. They are then combined as if the stiffest mode were the most damped one, λ² + δ λ + ω² = 0,
    which it is under Kelvin-Voigt damping. Errors as in `eigenvalues`.
    """
    if given("chain", chain, Chain).n <= DENSE:
        return eigenvalues(chain, q)
    q = vector("q", q, chain.n)
    square = _largest_ratio(chain, q, chain.stiffness)
    δ = _largest_ratio(chain, q, damping_slope(chain))
    pair = np.roots([1.0, δ, square]).astype(complex)
    return np.concatenate([pair, [1j * np.sqrt(square), -1j * np.sqrt(square), -δ]])


def _largest_ratio(chain: Chain, q: Array, diagonal: Array) -> float:
    """Largest μ of diag(diagonal) φ = μ M φ over the joints that are not prescribed."""
    from scipy.sparse.linalg import LinearOperator, eigsh  # noqa: PLC0415  0.1 s that only long chains need

    free = chain.hinges["prescribed"] == 0
    if not (diagonal * free).any():
        return 0.0
    hinges, zero = chain.hinges.copy(), np.zeros(chain.n)
    for name in ("stiffness", "damping", "coulomb"):
        hinges[name] = 0.0
    bare = dataclasses.replace(chain, hinges=hinges, gravity=np.zeros(3))
    shape = (chain.n, chain.n)
    found = eigsh(
        LinearOperator(shape, lambda φ: diagonal * free * φ.ravel(), dtype=np.float64),
        k=1,
        M=LinearOperator(shape, lambda φ: inverse_dynamics(bare, q, zero, φ.ravel()), dtype=np.float64),
        Minv=LinearOperator(shape, lambda τ: forward_dynamics(bare, q, zero, τ.ravel()), dtype=np.float64),
        which="LA", tol=1e-4,  # relative: beside the few per cent to stay below a stable step, nothing
        v0=np.ones(chain.n), return_eigenvectors=False,
    )  # fmt: skip
    return float(found[0])


def largest_frequency(chain: Chain, q: ArrayLike) -> float:
    """Largest |λ| of `fastest_eigenvalues` [rad/s]: what the step of an explicit method has to follow."""
    return float(np.abs(fastest_eigenvalues(chain, q)).max(initial=0.0))


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
    SceneError
        Unknown method.
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    SingularMassError
        A coordinate moves no inertia of its own at this posture.
    """
    return stable_step_of(
        fastest_eigenvalues(chain, np.zeros(given("chain", chain, Chain).n) if q is None else q), method
    )


def stable_step_of(λ: Complex, method: str) -> float:
    """The `stable_step` [s] of eigenvalues λ [1/s]; inf if nothing holds or brakes any joint."""
    λ = λ[np.abs(λ) > 1e-9 * np.abs(λ).max(initial=1e-300)]  # without those of joints that nothing holds or brakes
    if len(λ) == 0:
        return np.inf
    r = stability_polynomial(tableau(method))
    fastest = float(np.abs(λ).max())

    def unstable(x: float) -> bool:
        return not (np.abs(np.polynomial.polynomial.polyval(x / fastest * λ, r)) <= 1 + GROWTH).all()

    # |R| ≤ 1 on [0, x] with R'(0) = 1 and degree s leaves x ≤ 2 s², in any direction (Markov's inequality).
    high = next(x for x in 0.01 * np.arange(1, 200 * (len(r) - 1) ** 2 + 101) if unstable(x))
    low = high - 0.01
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return float(low / fastest)
