"""One step of an explicit Runge-Kutta method with error estimate; its last stage is the next step's first (FSAL).

L_i = q̇ + h Σ_j<i a_ij K_j        K_i = f(t + c_i h, q + h Σ_j<i a_ij L_j, L_i)
q ← q + h Σ b_i L_i               q̇ ← q̇ + h Σ b_i K_i              K_s+1 = f(t + h, q, q̇)

One or two rows d of weights give e_q = h Σ d_i L_i and e_v = h Σ d_i K_i, i = 1 … s + 1, with the norm of `error_norm`.
If there are two error estimates, ε and ε₃ of lower order, the error is ε² / √(ε² + ε₃² / 100) (Hairer, Nørsett &
Wanner, Solving Ordinary Differential Equations I, II.10).

Dense output at t + x h, from the stages of the step and e additional stages, i = 1 … s + 1 + e (the same book, II.6):

    q̇(x) = q̇ + h Σ β_i(x) K_i     q(x) = q + x h q̇ + h² Σ α_i(x) K_i     W(x) = W + h Σ β_i(x) P_i

The method defines the β_i, which have a lower order than the step. α_i = ∫ β_i plus a cubic polynomial that is 0 at
x = 0 and gives the end of the step at x = 1, so q is as accurate inside the step as at its end.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.forces.elements import find_own_slopes
from flexlink.kernels.forward.mass_plus import place_bodies
from flexlink.kernels.forward.solvers import forward_under
from flexlink.kernels.inputs.drive_torque import follow, stage_torque
from flexlink.kernels.stepping.error_norm import step_error_norm
from flexlink.kernels.stepping.runge_kutta import add_stage
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.ties import accelerate, choose_laws, keep_slopes, project
from flexlink.kernels.tools.compiler import inlined, recursion


class EmbeddedMethod(NamedTuple):
    """Coefficients of a method, and the weights d of its error estimates."""

    A: Any
    b: Any
    c: Any
    d: Any  # (1 or 2, s + 1)
    beyond: Any  # (e, s + 1 + e) rows of A of the additional stages; None, like the next two, without dense output
    beyond_c: Any  # (e,)
    dense: Any  # (2, s + 1 + e, powers) coefficients of the polynomials β_i / x and α_i / x²


class EmbeddedWork(NamedTuple):
    """Scratch of `embedded_step`, and the constants of a chain."""

    method: EmbeddedMethod
    chain: Any
    forward: Any  # scratch of forward dynamics
    posture: Any
    stepper: Any  # a `STEPPER`
    new: Any  # (3, n) q, q̇, q̈ at the end of the step
    K: Any  # (s + 1 + e, n) accelerations of the stages; L, same shape: rates
    L: Any
    power: Any  # (s + 1 + e,)
    inside: Any  # (2, powers, n) dense output: coefficients of the powers of x for rates and for angles
    power_inside: Any  # (powers,) the same for W
    Q: Any  # (n,)
    tau: Any
    e: Any  # (2, n)
    springs: Any  # see `error_norm`
    saturation: Any  # see `saturation`
    forces: Any  # force elements; None for a plain chain
    ties: Any = None  # see `ties`; None, like the next three: an open chain
    factors: Any = None  # (1, n, 8) of M
    vectors: Any = None  # scratch of `ties`, as in `implicit_layout`
    inverse: Any = None


@recursion
def embedded_step(t, h, inputs, state, allowed, work):
    """Step from `state` q, q̇, q̈ (n,) and W (2,) to `work.new`; returns its error [m] and 1 as the number of passes."""
    q, qd, qdd, done = state
    A, b, c, d = work.method.A, work.method.b, work.method.c, work.method.d
    K, L, power, s = work.K, work.L, work.power, len(c)
    for k in range(len(q)):
        L[0, k], K[0, k] = qd[k], qdd[k]
    power[0] = done[1]
    if work.ties is not None:
        choose_laws(t, q, qd, work)
    work.stepper[STEPPER.work] = done[0] + h * b[0] * power[0]
    for i in range(1, s):
        power[i] = evaluate(t, c[i], h, inputs, q, qd, A[i], i, work.Q, work)
        work.stepper[STEPPER.work] += h * b[i] * power[i]
    power[s] = evaluate(t, 1.0, h, inputs, q, qd, b, s, work.new[0], work)
    work.stepper[STEPPER.power] = power[s]
    for k in range(len(q)):
        work.new[1, k], work.new[2, k] = L[s, k], K[s, k]
    place_bodies(work.new[0], work.posture)
    if work.forces is not None:
        find_own_slopes(work.forces, work.new[0], work.new[1], work.springs.own)
    if work.ties is not None:
        work.stepper[STEPPER.work] -= work.ties.stored[1] - work.ties.stored[0]
        keep_slopes(work.ties)
    if len(d) == 0:  # a method for fixed steps
        return 0.0, 1
    ε = error_by(0, h, work)
    if len(d) == 1 or ε == 0.0:
        return ε, 1
    drift, kick = work.stepper[STEPPER.drift], work.stepper[STEPPER.kick]
    error = ε * ε / math.hypot(ε, 0.1 * error_by(1, h, work))
    work.stepper[STEPPER.drift], work.stepper[STEPPER.kick] = drift * error / ε, kick * error / ε
    return error, 1


@inlined
def evaluate(start, part, h, inputs, q, qd, weights, i, angles, work):
    """Write angles, L_i and K_i of stage i, at the fraction `part` of the step; returns the power there.

    The last stage, at the end of the step, is put onto the ties; it is nan, and so is the error, if they stay open.
    """
    t = start + part * h
    K, L, tau = work.K, work.L, work.tau
    for k in range(len(q)):
        angles[k], L[i, k], tau[k] = q[k], qd[k], 0.0
    for j in range(i):
        add_stage(weights[j] * h, L, K, j, angles, L[i])
    follow(inputs.motion, t, angles, L[i], K[i])
    if work.ties is not None and i == len(work.method.c) and not project(t, angles, L[i], work):
        angles[0] = math.nan
    stage_torque(inputs.drive, t, start + 0.5 * h, angles, L[i], tau)
    power = forward_under(inputs, t, start + 0.5 * h, angles, L[i], tau, K[i], work.forward)
    if work.ties is not None:
        power += accelerate(t, angles, L[i], K[i], work)
    return power


@recursion
def more_stages(t, h, inputs, state, work):
    """Evaluate the additional stages of the step just taken from `state`; returns their number."""
    A, c, s = work.method.beyond, work.method.beyond_c, len(work.method.c)
    for i in range(len(c)):
        m = s + 1 + i
        work.power[m] = evaluate(t, c[i], h, inputs, state[0], state[1], A[i], m, work.Q, work)
    return len(c)


@inlined
def error_by(row, h, work):
    """Return the error estimate [m] with the weights d in row `row`."""
    d, e_q, e_v = work.method.d[row], work.e[0], work.e[1]
    for k in range(len(e_q)):
        e_q[k] = e_v[k] = 0.0
    for i in range(len(d)):
        add_stage(h * d[i], work.L, work.K, i, e_q, e_v)
    for k in range(len(e_q)):
        if work.chain.hinges[k].prescribed:
            e_q[k] = e_v[k] = 0.0
    return step_error_norm(h, e_q, e_v, work.springs, work.posture, work.chain, work.stepper, work.ties)
