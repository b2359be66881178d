"""Estimates of the largest and smallest frequency of a chain by power iteration, O(n) per iteration.

    fastest     φ ← M⁻¹ W φ        W φ = λ M φ, W diagonal except for couplings, prescribed joints at rest
    slowest     φ ← K⁻¹ S φ        K φ = ω² S φ on the joints with springs, S = M_pp − M_pa M_aa⁺ M_ap

S is the Schur complement of M for the free joints a, which follow the others without torque: φ_a = −M_aa⁺ M_ap φ_p.
M_aa is singular if a stretched arm moves only a point mass. Any inverse on the range of M_aa is correct, since M_ap φ_p
lies in this range.
"""

import math

import numpy as np

from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.forces.couplings import factor_springs, solve_springs
from flexlink.kernels.forward.mass_plus import factor, factor_columns, place_bodies, solve
from flexlink.kernels.forward.mass_plus_cells import FACTORS
from flexlink.kernels.tools.compiler import kernel, recursion
from flexlink.kernels.tools.finite import largest
from flexlink.kernels.tools.vec3 import ZERO

EPS = 2.0**-52


@kernel
def largest_eigenvalue(chain, q, weights, coupled, passes, close, posture):
    """Estimate the largest λ of W φ = λ M φ from below; stop after `passes` iterations or at a change ≤ `close` λ.

    `weights` (n,) are the diagonal of W, `coupled` (couplings,) its other elements; `posture` is scratch. The result is
    not finite if M is singular.
    """
    n, last = len(q), 0.0
    φ, r, factors = np.zeros(n), np.zeros(n), np.zeros((n, factor_columns(posture)))
    for k in range(n):
        φ[k], factors[k, FACTORS.A] = 2 * (k % 2) - 1, chain.hinges[k].armature
    place_bodies(q, posture)
    factor(factors, posture)
    for _ in range(passes):
        for k in range(n):
            r[k] = weights[k] * φ[k]
        if chain.rare is not None:
            for c in range(len(coupled)):
                pair = chain.rare.couplings[c]
                r[pair.inner] += coupled[c] * φ[pair.outer]
                r[pair.outer] += coupled[c] * φ[pair.inner]
        solve(factors, r, φ, posture)
        size = largest(φ)
        if not size < math.inf or abs(size - last) <= close * size:
            return size
        last = size
        for k in range(n):
            φ[k] /= size
    return last


@kernel
def smallest_square(chain, q, passes, close):
    """Estimate the smallest ω² of K φ = ω² S φ from above, as in `largest_eigenvalue`; inf without springs."""
    bent, free = joints_of(chain, True), joints_of(chain, False)
    n, p, a, last = len(q), len(bent), len(free), 0.0
    if p == 0:
        return math.inf
    φ, none, M_a, M_aa, x, y = np.zeros(n), np.zeros(6), np.zeros((a, n)), np.zeros((a, a)), np.zeros(a), np.zeros(a)
    zero, torque, order, work = np.zeros(n), np.zeros(n), np.zeros(a, np.int64), rne_workspace(chain)
    for i in range(a):
        φ[free[i]] = 1.0
        rne(chain, ZERO, none, q, zero, φ, M_a[i], work)
        φ[free[i]] = 0.0
        for j in range(a):
            M_aa[i, j] = M_a[i, free[j]]
    rank, springs, bends = factor_semidefinite(M_aa, order), factor_springs(chain, bent), np.zeros(p)
    for i in range(p):
        φ[bent[i]] = 1.0
    for _ in range(passes):
        for j in range(a):
            x[j] = 0.0
            for i in range(p):
                x[j] -= M_a[j, bent[i]] * φ[bent[i]]
        solve_semidefinite(M_aa, order, rank, x, y)
        for j in range(a):
            φ[free[j]] = x[j]
        rne(chain, ZERO, none, q, zero, φ, torque, work)
        elastic, inertial, size = 0.0, 0.0, 0.0
        for i in range(p):
            k = bent[i]
            elastic += φ[k] * (chain.hinges[k].stiffness * φ[k])
            inertial += φ[k] * torque[k]
            bends[i] = torque[k]
        if chain.rare is not None:
            coupled = 0.0  # Σ 2 K_ij φ_i φ_j: prescribed joints are at rest
            for pair in chain.rare.couplings:
                coupled += 2.0 * pair.stiffness * φ[pair.inner] * φ[pair.outer]
            elastic += coupled
        solve_springs(springs, bends)
        for i in range(p):
            size = max(size, abs(bends[i]))
        square = elastic / inertial
        if not abs(square - last) > close * square:
            return square
        last = square
        for i in range(p):
            φ[bent[i]] = bends[i] / size
    return last


@kernel
def joints_of(chain, springs):
    """Indices of the joints with springs or, if `springs` is False, without springs; prescribed joints are excluded."""
    hinges = chain.hinges
    return np.flatnonzero(((hinges["stiffness"] > 0.0) == springs) & (hinges["prescribed"] == 0))


@recursion
def factor_semidefinite(A, order):
    """P A Pᵀ = L Lᵀ by Cholesky's method with the largest pivot first; returns the rank r. L is in the first r columns.

    `order` (n,) receives the row of A for each row of L. Ends when all remaining pivots are rounding errors.
    """
    n = len(A)
    for i in range(n):
        order[i] = i
    for j in range(n):
        pivot = j
        for i in range(j + 1, n):
            if A[i, i] > A[pivot, pivot]:
                pivot = i
        if j == 0:
            least = n * EPS * A[pivot, pivot]
        if not A[pivot, pivot] > least:
            return j
        order[j], order[pivot] = order[pivot], order[j]
        for i in range(n):
            A[j, i], A[pivot, i] = A[pivot, i], A[j, i]
        for i in range(n):
            A[i, j], A[i, pivot] = A[i, pivot], A[i, j]
        A[j, j] = math.sqrt(A[j, j])
        for i in range(j + 1, n):
            A[i, j] /= A[j, j]
        for i in range(j + 1, n):
            for k in range(j + 1, n):
                A[i, k] -= A[i, j] * A[k, j]
    return n


@recursion
def solve_semidefinite(L, order, rank, x, y):
    """Overwrite b in `x` with a solution of A x = b (0 where L has no pivot); b must be in A's range, `y` (n,) zero."""
    for i in range(rank):
        y[i] = x[order[i]]
        for k in range(i):
            y[i] -= L[i, k] * y[k]
        y[i] /= L[i, i]
    for i in range(rank - 1, -1, -1):
        for k in range(i + 1, rank):
            y[i] -= L[k, i] * y[k]
        y[i] /= L[i, i]
    for i in range(len(x)):
        x[order[i]] = y[i]
