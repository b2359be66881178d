"""(λ² M + λ C + K) x = r in O(n) for small motion x exp(λt) of a chain about a state with constant rates.

K = ∂(T_GC + T_FL)/∂q, C = ∂(T_GC + T_FR)/∂q̇. What a hinge that moves by x_k asks of all bodies beyond it is that of
`inverse_derivatives`, seen from them and added up along the chain:

    y ← y + j_k x_k         y = (δa, δφ, η, δω)         δa ← δa + η × r + 2 δω × ṙ              from body to body
    j_k = along q_k + λ along q̇_k + λ² along q̈_k

Force and moment at a hinge point are linear in the y there, (f, n) = A y + b, with whatever the hinges beyond do. So
from the tip on, as articulated bodies (Featherstone 2008, chapter 7), with A and b in place of the articulated inertia:

    body        A ← A + what it asks for              then moved by r to the hinge point of the body before
    hinge       c = A j + (e × f, e × n)      p = e·A                 D = κ + w p·j        κ = k + λ d + λ² armature
                A ← A − c w pᵀ / D            b ← b + c (r − w e·b) / D
    outward     x = (r − w (e·b + p·y)) / D                           row by row  κ x + w (e·n) = r

A hinge that slides has e·f in place of e·n, and turns nothing that it transmits but shifts it: (0, e × f). Branches add
up their A and b where they begin, and go on from the y there.

w scales a row's part of the loads. D are the pivots of an elimination from the tip on: of a symmetric matrix as many
are negative as eigenvalues are (Sylvester). Hinges with too small a pivot are not eliminated, their x is given.

Columns of A stand in the order of y; those that nothing can ask for, behind `size`, are zero and left out.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.derivatives.inverse_derivatives import (
    BODY_MOTION,
    HINGE_MOTION,
    MotionWork,
    motion_workspace,
    of_hinge,
    outward,
    own_spin,
    spin,
)
from flexlink.kernels.geometry.branches import rows_of_forks
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sym3 import sym_apply
from flexlink.kernels.tools.vec3 import ZERO, X, Y, Z, add, add_scaled, cross, dot, scale

UNITS = (X, Y, Z)
PARTS = numbered("δa:3 δφ:3 η:3 δω:3")
"""Numbers of y, and columns of A."""
HINGE = numbered("e:3 moved:6 j:12 c:6 p:12 D w eb")
"""Numbers of a hinge: e; e × f and e × n; then j, c, p, D, w and e·b of the elimination."""


class SmallMotion(NamedTuple):
    """A chain in a state, and the matrix that `factor` has eliminated."""

    chain: Any
    motion: MotionWork
    tip: Any  # (2, 3) force and moment that turn against the arm, 0 of a follower
    moving: Any  # (1,) bool: rates are not zero
    hinges: Any  # (n, HINGE)
    demands: Any  # (bodies, 6) scratch
    A: Any  # (12, 6) scratch
    forks: Any  # (rows, 12, 6) scratch: A of what branches bring, or y, or force and moment
    size: Any  # (1,) how many numbers of y can differ from 0
    given: Any  # (n,) bool: not eliminated


@kernel
def small_motion(chain):
    """Scratch of a chain, for `place`."""
    n, m = len(chain.hinges), len(chain.bodies)
    return SmallMotion(
        chain, motion_workspace(chain), np.zeros((2, 3)), np.zeros(1, np.bool_), np.zeros((n, HINGE.size)),
        np.empty((m, 6)), np.empty((12, 6)), matrices_of_forks(chain), np.zeros(1, np.int64),
        np.zeros(n, np.bool_),
    )  # fmt: skip


@kernel
def matrices_of_forks(chain):
    """Scratch (rows, 12, 6); None of a plain chain."""
    if chain.rare is None:
        return None
    return np.empty((rows_of_forks(chain.bodies), 12, 6))


@kernel
def place(work, wrench, follower, q, qd):
    """Angles and constant rates (n,); wrench (6,) in frame 0, or, a follower, in axes of the tip frame."""
    chain, motion, rows = work.chain, work.motion, work.hinges
    force, moment = outward(chain, wrench, follower, q, qd, np.zeros(len(q)), None, motion)
    f = t = ZERO
    if work.forks is not None:
        clear_loads(work.forks)
    for i in range(len(chain.bodies) - 1, -1, -1):
        b = chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, t = with_loads(work.forks, b.fork, f, t)
        if b.loaded:
            f, t = scale(-1.0, force), scale(-1.0, moment)
        f = add(f, vec_of(motion.bodies, i, BODY_MOTION.F))
        t = add(t, vec_of(motion.bodies, i, BODY_MOTION.N))
        for k in range(b.first, b.stop):
            e = of_hinge(motion.hinges, k, HINGE_MOTION.e)
            put_vec_of(rows, e, k, HINGE.e)
            slides = felt(chain, k) == 0
            put_vec_of(rows, ZERO if slides else cross(e, f), k, HINGE.moved)
            put_vec_of(rows, cross(e, f if slides else t), k, HINGE.moved + 3)
        t = add(t, cross(vec_of(motion.bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            f, t = add_loads(work.forks, b.slot, f, t)
    dead = 0.0 if follower else 1.0
    put_vec_of(work.tip, scale(dead, force), 0, 0)
    put_vec_of(work.tip, scale(dead, moment), 1, 0)
    work.moving[0] = False
    for k in range(len(qd)):
        work.moving[0] = work.moving[0] or qd[k] != 0.0


@recursion
def clear_loads(forks):
    """No branch has brought force and moment yet."""
    for row in range(len(forks)):
        for k in range(6):
            forks[row, 0, k] = 0.0


@recursion
def with_loads(forks, row, f, n):
    """Force and moment with those of branches."""
    return add(f, vec_of(forks[row], 0, 0)), add(n, vec_of(forks[row], 0, 3))


@recursion
def add_loads(forks, row, f, n):
    """Add those of a branch; returns those with which the next one begins at its tip."""
    f, n = with_loads(forks, row, f, n)
    put_vec_of(forks[row], f, 0, 0)
    put_vec_of(forks[row], n, 0, 3)
    return ZERO, ZERO


@recursion
def weigh(work, by_angle, by_rate, by_acceleration):
    """j of every hinge, of so much of K, C and M."""
    rows, motion = work.hinges, work.motion.hinges
    for k in range(len(rows)):
        e, δω = vec_of(rows, k, HINGE.e), of_hinge(motion, k, HINGE_MOTION.δω)
        η = scale(by_angle, of_hinge(motion, k, HINGE_MOTION.η))
        η = add_scaled(add_scaled(η, 2.0 * by_rate, δω), by_acceleration, e)
        put_vec_of(rows, scale(by_angle, of_hinge(motion, k, HINGE_MOTION.δa)), k, HINGE.j + PARTS.δa)
        put_vec_of(rows, scale(by_angle, e), k, HINGE.j + PARTS.δφ)
        put_vec_of(rows, η, k, HINGE.j + PARTS.η)
        put_vec_of(rows, add_scaled(scale(by_angle, δω), by_rate, e), k, HINGE.j + PARTS.δω)
    if work.motion.slides is not None:
        weigh_slides(work, by_angle, by_rate, by_acceleration)
    work.size[0] = PARTS.size if work.moving[0] else PARTS.δω if by_acceleration != 0.0 else PARTS.η


@recursion
def weigh_slides(work, by_angle, by_rate, by_acceleration):
    """Those of hinges that slide, written over."""
    rows, motion = work.hinges, work.motion.hinges
    for k in work.motion.slides:
        δa = add_scaled(
            scale(by_angle, of_hinge(motion, k, HINGE_MOTION.δa)), by_acceleration, vec_of(rows, k, HINGE.e)
        )
        put_vec_of(rows, add_scaled(δa, 2.0 * by_rate, of_hinge(motion, k, HINGE_MOTION.δv)), k, HINGE.j + PARTS.δa)
        for column in range(PARTS.δφ, PARTS.size):
            rows[k, HINGE.j + column] = 0.0


@kernel
def factor(work, weights, κ, w, sizes, smallest):
    """Eliminate (weights[0] K + weights[1] C + weights[2] M) x, springs, friction and rotors in `κ` (n,).

    Hinges that are `given` keep their x, and so do those with |D| ≤ smallest · sizes[k], which become given, too.
    Returns how many pivots are not positive; of hinges that are given D is the diagonal of what is left of the matrix.
    """
    weigh(work, weights[0], weights[1], weights[2])
    rows, bodies, A, given, size = work.hinges, work.motion.bodies, work.A, work.given, work.size[0]
    negative = 0
    begin(work)
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            add_matrix(work.forks[b.fork], A)
        if b.loaded:
            begin_at_tip(work.tip, A)
        add_body(bodies, b.mass, i, size, A)
        for k in range(b.stop - 1, b.first - 1, -1):
            D = κ[k] + w[k] * demand(rows, k, felt(work.chain, k), size, weights[0], A)
            rows[k, HINGE.D], rows[k, HINGE.w] = D, w[k]
            if given[k] or not abs(D) > smallest * sizes[k]:
                given[k] = True
            else:
                negative += not D > 0.0
                eliminate(rows, k, size, w[k] / D, A)
        if b.parent > 0:
            move_columns(bodies, i, size, A)
        if work.forks is not None and b.begins:
            add_matrix(A, work.forks[b.slot])
            clear_matrix(A)
    return negative


@recursion
def begin(work):
    """A of the last tip, and of what branches have brought so far."""
    clear_matrix(work.A)
    if work.forks is not None:
        for row in range(len(work.forks)):
            clear_matrix(work.forks[row])


@recursion
def clear_matrix(A):
    """A ← 0."""
    for column in range(PARTS.size):
        for i in range(6):
            A[column, i] = 0.0


@recursion
def add_matrix(B, A):
    """A ← A + B."""
    for column in range(PARTS.size):
        for i in range(6):
            A[column, i] += B[column, i]


@inlined
def felt(chain, k):
    """Where the part that a hinge feels begins in force and moment (6,): that of force if it slides."""
    if chain.rare is not None and chain.hinges[k].axis >= SLIDES:
        return 0
    return 3


@recursion
def begin_at_tip(tip, A):
    """A of the loaded tip: a wrench that keeps its direction turns against the arm."""
    for column in range(3):
        put_vec_of(A, cross(UNITS[column], vec_of(tip, 0, 0)), PARTS.δφ + column, 0)
        put_vec_of(A, cross(UNITS[column], vec_of(tip, 1, 0)), PARTS.δφ + column, 3)


@recursion
def add_body(bodies, m, i, size, A):
    """A ← A + what body i asks for."""
    for column in range(3):
        unit = UNITS[column]
        add_column(A, PARTS.δa + column, *by_acceleration(bodies, m, i, unit))
        if size > PARTS.η:
            add_column(A, PARTS.η + column, *by_turning(bodies, i, unit))
        if size > PARTS.δω:
            add_column(A, PARTS.δω + column, *by_spin(bodies, i, unit))


@inlined
def by_acceleration(bodies, m, i, δa):
    """Force and moment that body i asks for where its hinge point is accelerated."""
    return scale(m, δa), cross(vec_of(bodies, i, BODY_MOTION.mc), δa)


@inlined
def by_turning(bodies, i, η):
    """The same of η."""
    low, high = vec_of(bodies, i, BODY_MOTION.I), vec_of(bodies, i, BODY_MOTION.I + 3)
    I = (low[0], low[1], low[2], high[0], high[1], high[2])
    return cross(η, vec_of(bodies, i, BODY_MOTION.mc)), sym_apply(I, η)


@inlined
def by_spin(bodies, i, δω):
    """The same of δω."""
    low, high = vec_of(bodies, i, BODY_MOTION.I), vec_of(bodies, i, BODY_MOTION.I + 3)
    ω, I = vec_of(bodies, i, BODY_MOTION.ω), (low[0], low[1], low[2], high[0], high[1], high[2])
    return scale(2.0, cross(δω, cross(ω, vec_of(bodies, i, BODY_MOTION.mc)))), spin(own_spin(ω, I), δω)


@inlined
def add_column(A, column, f, n):
    """Column += (f, n)."""
    put_vec_of(A, add(vec_of(A, column, 0), f), column, 0)
    put_vec_of(A, add(vec_of(A, column, 3), n), column, 3)


@recursion
def move_columns(bodies, i, size, A):
    """A at the hinge point of the body that i hangs on."""
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
    """Column += that of an acceleration δa."""
    for i in range(6):
        A[column, i] += A[PARTS.δa, i] * δa[0] + A[PARTS.δa + 1, i] * δa[1] + A[PARTS.δa + 2, i] * δa[2]


@recursion
def demand(rows, k, part, size, by_angle, A):
    """c and p of hinge k, which feels such a `part`, into its row, and p·j."""
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
    """Write x with the matrix of `factor` times x = r (columns, n), x as it is where it is given.

    `left` (columns, n): of given hinges, which the elimination has not touched, the matrix times x.
    """
    for column in range(len(r)):
        load(work, r[column], x[column])
        move(work, x[column], left[column])


@recursion
def load(work, r, x):
    """b from the tip on; T = (r − w e·b) / D into x, e·b of given hinges into their rows."""
    rows, bodies, given = work.hinges, work.motion.bodies, work.given
    f = n = ZERO
    if work.forks is not None:
        clear_loads(work.forks)
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, n = with_loads(work.forks, b.fork, f, n)
        for k in range(b.stop - 1, b.first - 1, -1):
            eb = dot(vec_of(rows, k, HINGE.e), n if felt(work.chain, k) else f)
            if given[k]:
                rows[k, HINGE.eb] = eb
            else:
                x[k] = (r[k] - rows[k, HINGE.w] * eb) / rows[k, HINGE.D]
            f = add_scaled(f, x[k], vec_of(rows, k, HINGE.c))
            n = add_scaled(n, x[k], vec_of(rows, k, HINGE.c + 3))
        n = add(n, cross(vec_of(bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            f, n = add_loads(work.forks, b.slot, f, n)


@recursion
def keep_motion(forks, row, δa, δφ, η, δω):
    """Keep the y that branches go on from."""
    put_vec_of(forks[row], δa, 0, 0)
    put_vec_of(forks[row], δφ, 0, 3)
    put_vec_of(forks[row], η, 1, 0)
    put_vec_of(forks[row], δω, 1, 3)


@recursion
def kept_motion(forks, row):
    """Read it."""
    return vec_of(forks[row], 0, 0), vec_of(forks[row], 0, 3), vec_of(forks[row], 1, 0), vec_of(forks[row], 1, 3)


@recursion
def move(work, x, left):
    """x = T − w p·y / D, and y with it."""
    rows, bodies, given, size = work.hinges, work.motion.bodies, work.given, work.size[0]
    δa = δφ = η = δω = ZERO
    if work.forks is not None and len(work.forks) > 0:
        keep_motion(work.forks, 0, δa, δφ, η, δω)
    for i in range(len(bodies)):
        b = work.chain.bodies[i]
        if work.forks is not None and b.begins:
            δa, δφ, η, δω = kept_motion(work.forks, b.slot)
        δa = carried(bodies, i, δa, η, δω)
        for k in range(b.first, b.stop):
            py = dot(vec_of(rows, k, HINGE.p + PARTS.δa), δa) + dot(vec_of(rows, k, HINGE.p + PARTS.δφ), δφ)
            if size > PARTS.η:
                py += dot(vec_of(rows, k, HINGE.p + PARTS.η), η)
            if size > PARTS.δω:
                py += dot(vec_of(rows, k, HINGE.p + PARTS.δω), δω)
            w, D = rows[k, HINGE.w], rows[k, HINGE.D]
            if given[k]:
                left[k] = D * x[k] + w * (py + rows[k, HINGE.eb])
            else:
                x[k] -= w * py / D
            δa = add_scaled(δa, x[k], vec_of(rows, k, HINGE.j + PARTS.δa))
            δφ = add_scaled(δφ, x[k], vec_of(rows, k, HINGE.j + PARTS.δφ))
            η = add_scaled(η, x[k], vec_of(rows, k, HINGE.j + PARTS.η))
            δω = add_scaled(δω, x[k], vec_of(rows, k, HINGE.j + PARTS.δω))
        if work.forks is not None and b.fork > 0:
            keep_motion(work.forks, b.fork, δa, δφ, η, δω)


@inlined
def carried(bodies, i, δa, η, δω):
    """δa at the hinge point of body i, from that of the body that it hangs on."""
    r, u = vec_of(bodies, i, BODY_MOTION.r), vec_of(bodies, i, BODY_MOTION.u)
    return add(δa, add(cross(η, r), scale(2.0, cross(δω, u))))


@kernel
def multiply(work, weights, κ, x, product):
    """Write (weights[0] K + weights[1] C + weights[2] M) x for x (columns, n), springs, friction and rotors in `κ`."""
    weigh(work, weights[0], weights[1], weights[2])
    for column in range(len(x)):
        ask(work, x[column])
        answer(work, weights[0], κ, x[column], product[column])


@kernel
def mass_products(chain, q, x, product):
    """Write M x for x (columns, n), in body axes: twist of a slender arm, straight, keeps its digits."""
    zero, wrench, work = np.zeros(len(q)), np.zeros(6), rne_workspace(chain)
    for column in range(len(x)):
        rne(chain, ZERO, wrench, q, zero, x[column], product[column], work)


@recursion
def ask(work, x):
    """What every body asks for, with the turned wrench in that of the loaded one."""
    rows, bodies, demands = work.hinges, work.motion.bodies, work.demands
    δa = δφ = η = δω = ZERO
    if work.forks is not None and len(work.forks) > 0:
        keep_motion(work.forks, 0, δa, δφ, η, δω)
    for i in range(len(bodies)):
        b = work.chain.bodies[i]
        if work.forks is not None and b.begins:
            δa, δφ, η, δω = kept_motion(work.forks, b.slot)
        δa = carried(bodies, i, δa, η, δω)
        for k in range(b.first, b.stop):
            δa = add_scaled(δa, x[k], vec_of(rows, k, HINGE.j + PARTS.δa))
            δφ = add_scaled(δφ, x[k], vec_of(rows, k, HINGE.j + PARTS.δφ))
            η = add_scaled(η, x[k], vec_of(rows, k, HINGE.j + PARTS.η))
            δω = add_scaled(δω, x[k], vec_of(rows, k, HINGE.j + PARTS.δω))
        f, n = by_acceleration(bodies, b.mass, i, δa)
        of_η, of_δω = by_turning(bodies, i, η), by_spin(bodies, i, δω)
        put_vec_of(demands, add(f, add(of_η[0], of_δω[0])), i, 0)
        put_vec_of(demands, add(n, add(of_η[1], of_δω[1])), i, 3)
        if b.loaded:
            add_column(demands, i, cross(δφ, vec_of(work.tip, 0, 0)), cross(δφ, vec_of(work.tip, 1, 0)))
        if work.forks is not None and b.fork > 0:
            keep_motion(work.forks, b.fork, δa, δφ, η, δω)


@recursion
def answer(work, by_angle, κ, x, product):
    """Forces and moments from the tips on, and of every hinge κ x + e·n."""
    rows, bodies, demands = work.hinges, work.motion.bodies, work.demands
    f = n = ZERO
    if work.forks is not None:
        clear_loads(work.forks)
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, n = with_loads(work.forks, b.fork, f, n)
        f, n = add(f, vec_of(demands, i, 0)), add(n, vec_of(demands, i, 3))
        for k in range(b.stop - 1, b.first - 1, -1):
            product[k] = κ[k] * x[k] + dot(vec_of(rows, k, HINGE.e), n if felt(work.chain, k) else f)
            f = add_scaled(f, by_angle * x[k], vec_of(rows, k, HINGE.moved))
            n = add_scaled(n, by_angle * x[k], vec_of(rows, k, HINGE.moved + 3))
        n = add(n, cross(vec_of(bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            f, n = add_loads(work.forks, b.slot, f, n)
