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

import numpy as np

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.derivatives.adjoint import add_multiple, stage_back
from flexlink.kernels.forces.elements import find_own_slopes
from flexlink.kernels.forward.mass_plus import place_bodies, solve
from flexlink.kernels.inputs.tip_wrench import put_wrench
from flexlink.kernels.stepping.adaptive import OUTCOME, advance, forget
from flexlink.kernels.stepping.implicit_layout import BUTCHER, STAGE, VECTOR, WEIGHT
from flexlink.kernels.stepping.newton import factor_all
from flexlink.kernels.stepping.step_state import COUNT, STEPPER
from flexlink.kernels.tools.compiler import kernel, recursion, subroutine


@kernel
def go_back_implicitly(work, weights, steps, most, passed, starts, samples, given, λ, found):
    """Take λ (2, n) of the last sample back to the first one, as in `go_back`; `weights`: M_kk (n,).

    `steps`: arguments of `advance`, for at most `most` steps between samples; `passed`: number of knots up to every
    sample, at the times `starts`. Returns −2 − row if a step after sample `row`, or its adjoint, is not found.
    """
    implicit, _, inputs, settings, count, state, _, _, _, _ = steps
    (qs, qds), (s, n), now = samples, work.ν.shape, implicit.stepper
    t, q, K, size = np.empty(most + 1), np.empty((most, 2, n)), np.empty((most, s, n)), min(s * n, 200)
    krylov = weights, np.empty((2, s, n)), np.empty((size, s, n)), np.empty((size, s, n)), np.empty(size)
    for row in range(len(found) - 1, -1, -1):
        forget(now)
        state[0][:], state[1][:], found[row, :] = qs[row], qds[row], 0.0
        now[STEPPER.time], now[STEPPER.step], count[COUNT.knot], i = starts[row], settings[8], passed[row], 0
        while count[COUNT.knot] < passed[row + 1]:
            t[i], q[i, 0, :], q[i, 1, :] = now[STEPPER.time], state[0], state[1]
            if advance(*steps) == OUTCOME.stuck:
                return -2 - row
            K[i], i = implicit.stages[STAGE.qdd], i + 1
        t[i] = now[STEPPER.time]
        for k in range(n):
            if state[0][k] != qs[row + 1, k] or state[1][k] != qds[row + 1, k]:
                return row
        for j in range(i - 1, -1, -1):
            implicit.stages[STAGE.qdd] = K[j]
            if not step_back(work, implicit, inputs, t[j], t[j + 1] - t[j], q[j], krylov, λ, found[row]):
                return -2 - row
        λ += given[:, row]
    return -1


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
        if dot(r, r, weights) <= 1e-26 * first:
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
