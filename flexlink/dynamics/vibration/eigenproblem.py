"""The eigenproblem of small motion, (λ² M + λ C + K) φ = 0, with stiffnesses that differ by orders of magnitude.

1.  K = S K̂ S with a diagonal S, so that K̂ is of order 1. By Sylvester's law of inertia, the numbers of negative and
    zero eigenvalues of K̂ are the numbers of unstable and neutral modes, for any M. Small eigenvalues are compared with
    the rounding error here, where all rows have the same magnitude.
2.  With K = Y Yᵀ and M = L Lᵀ, the ω are the singular values of Yᵀ L⁻ᵀ. Nothing is squared: the relative error of ω is
    eps · ω_max/ω; it would be eps · (ω_max/ω)² from eigenvalues of M⁻¹ K. An indefinite K is shifted: K + σ M.
3.  With damping, rotation or a load without a potential, the λ follow from the first-order system in these modes,
    fastest first. The rows of its matrix decrease in size, so the QR algorithm is accurate row by row.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.dynamics.tangent import Stiffness

EPS = np.finfo(float).eps


class Solution(NamedTuple):
    """Eigenvalues λ [1/s], slowest first, mode shapes φ in columns, and the rounding error of each λ [1/s]."""

    eigenvalues: Complex
    shapes: NDArray[np.inexact]
    rounding: Array


class _Modes(NamedTuple):
    """Modes of K φ = μ M φ with the symmetric part of K; μ = −λ² in ascending order; Φᵀ M Φ = 1."""

    μ: Array
    Φ: Array
    falling: int
    resting: int


def solve(M: Array, L: Array, C: Array, stiffness: Stiffness) -> Solution:
    """Return one λ of each conjugate pair, and each real λ; of real pairs ±λ in an undamped system, only λ > 0.

    Parameters
    ----------
    M, L
        Mass matrix and its Cholesky factor, M = L Lᵀ, shape (n, n).
    C
        Damping and gyroscopic matrix, shape (n, n).
    stiffness
        K, and the magnitude of its terms.

    Raises
    ------
    ArgumentError
        A number is beyond float64.
    """
    if not all(np.isfinite(part).all() for part in (stiffness.K, stiffness.S, C)):
        raise ArgumentError(
            "stiffness, damping, loads or rates are so large that numbers overflow float64", id="overflow"
        )
    modes = _conservative(M, L, stiffness)
    K = stiffness.K
    without_potential = np.zeros_like(K) if stiffness.conservative else (K - K.T) / 2
    found = _first_order(modes, C, without_potential) if C.any() else _undamped(modes, without_potential)
    λ = np.where(np.abs(found.eigenvalues) <= found.rounding, 0.0, found.eigenvalues)
    return found._replace(eigenvalues=λ)


def _conservative(M: Array, L: Array, stiffness: Stiffness) -> _Modes:
    """Take step 2, twice if K is indefinite, since the first shift is a bound that may be far too high."""
    w, V = np.linalg.eigh(stiffness.scaled)  # reads the lower triangle: rows of outer hinges, which are more accurate
    falling = int((w < -stiffness.rounding).sum())
    resting = int((np.abs(w) <= stiffness.rounding).sum())
    S = stiffness.S
    if not falling:
        squares, Φ = _swinging(L, S, w, V, resting)
        return _Modes(squares, Φ, falling, resting)
    down = scipy.linalg.solve_triangular(L, S[:, None] * V[:, :falling] * np.sqrt(-w[:falling]), lower=True)
    lift = 2 * float(np.linalg.norm(down, 2)) ** 2  # since μ ≥ −‖L⁻¹ Y₋‖²
    for _ in range(2):
        lifted = np.sqrt(S**2 + lift * np.diag(M))
        w, V = np.linalg.eigh((stiffness.symmetric + lift * M) / np.outer(lifted, lifted))
        squares, Φ = _swinging(L, lifted, np.abs(w), V, 0)
        μ = squares - lift
        lift = 2 * abs(float(μ[0]))
    μ = np.concatenate([-np.abs(μ[:falling]), np.zeros(resting), np.abs(μ[falling + resting :])])
    return _Modes(μ, Φ, falling, resting)


def _swinging(L: Array, S: Array, w: Array, V: Array, resting: int) -> tuple[Array, Array]:
    """ω², slowest first, and Φ for K = Y Yᵀ with Y = S V √w; the first `resting` entries of w are treated as zero.

    With Yᵀ L⁻ᵀ = U ω Rᵀ the mode shapes are Φ = L⁻ᵀ R, and also Yᵀ Φ = U ω. The rounding error of row i is
    eps ‖(L⁻ᵀ)_i‖ by the first formula and eps ω/S_i by the second, which is smaller for stiff hinges in slow modes.
    Each entry is taken from the more accurate formula.
    """
    still, root = V[:, :resting], np.sqrt(w[resting:])
    Y = S[:, None] * V[:, resting:] * root
    inverse = scipy.linalg.solve_triangular(L, np.eye(len(L)), lower=True).T
    U, ω, right = np.linalg.svd(Y.T @ inverse)  # `right` has all n rows
    Φ = inverse @ right.T
    moving = Φ[:, : len(ω)]
    by_springs = (V[:, resting:] @ (U * ω / root[:, None]) + still @ (still.T @ (S[:, None] * moving))) / S[:, None]
    Φ[:, : len(ω)] = np.where(np.outer(1 / S, ω) < np.linalg.norm(inverse, axis=1)[:, None], by_springs, moving)
    return np.concatenate([np.zeros(resting), ω[::-1] ** 2]), Φ[:, ::-1]


def _undamped(modes: _Modes, without_potential: Array) -> Solution:
    """Solution without damping, λ = ±√−μ: it contains the λ of each pair ±λ with Im λ > 0, or λ > 0 if real."""
    μ: Complex = modes.μ.astype(complex)
    shapes: NDArray[np.inexact] = modes.Φ
    moved = np.zeros(len(μ))
    if without_potential.any():
        fast = np.argsort(-np.abs(modes.μ), kind="stable")
        Φ = modes.Φ[:, fast]
        μ, amplitudes, moved = _eigenvalues(np.diag(modes.μ[fast]) + Φ.T @ without_potential @ Φ)
        shapes = Φ @ amplitudes
    order = np.argsort(μ.real, kind="stable")
    λ, moved = np.sqrt(-μ[order]), moved[order]
    size = np.maximum(np.abs(λ), np.sqrt(moved))
    rounding = np.divide(moved, size, out=np.zeros(len(λ)), where=size > 0)  # 2 λ dλ = −dμ, and λ² = −dμ at μ = 0
    return Solution(np.where(λ.imag < 0, -λ, λ), shapes[:, order], rounding)


def _eigenvalues(A: Array) -> tuple[Complex, Complex, Array]:
    """Eigenvalues and right eigenvectors of A, and the rounding error of each eigenvalue."""
    λ, left, right = scipy.linalg.eig(A, left=True)
    overlap = np.abs(np.einsum("ik,ik->k", left.conj(), right))
    # The QR algorithm changes a simple eigenvalue by at most N eps ‖A‖/|wᴴ v| (Golub & Van Loan, section 7.2.2), and an
    # eigenvalue of multiplicity m by m times this bound: m = 2 for one neutral joint, 4 for two.
    defect = 4
    size = defect * len(A) * EPS * np.linalg.norm(A, 2)
    return λ, right, np.asarray(size / np.maximum(overlap, EPS))


def _first_order(modes: _Modes, C: Array, without_potential: Array) -> Solution:
    """Solve ẋ = s y, ẏ = −μ a − Φᵀ (C Φ y + N Φ a) for x = s a and y = ȧ, with mode amplitudes a and s = √|μ|.

    The amplitude of a neutral mode has no effect, so the mode has no x, but contributes one λ = 0. If nothing brakes
    the mode, λ = 0 is a double root, whose second half is the steady motion y.
    """
    n, resting = len(modes.μ), 0 if without_potential.any() else modes.resting
    fast = np.argsort(-np.abs(modes.μ), kind="stable")  # neutral modes last
    μ, Φ, m = modes.μ[fast], modes.Φ[:, fast], n - resting
    s = np.sqrt(np.abs(μ[:m]))
    s[s == 0] = s[s > 0].min(initial=1.0)
    x, y = 2 * np.arange(m), np.concatenate([2 * np.arange(m) + 1, m + np.arange(m, n)])
    A = np.zeros((m + n, m + n))
    A[np.ix_(y, y)] = -Φ.T @ C @ Φ
    A[np.ix_(y, x)] = -(Φ.T @ without_potential @ Φ)[:, :m] / s
    A[y[:m], x] -= μ[:m] / s
    A[x, y[:m]] = s
    if not np.isfinite(A).all():
        raise ArgumentError(
            "stiffness, damping, loads or rates are so large that accelerations overflow float64", id="overflow"
        )
    λ, right, rounding = _eigenvalues(A)
    if modes.falling == 0 and not without_potential.any() and _dissipative(C):
        λ.real, rounding = np.minimum(λ.real, 0.0), np.zeros(len(λ))  # the energy ½ ȧ² + ½ μ a² ≥ 0 never grows
    order = np.argsort(np.abs(λ), kind="stable")
    steady = order[:resting][np.abs(λ[order[:resting]]) <= len(A) * EPS * np.linalg.norm(A, 2)]
    kept = np.setdiff1d(order[λ[order].imag >= 0], steady, assume_unique=True)
    kept = kept[np.argsort(np.abs(λ[kept]), kind="stable")]
    amplitudes = right[y][:, kept] / np.where(λ[kept] == 0, 1.0, λ[kept])
    amplitudes[:m] = right[x][:, kept] / s[:, None]
    return Solution(
        np.concatenate([np.zeros(resting), λ[kept]]),
        Φ @ np.hstack([np.eye(n)[:, m:], amplitudes]),
        np.concatenate([np.zeros(resting), rounding[kept]]),
    )


def _dissipative(C: Array) -> bool:
    """Whether q̇ᵀ C q̇ ≥ 0 for all q̇ up to rounding errors, judged with all rows scaled to the same magnitude."""
    size = np.sqrt(np.abs(C).max(axis=1))
    size[size == 0] = 1.0
    scaled = (C + C.T) / 2 / np.outer(size, size)
    return bool(np.linalg.eigvalsh(scaled).min() >= -len(C) * EPS)


def first_order_matrix(M: Array, C: Array, K: Array) -> Array:
    """A of d/dt (q, q̇) = A (q, q̇), shape (2n, 2n); M must have passed `factored_mass`."""
    L, _ = scipy.linalg.lapack.dpotrf(M, lower=1)
    lower = [-scipy.linalg.cho_solve((L, True), right, check_finite=False) for right in (K, C)]
    A = np.block([[np.zeros_like(M), np.eye(len(M))], lower])
    if not np.isfinite(A).all():
        raise ArgumentError(
            "stiffness, damping, loads or rates are so large that accelerations overflow float64", id="overflow"
        )
    return A
