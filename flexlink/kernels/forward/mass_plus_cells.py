"""Columns of a hinge's row of factors for cells of coupled springs, in planar and in spatial chains."""

import numpy as np

from flexlink.kernels.tools.compiler import allocating, kernel, subroutine
from flexlink.kernels.tools.numbered import numbered

FACTORS = numbered("A inverse others:6")  # of a hinge: A, 1 / D, and factors that differ between plane and space
COUPLED = numbered("inertia L", start=8)
"""Columns of hinge k after its factors: the inertia that it moves, without rotors; then A_kj for every hinge j before
it in its cell, which becomes L_kj."""


@kernel
def columns(first):
    """Number of columns of the factors for cells that begin at the hinges `first` (n,)."""
    if first is None or len(first) == 0:
        return COUPLED.inertia
    longest = 0
    for k in range(len(first)):
        longest = max(longest, k - first[k])
    return COUPLED.L + longest


@allocating
def rows_beside(first, rare):
    """K_kj and D_kj, (n, w, 2), of every hinge k and every hinge j before it in its cell; None for a plain chain."""
    if rare is None:
        return None
    rows = np.zeros((len(first), columns(first) - COUPLED.L, 2)) if len(first) > 0 else np.zeros((0, 0, 2))
    for pair in rare.couplings:
        row = rows[pair.outer, pair.inner - first[pair.outer]]
        row[0], row[1] = row[0] + pair.stiffness, row[1] + pair.damping
    return rows


@subroutine
def put_couplings(u, v, coupled, factors):
    """Write A_kj = u D_kj + v K_kj for all pairs of hinges of a cell; K and D from `rows_beside`."""
    for k in range(coupled.shape[0]):
        for j in range(coupled.shape[1]):
            factors[k, COUPLED.L + j] = u * coupled[k, j, 1] + v * coupled[k, j, 0]


@subroutine
def add_products(u, v, rare, x, r):
    """r += (u D + v K) x, for the couplings alone."""
    for pair in rare.couplings:
        held = u * pair.damping + v * pair.stiffness
        r[pair.inner] += held * x[pair.outer]
        r[pair.outer] += held * x[pair.inner]
