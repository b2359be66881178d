"""Cells of coupled springs and dampers in `small_motion_factors`: κ is full within each.

Hinge by hinge from the tip on. A hinge k that is taken out leaves to every hinge j before it in its cell an open
column, what x_j = 1 adds to force and moment at the place of the elimination, and, the matrix not being symmetric, an
open row, what row j asks of the y there:

    (f, n) = A y + Σ_j G_j x_j + b                    Σ_i κ_ji x_i + q_j·y + w_j e_j·n = r_j

    body        q_j ← as a row of A                   G_j ← as a column of A
    hinge k     c = A j + (e × f, e × n) + G_k        p = w e·A + q_k            D = κ_kk + w (e·A j + e·G_k) + q_k·j
                L_j = κ_kj + w e·G_j                  U_j = κ_jk + q_j·j         j < k, its cell
                A ← A − c pᵀ / D      G_j ← G_j − c L_j / D      q_j ← q_j − U_j p / D      κ_ji ← κ_ji − U_j L_i / D
    load        T = (r − w e·b) / D                   b ← b + c T                r_j ← r_j − U_j T
    outward     x = T − (p·y + Σ_j L_j x_j) / D

A hinge whose x is given keeps it in place of T, and nothing else changes.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.derivatives.inverse_derivatives import BODY_MOTION
from flexlink.kernels.derivatives.small_motion import HINGE, PARTS, UNITS, felt
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.vec3 import add, cross, dot, scale


class Cells(NamedTuple):
    """What a chain's cells add to the elimination; w = hinges of the longest."""

    first: Any  # (n,) first hinge of the cell of each
    L: Any  # (n, w) L_j of hinge k, j from the first of its cell on
    U: Any  # (n, w) likewise
    G: Any  # (w, 6) of the cell that is open, scratch
    q: Any  # (w, 12) likewise
    κ: Any  # (w, w) likewise
    known: Any  # (n,) scratch of a solution: what is taken off r


@kernel
def cells_workspace(chain):
    """Scratch of a chain with couplings."""
    n, first = len(chain.hinges), cells_of(len(chain.hinges), chain.rare)
    w = 1
    for k in range(n):
        w = max(w, k - first[k] + 1)
    shapes = np.zeros((n, w)), np.zeros((n, w)), np.zeros((w, 6)), np.zeros((w, PARTS.size)), np.zeros((w, w))
    return Cells(first, *shapes, np.zeros(n))


@recursion
def put_couplings(work, weights):
    """K_kj and D_kj, weighed, where L_j of hinge k will stand."""
    couplings, cells = work.chain.rare.couplings, work.cells
    for k in range(len(cells.L)):
        for j in range(cells.L.shape[1]):
            cells.L[k, j] = 0.0
    for c in range(len(couplings)):
        k, held = couplings[c].outer, weights[0] * couplings[c].stiffness + weights[1] * couplings[c].damping
        cells.L[k, couplings[c].inner - cells.first[k]] = held


@recursion
def open_cell(cells, κ, k):
    """κ of the cell that ends at hinge k, if one does, as nothing has been taken out of it; returns hinges before k."""
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
    """c and p of hinge k, into its row, L and U; returns D from p·j of the hinges beyond the cell."""
    rows, cells, G, q, κ = work.hinges, work.cells, work.cells.G, work.cells.q, work.cells.κ
    e, part, own = vec_of(rows, k, HINGE.e), felt(work.chain, k), k - cells.first[k]
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
    """What hinge k leaves to those before it in its cell."""
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
    """The first `count` open rows and columns at the hinge point of the body that i hangs on."""
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
    """T of hinge k into x, and what it takes off r of those before it in its cell into `known`."""
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
