"""Elimination of cells, groups of hinges with coupled springs and dampers: κ is a full block within each cell.

This extends `small_motion_factors`, which eliminates one hinge at a time from the tip to the base. Elimination of
hinge k adds two vectors for every hinge j before it in its cell: an open column G_j, the force and moment at the
current point due to x_j = 1, and, as the matrix is not symmetric, an open row q_j, the coefficients of y in row j:

    (f, n) = A y + Σ_j G_j x_j + b                    Σ_i κ_ji x_i + q_j·y + w_j e_j·n = r_j

    body        q_j moves like a row of A             G_j moves like a column of A
    hinge k     c = A j + (e × f, e × n) + G_k        p = w e·A + q_k            D = κ_kk + w (e·A j + e·G_k) + q_k·j
                L_j = κ_kj + w e·G_j                  U_j = κ_jk + q_j·j         for j < k in the same cell
                A ← A − c pᵀ / D      G_j ← G_j − c L_j / D      q_j ← q_j − U_j p / D      κ_ji ← κ_ji − U_j L_i / D
    load        T = (r − w e·b) / D                   b ← b + c T                r_j ← r_j − U_j T
    outward     x = T − (p·y + Σ_j L_j x_j) / D

A hinge whose x is given is not eliminated; the load pass uses its x in place of T.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.derivatives.inverse_derivatives import BODY_MOTION
from flexlink.kernels.derivatives.small_motion import HINGE, PARTS, UNITS, wrench_part
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.vec3 import add, cross, dot, scale


class Cells(NamedTuple):
    """Arrays of the elimination with cells; w is the number of hinges of the longest cell."""

    first: Any  # (n,) first hinge of each hinge's cell
    L: Any  # (n, w) L_j of hinge k, with j counted from the first hinge of its cell
    U: Any  # (n, w) U_j of hinge k, with j counted in the same way
    G: Any  # (w, 6) scratch: open columns of the current cell
    q: Any  # (w, 12) scratch: open rows of the current cell
    κ: Any  # (w, w) scratch: κ of the current cell
    known: Any  # (n,) scratch of one solve: known terms to subtract from r


@kernel
def cells_workspace(chain):
    """Scratch for the cells of a chain with couplings."""
    n, first = len(chain.hinges), cells_of(len(chain.hinges), chain.rare)
    w = 1
    for k in range(n):
        w = max(w, k - first[k] + 1)
    shapes = np.zeros((n, w)), np.zeros((n, w)), np.zeros((w, 6)), np.zeros((w, PARTS.size)), np.zeros((w, w))
    return Cells(first, *shapes, np.zeros(n))


@recursion
def put_couplings(work, weights):
    """Write the weighted stiffness plus damping of each coupling to the entry that later receives L_j of hinge k."""
    couplings, cells = work.chain.rare.couplings, work.cells
    cells.L[:] = 0.0
    for c in range(len(couplings)):
        k, held = couplings[c].outer, weights[0] * couplings[c].stiffness + weights[1] * couplings[c].damping
        cells.L[k, couplings[c].inner - cells.first[k]] = held


@recursion
def open_cell(cells, κ, k):
    """If a cell ends at hinge k, set up its κ and clear G and q; return the number of hinges before k in its cell."""
    begin = cells.first[k]
    if k + 1 == len(κ) or cells.first[k + 1] != begin:
        for i in range(k - begin + 1):
            for j in range(i):
                cells.κ[i, j] = cells.κ[j, i] = cells.L[begin + i, j]
            cells.κ[i, i] = κ[begin + i]
            cells.G[i, :] = 0.0
            cells.q[i, :] = 0.0
    return k - begin


@recursion
def demand_in_cell(work, k, size, pj, w):
    """Write c, p, L and U of hinge k; return D, given `pj` = e·A j."""
    rows, cells, G, q, κ = work.hinges, work.cells, work.cells.G, work.cells.q, work.cells.κ
    e, part, own = vec_of(rows, k, HINGE.e), wrench_part(work.chain, k), k - cells.first[k]
    D = κ[own, own] + w * (pj + dot(e, vec_of(G, own, part)))
    for i in range(6):
        rows[k, HINGE.c + i] += G[own, i]
    for column in range(size):
        D += q[own, column] * rows[k, HINGE.j + column]
        rows[k, HINGE.p + column] = w * rows[k, HINGE.p + column] + q[own, column]
    for j in range(own):
        cells.L[k, j] = κ[own, j] + w * dot(e, vec_of(G, j, part))
        cells.U[k, j] = κ[j, own]
        for column in range(size):
            cells.U[k, j] += q[j, column] * rows[k, HINGE.j + column]
    return D


@recursion
def eliminate_in_cell(work, k, size):
    """Update G, q and κ of the hinges before hinge k in its cell for the elimination of hinge k."""
    rows, cells, own = work.hinges, work.cells, k - work.cells.first[k]
    for j in range(own):
        column, row = cells.L[k, j] / rows[k, HINGE.D], cells.U[k, j] / rows[k, HINGE.D]
        for i in range(6):
            cells.G[j, i] -= rows[k, HINGE.c + i] * column
        for i in range(size):
            cells.q[j, i] -= rows[k, HINGE.p + i] * row
        for i in range(own):
            cells.κ[j, i] -= row * cells.L[k, i]


@recursion
def move_open(work, i, size, count):
    """Move the first `count` open rows and columns to the hinge point of the parent body."""
    bodies, G, q = work.motion.bodies, work.cells.G, work.cells.q
    r, u = vec_of(bodies, i, BODY_MOTION.r), scale(2.0, vec_of(bodies, i, BODY_MOTION.u))
    for j in range(count):
        by_a = vec_of(q, j, PARTS.δa)
        for column in range(3):
            if size > PARTS.η:
                q[j, PARTS.η + column] += dot(by_a, cross(UNITS[column], r))
            if size > PARTS.δω:
                q[j, PARTS.δω + column] += dot(by_a, cross(UNITS[column], u))
        put_vec_of(G, add(vec_of(G, j, 3), cross(r, vec_of(G, j, 0))), j, 3)


@recursion
def load_in_cell(work, k, eb, r, x):
    """Write T of hinge k to x, and add U_j T to the `known` terms of the hinges j before it in its cell."""
    rows, cells = work.hinges, work.cells
    cells.known[k] += rows[k, HINGE.w] * eb
    if not work.given[k]:
        x[k] = (r[k] - cells.known[k]) / rows[k, HINGE.D]
    for j in range(cells.first[k], k):
        cells.known[j] += cells.U[k, j - cells.first[k]] * x[k]


@inlined
def pull_in_cell(cells, k, pull, x):
    """Return `pull` + Σ_j L_j x_j of hinge k, over the hinges j before it in its cell."""
    for j in range(cells.first[k], k):
        pull += cells.L[k, j - cells.first[k]] * x[j]
    return pull
