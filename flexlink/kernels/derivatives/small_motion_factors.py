"""Solution of (λ² M + λ C + K) x = r in O(n) for small motion of a chain, with y and j of `small_motion`.

Once all outboard hinges are eliminated, force and moment at a hinge point are linear in the y there: (f, n) = A y + b.
The recursion is the articulated-body algorithm (Featherstone 2008, chapter 7), with A and b in place of the
articulated-body inertia and the bias force:

    body        A ← A + load of the body per unit y   then moved by r to the hinge point of the parent body
    hinge       c = A j + (e × f, e × n)      p = e·A                 D = κ + w p·j        κ = k + λ d + λ² armature
                A ← A − c w pᵀ / D            b ← b + c T             T = (r − w e·b) / D
    outward     x = T − w p·y / D                                     which solves row by row  κ x + w (e·n) = r

A prismatic hinge has e·f in place of e·n. At a fork, the A and b of all branches are added; outward, each branch starts
from the y at its fork. For cells of coupled springs, κ is a full block, which adds terms to c, p and D (below).

κ contains the spring constant k, the damping d and the armature of a hinge. w scales the load e·n in a row. The D are
the pivots; a symmetric matrix has equally many negative pivots and negative eigenvalues (Sylvester). A hinge whose
pivot is too small is not eliminated; its x must be given.

The columns of A have the order of y. Columns of A from index `size` on cause no loads and are skipped.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.derivatives.inverse_derivatives import BODY_MOTION
from flexlink.kernels.derivatives.small_motion import (
    HINGE,
    PARTS,
    UNITS,
    add_column,
    beyond_hinge,
    by_acceleration,
    by_spin,
    by_turning,
    hinge_acceleration,
    keep_motion,
    kept_motion,
    weigh,
    wrench_part,
)
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.records import added, keep
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale


@kernel
def factor(work, weights, κ, w, sizes, smallest):
    """Factor weights[0] K + weights[1] C + weights[2] M, with the weighted stiffness, damping and armature in `κ` (n,).

    The springs and dampers that couple hinges of a cell are not in `κ`; they are read from the chain. Hinges marked
    `given` are not eliminated; hinges with |D| ≤ smallest · sizes[k] become given. Returns the number of eliminated
    hinges whose pivot is not positive. D of a given hinge is its diagonal entry after elimination of outboard hinges.
    """
    weigh(work, weights[0], weights[1], weights[2])
    rows, bodies, A, given, size = work.hinges, work.motion.bodies, work.A, work.given, work.size[0]
    negative = open_ = 0
    if work.cells is not None:
        put_couplings(work, weights)
    A[:] = 0.0
    if work.forks is not None:
        work.forks[:] = 0.0
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            add_matrix(work.forks[b.fork], A)
        if b.loaded:
            begin_at_tip(work.tip, A)
        add_body(bodies, b.mass, i, size, A)
        for k in range(b.stop - 1, b.first - 1, -1):
            D = demand(rows, k, wrench_part(work.chain, k), size, weights[0], A)
            if work.cells is None:
                D, part = κ[k] + w[k] * D, w[k]
            else:
                open_ = open_cell(work.cells, κ, k)
                D, part = demand_in_cell(work, k, size, D, w[k]), 1.0
            rows[k, HINGE.D], rows[k, HINGE.w] = D, w[k]
            if given[k] or not abs(D) > smallest * sizes[k]:
                given[k] = True
            else:
                negative += not D > 0.0
                eliminate(rows, k, size, part / D, A)
                if work.cells is not None:
                    eliminate_in_cell(work, k, size)
        if b.parent > 0:
            move_columns(bodies, i, size, A)
            if work.cells is not None:
                move_open(work, i, size, open_)
        if work.forks is not None and b.begins:  # no cell is open here, since its hinges are consecutive in one branch
            add_matrix(A, work.forks[b.slot])
            A[:] = 0.0
    return negative


@recursion
def add_matrix(B, A):
    """A ← A + B."""
    for column in range(PARTS.size):
        for i in range(6):
            A[column, i] += B[column, i]


@recursion
def begin_at_tip(tip, A):
    """Write A of the loaded tip: a wrench of fixed direction rotates relative to the arm when the tip turns by δφ."""
    for column in range(3):
        put_vec_of(A, cross(UNITS[column], vec_of(tip, 0, 0)), PARTS.δφ + column, 0)
        put_vec_of(A, cross(UNITS[column], vec_of(tip, 1, 0)), PARTS.δφ + column, 3)


@recursion
def add_body(bodies, m, i, size, A):
    """A ← A + force and moment that body i requires per unit y."""
    for column in range(3):
        unit = UNITS[column]
        add_column(A, PARTS.δa + column, *by_acceleration(bodies, m, i, unit))
        if size > PARTS.η:
            add_column(A, PARTS.η + column, *by_turning(bodies, i, unit))
        if size > PARTS.δω:
            add_column(A, PARTS.δω + column, *by_spin(bodies, i, unit))


@recursion
def move_columns(bodies, i, size, A):
    """Move A from the hinge point of body i to the hinge point of its parent body."""
    r, u = vec_of(bodies, i, BODY_MOTION.r), scale(2.0, vec_of(bodies, i, BODY_MOTION.u))
    for column in range(3):
        if size > PARTS.η:
            add_combined(A, PARTS.η + column, cross(UNITS[column], r))
        if size > PARTS.δω:
            add_combined(A, PARTS.δω + column, cross(UNITS[column], u))
    for column in range(size):
        put_vec_of(A, add(vec_of(A, column, 3), cross(r, vec_of(A, column, 0))), column, 3)


@inlined
def add_combined(A, column, δa):
    """A[column] += force and moment due to an acceleration δa."""
    for i in range(6):
        A[column, i] += A[PARTS.δa, i] * δa[0] + A[PARTS.δa + 1, i] * δa[1] + A[PARTS.δa + 2, i] * δa[2]


@recursion
def demand(rows, k, part, size, by_angle, A):
    """Write c and p = e·A of hinge k to its row; return p·j. The load of the hinge begins at index `part` of (f, n)."""
    e, total = vec_of(rows, k, HINGE.e), 0.0
    for i in range(6):
        rows[k, HINGE.c + i] = by_angle * rows[k, HINGE.moved + i]
    for column in range(size):
        j, p = rows[k, HINGE.j + column], dot(e, vec_of(A, column, part))
        rows[k, HINGE.p + column] = p
        total += p * j
        for i in range(6):
            rows[k, HINGE.c + i] += A[column, i] * j
    return total


@recursion
def eliminate(rows, k, size, factor, A):
    """A ← A − c w pᵀ / D."""
    for column in range(size):
        part = factor * rows[k, HINGE.p + column]
        for i in range(6):
            A[column, i] -= rows[k, HINGE.c + i] * part


@kernel
def solve(work, r, x, left):
    """Solve the system of `factor` for x, with right-hand sides r (columns, n); the x of given hinges is an input.

    `left` (columns, n) receives the product of matrix and x in the rows of given hinges.
    """
    for column in range(len(r)):
        load(work, r[column], x[column])
        move(work, x[column], left[column])


@recursion
def load(work, r, x):
    """Backward pass of b: write T to x, e·b of a given hinge to its row and, in cells, known terms to `known`."""
    rows, bodies, given = work.hinges, work.motion.bodies, work.given
    f = n = ZERO
    if work.cells is not None:
        work.cells.known[:] = 0.0
    if work.forks is not None:
        work.forks[:, 0] = 0.0
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, n = added(work.forks[b.fork], 0, (f, n))
        for k in range(b.stop - 1, b.first - 1, -1):
            eb = dot(vec_of(rows, k, HINGE.e), n if wrench_part(work.chain, k) else f)
            if work.cells is not None:
                load_in_cell(work, k, eb, r, x)
            elif given[k]:
                rows[k, HINGE.eb] = eb
            else:
                x[k] = (r[k] - rows[k, HINGE.w] * eb) / rows[k, HINGE.D]
            f = add_scaled(f, x[k], vec_of(rows, k, HINGE.c))
            n = add_scaled(n, x[k], vec_of(rows, k, HINGE.c + 3))
        n = add(n, cross(vec_of(bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            keep(work.forks[b.slot], 0, added(work.forks[b.slot], 0, (f, n)))
            f = n = ZERO


@recursion
def move(work, x, left):
    """Forward pass of y: x = T − (w p·y + Σ_j L_j x_j) / D."""
    rows, bodies, given, size = work.hinges, work.motion.bodies, work.given, work.size[0]
    δa = δφ = η = δω = ZERO
    if work.forks is not None and len(work.forks) > 0:
        keep_motion(work.forks, 0, δa, δφ, η, δω)
    for i in range(len(bodies)):
        b = work.chain.bodies[i]
        if work.forks is not None and b.begins:
            δa, δφ, η, δω = kept_motion(work.forks, b.slot)
        δa = hinge_acceleration(bodies, i, δa, η, δω)
        for k in range(b.first, b.stop):
            w, D, py = rows[k, HINGE.w], rows[k, HINGE.D], along(rows, k, size, δa, δφ, η, δω)
            pull = w * py if work.cells is None else pull_in_cell(work.cells, k, py, x)
            if not given[k]:
                x[k] -= pull / D
            elif work.cells is None:
                left[k] = D * x[k] + w * (py + rows[k, HINGE.eb])
            else:
                left[k] = D * x[k] + pull + work.cells.known[k]
            δa, δφ, η, δω = beyond_hinge(rows, k, x[k], δa, δφ, η, δω)
        if work.forks is not None and b.fork > 0:
            keep_motion(work.forks, b.fork, δa, δφ, η, δω)


@inlined
def along(rows, k, size, δa, δφ, η, δω):
    """p·y of hinge k."""
    py = dot(vec_of(rows, k, HINGE.p + PARTS.δa), δa) + dot(vec_of(rows, k, HINGE.p + PARTS.δφ), δφ)
    if size > PARTS.η:
        py += dot(vec_of(rows, k, HINGE.p + PARTS.η), η)
    if size > PARTS.δω:
        py += dot(vec_of(rows, k, HINGE.p + PARTS.δω), δω)
    return py


# Elimination of cells, groups of hinges with coupled springs and dampers: κ is a full block within each cell.
#
# Elimination of hinge k adds two vectors for every hinge j before it in its cell: an open column G_j, the force and
# moment at the current point due to x_j = 1, and, as the matrix is not symmetric, an open row q_j, the coefficients of
# y in row j:
#
#     (f, n) = A y + Σ_j G_j x_j + b                    Σ_i κ_ji x_i + q_j·y + w_j e_j·n = r_j
#
#     body        q_j moves like a row of A             G_j moves like a column of A
#     hinge k     c = A j + (e × f, e × n) + G_k        p = w e·A + q_k            D = κ_kk + w (e·A j + e·G_k) + q_k·j
#                 L_j = κ_kj + w e·G_j                  U_j = κ_jk + q_j·j         for j < k in the same cell
#                 A ← A − c pᵀ / D      G_j ← G_j − c L_j / D      q_j ← q_j − U_j p / D      κ_ji ← κ_ji − U_j L_i / D
#     load        T = (r − w e·b) / D                   b ← b + c T                r_j ← r_j − U_j T
#     outward     x = T − (p·y + Σ_j L_j x_j) / D
#
# A hinge whose x is given is not eliminated; the load pass uses its x in place of T.


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
