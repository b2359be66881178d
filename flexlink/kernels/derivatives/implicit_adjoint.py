"""Gradient of a function J of a run's samples by the discrete adjoint of implicit Runge-Kutta steps, back in time.

The stages K_i of `implicit` satisfy R_i = f(Q_i, V_i) − M(Q_i) K_i = 0. Their multipliers w_i, of all stages at once,
follow from the adjoint λ of the state at the end of the step. With κ_i = ∂(w_i·R_i)/∂Q_i and δ_i = ∂(w_i·R_i)/∂V_i:

    M(Q_i) w_i − Σ_j (h² (A²)_ji κ_j + h a_ji δ_j) = h² (b A)_i λ_q + h b_i λ_q̇
    λ_q̇ ← λ_q̇ + h λ_q + Σ (c_i h κ_i + δ_i)        λ_q ← λ_q + Σ κ_i        ∂J/∂T_EX = Σ w_i

The products κ and δ for given w take O(n). Conjugate residuals (Eisenstat, Elman & Schultz 1983) solve this system,
S w = ν, with the transposed matrices of `newton` as preconditioner, P⁻¹ = T⁻ᵀ (M + A_λ)⁻¹ Tᵀ: each direction p_m makes
the residual r = P⁻¹ (ν − S w) as small as possible in the norm Σ M_kk r_k², since joints move very different inertias.
Gravity, velocity terms, changes of M and dry friction remain to them; a few directions reach the rounding error.

The steps are repeated from sample to sample, by the same code as in the run.
"""

import math

import numpy as np

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.derivatives.adjoint import add_multiple, stage_back
from flexlink.kernels.forces.elements import find_own_slopes
from flexlink.kernels.forward.mass_plus import place_bodies, solve
from flexlink.kernels.inputs.tip_wrench import put_wrench
from flexlink.kernels.stepping.adaptive import NEARLY, OUTCOME, advance, forget
from flexlink.kernels.stepping.implicit_layout import BUTCHER, STAGE, VECTOR, WEIGHT
from flexlink.kernels.stepping.newton import factor_all
from flexlink.kernels.stepping.step_state import COUNT, STEPPER
from flexlink.kernels.tools.compiler import kernel, recursion, subroutine


@kernel
def go_back_implicitly(work, weights, steps, laws, most, passed, starts, samples, given, λ, found):
    """Take λ (2, n) of the last sample back to the first one, as in `go_back`; `weights`: M_kk (n,).

    `steps`: arguments of `advance`; `laws`: number of `friction_laws`; `most`: room for steps and their parts between
    samples; `passed`: number of knots up to every sample, at the times `starts`. Returns −2 − row if the steps after
    sample `row`, or their adjoint, are not found.
    """
    implicit, _, inputs, _, count, state, _, _, _, _ = steps
    (qs, qds), (s, n), now = samples, work.ν.shape, implicit.stepper
    taken = np.empty((most, 2)), np.empty((most, 2, n)), np.empty((most, s, n)), np.zeros(1, np.int64)
    (t, q, K, number), stop = taken, (np.empty(1), np.full(1, math.inf))
    size = min(s * n + 10, 200)  # rounding errors cost a few more than s n directions
    krylov = weights, np.empty((2, s, n)), np.empty((size, s, n)), np.empty((size, s, n)), np.empty(size)
    for row in range(len(found) - 1, -1, -1):
        forget(now)
        state[0][:], state[1][:], found[row, :] = qs[row], qds[row], 0.0
        now[STEPPER.time], now[STEPPER.step], count[COUNT.knot], number[0] = starts[row], steps[3][8], passed[row], 0
        while count[COUNT.knot] < passed[row + 1]:
            if take(steps, taken) == OUTCOME.stuck and not take_parts(steps, laws, stop, taken):
                return -2 - row
        for k in range(n):
            if state[0][k] != qs[row + 1, k] or state[1][k] != qds[row + 1, k]:
                return row
        for i in range(number[0] - 1, -1, -1):
            implicit.stages[STAGE.qdd] = K[i]
            if not step_back(work, implicit, inputs, t[i, 0], t[i, 1] - t[i, 0], q[i], krylov, λ, found[row]):
                return -2 - row
        λ += given[:, row]
    return -1


@recursion
def take(steps, taken):
    """Take one step, and add its times, its first state and its K_i to those `taken`; returns its OUTCOME."""
    (t, q, K, number), implicit, state = taken, steps[0], steps[5]
    i = number[0]
    if i == len(t):
        return OUTCOME.stuck
    t[i, 0] = implicit.stepper[STEPPER.time]
    for k in range(len(state[0])):
        q[i, 0, k], q[i, 1, k] = state[0][k], state[1][k]
    how = advance(*steps)
    if how != OUTCOME.stuck:
        t[i, 1], number[0] = implicit.stepper[STEPPER.time], i + 1
        for j in range(K.shape[1]):
            for k in range(K.shape[2]):
                K[i, j, k] = implicit.stages[STAGE.qdd, j, k]
    return how


@recursion
def take_parts(steps, laws, stop, taken):
    """Take a step in parts, as in `MethodSteps.step_in_parts`; return whether this succeeds."""
    implicit, forward, inputs, settings, count, state, tau, knots, samples, one = steps
    now, k, step, start = implicit.stepper, count[COUNT.knot], settings[8], implicit.stepper[STEPPER.time]
    at_knot, how = start + NEARLY * step >= knots[0][k], OUTCOME.stuck
    stop[0][0] = knots[0][k] if at_knot else start + step
    for trial in range(6 * laws):
        part, now[STEPPER.turning] = (stop[0][0] - start) / 2.0 ** (trial % 6 + 1), math.inf if trial > 5 else 0.0
        forget(now)
        now[STEPPER.step], count[COUNT.knot], how = part, 0, OUTCOME.goes_on
        parts = implicit, forward, inputs, (*settings[:7], part, part), count, state, tau, stop, samples, one
        while how == OUTCOME.goes_on:
            how = take(parts, taken)
        if how == OUTCOME.ended:
            break
    forget(now)
    now[STEPPER.turning], now[STEPPER.step], count[COUNT.knot] = 0.0, step, k + 1 if at_knot else k
    return how == OUTCOME.ended


@recursion
def step_back(work, implicit, inputs, t, h, start, krylov, λ, torque):
    """Take λ back by a step h from time t and `start` (2, n), add ∂J/∂T_EX to `torque`; return whether it is found."""
    (b, bA, c, _), ν, w, (κ, δ) = implicit.method.weights, work.ν, work.ρ, krylov[1]
    place_stages(h, start[0], start[1], implicit)
    for i in range(len(ν)):
        for k in range(len(torque)):
            ν[i, k] = h * h * bA[i] * λ[0, k] + h * b[i] * λ[1, k]
    converged = solve_stages(work, implicit, inputs, t, h, krylov, ν, w)
    multiply(work, implicit, inputs, t, h, krylov[1], w, ν)
    add_multiple(h, λ[0], λ[1])
    for i in range(len(w)):
        add_multiple(1.0, κ[i], λ[0])
        add_multiple(c[i] * h, κ[i], λ[1])
        add_multiple(1.0, δ[i], λ[1])
        add_multiple(1.0, w[i], torque)
    return converged


@recursion
def place_stages(h, q, qd, implicit):
    """Write Q_i and V_i of all stages, and factor Newton's matrices."""
    A, A2, c = implicit.method.A[BUTCHER.A], implicit.method.A[BUTCHER.A2], implicit.method.weights[WEIGHT.c]
    K, Q, V = implicit.stages[STAGE.qdd], implicit.stages[STAGE.q], implicit.stages[STAGE.qd]
    middle, rates = implicit.vectors[VECTOR.q_middle], implicit.vectors[VECTOR.qd_middle]
    for k in range(len(q)):
        middle[k], rates[k] = q[k] + 0.5 * h * qd[k], qd[k]
        for i in range(len(K)):
            Q[i, k], V[i, k] = q[k] + c[i] * h * qd[k], qd[k]
            for j in range(len(K)):
                Q[i, k], V[i, k] = Q[i, k] + h * h * A2[i, j] * K[j, k], V[i, k] + h * A[i, j] * K[j, k]
    place_bodies(middle, implicit.posture)
    if implicit.forces is not None:
        find_own_slopes(implicit.forces, middle, rates, implicit.springs.own)
    factor_all(h, rates, implicit)


@recursion
def solve_stages(work, implicit, inputs, t, h, krylov, ν, w):
    """Find the multipliers w (s, n) with S w = ν; return whether the residual falls to 1e-13 of that of w = 0."""
    weights, slopes, p, Sp, squares = krylov  # directions p_m; P⁻¹ S p_m, which are made orthogonal; their squares
    r, product = implicit.stages[STAGE.divided], implicit.stages[STAGE.residual]
    w[:] = 0.0
    precondition(ν, r, implicit)
    first = dot(r, r, weights)
    for m in range(len(p)):
        if dot(r, r, weights) <= 1e-26 * first < math.inf:
            return True
        for i in range(len(w)):
            for k in range(len(weights)):
                p[m, i, k] = r[i, k]
        multiply(work, implicit, inputs, t, h, slopes, p[m], product)
        precondition(product, Sp[m], implicit)
        for j in range(m):
            β = dot(Sp[m], Sp[j], weights) / squares[j]
            for i in range(len(w)):
                add_multiple(-β, p[j, i], p[m, i])
                add_multiple(-β, Sp[j, i], Sp[m, i])
        squares[m] = dot(Sp[m], Sp[m], weights)
        α = dot(r, Sp[m], weights) / squares[m]
        for i in range(len(w)):
            add_multiple(α, p[m, i], w[i])
            add_multiple(-α, Sp[m, i], r[i])
    return False


@subroutine
def multiply(work, implicit, inputs, t, h, slopes, w, r):
    """Write κ and δ to `slopes` (2, s, n), and r = S w, for the multipliers w (s, n)."""
    A, c, (κ, δ), (bare, inverse) = implicit.method.A, implicit.method.weights[WEIGHT.c], slopes, work.bare
    for i in range(len(w)):
        Q, V = implicit.stages[STAGE.q, i], implicit.stages[STAGE.qd, i]
        inverse_dynamics_into(bare, work.nothing, Q, work.vectors[0], w[i], r[i], inverse)  # also turns planar links
        put_wrench(inputs.loads, t + c[i] * h, t + 0.5 * h, Q, V, inputs.wrench)
        stage_back(work, inputs.wrench, Q, V, implicit.stages[STAGE.qdd, i], w[i], κ[i], δ[i])
    for i in range(len(w)):
        for j in range(len(w)):
            add_multiple(-h * h * A[BUTCHER.A2, j, i], κ[j], r[i])
            add_multiple(-h * A[BUTCHER.A, j, i], δ[j], r[i])


@recursion
def precondition(r, x, implicit):
    """Write x = P⁻¹ r for r and x (s, n)."""
    method, y, z = implicit.method, implicit.vectors, implicit.pairs
    x[:] = 0.0
    for m in range(len(method.real)):
        y[VECTOR.rhs] = 0.0
        for i in range(len(r)):
            add_multiple(method.T_real[i, m], r[i], y[VECTOR.rhs])
        solve(implicit.factors[m], y[VECTOR.rhs], y[VECTOR.solution], implicit.posture)
        for i in range(len(r)):
            add_multiple(method.Tinv_real[m, i], y[VECTOR.solution], x[i])
    for m in range(len(method.pairs)):
        z[0] = 0.0
        for i in range(len(r)):
            add_multiple(method.T_pairs[i, m], r[i], z[0])
        solve(implicit.factors_pairs[m], z[0], z[1], implicit.posture)
        for i in range(len(r)):
            for k in range(x.shape[1]):
                x[i, k] += 2.0 * (method.Tinv_pairs[m, i] * z[1, k]).real


@recursion
def dot(a, b, weights):
    """Scalar product of a and b (s, n)."""
    total = 0.0
    for i in range(len(a)):
        for k in range(len(weights)):
            total += weights[k] * a[i, k] * b[i, k]
    return total
