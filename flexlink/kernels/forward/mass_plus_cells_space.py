"""(M + A) x = r in space, O(n), where springs of a cell are coupled: A is full within it.

As in `mass_plus_diagonal_space`, hinge by hinge from the tip, with the open columns of `mass_plus_cells_plane`, here a
moment c_j and a force g_j: what hinge j's equation asks of the motion at the place of the recursion, c_j·α + g_j·a.

    body        c_j ← c_j + r × g_j
    hinge       U = J e + c_k        G = Hᵀ e + g_k        S = e·J e + 2 e·c_k + A_kk        L_kj = A_kj + e·c_j
                J ← J − U Uᵀ / S        H ← H − U Gᵀ / S        M ← M − G Gᵀ / S
                c_j ← c_j − L_kj U / S          g_j ← g_j − L_kj G / S         A_ij ← A_ij − L_ki L_kj / S
    load        T = (r − e·n) / S       n ← n + T U       f ← f + T G       r_j ← r_j − L_kj T
    outward     x = T − (U·α + G·a + Σ_j L_kj x_j) / S

No branch begins within a cell, and its hinges turn. One that slides is a cell by itself: U = H e, G = M e, S = e·G + A.
"""

from flexlink.kernels.forward.articulated_branches import (
    add_inertia_of_branch,
    add_load_of_branch,
    clear,
    keep_motion,
    motion_of,
    with_inertia_of_branches,
    with_load_of_branches,
)
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT
from flexlink.kernels.forward.mass_plus_cells import COUPLED
from flexlink.kernels.forward.mass_plus_diagonal_space import add_body
from flexlink.kernels.forward.mass_plus_slides import factor_slides, load_slides, move_slides
from flexlink.kernels.tools.compiler import inlined, subroutine
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.sym3 import sym_add_dyad, sym_apply
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, place, scale

ROW = numbered("A inverse U:3 G:3")  # of a hinge that is out: A_kk, 1 / S, U and G
OPEN = numbered("rotor c:3 g:3", start=ROW.inverse)  # of one that is not: A_kk so far, its open column


@subroutine
def factor_cells_in_space(factors, posture):
    """Prepare `solve_cells_in_space`; A_kk in the first column of `factors`, A_kj from `COUPLED.L` on."""
    layout, prescribed, es, rs, first = posture.layout, posture.prescribed, posture.e, posture.r, posture.first
    o = factors.dtype.type(0)
    J, M, H = (o, o, o, o, o, o), (o, o, o, o, o, o), ((o, o, o), (o, o, o), (o, o, o))
    forks = posture.forks
    if posture.forks is not None:
        forks = posture.forks.view(factors.dtype)
        clear(forks)
    begin = len(factors)  # hinges from here on that are not out yet have open columns
    for i in range(len(layout) - 1, -1, -1):
        J, H, M = add_body(posture, i, J, H, M)
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            J, H, M = with_inertia_of_branches(forks, layout[i, LAYOUT.fork], J, H, M)
        for j in range(begin, layout[i, LAYOUT.stop]):
            c, g = vec_of(factors, j, OPEN.c), vec_of(factors, j, OPEN.g)
            put_vec_of(factors, add(c, cross(vec_of(rs, i + 1, 0), g)), j, OPEN.c)
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            J, H, M = factor_slides(factors, posture, i, J, H, M)
        else:
            for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
                if first[k] != begin:
                    begin = first[k]
                    open_columns(factors, begin, k + 1)
                if not prescribed[k]:
                    e, c, g = vec_of(es, k, 0), vec_of(factors, k, OPEN.c), vec_of(factors, k, OPEN.g)
                    Je = sym_apply(J, e)
                    U, G, inertia = add(Je, c), add(place(e, H[0], H[1], H[2]), g), dot(e, Je)
                    inverse = 1.0 / (inertia + 2.0 * dot(e, c) + factors[k, OPEN.rotor])
                    factors[k, COUPLED.inertia], factors[k, ROW.inverse] = inertia, inverse
                    put_vec_of(factors, U, k, ROW.U)
                    put_vec_of(factors, G, k, ROW.G)
                    if begin < k:
                        close_hinge(factors, k, begin, e, U, G)
                    u = scale(inverse, U)
                    J, M = sym_add_dyad(J, -inverse, U), sym_add_dyad(M, -inverse, G)
                    H = (add_scaled(H[0], -u[0], G), add_scaled(H[1], -u[1], G), add_scaled(H[2], -u[2], G))
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            if layout[i, LAYOUT.slot] > 0:
                add_inertia_of_branch(forks, layout[i, LAYOUT.slot], vec_of(rs, i, 0), J, H, M)
            J, M, H = (o, o, o, o, o, o), (o, o, o, o, o, o), ((o, o, o), (o, o, o), (o, o, o))


@inlined
def open_columns(factors, begin, stop):
    """Nothing has been taken out of a cell of hinges begin … stop − 1."""
    o = factors.dtype.type(0)
    for j in range(begin, stop):
        factors[j, OPEN.rotor] = factors[j, ROW.A]
        put_vec_of(factors, (o, o, o), j, OPEN.c)
        put_vec_of(factors, (o, o, o), j, OPEN.g)


@inlined
def close_hinge(factors, k, begin, e, U, G):
    """What hinge k leaves to those before it in its cell, from `begin` on."""
    inverse = factors[k, ROW.inverse]
    for j in range(begin, k):
        c = vec_of(factors, j, OPEN.c)
        L = factors[k, COUPLED.L + j - begin] + dot(e, c)
        part = L * inverse
        factors[k, COUPLED.L + j - begin] = L
        put_vec_of(factors, add_scaled(c, -part, U), j, OPEN.c)
        put_vec_of(factors, add_scaled(vec_of(factors, j, OPEN.g), -part, G), j, OPEN.g)
        factors[j, OPEN.rotor] -= part * L
        for l in range(begin, j):
            factors[j, COUPLED.L + l - begin] -= part * factors[k, COUPLED.L + l - begin]


@subroutine
def solve_cells_in_space(factors, r, x, posture):
    """Write x with (M + A) x = r, 0 at prescribed joints."""
    layout, prescribed, es, rs, first = posture.layout, posture.prescribed, posture.e, posture.r, posture.first
    o = factors.dtype.type(0)
    for k in range(len(factors)):
        x[k] = r[k]
    n, f = (o, o, o), (o, o, o)
    forks = posture.forks
    if posture.forks is not None:
        forks = posture.forks.view(factors.dtype)
        clear(forks)
    for i in range(len(layout) - 1, -1, -1):
        n = add(n, cross(vec_of(rs, i + 1, 0), f))
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            n, f = with_load_of_branches(forks, layout[i, LAYOUT.fork], n, f)
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            n, f = load_slides(factors, x, x, posture, i, n, f)
        else:
            for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
                if not prescribed[k]:
                    T = (x[k] - dot(vec_of(es, k, 0), n)) * factors[k, ROW.inverse]
                    x[k], begin = T, first[k]
                    for j in range(begin, k):
                        x[j] -= factors[k, COUPLED.L + j - begin] * T
                    n, f = add_scaled(n, T, vec_of(factors, k, ROW.U)), add_scaled(f, T, vec_of(factors, k, ROW.G))
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            if layout[i, LAYOUT.slot] > 0:
                add_load_of_branch(forks, layout[i, LAYOUT.slot], vec_of(rs, i, 0), n, f)
            n, f = (o, o, o), (o, o, o)
    α, a = (o, o, o), (o, o, o)
    if posture.forks is not None and rarely(len(forks) > 0):
        keep_motion(forks, 0, α, a)
    for i in range(len(layout)):
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            α, a = motion_of(forks, layout[i, LAYOUT.slot])
        a = add(a, cross(α, vec_of(rs, i, 0)))
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            a = move_slides(factors, x, posture, i, α, a)
        else:
            for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
                if prescribed[k]:
                    x[k] = o
                else:
                    pull, begin = dot(vec_of(factors, k, ROW.U), α) + dot(vec_of(factors, k, ROW.G), a), first[k]
                    for j in range(begin, k):
                        pull += factors[k, COUPLED.L + j - begin] * x[j]
                    x[k] -= factors[k, ROW.inverse] * pull
                    α = add_scaled(α, x[k], vec_of(es, k, 0))
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            keep_motion(forks, layout[i, LAYOUT.fork], α, a)
