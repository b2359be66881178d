"""Branches of a tree in articulated-body recursions: one row of numbers per fork.

In a forward pass the row stores the state from which the branches continue (axes, motion). In a backward pass the row
receives the sum of the branches' articulated inertias and bias forces at the hinge point of the fork's body, in the
working axes of this body (`layout`, `branches`); row 0, of the base, receives nothing. Complex recursions use a complex
view of the rows.
"""

from flexlink.kernels.tools.compiler import inlined, subroutine
from flexlink.kernels.tools.lanes import zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import added, keep
from flexlink.kernels.tools.sym3 import sym_add, sym_apply
from flexlink.kernels.tools.vec3 import add, cross, dot

DEMAND = numbered("J:6 H:9 M:6 n:3 f:3")
FORK_SIZE = 2 * DEMAND.size
"""Number of floats in a row, which can also contain complex numbers, each in two floats."""


@inlined
def over_lever(o, r, H, M):
    """Transfer J, H and M from a point displaced by r to the origin of r: return ΔJ to add to J, and the new H."""
    d1, d2, d3 = (o, -r[2], r[1]), (r[2], o, -r[0]), (-r[1], r[0], o)  # unit vectors × r
    K1, K2, K3 = add(H[0], sym_apply(M, d1)), add(H[1], sym_apply(M, d2)), add(H[2], sym_apply(M, d3))
    ΔJ = (
        dot(d1, H[0]) + dot(d1, K1), dot(d2, H[1]) + dot(d2, K2), dot(d3, H[2]) + dot(d3, K3),
        dot(d3, H[1]) + dot(d2, K3), dot(d3, H[0]) + dot(d1, K3), dot(d2, H[0]) + dot(d1, K2),
    )  # fmt: skip
    return ΔJ, (K1, K2, K3)


@subroutine
def add_inertia_of_branch(forks, k, r, J, H, M):
    """Add the articulated inertia of a branch whose hinge point is displaced by r from the hinge point of its fork."""
    ΔJ, H = over_lever(zero_of(forks, 0, 0), r, H, M)
    keep(forks, k, added(forks, k, (sym_add(J, ΔJ), H, M)))


@subroutine
def add_load_of_branch(forks, k, r, n, f):
    """Add the bias moment and force of a branch whose hinge point is displaced by r, as in `add_inertia_of_branch`."""
    keep(forks, k, added(forks, k, (add(n, cross(r, f)), f), DEMAND.n), DEMAND.n)
