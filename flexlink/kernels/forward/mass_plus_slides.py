"""Prismatic hinges in (M + A) x = r (`mass_plus_space`), all hinges of a body in one call; springs are uncoupled."""

from flexlink.kernels.forward.articulated_layout import LAYOUT
from flexlink.kernels.forward.mass_plus_cells import COUPLED
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import pick
from flexlink.kernels.tools.compiler import subroutine
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.sym3 import sym_add_dyad, sym_apply
from flexlink.kernels.tools.vec3 import add_scaled, dot, scale

FACTORS = numbered("A inverse He:3 Me:3")  # of a prismatic hinge: A, 1 / D, H e and M e


@subroutine
def place_slides(q, posture, i, x, y, z):
    """Write the axes of the prismatic hinges of body `i` with axes x, y, z, and its hinge point at q."""
    r = vec_of(posture.r, i, 0)
    for k in range(posture.layout[i, LAYOUT.first], posture.layout[i, LAYOUT.stop]):
        e = pick(posture.axes[k] - SLIDES, x, y, z)
        put_vec_of(posture.e, e, k, 0)
        r = add_scaled(r, q[k], e)
    put_vec_of(posture.r, r, i, 0)


@subroutine
def factor_slides(factors, posture, i, J, H, M):
    """J, H and M inboard of the hinges of body `i`; stores their factors."""
    for k in range(posture.layout[i, LAYOUT.stop] - 1, posture.layout[i, LAYOUT.first] - 1, -1):
        if not posture.prescribed[k]:
            e = vec_of(posture.e, k, 0)
            U, G = (dot(H[0], e), dot(H[1], e), dot(H[2], e)), sym_apply(M, e)
            inertia = dot(e, G)
            inverse = 1.0 / (inertia + factors[k, FACTORS.A])
            keep(factors, k, (inverse, U, G), FACTORS.inverse)
            if factors.shape[1] > COUPLED.inertia:
                factors[k, COUPLED.inertia] = inertia
            u = scale(inverse, U)
            J, M = sym_add_dyad(J, -inverse, U), sym_add_dyad(M, -inverse, G)
            H = (add_scaled(H[0], -u[0], G), add_scaled(H[1], -u[1], G), add_scaled(H[2], -u[2], G))
    return J, H, M


@subroutine
def load_slides(factors, r, x, posture, i, n, f):
    """Return n and f inboard of the hinges of body `i`; store T in x."""
    for k in range(posture.layout[i, LAYOUT.stop] - 1, posture.layout[i, LAYOUT.first] - 1, -1):
        if not posture.prescribed[k]:
            T = (r[k] - dot(vec_of(posture.e, k, 0), f)) * factors[k, FACTORS.inverse]
            x[k] = T
            n = add_scaled(n, T, vec_of(factors, k, FACTORS.He))
            f = add_scaled(f, T, vec_of(factors, k, FACTORS.Me))
    return n, f


@subroutine
def move_slides(factors, x, posture, i, α, a):
    """Return a outboard of the hinges of body `i`; write x of these hinges."""
    for k in range(posture.layout[i, LAYOUT.first], posture.layout[i, LAYOUT.stop]):
        x[k] = 0.0 if posture.prescribed[k] else x[k]
        if not posture.prescribed[k]:
            pull = dot(vec_of(factors, k, FACTORS.He), α) + dot(vec_of(factors, k, FACTORS.Me), a)
            x[k] -= factors[k, FACTORS.inverse] * pull
            a = add_scaled(a, x[k], vec_of(posture.e, k, 0))
    return a


@subroutine
def displace_slides(δ, posture, i, p):
    """Displacement of the hinge point of body `i`, from its displacement p due to all earlier hinges."""
    for k in range(posture.layout[i, LAYOUT.first], posture.layout[i, LAYOUT.stop]):
        p = add_scaled(p, δ[k], vec_of(posture.e, k, 0))
    return p
