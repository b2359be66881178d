"""Ties: rows g(q, t), each with a multiplier λ, in the stages of an implicit step; O(n) for each row.

    M q̈ + h(q, q̇) + Jᵀ λ = τ        J = ∂g/∂q,  ġ = J q̇ + ∂g/∂t

    POINT      g = u · (p_a − p_b)       along a direction u of body b, or of frame 0
    DISTANCE   g = |p_a − p_b| − l(t)    a rod, a cable, a cylinder
    JOINT      g = q_a                   a coordinate

The law of a row gives λ. A row is held, or a spring with damper; with a free range, low < g < high, it is a spring
beyond the range, whose losses grow with the depth δ (Hunt & Crossley 1975):

    held       g = 0
    spring     λ = k g + d ġ
    range      λ = k δ (1 + c |ġ|)       δ = g − high > 0 or g − low < 0, ġ > 0 deeper; else λ = 0

A step keeps the law that is valid at its start, so it is smooth, and ends where this changes (`saturation`).

All stages satisfy the law (index 3 for held rows). In the coordinates of `newton`, one system for each eigenvalue, with
z = hλ_A for an eigenvalue λ_A of the method's A, each system gets the rows as a border:

    (M + A_z) x + Jᵀ μ = (T⁻¹ R)         Y = (M + A_z)⁻¹ Jᵀ,  S = J Y
    held       z² J x = −(T⁻¹ g)                                 S μ = J x⁰ + (T⁻¹ g) / z²      x⁰: without ties
    spring     μ = (T⁻¹ (λ(g) − λ)) + (k z² + d z) J x      (S + C) μ = J x⁰ + C (T⁻¹ (λ(g) − λ)),  C = 1 / (k z² + d z)
    x = x⁰ − Y μ,  λ_i ← λ_i + Σ T_iz μ_z

Held rows that depend on others at the posture in the middle of the step are redundant: their multipliers do not change.

What the iteration leaves of g would have to be undone within the next step, by q̈ of the order g / h², and of J q̇ an
error of h³ would remain. Therefore both are removed after every step and in every sample, in the metric of the step, in
which stiff vibrations stay quiet:

    q ← q − Y S⁻¹ g        q̇ ← q̇ − Y S⁻¹ ġ

The error of a step keeps J e = 0, and q̈ at a start satisfies g̈ = 0; springs enter both with k and d. The work of all
forces contains the energy stored in the springs, ½ k δ², as a function of q, so that it is exact:

    W = −∫ λ ∂g/∂t + (λ − k δ) ġ dt − Σ ½ k δ²        (without λ ∂g/∂t only for l = const)
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.forward.mass_plus import factor, place_bodies, solve
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.stepping.implicit_layout import VECTOR
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.tie_rows import (
    LAW,
    find_rows,
    law_of,
    multiplier,
    other_law,
    pressed,
    spring_forces,
    stretch,
)
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine

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
    ranges: Any  # (1,) number of rows with a free range
    lengths: Any  # l(t) of rows whose length moves, as `follow` reads it
    moved: Any  # (3, r) l, l̇, l̈ of these rows; 0: others
    law: Any  # (r,) LAW of each row in this step
    left: Any  # (r,) start of a step that takes another law, as the row leaves its own at once [s]; nan: none
    λ: Any  # (s, r) multipliers of the stages
    last: Any  # (s, r) the same of the last accepted step
    gap: Any  # (s, r) g of held rows, λ(g) − λ of others
    slope: Any  # (2, r) ∂λ/∂g and ∂λ/∂ġ, means of the stages
    stored: Any  # (2,) ½ k δ² of all rows at the start of the step, and at the last state [J]
    off: Any  # (2, r) how far λ is beyond its law [N], and its impulse in the rest of the step [N s]
    placed: Any  # results of `kinematics`
    J: Any  # (r, n)
    middle: Any  # (r, n) J at the middle of the step
    real: Any
    pairs: Any
    again: Any  # the same as `real` for one other matrix
    used: Any  # (r,)


@inlined
def find_at(t, q, g, ties, chain):
    """Write g and J at time t, and l(t) with its derivatives to `moved`."""
    follow(ties.lengths, t, ties.moved[0], ties.moved[1], ties.moved[2])
    find_rows(chain, ties.rows, ties.moved[0], q, ties.placed, g, ties.J)


@inlined
def rate(k, qd, ties):
    """ġ of row k."""
    v = -ties.moved[1, k]
    for j in range(len(qd)):
        v += ties.J[k, j] * qd[j]
    return v


@recursion
def energy(g, ties):
    """Energy stored in all springs by the laws of the step [J]."""
    E = 0.0
    for k in range(len(ties.rows)):
        δ = stretch(ties.rows[k], ties.law[k], g[k])
        if δ != 0.0:
            E += 0.5 * ties.rows[k].stiffness * δ * δ
    return E


@subroutine
def begin_ties(t, h, state, middle, accepted, work):
    """Find the laws at the start of the step and J in its middle; the stages begin with their last multipliers.

    `accepted`: whether the last multipliers belong to an accepted step; if not, those of the step before return.
    """
    ties, q, qd, first = work.ties, state[0], state[1], work.stepper[STEPPER.last_step] == 0.0
    g = ties.gap[0]
    find_at(t, q, g, ties, work.chain)
    for k in range(len(ties.rows)):
        row = ties.rows[k]
        law = law_of(row, g[k], rate(k, qd, ties))
        ties.law[k] = other_law(row, law, g[k]) if ties.left[k] == t else law
        for i in range(len(ties.λ)):
            if accepted:
                ties.last[i, k] = ties.λ[i, k]
            ties.λ[i, k] = 0.0 if ties.law[k] == LAW.free or first else ties.last[i, k]
    ties.stored[0] = energy(g, ties)
    find_at(t + 0.5 * h, middle, g, ties, work.chain)
    for k in range(len(ties.rows)):
        for j in range(len(q)):
            ties.middle[k, j] = ties.J[k, j]


@inlined
def noise_of_ties(h, work):
    """Factor of rounding errors in Newton's iteration: those of g become errors g / h of rates, for a time 1/ω₁.

    Measured: up to 4 rounding errors of a position times 1 / (ω₁ h); 6 are allowed, in units of 200.
    """
    return 1.0 if work.ties is None else max(1.0, 0.03 * work.stepper[STEPPER.inverse_ω1] / h)


@inlined
def pull(i, t, q, qd, R, work):
    """Subtract Jᵀ λ from the residual R (n,) of stage i, and note its gaps; returns the power beside ½ k δ²."""
    ties, power, s = work.ties, 0.0, len(work.ties.λ)
    find_at(t, q, ties.gap[i], ties, work.chain)
    for k in range(len(ties.rows)):
        λ, row = ties.λ[i, k], ties.rows[k]
        if ties.law[k] == LAW.held and abs(ties.gap[i, k]) <= 0.1 * CLOSED * ties.size[0]:
            ties.gap[i, k] = 0.0  # its rounding errors over h² would be accelerations
        for j in range(len(q)):
            R[j] -= ties.J[k, j] * λ
        if i == 0:
            ties.slope[0, k] = ties.slope[1, k] = 0.0
        if ties.law[k] != LAW.held:
            g, v = ties.gap[i, k], rate(k, qd, ties)
            by_law, of_g, of_v = multiplier(row, ties.law[k], g, v)
            ties.gap[i, k] = by_law - λ
            ties.slope[0, k] += of_g / s
            ties.slope[1, k] += of_v / s
            power -= (by_law - row.stiffness * stretch(row, ties.law[k], g)) * v
        power -= λ * ties.moved[1, k]
    return power


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


@inlined
def yielding(k, z, ties):
    """C of row k; 0 if its law has no spring."""
    if ties.law[k] < LAW.spring:
        return 0.0 * z
    return 1.0 / (z * (ties.slope[0, k] * z + ties.slope[1, k]))


@recursion
def put_row(k, b, C, S, A, ties, held):
    """Write row k of the small system (S + C) μ = b to A (r, r + 1); free rows, and with `held` springs, are 0.

    The row of a spring is scaled to the pivot of a held row, since a soft spring would make held rows look redundant.
    """
    r = len(S)
    for l in range(r + 1):
        A[k, l] = 0.0 * b
    if ties.law[k] != LAW.held and (held or ties.law[k] == LAW.free):
        return
    weight = S[k, k] / (S[k, k] + C) if C != 0.0 else 1.0 + 0.0 * b
    for l in range(r):
        if ties.law[l] == LAW.held or not (held or ties.law[l] == LAW.free):
            A[k, l] = weight * S[k, l]
    A[k, k] += weight * C
    A[k, r] = weight * b


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
def take_off(x, Y, A, ties):
    """x ← x − Y μ, where A (r, r + 1) is the small system of μ; its last column is then μ."""
    solve_small(A, ties.used)
    for k in range(len(A)):
        for j in range(len(x)):
            x[j] -= A[k, len(A)] * Y[k, j]


@recursion
def hold(z, m, twice, T, Tinv, x, answers, ties):
    """Move x (n,), the solution for eigenvalue m without ties, by the ties, and update the stages' multipliers."""
    J, Y, S, A = ties.middle, answers[0][m], answers[1][m], answers[2]
    r, s = len(J), len(ties.λ)
    for k in range(r):
        off, moved, C = 0.0 * z, 0.0 * z, yielding(k, z, ties)
        for i in range(s):
            off += Tinv[m, i] * ties.gap[i, k]
        for j in range(len(x)):
            moved += J[k, j] * x[j]
        off = off / (z * z) if ties.law[k] == LAW.held else off * C
        put_row(k, moved + off, C, S, A, ties, False)
    take_off(x, Y, A, ties)
    for k in range(r):
        for i in range(s):
            ties.λ[i, k] += twice * (T[i, m] * A[k, r]).real


@subroutine
def project(t, q, qd, work):
    """Put q and q̇ (n,) onto the held rows at time t, in the metric of the step; returns whether all are closed.

    If any row is held, the posture of the workspace is then that of q.
    """
    ties, r, held = work.ties, len(work.ties.rows), 0
    g, factors = ties.gap[0], work.factors[0]
    for k in range(r):
        held += ties.law[k] == LAW.held
    if held > 0:
        place_bodies(q, work.posture)
        factor(factors, work.posture)
    before = off = math.inf
    for again in range(TIMES):
        find_at(t, q, g, ties, work.chain)
        off = 0.0
        for k in range(r):
            if ties.law[k] == LAW.held:
                off = max(off, abs(g[k]))
        if held == 0 or (again > 0 and (off <= CLOSED * ties.size[0] or off >= before)):
            break
        answer(ties.J, factors, ties.real, 0, work.vectors[VECTOR.rhs], work.posture)
        move_by(g, q, ties)
        before = off
    ties.stored[1] = energy(g, ties)
    if held > 0:
        for k in range(r):
            g[k] = rate(k, qd, ties)
        move_by(g, qd, ties)
    return off <= OPEN * ties.size[0]


@recursion
def settle_on_ties(t, error, work):
    """Put the end of the step, at time t, onto the held rows, and add the springs to W; returns nan if they open."""
    closed = project(t, work.new[0], work.new[1], work)
    work.stepper[STEPPER.work] -= work.ties.stored[1] - work.ties.stored[0]
    return error if closed else math.nan


@recursion
def move_by(g, q, ties):
    """q ← q − Y S⁻¹ g over all held rows, with the answers for the first real eigenvalue."""
    for k in range(len(g)):
        put_row(k, g[k], 0.0, ties.real[1][0], ties.real[2], ties, True)
    take_off(q, ties.real[0][0], ties.real[2], ties)


@recursion
def keep(z, e_q, e_v, y, work):
    """Change y (n,) such that J (e_v + y) = 0 at the middle of the step; springs resist e_q and e_v by their slopes."""
    ties = work.ties
    J, Y, S, A, r = ties.middle, ties.real[0][0], ties.real[1][0], ties.real[2], len(ties.rows)
    if len(work.turning.dry) > 0:  # the factors have changed
        answer(J, work.factors[0], ties.real, 0, work.vectors[VECTOR.tau], work.posture)
    for k in range(r):
        b, C = 0.0, yielding(k, z, ties)
        for j in range(len(y)):
            b += J[k, j] * (e_v[j] + y[j])
        if C != 0.0:
            for j in range(len(y)):
                b += C * z * ties.slope[0, k] * J[k, j] * e_q[j]
        put_row(k, b, C, S, A, ties, False)
    take_off(y, Y, A, ties)


@recursion
def pull_back(τ, δ, factors, r, posture, ties):
    """Change a displacement δ (n,) in a time τ without ties, whose matrix has these factors, to that with ties."""
    answer(ties.middle, factors, ties.again, 0, r, posture)
    for k in range(len(ties.rows)):
        moved = 0.0
        for j in range(len(δ)):
            moved += ties.middle[k, j] * δ[j]
        put_row(k, moved, yielding(k, τ, ties), ties.again[1][0], ties.again[2], ties, False)
    take_off(δ, ties.again[0][0], ties.again[2], ties)


@recursion
def accelerate(state, work):
    """Change q̈ at a start such that g̈ = 0 for held rows, by Jᵀ μ alone, and add the springs; factors contain rotors.

    J̇ q̇ is a central difference along q̇, of a relative error of 1e-9, since q̈ at a start serves the error estimate only.
    """
    t, q, qd, qdd = work.stepper[STEPPER.time], state[0], state[1], state[2]
    ties, n, r, x = work.ties, len(state[0]), len(work.ties.rows), work.vectors[VECTOR.solution]
    fastest, g, near, Y = 0.0, ties.gap[0], ties.off[0], ties.real[0][0]
    for k in range(n):
        fastest = max(fastest, abs(qd[k]))
    place_bodies(q, work.posture)
    factor(work.factors[0], work.posture)
    nudge = 1e-5 / max(fastest, 1e-300)
    for k in range(r):
        g[k] = 0.0
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for k in range(n):
            x[k] = q[k] + sign * nudge * qd[k]
        find_at(t, x, near, ties, work.chain)
        for k in range(r):
            for j in range(n):
                g[k] += sign * ties.J[k, j] * qd[j] / (2.0 * nudge)
    find_at(t, q, near, ties, work.chain)
    answer(ties.J, work.factors[0], ties.real, 0, work.vectors[VECTOR.rhs], work.posture)
    for k in range(r):
        ties.off[1, k] = rate(k, qd, ties)
    spring_forces(ties.rows, near, ties.off[1], ties.slope[0], ties.slope[1])
    for k in range(r):
        for j in range(n):
            qdd[j] -= ties.slope[0, k] * Y[k, j]
    for k in range(r):
        g[k] -= ties.moved[2, k]
        for j in range(n):
            g[k] += ties.J[k, j] * qdd[j]
    move_by(g, qdd, ties)


@recursion
def beyond_law(t, q, qd, work):
    """How far the multiplier that is farthest beyond its law is beyond it [N], at a state of the step just taken."""
    ties, largest = work.ties, -math.inf
    find_at(t, q, ties.gap[0], ties, work.chain)
    for k in range(len(ties.rows)):
        row, law, off = ties.rows[k], ties.law[k], -math.inf
        g, v = ties.gap[0, k], rate(k, qd, ties)
        if law == LAW.high:
            off = -pressed(row, 1.0, g, v)
        elif law == LAW.low:
            off = -pressed(row, -1.0, g, v)
        elif law == LAW.free:
            off = max(pressed(row, 1.0, g, v), pressed(row, -1.0, g, v))
        ties.off[0, k] = off
        largest = max(largest, off)
    return largest


@recursion
def note_impulses(left, first, ties):
    """Note the largest impulse of each row beyond its law in the time `left` [s]."""
    for k in range(len(ties.rows)):
        ties.off[1, k] = max(0.0 if first else ties.off[1, k], left * ties.off[0, k])


@recursion
def add_impulses(impulse, ties):
    """Add Jᵀ p of all rows to the impulses of the joints (n,)."""
    for k in range(len(ties.rows)):
        for j in range(len(impulse)):
            impulse[j] += ties.J[k, j] * ties.off[1, k]


@recursion
def take_other_laws(t, ties):
    """Let rows that leave their law at once, as their impulses show, take another one in the step from time t on."""
    for k in range(len(ties.rows)):
        if ties.off[1, k] > 0.0:
            ties.left[k] = t
