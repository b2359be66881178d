"""Modal truncation of linear systems, with the static gain kept.

The slow states span an invariant subspace V of A, with left counterpart W: Wᵀ A V = A_r, Wᵀ V = 1. Fast states follow
the inputs at once, by their static response:

    ẋ_r = A_r x_r + Wᵀ B u        y = C V x_r + (D − C P A⁻¹ B) u        P = 1 − V Wᵀ

V comes from a Krylov space of S = (A − σ)⁻¹, in orthonormal Schur vectors and not in eigenvectors, so that rigid
motions, whose double eigenvalue 0 has one eigenvector, do no harm (Antoulas, Approximation of Large-Scale Dynamical
Systems, 2005, sections 9.2 and 11.2).
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.types import Array

Solve = Callable[[Array], Array]
"""S x, or Sᵀ x, for columns x."""


class SlowPart(NamedTuple):
    """Slow part of a linear system, and the static response of the rest."""

    A: Array  # A_r, (r, r)
    basis: Array  # V, (n, r): x = V x_r
    dual: Array  # W, (n, r): x_r = Wᵀ x
    static: Array  # −P A⁻¹ B, (n, m)


def slow_part(A: Array, B: Array, C: Array, count: int) -> SlowPart:
    """The `count` slowest states, or more where states of equal |λ| would be parted, such as complex pairs."""
    A, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    B, C, n = B / scale[:, None], C * scale, len(A)
    σ = 1e-5 * float(np.abs(A).max())
    for _ in range(2):  # the second time with a shift near the slow states, where S is most accurate
        factors = scipy.linalg.lu_factor(A - σ * np.eye(n))
        solve = [functools.partial(scipy.linalg.lu_solve, factors, trans=side) for side in (0, 1)]
        V, T, radius = invariant(solve[0], B, σ, count)
        σ, before = max(σ, 0.4142 * radius), σ
    W, _, _ = invariant(solve[1], C.T, before, count)
    W = np.asarray(np.linalg.solve(W.T @ V, W.T).T)
    slow = before * np.eye(len(T)) + np.linalg.inv(T)
    fast = A - V @ ((slow + σ * np.eye(len(T))) @ W.T)  # the slow eigenvalues are moved to −σ
    static = np.asarray(-np.linalg.solve(fast, B - V @ (W.T @ B)))
    return SlowPart(slow, V * scale[:, None], W / scale[:, None], static * scale[:, None])


def invariant(solve: Solve, start: Array, σ: float, count: int) -> tuple[Array, Array, float]:
    """Basis V of the invariant subspace of the slowest states, T with S V = V T, and the largest |λ| it contains."""
    small = 160  # largest number of states for which the whole space serves as Krylov space
    n = len(start)
    size = n if n <= small else 4 * count + 40
    while True:
        Q = np.eye(n) if size >= n else krylov(solve, start, size)
        V, T, slowest = _slowest(Q, Q.T @ solve(Q), σ, count)
        if size >= n or np.linalg.norm(solve(V) - V @ T) < 1e-9 * np.linalg.norm(T):
            return V, T, slowest
        size *= 2


def _slowest(Q: Array, H: Array, σ: float, count: int) -> tuple[Array, Array, float]:
    """Schur vectors of the slowest states in the space of Q, where S is H; and the |λ| of the last of `count`."""
    rigid = 1e-3 * σ  # rounding leaves a double eigenvalue of 0 at 1e-8 … 1e-6 σ: below this |λ|, all are rigid motions
    λ = np.maximum(np.sort(np.abs(σ + 1.0 / np.linalg.eigvals(H))), rigid)
    radius = between(λ, count)
    T, U, kept = scipy.linalg.schur(H, sort=lambda re, im=0.0: abs(σ + 1.0 / complex(re, im)) <= radius)
    return Q @ U[:, :kept], T[:kept, :kept], float(λ[min(count, len(λ)) - 1])


def between(λ: Array, count: int) -> float:
    """A radius between the first `count` of the sorted |λ|, or more if they are nearly equal to further ones."""
    # states whose |λ| differ by less than this part are kept or dropped together
    equal = 1e-6
    while count < len(λ) and λ[count] - λ[count - 1] <= equal * λ[count]:
        count += 1
    return float(np.sqrt(λ[count - 1] * λ[count])) if count < len(λ) else float(2 * λ[-1])


def krylov(solve: Solve, start: Array, size: int) -> Array:
    """Orthonormal basis of S start, S² start, …, and of two fixed further directions with their images, (n, size)."""
    others = np.random.default_rng(0).standard_normal((len(start), 2))
    block = np.linalg.qr(solve(np.hstack([start, others])))[0]
    Q = block
    while Q.shape[1] < size:
        block = solve(block)
        for _ in range(2):
            block -= Q @ (Q.T @ block)
        block = np.linalg.qr(block)[0]
        Q = np.hstack([Q, block])
    return Q[:, :size]


class Balanced(NamedTuple):
    """A balanced model of few states, and the bound of its error."""

    A: Array  # (r, r)
    B: Array  # (r, m)
    C: Array  # (p, r)
    D: Array  # (p, m)
    reduce: Array  # (r, n): x_r = reduce x
    bound: float  # 2 Σ σ_k of the states left out


def balanced_part(A: Array, B: Array, C: Array, D: Array, count: int) -> Balanced:
    """Balanced singular perturbation of a stable system: the states of its `count` largest Hankel singular values σ.

    With Gramians P = L Lᵀ and Q = R Rᵀ, and Rᵀ L = U Σ Vᵀ, the balanced states are Σ^{-1/2} Uᵀ Rᵀ x. The states of the
    smaller σ follow the others at once, so the static gain is kept; the error of the frequency response is at most
    2 Σ σ_k of these (Liu & Anderson, International Journal of Control 50(4), 1989).
    """
    A, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    B, C = B / scale[:, None], C * scale
    L = _root(scipy.linalg.solve_continuous_lyapunov(A, -B @ B.T))
    R = _root(scipy.linalg.solve_continuous_lyapunov(A.T, -C.T @ C))
    U, σ, Vt = np.linalg.svd(R.T @ L)
    # states with smaller σ are below the rounding errors of the Gramians; they are left out altogether
    kept = max(count, int((σ > 1e-7 * σ[0]).sum()))
    down, up = (U[:, :kept] / np.sqrt(σ[:kept])).T @ R.T, L @ (Vt[:kept].T / np.sqrt(σ[:kept]))
    gain, r = D - C @ np.linalg.solve(A, B), count
    A, B, C = down @ A @ up, down @ B, C @ up
    fast = np.linalg.solve(A[r:, r:], np.hstack([A[r:, :r], B[r:]]))
    A, B, C = A[:r, :r] - A[:r, r:] @ fast[:, :r], B[:r] - A[:r, r:] @ fast[:, r:], C[:, :r] - C[:, r:] @ fast[:, :r]
    D = gain + C @ np.linalg.solve(A, B)  # D − C₂ A₂₂⁻¹ B₂, and the gain of the states that are left out altogether
    return Balanced(A, B, C, D, (down / scale)[:r], float(2 * σ[r:].sum()))


def _root(gramian: Array) -> Array:
    """L of a positive semidefinite L Lᵀ."""
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
