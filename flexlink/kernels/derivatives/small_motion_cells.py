"""(λ² M + λ C + K) x = r in O(n) where springs and dampers of a cell are coupled: κ is full within it.

As in `small_motion`, hinge by hinge from the tip on. A hinge k that is taken out leaves to every hinge j before it in
its cell an open column, what x_j = 1 adds to force and moment at the place of the elimination, and, the matrix not
being symmetric, an open row, what row j asks of the y there:

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

from flexlink.kernels.derivatives.inverse_derivatives import BODY_MOTION, motion_workspace
from flexlink.kernels.derivatives.small_motion import (
    HINGE,
    PARTS,
    UNITS,
    SmallMotion,
    add_body,
    add_loads,
    add_matrix,
    begin,
    begin_at_tip,
    carried,
    clear_loads,
    clear_matrix,
    demand,
    eliminate,
    felt,
    keep_motion,
    kept_motion,
    matrices_of_forks,
    move_columns,
    weigh,
    with_loads,
)
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale


class SmallMotionInCells(NamedTuple):
    """A chain in a state, and the matrix that `factor_in_cells` has eliminated; w = hinges of the longest cell."""

    whole: SmallMotion  # its hinges keep c and p with what their cell adds
    first: Any  # (n,) first hinge of the cell of each
    L: Any  # (n, w) L_j of hinge k, j from the first of its cell on
    U: Any  # (n, w) likewise
    G: Any  # (w, 6) of the cell that is open, scratch
    q: Any  # (w, 12) likewise
    κ: Any  # (w, w) likewise
    known: Any  # (n,) scratch of a solution: what is taken off r


@kernel
def small_motion_in_cells(chain):
    """Scratch of a chain, for `place`, `multiply`, which take `whole`, and `factor_in_cells`."""
    n, m, first = len(chain.hinges), len(chain.bodies), cells_of(len(chain.hinges), chain.rare)
    w = 1
    for k in range(n):
        w = max(w, k - first[k] + 1)
    whole = SmallMotion(
        chain, motion_workspace(chain), np.zeros((2, 3)), np.zeros(1, np.bool_), np.zeros((n, HINGE.size)),
        np.empty((m, 6)), np.empty((12, 6)), matrices_of_forks(chain), np.zeros(1, np.int64),
        np.zeros(n, np.bool_),
    )  # fmt: skip
    return SmallMotionInCells(
        whole, first, np.zeros((n, w)), np.zeros((n, w)), np.zeros((w, 6)), np.zeros((w, PARTS.size)),
        np.zeros((w, w)), np.zeros(n),
    )  # fmt: skip


@kernel
def factor_in_cells(cells, weights, κ, w, sizes, smallest):
    """As `factor`; K_ij and D_ij of the chain's couplings count beside `κ`, the diagonal."""
    work, first = cells.whole, cells.first
    weigh(work, weights[0], weights[1], weights[2])
    put_couplings(cells, weights)
    rows, bodies, A, given, size = work.hinges, work.motion.bodies, work.A, work.given, work.size[0]
    negative = open_ = 0
    begin(work)
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            add_matrix(work.forks[b.fork], A)
        if b.loaded:
            begin_at_tip(work.tip, A)
        add_body(bodies, b.mass, i, size, A)
        for k in range(b.stop - 1, b.first - 1, -1):
            open_ = k - first[k]
            if k + 1 == len(rows) or first[k + 1] != first[k]:
                open_cell(cells, κ, k)
            D = demand_in_cell(cells, k, size, weights[0], w[k])
            rows[k, HINGE.D], rows[k, HINGE.w] = D, w[k]
            if given[k] or not abs(D) > smallest * sizes[k]:
                given[k] = True
            else:
                negative += not D > 0.0
                eliminate(rows, k, size, 1.0 / D, A)
                eliminate_in_cell(cells, k, size)
        if b.parent > 0:
            move_columns(bodies, i, size, A)
            move_open(cells, i, size, open_)
        if work.forks is not None and b.begins:  # no cell is open here: the hinges of one are in a row
            add_matrix(A, work.forks[b.slot])
            clear_matrix(A)
    return negative


@recursion
def put_couplings(cells, weights):
    """K_kj and D_kj, weighed, where L_j of hinge k will stand."""
    couplings, first = cells.whole.chain.rare.couplings, cells.first
    for k in range(len(cells.L)):
        for j in range(cells.L.shape[1]):
            cells.L[k, j] = 0.0
    for c in range(len(couplings)):
        k, held = couplings[c].outer, weights[0] * couplings[c].stiffness + weights[1] * couplings[c].damping
        cells.L[k, couplings[c].inner - first[k]] = held


@recursion
def open_cell(cells, κ, last):
    """κ of the cell that ends at hinge `last`; nothing has been taken out of it."""
    begin = cells.first[last]
    for i in range(last - begin + 1):
        for j in range(i):
            cells.κ[i, j] = cells.κ[j, i] = cells.L[begin + i, j]
        cells.κ[i, i] = κ[begin + i]
        for column in range(6):
            cells.G[i, column] = 0.0
        for column in range(PARTS.size):
            cells.q[i, column] = 0.0


@recursion
def demand_in_cell(cells, k, size, by_angle, w):
    """c and p of hinge k, into its row, L and U; returns D."""
    rows, G, q, κ, own = cells.whole.hinges, cells.G, cells.q, cells.κ, k - cells.first[k]
    e, part = vec_of(rows, k, HINGE.e), felt(cells.whole.chain, k)
    D = κ[own, own] + w * (demand(rows, k, part, size, by_angle, cells.whole.A) + dot(e, vec_of(G, own, part)))
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
def eliminate_in_cell(cells, k, size):
    """What hinge k leaves to those before it in its cell."""
    rows, own = cells.whole.hinges, k - cells.first[k]
    for j in range(own):
        column, row = cells.L[k, j] / rows[k, HINGE.D], cells.U[k, j] / rows[k, HINGE.D]
        for i in range(6):
            cells.G[j, i] -= rows[k, HINGE.c + i] * column
        for i in range(size):
            cells.q[j, i] -= rows[k, HINGE.p + i] * row
        for i in range(own):
            cells.κ[j, i] -= row * cells.L[k, i]


@recursion
def move_open(cells, i, size, count):
    """The first `count` open rows and columns at the hinge point of the body that i hangs on."""
    bodies, G, q = cells.whole.motion.bodies, cells.G, cells.q
    r, u = vec_of(bodies, i, BODY_MOTION.r), scale(2.0, vec_of(bodies, i, BODY_MOTION.u))
    for j in range(count):
        by_a = vec_of(q, j, PARTS.δa)
        for column in range(3):
            if size > PARTS.η:
                q[j, PARTS.η + column] += dot(by_a, cross(UNITS[column], r))
            if size > PARTS.δω:
                q[j, PARTS.δω + column] += dot(by_a, cross(UNITS[column], u))
        put_vec_of(G, add(vec_of(G, j, 3), cross(r, vec_of(G, j, 0))), j, 3)


@kernel
def solve_in_cells(cells, r, x, left):
    """As `solve`."""
    for column in range(len(r)):
        load_in_cells(cells, r[column], x[column])
        move_in_cells(cells, x[column], left[column])


@recursion
def load_in_cells(cells, r, x):
    """b from the tip on; T into x, what is taken off r into `known`."""
    work, first, known = cells.whole, cells.first, cells.known
    rows, bodies = work.hinges, work.motion.bodies
    for k in range(len(known)):
        known[k] = 0.0
    f = n = ZERO
    if work.forks is not None:
        clear_loads(work.forks)
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, n = with_loads(work.forks, b.fork, f, n)
        for k in range(b.stop - 1, b.first - 1, -1):
            eb = dot(vec_of(rows, k, HINGE.e), n if felt(work.chain, k) else f)
            known[k] += rows[k, HINGE.w] * eb
            if not work.given[k]:
                x[k] = (r[k] - known[k]) / rows[k, HINGE.D]
            for j in range(first[k], k):
                known[j] += cells.U[k, j - first[k]] * x[k]
            f = add_scaled(f, x[k], vec_of(rows, k, HINGE.c))
            n = add_scaled(n, x[k], vec_of(rows, k, HINGE.c + 3))
        n = add(n, cross(vec_of(bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            f, n = add_loads(work.forks, b.slot, f, n)


@recursion
def move_in_cells(cells, x, left):
    """x = T − (p·y + Σ_j L_j x_j) / D, and y with it."""
    work, first = cells.whole, cells.first
    rows, bodies, size = work.hinges, work.motion.bodies, work.size[0]
    δa = δφ = η = δω = ZERO
    if work.forks is not None and len(work.forks) > 0:
        keep_motion(work.forks, 0, δa, δφ, η, δω)
    for i in range(len(bodies)):
        b = work.chain.bodies[i]
        if work.forks is not None and b.begins:
            δa, δφ, η, δω = kept_motion(work.forks, b.slot)
        δa = carried(bodies, i, δa, η, δω)
        for k in range(b.first, b.stop):
            pull = asked(rows, k, size, δa, δφ, η, δω)
            for j in range(first[k], k):
                pull += cells.L[k, j - first[k]] * x[j]
            if work.given[k]:
                left[k] = rows[k, HINGE.D] * x[k] + pull + cells.known[k]
            else:
                x[k] -= pull / rows[k, HINGE.D]
            δa = add_scaled(δa, x[k], vec_of(rows, k, HINGE.j + PARTS.δa))
            δφ = add_scaled(δφ, x[k], vec_of(rows, k, HINGE.j + PARTS.δφ))
            η = add_scaled(η, x[k], vec_of(rows, k, HINGE.j + PARTS.η))
            δω = add_scaled(δω, x[k], vec_of(rows, k, HINGE.j + PARTS.δω))
        if work.forks is not None and b.fork > 0:
            keep_motion(work.forks, b.fork, δa, δφ, η, δω)


@inlined
def asked(rows, k, size, δa, δφ, η, δω):
    """p·y of hinge k."""
    py = dot(vec_of(rows, k, HINGE.p + PARTS.δa), δa) + dot(vec_of(rows, k, HINGE.p + PARTS.δφ), δφ)
    if size > PARTS.η:
        py += dot(vec_of(rows, k, HINGE.p + PARTS.η), η)
    if size > PARTS.δω:
        py += dot(vec_of(rows, k, HINGE.p + PARTS.δω), δω)
    return py
