"""Solve (M + A) x = r in space, O(n), real or complex; M is the mass matrix, A contains rotors, springs, dampers.

Articulated bodies as in `articulated`, hinge by hinge, at rest and without forces, in axes of frame 0. For diagonal A:

    backward    J ← J + I + Σ…       H ← H + M r̃ + m c̃       M ← M + m 1              (body with lever r)
                D = e·J e + A         J ← J − J e (J e)ᵀ / D    H ← H − J e (Hᵀ e)ᵀ / D    M ← M − Hᵀ e (Hᵀ e)ᵀ / D
    load        n ← n + r × f         T = (r − e·n) / D         n ← n + T J e              f ← f + T Hᵀ e
    forward     x = T − (J e·α + Hᵀ e·a) / D                    α ← α + x e                a ← a + α × r

A prismatic hinge has D = e·M e + A, H e and M e in place of J e and Hᵀ e, f in place of n, a in place of α.

With coupled springs, each hinge j of a cell has a column as in `mass_plus_plane`, here a moment c_j and a force g_j.
Its equation contains c_j·α + g_j·a for the motion at the current point.

    body        c_j ← c_j + r × g_j
    hinge       U = J e + c_k        G = Hᵀ e + g_k        S = e·J e + 2 e·c_k + A_kk        L_kj = A_kj + e·c_j
                J ← J − U Uᵀ / S        H ← H − U Gᵀ / S        M ← M − G Gᵀ / S
                c_j ← c_j − L_kj U / S          g_j ← g_j − L_kj G / S         A_ij ← A_ij − L_ki L_kj / S
    load        T = (r − e·n) / S       n ← n + T U       f ← f + T G       r_j ← r_j − L_kj T
    forward     x = T − (U·α + G·a + Σ_j L_kj x_j) / S

No branch begins within a cell, and all its hinges are revolute. A prismatic hinge is a cell of one hinge: U = H e,
G = M e, S = e·G + A.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.forward.articulated_branches import DEMAND, add_inertia_of_branch, add_load_of_branch
from flexlink.kernels.forward.articulated_layout import GROUP, LAYOUT
from flexlink.kernels.forward.articulated_rows import BODY_ROW, articulated_workspace, axes_of
from flexlink.kernels.forward.mass_plus_cells import COUPLED, rows_beside
from flexlink.kernels.forward.mass_plus_slides import (
    displace_slides,
    factor_slides,
    load_slides,
    move_slides,
    place_slides,
)
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import X, Y, Z, pick, rotate, turn_axes
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.sym3 import sym_add_dyad, sym_apply, sym_from_axes, sym_of
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale

ROW = numbered("A inverse U:3 G:3")  # of an eliminated hinge: A_kk, 1 / S, U and G
OPEN = numbered("rotor c:3 g:3", start=ROW.inverse)  # of a hinge before its elimination: A_kk so far, its column c, g


class SpacePosture(NamedTuple):
    """Posture of a chain in space, axes of frame 0, with its constants."""

    layout: Any
    axes: Any
    rows: Any
    prescribed: Any
    trig: Any  # angles, cosines, sines
    e: Any  # (n, 3) hinge axes
    r: Any  # (bodies + 1, 3) from the previous hinge point to that of the body; a last row of zeros
    moments: Any  # (bodies, 3) m c
    inertias: Any  # (bodies, 6) about the hinge point
    first: Any  # (n,) first hinge of each hinge's cell; (0,) without couplings; None for a plain chain
    coupled: Any  # (n, w, 2) K and D with the hinges before it in its cell
    forks: Any  # rows of the forks, scratch; for a tree, or for prismatic joints
    radius: Any  # (n,) displacement per rotation of joints that displace no point [m]; (0,) if there are none


@kernel
def space_posture(chain):
    """Allocate the posture of a chain in space."""
    n, m, work = len(chain.hinges), len(chain.bodies), articulated_workspace(chain)
    first = cells_of(n, chain.rare)
    return SpacePosture(
        work.layout, work.axes, work.bodies, work.prescribed, work.trig,
        np.zeros((n, 3)), np.zeros((m + 1, 3)), np.zeros((m, 3)), np.zeros((m, 6)),
        first, rows_beside(first, chain.rare), rows_of_tree(work.forks, work.axes), np.zeros(0),
    )  # fmt: skip


@allocating
def rows_of_tree(forks, axes):
    """Rows for forks; at least one if there are prismatic joints."""
    return None if forks is None else np.zeros((max(len(forks), int(axes.max() >= SLIDES)), forks.shape[1]))


@kernel
def space_postures(s, posture):
    """Allocate `s` postures of the same chain; their arrays have a leading dimension (s,)."""
    n, m = len(posture.e), len(posture.moments)
    return SpacePosture(
        posture.layout, posture.axes, posture.rows, posture.prescribed, np.zeros((s, 3, n)),
        np.zeros((s, n, 3)), np.zeros((s, m + 1, 3)), np.zeros((s, m, 3)), np.zeros((s, m, 6)),
        posture.first, posture.coupled, posture.forks, posture.radius,
    )  # fmt: skip


@inlined
def space_without_cells(posture):
    """The same posture with the type of a chain without coupled springs."""
    return SpacePosture(
        posture.layout, posture.axes, posture.rows, posture.prescribed, posture.trig, posture.e, posture.r,
        posture.moments, posture.inertias, None, None, posture.forks, posture.radius,
    )  # fmt: skip


@recursion
def space_posture_of(i, postures):
    """Posture `i` of several postures, whose arrays have a leading dimension."""
    return SpacePosture(
        postures.layout, postures.axes, postures.rows, postures.prescribed, postures.trig[i],
        postures.e[i], postures.r[i], postures.moments[i], postures.inertias[i],
        postures.first, postures.coupled, postures.forks, postures.radius,
    )  # fmt: skip


@recursion
def place_in_space(q, posture):
    """Set the posture to the coordinates q (n,)."""
    layout, axes, rows, trig = posture.layout, posture.axes, posture.rows, posture.trig
    es, rs, moments, inertias = posture.e, posture.r, posture.moments, posture.inertias
    for k in range(len(q)):
        trig[0, k] = q[k]
    cos_sin_all(trig[0], trig[1], trig[2])
    x, y, z = X, Y, Z
    if posture.forks is not None and rarely(len(posture.forks) > 0):
        keep(posture.forks, 0, (x, y, z))
    for i in range(len(layout)):
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            x, y, z = kept(posture.forks, layout[i, LAYOUT.slot], (x, y, z))
        put_vec_of(rs, rotate(vec_of(rows, i, BODY_ROW.reach), x, y, z), i, 0)
        if layout[i, LAYOUT.turned]:
            u, v, w = axes_of(rows, i, BODY_ROW.mount)
            x, y, z = rotate(u, x, y, z), rotate(v, x, y, z), rotate(w, x, y, z)
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            place_slides(q, posture, i, x, y, z)
        else:
            for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
                put_vec_of(es, pick(axes[k], x, y, z), k, 0)
                x, y, z = turn_axes(axes[k], trig[1, k], trig[2, k], x, y, z)
        put_vec_of(moments, rotate(vec_of(rows, i, BODY_ROW.moment), x, y, z), i, 0)
        keep(inertias, i, sym_from_axes(x, y, z, sym_of(rows, i, BODY_ROW.own_inertia)))
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            keep(posture.forks, layout[i, LAYOUT.fork], (x, y, z))


@recursion
def factor_in_space(factors, posture):
    """Prepare `solve_in_space`; column 0 of `factors` is A_kk, columns from `COUPLED.L` are A_kj."""
    layout, prescribed, es, rs, first = posture.layout, posture.prescribed, posture.e, posture.r, posture.first
    o = factors.dtype.type(0)
    J, M, H = (o, o, o, o, o, o), (o, o, o, o, o, o), ((o, o, o), (o, o, o), (o, o, o))
    forks = posture.forks
    if posture.forks is not None:
        forks = posture.forks.view(factors.dtype)
        forks[1:] = 0.0
    begin = len(factors)  # hinges from `begin` are not yet eliminated and have columns c, g
    for i in range(len(layout) - 1, -1, -1):
        J, H, M = add_body(posture, i, J, H, M)
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            J, H, M = added(forks, layout[i, LAYOUT.fork], (J, H, M))
        if first is not None:
            for j in range(begin, layout[i, LAYOUT.stop]):
                moved = cross(vec_of(rs, i + 1, 0), vec_of(factors, j, OPEN.g))
                put_vec_of(factors, add(vec_of(factors, j, OPEN.c), moved), j, OPEN.c)
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            J, H, M = factor_slides(factors, posture, i, J, H, M)
        else:
            for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
                if first is not None and first[k] != begin:
                    begin = first[k]
                    for j in range(begin, k + 1):
                        keep(factors, j, (factors[j, ROW.A], (o, o, o), (o, o, o)), OPEN.rotor)
                if not prescribed[k]:
                    e = vec_of(es, k, 0)
                    U, G = sym_apply(J, e), rotate(e, H[0], H[1], H[2])
                    if first is None:
                        inverse = 1.0 / (dot(e, U) + factors[k, ROW.A])
                    else:
                        c, factors[k, COUPLED.inertia] = vec_of(factors, k, OPEN.c), dot(e, U)
                        inverse = 1.0 / (dot(e, U) + 2.0 * dot(e, c) + factors[k, OPEN.rotor])
                        U, G = add(U, c), add(G, vec_of(factors, k, OPEN.g))
                    keep(factors, k, (inverse, U, G), ROW.inverse)
                    if first is not None:
                        close_hinge(factors, k, begin, e, U, G)
                    u = scale(inverse, U)
                    J, M = sym_add_dyad(J, -inverse, U), sym_add_dyad(M, -inverse, G)
                    H = (add_scaled(H[0], -u[0], G), add_scaled(H[1], -u[1], G), add_scaled(H[2], -u[2], G))
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            if layout[i, LAYOUT.slot] > 0:
                add_inertia_of_branch(forks, layout[i, LAYOUT.slot], vec_of(rs, i, 0), J, H, M)
            J, M, H = (o, o, o, o, o, o), (o, o, o, o, o, o), ((o, o, o), (o, o, o), (o, o, o))


@inlined
def close_hinge(factors, k, begin, e, U, G):
    """Eliminate hinge k from the equations of hinges `begin` … k − 1, before it in its cell."""
    inverse = factors[k, ROW.inverse]
    for j in range(begin, k):
        c = vec_of(factors, j, OPEN.c)
        L = factors[k, COUPLED.L + j - begin] + dot(e, c)
        part = L * inverse
        factors[k, COUPLED.L + j - begin] = L
        g = add_scaled(vec_of(factors, j, OPEN.g), -part, G)
        keep(factors, j, (factors[j, OPEN.rotor] - part * L, add_scaled(c, -part, U), g), OPEN.rotor)
        for l in range(begin, j):
            factors[j, COUPLED.L + l - begin] -= part * factors[k, COUPLED.L + l - begin]


@inlined
def add_body(posture, i, J, H, M):
    """J, H, M at the hinge point of body i, from J, H, M at the next hinge point."""
    r, mc, m = vec_of(posture.r, i + 1, 0), vec_of(posture.moments, i, 0), posture.rows[i, BODY_ROW.mass]
    I = sym_of(posture.inertias, i, 0)
    d1, d2, d3 = (0.0, -r[2], r[1]), (r[2], 0.0, -r[0]), (-r[1], r[0], 0.0)  # unit vectors × r
    K1, K2, K3 = add(H[0], sym_apply(M, d1)), add(H[1], sym_apply(M, d2)), add(H[2], sym_apply(M, d3))
    J = (
        J[0] + I[0] + dot(d1, H[0]) + dot(d1, K1), J[1] + I[1] + dot(d2, H[1]) + dot(d2, K2),
        J[2] + I[2] + dot(d3, H[2]) + dot(d3, K3), J[3] + I[3] + dot(d3, H[1]) + dot(d2, K3),
        J[4] + I[4] + dot(d3, H[0]) + dot(d1, K3), J[5] + I[5] + dot(d2, H[0]) + dot(d1, K2),
    )  # fmt: skip
    H = (add(K1, (0.0, -mc[2], mc[1])), add(K2, (mc[2], 0.0, -mc[0])), add(K3, (-mc[1], mc[0], 0.0)))
    return J, H, (M[0] + m, M[1] + m, M[2] + m, M[3], M[4], M[5])


@recursion
def solve_in_space(factors, r, x, posture):
    """Write x with (M + A) x = r, 0 at prescribed joints."""
    layout, prescribed, es, rs, first = posture.layout, posture.prescribed, posture.e, posture.r, posture.first
    o = factors.dtype.type(0)
    n, f = (o, o, o), (o, o, o)
    if first is not None:
        for k in range(len(factors)):
            x[k] = r[k]
        r = x
    forks = posture.forks
    if posture.forks is not None:
        forks = posture.forks.view(factors.dtype)
        forks[1:] = 0.0
    for i in range(len(layout) - 1, -1, -1):
        n = add(n, cross(vec_of(rs, i + 1, 0), f))
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            n, f = added(forks, layout[i, LAYOUT.fork], (n, f), DEMAND.n)
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            n, f = load_slides(factors, r, x, posture, i, n, f)
        else:
            for k in range(layout[i, LAYOUT.stop] - 1, layout[i, LAYOUT.first] - 1, -1):
                if not prescribed[k]:
                    T = (r[k] - dot(vec_of(es, k, 0), n)) * factors[k, ROW.inverse]
                    x[k] = T
                    if first is not None:
                        for j in range(first[k], k):
                            x[j] -= factors[k, COUPLED.L + j - first[k]] * T
                    n, f = add_scaled(n, T, vec_of(factors, k, ROW.U)), add_scaled(f, T, vec_of(factors, k, ROW.G))
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            if layout[i, LAYOUT.slot] > 0:
                add_load_of_branch(forks, layout[i, LAYOUT.slot], vec_of(rs, i, 0), n, f)
            n, f = (o, o, o), (o, o, o)
    α, a = (o, o, o), (o, o, o)
    if posture.forks is not None and rarely(len(forks) > 0):
        keep(forks, 0, (α, a))
    for i in range(len(layout)):
        if posture.forks is not None and rarely(layout[i, LAYOUT.begins]):
            α, a = kept(forks, layout[i, LAYOUT.slot], (α, a))
        a = add(a, cross(α, vec_of(rs, i, 0)))
        if posture.forks is not None and rarely(layout[i, LAYOUT.group] == GROUP.slides):
            a = move_slides(factors, x, posture, i, α, a)
        else:
            for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
                if prescribed[k]:
                    x[k] = o
                else:
                    pull = dot(vec_of(factors, k, ROW.U), α) + dot(vec_of(factors, k, ROW.G), a)
                    if first is not None:
                        for j in range(first[k], k):
                            pull += factors[k, COUPLED.L + j - first[k]] * x[j]
                    x[k] -= factors[k, ROW.inverse] * pull
                    α = add_scaled(α, x[k], vec_of(es, k, 0))
        if posture.forks is not None and rarely(layout[i, LAYOUT.fork] > 0):
            keep(forks, layout[i, LAYOUT.fork], (α, a))


@recursion
def displacement_in_space(δ, posture):
    """Largest displacement [m] of either end of any segment for small changes δ (n,) of the coordinates."""
    layout, es, rs = posture.layout, posture.e, posture.r
    if posture.forks is not None and rarely(len(posture.forks) > 0):
        return displacement_in_tree(δ, posture)
    φ, p, largest = ZERO, ZERO, 0.0
    for i in range(len(layout)):
        for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
            φ = add_scaled(φ, δ[k], vec_of(es, k, 0))
        p = add(p, cross(φ, vec_of(rs, i + 1, 0)))
        largest = max(largest, dot(p, p))
    return math.sqrt(largest + (φ[0] - φ[0]))  # nan if a δ is not finite; `max` would ignore it


@subroutine
def displacement_in_tree(δ, posture):
    """`displacement_in_space` for trees or prismatic joints; separate, to keep the loop for other chains short."""
    layout, es, rs, forks = posture.layout, posture.e, posture.r, posture.forks
    φ, p, largest = ZERO, ZERO, 0.0
    keep(forks, 0, (φ, p))
    for i in range(len(layout)):
        if layout[i, LAYOUT.begins]:
            largest += φ[0] - φ[0]
            φ, p = kept(forks, layout[i, LAYOUT.slot], (φ, p))
        p = add(p, cross(φ, vec_of(rs, i, 0)))
        largest = max(largest, dot(p, p))
        if layout[i, LAYOUT.group] == GROUP.slides:
            p = displace_slides(δ, posture, i, p)
            largest = max(largest, dot(p, p)) + (p[0] - p[0])
        else:
            for k in range(layout[i, LAYOUT.first], layout[i, LAYOUT.stop]):
                φ = add_scaled(φ, δ[k], vec_of(es, k, 0))
        if layout[i, LAYOUT.fork] > 0:
            keep(forks, layout[i, LAYOUT.fork], (φ, p))
    return math.sqrt(largest + (φ[0] - φ[0]))
