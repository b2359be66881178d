"""Ties: rows g(q, t), each with a multiplier λ, in the stages of a step; O(n) for each row.

    M q̈ + h(q, q̇) + Jᵀ λ = τ        J = ∂g/∂q,  ġ = J q̇ + ∂g/∂t

    POINT      g = u · (p_a − p_b)       along a direction u of body b, or of frame 0
    DISTANCE   g = |p_a − p_b| − l(t)    a rod, a cable, a cylinder
    JOINT      g = q_a − r q_b           a coordinate; with b, two that move in the ratio r

The law of a row gives λ. A row is held, or a spring with damper; with a free range, low < g < high, it is a spring
beyond the range, whose losses grow with the depth δ (Hunt & Crossley 1975):

    held       g = 0
    spring     λ = k g + d ġ
    range      λ = k δ (1 + c |ġ|)       δ = g − high > 0 or g − low < 0, ġ > 0 deeper; else λ = 0
    oil        λ = A_b p_b − A_a p_a + d ġ        p = p₀ + β ln(V(l) / V(l + g)) in each closed chamber, or 0 absolute

A step keeps the law that is valid at its start, so it is smooth, and ends where this changes (`saturation`).

All stages of an implicit step satisfy the law (index 3 for held rows). In the coordinates of `newton`, one system for
each eigenvalue, with z = hλ_A for an eigenvalue λ_A of the method's A, each system gets the rows as a border:

    (M + A_z) x + Jᵀ μ = (T⁻¹ R)         Y = (M + A_z)⁻¹ Jᵀ,  S = J Y
    held       z² J x = −(T⁻¹ g)                                 S μ = J x⁰ + (T⁻¹ g) / z²      x⁰: without ties
    spring     μ = (T⁻¹ (λ(g) − λ)) + (k z² + d z) J x      (S + C) μ = J x⁰ + C (T⁻¹ (λ(g) − λ)),  C = 1 / (k z² + d z)
    x = x⁰ − Y μ,  λ_i ← λ_i + Σ T_iz μ_z

Held rows that depend on others at the posture in the middle of the step are redundant: their multipliers do not change.

What the iteration leaves of g would have to be undone within the next step, by q̈ of the order g / h², and of J q̇ an
error of h³ would remain. Therefore both are removed after every step and in every sample, in the metric of the step, in
which stiff vibrations stay quiet:

    q ← q − Y S⁻¹ g        q̇ ← q̇ − Y S⁻¹ ġ

The error of a step keeps J e = 0, and q̈ at a start satisfies g̈ = 0; springs enter both with k and d. So do the stages
of an explicit step, whose end is put onto the rows in the metric M:

    q̈ = q̈⁰ − M⁻¹ Jᵀ λ        J q̈ + J̇ q̇ + ∂ġ/∂t = 0        q̈⁰: without ties

The work of all forces contains the energy E that springs store, as a function of q and l, so that it is exact:

    W = −∫ (λ − λ_E) ġ + (λ − ∂E/∂l) l̇ dt − Σ E        λ_E = ∂E/∂g, E = ½ k δ² of springs
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.forward.mass_plus import factor, place_bodies, shift_cells, solve
from flexlink.kernels.forward.mass_plus_cells import FACTORS
from flexlink.kernels.geometry.kinematics import spread
from flexlink.kernels.inputs.drive_torque import follow
from flexlink.kernels.stepping.implicit_layout import VECTOR
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.tie_rows import (
    LAW,
    find_row,
    find_rows,
    law_of,
    load,
    multiplier,
    other_law,
    place_all,
    power_beside,
    stored,
)
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine

REDUNDANT = 1e-11
"""Pivot of S, relative to the largest, up to which a row is redundant: above the rounding errors of any useful arm."""
CLOSED = 1e-14
"""Largest |g| of a closed row, relative to the size of the arm."""
OPEN = 1e-10
"""Largest |g| after a step, relative to the size; a step that leaves more is refused: its posture is singular."""
OTHERS = 1e-3  # weight of the pivot of a row that had no part in the last system
TIMES = 8  # corrections of q after a step; one is enough if the step is accurate


class Answers(NamedTuple):
    """Answers of the chain to multipliers, and the small system, for p eigenvalues of one kind."""

    Y: Any  # (p, r, n)
    S: Any  # (p, r, r)
    G: Any  # (p, r, r) the inverse of S + C
    C: Any  # (p, r)
    b: Any  # (r,) scratch, as are the next two
    μ: Any  # (r,)
    r: Any  # (n,)


class Ties(NamedTuple):
    """Rows of a chain, and scratch for an implicit method with s stages; explicit ones keep no multipliers: s = 1."""

    rows: Any  # (r,) TIE
    size: Any  # (1,) of the arm [m]
    ranges: Any  # (4,) rows with a free range; those that press in this step; rows with a spring; prescribed joints
    lengths: Any  # l(t) of rows whose length moves, as `follow` reads it
    moved: Any  # (3, r) l, l̇, l̈ of these rows; 0: others
    law: Any  # (r,) LAW of each row in this step
    left: Any  # (r,) start of a step that takes another law, as the row leaves its own at once [s]; nan: none
    λ: Any  # (s, r) multipliers of the stages
    last: Any  # (s, r) the same of the last accepted step
    gap: Any  # (s, r) g of held rows, λ(g) − λ of others
    slope: Any  # (2, r) ∂λ/∂g and ∂λ/∂ġ, means of the stages; of an explicit step, at the last one
    stored: Any  # (2,) E of all rows at the start of the step, and at the last state [J]
    off: Any  # (2, r) how far λ is beyond its law [N], and its impulse in the rest of the step [N s]
    placed: Any  # Places
    J: Any  # (r, n)
    middle: Any  # (r, n) J at the middle of the step; of an explicit step, at its end
    real: Answers
    pairs: Answers  # for the complex eigenvalues
    again: Answers  # for one other matrix
    used: Any  # (r,) 0: redundant, or without a part in the last small system
    no_wrench: Any  # (6,) zeros


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


@inlined
def rate_by_motions(k, qd, work):
    """The part of ġ of row k that prescribed joints cause, against which their torques do work."""
    v = 0.0
    for j in range(len(qd)):
        if work.chain.hinges[j].prescribed:
            v += work.ties.J[k, j] * qd[j]
    return v


@recursion
def power_of_motions(q, qd, qdd, work):
    """Power of prescribed joints against inertia and gravity."""
    power, torque = 0.0, work.vectors[VECTOR.rhs]
    if work.ties.ranges[3] > 0:
        inverse_dynamics_into(work.chain, work.ties.no_wrench, q, qd, qdd, torque, work.inverse)
        for k in range(len(q)):
            power += qd[k] * torque[k] if work.chain.hinges[k].prescribed else 0.0
    return power


@recursion
def energy(g, ties):
    """Energy stored in all springs by the laws of the step [J]."""
    E = 0.0
    for k in range(len(ties.rows)):
        E += stored(ties.rows[k], ties.law[k], g[k], ties.moved[0, k])[0]
    return E


@recursion
def choose_laws(t, q, qd, work):
    """Find the laws at the start of a step, and the energy that springs store there; held rows have one law."""
    ties, g = work.ties, work.ties.gap[0]
    if ties.ranges[2] == 0:
        return
    find_at(t, q, g, ties, work.chain)
    ties.ranges[1] = 0
    for k in range(len(ties.rows)):
        law = law_of(ties.rows[k], g[k], rate(k, qd, ties), ties.moved[0, k])
        ties.law[k] = other_law(ties.rows[k], law, g[k]) if ties.left[k] == t else law
        ties.ranges[1] += ties.law[k] > LAW.spring
    ties.stored[0] = energy(g, ties)


@subroutine
def begin_ties(t, h, state, middle, work):
    """Find the laws at the start of the step, and J in its middle.

    The stages begin with extrapolated multipliers; those of redundant rows, which nothing corrects, keep the value at
    the end of the last step: extrapolated from step to step, they would grow against those of the rows in their place.
    """
    ties, first = work.ties, work.stepper[STEPPER.last_step] == 0.0
    choose_laws(t, state[0], state[1], work)
    for k in range(len(ties.rows)):
        redundant = ties.law[k] == LAW.held and ties.used[k] == 0.0
        for i in range(len(ties.λ)):
            if first or ties.law[k] == LAW.free:
                ties.λ[i, k] = 0.0
            elif redundant:
                ties.λ[i, k] = ties.last[len(ties.λ) - 1, k]
    find_at(t + 0.5 * h, middle, ties.gap[0], ties, work.chain)
    keep_slopes(ties)


@inlined
def keep_slopes(ties):
    """Keep J as that of the step."""
    for k in range(len(ties.J)):
        for j in range(ties.J.shape[1]):
            ties.middle[k, j] = ties.J[k, j]


@inlined
def noise_of_ties(h, work):
    """Factor of rounding errors in Newton's iteration: those of g become errors g / h of rates, for a time 1/ω₁.

    Measured: up to 4 rounding errors of a position times 1 / (ω₁ h); 6 are allowed, in units of 200.
    """
    return 1.0 if work.ties is None else max(1.0, 0.03 * work.stepper[STEPPER.inverse_ω1] / h)


@inlined
def pull(i, t, q, qd, R, work):
    """Subtract Jᵀ λ from the residual R (n,) of stage i, and note its gaps; returns the power beside that of E.

    J is needed only for laws that depend on ġ: the multipliers are forces on bodies.
    """
    ties, placed, power, s = work.ties, work.ties.placed, 0.0, len(work.ties.λ)
    follow(ties.lengths, t, ties.moved[0], ties.moved[1], ties.moved[2])
    place_all(work.chain, q, placed)
    placed.loads[:, :] = 0.0
    for k in range(len(ties.rows)):
        λ, row, l = ties.λ[i, k], ties.rows[k], ties.moved[0, k]
        if i == 0:
            ties.slope[0, k] = ties.slope[1, k] = 0.0
        g = load(row, l, λ, q, placed, R)
        if ties.law[k] == LAW.held:
            power -= λ * ties.moved[1, k]
            # its rounding errors over h² would be accelerations
            ties.gap[i, k] = 0.0 if abs(g) <= 0.1 * CLOSED * ties.size[0] else g
        else:
            find_row(work.chain, row, l, q, placed, ties.J[k])
            v = rate(k, qd, ties)
            by_law, of_g, of_v = multiplier(row, ties.law[k], g, v, l)
            ties.gap[i, k] = by_law - λ
            ties.slope[0, k] += of_g / s
            ties.slope[1, k] += of_v / s
            power += power_beside(row, ties.law[k], g, v, by_law, l, ties.moved[1, k])
    spread(work.chain, placed, placed.loads, R)
    if ties.ranges[3] > 0:
        for k in range(len(q)):  # R was 0 there
            power -= qd[k] * R[k] if work.chain.hinges[k].prescribed else 0.0
    return power


@recursion
def answer(J, factors, z, held, answers, m, posture, ties):
    """Write Y = (M + A_z)⁻¹ Jᵀ, as rows, S = J Y and G for eigenvalue m; with `held` only held rows act."""
    Y, S, r = answers.Y[m], answers.S[m], answers.r
    for k in range(len(J)):
        for j in range(len(r)):
            r[j] = J[k, j]
        solve(factors, r, Y[k], posture)
    for k in range(len(J)):
        for l in range(len(J)):
            S[k, l] = 0.0
            for j in range(len(r)):
                S[k, l] += J[k, j] * Y[l, j]
    invert(z, held, answers, m, ties)


@subroutine
def answer_ties(h, work):
    """Find Y, S and G for every eigenvalue, whose factors are known."""
    ties, method = work.ties, work.method
    for m in range(len(method.real)):
        answer(ties.middle, work.factors[m], h * method.real[m], False, ties.real, m, work.posture, ties)
    for m in range(len(method.pairs)):
        answer(ties.middle, work.factors_pairs[m], h * method.pairs[m], False, ties.pairs, m, work.posture, ties)


@inlined
def acts(k, held, ties):
    """Whether row k has a part in the small system; with `held` only held rows have."""
    return ties.law[k] == LAW.held or not (held or ties.law[k] == LAW.free)


@recursion
def invert(z, held, answers, m, ties):
    """Write C, and G with μ = G b for (S + C) μ = b; its rows and columns are 0 for redundant rows, and without a part.

    Elimination with the largest pivot first; a row whose pivot is a rounding error depends on those before it. Rows
    that had a part in the last system come first, so that of rows that depend on each other the same stay redundant.
    The row of a spring is scaled to the pivot of a held row, since a soft spring would make held rows look redundant.
    """
    S, C, G, weight = answers.S[m], answers.C[m], answers.G[m], answers.μ
    used, r, first = ties.used, len(ties.rows), 0.0
    for k in range(r):
        used[k] = -OTHERS if used[k] == 0.0 else -1.0  # until the row is used: the weight of its pivot
        C[k] = 0.0 * z
        if ties.law[k] >= LAW.spring and not held:
            C[k] = 1.0 / (z * (ties.slope[0, k] * z + ties.slope[1, k]))
        weight[k] = S[k, k] / (S[k, k] + C[k]) if C[k] != 0.0 else 1.0 + C[k]
        for l in range(r):
            G[k, l] = weight[k] * S[k, l] if acts(k, held, ties) and acts(l, held, ties) else 0.0 * z
        if acts(k, held, ties):
            G[k, k] += weight[k] * C[k]
    for _ in range(r):
        p = -1
        for k in range(r):
            if used[k] < 0.0 and (p < 0 or used[k] * abs(G[k, k]) < used[p] * abs(G[p, p])):
                p = k
        first = max(first, abs(G[p, p]))
        if abs(G[p, p]) <= REDUNDANT * first:
            used[p] = 0.0
            continue
        used[p], pivot = 1.0, 1.0 / G[p, p]
        G[p, p] = 1.0 + 0.0 * z
        for l in range(r):
            G[p, l] *= pivot
        for k in range(r):
            if k != p:
                part = G[k, p]
                G[k, p] = 0.0 * z
                for l in range(r):
                    G[k, l] -= part * G[p, l]
    for k in range(r):
        for l in range(r):
            G[k, l] = G[k, l] * weight[l] if used[k] * used[l] > 0.0 else 0.0 * z


@recursion
def take_off(x, answers, m):
    """x ← x − Y μ, where μ = G b."""
    Y, G, b, μ = answers.Y[m], answers.G[m], answers.b, answers.μ
    for k in range(len(b)):
        μ[k] = 0.0
        for l in range(len(b)):
            μ[k] += G[k, l] * b[l]
    for k in range(len(b)):
        for j in range(len(x)):
            x[j] -= μ[k] * Y[k, j]


@recursion
def hold(z, m, twice, T, Tinv, x, answers, ties):
    """Move x (n,), the solution for eigenvalue m without ties, by the ties, and update the stages' multipliers."""
    J, r, s = ties.middle, len(ties.rows), len(ties.λ)
    if ties.ranges[1] > 0:  # their slopes change from pass to pass
        invert(z, False, answers, m, ties)
    for k in range(r):
        off, moved = 0.0 * z, 0.0 * z
        for i in range(s):
            off += Tinv[m, i] * ties.gap[i, k]
        for j in range(len(x)):
            moved += J[k, j] * x[j]
        answers.b[k] = moved + (off / (z * z) if ties.law[k] == LAW.held else off * answers.C[m, k])
    take_off(x, answers, m)
    for k in range(r):
        for i in range(s):
            ties.λ[i, k] += twice * (T[i, m] * answers.μ[k]).real


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
        answer(ties.J, factors, 0.0, True, ties.real, 0, work.posture, ties)
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
        ties.real.b[k] = g[k]
    take_off(q, ties.real, 0)


@recursion
def keep(z, e_q, e_v, y, work):
    """Change y (n,) such that J (e_v + y) = 0 at the middle of the step; springs resist e_q and e_v by their slopes."""
    ties, b = work.ties, work.ties.real.b
    if len(work.turning.dry) > 0:  # the factors have changed
        answer(ties.middle, work.factors[0], z, False, ties.real, 0, work.posture, ties)
    for k in range(len(b)):
        b[k], by_spring = 0.0, ties.real.C[0, k] * z * ties.slope[0, k] if ties.law[k] >= LAW.spring else 0.0
        for j in range(len(y)):
            b[k] += ties.middle[k, j] * (e_v[j] + y[j] + by_spring * e_q[j])
    take_off(y, ties.real, 0)


@recursion
def pull_back(τ, δ, factors, posture, ties):
    """Change a displacement δ (n,) in a time τ without ties, whose matrix has these factors, to that with ties."""
    b = ties.again.b
    answer(ties.middle, factors, τ, False, ties.again, 0, posture, ties)
    for k in range(len(b)):
        b[k] = 0.0
        for j in range(len(δ)):
            b[k] += ties.middle[k, j] * δ[j]
    take_off(δ, ties.again, 0)


@recursion
def accelerate(t, q, qd, qdd, work):
    """Add the springs to q̈ by the laws of the step, and change it such that g̈ = 0 for held rows, by Jᵀ λ alone.

    Returns the power beside that of E, and what it changes of the power of prescribed joints. J̇ q̇ is a central
    difference along q̇, of a relative error of about 1e-10.
    """
    ties, n, r, x = work.ties, len(q), len(work.ties.rows), work.vectors[VECTOR.solution]
    fastest, power, g = 0.0, -power_of_motions(q, qd, qdd, work), ties.gap[0]
    near, Y = ties.off[0], ties.real.Y[0]
    for k in range(n):
        fastest = max(fastest, abs(qd[k]))
        work.factors[0, k, FACTORS.A] = work.chain.hinges[k].armature
    place_bodies(q, work.posture)
    shift_cells(0.0, work.factors[0], work.posture)
    factor(work.factors[0], work.posture)
    nudge = 1e-5 / max(fastest, 1e-300)
    g[:] = 0.0
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for k in range(n):
            x[k] = q[k] + sign * nudge * qd[k]
        find_at(t, x, near, ties, work.chain)
        for k in range(r):
            for j in range(n):
                g[k] += sign * ties.J[k, j] * qd[j] / (2.0 * nudge)
    find_at(t, q, near, ties, work.chain)
    answer(ties.J, work.factors[0], 0.0, True, ties.real, 0, work.posture, ties)
    for k in range(r):
        row, law, v = ties.rows[k], ties.law[k], rate(k, qd, ties)
        if law != LAW.held:
            λ, ties.slope[0, k], ties.slope[1, k] = multiplier(row, law, near[k], v, ties.moved[0, k])
            power += power_beside(row, law, near[k], v, λ, ties.moved[0, k], ties.moved[1, k])
            power += λ * rate_by_motions(k, qd, work)
            for j in range(n):
                qdd[j] -= λ * Y[k, j]
    for k in range(r):
        g[k] -= ties.moved[2, k]
        for j in range(n):
            g[k] += ties.J[k, j] * qdd[j]
    move_by(g, qdd, ties)
    for k in range(r):
        μ = ties.real.μ[k]  # of held rows; springs have no part in this system
        power += μ * (rate_by_motions(k, qd, work) - ties.moved[1, k])
    return power + power_of_motions(q, qd, qdd, work)
