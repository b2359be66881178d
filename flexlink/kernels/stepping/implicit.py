"""One step of an implicit Runge-Kutta method for M q̈ = f(t, q, q̇), in O(n); the unknowns K_i are the stages' q̈.

    Q_i = q + c_i h q̇ + h² Σ (A²)_ij K_j       V_i = q̇ + h Σ a_ij K_j
    R_i = f(t + c_i h, Q_i, V_i) − M(Q_i) K_i = 0                            residual, by recursive Newton-Euler
    q ← q + h q̇ + h² Σ (b A)_i K_i             q̇ ← q̇ + h Σ b_i K_i

The stages are found by Newton's iteration; `newton` describes its linear systems.

Dense output at t + x h: the polynomial through the stages' q̈, integrated once and twice,

    q̇(x) = q̇ + h Σ β_i(x) K_i     q(x) = q + x h q̇ + h² Σ α_i(x) K_i     W(x) = W + h Σ β_i(x) P_i

with β_i = ∫ ℓ_i and α_i = ∫ β_i, where ℓ_i is 1 at c_i and 0 at the other nodes. At x = 1 this is the end of the step.
Inside the step the order is s + 1, as for the error estimate, so the tolerance applies there as well. The initial q̈ is
not used: after a jump of torque it contains vibrations that the step does not resolve.

Error (Hairer & Wanner, Solving Ordinary Differential Equations II, IV.8), γ₀ the real eigenvalue of A:

    e_q = h (γ₀ q̇ + Σ d_i V_i)    e_v = h (γ₀ q̈ + Σ d_i K_i)    both multiplied by (1 − hγ₀ J)⁻¹; norm: `error_norm`
"""

import math

from flexlink.kernels.bodies.inverse import inverse_dynamics_into
from flexlink.kernels.forces.elements import add_torques, find_own_slopes
from flexlink.kernels.forces.joint_torques import elastic, friction
from flexlink.kernels.forward.mass_plus import displacement, factor, make_possible, place_bodies, solve
from flexlink.kernels.forward.mass_plus_cells import FACTORS, add_products
from flexlink.kernels.inputs.drive_torque import follow, stage_torque
from flexlink.kernels.inputs.tip_wrench import put_wrench
from flexlink.kernels.stepping.dry_friction import (
    factor_turning,
    is_noted,
    leave_out_friction,
    note_turning,
    put_in_friction,
)
from flexlink.kernels.stepping.error_norm import held, step_error_norm
from flexlink.kernels.stepping.implicit_layout import BUTCHER, STAGE, VECTOR, WEIGHT
from flexlink.kernels.stepping.newton import (
    changes,
    divide_stages,
    factor_all,
    factor_stages,
    improve,
    inertia_beyond,
    moved_by_changes,
    shift_rotors,
    slowest_rates,
)
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.tie_rows import LAW
from flexlink.kernels.stepping.ties import answer_ties, begin_ties, keep, noise_of_ties, pull, settle_on_ties
from flexlink.kernels.tools.compiler import inlined, recursion, subroutine
from flexlink.kernels.tools.rare import rarely

FIRST_CONTRACTION = 0.3  # assumed contraction factor in the first iteration


@subroutine
def implicit_step(t, h, inputs, state, allowed, work):
    """Step from `state` q, q̇, q̈ (n,) and W (2,) to `work.new`; returns its error [m] and number of iterations.

    `allowed` is the tolerance of the step, and the largest displacement of a body [m] that the remaining error of the
    iteration may cause at the end of the step. The error is nan if the iteration does not converge.
    """
    q, qd, qdd, done = state
    tolerance, accurate = allowed
    angles, rates = work.vectors[VECTOR.q_middle], work.vectors[VECTOR.qd_middle]
    law = work.stepper[STEPPER.turning] > 0.0
    predict(h, work)
    for k in range(len(q)):
        angles[k], rates[k] = q[k] + 0.5 * h * qd[k], qd[k]
    follow(inputs.motion, t + 0.5 * h, angles, rates, work.vectors[VECTOR.tau])
    place_bodies(angles, work.posture)
    if work.ties is not None:
        begin_ties(t, h, state, angles, work)
    if work.forces is not None:
        find_own_slopes(work.forces, angles, rates, work.springs.own)
    by_stage = work.stepper[STEPPER.by_stage] > 0.0
    if by_stage:
        accurate *= 0.3  # the remaining error of K affects the error estimate more than the end of the step
    work.turning.count[0] = 0
    roundings = 200.0 * work.stepper[STEPPER.rounding]  # rounding errors of a body's position, added up over all joints
    roundings *= noise_of_ties(h, work)
    most = work.stepper[STEPPER.max_iterations]
    stalled_at, slow_from = 0.5, 0.25  # contraction above 0.5: only rounding moves K; above 0.25: friction may reverse
    of_friction = 100.0 * accurate  # [m] limit at joints with dry friction: five times a step's error, by experiment
    before = math.inf  # displacement by the last pass [m]
    fresh, settled, contraction, error, iteration = not law, False, FIRST_CONTRACTION, math.nan, 0
    while not settled:
        residuals(t, h, inputs, q, qd, work)
        iteration += 1
        if not math.isnan(error):  # this pass only updated P_i for the final stages
            break
        if iteration == 1:
            prepare_systems(h, rates, by_stage, work)
        if law and note_turning(h, qd, work):
            factor_turning(h, work)
        moved = improve_stages(h, qd, by_stage, work)
        if iteration > 1:
            contraction = moved / before
        elif work.turning.count[0] == 0:
            contraction = likely_contraction(h, moved, work.stepper)
        stalled = iteration > 1 and contraction > stalled_at and moved <= roundings
        near = contraction < 1.0 and moved * contraction <= accurate * (1.0 - contraction)
        if stalled or (near and unsettled(h, work) <= of_friction):
            work.stepper[STEPPER.contraction] = contraction if work.turning.count[0] == 0 else 0.0
            work.stepper[STEPPER.displacement] = moved if iteration == 1 else before
            finish(t, h, inputs, q, qd, work)
            error = estimate(h, qd, qdd, tolerance, work)
            settled = math.isnan(error) or work_is_accurate(moved, q, allowed, work) or not does_work(inputs, work)
        elif not moved < math.inf or (iteration > 3 and contraction > 1.0) or iteration == most:
            return math.nan, iteration
        elif fresh and iteration > 1 and contraction > slow_from:
            fresh = False
            slowest_rates(qd, rates, work)
            prepare_systems(h, rates, by_stage, work)
        before = moved
    add_up_work(h, done, work)
    if work.ties is not None:
        error = settle_on_ties(t + h, error, work)
    return error, iteration


@recursion
def prepare_systems(h, rates, by_stage, work):
    """Factor the matrices of the next passes; dry friction has its slope at `rates`, 0 if its nonlinear law is used."""
    if work.stepper[STEPPER.turning] > 0.0:
        for k in work.turning.dry:
            rates[k] = math.inf
    work.stepper[STEPPER.prepared] += 1.0
    factor_all(h, rates, work)
    if work.ties is not None:
        answer_ties(h, work)
    if by_stage:
        work.stepper[STEPPER.stage_matrices] += work.stages.shape[1]
        factor_stages(h, work)


@inlined
def improve_stages(h, qd, by_stage, work):
    """Take one Newton step for K; returns how far it moves a body at the step's end [m], or nan if it fails."""
    δq, δv = changes(work)
    δq[:] = 0.0
    δv[:] = 0.0
    if work.turning.count[0] > 0:
        leave_out_friction(work)
    if by_stage:
        work.stepper[STEPPER.stage_solutions] += work.stages.shape[1]
        divide_stages(work)
    improve(h, by_stage, work)
    if work.turning.count[0] > 0 and not put_in_friction(h, qd, work):
        return math.nan
    return moved_by_changes(h, work)


@inlined
def likely_contraction(h, moved, stepper):
    """Contraction factor of the first iteration, roughly proportional to h² (Hairer & Wanner, IV.8).

    It is extrapolated from the factor in the last step, unless this step is much longer, or this pass moves a body much
    farther: because f is nonlinear, the factor grows in proportion to that displacement.
    """
    known, last = stepper[STEPPER.contraction], stepper[STEPPER.last_step]
    stepper[STEPPER.contraction] = 0.0
    much_longer, much_farther = h > 1.5 * last, moved > 10.0 * stepper[STEPPER.displacement]
    if known == 0.0 or last == 0.0 or much_longer or much_farther:
        return FIRST_CONTRACTION
    return min(FIRST_CONTRACTION, max(1.0, h / last) ** 2 * known**0.8)


@inlined
def predict(h, work):
    """Extrapolate K and λ from the last step's polynomial; 0 in a first step, or if h² would magnify stiff noise."""
    extrapolate(h, work.stages[STAGE.qdd], work.stages[STAGE.last_qdd], work)
    for i in range(work.stages.shape[1]):
        make_possible(work.stages[STAGE.qdd, i], work.posture)
    if work.ties is not None:
        extrapolate(h, work.ties.λ, work.ties.last, work)
    work.stepper[STEPPER.accepted] = 0.0


@recursion
def extrapolate(h, x, before, work):
    """Continue the polynomial through the stages x (s, n) of the last accepted step, or, if that failed, `before`."""
    c, last = work.method.weights[WEIGHT.c], work.stepper[STEPPER.last_step]
    s, n = x.shape
    for i in range(s):
        for k in range(n):
            if work.stepper[STEPPER.accepted] > 0.0:
                before[i, k] = x[i, k]
            x[i, k] = 0.0
    if last == 0.0 or h > 4.0 * last:
        return
    for i in range(s):
        for j in range(s):
            weight = 1.0
            for m in range(s):
                if m != j:
                    weight *= (1.0 + c[i] * h / last - c[m]) / (c[j] - c[m])
            for k in range(n):
                x[i, k] += weight * before[j, k]


@inlined
def residuals(t, h, inputs, q, qd, work):
    """Write R_i of all stages, and the power P_i of all non-conservative forces."""
    A, c, qdd = work.method.A, work.method.weights[WEIGHT.c], work.stages[STAGE.qdd]
    for i in range(len(c)):
        Q, V, ti = work.stages[STAGE.q, i], work.stages[STAGE.qd, i], t + c[i] * h
        for k in range(len(q)):
            Q[k], V[k] = q[k] + c[i] * h * qd[k], qd[k]
        for j in range(len(c)):
            weight2, weight = h * h * A[BUTCHER.A2, i, j], h * A[BUTCHER.A, i, j]
            for k in range(len(q)):
                Q[k] += weight2 * qdd[j, k]
                V[k] += weight * qdd[j, k]
        follow(inputs.motion, ti, Q, V, qdd[i])
        work.power[i] = residual(ti, t + 0.5 * h, inputs, Q, V, qdd[i], work.stages[STAGE.residual, i], work)
        if work.ties is not None:
            work.power[i] += pull(i, ti, Q, V, work.stages[STAGE.residual, i], work)


@inlined
def residual(t, middle, inputs, q, qd, qdd, R, work):
    """Write f(t, q, q̇) − M q̈, 0 at prescribed joints; returns the power of non-conservative forces."""
    chain, tau = work.chain, work.vectors[VECTOR.tau]
    tau[:] = 0.0
    stage_torque(inputs.drive, t, middle, q, qd, tau)
    power = put_wrench(inputs.loads, t, middle, q, qd, inputs.wrench)
    power += inverse_dynamics_into(chain, inputs.wrench, q, qd, qdd, R, work.inverse)
    if work.forces is not None and rarely(work.forces.act):
        power -= add_torques(work.forces.elements, q, qd, R)
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


@inlined
def unsettled(h, work):
    """How far [m] the residual torques at joints with dry friction would displace a body without friction.

    With the steep slope of friction at rest, a pass hardly moves such a joint, however far it is from the solution.
    """
    δ, largest = work.vectors[VECTOR.q_middle], 0.0
    if len(work.turning.dry) == 0:
        return largest
    for i in range(work.stages.shape[1]):
        for k in range(len(δ)):
            hinge, δ[k] = work.chain.hinges[k], 0.0
            if hinge.coulomb > 0.0 and not hinge.prescribed and not is_noted(k, work.turning):
                inertia = hinge.armature + inertia_beyond(k, work)
                δ[k] = h * max(h, work.stepper[STEPPER.inverse_ω1]) * work.stages[STAGE.residual, i, k] / inertia
        largest = max(largest, displacement(δ, work.posture))
    return largest


@inlined
def work_is_accurate(moved, q, allowed, work):
    """Whether the stages' powers, computed before the last pass moved a body by `moved`, are accurate enough for W.

    They are accurate if `moved` ≤ 4 tolerances: the error of W over all steps is then no larger than if the path of
    the forces were longer by the tolerance. For a fixed step the limit is 1e-3 times the step's displacement.
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
    """Whether non-conservative forces act: drives, dampers, friction, ties, prescribed motions, the tip wrench."""
    hinges = work.chain.hinges
    works = len(inputs.drive.joints) + len(inputs.motion.joints) > 0
    if inputs.loads is not None:
        works = works or inputs.loads.varies
    if work.forces is not None:
        works = works or work.forces.act
    for k in range(3, len(inputs.wrench)):
        works = works or inputs.wrench[k] != 0.0
    for k in range(len(hinges)):
        works = works or hinges[k].damping > 0.0 or hinges[k].coulomb > 0.0
    if work.ties is not None:
        works = works or len(work.ties.lengths.joints) > 0
        for law in work.ties.law:
            works = works or law != LAW.held
    return works


@recursion
def finish(t, h, inputs, q, qd, work):
    """Write the end of the step; its q̈ is K_s, as the methods are stiffly accurate: b = (a_s1 … a_ss)."""
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
    """Write W and the power at the end of the step."""
    work.stepper[STEPPER.work], work.stepper[STEPPER.power] = done[0], work.power[len(work.power) - 1]
    for i in range(len(work.power)):
        work.stepper[STEPPER.work] += h * work.method.weights[WEIGHT.b, i] * work.power[i]


@subroutine
def estimate(h, qd, qdd, tolerance, work):
    """Error of the step [m]; 0 for a fixed step.

    In the first step, and after a rejection, an error beyond the tolerance is damped a second time, because the error
    of stiff vibrations, as after a jump, would not decrease with h (Hairer & Wanner II, IV.8.20, with J instead of f).
    The slope of dry friction in D is taken at the end of the step: the steepest slope, which the iteration uses last,
    would hide the error of a reversal.
    """
    hγ, vectors = h * work.method.γ, work.vectors
    if hγ == 0.0 or tolerance == math.inf:  # the method has no error estimate, or the step is fixed
        return 0.0
    if len(work.turning.dry) > 0:
        shift_rotors(hγ, work.new[1], work.factors[0], work)
        factor(work.factors[0], work.posture)
    e_q, e_v = vectors[VECTOR.q_middle], vectors[VECTOR.qd_middle]
    for k in range(len(qd)):
        e_q[k], e_v[k] = hγ * qd[k], hγ * qdd[k] if math.isfinite(qdd[k]) else 0.0  # M may be singular at the start
        for i in range(work.stages.shape[1]):
            e_q[k] += h * work.method.weights[WEIGHT.d, i] * work.stages[STAGE.qd, i, k]
            e_v[k] += h * work.method.weights[WEIGHT.d, i] * work.stages[STAGE.qdd, i, k]
    error, times = math.inf, 2 if work.stepper[STEPPER.refusal] > 0.0 or work.stepper[STEPPER.last_step] == 0.0 else 1
    while times > 0 and error >= tolerance:
        error, times = damped_error(h, hγ, e_q, e_v, work), times - 1
    return error


@subroutine
def damped_error(h, hγ, e_q, e_v, work):
    """Damp errors of angles and rates (n,) in place by (1 − hγ₀ J)⁻¹; returns their norm [m].

    (M + A) y = −hγ₀ D e_v − (hγ₀)² K e_v − hγ₀ K e_q,  e_v ← e_v + y,  e_q ← e_q + hγ₀ e_v.
    """
    r, y, factors = work.vectors[VECTOR.rhs], work.vectors[VECTOR.solution], work.factors[0]
    for k in range(len(r)):
        resists = factors[k, FACTORS.A] - work.chain.hinges[k].armature
        r[k] = -resists * e_v[k] - hγ * held(k, work.springs, work.chain) * e_q[k]
    if work.chain.rare is not None:
        add_products(-hγ, -hγ * hγ, work.chain.rare, e_v, r)
        add_products(0.0, -hγ, work.chain.rare, e_q, r)
    solve(factors, r, y, work.posture)
    if work.ties is not None:
        keep(hγ, e_q, e_v, y, work)
    for k in range(len(r)):
        if work.chain.hinges[k].prescribed:
            e_q[k] = e_v[k] = 0.0
        else:
            e_v[k] += y[k]
            e_q[k] += hγ * e_v[k]
    error = step_error_norm(h, e_q, e_v, work.springs, work.posture, work.chain, work.stepper, work.ties)
    return work.stepper[STEPPER.turning] * error if work.turning.count[0] > 0 else error
