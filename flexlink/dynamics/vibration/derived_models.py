"""Linear models derived from others: sampled by a digital controller, or with fewer states.

Samples are taken with zero-order hold, and with delays of inputs and outputs:

    x_k+1 = Φ x_k + Γ_r u_k-m + Γ_f u_k-m-1        delay of the inputs = (m + f) T,   0 ≤ f < 1

u_k is computed at t_k = k T. During the first part f T of a period u_k-m-1 still acts, during the rest u_k-m (Franklin,
Powell and Workman, Digital Control of Dynamic Systems, 1998, section 4.3). Inputs on their way are states, as are the
last values of delayed outputs. All of it is exact: Φ and Γ follow from matrix exponentials.
"""

import functools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.common.types import Array
from flexlink.describe.numbers import is_whole


class Delay(NamedTuple):
    """A delay of `whole` sampling periods and a `part` of one, 0 ≤ part < 1."""

    whole: int
    part: float

    @property
    def samples(self) -> int:
        """Number of values that are on their way."""
        return self.whole + (self.part > 0.0)


def delay_in(period: float, delay: float) -> Delay:
    """A delay [s] in sampling periods [s]; whole if it differs from a whole number only by rounding."""
    periods = delay / period
    if is_whole(periods):
        return Delay(round(periods), 0.0)
    return Delay(math.floor(periods), periods - math.floor(periods))


def held(A: Array, B: Array, period: float, late: Sequence[Delay], time: float) -> tuple[Array, list[Array]]:
    """Φ and Γ_i of the state Φ x_k + Σ_i Γ_i (u_k, u_k-1, …, u_k-samples)_i after a `time` ≤ `period` [s] from t_k on.

    `late` contains the delay of each input i; Γ_i has shape (n, samples_i + 1).
    """
    n, m = B.shape
    both = np.zeros((n + m, n + m))
    both[:n] = np.hstack([A, B])
    Φ, Γ = np.eye(n), [np.zeros((n, each.samples + 1)) for each in late]
    for part in sorted({each.part for each in late} or {0.0}):
        switch = min(part * period, time)  # from here on u_k-whole acts, until then u_k-whole-1
        first, rest = (scipy.linalg.expm(both * t) if t else np.eye(n + m) for t in (switch, time - switch))
        Φ = rest[:n, :n] @ first[:n, :n]
        for i, each in enumerate(late):
            if each.part == part:
                Γ[i][:, each.whole] = rest[:n, n + i]
                if part:
                    Γ[i][:, each.whole + 1] = rest[:n, :n] @ first[:n, n + i]
    return Φ, Γ


def with_queue(A: Array, B: Array, period: float, late: Sequence[Delay]) -> tuple[Array, Array]:
    """Matrices of the state (x_k, u_k-1 … u_k-samples of input 1, of input 2, …) from instant to instant."""
    n, m = B.shape
    Φ, Γ = held(A, B, period, late, period)
    size = n + sum(each.samples for each in late)
    found, by_input = np.zeros((size, size)), np.zeros((size, m))
    found[:n, :n], at = Φ, n
    for i, each in enumerate(late):
        by_input[:n, i], queue = Γ[i][:, 0], slice(at, at := at + each.samples)
        if each.samples:
            found[:n, queue], by_input[queue.start, i] = Γ[i][:, 1:], 1.0
            found[queue, queue] = np.eye(each.samples, k=-1)
    return found, by_input


Matrices = tuple[Array, Array, Array, Array]  # A, B, C, D of a linear system


def discrete(matrices: Matrices, period: float, delay: ArrayLike, delays: Array) -> tuple[Matrices, list[int]]:
    """Sampled system A, B, C, D with a `period` [s], its inputs late by `delay` and each output by `delays` (p,) [s].

    `delay` is one number or one per input. Returns also the number of states of each output's queue, shape (p,). The
    states are x, then the queue of each input (`with_queue`), then the queue of each output, the newest value first.
    """
    A, B, C, D = matrices
    late = [delay_in(period, each) for each in np.broadcast_to(delay, B.shape[1]).tolist()]
    outputs = [delay_in(period, each) for each in delays.tolist()]
    inner, by_input = with_queue(A, B, period, late)
    queues = [each.samples for each in outputs]
    size, m = len(inner) + sum(queues), B.shape[1]
    Φ, Γ, H, J = (np.zeros(shape) for shape in ((size, size), (size, m), (len(C), size), (len(C), m)))
    Φ[: len(inner), : len(inner)], Γ[: len(inner)] = inner, by_input
    times = [(1.0 - each.part) * period if each.part else 0.0 for each in outputs]
    values = {time: _values((A, B, C, D), period, late, time) for time in set(times)}
    at = len(inner)
    for j, (each, time) in enumerate(zip(outputs, times, strict=True)):
        by_state, by_new = values[time]
        if not each.samples:
            J[j], H[j, : len(inner)] = by_new[j], by_state[j]
            continue
        Γ[at], Φ[at, : len(inner)] = by_new[j], by_state[j]
        Φ[at + 1 : at + each.samples, at : at + each.samples - 1] = np.eye(each.samples - 1)
        at += each.samples
        H[j, at - 1] = 1.0
    return (Φ, Γ, H, J), queues


def _values(matrices: Matrices, period: float, late: Sequence[Delay], time: float) -> tuple[Array, Array]:
    """Coefficients of y = C x + D u at t_k + `time`, for the state of `with_queue`, and for the newest inputs u_k."""
    A, B, C, D = matrices
    Φ, Γ = held(A, B, period, late, time)
    columns = [C @ each for each in Γ]
    for i, each in enumerate(late):
        columns[i][:, each.whole + (time < each.part * period)] += D[:, i]
    newest = np.column_stack([each[:, 0] for each in columns]) if columns else np.zeros((len(C), 0))
    return np.hstack([C @ Φ, *(each[:, 1:] for each in columns)]), newest


# Modal truncation of linear systems, with the static gain kept.
#
# The slow states span an invariant subspace V of A, with left counterpart W: Wᵀ A V = A_r, Wᵀ V = 1. Fast states follow
# the inputs at once, by their static response:
#
#     ẋ_r = A_r x_r + Wᵀ B u        y = C V x_r + (D − C P A⁻¹ B) u        P = 1 − V Wᵀ
#
# V comes from a Krylov space of S = (A − σ)⁻¹, in orthonormal Schur vectors and not in eigenvectors, so that rigid
# motions, whose double eigenvalue 0 has one eigenvector, do no harm (Antoulas, Approximation of Large-Scale Dynamical
# Systems, 2005, sections 9.2 and 11.2).


Solve = Callable[[Array], Array]  # S x, or Sᵀ x, for columns x


def slow_part(A: Array, B: Array, C: Array, count: int) -> tuple[Array, Array, Array, Array]:
    """A_r (r, r), V and W (n, r) of the slow part x = V x_r, x_r = Wᵀ x; −P A⁻¹ B (n, m), the static rest.

    These are the `count` slowest states, or more where states of equal |λ| would be parted, such as complex pairs.
    """
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
    return (slow, V * scale[:, None], W / scale[:, None], static * scale[:, None])


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
    block = np.linalg.qr(solve(np.hstack([start, np.random.default_rng(0).standard_normal((len(start), 2))])))[0]
    Q = block
    while Q.shape[1] < size:
        block = solve(block)
        for _ in range(2):
            block -= Q @ (Q.T @ block)
        block = np.linalg.qr(block)[0]
        Q = np.hstack([Q, block])
    return Q[:, :size]


def balanced_part(A: Array, B: Array, C: Array, D: Array, count: int) -> tuple[Matrices, Array, float]:
    """Balanced singular perturbation of a stable system: the states of its `count` largest Hankel singular values σ.

    With Gramians P = L Lᵀ and Q = R Rᵀ, and Rᵀ L = U Σ Vᵀ, the balanced states are Σ^{-1/2} Uᵀ Rᵀ x. The states of the
    smaller σ follow the others at once, so the static gain is kept; the error of the frequency response is at most
    2 Σ σ_k of these (Liu & Anderson, International Journal of Control 50(4), 1989), which is returned after the
    matrices and after the matrix that reduces x.
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
    return (A, B, C, D), (down / scale)[:r], float(2 * σ[r:].sum())


def _root(gramian: Array) -> Array:
    """L of a positive semidefinite L Lᵀ."""
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
