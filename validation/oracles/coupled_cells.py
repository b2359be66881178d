"""Bending frequencies of a clamped chain of cells, each with p coupled springs, to 40 digits, without the library.

EI = ρA = L = 1. The coordinates of a cell of length h are the beam's angles θ(t_k) at its p + 1 Gauss-Lobatto nodes.
The segment of node k has length h b_k, with b the weights; the two segments at a cell boundary are one. Springs act on
the derivative of the interpolating polynomial at the p Gauss points with weights w_q:

    K = Cᵀ diag(w) C / h        C_qj = Σ_k≥j L_k'(x_q)

The mass of a segment is its length; its centre is at a distance S_i − s_i from its hinge, with S_i its end and s_i its
node. Its inertia is such that a rigidly rotating beam has the exact kinetic energy: the mass matrix A for the angles of
the segments, of lengths l_i, has Σ_j A_ij = l_i ∫ min(1 − s_i, 1 − x) dx. The inertia `tip` m l²/3 is then moved from
the second last segment to the last.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from mpmath import mp, mpf

from flexlink.common.types import Array

DIGITS = 40


def frequencies(p: int, hinges: int, tip: float) -> Array:
    """All natural angular frequencies, slowest first."""
    with mp.workdps(DIGITS):
        lower = mp.matrix(hinges + 1, hinges)
        for i, j in itertools.product(range(hinges + 1), range(hinges)):
            lower[i, j] = mpf(i > j)  # maps the angles of hinges to the angles of segments
        M = lower.T * _mass(p, hinges, tip) * lower
        inverse = mp.inverse(mp.cholesky(_stiffness(p, hinges)))
        S = inverse * M * inverse.T
        return np.array(sorted(float(1 / mp.sqrt(value)) for value in mp.eigsy((S + S.T) / 2, eigvals_only=True)))


def _stiffness(p: int, hinges: int) -> Any:
    cells, nodes = hinges // p, _lobatto(p)
    points = [(1 + x) / 2 for x in _roots(mp.taylor(lambda x: mp.legendre(p, x), 0, p))]
    C = mp.matrix(p)
    for (q, x), j in itertools.product(enumerate(points), range(p)):
        C[q, j] = mp.fsum(mp.diff(lambda t, k=k: _lagrange(nodes, k, t), x) for k in range(j + 1, p + 1))
    K = mp.zeros(hinges)
    block = C.T * mp.diag([_weight(points, k) for k in range(p)]) * C * cells
    for e, i, j in itertools.product(range(cells), range(p), range(p)):
        K[e * p + i, e * p + j] = block[i, j]
    return K


def _mass(p: int, hinges: int, tip: float) -> Any:
    """Mass matrix A for the angles of all segments, including the one at the root."""
    cells, nodes = hinges // p, _lobatto(p)
    s, l = [mpf(0)] * (hinges + 1), [mpf(0)] * (hinges + 1)
    for e, k in itertools.product(range(cells), range(p + 1)):
        s[e * p + k] = (e + nodes[k]) / cells
        l[e * p + k] += _weight(nodes, k) / cells
    ends = list(itertools.accumulate(l))
    beyond = [1 - end for end in ends]  # mass outboard of each segment, with ρA = 1
    centre = [end - place for end, place in zip(ends, s, strict=True)]
    A = mp.zeros(hinges + 1)
    for i in range(hinges + 1):
        A[i, i] = l[i] * centre[i] ** 2 + l[i] ** 2 * beyond[i]
        for j in range(i + 1, hinges + 1):
            A[i, j] = A[j, i] = l[i] * (l[j] * centre[j] + l[j] * beyond[j])
    own = [l[i] * (1 - s[i] ** 2) / 2 - mp.fsum(A[i, j] for j in range(hinges + 1)) for i in range(hinges + 1)]
    given = mpf(tip) * l[-1] ** 3 / 3
    own[-1], own[-2] = own[-1] + given, own[-2] - given
    return A + mp.diag(own)


def _lobatto(p: int) -> list[Any]:
    """Gauss-Lobatto nodes on [0, 1]."""
    P = mp.taylor(lambda x: mp.legendre(p, x), 0, p)
    inner = _roots([k * P[k] for k in range(1, p + 1)])
    return [mpf(0), *((1 + x) / 2 for x in inner), mpf(1)]


def _roots(coefficients: list[Any]) -> list[Any]:
    """Roots of a polynomial with only real roots; coefficients start at the lowest power."""
    first = np.sort(np.polynomial.Polynomial([float(c) for c in coefficients]).roots().real)
    return [mp.findroot(lambda x: mp.fsum(c * x**k for k, c in enumerate(coefficients)), mpf(x)) for x in first]


def _lagrange(nodes: list[Any], k: int, t: Any) -> Any:
    return mp.fprod((t - x) / (nodes[k] - x) for j, x in enumerate(nodes) if j != k)


def _weight(nodes: list[Any], k: int) -> Any:
    """Weight of node k in the quadrature on [0, 1] that is exact for Lagrange's polynomials."""
    return mp.quad(lambda t: _lagrange(nodes, k, t), [0, 1])
