"""Ties: rows g(q) = 0 that close loops, each with a multiplier λ, in the stages of an implicit step; O(n) for each row.

    M q̈ + h(q, q̇) + Jᵀ λ = τ        J = ∂g/∂q

    POINT      g = u · (p_a − p_b)       along a direction u of frame 0, for points of two bodies, or of one and frame 0
    DISTANCE   g = |p_a − p_b| − l       a rod

All stages satisfy g = 0 (index 3). In the coordinates of `newton`, one system for each eigenvalue, with z = hλ_A for an
eigenvalue λ_A of the method's A, each system gets the rows as a border:

    (M + A_z) x + Jᵀ μ = (T⁻¹ R)        z² J x = −(T⁻¹ g)
    Y = (M + A_z)⁻¹ Jᵀ,  S = J Y:       S μ = J x⁰ + (T⁻¹ g) / z²,  x = x⁰ − Y μ        x⁰: without ties
    λ_i ← λ_i + Σ T_iz μ_z

Redundant rows, which depend on others at the posture in the middle of the step, get no change of their multipliers.

What the iteration leaves of g would have to be undone within the next step, by q̈ of the order g / h², and of J q̇ an
error of h³ would remain. Therefore both are removed after every step and in every sample, in the metric of the step, in
which stiff vibrations stay quiet:

    q ← q − Y S⁻¹ g        q̇ ← q̇ − Y S⁻¹ J q̇

The error of a step keeps J e = 0, and q̈ at a start satisfies J q̈ + J̇ q̇ = 0.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.forward.mass_plus import factor, place_bodies, solve
from flexlink.kernels.geometry.kinematics import add_slope, kinematics
from flexlink.kernels.stepping.implicit_layout import VECTOR
from flexlink.kernels.tools.compiler import entry, inlined, recursion, shared, subroutine
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.vec3 import add, apply, dot, scale, sub, vector

KIND = numbered("point distance")
TIE = np.dtype(
    [
        ("kind", np.int64), ("a", np.int64), ("b", np.int64),  # bodies; −1: frame 0
        ("point_a", np.float64, (3,)), ("point_b", np.float64, (3,)),  # in axes of the bodies [m]
        ("along", np.float64, (3,)),  # u
        ("length", np.float64),  # l [m]
    ],
    align=True,
)  # fmt: skip
REDUNDANT = 1e-11
"""Pivot of S, relative to the largest, up to which a row is redundant: above the rounding errors of any useful arm."""
CLOSED = 1e-14
"""Largest |g| of a closed row, relative to the size of the arm."""
OPEN = 1e-10
"""Largest |g| after a step, relative to the size; a step that leaves more is refused: its posture is singular."""
TIMES = 8  # corrections of q after a step; one is enough if the step is accurate


class Ties(NamedTuple):
    """Rows of a chain, and scratch for an implicit method with s stages.

    `real` and `pairs` are the answers of the chain for the real and for the complex eigenvalues: Y (p, r, n),
    S (p, r, r), and a matrix (r, r + 1) for a small system with its right-hand side.
    """

    rows: Any  # (r,) TIE
    size: Any  # (1,) of the arm [m]
    placed: Any  # results of `kinematics`
    λ: Any  # (s, r) multipliers of the stages
    gap: Any  # (s, r)
    J: Any  # (r, n)
    middle: Any  # (r, n) J at the middle of the step
    real: Any
    pairs: Any
    used: Any  # (r,)


@inlined
def place(body, point, placed):
    """Position in frame 0 of a point of a body, or of frame 0."""
    p = vector(point)
    return p if body < 0 else add(vector(placed.points[body]), apply(placed.rotations[body], p))


@shared
@entry
def find_rows(chain, rows, q, placed, g, J):
    """Write g (r,) and J (r, n) at angles q; `placed` is scratch."""
    kinematics(chain, q, placed)
    for k in range(len(rows)):
        row = rows[k]
        for j in range(len(q)):
            J[k, j] = 0.0
        a, b = place(row.a, row.point_a, placed), place(row.b, row.point_b, placed)
        apart, u = sub(a, b), vector(row.along)
        if row.kind == KIND.distance:
            far = math.sqrt(dot(apart, apart))
            u = scale(1.0 / far, apart)
        g[k] = dot(u, apart) - row.length
        add_slope(chain, placed, row.a, a, u, J[k])
        add_slope(chain, placed, row.b, b, scale(-1.0, u), J[k])


@inlined
def begin_ties(q, work):
    """Find J at the middle of the step; the stages begin with their last multipliers, if these are numbers."""
    ties = work.ties
    find_rows(work.chain, ties.rows, q, ties.placed, ties.gap[0], ties.middle)
    for i in range(len(ties.λ)):
        for k in range(len(ties.rows)):
            if not math.isfinite(ties.λ[i, k]):
                ties.λ[i, k] = 0.0


@inlined
def pull(i, q, R, work):
    """Subtract Jᵀ λ from the residual R (n,) of stage i, and note its gaps."""
    ties = work.ties
    find_rows(work.chain, ties.rows, q, ties.placed, ties.gap[i], ties.J)
    for k in range(len(ties.rows)):
        for j in range(len(q)):
            R[j] -= ties.J[k, j] * ties.λ[i, k]


@recursion
def answer(J, factors, answers, eigenvalue, r, posture):
    """Write Y = (M + A)⁻¹ Jᵀ, as rows, and S = J Y for an eigenvalue, by its index; `r` (n,) is scratch."""
    Y, S = answers[0][eigenvalue], answers[1][eigenvalue]
    for k in range(len(J)):
        for j in range(len(r)):
            r[j] = J[k, j]
        solve(factors, r, Y[k], posture)
    for k in range(len(J)):
        for m in range(len(J)):
            S[k, m] = 0.0
            for j in range(len(r)):
                S[k, m] += J[k, j] * Y[m, j]


@subroutine
def answer_ties(work):
    """Find Y and S for every eigenvalue, whose factors are known."""
    ties = work.ties
    for m in range(len(work.method.real)):
        answer(ties.middle, work.factors[m], ties.real, m, work.vectors[VECTOR.rhs], work.posture)
    for m in range(len(work.method.pairs)):
        answer(ties.middle, work.factors_pairs[m], ties.pairs, m, work.pairs[0], work.posture)


@recursion
def solve_small(A, used):
    """Replace the last column b of A (r, r + 1) by x with A x = b, 0 for redundant rows; `used` (r,) is scratch.

    Elimination with the largest pivot first; a row whose pivot is a rounding error depends on those before it.
    """
    r, first = len(A), 0.0
    for k in range(r):
        used[k] = 0.0
    for _ in range(r):
        p = -1
        for k in range(r):
            if used[k] == 0.0 and (p < 0 or abs(A[k, k]) > abs(A[p, p])):
                p = k
        first = max(first, abs(A[p, p]))
        if abs(A[p, p]) <= REDUNDANT * first:
            break
        used[p] = 1.0
        for i in range(r):
            if i != p:
                part = A[i, p] / A[p, p]
                for j in range(r + 1):
                    A[i, j] -= part * A[p, j]
    for k in range(r):
        A[k, r] = A[k, r] / A[k, k] if used[k] > 0.0 else 0.0 * A[k, r]


@recursion
def hold(z, m, twice, T, Tinv, x, answers, ties):
    """Move x (n,), the solution for eigenvalue m without ties, onto the rows, and update the stages' multipliers."""
    J, Y, S, A = ties.middle, answers[0][m], answers[1][m], answers[2]
    r, s = len(J), len(ties.λ)
    for k in range(r):
        wrong = 0.0 * z
        for i in range(s):
            wrong += Tinv[m, i] * ties.gap[i, k]
        wrong /= z * z
        for j in range(len(x)):
            wrong += J[k, j] * x[j]
        for l in range(r):
            A[k, l] = S[k, l]
        A[k, r] = wrong
    solve_small(A, ties.used)
    for k in range(r):
        for j in range(len(x)):
            x[j] -= A[k, r] * Y[k, j]
        for i in range(s):
            ties.λ[i, k] += twice * (T[i, m] * A[k, r]).real


@subroutine
def project(q, qd, work):
    """Put q and q̇ (n,) onto the rows, in the metric of the step; returns whether all rows are closed.

    The posture of the workspace is then that of q.
    """
    ties, r = work.ties, len(work.ties.rows)
    J, factors = ties.J, work.factors[0]
    place_bodies(q, work.posture)
    factor(factors, work.posture)
    before = off = math.inf
    for again in range(TIMES):
        find_rows(work.chain, ties.rows, q, ties.placed, ties.gap[0], J)
        off = 0.0
        for k in range(r):
            off = max(off, abs(ties.gap[0, k]))
        if again > 0 and (off <= CLOSED * ties.size[0] or off >= before):
            break
        answer(J, factors, ties.real, 0, work.vectors[VECTOR.rhs], work.posture)
        move_by(ties.gap[0], q, ties)
        before = off
    for k in range(r):
        ties.gap[0, k] = 0.0
        for j in range(len(qd)):
            ties.gap[0, k] += J[k, j] * qd[j]
    move_by(ties.gap[0], qd, ties)
    return off <= OPEN * ties.size[0]


@recursion
def move_by(g, q, ties):
    """q ← q − Y S⁻¹ g, with the answers for the first real eigenvalue."""
    Y, S, A, r = ties.real[0][0], ties.real[1][0], ties.real[2], len(g)
    for k in range(r):
        for l in range(r):
            A[k, l] = S[k, l]
        A[k, r] = g[k]
    solve_small(A, ties.used)
    for k in range(r):
        for j in range(len(q)):
            q[j] -= A[k, r] * Y[k, j]


@recursion
def keep(e_v, y, work):
    """Change y (n,) such that J (e_v + y) = 0 at the middle of the step."""
    ties = work.ties
    J, g = ties.middle, ties.gap[0]
    if len(work.turning.dry) > 0:  # the factors have changed
        answer(J, work.factors[0], ties.real, 0, work.vectors[VECTOR.tau], work.posture)
    for k in range(len(J)):
        g[k] = 0.0
        for j in range(len(y)):
            g[k] += J[k, j] * (e_v[j] + y[j])
    move_by(g, y, ties)


@recursion
def accelerate(state, work):
    """Change q̈ at a start such that J q̈ + J̇ q̇ = 0 and M q̈ changes by Jᵀ μ alone; the first factors contain rotors.

    J̇ q̇ is a central difference along q̇, of a relative error of 1e-9, since q̈ at a start serves the error estimate only.
    """
    q, qd, qdd = state[0], state[1], state[2]
    ties, n, r, x = work.ties, len(state[0]), len(work.ties.rows), work.vectors[VECTOR.solution]
    fastest = 0.0
    for k in range(n):
        fastest = max(fastest, abs(qd[k]))
    place_bodies(q, work.posture)
    factor(work.factors[0], work.posture)
    g, nudge = ties.gap[0], 1e-5 / max(fastest, 1e-300)
    for k in range(r):
        g[k] = 0.0
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for k in range(n):
            x[k] = q[k] + sign * nudge * qd[k]
        find_rows(work.chain, ties.rows, x, ties.placed, ties.gap[-1], ties.J)
        for k in range(r):
            for j in range(n):
                g[k] += sign * ties.J[k, j] * qd[j] / (2.0 * nudge)
    find_rows(work.chain, ties.rows, q, ties.placed, ties.gap[-1], ties.J)
    answer(ties.J, work.factors[0], ties.real, 0, work.vectors[VECTOR.rhs], work.posture)
    for k in range(r):
        for j in range(n):
            g[k] += ties.J[k, j] * qdd[j]
    move_by(g, qdd, ties)
