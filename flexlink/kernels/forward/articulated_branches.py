"""Branches of a tree in recursions of articulated bodies: a row of numbers for every fork.

Outward a row holds the state that branches go on from, inward the sum of what they demand at the fork's hinge point,
in the working axes of its body (`layout`, `branches`). Seen as complex numbers they serve complex ones, too.
"""

from flexlink.kernels.tools.compiler import inlined, subroutine
from flexlink.kernels.tools.lanes import put_at, put_vec_of, vec_of, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sym3 import sym_add, sym_apply, sym_of
from flexlink.kernels.tools.vec3 import add, cross, dot

STATE = numbered("x:3 y:3 z:3 ω:3 f:3 n:3")
MOTION = numbered("α:3 a:3")
DEMAND = numbered("J:6 H:9 M:6 n:3 f:3")
FORK_SIZE = 2 * DEMAND.size
"""Numbers of a row: floats, or half as many complex ones."""


@subroutine
def clear(forks):
    """Nothing is demanded yet; nobody asks what is demanded of the base, row 0."""
    for k in range(1, len(forks)):
        for j in range(DEMAND.size):
            put_at(forks, zero_of(forks, 0, 0), k, j)


@subroutine
def keep_axes(forks, k, x, y, z):
    """Keep the axes of a fork."""
    put_vec_of(forks, x, k, STATE.x)
    put_vec_of(forks, y, k, STATE.y)
    put_vec_of(forks, z, k, STATE.z)


@subroutine
def keep_motion(forks, k, α, a):
    """Keep how a fork and its hinge point accelerate, or move."""
    put_vec_of(forks, α, k, MOTION.α)
    put_vec_of(forks, a, k, MOTION.a)


@inlined
def motion_of(forks, k):
    """What `keep_motion` has kept."""
    return vec_of(forks, k, MOTION.α), vec_of(forks, k, MOTION.a)


@subroutine
def keep_state(forks, k, x, y, z, ω, f, n):
    """Keep axes, angular velocity and demand of the tip at a fork."""
    keep_axes(forks, k, x, y, z)
    put_vec_of(forks, ω, k, STATE.ω)
    put_vec_of(forks, f, k, STATE.f)
    put_vec_of(forks, n, k, STATE.n)


@inlined
def state_of(forks, k):
    """What `keep_state` has kept."""
    x, y, z = vec_of(forks, k, STATE.x), vec_of(forks, k, STATE.y), vec_of(forks, k, STATE.z)
    return x, y, z, vec_of(forks, k, STATE.ω), vec_of(forks, k, STATE.f), vec_of(forks, k, STATE.n)


@inlined
def over_lever(o, r, H, M):
    """What J and H, the latter as a whole, become at a point from which the old one is r away: J + ΔJ, H; o is zero."""
    d1, d2, d3 = (o, -r[2], r[1]), (r[2], o, -r[0]), (-r[1], r[0], o)  # unit vectors × r
    K1, K2, K3 = add(H[0], sym_apply(M, d1)), add(H[1], sym_apply(M, d2)), add(H[2], sym_apply(M, d3))
    ΔJ = (
        dot(d1, H[0]) + dot(d1, K1), dot(d2, H[1]) + dot(d2, K2), dot(d3, H[2]) + dot(d3, K3),
        dot(d3, H[1]) + dot(d2, K3), dot(d3, H[0]) + dot(d1, K3), dot(d2, H[0]) + dot(d1, K2),
    )  # fmt: skip
    return ΔJ, (K1, K2, K3)


@subroutine
def add_inertia_of_branch(forks, k, r, J, H, M):
    """Add what a branch whose hinge point is r away from that of its fork demands per acceleration."""
    ΔJ, H = over_lever(zero_of(forks, 0, 0), r, H, M)
    J, H, M = with_inertia_of_branches(forks, k, sym_add(J, ΔJ), H, M)
    for j in range(3):
        put_vec_of(forks, H[j], k, DEMAND.H + 3 * j)
    for j in range(6):
        put_at(forks, J[j], k, DEMAND.J + j)
        put_at(forks, M[j], k, DEMAND.M + j)


@subroutine
def add_load_of_branch(forks, k, r, n, f):
    """Add the moment and the force that a branch demands at rest."""
    n, f = with_load_of_branches(forks, k, add(n, cross(r, f)), f)
    put_vec_of(forks, n, k, DEMAND.n)
    put_vec_of(forks, f, k, DEMAND.f)


@inlined
def inertia_of_branches(forks, k):
    """J, H and M that all branches at a fork have together."""
    H = vec_of(forks, k, DEMAND.H), vec_of(forks, k, DEMAND.H + 3), vec_of(forks, k, DEMAND.H + 6)
    return sym_of(forks, k, DEMAND.J), H, sym_of(forks, k, DEMAND.M)


@inlined
def load_of_branches(forks, k):
    """n and f that all branches at a fork have together."""
    return vec_of(forks, k, DEMAND.n), vec_of(forks, k, DEMAND.f)


@subroutine
def with_inertia_of_branches(forks, k, J, H, M):
    """J, H and M at a fork, with those of its branches."""
    J1, H1, M1 = inertia_of_branches(forks, k)
    return sym_add(J, J1), (add(H[0], H1[0]), add(H[1], H1[1]), add(H[2], H1[2])), sym_add(M, M1)


@subroutine
def with_load_of_branches(forks, k, n, f):
    """n and f at a fork, with those of its branches."""
    n1, f1 = load_of_branches(forks, k)
    return add(n, n1), add(f, f1)
