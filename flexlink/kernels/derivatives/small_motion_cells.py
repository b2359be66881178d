"""Cells of coupled springs and dampers in `small_motion_factors`: κ is a full matrix within each cell.

Hinges are eliminated one by one from the tip. Eliminating hinge k fills in, for every hinge j before it in its cell, a
column G_j (force and moment for x_j = 1) and, since the matrix is not symmetric, a row q_j (the coefficient of y in
equation j):

    (f, n) = A y + Σ_j G_j x_j + b                    Σ_i κ_ji x_i + q_j·y + w_j e_j·n = r_j

    body        q_j ← as a row of A                   G_j ← as a column of A
    hinge k     c = A j + (e × f, e × n) + G_k        p = w e·A + q_k            D = κ_kk + w (e·A j + e·G_k) + q_k·j
                L_j = κ_kj + w e·G_j                  U_j = κ_jk + q_j·j         j < k, its cell
                A ← A − c pᵀ / D      G_j ← G_j − c L_j / D      q_j ← q_j − U_j p / D      κ_ji ← κ_ji − U_j L_i / D
    load        T = (r − w e·b) / D                   b ← b + c T                r_j ← r_j − U_j T
    forward     x = T − (p·y + Σ_j L_j x_j) / D

A hinge with given x uses it in place of T; all else is the same.
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
    """Factors and scratch arrays for cells; w is the number of hinges of the longest cell."""

    first: Any  # (n,) first hinge of each hinge's cell
    L: Any  # (n, w) L_j of hinge k, j from the first hinge of its cell
    U: Any  # (n, w) U_j of hinge k
    G: Any  # (w, 6) G of the current cell, scratch
    q: Any  # (w, 12) q of the current cell, scratch
    κ: Any  # (w, w) κ of the current cell, scratch
    known: Any  # (n,) scratch of a solution: sum subtracted from r


@kernel
def cells_workspace(chain):
    """Allocate the factors of a chain with couplings."""
    n, first = len(chain.hinges), cells_of(len(chain.hinges), chain.rare)
    w = 1
    for k in range(n):
        w = max(w, k - first[k] + 1)
    shapes = np.zeros((n, w)), np.zeros((n, w)), np.zeros((w, 6)), np.zeros((w, PARTS.size)), np.zeros((w, w))
    return Cells(first, *shapes, np.zeros(n))


@recursion
def put_couplings(work, weights):
    """Write the weighted sum of K_kj and D_kj to the memory of L_j of hinge k."""
    couplings, cells = work.chain.rare.couplings, work.cells
    for k in range(len(cells.L)):
        for j in range(cells.L.shape[1]):
            cells.L[k, j] = 0.0
    for c in range(len(couplings)):
        k, held = couplings[c].outer, weights[0] * couplings[c].stiffness + weights[1] * couplings[c].damping
        cells.L[k, couplings[c].inner - cells.first[k]] = held


@recursion
def open_cell(cells, κ, k):
    """Set up κ of the cell that ends at hinge k, if one does; return the number of hinges before k in its cell."""
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
    """Write c and p of hinge k to its row, L and U; return D, from p·j of the outboard hinges."""
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
    """Update the equations of the hinges before k in its cell."""
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
    """Transfer the first `count` rows and columns of the cell to the hinge point of body i's parent."""
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
    """Write T of hinge k to x; add its part of r for the hinges before it in its cell to `known`."""
    rows, cells = work.hinges, work.cells
    cells.known[k] += rows[k, HINGE.w] * eb
    if not work.given[k]:
        x[k] = (r[k] - cells.known[k]) / rows[k, HINGE.D]
    for j in range(cells.first[k], k):
        cells.known[j] += cells.U[k, j - cells.first[k]] * x[k]


@inlined
def pull_in_cell(cells, k, pull, x):
    """`pull` + Σ_j L_j x_j of hinge k."""
    for j in range(cells.first[k], k):
        pull += cells.L[k, j - cells.first[k]] * x[j]
    return pull
