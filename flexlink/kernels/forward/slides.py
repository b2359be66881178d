"""Prismatic hinges in the articulated-body algorithm, all hinges of a body in one call.

Force and moment swap roles, and so do acceleration and angular acceleration. With U = H e and G = M e in place of
J e and Hᵀ e:

    D = e·G + A      q̈ = (T − e·f − U·α − G·a) / D      J ← J − U Uᵀ/D      H ← H − U Gᵀ/D      M ← M − G Gᵀ/D

The hinge point of the body moves: r ← r + e q, and b ← b + ω × (ω × e q) + 2 q̇ ω × e.
"""

from flexlink.kernels.forward.articulated_groups import eliminate_joint, missing_torque, propagate_prescribed, swung
from flexlink.kernels.forward.articulated_layout import LAYOUT
from flexlink.kernels.forward.articulated_rows import BODY_ROW, HINGE_ROW
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import pick
from flexlink.kernels.tools.compiler import inlined, subroutine
from flexlink.kernels.tools.lanes import at, put_at, put_vec_of, vec_of, zero_of
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, scale


@subroutine
def put_slides(layout, i, axes, bodies, hinges, x, y, z, ω, places, qd):
    """Store the axes of the prismatic hinges of body `i` with axes x, y, z, and update its r and b."""
    r, b = vec_of(bodies, i, BODY_ROW.r), vec_of(bodies, i, BODY_ROW.b)
    for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
        e = pick(axes[k] - SLIDES, x, y, z)
        put_vec_of(hinges, e, k, HINGE_ROW.axis)
        r = add_scaled(r, at(places, k), e)
        b = add_scaled(add(b, swung(ω, scale(at(places, k), e))), 2.0 * at(qd, k), cross(ω, e))
    keep(bodies, i, (r, b), BODY_ROW.r)


@subroutine
def eliminate_slides(layout, i, axes, prescribed, hinges, qdd, J, H, M, n, f):
    """Return J, H, M, n, f inboard of the hinges of body `i`, given them outboard; a given q̈ adds to n and f."""
    H = transposed(H)
    for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
        if prescribed[k]:
            f, n = propagate_prescribed(hinges, k, at(qdd, k), M, H, f, n)
        else:
            again = k + 1 < layout[i, LAYOUT.stop] and axes[k] == axes[k + 1] and not prescribed[k + 1]
            M, H, J, f, n = eliminate_joint(hinges, k, again, M, H, J, f, n)
    for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
        G, U = vec_of(hinges, k, HINGE_ROW.Je), vec_of(hinges, k, HINGE_ROW.He)
        keep(hinges, k, (U, G), HINGE_ROW.Je)
    return J, transposed(H), M, n, f


@inlined
def transposed(A):
    """Rows of Aᵀ, from the rows of A."""
    a, b, c = A
    return (a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2])


@subroutine
def accelerate_slides(layout, i, prescribed, hinges, qd, tau, qdd, α, a):
    """Write q̈ of the hinges of body `i`, or torques if prescribed; return a outboard, and the power of the torques."""
    power = zero_of(qdd)
    for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
        if not prescribed[k]:
            demand = dot(vec_of(hinges, k, HINGE_ROW.Je), α) + dot(vec_of(hinges, k, HINGE_ROW.He), a)
            put_at(qdd, at(hinges, k, HINGE_ROW.inverse) * (at(hinges, k, HINGE_ROW.T) - demand), k)
        a = add_scaled(a, at(qdd, k), vec_of(hinges, k, HINGE_ROW.axis))
        if prescribed[k]:
            more = missing_torque(hinges, k, at(qdd, k), α, a)
            put_at(tau, at(tau, k) + more, k)
            power += at(qd, k) * more
    return a, power
