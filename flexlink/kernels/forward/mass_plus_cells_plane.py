"""(M + A) x = r in a plane, O(n), where springs of a cell are coupled: A is full within it.

As in `mass_plus_diagonal_plane`, hinge by hinge from the tip. A hinge k that is taken out leaves to every hinge j
before it in its cell a term of j's equation that depends on the motion at its place, c_j α + g_j·a, and, M + A being
symmetric, the same moment c_j and force g_j where ξ_j = 1: an open column, which travels inward as a load does. With
ξ = σ x, A_kj times σ_k σ_j, and D the inertia beyond without the rotor,

    body        c_j ← c_j + d·g_j
    hinge       U = D + c_k        G = H + g_k        S = U + c_k + A_kk        L_kj = A_kj + c_j        j < k, its cell
                j = (D A_kk − c_k²) / S               g = ((c_k + A_kk) H − U g_k) / S                M ← M − G Gᵀ / S
                c_j ← c_j − L_kj U / S                g_j ← g_j − L_kj G / S                 A_ij ← A_ij − L_ki L_kj / S
    load        T = (τ − n) / S       n ← (U τ + (c_k + A_kk) n) / S       f ← f + G T       r_j ← r_j − L_kj T
    outward     ξ = T − (U α_before + G·a + Σ_j L_kj ξ_j) / S

Nothing cancels where A is large. Column j stands in the places of row j's own factors until j is taken out. What is
kept is σ_j L_kj, which acts on r_j and x_j themselves.
"""

from flexlink.kernels.bodies.plane import LINK
from flexlink.kernels.forward.mass_plus_cells import COUPLED
from flexlink.kernels.tools.compiler import inlined, subroutine
from flexlink.kernels.tools.numbered import numbered

ROW = numbered("A inverse gx gy β γ")  # of a hinge that is out: A_kk, 1 / S, G, (c_k + A_kk) / S and U / S
OPEN = numbered("rotor gx gy c", start=ROW.inverse)  # of one that is not: A_kk so far, its open column


@subroutine
def factor_cells_in_plane(factors, posture):
    """Prepare `solve_cells_in_plane`; A_kk in the first column of `factors`, A_kj from `COUPLED.L` on."""
    links, d, h, first = posture.links, posture.d, posture.h, posture.first
    o = factors.dtype.type(0)
    Mxx = Mxy = Myy = j = gx = gy = o
    beyond = len(factors)  # the cell of the hinge beyond; its first hinge
    for k in range(len(factors) - 1, -1, -1):
        dx, dy, m, begin = d[k, 0], d[k, 1], links[k, LINK.mass], first[k]
        D = links[k, LINK.inertia] + j + 2.0 * (dx * gx + dy * gy)
        D += dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = h[k, 0] + gx + Mxx * dx + Mxy * dy, h[k, 1] + gy + Mxy * dx + Myy * dy
        Mxx, Myy = Mxx + m, Myy + m
        for i in range(begin, k + 1):
            if begin == beyond:
                factors[i, OPEN.c] += dx * factors[i, OPEN.gx] + dy * factors[i, OPEN.gy]
            else:
                factors[i, OPEN.rotor] = factors[i, ROW.A]
                factors[i, OPEN.c] = factors[i, OPEN.gx] = factors[i, OPEN.gy] = o
        beyond = begin
        factors[k, COUPLED.inertia] = D
        if posture.prescribed[k]:
            j, gx, gy = D, Hx, Hy
        else:
            A, c, hx, hy = factors[k, OPEN.rotor], factors[k, OPEN.c], factors[k, OPEN.gx], factors[k, OPEN.gy]
            U, Gx, Gy = D + c, Hx + hx, Hy + hy
            inverse = 1.0 / (U + c + A)
            β, γ = (c + A) * inverse, U * inverse
            Mxx, Mxy, Myy = Mxx - Gx * Gx * inverse, Mxy - Gx * Gy * inverse, Myy - Gy * Gy * inverse
            j, gx, gy = (D * A - c * c) * inverse, β * Hx - γ * hx, β * Hy - γ * hy
            factors[k, ROW.inverse], factors[k, ROW.gx], factors[k, ROW.gy] = inverse, Gx, Gy
            factors[k, ROW.β], factors[k, ROW.γ] = β, γ
            if begin < k:
                close_hinge(factors, links, k, begin, U, Gx, Gy)


@inlined
def close_hinge(factors, links, k, begin, U, Gx, Gy):
    """What hinge k leaves to those before it in its cell, from `begin` on; keeps σ_j L_kj."""
    inverse, σ = factors[k, ROW.inverse], links[k, LINK.sign]
    for i in range(begin, k):
        own = links[i, LINK.sign]
        L = σ * own * factors[k, COUPLED.L + i - begin] + factors[i, OPEN.c]
        part = L * inverse
        factors[k, COUPLED.L + i - begin] = own * L
        factors[i, OPEN.c] -= part * U
        factors[i, OPEN.gx] -= part * Gx
        factors[i, OPEN.gy] -= part * Gy
        factors[i, OPEN.rotor] -= part * L
        for l in range(begin, i):
            factors[i, COUPLED.L + l - begin] -= own * part * factors[k, COUPLED.L + l - begin]


@subroutine
def solve_cells_in_plane(factors, r, x, posture):
    """Write x with (M + A) x = r, 0 at prescribed joints."""
    links, prescribed, d, first = posture.links, posture.prescribed, posture.d, posture.first
    o = factors.dtype.type(0)
    fx = fy = n = o
    for k in range(len(factors)):
        x[k] = r[k]
    for k in range(len(factors) - 1, -1, -1):
        n += d[k, 0] * fx + d[k, 1] * fy
        if not prescribed[k]:
            τ, begin = links[k, LINK.sign] * x[k], first[k]
            T = (τ - n) * factors[k, ROW.inverse]
            x[k] = T
            for i in range(begin, k):
                x[i] -= factors[k, COUPLED.L + i - begin] * T
            n = factors[k, ROW.γ] * τ + factors[k, ROW.β] * n
            fx, fy = fx + factors[k, ROW.gx] * T, fy + factors[k, ROW.gy] * T
    ax = ay = before = o
    for k in range(len(factors)):
        if prescribed[k]:
            x[k] = o
        else:
            pull, begin = factors[k, ROW.gx] * ax + factors[k, ROW.gy] * ay, first[k]
            for i in range(begin, k):
                pull += factors[k, COUPLED.L + i - begin] * x[i]
            α = x[k] - factors[k, ROW.inverse] * pull
            x[k] = links[k, LINK.sign] * (α - factors[k, ROW.γ] * before)
            before = α + factors[k, ROW.β] * before
        ax, ay = ax + before * d[k, 0], ay + before * d[k, 1]
