"""Where A of cells of coupled springs stands beside the factors of a hinge, for a plane and for space alike."""

from flexlink.kernels.tools.compiler import kernel, subroutine
from flexlink.kernels.tools.numbered import numbered

COUPLED = numbered("inertia L", start=8)
"""Numbers of a hinge k behind its factors: the inertia that it turns, without rotors; then, of every hinge j before it
in its cell, A_kj, which becomes L_kj."""


@kernel
def columns(first):
    """Numbers of a hinge's row of factors, for cells that begin at `first` (n,)."""
    if len(first) == 0:
        return COUPLED.inertia
    longest = 0
    for k in range(len(first)):
        longest = max(longest, k - first[k])
    return COUPLED.L + longest


@subroutine
def put_couplings(u, v, couplings, factors, first):
    """A_kj = u D_kj + v K_kj of every two hinges of a cell."""
    for k in range(len(first)):
        for j in range(COUPLED.L, factors.shape[1]):
            factors[k, j] = 0.0
    for c in range(len(couplings)):
        pair = couplings[c]
        place = COUPLED.L + pair.inner - first[pair.outer]
        factors[pair.outer, place] = u * pair.damping + v * pair.stiffness


@subroutine
def add_products(u, v, couplings, x, r):
    """r += (u D + v K) x, of couplings alone."""
    for c in range(len(couplings)):
        pair = couplings[c]
        held = u * pair.damping + v * pair.stiffness
        r[pair.inner] += held * x[pair.outer]
        r[pair.outer] += held * x[pair.inner]
