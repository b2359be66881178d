"""Linear solvers for M x = b with small dense M, in place, without calls out of the compiled loop.

Rounding turns a singular M into a regular one, whose solution is finite and wrong. A second right-hand side detects
this: e_k = ±√M_kk, with signs chosen during the elimination so that its solution z grows most (Cline, Moler, Stewart &
Wilkinson 1979). With M = D H D, D_kk = √M_kk, the growth Σ √M_kk |z_k| estimates 1/λ_min(H). The relative rounding
error of x is at most n eps / λ_min (Demmel 1989; Higham 2002, theorem 10.6). If this bound reaches 1, x is set to nan.
"""

import math

import numpy as np

from flexlink.kernels.tools.compiler import entry, inlined, shared

EPS = 2.0**-52


@inlined
def begin_probe(A, probe):
    """Write √A_kk, by column and by row, into `probe`, (3, n)."""
    for k in range(len(A)):
        probe[0, k] = probe[1, k] = np.sqrt(A[k, k])


@inlined
def end_probe(b, probe):
    """Set b to nan if the growth of the probe shows that the solution may be all rounding error."""
    growth = 0.0
    for k in range(len(b)):
        growth += probe[0, k] * abs(probe[2, k])
    if not len(b) * EPS * growth < 1.0:
        b[:] = np.nan


@shared
@entry
def solve_lu(A, b, probe):
    """Solve A x = b, A symmetric positive definite, by LU with partial pivoting (the paper's method).

    Overwrites A; the result is in b, nan if A is singular to rounding; `probe` (3, n) is scratch.
    """
    n, z = len(b), probe[2]
    begin_probe(A, probe)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            b[k], b[pivot] = b[pivot], b[k]
            probe[1, k], probe[1, pivot] = probe[1, pivot], probe[1, k]
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            A[i, k] = factor
            for j in range(k + 1, n):
                A[i, j] -= factor * A[k, j]
    for i in range(n):
        total, rest = b[i], 0.0
        for k in range(i):
            total -= A[i, k] * b[k]
            rest -= A[i, k] * z[k]
        b[i], z[i] = total, rest + math.copysign(probe[1, i], rest)
    for i in range(n - 1, -1, -1):
        total, rest = b[i], z[i]
        for k in range(i + 1, n):
            total -= A[i, k] * b[k]
            rest -= A[i, k] * z[k]
        b[i], z[i] = total / A[i, i], rest / A[i, i]
    end_probe(b, probe)


@entry
def solve_cholesky(A, b, probe):
    """Solve like `solve_lu`, but by A = L Lᵀ; the result is also nan if A is not positive definite."""
    n, z = len(b), probe[2]
    begin_probe(A, probe)
    for j in range(n):
        for i in range(j, n):
            total = A[i, j]
            for k in range(j):
                total -= A[i, k] * A[j, k]
            A[i, j] = np.sqrt(total) if i == j else total / A[j, j]
    for i in range(n):
        total, rest = b[i], 0.0
        for k in range(i):
            total -= A[i, k] * b[k]
            rest -= A[i, k] * z[k]
        b[i], z[i] = total / A[i, i], (rest + math.copysign(probe[1, i], rest)) / A[i, i]
    for i in range(n - 1, -1, -1):
        total, rest = b[i], z[i]
        for k in range(i + 1, n):
            total -= A[k, i] * b[k]
            rest -= A[k, i] * z[k]
        b[i], z[i] = total / A[i, i], rest / A[i, i]
    end_probe(b, probe)
