"""Where A of cells of coupled springs stands beside the factors of a hinge, for a plane and for space alike."""

import numpy as np

from flexlink.kernels.tools.compiler import kernel, subroutine
from flexlink.kernels.tools.numbered import numbered

COUPLED = numbered("inertia L", start=8)
"""Numbers of a hinge k behind its factors: the inertia that it turns, without rotors; then, of every hinge j before it
in its cell, A_kj, which becomes L_kj."""


@kernel
def columns(first):
    """Numbers of a hinge's row of factors, for cells that begin at `first` (n,)."""
    if first is None or len(first) == 0:
        return COUPLED.inertia
    longest = 0
    for k in range(len(first)):
        longest = max(longest, k - first[k])
    return COUPLED.L + longest


@kernel
def rows_beside(first, rare):
    """K_kj and D_kj of every hinge k and those before it in its cell, (n, w, 2), for `put_couplings`; None: plain."""
    if rare is None:
        return None
    couplings = rare.couplings
    rows = np.zeros((len(first), columns(first) - COUPLED.L, 2)) if len(first) > 0 else np.zeros((0, 0, 2))
    for c in range(len(couplings)):
        pair = couplings[c]
        row = rows[pair.outer, pair.inner - first[pair.outer]]
        row[0], row[1] = row[0] + pair.stiffness, row[1] + pair.damping
    return rows


@subroutine
def put_couplings(u, v, beside, factors):
    """A_kj = u D_kj + v K_kj of every two hinges of a cell, from `rows_beside`."""
    for k in range(beside.shape[0]):
        for j in range(beside.shape[1]):
            factors[k, COUPLED.L + j] = u * beside[k, j, 1] + v * beside[k, j, 0]


@subroutine
def add_products(u, v, rare, x, r):
    """r += (u D + v K) x, of couplings alone."""
    couplings = rare.couplings
    for c in range(len(couplings)):
        pair = couplings[c]
        held = u * pair.damping + v * pair.stiffness
        r[pair.inner] += held * x[pair.outer]
        r[pair.outer] += held * x[pair.inner]
