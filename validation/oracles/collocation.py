"""Radau IIA and Gauss in mpmath: nodes are eigenvalues of Jacobi matrices; A and b follow from collocation.

Golub & Welsch (1969): the zeros of Legendre's polynomial P_s are the eigenvalues of the symmetric tridiagonal matrix of
its recurrence, with off-diagonal β_k = k / √(4k² − 1) and zero diagonal. Golub (1973): with the last diagonal element

    1 − β_s−1² p_s−2(1) / p_s−1(1)          p_k the polynomials with leading coefficient 1

one eigenvalue is 1, and the eigenvalues are Radau's nodes c_i on [−1, 1]. On [0, 1], A and b follow from the conditions
Σ_j a_ij c_j^(k−1) = c_i^k / k and Σ_j b_j c_j^(k−1) = 1 / k.
"""

from __future__ import annotations

from typing import Any

from mpmath import mp, mpf

Row = list[Any]


def collocation(family: str, stages: int) -> tuple[list[Row], Row, Row]:
    """A, b, c of "Gauss" or "Radau IIA", in mpmath's working precision."""
    c = _nodes(family == "Radau IIA", stages)
    powers = mp.matrix([[x**k for x in c] for k in range(stages)])
    rows = [list(mp.lu_solve(powers, mp.matrix([x ** (k + 1) / (k + 1) for k in range(stages)]))) for x in (*c, mpf(1))]
    return rows[:-1], rows[-1], c


def _nodes(ends_at_one: bool, stages: int) -> Row:
    """Nodes on [0, 1], ascending."""
    jacobi = mp.zeros(stages)
    for k in range(1, stages):
        jacobi[k, k - 1] = jacobi[k - 1, k] = k / mp.sqrt(4 * mpf(k) ** 2 - 1)
    if ends_at_one:
        last = stages - 1  # p_k(1) = 2^k k!² / (2k)!, hence p_k−1(1) / p_k(1) = (2k − 1) / k
        jacobi[last, last] = 1 - jacobi[last, last - 1] ** 2 * (2 * mpf(last) - 1) / last
    return sorted((1 + x) / 2 for x in mp.eigsy(jacobi, eigvals_only=True))
