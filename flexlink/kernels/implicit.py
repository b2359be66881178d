"""One step of an implicit Runge-Kutta method for M q̈ = f(t, q, q̇), in O(n); unknown are the stages' q̈, K_i.

    Q_i = q + c_i h q̇ + h² Σ (A²)_ij K_j       V_i = q̇ + h Σ a_ij K_j
    R_i = f(t + c_i h, Q_i, V_i) − M(Q_i) K_i = 0                            by recursive Newton-Euler
    q ← q + h q̇ + h² Σ (b A)_i K_i             q̇ ← q̇ + h Σ b_i K_i

Simplified Newton: of the Jacobian only springs, dampers, friction's slope and a drive's gains, diagonal matrices K and
D, and M at one posture. With A = T Λ T⁻¹ it falls apart into one system for each eigenvalue λ of A, of which one of
each complex pair suffices:

    (M + hλ D + h²λ² K) x = T⁻¹ R          K_i ← K_i + T x

M with other rotors, which `shifted` solves in O(n). What is left out, stiffness of gravity and of rates, makes the
iteration contract by 1e-3 to 0.2 at useful steps.

Error (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8), γ₀ the real eigenvalue of A:

    e_q = h (γ₀ q̇ + Σ d_i V_i)       e_v = h (γ₀ q̈ + Σ d_i K_i)       both times (1 − hγ₀ J)⁻¹
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.clock import ACCEPTED, LAST, WORST
from flexlink.kernels.compiler import inlined, recursion
from flexlink.kernels.inputs import drive_torque, follow
from flexlink.kernels.inverse import inverse_dynamics_into
from flexlink.kernels.joint_torques import elastic, friction
from flexlink.kernels.shifted import displacement, factor, place_bodies, solve

MOST_ITERATIONS = 12
FARTHEST = 4.0  # a step that is longer than so many times the last is not extrapolated to
SLOW = 0.25  # contraction from which friction is suspected to turn round within the step


class ImplicitMethod(NamedTuple):
    """Coefficients of a method, its eigenvalues with their vectors, and the weights of its error."""

    A: Any
    A2: Any
    b: Any
    bA: Any  # noqa: N815
    c: Any
    real: Any
    T_real: Any
    Tinv_real: Any
    pairs: Any
    T_pairs: Any
    Tinv_pairs: Any
    γ0: Any
    d: Any  # (s,), or empty: no error is estimated


class ImplicitWork(NamedTuple):
    """Scratch of `implicit_step`, with the constants of a chain, its drive's gains and 1 / ω₁."""

    method: ImplicitMethod
    chain: Any
    forward: Any  # scratch of forward dynamics
    inverse: Any  # scratch of inverse dynamics
    posture: Any
    kp: Any
    kd: Any
    slowest: Any  # 1 / ω₁ [s], ω₁ the lowest frequency
    new: Any  # (3, n) q, q̇, q̈ at the end of the step
    W: Any  # (2,) work up to there, and its power there
    clock: Any  # see there
    K: Any  # (s, n), and so Q, V, R and K_before, of the last step that was accepted
    K_before: Any
    Q: Any
    V: Any
    R: Any
    P: Any  # (s,) power
    tau: Any
    middle: Any  # (2, n)
    x: Any  # (2, n) right-hand side and solution
    shift: Any  # (r, n)
    factors: Any  # (r, n, 8)
    x_pairs: Any
    shift_pairs: Any
    factors_pairs: Any


@recursion
def implicit_step(t, h, inputs, state, accurate, work):
    """Step from `state` q, q̇, q̈ (n,) and W (2,) to `work.new` and `work.W`; returns its error [m] and iterations.

    The iteration ends where it moves no body by more than `accurate` [m]; the error is nan if it does not get there.
    """
    q, qd, qdd = state[0], state[1], state[2]
    predict(h, work)
    for k in range(len(q)):
        work.middle[0, k] = q[k] + 0.5 * h * qd[k]
        work.middle[1, k] = qd[k]
    follow(inputs.motion, t + 0.5 * h, work.middle[0], work.middle[1], work.tau)
    place_bodies(work.middle[0], work.posture)
    factor_all(h, work.middle[1], work)
    before, contraction, fresh = 0.0, 0.3, True
    for iteration in range(1, MOST_ITERATIONS + 1):
        residuals(t, h, inputs, q, qd, work)
        moved = improve(h, work)
        if iteration > 1:
            contraction = moved / before
        before = moved
        left = min(contraction, 0.9)
        if moved * left <= accurate * (1.0 - left):
            finish(t, h, inputs, state, work)
            return estimate(h, qd, qdd, work), iteration
        if not moved < math.inf or (iteration > 3 and contraction > 1.0):
            break
        if fresh and iteration > 1 and contraction > SLOW:
            fresh = False
            slowest_rates(qd, work)
            factor_all(h, work.middle[1], work)
    return math.nan, MOST_ITERATIONS


@inlined
def predict(h, work):
    """K from the last step's polynomial; from 0 after none, or a much shorter one: h² would magnify stiff noise."""
    c, K, last = work.method.c, work.K, work.clock[LAST]
    s, n = K.shape
    for i in range(s):
        for k in range(n):
            if work.clock[ACCEPTED] > 0.0:
                work.K_before[i, k] = K[i, k]
            K[i, k] = 0.0
    work.clock[ACCEPTED] = 0.0
    if last > 0.0 and h <= FARTHEST * last:
        for i in range(s):
            for j in range(s):
                weight = 1.0
                for m in range(s):
                    if m != j:
                        weight *= (1.0 + c[i] * h / last - c[m]) / (c[j] - c[m])
                for k in range(n):
                    K[i, k] += weight * work.K_before[j, k]


@inlined
def slope(work, k, rate):
    """D of one joint: dampers, a drive's gain and the slope of the chord of dry friction, which does not overshoot."""
    hinge = work.chain.hinges[k]
    d = hinge.damping + work.kd[k]
    if hinge.coulomb > 0.0:
        x = abs(rate) / hinge.coulomb_width
        d += hinge.coulomb / hinge.coulomb_width * (math.tanh(x) / x if x > 1e-8 else 1.0)
    return d


@recursion
def factor_all(h, rates, work):
    """Prepare M + hλ D + h²λ² K for every λ, with friction's slope at these rates."""
    for m in range(len(work.method.real)):
        shift_rotors(h * work.method.real[m], rates, work.shift[m], work)
        factor(work.shift[m], work.factors[m], work.posture)
    for m in range(len(work.method.pairs)):
        shift_rotors(h * work.method.pairs[m], rates, work.shift_pairs[m], work)
        factor(work.shift_pairs[m], work.factors_pairs[m], work.posture)


@inlined
def shift_rotors(z, rates, A, work):
    """A = rotors + z D + z² K."""
    for k in range(len(A)):
        hinge = work.chain.hinges[k]
        A[k] = hinge.armature + z * (slope(work, k, rates[k]) + z * (hinge.stiffness + work.kp[k]))


@recursion
def slowest_rates(qd, work):
    """The rate of each joint nearest to 0 at the start and in all stages, 0 if it turns round: the steepest chord."""
    for k in range(len(qd)):
        least = qd[k]
        for i in range(len(work.V)):
            rate = work.V[i, k]
            if least * rate <= 0.0:
                least = 0.0
            elif abs(rate) < abs(least):
                least = rate
        work.middle[1, k] = least


@recursion
def residuals(t, h, inputs, q, qd, work):
    """R_i of all stages, and the power P_i of all that has no potential."""
    method, K = work.method, work.K
    for i in range(len(method.c)):
        Q, V, ti = work.Q[i], work.V[i], t + method.c[i] * h
        for k in range(len(q)):
            Q[k], V[k] = q[k] + method.c[i] * h * qd[k], qd[k]
        for j in range(len(method.c)):
            weight2, weight = h * h * method.A2[i, j], h * method.A[i, j]
            for k in range(len(q)):
                Q[k] += weight2 * K[j, k]
                V[k] += weight * K[j, k]
        follow(inputs.motion, ti, Q, V, K[i])
        work.P[i] = residual(ti, inputs, Q, V, K[i], work.R[i], work)


@recursion
def residual(t, inputs, q, qd, qdd, R, work):
    """Write f(t, q, q̇) − M q̈, 0 at prescribed joints; returns the power q̇·(T_EX − T_FR) + m·ω."""
    chain, tau = work.chain, work.tau
    for k in range(len(q)):
        tau[k] = 0.0
    drive_torque(inputs.drive, t, q, qd, tau)
    power = inverse_dynamics_into(chain, inputs.wrench, q, qd, qdd, R, work.inverse)
    for k in range(len(q)):
        hinge = chain.hinges[k]
        spring = elastic(hinge, q[k])
        if hinge.prescribed:
            power += qd[k] * (R[k] + spring)
            R[k] = 0.0
        else:
            working = tau[k] - friction(hinge, qd[k])
            power += qd[k] * working
            R[k] = working - spring - R[k]
    return power


@recursion
def improve(h, work):
    """K += T x for all eigenvalues; returns how far this moves a body at the end of the step [m]."""
    method, K, R, x, z = work.method, work.K, work.R, work.x, work.x_pairs
    s, n = K.shape
    δq, δv = work.middle[0], work.tau
    for k in range(n):
        δq[k] = δv[k] = 0.0
    for m in range(len(method.real)):
        for k in range(n):
            x[0, k] = 0.0
        for j in range(s):
            for k in range(n):
                x[0, k] += method.Tinv_real[m, j] * R[j, k]
        solve(work.shift[m], work.factors[m], x[0], x[1], work.posture)
        for i in range(s):
            add_change(h, method, i, method.T_real[i, m], x[1], K[i], δq, δv)
    for m in range(len(method.pairs)):
        for k in range(n):
            z[0, k] = 0.0
        for j in range(s):
            for k in range(n):
                z[0, k] += method.Tinv_pairs[m, j] * R[j, k]
        solve(work.shift_pairs[m], work.factors_pairs[m], z[0], z[1], work.posture)
        for i in range(s):
            add_change(h, method, i, 2.0 * method.T_pairs[i, m], z[1], K[i], δq, δv)
    worst = 0
    for k in range(n):
        δv[k] *= max(h, work.slowest)
        if abs(δv[k]) > abs(δv[worst]):
            worst = k
    work.clock[WORST] = worst
    return max(displacement(δq, work.posture), displacement(δv, work.posture))


@inlined
def add_change(h, method, i, weight, x, K, δq, δv):
    """K_i += Re(weight x), and what that changes at the end of the step."""
    for k in range(len(x)):
        δ = (weight * x[k]).real
        K[k] += δ
        δq[k] += h * h * method.bA[i] * δ
        δv[k] += h * method.b[i] * δ


@recursion
def finish(t, h, inputs, state, work):
    """The end of the step; its q̈ is K_s, which is that of a method with b = (a_s1 … a_ss)."""
    q, qd, done = state[0], state[1], state[3]
    method, K, new = work.method, work.K, work.new
    s = len(method.c)
    for k in range(len(q)):
        new[0, k], new[1, k], new[2, k] = q[k] + h * qd[k], qd[k], K[s - 1, k]
    work.W[0], work.W[1] = done[0], work.P[s - 1]
    for i in range(s):
        work.W[0] += h * method.b[i] * work.P[i]
        weight2, weight = h * h * method.bA[i], h * method.b[i]
        for k in range(len(q)):
            new[0, k] += weight2 * K[i, k]
            new[1, k] += weight * K[i, k]
    follow(inputs.motion, t + h, new[0], new[1], new[2])


@recursion
def estimate(h, qd, qdd, work):
    """Error of the step [m], 0 where none is estimated: largest displacement of any body by e_q and by τ e_v.

    (1 − hγ₀ J)⁻¹ (e_q, e_v):  (M + A) y = −hγ₀ D e_v − (hγ₀)² K e_v − hγ₀ K e_q,  e_v ← e_v + y,  e_q ← e_q + hγ₀ e_v.
    τ = max(h, 1 / ω₁): with τ = h any error of the rates would pass at small steps.
    """
    method, K = work.method, work.K
    if len(method.d) == 0:
        return 0.0
    e_q, e_v, r, y = work.middle[0], work.middle[1], work.x[0], work.x[1]
    hγ = h * method.γ0
    for k in range(len(qd)):
        e_q[k], e_v[k] = hγ * qd[k], hγ * qdd[k]
        for i in range(len(method.d)):
            e_q[k] += h * method.d[i] * work.V[i, k]
            e_v[k] += h * method.d[i] * K[i, k]
        hinge = work.chain.hinges[k]
        r[k] = -(work.shift[0, k] - hinge.armature) * e_v[k] - hγ * (hinge.stiffness + work.kp[k]) * e_q[k]
    solve(work.shift[0], work.factors[0], r, y, work.posture)
    for k in range(len(qd)):
        if work.chain.hinges[k].prescribed:
            e_q[k] = e_v[k] = 0.0
        else:
            e_v[k] += y[k]
            e_q[k] += hγ * e_v[k]
            e_v[k] *= max(h, work.slowest)
    return max(displacement(e_q, work.posture), displacement(e_v, work.posture))
