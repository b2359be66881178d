"""One step of an implicit Runge-Kutta method for M q̈ = f(t, q, q̇), in O(n); unknown are the stages' q̈, K_i.

    Q_i = q + c_i h q̇ + h² Σ (A²)_ij K_j       V_i = q̇ + h Σ a_ij K_j
    R_i = f(t + c_i h, Q_i, V_i) − M(Q_i) K_i = 0                            by recursive Newton-Euler
    q ← q + h q̇ + h² Σ (b A)_i K_i             q̇ ← q̇ + h Σ b_i K_i

Simplified Newton: of the Jacobian only springs, dampers, friction's slope and a drive's gains, diagonal matrices K and
D, and M at one posture. With A = T Λ T⁻¹ it falls apart into one system for each eigenvalue λ of A, of which one of
each complex pair suffices:

    (M + hλ D + h²λ² K) x = T⁻¹ R          K_i ← K_i + T x

M with other rotors, which `mass_plus_diagonal` solves in O(n). What is left out, stiffness of gravity and of rates,
makes the iteration contract by 1e-3 to 0.2 at useful steps.

Dense output at t + x h, by the polynomial q̈ through the stages, integrated once and twice:

    q̇(x) = q̇ + h Σ β_i(x) K_i     q(x) = q + x h q̇ + h² Σ α_i(x) K_i     W(x) = W + h Σ β_i(x) P_i

with ℓ_i, 1 at c_i and 0 at the other nodes, β_i = ∫ ℓ_i and α_i = ∫ β_i. At x = 1 it is the end of the step; in between
its order is that of the error estimate, s + 1, so that the tolerance holds for it, too. The q̈ that the step starts from
has no part in it: after a jump of torque that is of vibrations that the step does not resolve.

Error (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8), γ₀ the real eigenvalue of A:

    e_q = h (γ₀ q̇ + Σ d_i V_i)       e_v = h (γ₀ q̈ + Σ d_i K_i)       both (1 − hγ₀ J)⁻¹, weighed as in `error_norm`
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.bodies.joint_torques import elastic, friction
from flexlink.kernels.forward.mass_plus_diagonal import FACTORS, displacement, factor, place_bodies, solve
from flexlink.kernels.inputs.drive_torque import follow, stage_torque
from flexlink.kernels.inputs.tip_wrench import put_wrench
from flexlink.kernels.stepping.error_norm import step_error_norm
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.tools.compiler import inlined, recursion
from flexlink.kernels.tools.numbered import numbered

FIRST_CONTRACTION = 0.3  # taken for granted in the first iteration
STAGE = numbered("qdd last_qdd q qd residual")  # K of all stages, that of the last accepted step, Q, V, R
VECTOR = numbered("tau q_middle qd_middle rhs solution")  # of all joints
COUPLING = numbered("A A2")  # of stages: A and A²
WEIGHT = numbered("b bA c d")


class ImplicitMethod(NamedTuple):
    """Coefficients of a method, its eigenvalues with their vectors, and the weights of its error."""

    A: Any  # (2, s, s) A and A²
    weights: Any  # (4, s) b, b A, c and d
    γ: Any  # the real eigenvalue; 0: no error is estimated
    real: Any
    T_real: Any
    Tinv_real: Any
    pairs: Any
    T_pairs: Any
    Tinv_pairs: Any
    dense: Any  # (2, s, s) of x: coefficients of β_i / x and of α_i / x²


class ImplicitWork(NamedTuple):
    """Scratch of `implicit_step`, with the constants of a chain."""

    method: ImplicitMethod
    chain: Any
    inverse: Any  # scratch of inverse dynamics
    posture: Any
    stepper: Any  # a `STEPPER`
    new: Any  # (3, n) q, q̇, q̈ at the end of the step
    stages: Any  # (5, s, n)
    power: Any  # (s,)
    vectors: Any  # (5, n)
    springs: Any  # see `error_norm`
    factors: Any  # (r, n, 8)
    pairs: Any  # (2, n) complex
    factors_pairs: Any  # (p, n, 8) complex


@recursion
def implicit_step(t, h, inputs, state, allowed, work):
    """Step from `state` q, q̇, q̈ (n,) and W (2,) to `work.new`; returns its error [m] and iterations.

    `allowed`: error of the step, and how far from its end the iteration may move a body at last [m]. The error is nan
    if it does not get there.
    """
    q, qd, qdd, done = state
    tolerance, accurate = allowed
    angles, rates = work.vectors[VECTOR.q_middle], work.vectors[VECTOR.qd_middle]
    predict(h, work)
    for k in range(len(q)):
        angles[k], rates[k] = q[k] + 0.5 * h * qd[k], qd[k]
    follow(inputs.motion, t + 0.5 * h, angles, rates, work.vectors[VECTOR.tau])
    place_bodies(angles, work.posture)
    factor_all(h, rates, work)
    roundings = 200.0 * work.stepper[STEPPER.rounding]  # of the place of a body, added up by a step through all joints
    most = work.stepper[STEPPER.max_iterations]
    stalled_at, slow_from = 0.5, 0.25  # contractions: rounding is all that moves; friction may turn round in the step
    of_friction = 100.0 * accurate  # [m] may be left at joints with dry friction: five times a step's error, measured
    before = math.inf  # what the last pass moved
    fresh, settled, contraction, error, iteration = True, False, FIRST_CONTRACTION, math.nan, 0
    while not settled:
        residuals(t, h, inputs, q, qd, work)
        iteration += 1
        if not math.isnan(error):  # P_i are those of the stages now
            break
        moved = improve(h, work)
        contraction = likely_contraction(h, moved, work.stepper) if iteration == 1 else moved / before
        stalled = iteration > 1 and contraction > stalled_at and moved <= roundings
        near = contraction < 1.0 and moved * contraction <= accurate * (1.0 - contraction)
        if stalled or (near and unsettled(h, work) <= of_friction):
            work.stepper[STEPPER.contraction] = contraction
            work.stepper[STEPPER.displacement] = moved if iteration == 1 else before
            finish(t, h, inputs, q, qd, work)
            error = estimate(h, qd, qdd, tolerance, work)
            settled = math.isnan(error) or tells_work(moved, q, allowed, work) or not does_work(inputs, work)
        elif not moved < math.inf or (iteration > 3 and contraction > 1.0) or iteration == most:
            return math.nan, iteration
        elif fresh and iteration > 1 and contraction > slow_from:
            fresh = False
            slowest_rates(qd, rates, work)
            factor_all(h, rates, work)
        before = moved
    add_up_work(h, done, work)
    return error, iteration


@inlined
def likely_contraction(h, moved, stepper):
    """That of the first iteration, from the last step's (Hairer & Wanner, IV.8): it is about in proportion to h².

    Not where the iteration moves much farther than it did then: curvature contracts in proportion to that.
    """
    known, last = stepper[STEPPER.contraction], stepper[STEPPER.last_step]
    stepper[STEPPER.contraction] = 0.0
    much_longer, much_farther = h > 1.5 * last, moved > 10.0 * stepper[STEPPER.displacement]
    if known == 0.0 or last == 0.0 or much_longer or much_farther:
        return FIRST_CONTRACTION
    return min(FIRST_CONTRACTION, max(1.0, h / last) ** 2 * known**0.8)


@inlined
def has_dry_friction(hinges):
    """Whether any joint has dry friction."""
    largest = 0.0
    for k in range(len(hinges)):
        largest = max(largest, hinges[k].coulomb)
    return largest > 0.0


@inlined
def predict(h, work):
    """K from the last step's polynomial; from 0 after none, or a much shorter one: h² would magnify stiff noise."""
    c, qdd, before = work.method.weights[WEIGHT.c], work.stages[STAGE.qdd], work.stages[STAGE.last_qdd]
    last = work.stepper[STEPPER.last_step]
    s, n = qdd.shape
    for i in range(s):
        for k in range(n):
            if work.stepper[STEPPER.accepted] > 0.0:
                before[i, k] = qdd[i, k]
            qdd[i, k] = 0.0
    work.stepper[STEPPER.accepted] = 0.0
    if last > 0.0 and h <= 4.0 * last:
        for i in range(s):
            for j in range(s):
                weight = 1.0
                for m in range(s):
                    if m != j:
                        weight *= (1.0 + c[i] * h / last - c[m]) / (c[j] - c[m])
                for k in range(n):
                    qdd[i, k] += weight * before[j, k]


@inlined
def slope(work, k, rate):
    """D of one joint: dampers, a drive's gain and the slope of the chord of dry friction, which does not overshoot."""
    hinge = work.chain.hinges[k]
    d = hinge.damping + work.springs.kd[k]
    if hinge.coulomb > 0.0:
        x = abs(rate) / hinge.coulomb_width
        d += hinge.coulomb / hinge.coulomb_width * (math.tanh(x) / x if x > 1e-8 else 1.0)
    return d


@recursion
def factor_all(h, rates, work):
    """Prepare M + hλ D + h²λ² K for every λ, with friction's slope at these rates."""
    for m in range(len(work.method.real)):
        shift_rotors(h * work.method.real[m], rates, work.factors[m], work)
        factor(work.factors[m], work.posture)
    for m in range(len(work.method.pairs)):
        shift_rotors(h * work.method.pairs[m], rates, work.factors_pairs[m], work)
        factor(work.factors_pairs[m], work.posture)


@inlined
def shift_rotors(z, rates, factors, work):
    """A = rotors + z D + z² K."""
    for k in range(len(factors)):
        hinge = work.chain.hinges[k]
        held = slope(work, k, rates[k]) + z * (hinge.stiffness + work.springs.kp[k])
        factors[k, FACTORS.A] = hinge.armature + z * held


@recursion
def slowest_rates(qd, rates, work):
    """The rate of each joint nearest to 0 at the start and in all stages, 0 if it turns round: the steepest chord."""
    for k in range(len(qd)):
        least = qd[k]
        for i in range(work.stages.shape[1]):
            rate = work.stages[STAGE.qd, i, k]
            if least * rate <= 0.0:
                least = 0.0
            elif abs(rate) < abs(least):
                least = rate
        rates[k] = least


@recursion
def residuals(t, h, inputs, q, qd, work):
    """R_i of all stages, and the power P_i of all that has no potential."""
    A, c, qdd = work.method.A, work.method.weights[WEIGHT.c], work.stages[STAGE.qdd]
    for i in range(len(c)):
        Q, V, ti = work.stages[STAGE.q, i], work.stages[STAGE.qd, i], t + c[i] * h
        for k in range(len(q)):
            Q[k], V[k] = q[k] + c[i] * h * qd[k], qd[k]
        for j in range(len(c)):
            weight2, weight = h * h * A[COUPLING.A2, i, j], h * A[COUPLING.A, i, j]
            for k in range(len(q)):
                Q[k] += weight2 * qdd[j, k]
                V[k] += weight * qdd[j, k]
        follow(inputs.motion, ti, Q, V, qdd[i])
        work.power[i] = residual(ti, t + 0.5 * h, inputs, Q, V, qdd[i], work.stages[STAGE.residual, i], work)


@recursion
def residual(t, middle, inputs, q, qd, qdd, R, work):
    """Write f(t, q, q̇) − M q̈, 0 at prescribed joints; returns the power of all that has no potential."""
    chain, tau = work.chain, work.vectors[VECTOR.tau]
    for k in range(len(q)):
        tau[k] = 0.0
    stage_torque(inputs.drive, t, middle, q, qd, tau)
    power = put_wrench(inputs.table, t, middle, q, qd, inputs.wrench)
    power += inverse_dynamics_into(chain, inputs.wrench, q, qd, qdd, R, work.inverse)
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
    method, qdd, R = work.method, work.stages[STAGE.qdd], work.stages[STAGE.residual]
    r, x, z = work.vectors[VECTOR.rhs], work.vectors[VECTOR.solution], work.pairs
    s, n = qdd.shape
    δq, δv = work.vectors[VECTOR.q_middle], work.vectors[VECTOR.tau]
    for k in range(n):
        δq[k] = δv[k] = 0.0
    for m in range(len(method.real)):
        for k in range(n):
            r[k] = 0.0
        for j in range(s):
            for k in range(n):
                r[k] += method.Tinv_real[m, j] * R[j, k]
        solve(work.factors[m], r, x, work.posture)
        for i in range(s):
            add_change(h, method, i, method.T_real[i, m], x, qdd[i], δq, δv)
    for m in range(len(method.pairs)):
        for k in range(n):
            z[0, k] = 0.0
        for j in range(s):
            for k in range(n):
                z[0, k] += method.Tinv_pairs[m, j] * R[j, k]
        solve(work.factors_pairs[m], z[0], z[1], work.posture)
        for i in range(s):
            add_change(h, method, i, 2.0 * method.T_pairs[i, m], z[1], qdd[i], δq, δv)
    worst = 0
    for k in range(n):
        δv[k] *= max(h, work.stepper[STEPPER.inverse_ω1])
        if abs(δv[k]) > abs(δv[worst]):
            worst = k
    work.stepper[STEPPER.worst_joint] = worst
    return max(displacement(δq, work.posture), displacement(δv, work.posture))


@inlined
def add_change(h, method, i, weight, x, qdd, δq, δv):
    """K_i += Re(weight x), and what that changes at the end of the step."""
    for k in range(len(x)):
        δ = (weight * x[k]).real
        qdd[k] += δ
        δq[k] += h * h * method.weights[WEIGHT.bA, i] * δ
        δv[k] += h * method.weights[WEIGHT.b, i] * δ


@inlined
def unsettled(h, work):
    """How far [m] the torques that are left at joints with dry friction would move a body, were they free to turn.

    The slope of friction at rest moves such a joint by next to nothing, however far it is from where it belongs.
    """
    δ, largest = work.vectors[VECTOR.q_middle], 0.0
    if not has_dry_friction(work.chain.hinges):
        return largest
    for i in range(work.stages.shape[1]):
        for k in range(len(δ)):
            hinge, δ[k] = work.chain.hinges[k], 0.0
            if hinge.coulomb > 0.0 and not hinge.prescribed:
                inertia = hinge.armature + inertia_beyond(k, work)
                δ[k] = h * max(h, work.stepper[STEPPER.inverse_ω1]) * work.stages[STAGE.residual, i, k] / inertia
        largest = max(largest, displacement(δ, work.posture))
    return largest


@inlined
def inertia_beyond(k, work):
    """What a joint turns [kg m²], its rotor apart, while joints further out are as stiff as the first factors say."""
    if len(work.factors) > 0:
        return 1.0 / work.factors[0, k, FACTORS.inverse] - work.factors[0, k, FACTORS.A]
    return abs(1.0 / work.factors_pairs[0, k, FACTORS.inverse] - work.factors_pairs[0, k, FACTORS.A])


@inlined
def tells_work(moved, q, allowed, work):
    """Whether the stages' powers, found before the last pass moved a body so far, tell the work of the step.

    They do if it is no farther than 4 times the step's error: all steps together put W off by no more than if the
    forces acted farther by the tolerance. Of a fixed step 1e-3 of what the whole step moves a body by will do.
    """
    tolerance, accurate = allowed
    if tolerance < math.inf:
        return moved <= 4.0 * tolerance
    δ = work.vectors[VECTOR.q_middle]
    for k in range(len(q)):
        δ[k] = work.new[0, k] - q[k]
    return moved <= max(4.0 * accurate, 1e-3 * displacement(δ, work.posture))


@inlined
def does_work(inputs, work):
    """Whether anything has power that has no potential: drives, dampers, friction, prescribed motions, the wrench."""
    hinges = work.chain.hinges
    works = len(inputs.drive.joints) + len(inputs.motion.joints) > 0 or inputs.table is not None
    for k in range(3, len(inputs.wrench)):
        works = works or inputs.wrench[k] != 0.0
    for k in range(len(hinges)):
        works = works or hinges[k].damping > 0.0 or hinges[k].coulomb > 0.0
    return works


@recursion
def finish(t, h, inputs, q, qd, work):
    """The end of the step; its q̈ is K_s, which is that of a method with b = (a_s1 … a_ss)."""
    weights, qdd, new = work.method.weights, work.stages[STAGE.qdd], work.new
    s = len(qdd)
    for k in range(len(q)):
        new[0, k], new[1, k], new[2, k] = q[k] + h * qd[k], qd[k], qdd[s - 1, k]
    for i in range(s):
        weight2, weight = h * h * weights[WEIGHT.bA, i], h * weights[WEIGHT.b, i]
        for k in range(len(q)):
            new[0, k] += weight2 * qdd[i, k]
            new[1, k] += weight * qdd[i, k]
    follow(inputs.motion, t + h, new[0], new[1], new[2])


@inlined
def add_up_work(h, done, work):
    """W at the end of the step, and the power there."""
    work.stepper[STEPPER.work], work.stepper[STEPPER.power] = done[0], work.power[len(work.power) - 1]
    for i in range(len(work.power)):
        work.stepper[STEPPER.work] += h * work.method.weights[WEIGHT.b, i] * work.power[i]


@recursion
def between_stages(x, h, state, work, angles, rates):
    """Write q and q̇ at a part x of the step that was just taken from `state`; returns W there."""
    q, qd, done = state[0], state[1], state[3]
    dense, qdd, W = work.method.dense, work.stages[STAGE.qdd], done[0]
    s, n = qdd.shape
    for k in range(n):
        angles[k], rates[k] = q[k] + x * h * qd[k], qd[k]
    for i in range(s):
        β = α = 0.0
        for m in range(s - 1, -1, -1):
            β = β * x + dense[0, i, m]
            α = α * x + dense[1, i, m]
        weight2, weight = h * h * x * x * α, h * x * β
        W += weight * work.power[i]
        for k in range(n):
            angles[k] += weight2 * qdd[i, k]
            rates[k] += weight * qdd[i, k]
    return W


@recursion
def estimate(h, qd, qdd, tolerance, work):
    """Error of the step [m], 0 of a fixed one.

    Of a first step, and of one after a refusal, an error beyond the tolerance is damped once more: one of stiff
    vibrations, as after a jump, would not become smaller with h (Hairer & Wanner II, equation IV.8.20, J for f).
    Dry friction's slope in D is that at the end of the step: the steepest one, with which the iteration ends, would
    hide what turning round did.
    """
    hγ, vectors = h * work.method.γ, work.vectors
    if hγ == 0.0 or tolerance == math.inf:  # none is estimated, or none is asked for
        return 0.0
    if has_dry_friction(work.chain.hinges):
        shift_rotors(hγ, work.new[1], work.factors[0], work)
        factor(work.factors[0], work.posture)
    e_q, e_v = vectors[VECTOR.q_middle], vectors[VECTOR.qd_middle]
    for k in range(len(qd)):
        e_q[k], e_v[k] = hγ * qd[k], hγ * qdd[k] if math.isfinite(qdd[k]) else 0.0  # M of a start may be singular
        for i in range(work.stages.shape[1]):
            e_q[k] += h * work.method.weights[WEIGHT.d, i] * work.stages[STAGE.qd, i, k]
            e_v[k] += h * work.method.weights[WEIGHT.d, i] * work.stages[STAGE.qdd, i, k]
    error, times = math.inf, 2 if work.stepper[STEPPER.refusal] > 0.0 or work.stepper[STEPPER.last_step] == 0.0 else 1
    while times > 0 and error >= tolerance:
        error, times = damped_error(h, hγ, e_q, e_v, work), times - 1
    return error


@recursion
def damped_error(h, hγ, e_q, e_v, work):
    """Damp errors of angles and rates (n,) in place by (1 − hγ₀ J)⁻¹; returns how far they move a body [m].

    (M + A) y = −hγ₀ D e_v − (hγ₀)² K e_v − hγ₀ K e_q,  e_v ← e_v + y,  e_q ← e_q + hγ₀ e_v.
    """
    r, y, factors = work.vectors[VECTOR.rhs], work.vectors[VECTOR.solution], work.factors[0]
    for k in range(len(r)):
        hinge = work.chain.hinges[k]
        r[k] = -(factors[k, FACTORS.A] - hinge.armature) * e_v[k] - hγ * (hinge.stiffness + work.springs.kp[k]) * e_q[k]
    solve(factors, r, y, work.posture)
    for k in range(len(r)):
        if work.chain.hinges[k].prescribed:
            e_q[k] = e_v[k] = 0.0
        else:
            e_v[k] += y[k]
            e_q[k] += hγ * e_v[k]
    return step_error_norm(h, e_q, e_v, work)
